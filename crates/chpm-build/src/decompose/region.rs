//! One region becomes leaves: cells, parts, triangles by part, leaves, and which of their vertices are shared.

use super::cell_graph::{self, Cell};
use super::grid::{Grid, Placement};
use super::leaf::{self, Leaf, LeafMesh, LeafWriter};
use super::load::{INNER, majority};
use super::normals::{self, BorderSum};
use super::partition;
use super::topology::{Ledger, Surveyor, TopologyCounts};
use crate::config::{Normals, Settings};
use crate::context::Context;
use crate::error::BuildError;
use crate::pairs::Pairs;
use chpm_extmem::Spool;
use chpm_mesh::{Aabb, Vertices};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// One in so many triangles is looked at: a sample says well enough what a cut would cost.
const SAMPLE: usize = 2;
/// Most triangles of a leaf: with three vertices each they still fit 16-bit indices.
const MAX_LEAF_TRIANGLES: usize = u16::MAX as usize / 3;

/// The triangles of a region and all vertices that they use.
pub(crate) struct Mesh {
    pub(crate) vertices: Vertices,
    /// Each there once.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Copies of them that were left out.
    pub(crate) copies: u64,
    /// By vertex: its border number, or [`INNER`].
    pub(crate) border: Vec<u32>,
    /// Vertices at home here that any triangle uses, of this region or another.
    pub(crate) referenced: u64,
}

/// Result of a region. Leaves are numbered from 0 in it.
#[derive(Serialize, Deserialize)]
pub(crate) struct Done {
    pub(crate) leaves: Vec<Leaf>,
    pub(crate) interfaces: Interfaces,
    /// Border number and leaf, for each leaf that uses a border vertex; ascending.
    pub(crate) border_uses: Vec<(u32, u32)>,
    /// Counts, with border numbers, and numbers of inner shared vertices above all of those.
    pub(crate) topology: TopologyCounts,
    pub(crate) referenced: u64,
    pub(crate) copies: u64,
    /// Sums of normals about border vertices, if normals are computed.
    pub(crate) normals: Vec<BorderSum>,
}

/// Sets of leaves, with the number of vertices that each has to itself. Shared vertices of one region are numbered by these.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(crate) struct Interfaces {
    /// Leaves of interface i, ascending: `users[starts[i]..starts[i + 1]]`.
    pub(crate) users: Vec<u32>,
    pub(crate) starts: Vec<u32>,
    pub(crate) counts: Vec<u32>,
}

impl Interfaces {
    /// Bytes that it has in memory.
    pub(crate) fn bytes(&self) -> u64 {
        4 * (self.users.capacity() + self.starts.capacity() + self.counts.capacity()) as u64
    }
}

/// The shared vertices of a region: inner ones first, then border vertices.
struct Shared {
    /// By vertex: its number, or [`INNER`].
    numbers: Vec<u32>,
    inner_count: u32,
    /// Border numbers of those after the inner ones.
    border: Vec<u32>,
}

/// Result of a region, with the normals of its vertices, if they are computed.
pub(crate) fn done(
    mut mesh: Mesh,
    parts: u32,
    border_count: u32,
    settings: &Settings,
    spool: &Spool,
    context: &Context<'_>,
) -> Result<Done, BuildError> {
    let normals = match settings.normals {
        Normals::Computed => normals::compute(&mut mesh),
        _ => Vec::new(),
    };
    Ok(Done { normals, ..run(&mesh, parts, border_count, settings, spool, context)? })
}

