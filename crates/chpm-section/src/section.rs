//! Sections of a file: which pages planes cross, and the lines on each plane.

use crate::error::SectionError;
use crate::line::{Line, Part, joined};
use crate::nest::nest;
use crate::pieces::Pieces;
use crate::planes::{Planes, dot};
use chpm_format::Chpm;
use chpm_mesh::Bytes;
use chpm_refine::{Cut, Member};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Lines that a plane cuts out of a mesh.
#[derive(Clone, PartialEq, Debug)]
pub struct Section {
    /// The plane's distance from the zero point.
    pub offset: f64,
    /// Lines: the same, in the same order, in whatever order the file has its pages.
    pub lines: Vec<Line>,
}

/// A sum that is 0 of no numbers, and not -0.
fn sum(numbers: impl Iterator<Item = f64>) -> f64 {
    numbers.sum::<f64>() + 0.0
}

impl Section {
    /// Area between lines of even depth and those in them; none where closed lines cross each other.
    pub fn area(&self) -> Option<f64> {
        let signed = |line: &Line| if line.depth.is_multiple_of(2) { line.area } else { -line.area };
        (self.crossing() == 0).then(|| sum(self.lines.iter().map(signed)))
    }

    /// Closed lines that cross others.
    pub fn crossing(&self) -> u64 {
        self.lines.iter().filter(|line| line.crosses).count() as u64
    }

    /// Length of all lines.
    pub fn length(&self) -> f64 {
        sum(self.lines.iter().map(|line| line.length))
    }

    /// Ends of lines that are not closed: where the surface has a boundary.
    pub fn open_ends(&self) -> u64 {
        2 * self.lines.iter().filter(|line| !line.is_closed).count() as u64
    }

    /// Points of all lines.
    pub fn points(&self) -> u64 {
        self.lines.iter().map(|line| line.points.len() as u64).sum()
    }
}

/// Pages: how many of them, and their bytes in the file.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Pages {
    /// Those whose boxes a plane crosses, and which so are read.
    pub read: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Those of them that have a triangle on both sides of a plane.
    pub crossed: u64,
}

/// Planes that are cut side by side at most: what a thread holds of one page is bounded by their number.
const AT_ONCE: usize = 64;

/// A mesh that is to be cut, and by what.
#[derive(Debug)]
pub struct Slicer<'a, D> {
    file: &'a Chpm<D>,
    /// About the file's origin.
    planes: Planes,
    offsets: Vec<f64>,
    /// Clusters whose boxes are crossed, and by which planes.
    members: Vec<(Member, Range<usize>)>,
    /// Whether triangles of these are.
    crossed: Vec<bool>,
    /// The first plane that has not been told, and how many go on side by side.
    next: usize,
    at_once: usize,
}

impl<'a, D: AsRef<[u8]> + Sync> Slicer<'a, D> {
    /// Finds the clusters of a cut that planes cross; reads no page.
    pub fn new(file: &'a Chpm<D>, cut: &Cut, planes: &Planes) -> Self {
        let offsets = planes.offsets().to_vec();
        let planes = planes.about(file.header().origin);
        let through = |member: &Member| planes.through(&file.clusters()[member.cluster.index()].aabb());
        let members = cut.members().iter().map(|member| (*member, through(member)));
        let members: Vec<_> = members.filter(|(_, range)| !range.is_empty()).collect();
        let crossed = vec![false; members.len()];
        Slicer { file, planes, offsets, members, crossed, next: 0, at_once: AT_ONCE }
    }

