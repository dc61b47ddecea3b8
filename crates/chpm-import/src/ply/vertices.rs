//! Vertices: whole blocks of records if they are binary and of fixed length, else number by number.

use super::{
    binary,
    error::Fault,
    header::{Element, Encoding, PropertyType, ScalarType},
    read::Body,
    schema::{Slot, VertexPlan},
};
use crate::batch::Batch;
use crate::location::SourceLocation;
use crate::options::Invalid;
use crate::vertex_format::VertexFormat;
use chpm_mesh::FAR;
use std::io::Read;

impl<R: Read> Body<R> {
    /// Reads vertices until the batch is full or there are no more of them.
    pub(super) fn vertices(
        &mut self,
        element: &Element,
        plan: &VertexPlan,
        format: VertexFormat,
        batch: &mut Batch,
    ) -> Result<(), Fault> {
        while self.index < element.count && batch.vertex_count() < Batch::FULL {
            match (plan.stride, self.source.encoding) {
                (Some(stride), Encoding::BinaryLittleEndian) => {
                    self.records::<false>(element, plan, stride, format, batch)?;
                }
                (Some(stride), Encoding::BinaryBigEndian) => {
                    self.records::<true>(element, plan, stride, format, batch)?;
                }
                _ => self.vertex(element, plan, format, batch)?,
            }
        }
        Ok(())
    }

    /// All records that are in the window and wanted; at least one.
    fn records<const BIG: bool>(
        &mut self,
        element: &Element,
        plan: &VertexPlan,
        stride: usize,
        format: VertexFormat,
        batch: &mut Batch,
    ) -> Result<(), Fault> {
        if !self.source.need(stride)? {
            return Err(Fault::End);
        }
        let bytes = self.source.bytes();
        let mark = batch.vertex_count();
        let room = (Batch::FULL - mark) as u64;
        let count = ((bytes.len() / stride) as u64).min(room).min(element.count - self.index) as usize;
        let records = &bytes[..count * stride];

        // A column at a time, so that no loop asks what a property is.
        // Also false for what is not finite.
        let near = if format.coordinates.are_double() {
            binary::doubles::<BIG>(records, stride, &plan.position, &mut batch.positions_f64);
            batch.positions_f64[mark..].as_flattened().iter().fold(true, |all, x| all & (x.abs() <= FAR))
        } else {
            binary::singles::<BIG>(records, stride, &plan.position, &mut batch.vertices.positions);
            batch.vertices.positions[mark..]
                .as_flattened()
                .iter()
                .fold(true, |all, x| all & (x.abs() <= FAR as f32))
        };
        if let Some(fields) = &plan.normal {
            binary::singles::<BIG>(records, stride, fields, &mut batch.vertices.normals);
            for normal in &mut batch.vertices.normals[mark..] {
                self.tally.zeroed_normals += u64::from(zero_if_not_finite(normal));
            }
        }
        if let Some(fields) = &plan.color {
            binary::colors::<BIG>(records, stride, fields, plan.alpha, &mut batch.vertices.colors);
            self.clamped += binary::clamped::<BIG>(records, stride, fields);
        }
        plan.scalars.read_records::<BIG>(records, stride, &mut batch.vertices.scalars);
        if let Some(fields) = &plan.texture {
            binary::pairs::<BIG>(records, stride, fields, &mut self.coordinates);
        }

        // Rare, so that only then each vertex is looked at.
        if !near {
            self.check_records(element, plan, stride, mark, batch)?;
        }
        self.index += count as u64;
        self.source.consume(count * stride);
        Ok(())
    }

    /// Finds the vertices that are not finite, or far, among those from `mark` on, whose records are the next in the window.
    fn check_records(
        &mut self,
        element: &Element,
        plan: &VertexPlan,
        stride: usize,
        mark: usize,
        batch: &mut Batch,
    ) -> Result<(), Fault> {
        let first = self.index;
        for at in mark..batch.vertex_count() {
            let position = match batch.positions_f64.get(at) {
                Some(position) => *position,
                None => batch.vertices.positions[at].map(f64::from),
            };
            let record = at - mark;
            let Some(axis) = position.iter().position(|x| !x.is_finite()) else {
                if let Some(axis) = position.iter().position(|x| x.abs() > FAR) {
                    let offset = self.source.offset() + (record * stride + plan.position[axis].offset) as u64;
                    let (element, index) = (element.name.clone(), first + record as u64);
                    batch.far.push(SourceLocation { element, index, offset, line: None });
                }
                continue;
            };

            if self.invalid_data == Invalid::Refuse {
                self.index = first + record as u64;
                let field = plan.position[axis];
                self.source.mark = self.source.offset() + (record * stride + field.offset) as u64;
                return Err(not_finite(element, field.property, position[axis]));
            }
            if let Some(position) = batch.positions_f64.get_mut(at) {
                *position = [0.0; 3];
            } else {
                batch.vertices.positions[at] = [0.0; 3];
            }
            self.invalidate(first + record as u64, batch);
        }
        Ok(())
    }