/// Cuts the region into `parts` leaves, more if one would not fit 16-bit indices.
pub(crate) fn run(
    mesh: &Mesh,
    parts: u32,
    border_count: u32,
    settings: &Settings,
    spool: &Spool,
    context: &Context<'_>,
) -> Result<Done, BuildError> {
    if mesh.triangles.is_empty() {
        let (leaves, interfaces) = (Vec::new(), Interfaces::default());
        let (border_uses, topology) = (Vec::new(), TopologyCounts::default());
        let (referenced, normals) = (mesh.referenced, Vec::new());
        return Ok(Done { leaves, interfaces, border_uses, topology, referenced, copies: 0, normals });
    }
    let traced = context.trace.task("cut");
    let part_of = cut(mesh, parts, settings, context)?;
    drop(traced);
    context.check()?;
    let gathered = gather(mesh, &part_of, parts, context)?;
    let traced = context.trace.task("share");
    let (shared, interfaces, border_uses) = share(mesh, &gathered);
    drop(traced);

    let phase = context.trace.phase();
    let leaf = |(surveyor, writer): &mut (Surveyor, LeafWriter), gathered: LeafMesh| {
        let _traced = phase.task("leaf");
        context.check()?;
        let numbers = gathered.vertices.iter().map(|v| shared.numbers[*v as usize]);
        let mut marks: Vec<(u16, u32)> = (0..).zip(numbers).filter(|(_, number)| *number != INNER).collect();
        let topology =
            surveyor.survey(&gathered.triangles, &gathered.vertices, &marks, &mesh.vertices.positions);
        marks.iter_mut().for_each(|(_, number)| *number = code(*number, &shared.border, shared.inner_count));
        let leaf = writer.write(mesh, &gathered, &marks, spool)?;
        context.progress.advance(gathered.triangles.len() as u64);
        Ok((leaf, topology))
    };
    let made: Vec<(Leaf, TopologyCounts)> =
        gathered.into_par_iter().map_init(Default::default, leaf).collect::<Result<_, BuildError>>()?;
    let Shared { numbers, inner_count, border } = shared;
    drop(numbers);

    // What leaves counted about vertices that several have is put together, by their numbers here and then by those that hold everywhere.
    let mut ledger = Ledger::new(inner_count as usize + border.len());
    let mut leaves = Vec::with_capacity(made.len());
    for (leaf, topology) in made {
        leaves.push(leaf);
        ledger.enter(topology);
    }
    let global = |number: u32| match number.checked_sub(inner_count) {
        Some(at) => border[at as usize],
        None => number + border_count,
    };
    let topology = ledger.close(inner_count).renumbered(global);
    let (referenced, copies) = (mesh.referenced, mesh.copies);
    Ok(Done { leaves, interfaces, border_uses, topology, referenced, copies, normals: Vec::new() })
}

fn code(number: u32, shared_border: &[u32], shared_inner_count: u32) -> u32 {
    match number.checked_sub(shared_inner_count) {
        Some(border) => shared_border[border as usize],
        None => number | leaf::INNER,
    }
}

/// The part of each vertex (Quick-VDR 4.1: cells, cell graph, k-way partition).
fn cut(mesh: &Mesh, parts: u32, settings: &Settings, context: &Context<'_>) -> Result<Vec<u32>, BuildError> {
    if parts <= 1 {
        return Ok(vec![0; mesh.vertices.positions.len()]);
    }
    let positions = &mesh.vertices.positions[..];
    let (bounds, limit) = (Aabb::of_points(positions), settings.cell_vertices);
    let grid = Grid::build(positions, &bounds, limit, Placement::InBox, &context.trace, &|| context.check())?;
    let mut cells: Vec<u32> = positions.par_iter().with_min_len(1 << 12).map(|p| grid.cell_of(*p)).collect();
    let list: Vec<Cell> = grid.cells;

    let traced = context.trace.task("joints");
    let mut joints = Pairs::default();
    for t in mesh.triangles.iter().step_by(SAMPLE) {
        cell_graph::joints(t.map(|v| cells[v as usize])).for_each(|(a, b)| joints.add(a, b, 1));
    }
    context.check()?;
    drop(traced);
    let traced = context.trace.task("graph");
    let graph = cell_graph::build(&list, joints.sums(), settings.cell_neighbors)?;
    drop(traced);
    context.check()?;

    // From cells to parts, in place.
    let assignment = partition::parts(&graph, parts.min(list.len() as u32), settings, context)?;
    cells.iter_mut().for_each(|cell| *cell = assignment[*cell as usize]);
    Ok(cells)
}

