//! One mesh file while it is read: its vertices, as far as memory goes, and each triangle's corners as soon as they are known.

use super::Counts;
use super::conf::Motion;
use crate::stop;
use anyhow::{Result, bail, ensure};
use bytemuck::Pod;
use chpm_build::Cancel;
use chpm_extmem::{BufferWriter, Column, Store};
use chpm_import::Triangulator;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

/// The corners of a triangle, as the source has them.
pub(super) type Corners = [[f64; 3]; 3];

/// A triangle as it is found.
pub(super) struct Triangle {
    pub(super) corners: Corners,
    /// Its vertices, numbered through all files; corners of their own where facets bring them.
    pub(super) vertices: [u32; 3],
    /// Whether it is a facet, whose corners are joined with others of its file by position.
    pub(super) is_facet: bool,
    /// Whether coordinates are text that the header declares to be of single precision.
    pub(super) is_told_single: bool,
    /// The number of its file's first vertex.
    pub(super) file: u32,
}

/// Vertices of a block that is read at once where not all are in memory, and how many blocks are kept.
const BLOCK: usize = 256;
const BLOCKS: usize = 1 << 10;
/// Words of early faces that are read at once.
const WINDOW: usize = 1 << 16;
/// Calls after which a wish to stop is looked for.
const HEED: u64 = 1 << 14;
/// A triangle of a range grid whose longest edge is more than so many times its shortest is none: it hangs across a step in depth.
const STEP: f64 = 6.0;

/// How sources are read.
pub(super) struct Target<'a> {
    pub(super) store: &'a Store,
    /// Whether what is invalid is left out and counted, not refused.
    pub(super) drops: bool,
    pub(super) cancel: &'a Cancel,
    /// Bytes of its files that are behind us.
    pub(super) read: Arc<AtomicU64>,
}

/// A mesh that is being read, and where its triangles go.
pub(super) struct Mesh<'a> {
    store: &'a Store,
    cancel: &'a Cancel,
    pub(super) drops: bool,
    pub(super) counts: &'a mut Counts,
    sink: &'a mut dyn FnMut(Triangle),
    /// The number of the file's first vertex.
    file: u32,
    calls: u64,
    points: Points,
    motion: Option<&'a Motion>,
    triangulator: Triangulator,
    /// Faces that came before the vertices: the number of corners, then these.
    early: Option<BufferWriter<u32>>,
    /// Whether triangles are those of a range grid.
    pub(super) is_grid: bool,
    /// Whether coordinates are text that the header declares to be of single precision.
    pub(super) is_told_single: bool,
}

/// Vertices, in the precision that the source has.
enum Points {
    None,
    Single(Places<f32>),
    Double(Places<f64>),
}

impl<'a> Mesh<'a> {
    pub(super) fn new(
        target: &Target<'a>,
        motion: Option<&'a Motion>,
        counts: &'a mut Counts,
        sink: &'a mut dyn FnMut(Triangle),
    ) -> Self {
        let &Target { store, drops, cancel, .. } = target;
        let file = counts.vertices;
        Mesh {
            store,
            cancel,
            drops,
            counts,
            sink,
            file,
            calls: 0,
            points: Points::None,
            motion,
            triangulator: Triangulator::default(),
            early: None,
            is_grid: false,
            is_told_single: false,
        }
    }

    /// Looks whether work is to stop, now and then.
    pub(super) fn heed(&mut self) -> Result<()> {
        self.calls += 1;
        if self.calls.is_multiple_of(HEED) { stop::check(self.cancel) } else { Ok(()) }
    }

    /// Vertices begin.
    pub(super) fn begin(&mut self, is_double: bool) -> Result<()> {
        self.points = match is_double {
            true => Points::Double(Places::new(self.store)?),
            false => Points::Single(Places::new(self.store)?),
        };
        Ok(())
    }

    pub(super) fn vertex(&mut self, position: [f64; 3]) -> Result<()> {
        self.heed()?;
        self.number(1)?;
        match &mut self.points {
            Points::None => Ok(()),
            Points::Single(places) => places.push(position.map(|x| x as f32)),
            Points::Double(places) => places.push(position),
        }
    }

    /// The number of the next vertex, of which there are so many.
    fn number(&mut self, count: u32) -> Result<u32> {
        let first = self.counts.vertices;
        let Some(next) = first.checked_add(count) else {
            bail!("the source has more than {} vertices", u32::MAX)
        };
        self.counts.vertices = next;
        Ok(first)
    }

    /// All vertices are there: what comes now can be looked up.
    pub(super) fn end_of_vertices(&mut self) -> Result<()> {
        match &mut self.points {
            Points::None => {}
            Points::Single(places) => places.finish()?,
            Points::Double(places) => places.finish()?,
        }
        let Some(early) = self.early.take() else { return Ok(()) };
        let early = early.finish_column()?;
        let (mut at, mut scratch) = (0, Vec::new());
        while at < early.len() {
            let mut words = early.read(at..early.len().min(at + WINDOW), &mut scratch)?;
            // A face of very many corners has a window of its own.
            if words[0] as usize >= words.len() {
                let len = words[0] as usize + 1;
                words = early.read(at..at + len, &mut scratch)?;
            }
            while let Some((count, rest)) = words.split_first()
                && let Some(corners) = rest.get(..*count as usize)
            {
                self.face(corners)?;
                at += 1 + corners.len();
                words = &rest[corners.len()..];
            }
        }
        Ok(())
    }

    fn point(&mut self, vertex: u32) -> Result<Option<[f64; 3]>> {
        match &mut self.points {
            Points::None => Ok(None),
            Points::Single(places) => places.get(vertex),
            Points::Double(places) => places.get(vertex),
        }
    }

