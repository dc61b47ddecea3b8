//! A cluster as the GPU has it: written once, drawn at any position of its progressive mesh.
//!
//! Triangles are those of the finest mesh, in stages by their [birth](ProgressiveMesh::birth): the base mesh's first, then some eighths of
//! the splits each, and within a stage in the order of the file, which caches like. A position draws whole stages. Corners are never
//! written again: a vertex that has collapsed is followed to where it went by the vertex shader, along the same targets that the file stores,
//! and a triangle of the last stage that is not there yet has two corners in one place and covers nothing. So a position that moves
//! costs no upload, only another count.

use chpm_format::Page;
use chpm_mesh::ProgressiveMesh;
use nalgebra::Vector3;

/// What everything in a block is aligned to, bytes: one load of the shader.
pub const UNIT: usize = 16;

/// Where the parts of a block start, in units from its own start. Vertices come first: one unit each, position and normal.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Layout {
    /// Vertices of the finest mesh.
    pub vertices: u32,
    /// Vertices of the base mesh.
    pub base_vertices: u32,
    /// Triangles of the finest mesh.
    pub triangles: u32,
    /// Colours, four to a unit; none if this is where the targets start.
    pub colors_at: u32,
    /// Targets of the collapses, eight to a unit.
    pub targets_at: u32,
    /// Corners, eight to a unit.
    pub corners_at: u32,
    /// Units of the block.
    pub units: u32,
}

impl Layout {
    /// The layout of a cluster with these counts.
    pub fn new(vertices: u32, base_vertices: u32, triangles: u32, colors: bool) -> Self {
        let colors_at = vertices;
        let targets_at = colors_at + if colors { vertices.div_ceil(4) } else { 0 };
        let corners_at = targets_at + (vertices - base_vertices).div_ceil(8);
        let units = corners_at + (3 * triangles).div_ceil(8);
        Layout { vertices, base_vertices, triangles, colors_at, targets_at, corners_at, units }
    }

    /// Bytes of the block.
    pub fn bytes(&self) -> u64 {
        u64::from(self.units) * UNIT as u64
    }
}

/// Stages behind the base mesh.
const STAGES: usize = 8;

/// How many triangles there are at each position.
#[derive(Clone, Debug, Default)]
pub struct Counts {
    /// By position from the base mesh's.
    alive: Box<[u32]>,
    /// By stage: where it ends.
    stages: [u32; STAGES + 1],
}

impl Counts {
    /// Triangles of the mesh that is so many splits from the base mesh.
    pub fn alive(&self, splits: u32) -> u32 {
        self.alive[splits as usize]
    }

    /// Triangles to draw for it: those that are there, and some that cover nothing.
    pub fn drawn(&self, splits: u32) -> u32 {
        self.stages[stage(splits as usize, self.alive.len() - 1)]
    }
}

/// The stage of a triangle that a split brings, or of a position.
fn stage(splits: usize, all: usize) -> usize {
    (splits * STAGES).div_ceil(all.max(1))
}

/// A cluster's block, and how many triangles each position has.
#[derive(Clone, Debug, Default)]
pub struct Block {
    layout: Layout,
    units: Vec<[u32; 4]>,
    counts: Counts,
}

impl Block {
    /// Makes the block of a page that was checked.
    pub fn of_page(page: &Page<'_>) -> Self {
        let mesh = page.progressive_mesh();
        let layout = Layout::new(
            mesh.vertex_count as u32,
            mesh.base_vertex_count as u32,
            mesh.triangles.len() as u32,
            !page.colors.is_empty(),
        );
        let mut units = Vec::with_capacity(layout.units as usize);
        let own;
        let normals = if page.normals.is_empty() {
            own = normals(page);
            &own
        } else {
            page.normals
        };
        let vertex = |([x, y, z], normal): (&[f32; 3], &[f32; 3])| {
            [x.to_bits(), y.to_bits(), z.to_bits(), encode_normal(*normal)]
        };
        units.extend(page.positions.iter().zip(normals).map(vertex));
        push_all(&mut units, page.colors);
        push_all(&mut units, page.targets);
        let (order, stages) = by_stage(&mesh);
        let corners: Vec<[u16; 3]> = order.iter().map(|place| mesh.triangles[*place as usize]).collect();
        push_all(&mut units, &corners);
        debug_assert_eq!(units.len(), layout.units as usize);
        Block { layout, units, counts: Counts { alive: alive(&mesh).into(), stages } }
    }

    /// Where its parts are.
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// The bytes for the GPU.
    pub fn bytes(&self) -> &[u8] {
        bytemuck::cast_slice(&self.units)
    }

    /// How many triangles there are.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }
}

/// The places of the triangles of the finest mesh, by stage and in a stage in the order of the file; and where each stage ends.
pub fn by_stage(mesh: &ProgressiveMesh<'_>) -> (Vec<u32>, [u32; STAGES + 1]) {
    let base = mesh.base_vertex_count;
    let all = mesh.vertex_count - base;
    let stages: Vec<u8> =
        mesh.triangles.iter().map(|corners| stage(mesh.birth(*corners) - base, all) as u8).collect();
    let mut ends = [0; STAGES + 1];
    for stage in &stages {
        ends[usize::from(*stage)] += 1;
    }
    let mut sum = 0;
    for end in &mut ends {
        sum += std::mem::replace(end, sum);
    }
    let mut order = vec![0; stages.len()];
    for (place, stage) in (0..).zip(&stages) {
        // Starts become ends.
        let next = &mut ends[usize::from(*stage)];
        order[*next as usize] = place;
        *next += 1;
    }
    (order, ends)
}