/// The triangles by part, each part a leaf.
fn gather(
    mesh: &Mesh,
    part_of: &[u32],
    parts: u32,
    context: &Context<'_>,
) -> Result<Vec<LeafMesh>, BuildError> {
    let mut starts = vec![0usize; parts as usize + 1];
    let mut clusters = Vec::with_capacity(mesh.triangles.len());
    for triangle in &mesh.triangles {
        let cluster =
            majority(triangle.map(|v| part_of[v as usize]), || triangle.iter().map(|v| *v as usize).sum());
        clusters.push(cluster as u16);
        starts[cluster as usize + 1] += 1;
    }
    for part in 0..parts as usize {
        starts[part + 1] += starts[part];
    }

    // A counting sort, which keeps the source's order within a part.
    let mut next = starts.clone();
    let mut sorted = vec![[0; 3]; mesh.triangles.len()];
    for (triangle, cluster) in mesh.triangles.iter().zip(clusters) {
        let next = &mut next[usize::from(cluster)];
        sorted[*next] = *triangle;
        *next += 1;
    }

    // A part that 16-bit indices cannot number becomes several leaves.
    let mut jobs = Vec::new();
    for range in starts.windows(2).filter(|range| range[0] < range[1]) {
        let triangles = &sorted[range[0]..range[1]];
        let pieces = triangles.len().div_ceil(MAX_LEAF_TRIANGLES);
        jobs.extend(triangles.chunks(triangles.len().div_ceil(pieces)));
    }

    let vertex_count = mesh.vertices.positions.len();
    let phase = context.trace.phase();
    jobs.into_par_iter()
        .map_init(Vec::new, |locals: &mut Vec<u16>, triangles: &[[u32; 3]]| {
            let _traced = phase.task("gather");
            context.check()?;
            locals.resize(vertex_count, leaf::ABSENT);
            Ok(LeafMesh::gather(triangles, locals))
        })
        .collect()
}

/// Finds the vertices that several leaves use, and numbers those that no other region has by the set of their leaves.
fn share(mesh: &Mesh, leaves: &[LeafMesh]) -> (Shared, Interfaces, Vec<(u32, u32)>) {
    // How many leaves use a vertex; two tell as much as more.
    let mut uses = vec![0u8; mesh.vertices.positions.len()];
    for v in leaves.iter().flat_map(|leaf| &leaf.vertices) {
        uses[*v as usize] = (uses[*v as usize] + 1).min(2);
    }

    let is_shared = |v: u32| uses[v as usize] > 1 || mesh.border[v as usize] != INNER;
    let mut pairs: Vec<(u32, u32)> = Vec::new();
    for (index, leaf) in (0..).zip(leaves) {
        pairs.extend(leaf.vertices.iter().filter(|v| is_shared(**v)).map(|v| (*v, index)));
    }
    pairs.par_sort_unstable();

    let mut numbers = vec![INNER; mesh.vertices.positions.len()];
    let mut inner = Vec::new();
    let mut border = Vec::new();
    let mut border_uses = Vec::new();
    for same in pairs.chunk_by(|a, b| a.0 == b.0) {
        match mesh.border[same[0].0 as usize] {
            INNER => inner.push(same),
            id => {
                border.push((id, same[0].0));
                border_uses.extend(same.iter().map(|(_, leaf)| (id, *leaf)));
            }
        }
    }

    // Vertices of the same leaves come together: they are one interface, and numbered one after another.
    fn users(same: &&[(u32, u32)]) -> Vec<u32> {
        same.iter().map(|(_, leaf)| *leaf).collect::<Vec<u32>>()
    }
    inner.par_sort_unstable_by(|a, b| {
        a.iter().map(|u| u.1).cmp(b.iter().map(|u| u.1)).then(a[0].0.cmp(&b[0].0))
    });
    let mut interfaces = Interfaces { starts: vec![0], ..Interfaces::default() };
    let mut next = 0;
    for alike in inner.chunk_by(|a, b| a.iter().map(|u| u.1).eq(b.iter().map(|u| u.1))) {
        interfaces.users.extend(users(&alike[0]));
        interfaces.starts.push(interfaces.users.len() as u32);
        interfaces.counts.push(alike.len() as u32);
        for same in alike {
            numbers[same[0].0 as usize] = next;
            next += 1;
        }
    }

    border_uses.par_sort_unstable();
    for ((_, vertex), number) in border.iter().zip(next..) {
        numbers[*vertex as usize] = number;
    }
    let border = border.into_iter().map(|(id, _)| id).collect();
    (Shared { numbers, inner_count: next, border }, interfaces, border_uses)
}
