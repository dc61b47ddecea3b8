//! The source in regions of some dozen leaf clusters, each small enough to be worked on in memory by itself.
//!
//! Vertices are numbered by coarse cell, triangles get the new numbers, the graph of cells is cut into regions, and each
//! triangle goes to the region that has most of its corners. A vertex that a triangle of another region uses is a border
//! vertex: that region gets a copy of it, and its border number says that both are one. How many regions there are depends
//! on the source alone, not on the budget.

mod split;
mod step;

use super::cell_graph;
use super::copies::{self, Sieve};
use super::number::{self, Cells};
use super::region::Mesh;
use super::{leaf_count, partition};
use crate::config::{Normals, Settings};
use crate::context::Context;
use crate::error::BuildError;
use crate::ingest::Source;
use crate::pairs::{Pairs, graph_bytes};
use crate::vertex_columns::{ColumnMap, VertexColumns};
use bytemuck::{Pod, Zeroable};
use chpm_extmem::{Buckets, Column, Reservation, Store, process};
use chpm_mesh::{Octahedral, Vertex, Vertices};
use rayon::prelude::*;
use std::ops::Range;
use step::Step;

/// Leaves of a region: as many as two threads can work on in the least memory.
const REGION_LEAVES: u32 = 64;
/// Coarse cells of a region, about.
const REGION_CELLS: u32 = 128;
/// One in so many triangles is looked at for the graph of coarse cells: each has hundreds of edges to the next.
const SAMPLE: usize = 16;
/// Triangles that are looked at in one step.
const STEP: usize = 1 << 17;
/// Triangles that are prepared for their regions in one step.
const ROUTED: usize = 1 << 16;
/// Triangles of a region that one thread takes in at a time.
const LOADED: usize = 1 << 14;
/// Memory for the blocks of all regions' triangles.
const BLOCKS: usize = 8 << 20;

/// No border number.
pub(crate) const INNER: u32 = u32::MAX;

/// A vertex of another region.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Foreign {
    vertex: u32,
    border: u32,
    data: Vertex,
}

/// Which regions use the vertices of another, by that: vertex and region. What comes soon again is there once.
struct Visits {
    uses: Buckets<[u32; 2]>,
    known: Sieve,
}

impl Visits {
    fn push(&mut self, home: u32, vertex: u32, region: usize) -> Result<(), BuildError> {
        if self.known.is_new([vertex, region as u32, u32::MAX]) {
            self.uses.push(home as usize, [vertex, region as u32])?;
        }
        Ok(())
    }
}

/// The source in regions.
pub(crate) struct Divided {
    vertices: VertexColumns,
    cells: Cells,
    /// By cell: its region, and its first vertex's number there.
    homes: Vec<(u32, u32)>,
    /// The cells of each region, ascending.
    region_cells: Vec<Vec<u32>>,
    triangles: Buckets<[u32; 3]>,
    /// By region with vertices: whether its triangles were sent to regions of their own.
    was_split: Vec<bool>,
    foreign: Buckets<Foreign>,
    /// The words of their scalars, in the same order.
    foreign_scalars: Buckets<u32>,
    /// Border vertices, by border number: in the order of their home regions, ascending within one.
    border: Vec<u32>,
    /// Home region h has the border numbers `border_starts[h]..border_starts[h + 1]`.
    border_starts: Vec<u32>,
    /// Copies of a triangle that were left out on the way to the regions.
    pub(crate) copies: u64,
    _share: Reservation,
}

