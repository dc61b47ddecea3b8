//! Faces and strips: corners checked, strips cut into triangles.

use super::{
    binary,
    error::Fault,
    header::{Element, Encoding, PropertyType, ScalarType},
    read::Body,
    schema::ListPlan,
};
use crate::batch::{Batch, MAX_CORNERS};
use crate::options::Invalid;
use std::io::Read;

/// Where the reader is inside a list of strips, which may be longer than any batch.
#[derive(Debug, Default)]
pub(super) struct Strip {
    /// Whether the length of the list has been read.
    open: bool,
    /// Entries of the list that are still to come.
    remaining: u64,
    /// Corners since the last restart.
    run: u64,
    /// The last two corners; one that is no vertex is none.
    last: [Option<u32>; 2],
}

impl<R: Read> Body<R> {
    /// Reads faces until the batch is full or there are no more of them.
    pub(super) fn faces(
        &mut self,
        element: &Element,
        plan: &ListPlan,
        batch: &mut Batch,
    ) -> Result<(), Fault> {
        while self.wedges.is_some() && self.index < element.count && !batch.is_full_of_faces() {
            self.textured_face(element, plan, batch)?;
        }
        while self.index < element.count && !batch.is_full_of_faces() {
            match self.source.encoding {
                Encoding::Ascii => {}
                Encoding::BinaryLittleEndian => self.block::<false>(element, plan, batch)?,
                Encoding::BinaryBigEndian => self.block::<true>(element, plan, batch)?,
            }
            // Whatever stopped the block is one face for the slow way, which says what is wrong with it.
            if self.index < element.count && !batch.is_full_of_faces() {
                self.face(element, plan, batch)?;
            }
        }
        Ok(())
    }

    /// All plain triangles that are next in the window and wanted; possibly none.
    fn block<const BIG: bool>(
        &mut self,
        element: &Element,
        plan: &ListPlan,
        batch: &mut Batch,
    ) -> Result<(), Fault> {
        let small = matches!(plan.count, ScalarType::UChar | ScalarType::Char);
        let highest = match plan.item {
            // What is negative as an `int` is not in range as a `u32`.
            ScalarType::Int => self.vertex_count.min(1 << 31),
            ScalarType::UInt => self.vertex_count,
            _ => return Ok(()),
        };
        let Some((before, after)) = plan.around.filter(|_| small && self.invalid.is_empty()) else {
            return Ok(());
        };
        let stride = before + 13 + after;
        if !self.source.need(stride)? {
            return Ok(());
        }
        let bytes = self.source.bytes();
        let room = (Batch::FULL - batch.triangles.len()) as u64;
        let count = ((bytes.len() / stride) as u64).min(room).min(element.count - self.index) as usize;
        let faces = &bytes[..count * stride];
        let (read, degenerate) =
            binary::triangles::<BIG>(faces, (before, after), highest as u32, &mut batch.triangles);
        self.tally.degenerate_faces += degenerate as u64;
        self.index += read as u64;
        self.source.consume(read * stride);
        Ok(())
    }

    /// One face of any number of corners.
    fn face(&mut self, element: &Element, plan: &ListPlan, batch: &mut Batch) -> Result<(), Fault> {
        self.source.begin_element()?;
        self.source.skip_values(types(element, 0..plan.property))?;
        let count = self.source.count(plan.count)?;
        if count > MAX_CORNERS {
            return Err(Fault::TooManyCorners(count));
        }

        self.corners.clear();
        for _ in 0..count {
            if let Some(corner) = self.corner(plan.item)? {
                self.corners.push(corner);
            }
        }
        self.source.skip_values(types(element, plan.property + 1..element.properties.len()))?;

        if self.corners.len() as u64 == count {
            let _ = batch.push_face(&self.corners, &mut self.tally);
        } else {
            self.tally.dropped_faces += 1;
        }
        self.index += 1;
        Ok(())
    }

    /// Reads lists of strips until the batch is full or there are no more of them.
    pub(super) fn strips(
        &mut self,
        element: &Element,
        plan: &ListPlan,
        batch: &mut Batch,
    ) -> Result<(), Fault> {
        while self.index < element.count {
            if !self.strip.open {
                self.source.begin_element()?;
                self.source.skip_values(types(element, 0..plan.property))?;
                let remaining = self.source.count(plan.count)?;
                self.strip = Strip { open: true, remaining, ..Strip::default() };
            }
            while self.strip.remaining > 0 {
                if batch.triangles.len() >= Batch::FULL {
                    return Ok(());
                }
                self.strip_corner(plan.item, batch)?;
                self.strip.remaining -= 1;
            }
            self.source.skip_values(types(element, plan.property + 1..element.properties.len()))?;
            self.strip.open = false;
            self.index += 1;
        }
        Ok(())
    }

    /// One entry of a strip, and the triangle that it completes; every other triangle is turned round.
    fn strip_corner(&mut self, ty: ScalarType, batch: &mut Batch) -> Result<(), Fault> {
        let index = self.source.index(ty)?;
        // An unsigned list can hold -1 only as the index that no vertex can have.
        if index == -1 || index == i64::from(u32::MAX) {
            self.strip.run = 0;
            return Ok(());
        }
        let corner = self.check(index)?;
        let Strip { run, last: [a, b], .. } = self.strip;
        self.strip.last = [b, corner];
        self.strip.run = run + 1;
        self.tally.strips += u64::from(run == 2);
        if run >= 2 {
            match (a, b, corner) {
                (Some(a), Some(b), Some(c)) if a == b || b == c || c == a => self.tally.degenerate_faces += 1,
                (Some(a), Some(b), Some(c)) if run % 2 == 0 => batch.triangles.push([a, b, c]),
                (Some(a), Some(b), Some(c)) => batch.triangles.push([b, a, c]),
                _ => self.tally.dropped_faces += 1,
            }
        }
        Ok(())
    }

    /// The next corner, or none if it is no valid vertex and such are dropped.
    pub(super) fn corner(&mut self, ty: ScalarType) -> Result<Option<u32>, Fault> {
        let index = self.source.index(ty)?;
        self.check(index)
    }

    fn check(&self, index: i64) -> Result<Option<u32>, Fault> {
        let vertex = u32::try_from(index).ok().filter(|vertex| u64::from(*vertex) < self.vertex_count);
        match (vertex, self.invalid_data) {
            (None, Invalid::Refuse) => Err(Fault::Index(index)),
            (vertex, _) => Ok(vertex.filter(|vertex| !self.invalid.contains(u64::from(*vertex)))),
        }
    }
}

fn types(element: &Element, range: std::ops::Range<usize>) -> impl Iterator<Item = &PropertyType> {
    element.properties[range].iter().map(|property| &property.ty)
}
