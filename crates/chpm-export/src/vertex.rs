//! A vertex as glTF has it: position, unit normal and linear colour side by side.

use crate::grid::{Grid, small_normal};
use chpm_mesh::{Attributes, Scalar, VertexSlices, scalar_places};

/// Turns vertices into bytes.
pub(crate) struct Interleave {
    attributes: Attributes,
    scalars: Vec<Scalar>,
    /// By a channel of sRGB: the same, linear, in 16 bits. No two are equal.
    linear: Vec<u16>,
    /// With it, positions are 16 bits an axis, normals and colours bytes.
    grid: Option<Grid>,
}

/// Where the parts of a vertex are.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(crate) struct Stride {
    /// Bytes from one vertex to the next.
    pub(crate) bytes: usize,
    /// Of the normal, if there is one.
    pub(crate) normal: Option<usize>,
    /// Of the colour, if there is one.
    pub(crate) color: Option<usize>,
    /// Of the first named scalar; four bytes each.
    pub(crate) scalars: usize,
}

impl Stride {
    pub(crate) fn of(attributes: Attributes, scalars: usize, is_quantized: bool) -> Self {
        // Each part begins at a multiple of four.
        let [position, normal, color] = if is_quantized { [8, 4, 4] } else { [12, 12, 8] };
        let behind_normal = position + if attributes.normals { normal } else { 0 };
        let behind_color = behind_normal + if attributes.colors { color } else { 0 };
        Stride {
            bytes: behind_color + 4 * scalars,
            normal: attributes.normals.then_some(position),
            color: attributes.colors.then_some(behind_normal),
            scalars: behind_color,
        }
    }
}

impl Interleave {
    pub(crate) fn new(attributes: Attributes, scalars: &[Scalar], grid: Option<Grid>) -> Self {
        Interleave { attributes, scalars: scalars.to_vec(), linear: (0..=255).map(linear).collect(), grid }
    }

    /// Appends vertices, which carry what was announced.
    pub(crate) fn append(&self, vertices: VertexSlices<'_>, out: &mut Vec<u8>) {
        debug_assert_eq!(vertices.uneven(), None);
        out.reserve(
            vertices.positions.len()
                * Stride::of(self.attributes, self.scalars.len(), self.grid.is_some()).bytes,
        );
        for (at, position) in vertices.positions.iter().enumerate() {
            match &self.grid {
                Some(grid) => put_small(out, small_position(grid, *position)),
                None => put(out, *position),
            }
            if self.attributes.normals {
                let normal = unit(vertices.normals.get(at).copied().unwrap_or_default());
                match self.grid {
                    Some(_) => out.extend_from_slice(bytemuck::bytes_of(&small_direction(normal))),
                    None => put(out, normal),
                }
            }
            if self.attributes.colors {
                let [red, green, blue, alpha] = vertices.colors.get(at).copied().unwrap_or_default();
                let light = [red, green, blue].map(|channel| self.linear[usize::from(channel)]);
                match self.grid {
                    // Sixteen bits are 257 times eight.
                    Some(_) => out.extend(
                        light.map(|light| ((u32::from(light) + 128) / 257) as u8).into_iter().chain([alpha]),
                    ),
                    None => put_small(out, [light[0], light[1], light[2], u16::from(alpha) * 257]),
                }
            }
            for (place, scalar) in scalar_places(&self.scalars) {
                let value = scalar.kind.value(&vertices.scalars_of(at)[place]);
                out.extend(finite(value).to_le_bytes());
            }
        }
    }
}

/// A value as glTF has it: the nearest single, and 0 for what is no number, since it allows nothing else.
fn finite(value: f64) -> f32 {
    if value.is_nan() { 0.0 } else { (value as f32).clamp(-f32::MAX, f32::MAX) }
}

fn put(out: &mut Vec<u8>, [x, y, z]: [f32; 3]) {
    let mut bytes = [0; 12];
    for (to, number) in bytes.as_chunks_mut::<4>().0.iter_mut().zip([x, y, z]) {
        *to = number.to_le_bytes();
    }
    out.extend_from_slice(&bytes);
}

