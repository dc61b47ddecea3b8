//! A cluster as the GPU has it: its vertices, written once, and behind them room for the triangles of any position of its progressive
//! mesh.
//!
//! A unit is a vertex: position, normal, and colour if the file has colours. So a block can start wherever a vertex could, and its first
//! unit is the number that is added to its corners. The corners are those of one position, in the order of the file; they are written
//! whenever the position is another one ([`super::Arena::move_to`]), and are all that is written again.

use chpm_format::Page;
use chpm_mesh::octahedral;
use nalgebra::Vector3;

/// Words of a vertex.
pub fn words_of_unit(colors: bool) -> u32 {
    if colors { 5 } else { 4 }
}

/// The parts of a block.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Layout {
    /// Vertices of the finest mesh: units, from its start.
    pub vertices: u32,
    /// Triangles of the finest mesh, for the corners of which there is room behind the vertices.
    pub triangles: u32,
    /// Units of all.
    pub units: u32,
    /// Bytes of a unit.
    pub unit: u32,
}

impl Layout {
    /// The layout of a cluster with these counts.
    pub fn new(vertices: u32, triangles: u32, colors: bool) -> Self {
        let unit = 4 * words_of_unit(colors);
        Layout { vertices, triangles, units: vertices + (6 * triangles).div_ceil(unit), unit }
    }

    /// Bytes of the block.
    pub fn bytes(&self) -> u64 {
        u64::from(self.units) * u64::from(self.unit)
    }

    /// Bytes of its vertices.
    pub fn vertex_bytes(&self) -> u64 {
        u64::from(self.vertices) * u64::from(self.unit)
    }
}

/// What is written once of a cluster's block.
#[derive(Clone, Debug, Default)]
pub struct Block {
    layout: Layout,
    words: Vec<u32>,
}

impl Block {
    /// Makes the block of a page that was checked.
    pub fn of_page(page: &Page<'_>) -> Self {
        let (vertices, triangles) = (page.positions.len() as u32, page.triangles.len() as u32);
        let layout = Layout::new(vertices, triangles, !page.colors.is_empty());
        let own = if page.attributes().has_normals() { Vec::new() } else { normals(page) };
        let mut words = Vec::with_capacity((layout.vertex_bytes() / 4) as usize);
        for (vertex, [x, y, z]) in page.positions.iter().enumerate() {
            let normal = page.normal(vertex).unwrap_or_else(|| own[vertex]);
            words.extend([x.to_bits(), y.to_bits(), z.to_bits(), encode_normal(normal)]);
            words.extend(page.colors.get(vertex).map(|color| bytemuck::cast::<_, u32>(*color)));
        }
        debug_assert_eq!(4 * words.len() as u64, layout.vertex_bytes());
        Block { layout, words }
    }

    /// Where its parts are.
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// The bytes of its vertices.
    pub fn bytes(&self) -> &[u8] {
        bytemuck::cast_slice(&self.words)
    }
}

/// The mean of the normals about each vertex, by area.
fn normals(page: &Page<'_>) -> Vec<[f32; 3]> {
    let mut sums = vec![Vector3::<f32>::zeros(); page.positions.len()];
    for corners in page.triangles {
        let [a, b, c] = corners.map(|v| Vector3::from(page.positions[usize::from(v)]));
        let area = (b - a).cross(&(c - a));
        for vertex in corners {
            sums[usize::from(*vertex)] += area;
        }
    }
    sums.into_iter().map(|sum| sum.into()).collect()
}

/// No direction: a corner of the square, which any other corner can stand for.
const NO_DIRECTION: u32 = 0x8001_8001;

/// A direction as a point of the unfolded octahedron, 16 bits a side.
fn encode_normal(normal: [f32; 3]) -> u32 {
    let Some([u, v]) = octahedral::square(normal.map(f64::from)) else { return NO_DIRECTION };
    let pack = |t: f64| u32::from((t.clamp(-1.0, 1.0) * 32767.0).round() as i16 as u16);
    match pack(u) | pack(v) << 16 {
        NO_DIRECTION => pack(1.0) | pack(1.0) << 16,
        code => code,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_format::PageParts;
    use chpm_mesh::VertexSlices;

    #[test]
    fn a_unit_is_a_vertex() {
        for (colors, words) in [(&[][..], 4), (&[[1, 2, 3, 255], [4, 5, 6, 255], [7, 8, 9, 255]], 5)] {
            let parts = PageParts {
                vertices: VertexSlices {
                    colors,
                    ..VertexSlices::new(&[[0.0, 0.0, 0.5], [2.0, 0.0, 0.5], [2.0, 2.0, 0.5]])
                },
                triangles: &[[0, 1, 2]],
                ..PageParts::default()
            };
            let mut page = Vec::new();
            parts.encode(&mut page).unwrap();
            let block = Block::of_page(&Page::parse(&page).unwrap());
            assert_eq!(block.layout(), Layout::new(3, 1, words == 5));
            // Six bytes of corners are less than a unit.
            assert_eq!(block.layout().bytes(), 4 * 4 * words);
            assert_eq!(block.bytes().len() as u64, block.layout().vertex_bytes());
            for (vertex, bytes) in block.bytes().chunks_exact(4 * words as usize).enumerate() {
                let words: &[u32] = bytemuck::cast_slice(bytes);
                let expected = parts.vertices.positions[vertex].map(f32::to_bits);
                assert_eq!((&words[..3], words[3]), (&expected[..], encode_normal([0.0, 0.0, 1.0])));
                assert_eq!(bytes.get(16..), colors.get(vertex).map(|color| &color[..]).or(Some(&[])));
            }
        }
    }

    /// Corners are written by whole words: an odd one takes two bytes more.
    #[test]
    fn there_is_room_for_all_corners() {
        for triangles in 0..100 {
            for colors in [false, true] {
                let layout = Layout::new(7, triangles, colors);
                let room = layout.bytes() - layout.vertex_bytes();
                let needed = u64::from((6 * triangles).next_multiple_of(4));
                assert!((needed..needed + u64::from(layout.unit)).contains(&room), "{layout:?}");
            }
        }
    }

    #[test]
    fn normals_survive_their_sixteen_bits() {
        let decode = |code: u32| {
            let unpack = |bits: u32| f64::from(bits as u16 as i16) / 32767.0;
            let (u, v) = (unpack(code & 0xffff), unpack(code >> 16));
            let z = 1.0 - u.abs() - v.abs();
            let t = (-z).max(0.0);
            Vector3::new(u - t.copysign(u), v - t.copysign(v), z).normalize()
        };
        for (x, y, z) in [(1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.3, -0.5, -0.2), (-1e-20, 2e-20, 3e-20)] {
            let normal = Vector3::<f64>::new(x, y, z);
            let code = encode_normal([x as f32, y as f32, z as f32]);
            assert!((decode(code) - normal.normalize()).norm() < 1e-4, "{normal:?}");
        }
        assert_eq!(encode_normal([0.0; 3]), NO_DIRECTION);
        // Near the corner that stands for no direction.
        assert!((decode(encode_normal([-1e-6, -1e-6, -1.0])) + Vector3::z()).norm() < 1e-4);
        assert_ne!(encode_normal([-1e-6, -1e-6, -1.0]), NO_DIRECTION);
    }
}