    /// One vertex, number by number.
    fn vertex(
        &mut self,
        element: &Element,
        plan: &VertexPlan,
        format: VertexFormat,
        batch: &mut Batch,
    ) -> Result<(), Fault> {
        let mut position = [0.0; 3];
        let mut normal = [0.0; 3];
        let mut color = [0, 0, 0, 255];
        let mut uv = [0.0; 2];
        let mut valid = true;
        let mut is_clamped = false;
        let is_text = self.source.encoding == Encoding::Ascii;
        // The words of this vertex are filled in the order in which its numbers come.
        let words = batch.vertices.scalars.len();
        batch.vertices.scalars.resize(words + plan.scalars.words(), 0);
        // Where its first coordinate is that is far from zero.
        let mut far = None;
        self.source.begin_element()?;
        for (at, (property, slot)) in element.properties.iter().zip(&plan.slots).enumerate() {
            let (ty, slot) = match (property.ty, slot) {
                (PropertyType::Scalar(ty), slot)
                    if *slot != Slot::Skip || plan.scalars.find(at).is_some() =>
                {
                    (ty, *slot)
                }
                (skipped, _) => {
                    self.source.skip_values([&skipped])?;
                    continue;
                }
            };
            let is_position = matches!(slot, Slot::Position(_));
            // Text is rounded once: to the type of the property, or to what coordinates are delivered as.
            let ty = if is_position && ty == ScalarType::Float && is_text { ScalarType::Double } else { ty };

            let value = self.source.scalar(ty)?;
            if is_position && value.abs() > FAR && far.is_none() {
                far = Some((self.source.mark, self.source.line));
            }
            if let Some(kept) = plan.scalars.find(at) {
                let row = &mut batch.vertices.scalars[words..];
                kept.fill(row, value, self.source.last_float(ty));
            }
            match slot {
                Slot::Skip => {}
                Slot::Position(axis) if value.is_finite() => position[axis] = value,
                Slot::Position(_) if self.invalid_data == Invalid::Refuse => {
                    return Err(not_finite(element, at, value));
                }
                Slot::Position(_) => valid = false,
                Slot::Normal(axis) => normal[axis] = value as f32,
                Slot::Color(channel) => {
                    color[channel] = binary::channel(value, ty);
                    is_clamped |= channel < 3 && binary::is_clamped(value, ty);
                }
                Slot::Texture(axis) => uv[axis] = value as f32,
            }
        }

        if !valid {
            position = [0.0; 3];
            self.invalidate(self.index, batch);
        }
        if valid && let Some((offset, line)) = far {
            let (element, line) = (element.name.clone(), is_text.then_some(line));
            batch.far.push(SourceLocation { element, index: self.index, offset, line });
        }

        if format.coordinates.are_double() {
            batch.positions_f64.push(position);
        } else {
            batch.vertices.positions.push(position.map(|x| x as f32));
        }
        if format.attributes.normals {
            self.tally.zeroed_normals += u64::from(zero_if_not_finite(&mut normal));
            batch.vertices.normals.push(normal);
        }
        if format.attributes.colors {
            batch.vertices.colors.push(color);
            self.clamped += u64::from(is_clamped);
        }
        if plan.texture.is_some() {
            self.coordinates.push(uv);
        }
        self.index += 1;
        Ok(())
    }

    fn invalidate(&mut self, vertex: u64, batch: &mut Batch) {
        self.invalid.insert(vertex);
        self.tally.dropped_vertices += 1;
        batch.invalid_vertices.push(vertex);
    }
}

fn not_finite(element: &Element, property: usize, value: f64) -> Fault {
    Fault::NotFinite { property: element.properties[property].name.clone(), value }
}

/// A normal is a help and no shape: a bad one is no reason to stop.
fn zero_if_not_finite(normal: &mut [f32; 3]) -> bool {
    let bad = !normal.iter().all(|x| x.is_finite());
    if bad {
        *normal = [0.0; 3];
    }
    bad
}
