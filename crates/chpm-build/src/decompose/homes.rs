//! Where vertices are at home: in coarse cells, which make up regions. Decided once for the whole source.

use super::cell_graph::{self, Cell};
use super::grid::Placement;
use super::number::{self, Cells, Numbered};
use super::{cubes, partition};
use crate::config::{Division, Settings};
use crate::context::Context;
use crate::error::BuildError;
use crate::ids::Id;
use crate::pairs::{Pairs, graph_bytes};
use crate::vertex_columns::VertexColumns;
use chpm_extmem::Column;
use chpm_mesh::Aabb;
use rayon::prelude::*;
use std::ops::Range;

/// Leaves of a region: as many as two threads can work on in the least memory.
pub(super) const REGION_LEAVES: u32 = 64;
/// Coarse cells of a region, about.
const REGION_CELLS: u32 = 128;
/// One in so many triangles is looked at for the graph of coarse cells: each has hundreds of edges to the next.
const SAMPLE: usize = 16;
/// Triangles that are looked at in one step.
const STEP: usize = 1 << 17;

/// Regions as sets of cells.
pub(crate) struct Homes {
    cells: Cells,
    /// By cell: its region, and its first vertex's number there.
    of_cells: Vec<(u32, u32)>,
    /// The cells of each region, ascending.
    region_cells: Vec<Vec<u32>>,
    /// Where the vertices of each region begin, if those at home in one lie together; else they lie by their numbers.
    starts: Option<Vec<usize>>,
}

impl Homes {
    /// Cells, with the region of each.
    pub(crate) fn new(cells: Cells, regions: &[u32]) -> Self {
        // Cells of a region follow one another there.
        let mut region_cells = vec![Vec::new(); regions.iter().max().map_or(0, |last| *last as usize + 1)];
        let mut counts = vec![0; region_cells.len()];
        let mut of_cells = Vec::with_capacity(regions.len());
        for (cell, region) in (0..).zip(regions) {
            of_cells.push((*region, counts[*region as usize]));
            counts[*region as usize] += cells.range(cell).len() as u32;
            region_cells[*region as usize].push(cell);
        }
        Homes { cells, of_cells, region_cells, starts: None }
    }

    /// The same for vertices that lie by region, one after another.
    pub(super) fn laid_by_region(mut self) -> Self {
        let ends = (0..self.count()).scan(0, |end, region| {
            *end += self.own(region);
            Some(*end)
        });
        self.starts = Some(std::iter::once(0).chain(ends).collect());
        self
    }

    /// Number of regions that vertices are at home in.
    pub(crate) fn count(&self) -> usize {
        self.region_cells.len()
    }

    /// Vertices of all of them.
    pub(super) fn vertex_count(&self) -> usize {
        self.cells.end()
    }

    /// Vertices and region of each cell.
    pub(crate) fn cells(&self) -> impl Iterator<Item = (u32, u32)> {
        (0..).zip(&self.of_cells).map(|(cell, (region, _))| (self.cells.range(cell).len() as u32, *region))
    }

    /// The cell of a vertex.
    pub(super) fn cell_of(&self, vertex: usize) -> u32 {
        self.cells.of(vertex)
    }

    /// The region that a vertex is at home in.
    #[inline]
    pub(super) fn of(&self, vertex: usize) -> u32 {
        self.of_cells[self.cells.of(vertex) as usize].0
    }

    /// That, and the number of the vertex among those at home there.
    #[inline]
    pub(super) fn place(&self, vertex: usize) -> (u32, u32) {
        let cell = self.cells.of(vertex);
        let (home, first) = self.of_cells[cell as usize];
        (home, first + (vertex - self.cells.range(cell).start) as u32)
    }

    /// Vertices that are at home in a region; none are in one that was split off.
    pub(super) fn own(&self, region: usize) -> usize {
        self.own_cells(region).iter().map(|cell| self.cells.range(*cell).len()).sum()
    }

    /// Where those vertices lie, in their order.
    pub(super) fn own_runs(&self, region: usize) -> Vec<Range<usize>> {
        if let Some(starts) = self.starts.as_ref().filter(|_| region < self.count()) {
            return std::iter::once(starts[region]..starts[region + 1]).collect();
        }
        // Neighbouring cells lie side by side.
        let runs = self.own_cells(region).chunk_by(|a, b| a + 1 == *b);
        runs.map(|run| self.cells.range(run[0]).start..self.cells.range(run[run.len() - 1]).end).collect()
    }

    /// Where vertices of a cell lie, from one to another.
    pub(super) fn lie(&self, first: usize, last: usize) -> Range<usize> {
        let start = match &self.starts {
            None => first,
            Some(starts) => {
                let (home, number) = self.place(first);
                starts[home as usize] + number as usize
            }
        };
        start..start + (last - first) + 1
    }

