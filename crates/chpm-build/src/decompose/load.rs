//! The mesh of a region, from what was sent to it.

use super::copies;
use super::divide::Foreign;
use super::homes::Homes;
use super::region::Mesh;
use crate::context::Context;
use crate::error::BuildError;
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
pub(crate) struct Material {
    /// By the numbers of vertices that hold everywhere.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Vertices of others that they use.
    pub(crate) foreign: Vec<Foreign>,
    /// Vertices at home here that others use, ascending,
    pub(crate) border: Vec<u32>,
    /// and the border number of the first; the others' follow.
    pub(crate) first_border: u32,
}

impl Material {
    /// The mesh. Vertices of its own come first, those of others after them.
    pub(crate) fn load(
        self,
        region: usize,
        homes: &Homes,
        vertices: &VertexColumns,
        context: &Context<'_>,
    ) -> Result<Mesh, BuildError> {
        let Material { mut triangles, mut foreign, border: visited, first_border } = self;
        foreign.sort_unstable_by_key(|f| f.vertex);
        let own = homes.own(region);
        // The number of a vertex among a region's own and then the foreign ones.
        let local = |vertex: u32| {
            let (home, number) = homes.place(vertex);
            if home as usize == region {
                number
            } else {
                (own + foreign.partition_point(|f| f.vertex < vertex)) as u32
            }
        };

        // Where each vertex was looked for, and then which number those have that were found.
        let mut numbers = vec![UNUSED; own + foreign.len()];
        let phase = context.trace.phase();
        triangles.par_chunks_mut(LOADED).for_each(|triangles| {
            let _traced = phase.task("find");
            triangles.as_flattened_mut().iter_mut().for_each(|v| *v = local(*v));
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
        for (vertex, id) in visited.iter().zip(first_border..) {
            match numbers[local(*vertex) as usize] {
                UNUSED => visited_only += 1,
                number => border[number as usize] = id,
            }
        }
        for (number, vertex) in numbers[own..].iter().zip(&foreign) {
            border[*number as usize] = vertex.border;
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
        for cell in foreign.chunk_by(|a, b| homes.cell_of(a.vertex) == homes.cell_of(b.vertex)) {
            let (first, last) = (cell[0].vertex, cell[cell.len() - 1].vertex);
            let used = cell.iter().map(|f| (f.vertex - first) as usize);
            gathered.gather(vertices.read(homes.lie(first, last), &mut scratch)?, used);
        }
        Ok(Mesh { copies, triangles, border, referenced: own_used as u64 + visited_only, vertices: gathered })
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