/// By position from the base mesh's: how many triangles there are.
fn alive(mesh: &ProgressiveMesh<'_>) -> Vec<u32> {
    let base = mesh.base_vertex_count;
    let mut alive = vec![0; mesh.vertex_count - base + 1];
    for corners in mesh.triangles {
        alive[mesh.birth(*corners) - base] += 1;
    }
    let mut sum = 0;
    for count in &mut alive {
        sum += *count;
        *count = sum;
    }
    alive
}

/// Appends items, filled up to whole units.
fn push_all<T: bytemuck::NoUninit>(units: &mut Vec<[u32; 4]>, items: &[T]) {
    let bytes: &[u8] = bytemuck::cast_slice(items);
    let (whole, rest) = bytes.split_at(bytes.len() / UNIT * UNIT);
    units.extend(whole.chunks_exact(UNIT).map(bytemuck::pod_read_unaligned::<[u32; 4]>));
    if !rest.is_empty() {
        let mut last = [0_u8; UNIT];
        last[..rest.len()].copy_from_slice(rest);
        units.push(bytemuck::cast(last));
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

/// A direction as a point of the unfolded octahedron, 16 bits a side; nothing in particular for no direction.
fn encode_normal(normal: [f32; 3]) -> u32 {
    let [x, y, z] = normal.map(f64::from);
    let length = x.abs() + y.abs() + z.abs();
    // Sums of areas may be anything down to the smallest numbers; f64 divides them safely.
    let (x, y) = if length > 0.0 && length.is_finite() { (x / length, y / length) } else { (0.0, 0.0) };
    let fold = |a: f64, b: f64| (1.0 - b.abs()).copysign(a);
    let (u, v) = if z < 0.0 { (fold(x, y), fold(y, x)) } else { (x, y) };
    let pack = |t: f64| u32::from((t.clamp(-1.0, 1.0) * 32767.0).round() as i16 as u16);
    pack(u) | pack(v) << 16
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_format::PageParts;

    /// A square fan about vertex 4, which collapses to 0; then 3 collapses to 0.
    fn fan() -> Vec<u8> {
        let parts = PageParts {
            positions: &[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 2.0, 0.0], [0.0, 2.0, 0.0], [1.0, 1.0, 0.0]],
            triangles: &[[3, 0, 4], [2, 3, 4], [1, 2, 4], [0, 1, 4]],
            targets: &[0, 0],
            errors: &[2.0, 1.0],
            ..PageParts::default()
        };
        let mut page = Vec::new();
        parts.encode(&mut page).unwrap();
        page
    }

    #[test]
    fn triangles_come_by_stage_and_every_position_is_a_prefix() {
        let bytes = fan();
        let page = Page::parse(&bytes).unwrap();
        let mesh = page.progressive_mesh();
        // Two splits: the first is in the fourth of eight stages, the second in the last.
        let (order, stages) = by_stage(&mesh);
        assert_eq!((order, stages), (vec![2, 1, 0, 3], [1, 1, 1, 1, 2, 2, 2, 2, 4]));
        assert_eq!(alive(&mesh), [1, 2, 4]);
        let counts = Block::of_page(&page).counts().clone();
        assert_eq!([0, 1, 2].map(|n| (counts.alive(n), counts.drawn(n))), [(1, 1), (2, 2), (4, 4)]);
    }

    #[test]
    fn stages_end_where_they_should() {
        for all in 0..50 {
            assert_eq!(stage(0, all), 0);
            assert!(
                (1..=all)
                    .all(|n| (1..=STAGES).contains(&stage(n, all)) && stage(n, all) >= stage(n - 1, all))
            );
        }
        assert_eq!(stage(50, 50), STAGES);
    }

    #[test]
    fn a_block_plays_like_its_page() {
        let bytes = fan();
        let page = Page::parse(&bytes).unwrap();
        let mesh = page.progressive_mesh();
        let block = Block::of_page(&page);
        let layout = block.layout();
        assert_eq!(layout, Layout::new(5, 3, 4, false));
        assert_eq!(block.bytes().len() as u64, layout.bytes());
        let halves: &[u16] = bytemuck::cast_slice(block.bytes());
        let part = |at: u32, len: usize| &halves[8 * at as usize..][..len];
        assert_eq!(part(layout.targets_at, 2), [0, 0]);
        for n in 3..=5_usize {
            // As the shader does it.
            let drawn = block.counts().drawn(n as u32 - 3) as usize;
            let corners = part(layout.corners_at, 3 * drawn).chunks(3);
            let resolved = corners.map(|t| [0, 1, 2].map(|k| mesh.resolve(t[k], n)));
            let mut got: Vec<[u16; 3]> = resolved.filter(|[a, b, c]| a != b && b != c && c != a).collect();
            assert_eq!(got.len(), block.counts().alive(n as u32 - 3) as usize);
            let mut expected = Vec::new();
            mesh.triangles_at(n, &mut expected);
            got.sort();
            expected.sort();
            assert_eq!(got, expected, "at {n} vertices");
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
        assert_eq!(encode_normal([0.0; 3]), 0);
    }
}