/// Divides the source for `leaves` leaf clusters.
pub(crate) fn run(
    source: Source,
    leaves: u32,
    settings: &Settings,
    context: &Context<'_>,
) -> Result<Divided, BuildError> {
    let Source { mut vertices, mut triangles, bounds, .. } = source;
    let store = &context.store;
    let wanted = region_count(vertices.positions.len(), leaves, settings);

    // One region is one cell, and everything stays where it is. Else vertices get new numbers, by cell, and the graph of cells is cut.
    let mut cells = Cells::single(vertices.positions.len() as u32);
    let mut regions = vec![0];
    if wanted > 1 {
        let limit = (vertices.positions.len() as u32 / (wanted * REGION_CELLS)).max(settings.cell_vertices);
        let mapping;
        let traced = context.trace.task("number");
        (cells, mapping) = number::run(&vertices.positions, &bounds, limit, context)?;
        drop(traced);
        let traced = context.trace.task("permute");
        vertices = vertices.map(&number::Permutation { mapping: &mapping, context })?;
        drop(traced);
        let traced = context.trace.task("renumber");
        crate::join::run(&mut triangles, &mapping, context)?;
        drop((mapping, traced));
        context.check()?;

        let _traced = context.trace.task("cut");
        let joints = joints(&triangles, &cells, context)?.sums();
        let _share = store.budget.reserve_work("the graph of cells", graph_bytes(joints.len()))?;
        let graph = cell_graph::build(&cells.list, joints, settings.cell_neighbors)?;
        regions = partition::parts(&graph, wanted.min(cells.list.len() as u32), settings, context)?;
    } else {
        context.progress.advance(triangles.len() as u64);
    }
    context.check()?;

    // By cell its region, and the number that its first vertex has there: cells of a region follow one another.
    let mut region_cells = vec![Vec::new(); regions.iter().max().map_or(0, |last| *last as usize + 1)];
    let mut counts = vec![0; region_cells.len()];
    let mut homes = Vec::with_capacity(regions.len());
    for (cell, region) in regions.iter().enumerate() {
        homes.push((*region, counts[*region as usize]));
        counts[*region as usize] += cells.list[cell].count;
        region_cells[*region as usize].push(cell as u32);
    }

    let block = (BLOCKS / region_cells.len()).clamp(1 << 9, 1 << 15);
    let home_count = region_cells.len();
    let mut divided = Divided {
        vertices,
        cells,
        homes,
        region_cells,
        triangles: Buckets::new(store, "triangles by region", home_count, block),
        was_split: vec![false; home_count],
        foreign: Buckets::new(store, "vertices of other regions", 0, block / 4),
        foreign_scalars: Buckets::new(store, "scalars of other regions", 0, block / 4),
        border: Vec::new(),
        border_starts: vec![0],
        copies: 0,
        _share: store.budget.reserve_work("border vertices", 0)?,
    };

    // Triangles go first; regions that got too many are split; then it is known which vertices of others each region has.
    let uses = Buckets::new(store, "uses of other regions", home_count, block / 4);
    let mut visits = Visits { uses, known: Sieve::default() };
    let traced = context.trace.task("route");
    let uses = divided.route(triangles, &mut visits, context)?;
    drop(traced);
    let _traced = context.trace.task("exchange");
    divided.split(split::limit(settings), &uses, &mut visits, context)?;
    divided.exchange(visits, settings, context)?;
    process::return_free_pages();
    Ok(divided)
}

/// Regions for as many leaves and vertices: a power of two, so that each has the same number of leaves.
fn region_count(vertices: usize, leaves: u32, settings: &Settings) -> u32 {
    // As many vertices as a region of a closed surface has, twice over.
    let region_vertices = u64::from(REGION_LEAVES) * u64::from(settings.cluster_triangles.max(16));
    let by_vertices = (vertices as u64 / region_vertices).max(1).ilog2();
    (leaves / REGION_LEAVES).max(1 << by_vertices).max(1)
}

/// Graph of the cells from a sample of the triangles.
fn joints(triangles: &Column<[u32; 3]>, cells: &Cells, context: &Context<'_>) -> Result<Pairs, BuildError> {
    let steps = triangles.len().div_ceil(STEP);
    let phase = context.trace.phase();
    let all = (0..steps).into_par_iter().map_init(Vec::new, |scratch: &mut Vec<[u32; 3]>, step: usize| {
        let _traced = phase.task("joints");
        context.check()?;
        let range = step * STEP..triangles.len().min((step + 1) * STEP);
        let mut joints = Pairs::default();
        for t in triangles.read(range, scratch)?.iter().step_by(SAMPLE) {
            cell_graph::joints(t.map(|v| cells.of(v))).for_each(|(a, b)| joints.add(a, b, 1));
        }
        Ok(joints)
    });
    all.try_reduce(Pairs::default, |a, b| Ok(a.merge(b)))
}

impl Divided {
    /// The same with the vertices on disk, so that regions have more memory.
    pub(crate) fn moved_to_disk(self, store: &Store) -> Result<Self, BuildError> {
        Ok(Divided { vertices: self.vertices.map(&ToDisk(store))?, ..self })
    }

