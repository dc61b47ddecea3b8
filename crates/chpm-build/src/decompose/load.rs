//! The mesh of a region, from what was sent to it.

use super::copies;
use super::divide::Foreign;
use super::homes::Homes;
use super::region::Mesh;
use crate::context::Context;
use crate::error::BuildError;
use crate::ids::Id;
use crate::vertex_columns::VertexColumns;
use chpm_mesh::Vertices;
use rayon::prelude::*;

/// Triangles of a region that one thread takes in at a time.
const LOADED: usize = 1 << 14;

/// No border number.
pub(crate) const INNER: u32 = u32::MAX;

/// No triangle has the vertex.
const UNUSED: u32 = u32::MAX;

/// All that a region is made of but the vertices themselves.
pub(crate) struct Material<I: Id> {
    /// By the numbers of vertices that hold everywhere.
    pub(crate) triangles: Vec<[I; 3]>,
    /// Vertices of others that they use.
    pub(crate) foreign: Vec<Foreign<I>>,
    /// Vertices at home here that others use, ascending,
    pub(crate) border: Vec<I>,
    /// and the border number of the first; the others' follow.
    pub(crate) first_border: u32,
}

impl<I: Id> Material<I> {
    /// The mesh. Vertices of its own come first, those of others after them.
    pub(crate) fn load(
        self,
        region: usize,
        homes: &Homes,
        vertices: &VertexColumns,
        context: &Context<'_>,
    ) -> Result<Mesh, BuildError> {
        let Material { mut triangles, mut foreign, border: visited, first_border } = self;
        foreign.sort_unstable_by_key(|[vertex, _]| *vertex);
        let own = homes.own(region);
        // The number of a vertex among a region's own and then the foreign ones.
        let local = |vertex: I| {
            let (home, number) = homes.place(vertex.index());
            if home as usize == region {
                number as usize
            } else {
                own + foreign.partition_point(|[other, _]| *other < vertex)
            }
        };

        // Where each vertex was looked for, and then which number those have that were found.
        let mut numbers = vec![UNUSED; own + foreign.len()];
        let phase = context.trace.phase();
        triangles.par_chunks_mut(LOADED).for_each(|triangles| {
            let _traced = phase.task("find");
            triangles.as_flattened_mut().iter_mut().for_each(|v| *v = I::of(local(*v)));
        });
        // From here on 32 bits do.
        let mut triangles = I::narrowed(triangles);
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
        for (vertex, id) in visited.iter().zip(first_border..) {
            match numbers[local(*vertex)] {
                UNUSED => visited_only += 1,
                number => border[number as usize] = id,
            }
        }
        for (number, [_, id]) in numbers[own..].iter().zip(&foreign) {
            border[*number as usize] = id.index() as u32;
        }

        let own_used = numbers[..own].iter().filter(|n| **n != UNUSED).count();
        let mut gathered = Vertices::with_capacity(count as usize, vertices.attributes());
        let (mut rest, mut scratch) = (&numbers[..own], Vertices::default());
        for run in homes.own_runs(region) {
            let (of_run, further) = rest.split_at(run.len());
            let used = (0..).zip(of_run).filter(|(_, number)| **number != UNUSED).map(|(at, _)| at);
            gathered.gather(vertices.read(run, &mut scratch)?, used);
            rest = further;
        }
        // A cell's vertices lie side by side: one read for all that are used.
        let cell_of = |[vertex, _]: &Foreign<I>| homes.cell_of(vertex.index());
        for cell in foreign.chunk_by(|a, b| cell_of(a) == cell_of(b)) {
            let [first, last] = [&cell[0], &cell[cell.len() - 1]].map(|[vertex, _]| vertex.index());
            let used = cell.iter().map(|[vertex, _]| vertex.index() - first);
            gathered.gather(vertices.read(homes.lie(first, last), &mut scratch)?, used);
        }
        Ok(Mesh { copies, triangles, border, referenced: own_used as u64 + visited_only, vertices: gathered })
    }
}

/// Value that most of a triangle's corners have; where all differ, one of the three by a number of the triangle that does not depend on the order of
/// its corners, so that its copies stay together.
pub(crate) fn majority(of_corners: [u32; 3], number: impl FnOnce() -> usize) -> u32 {
    let [a, b, c] = of_corners;
    if a == b || a == c {
        a
    } else if b == c {
        b
    } else {
        let mut distinct = [a, b, c];
        distinct.sort_unstable();
        distinct[number() % 3]
    }
}
