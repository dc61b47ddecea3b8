//! A vertex as glTF has it: position, unit normal and linear colour side by side.

use chpm_mesh::{Attributes, Scalar, VertexSlices, scalar_places};

/// Turns vertices into bytes.
pub(crate) struct Interleave {
    attributes: Attributes,
    scalars: Vec<Scalar>,
    /// By a channel of sRGB: the same, linear, in 16 bits. No two are equal.
    linear: Vec<u16>,
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
    pub(crate) fn of(attributes: Attributes, scalars: usize) -> Self {
        let behind_normal = 12 + if attributes.normals { 12 } else { 0 };
        let behind_color = behind_normal + if attributes.colors { 8 } else { 0 };
        Stride {
            bytes: behind_color + 4 * scalars,
            normal: attributes.normals.then_some(12),
            color: attributes.colors.then_some(behind_normal),
            scalars: behind_color,
        }
    }
}

impl Interleave {
    pub(crate) fn new(attributes: Attributes, scalars: &[Scalar]) -> Self {
        Interleave { attributes, scalars: scalars.to_vec(), linear: (0..=255).map(linear).collect() }
    }

    /// Appends vertices, which carry what was announced.
    pub(crate) fn append(&self, vertices: VertexSlices<'_>, out: &mut Vec<u8>) {
        debug_assert_eq!(vertices.uneven(), None);
        out.reserve(vertices.positions.len() * Stride::of(self.attributes, self.scalars.len()).bytes);
        for (at, position) in vertices.positions.iter().enumerate() {
            put(out, *position);
            if self.attributes.normals {
                put(out, unit(vertices.normals.get(at).copied().unwrap_or_default()));
            }
            if self.attributes.colors {
                let [red, green, blue, alpha] = vertices.colors.get(at).copied().unwrap_or_default();
                for channel in [red, green, blue] {
                    out.extend(self.linear[usize::from(channel)].to_le_bytes());
                }
                out.extend((u16::from(alpha) * 257).to_le_bytes());
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

/// The normal with length 1, as glTF has them. One without a direction gets any.
fn unit(normal: [f32; 3]) -> [f32; 3] {
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
            let with = Stride::of(attributes, 2);
            let Stride { bytes, normal, color, scalars } = Stride::of(attributes, 0);
            assert_eq!((with.bytes, with.scalars, scalars), (bytes + 8, bytes, bytes));
            (bytes, normal, color)
        };
        assert_eq!(stride(false, false), (12, None, None));
        assert_eq!(stride(true, false), (24, Some(12), None));
        assert_eq!(stride(false, true), (20, None, Some(12)));
        assert_eq!(stride(true, true), (32, Some(12), Some(24)));
    }
}
