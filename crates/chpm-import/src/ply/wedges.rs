//! Faces that have texture coordinates of their corners, or say which image they are of.

use super::{
    error::Fault,
    header::{Element, PropertyType},
    read::Body,
    schema::ListPlan,
};
use crate::batch::{Batch, MAX_CORNERS};
use crate::texture::Cutter;
use std::io::Read;

/// How faces name images.
pub(super) struct Wedges {
    /// Materials by the numbers of images.
    pub(super) materials: Vec<u32>,
    /// Properties of a face: the list of coordinates, and the number of the image; the first where there is none.
    pub(super) coordinates: Option<usize>,
    pub(super) number: Option<usize>,
    pub(super) cutter: Cutter,
    pub(super) uv: Vec<[f32; 2]>,
    /// Faces whose image or coordinates are none that there may be.
    pub(super) wrong: u64,
}

impl<R: Read> Body<R> {
    /// One face of any number of corners, with what it says of images.
    pub(super) fn textured_face(
        &mut self,
        element: &Element,
        plan: &ListPlan,
        batch: &mut Batch,
    ) -> Result<(), Fault> {
        let Some(mut wedges) = self.wedges.take() else { return Ok(()) };
        self.source.begin_element()?;
        let (mut count, mut number) = (0, 0.0);
        self.corners.clear();
        wedges.uv.clear();
        for (at, property) in element.properties.iter().enumerate() {
            match property.ty {
                _ if at == plan.property => {
                    count = self.length(plan.count, MAX_CORNERS)?;
                    for _ in 0..count {
                        if let Some(corner) = self.corner(plan.item)? {
                            self.corners.push(corner);
                        }
                    }
                }
                PropertyType::List { count, item } if wedges.coordinates == Some(at) => {
                    let count = self.length(count, 2 * MAX_CORNERS)?;
                    for at in 0..count {
                        let value = self.source.scalar(item)? as f32;
                        match at % 2 {
                            0 => wedges.uv.push([value, f32::NAN]),
                            _ => wedges.uv.last_mut().into_iter().for_each(|uv| uv[1] = value),
                        }
                    }
                }
                PropertyType::Scalar(ty) if wedges.number == Some(at) => number = self.source.scalar(ty)?,
                ty => self.source.skip_values([&ty])?,
            }
        }

        if self.corners.len() as u64 != count {
            self.tally.dropped_faces += 1;
        } else if batch.push_face(&self.corners, &mut self.tally) {
            wedges.add(&self.corners, number, batch);
        }
        self.index += 1;
        self.wedges = Some(wedges);
        Ok(())
    }

    /// The length of a list, which is at most `limit`.
    fn length(&mut self, ty: super::ScalarType, limit: u64) -> Result<u64, Fault> {
        let count = self.source.count(ty)?;
        if count > limit { Err(Fault::TooManyCorners(count)) } else { Ok(count) }
    }
}

impl Wedges {
    /// A face of the image of this number, if there is one. Coordinates that vertices have are not known here. A face without an image is of number -1, or has
    /// no coordinates.
    fn add(&mut self, corners: &[u32], number: f64, batch: &mut Batch) {
        if self.coordinates.is_none() {
            self.uv.resize(corners.len(), [f32::NAN; 2]);
        }
        let is_number = number >= 0.0 && number < self.materials.len() as f64;
        if is_number && self.uv.len() == corners.len() {
            let material = self.materials[number as usize];
            self.cutter.cut(corners, &self.uv, material, &mut batch.textured);
        } else if number != -1.0 && !self.uv.is_empty() {
            self.wrong += 1;
        }
    }
}