    /// Number of regions. Those after [`Self::home_count`] have no vertices of their own.
    pub(crate) fn region_count(&self) -> usize {
        self.triangles.count()
    }

    /// Number of regions that vertices are at home in.
    pub(crate) fn home_count(&self) -> usize {
        self.region_cells.len()
    }

    /// Number of border vertices.
    pub(crate) fn border_count(&self) -> usize {
        self.border.len()
    }

    /// Triangles of a region.
    pub(crate) fn triangle_count(&self, region: usize) -> usize {
        self.triangles.len(region)
    }

    /// Vertices of a region: its own, and copies of others.
    pub(crate) fn vertex_count(&self, region: usize) -> usize {
        let cells = self.region_cells.get(region).into_iter().flatten();
        let own: usize = cells.map(|cell| self.cells.range(*cell).len()).sum();
        own + self.foreign.len(region)
    }

    /// Whether triangles of a region have corners anywhere, and not only along its border.
    pub(crate) fn is_joined_to_all(&self, region: usize) -> bool {
        4 * self.foreign.len(region) > self.triangle_count(region)
    }

    /// Border vertices that a region may have: its own, which others use, and copies of others.
    pub(crate) fn border_vertices(&self, region: usize) -> usize {
        self.border_range(region).len() + self.foreign.len(region)
    }

    /// The border numbers of the vertices at home in a region.
    fn border_range(&self, region: usize) -> Range<u32> {
        let ends = self.border_starts.get(region).zip(self.border_starts.get(region + 1));
        ends.map_or(0..0, |(start, end)| *start..*end)
    }

    /// Sends each triangle to its region, and notes who uses the vertices of another. Answers how many corners each region has
    /// from others. Several steps are prepared side by side, and what each has for a region goes there in their order.
    fn route(
        &mut self,
        triangles: Column<[u32; 3]>,
        visits: &mut Visits,
        context: &Context<'_>,
    ) -> Result<Vec<u64>, BuildError> {
        let mut uses = vec![0; self.home_count()];
        let mut sieve = Sieve::default();
        let [sifting, joining, sorting, appending, visiting] = [(); 5].map(|()| context.trace.phase());
        let mut steps: Vec<Step> = (0..rayon::current_num_threads()).map(|_| Step::default()).collect();
        let starts: Vec<usize> = (0..triangles.len()).step_by(ROUTED).collect();
        for starts in starts.chunks(steps.len()) {
            let steps = &mut steps[..starts.len()];
            steps.par_iter_mut().zip(starts).try_for_each(|(step, start)| {
                let _traced = sifting.task("sift");
                context.check()?;
                step.read(&triangles, *start..triangles.len().min(start + ROUTED))
            })?;
            Step::join(steps, &mut sieve, joining);
            steps.par_iter_mut().for_each(|step| {
                let _traced = sorting.task("sort");
                step.sort(self);
            });

            self.triangles.parts_mut().into_par_iter().enumerate().try_for_each(|(region, mut own)| {
                let _traced = appending.task("append");
                steps.iter().try_for_each(|step| own.extend_from_slice(step.of_region(region)))
            })?;
            visits.uses.parts_mut().into_par_iter().enumerate().try_for_each(|(home, mut own)| {
                let _traced = visiting.task("visit");
                steps.iter().try_for_each(|step| own.extend(step.of_home(home)))
            })?;
            for step in steps {
                uses.iter_mut().zip(&step.uses).for_each(|(uses, more)| *uses += more);
            }
            let end = triangles.len().min(starts[starts.len() - 1] + ROUTED);
            context.progress.advance((end - starts[0]) as u64);
        }
        self.copies = sieve.dropped;
        Ok(uses)
    }