    /// The file that is cut.
    pub fn file(&self) -> &'a Chpm<D> {
        self.file
    }

    /// The corners of a box in the plane, along its axes and relative to the file's origin, that holds all lines; none if no cluster is crossed.
    pub fn bounds(&self) -> Option<[[f64; 2]; 2]> {
        let axes = self.planes.axes();
        let mut bounds: Option<[[f64; 2]; 2]> = None;
        for (member, _) in &self.members {
            let aabb = self.file.clusters()[member.cluster.index()].aabb();
            for corner in 0..8 {
                let pick =
                    |axis: usize| if corner >> axis & 1 == 0 { aabb.min[axis] } else { aabb.max[axis] };
                let at = axes.map(|axis| dot(axis, std::array::from_fn(|i| f64::from(pick(i)))));
                let [low, high] = bounds.get_or_insert([at, at]);
                *low = [low[0].min(at[0]), low[1].min(at[1])];
                *high = [high[0].max(at[0]), high[1].max(at[1])];
            }
        }
        bounds
    }

    /// The sections of the next planes, in ascending order, on the threads of rayon's current pool; none when all have been told. As many planes are cut side by side as
    /// have their lines in `room`; that shows in nothing but how often a page is read. Asks `go_on` before each page.
    ///
    /// # Errors
    /// [`SectionError::Format`] for a damaged page, [`SectionError::TooLarge`] where a single plane has too many lines, [`SectionError::Stopped`].
    pub fn next_sections(
        &mut self,
        room: Bytes,
        go_on: impl Fn() -> bool + Sync,
    ) -> Result<Vec<Section>, SectionError> {
        loop {
            let batch = self.next..self.offsets.len().min(self.next + self.at_once);
            match self.cut(batch.clone(), room, &go_on) {
                Err(SectionError::TooLarge { .. }) if batch.len() > 1 => self.at_once = batch.len() / 2,
                Err(error) => return Err(error),
                Ok(pieces) => {
                    for (member, pieces) in &pieces {
                        self.crossed[*member] |= !pieces.pieces.is_empty();
                    }
                    self.next = batch.end;
                    return Ok(self.sections(batch, &pieces));
                }
            }
        }
    }

    /// Pages of all planes; those that are crossed of the planes that have been told.
    pub fn pages(&self) -> Pages {
        let record = |(member, _): &(Member, _)| &self.file.clusters()[member.cluster.index()];
        Pages {
            read: self.members.len() as u64,
            bytes: self.members.iter().map(|member| u64::from(record(member).page_len)).sum(),
            crossed: self.crossed.iter().filter(|is_crossed| **is_crossed).count() as u64,
        }
    }

    /// The pieces of all clusters that some of the planes cross, and their numbers.
    fn cut(
        &self,
        batch: Range<usize>,
        room: Bytes,
        go_on: &(impl Fn() -> bool + Sync),
    ) -> Result<Vec<(usize, Pieces)>, SectionError> {
        let taken = AtomicU64::new(0);
        let members = self.members.par_iter().enumerate().filter_map(|(number, (member, range))| {
            let range = range.start.max(batch.start)..range.end.min(batch.end);
            (!range.is_empty()).then_some((number, member, range))
        });
        let pieces = members.map(|(number, member, range)| {
            if !go_on() {
                return Err(SectionError::Stopped);
            }
            let page = self.file.page(member.cluster)?;
            let pieces = Pieces::cut(&page.view(), member.vertices as usize, &self.planes, range);
            let bytes = pieces.bytes();
            if taken.fetch_add(bytes, Relaxed) + bytes > room.0 {
                return Err(SectionError::TooLarge { offset: self.offsets[batch.start], room });
            }
            Ok((number, pieces))
        });
        pieces.collect()
    }

    fn sections(&self, batch: Range<usize>, pieces: &[(usize, Pieces)]) -> Vec<Section> {
        let mut parts: Vec<Vec<Part<'_>>> = vec![Vec::new(); batch.len()];
        for (_, of) in pieces {
            for piece in &of.pieces {
                parts[piece.plane as usize - batch.start].push(Part::new(of, piece));
            }
        }
        let offsets = &self.offsets[batch];
        let sections = offsets.par_iter().zip(parts).map(|(offset, parts)| {
            let mut lines = joined(&parts);
            nest(&mut lines, self.planes.axes());
            Section { offset: *offset, lines }
        });
        sections.collect()
    }
}
