//! The looks of a cluster's mesh: colours of its vertices, and which way they face.

use super::Paint;
use super::borders::Borders;
use super::eye::Vector;
use chpm_format::{ClusterRecord, Page};
use chpm_mesh::facing::{FLAT, Facing, facings};
use chpm_mesh::{Places, viridis};
use chpm_texture::sheet::Painted;

/// The colour where there is none, and of what is no number.
pub(super) const PLAIN: [f64; 3] = [0.78, 0.76, 0.72];
const NONE: [u8; 3] = [128; 3];

/// The mesh of a cluster that rays meet.
#[derive(Debug)]
pub(super) struct Skin {
    /// Corners of each triangle of the page, dead ones as well.
    triangles: Vec<[u16; 3]>,
    positions: Vec<[f32; 3]>,
    /// By vertex, or none where triangles are flat.
    codes: Vec<u32>,
    /// By vertex, or none where there are no colours.
    colors: Vec<[u8; 3]>,
    /// By vertex, where values are shown instead of colours.
    values: Vec<f64>,
    /// The image of its surface, where that is shown.
    pub(super) sheet: Option<Painted>,
}

/// A corner of a triangle that was met.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner {
    pub(super) at: Vector,
    pub(super) facing: Facing,
}

impl Skin {
    /// Bytes that it takes, and what is only needed to make it.
    pub(super) fn bytes_of(record: &ClusterRecord) -> u64 {
        6 * u64::from(record.triangle_count) + 24 * u64::from(record.vertex_count) + 200
    }

    /// Of a page's base mesh or its finest; with `borders` smooth, as far as the file has no normals.
    pub(super) fn new(page: &Page<'_>, is_finest: bool, paint: &Paint, borders: Option<&Borders>) -> Self {
        let n = if is_finest { page.vertex_count() } else { page.base_vertex_count };
        let mut places = Places::default();
        places.go_to(&page.progressive_mesh(), n);
        let triangles = page.triangles.iter().map(|corners| corners.map(|v| places.of(v))).collect();

        let mut codes = Vec::new();
        if let Some(borders) = borders {
            if page.attributes().has_normals() {
                let normal = |vertex: usize| page.normal(vertex).unwrap_or_default();
                codes.extend((0..n).map(|vertex| Facing::of_normal(normal(vertex)).code()));
            } else {
                codes.extend(facings(page.positions, page.triangles).into_iter().take(n).map(Facing::code));
                for (vertex, id) in page.shared() {
                    if let (Some(own), Some(code)) = (codes.get_mut(usize::from(vertex)), borders.code(id)) {
                        *own = code;
                    }
                }
            }
        }
        let (mut colors, mut values) = (Vec::new(), Vec::new());
        match paint {
            Paint::Plain => {}
            Paint::Own => colors.extend(page.colors.iter().take(n).map(|[r, g, b, _]| [*r, *g, *b])),
            Paint::Scalar(words, scalar) => {
                let value = |vertex| scalar.kind.value(&page.scalars_of(vertex)[words.clone()]);
                values.extend((0..n).map(value));
            }
        }
        Skin { triangles, positions: page.positions[..n].to_vec(), codes, colors, values, sheet: None }
    }

    /// The corners of a triangle, by its place in the page.
    pub(super) fn corners(&self, triangle: u32) -> [Corner; 3] {
        self.triangles[triangle as usize].map(|vertex| {
            let vertex = usize::from(vertex);
            let code = self.codes.get(vertex).copied().unwrap_or(FLAT);
            Corner { at: self.positions[vertex].map(f64::from).into(), facing: Facing::of_code(code) }
        })
    }

    /// How much of a point of a triangle is there, 0 to 1.
    pub(super) fn opacity(&self, triangle: u32, point: [f64; 3], seen: f64) -> f64 {
        self.sheet.as_ref().map_or(1.0, |sheet| sheet.texel(triangle, point, seen)[3])
    }

    /// The colour of a point of a triangle, by its corners' shares, and where there is an image by the point itself and how much of it a ray sees. What is mixed of values is the value, since between two colours of a scale there may be
    /// others than their mixture; a corner whose value is no number has a colour all the same.
    pub(super) fn color(
        &self,
        triangle: u32,
        shares: [f64; 3],
        (point, seen): ([f64; 3], f64),
        paint: &Paint,
    ) -> [f64; 3] {
        if let Some(sheet) = &self.sheet {
            let [red, green, blue, _] = sheet.texel(triangle, point, seen);
            return [red, green, blue];
        }
        let corners = self.triangles[triangle as usize].map(usize::from);
        let of_scale = |value| match paint {
            Paint::Scalar(_, scalar) => scalar.range.fraction(value).map_or(NONE, viridis),
            _ => NONE,
        };
        let colors = if self.values.is_empty() {
            let color =
                |vertex: usize| self.colors.get(vertex).map(|color| color.map(|c| f64::from(c) / 255.0));
            corners.map(|vertex| color(vertex).unwrap_or(PLAIN))
        } else {
            let values = corners.map(|vertex| self.values[vertex]);
            let mixed: f64 = (0..3).map(|i| shares[i] * values[i]).sum();
            let colors = if mixed.is_finite() { [mixed; 3] } else { values }.map(of_scale);
            colors.map(|color| color.map(|c| f64::from(c) / 255.0))
        };
        [0, 1, 2].map(|c| (0..3).map(|i| shares[i] * colors[i][c]).sum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_mesh::{Scalar, ScalarKind, ScalarRange};

    #[test]
    fn between_values_there_are_the_colours_of_the_scale() {
        let mut scalar = Scalar::new("height", ScalarKind::Float64);
        scalar.range = ScalarRange { low: 0.0, high: 4.0, count: 2 };
        let paint = Paint::Scalar(0..2, scalar);
        let skin = |values: [f64; 3]| Skin {
            triangles: vec![[2, 0, 1]],
            positions: vec![[0.0; 3]; 3],
            codes: Vec::new(),
            colors: Vec::new(),
            values: values.to_vec(),
            sheet: None,
        };
        const NOWHERE: ([f64; 3], f64) = ([0.0; 3], 0.0);
        let near = |a: [f64; 3], b: [u8; 3]| (0..3).all(|c| (a[c] - f64::from(b[c]) / 255.0).abs() < 1e-9);
        let two = skin([0.0, 4.0, 2.0]);
        assert!(near(two.color(0, [0.0, 0.5, 0.5], NOWHERE, &paint), viridis(0.5)));
        assert!(near(two.color(0, [0.5, 0.25, 0.25], NOWHERE, &paint), viridis(0.5)));
        assert!(near(two.color(0, [0.0, 0.75, 0.25], NOWHERE, &paint), viridis(0.25)));
        // Grey is what has no value, and what is near to it.
        let some = skin([f64::NAN, 4.0, 4.0]);
        assert!(near(some.color(0, [0.0, 1.0, 0.0], NOWHERE, &paint), NONE));
        assert!(near(some.color(0, [1.0, 0.0, 0.0], NOWHERE, &paint), viridis(1.0)));
    }
}