    /// Numbers the border vertices, and sends copies of them to the regions that use them.
    fn exchange(
        &mut self,
        visits: Visits,
        settings: &Settings,
        context: &Context<'_>,
    ) -> Result<(), BuildError> {
        // A bucket for each region, of which there are more since some were split.
        while self.foreign.count() < self.region_count() {
            self.foreign.add();
            self.foreign_scalars.add();
        }
        let (mut visiting, mut scratch) = (Vec::new(), Vertices::default());
        for home in 0..self.home_count() {
            context.check()?;
            visiting.clear();
            let _share = context
                .store
                .budget
                .reserve_work("uses of border vertices", 8 * visits.uses.len(home) as u64)?;
            visits.uses.read(home, &mut visiting)?;
            // Triangles of a split region have gone to others, which visit for themselves.
            visiting.retain(|[_, region]| self.was_split.get(*region as usize) != Some(&true));
            visiting.par_sort_unstable();
            visiting.dedup();

            // A cell's vertices lie side by side: one read for all that are visited.
            for cell in visiting.chunk_by(|a, b| self.cells.of(a[0]) == self.cells.of(b[0])) {
                let range = cell[0][0] as usize..cell[cell.len() - 1][0] as usize + 1;
                let first = range.start;
                let vertices = self.vertices.read(range, &mut scratch)?;
                for [vertex, region] in cell {
                    if self.border.last() != Some(vertex) {
                        self.border.push(*vertex);
                    }
                    let border = self.border.len() as u32 - 1;
                    let data = vertices.vertex(*vertex as usize - first);
                    self.foreign.push(*region as usize, Foreign { vertex: *vertex, border, data })?;
                    for word in vertices.scalars_of(*vertex as usize - first) {
                        self.foreign_scalars.push(*region as usize, *word)?;
                    }
                }
            }
            self.border_starts.push(self.border.len() as u32);
        }
        self.border.shrink_to_fit();
        // Border number, and what the counts of topology and the shared vertices keep for each.
        let len = if settings.normals == Normals::Computed { 24 + size_of::<Octahedral>() } else { 24 };
        self._share =
            context.store.budget.reserve_work("border vertices", (len * self.border.len()) as u64)?;
        Ok(())
    }

    /// The mesh of a region. Vertices of its own come first, those of others after them.
    pub(crate) fn load(&self, region: usize, context: &Context<'_>) -> Result<Mesh, BuildError> {
        let own_cells = self.region_cells.get(region).map_or(&[][..], Vec::as_slice);
        let own: usize = own_cells.iter().map(|cell| self.cells.range(*cell).len()).sum();
        let mut foreign = Vec::new();
        self.foreign.read(region, &mut foreign)?;
        let scalars = self.sorted_scalars(region, &foreign)?;
        foreign.sort_unstable_by_key(|f| f.vertex);

        let mut triangles = Vec::new();
        self.triangles.read(region, &mut triangles)?;

        // Where each vertex was looked for, and then which number those have that were found.
        const UNUSED: u32 = u32::MAX;
        let mut numbers = vec![UNUSED; own + foreign.len()];
        let phase = context.trace.phase();
        triangles.par_chunks_mut(LOADED).for_each(|triangles| {
            let _traced = phase.task("find");
            let corners = triangles.as_flattened_mut();
            corners.iter_mut().for_each(|v| *v = self.local(*v, region, own, &foreign));
        });
        triangles.as_flattened().iter().for_each(|v| numbers[*v as usize] = 0);

        // Those that triangles use are numbered in their order.
        let mut count = 0;
        for number in numbers.iter_mut().filter(|n| **n != UNUSED) {
            *number = count;
            count += 1;
        }
        let phase = context.trace.phase();
        triangles.par_chunks_mut(LOADED).for_each(|triangles| {
            let _traced = phase.task("renumber");
            triangles.as_flattened_mut().iter_mut().for_each(|v| *v = numbers[*v as usize]);
        });
        let copies = copies::drop_all(&mut triangles, count as usize);

        // Border vertices: those at home here that others visit, used here or not, and the foreign ones.
        let mut border = vec![INNER; count as usize];
        let mut visited_only = 0;
        for id in self.border_range(region) {
            match numbers[self.local(self.border[id as usize], region, own, &foreign) as usize] {
                UNUSED => visited_only += 1,
                number => border[number as usize] = id,
            }
        }
        for (number, vertex) in numbers[own..].iter().zip(&foreign) {
            border[*number as usize] = vertex.border;
        }

        let own_used = numbers[..own].iter().filter(|n| **n != UNUSED).count();
        let runs = Runs { cells: &self.cells, own: own_cells, numbers: &numbers, count: count as usize };
        Ok(Mesh {
            copies,
            triangles,
            border,
            referenced: own_used as u64 + visited_only,
            vertices: runs.gather(&self.vertices, &foreign, &scalars)?,
        })
    }