    /// A face of any number of corners, cut as the builder cuts it: which triangles stand for a polygon is not for readers to
    /// find. Triangles that name a vertex twice are left out.
    pub(super) fn face(&mut self, corners: &[u32]) -> Result<()> {
        if !self.is_known() {
            let early = match &mut self.early {
                Some(early) => early,
                none => none.insert(BufferWriter::new(self.store, "source faces", 0)?),
            };
            early.extend_from_slice(&[corners.len() as u32])?;
            return Ok(early.extend_from_slice(corners)?);
        }
        match *corners {
            [a, b, c] => self.triangle([a, b, c]),
            [_, _, _, _, ..] => self.polygon(corners),
            _ => {
                self.counts.degenerate_faces += 1;
                Ok(())
            }
        }
    }

    fn polygon(&mut self, corners: &[u32]) -> Result<()> {
        self.heed()?;
        let (mut places, mut triangles) = (Vec::new(), Vec::new());
        if corners.len() <= Triangulator::EARS {
            for corner in corners {
                let place = self.point(*corner)?.unwrap_or_default();
                // Scans are cut where they lie in the model.
                places.push(self.motion.map_or(place, |motion| motion.of(place)));
            }
        }
        self.counts.polygons_triangulated += 1;
        self.counts.degenerate_faces += self.triangulator.cut(corners, &places, &mut triangles);
        triangles.into_iter().try_for_each(|corners| self.triangle(corners))
    }

    fn is_known(&self) -> bool {
        match &self.points {
            Points::None => false,
            Points::Single(places) => places.column.is_some(),
            Points::Double(places) => places.column.is_some(),
        }
    }

    fn triangle(&mut self, corners: [u32; 3]) -> Result<()> {
        self.heed()?;
        let [a, b, c] = corners;
        if a == b || b == c || c == a {
            self.counts.degenerate_faces += 1;
            return Ok(());
        }
        let mut places = [[0.0; 3]; 3];
        for (place, vertex) in places.iter_mut().zip(corners) {
            let found = self.point(vertex)?;
            ensure!(found.is_some(), "a face of the source names vertex {vertex}, which is not there");
            *place = found.unwrap_or_default();
        }
        if self.is_grid && is_step(places.map(|p| p.map(|x| x as f32))) {
            return Ok(());
        }
        let vertices = corners.map(|vertex| self.file + vertex);
        self.found(places, vertices, false);
        Ok(())
    }

    /// A triangle that brings its own corners.
    pub(super) fn facet(&mut self, corners: Corners) -> Result<()> {
        self.heed()?;
        let [a, b, c] = corners.map(|corner| corner.map(f64::to_bits));
        if a == b || b == c || c == a {
            self.counts.degenerate_faces += 1;
            return Ok(());
        }
        let first = self.number(3)?;
        self.found(corners, [first, first + 1, first + 2], true);
        Ok(())
    }

    fn found(&mut self, corners: Corners, vertices: [u32; 3], is_facet: bool) {
        let (is_told_single, file) = (self.is_told_single, self.file);
        (self.sink)(Triangle { corners, vertices, is_facet, is_told_single, file });
    }
}

fn is_step([a, b, c]: [[f32; 3]; 3]) -> bool {
    let square = |a: [f32; 3], b: [f32; 3]| {
        let [x, y, z] = std::array::from_fn(|axis| f64::from(a[axis]) - f64::from(b[axis]));
        x * x + y * y + z * z
    };
    let (ab, bc, ca) = (square(a, b), square(b, c), square(c, a));
    ab.max(bc).max(ca) > STEP * STEP * ab.min(bc).min(ca)
}

/// Positions by vertex: in memory if the budget has room, else in blocks, of which the last ones are kept.
struct Places<T: Pod> {
    coming: Option<BufferWriter<[T; 3]>>,
    fresh: Vec<[T; 3]>,
    column: Option<Column<[T; 3]>>,
    blocks: Vec<(usize, Vec<[T; 3]>)>,
}

impl<T: Pod + Into<f64>> Places<T> {
    fn new(store: &Store) -> Result<Self> {
        let coming = Some(BufferWriter::new(store, "source positions", 0)?);
        Ok(Places { coming, fresh: Vec::new(), column: None, blocks: Vec::new() })
    }

    fn push(&mut self, position: [T; 3]) -> Result<()> {
        self.fresh.push(position);
        if self.fresh.len() == HEED as usize { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<()> {
        if let Some(coming) = &mut self.coming {
            coming.extend_from_slice(&self.fresh)?;
        }
        self.fresh.clear();
        Ok(())
    }

    fn finish(&mut self) -> Result<()> {
        self.flush()?;
        if let Some(coming) = self.coming.take() {
            let column = coming.finish_column()?;
            if column.is_on_disk() {
                self.blocks.resize_with(BLOCKS, || (usize::MAX, Vec::new()));
            }
            self.column = Some(column);
        }
        Ok(())
    }

    fn get(&mut self, vertex: u32) -> Result<Option<[f64; 3]>> {
        let (Some(column), at) = (&self.column, vertex as usize) else { return Ok(None) };
        if at >= column.len() {
            return Ok(None);
        }
        if let Some(all) = column.as_slice() {
            return Ok(Some(all[at].map(Into::into)));
        }
        let block = at / BLOCK;
        let (held, places) = &mut self.blocks[block % BLOCKS];
        if *held != block {
            let range = block * BLOCK..column.len().min((block + 1) * BLOCK);
            // A range that fails to be read must not be taken for one that was.
            *held = usize::MAX;
            column.read(range, places)?;
            *held = block;
        }
        Ok(Some(places[at % BLOCK].map(Into::into)))
    }
}