fn put_small(out: &mut Vec<u8>, numbers: [u16; 4]) {
    numbers.into_iter().for_each(|number| out.extend(number.to_le_bytes()));
}

/// A position on a lattice, and room up to a multiple of four.
pub(crate) fn small_position(grid: &Grid, position: [f32; 3]) -> [u16; 4] {
    let [x, y, z] = grid.nearest(position);
    [x, y, z, 0]
}

/// A unit normal in bytes, and room up to a multiple of four.
pub(crate) fn small_direction(normal: [f32; 3]) -> [i8; 4] {
    let [x, y, z] = small_normal(normal);
    [x, y, z, 0]
}

/// The normal with length 1, as glTF has them. One without a direction gets any.
pub(crate) fn unit(normal: [f32; 3]) -> [f32; 3] {
    let wide = normal.map(f64::from);
    let length = wide.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length > 0.0 { wide.map(|x| (x / length) as f32) } else { [0.0, 0.0, 1.0] }
}

/// A channel of sRGB as light.
fn linear(channel: u8) -> u16 {
    let value = f64::from(channel) / 255.0;
    let light = if value <= 0.04045 { value / 12.92 } else { libm::pow((value + 0.055) / 1.055, 2.4) };
    (light * 65535.0).round() as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_stay_apart_and_normals_have_length_one() {
        let all: Vec<u16> = (0..=255).map(linear).collect();
        assert!(all.is_sorted_by(|a, b| a < b), "{all:?}");
        assert_eq!((all[0], all[255], all[188]), (0, 65535, 32957));
        for normal in [[3.0, 0.0, -4.0], [1e-30, 1e-30, 0.0], [1e38, 1e38, 1e38], [0.0; 3], [1e-45, 0.0, 0.0]]
        {
            let length: f64 = unit(normal).iter().map(|x| f64::from(*x).powi(2)).sum();
            assert!((length - 1.0).abs() < 1e-6, "{normal:?}");
        }
    }

    #[test]
    fn attributes_lie_one_after_the_other() {
        let stride = |normals, colors| {
            let attributes = Attributes { normals, colors, ..Attributes::NONE };
            let with = Stride::of(attributes, 2, false);
            let Stride { bytes, normal, color, scalars } = Stride::of(attributes, 0, false);
            assert_eq!((with.bytes, with.scalars, scalars), (bytes + 8, bytes, bytes));
            (bytes, normal, color)
        };
        assert_eq!(stride(false, false), (12, None, None));
        assert_eq!(stride(true, false), (24, Some(12), None));
        assert_eq!(stride(false, true), (20, None, Some(12)));
        assert_eq!(stride(true, true), (32, Some(12), Some(24)));
    }

    #[test]
    fn quantized_parts_begin_at_multiples_of_four() {
        let attributes = Attributes { normals: true, colors: true, ..Attributes::NONE };
        let stride = Stride::of(attributes, 1, true);
        assert_eq!((stride.bytes, stride.normal, stride.color, stride.scalars), (20, Some(8), Some(12), 16));
        assert_eq!(Stride::of(Attributes::NONE, 0, true).bytes, 8);

        let bounds = chpm_mesh::Aabb { min: [0.0; 3], max: [65_535.0; 3] };
        let interleave = Interleave::new(attributes, &[], Some(Grid::over(&bounds)));
        let mut out = Vec::new();
        interleave.append(
            VertexSlices {
                normals: &[[0.0, -2.0, 0.0]],
                colors: &[[0, 255, 188, 9]],
                ..VertexSlices::new(&[[1.4, 258.0, 65_535.0]])
            },
            &mut out,
        );
        assert_eq!(out, [1, 0, 2, 1, 255, 255, 0, 0, 0, 129, 0, 0, 0, 255, 128, 9]);
    }
}