    /// The words of the scalars of other regions' vertices, by the numbers of these, which come as they were sent.
    fn sorted_scalars(&self, region: usize, foreign: &[Foreign]) -> Result<Vec<u32>, BuildError> {
        let words = self.vertices.scalars.len();
        let (mut sent, mut sorted) = (Vec::new(), Vec::new());
        if words > 0 {
            self.foreign_scalars.read(region, &mut sent)?;
            let mut order: Vec<usize> = (0..foreign.len()).collect();
            order.sort_unstable_by_key(|at| foreign[*at].vertex);
            order.iter().for_each(|at| sorted.extend_from_slice(&sent[at * words..(at + 1) * words]));
        }
        Ok(sorted)
    }

    /// Bytes of a vertex and what it carries.
    pub(super) fn vertex_len(&self) -> usize {
        self.vertices.attributes().vertex_len()
    }

    /// Words of a vertex's named scalars.
    pub(super) fn scalar_words(&self) -> usize {
        self.vertices.scalars.len()
    }

    /// The number of a vertex among a region's own and then the foreign ones.
    fn local(&self, vertex: u32, region: usize, own: usize, foreign: &[Foreign]) -> u32 {
        let cell = self.cells.of(vertex);
        let (home, first) = self.homes[cell as usize];
        if home as usize == region {
            first + (vertex - self.cells.range(cell).start as u32)
        } else {
            (own + foreign.partition_point(|f| f.vertex < vertex)) as u32
        }
    }
}

/// Moves columns to disk.
struct ToDisk<'a>(&'a Store);

impl ColumnMap for ToDisk<'_> {
    fn map<T: Pod + Send + Sync>(&self, column: Column<T>, _: &'static str) -> Result<Column<T>, BuildError> {
        Ok(column.moved_to_disk(self.0)?)
    }
}

/// The vertices of a region's own cells.
struct Runs<'a> {
    cells: &'a Cells,
    own: &'a [u32],
    /// The new number of each vertex, or `u32::MAX`.
    numbers: &'a [u32],
    count: usize,
}

impl Runs<'_> {
    /// Those of the vertices that are used, and behind them the `foreign` ones.
    fn gather(
        &self,
        vertices: &VertexColumns,
        foreign: &[Foreign],
        scalars: &[u32],
    ) -> Result<Vertices, BuildError> {
        let carried = vertices.attributes();
        let mut gathered = Vertices::with_capacity(self.count, carried);
        let mut scratch = Vertices::default();
        let (mut rest, mut numbers) = (self.own, self.numbers);
        while let [first, ..] = rest {
            // Neighbouring cells lie side by side.
            let run = rest.iter().zip(*first..).take_while(|(cell, next)| **cell == *next).count();
            let range = self.cells.range(*first).start..self.cells.range(rest[run - 1]).end;
            let (of_run, further) = numbers.split_at(range.len());
            let used = (0..).zip(of_run).filter(|(_, number)| **number != u32::MAX).map(|(at, _)| at);
            gathered.gather(vertices.read(range, &mut scratch)?, used);
            (rest, numbers) = (&rest[run..], further);
        }
        foreign.iter().for_each(|vertex| gathered.push_vertex(&vertex.data, carried));
        gathered.scalars.extend_from_slice(scalars);
        Ok(gathered)
    }
}

/// Value that most of a triangle's corners have; where all differ, one of the three by a rule that does not depend on the order of
/// the corners, so that copies of a triangle stay together.
pub(crate) fn majority(triangle: [u32; 3], of_corners: [u32; 3]) -> u32 {
    let [a, b, c] = of_corners;
    if a == b || a == c {
        a
    } else if b == c {
        b
    } else {
        let mut distinct = [a, b, c];
        distinct.sort_unstable();
        let sum: u64 = triangle.iter().map(|v| u64::from(*v)).sum();
        distinct[(sum % 3) as usize]
    }
}

/// Leaves that a region is cut into: an equal share, unless regions were cut or have fewer triangles than it seemed.
pub(crate) fn leaves_of(divided: &Divided, mesh: &Mesh, leaves: u32, settings: &Settings) -> u32 {
    if divided.region_count() == divided.home_count() && divided.copies + mesh.copies == 0 {
        leaves.div_ceil(divided.home_count() as u32)
    } else {
        leaf_count(mesh.triangles.len(), settings)
    }
}
