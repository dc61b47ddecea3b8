//! The looks of a cluster's mesh: colours of its vertices, and which way they face.

use super::Paint;
use super::borders::Borders;
use super::eye::Vector;
use chpm_format::{ClusterRecord, Page};
use chpm_mesh::facing::{FLAT, Facing, facings};
use chpm_mesh::{Places, viridis};

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
}

/// A corner of a triangle that was met.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner {
    pub(super) at: Vector,
    pub(super) facing: Facing,
    pub(super) color: [f64; 3],
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
        let color = |vertex: usize| match paint {
            Paint::Plain => None,
            Paint::Own => page.colors.get(vertex).map(|[r, g, b, _]| [*r, *g, *b]),
            Paint::Scalar(words, scalar) => {
                let value = scalar.kind.value(&page.scalars_of(vertex)[words.clone()]);
                Some(scalar.range.fraction(value).map_or(NONE, viridis))
            }
        };
        let colors = (0..n).map_while(color).collect();
        Skin { triangles, positions: page.positions[..n].to_vec(), codes, colors }
    }

    /// The corners of a triangle, by its place in the page.
    pub(super) fn corners(&self, triangle: u32) -> [Corner; 3] {
        self.triangles[triangle as usize].map(|vertex| {
            let vertex = usize::from(vertex);
            let code = self.codes.get(vertex).copied().unwrap_or(FLAT);
            let color = self.colors.get(vertex).map(|color| color.map(|c| f64::from(c) / 255.0));
            Corner {
                at: self.positions[vertex].map(f64::from).into(),
                facing: Facing::of_code(code),
                color: color.unwrap_or(PLAIN),
            }
        })
    }
}