    fn own_cells(&self, region: usize) -> &[u32] {
        self.region_cells.get(region).map_or(&[], Vec::as_slice)
    }
}

/// A source with its vertices in the order of cells.
pub(crate) struct Cut<I: Id> {
    pub(crate) vertices: VertexColumns,
    /// In the order of the source.
    pub(crate) triangles: Column<[I; 3]>,
    pub(crate) homes: Homes,
}

/// Numbers the vertices by cell, and cuts the graph of cells into regions for `leaves` leaf clusters.
pub(crate) fn run<I: Id>(
    mut vertices: VertexColumns,
    mut triangles: Column<[I; 3]>,
    bounds: Aabb,
    leaves: u32,
    settings: &Settings,
    context: &Context<'_>,
) -> Result<Cut<I>, BuildError> {
    let count = vertices.positions.len();
    let wanted = region_count(count, leaves, settings);
    // One region is one cell, and everything stays where it is.
    if wanted <= 1 {
        context.progress.advance(triangles.len() as u64);
        let homes = Homes::new(Cells::new([count as u32].into_iter()), &[0]);
        return Ok(Cut { vertices, triangles, homes });
    }

    let (limit, placement) = match settings.division {
        Division::Graph => (count / (wanted as usize * REGION_CELLS as usize), Placement::InBox),
        // Nothing that the rest of the source has a part in.
        Division::Cubes => {
            ((region_vertices(settings) / u64::from(REGION_CELLS)) as usize, Placement::AtMultiples)
        }
    };
    let limit = u32::try_from(limit).unwrap_or(u32::MAX).max(settings.cell_vertices);
    let traced = context.trace.task("number");
    let Numbered { cells: list, keys, mapping } =
        number::run::<I>(&vertices.positions, &bounds, limit, placement, context)?;
    drop(traced);
    let traced = context.trace.task("permute");
    vertices = vertices.map(&number::Permutation { mapping: &mapping, context })?;
    drop(traced);
    let traced = context.trace.task("renumber");
    crate::join::run(&mut triangles, &mapping, context)?;
    drop((mapping, traced));
    context.check()?;

    let _traced = context.trace.task("cut");
    let cells = Cells::new(list.iter().map(|cell| cell.count));
    let regions = match settings.division {
        Division::Graph => regions(&list, &cells, &triangles, wanted, settings, context)?,
        Division::Cubes => cubes::regions(&list, &keys, region_vertices(settings)),
    };
    context.check()?;
    Ok(Cut { vertices, triangles, homes: Homes::new(cells, &regions) })
}

/// Regions for as many leaves and vertices: a power of two, so that each has the same number of leaves.
fn region_count(vertices: usize, leaves: u32, settings: &Settings) -> u32 {
    // As many vertices as a region of a closed surface has, twice over.
    let by_vertices = (vertices as u64 / (2 * region_vertices(settings))).max(1).ilog2();
    (leaves / REGION_LEAVES).max(1 << by_vertices).max(1)
}

/// Vertices that a region of a closed surface has.
fn region_vertices(settings: &Settings) -> u64 {
    u64::from(REGION_LEAVES) * u64::from(settings.cluster_triangles.max(16)) / 2
}

/// The region of each cell.
fn regions<I: Id>(
    list: &[Cell],
    cells: &Cells,
    triangles: &Column<[I; 3]>,
    wanted: u32,
    settings: &Settings,
    context: &Context<'_>,
) -> Result<Vec<u32>, BuildError> {
    let joints = joints(triangles, cells, context)?.sums();
    let _share = context.store.budget.reserve_work("the graph of cells", graph_bytes(joints.len()))?;
    let graph = cell_graph::build(list, joints, settings.cell_neighbors)?;
    partition::parts(&graph, wanted.min(list.len() as u32), settings, context)
}

/// Graph of the cells from a sample of the triangles.
fn joints<I: Id>(
    triangles: &Column<[I; 3]>,
    cells: &Cells,
    context: &Context<'_>,
) -> Result<Pairs, BuildError> {
    let steps = triangles.len().div_ceil(STEP);
    let phase = context.trace.phase();
    let all = (0..steps).into_par_iter().map_init(Vec::new, |scratch: &mut Vec<[I; 3]>, step: usize| {
        let _traced = phase.task("joints");
        context.check()?;
        let range = step * STEP..triangles.len().min((step + 1) * STEP);
        let mut joints = Pairs::default();
        for t in triangles.read(range, scratch)?.iter().step_by(SAMPLE) {
            cell_graph::joints(t.map(|v| cells.of(v.index()))).for_each(|(a, b)| joints.add(a, b, 1));
        }
        Ok(joints)
    });
    all.try_reduce(Pairs::default, |a, b| Ok(a.merge(b)))
}
