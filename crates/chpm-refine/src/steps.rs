//! The steps of a progressive mesh, prepared: which corners each collapse moves.

use chpm_mesh::ProgressiveMesh;
use std::ops::Range;

/// A mesh that goes up and down by steps. Triangles are kept in the order of their [birth](ProgressiveMesh::birth), so that those of a
/// position are always the first ones; a triangle that is not there keeps the corners it had last. A step writes the corners that
/// it changes, the same ones up and down, and allocates nothing.
#[derive(Clone, Debug, Default)]
pub(crate) struct Steps {
    /// By birth, and in the order of the finest mesh among equals.
    triangles: Vec<[u16; 3]>,
    /// By place in the finest mesh: place in `triangles`.
    place: Vec<u32>,
    /// By position from the base mesh's: how many triangles it has.
    alive: Vec<u32>,
    /// By collapse: where its corners end in `corners`. The last collapse's come first; one more entry for their start.
    ends: Vec<u32>,
    /// Corners (three to a triangle) that a collapse moves without killing their triangle.
    corners: Vec<u32>,
}

/// No corner.
const NONE: u32 = u32::MAX;

impl Steps {
    /// Prepares a mesh and puts it at its base mesh: plays all collapses once, each along the corners of its vertex.
    pub(crate) fn prepare(&mut self, mesh: &ProgressiveMesh<'_>) {
        let collapses = mesh.vertex_count - mesh.base_vertex_count;
        self.alive.clear();
        self.alive.resize(collapses + 1, 0);
        self.place.clear();
        self.place.resize(mesh.triangles.len(), 0);
        let mut played = mesh.triangles.to_vec();
        self.play(mesh, &mut played);
        self.sort_by_birth(&played);
        for corner in &mut self.corners {
            *corner = 3 * self.place[(*corner / 3) as usize] + *corner % 3;
        }
    }

    /// Notes the corners that move, and births where places will be; `triangles` keep the corners that they have last.
    fn play(&mut self, mesh: &ProgressiveMesh<'_>, triangles: &mut [[u16; 3]]) {
        let base = mesh.base_vertex_count;
        let mut lists = Lists::of_collapsed(mesh);
        let (births, corners) = (&mut self.place, &mut self.corners);

        corners.clear();
        self.ends.clear();
        self.ends.resize(mesh.targets.len() + 1, 0);

        for (collapse, target) in mesh.targets.iter().enumerate().rev() {
            let mut next = lists.first[collapse];
            while next != NONE {
                let corner = next;
                next = lists.next[corner as usize];
                let triangle = (corner / 3) as usize;
                if births[triangle] > 0 {
                    continue;
                }
                if triangles[triangle].contains(target) {
                    births[triangle] = collapse as u32 + 1;
                    continue;
                }
                triangles[triangle][(corner % 3) as usize] = *target;
                corners.push(corner);
                if let Some(list) = usize::from(*target).checked_sub(base) {
                    lists.push(list, corner);
                }
            }

            self.ends[collapse] = corners.len() as u32;
        }
    }

    /// A counting sort, which keeps the order among equals.
    fn sort_by_birth(&mut self, played: &[[u16; 3]]) {
        for birth in &self.place {
            self.alive[*birth as usize] += 1;
        }
        let mut sum = 0;
        for count in &mut self.alive {
            sum += std::mem::replace(count, sum);
        }
        self.triangles.clear();
        self.triangles.resize(played.len(), [0; 3]);
        for (corners, place) in played.iter().zip(&mut self.place) {
            // Starts become ends, which are the counts of the positions.
            let next = &mut self.alive[*place as usize];
            *place = *next;
            *next += 1;
            self.triangles[*place as usize] = *corners;
        }
    }

    /// Goes from one position to another, in either direction; an interval from the larger to the smaller one collapses.
    pub(crate) fn walk(&mut self, targets: &[u16], base_vertex_count: usize, way: Range<usize>) {
        let Range { start, end } = way;
        for vertex in (end..start).rev() {
            self.write(vertex - base_vertex_count, targets[vertex - base_vertex_count]);
        }
        for vertex in start..end {
            self.write(vertex - base_vertex_count, vertex as u16);
        }
    }

    /// Sets the corners that a collapse moves.
    fn write(&mut self, collapse: usize, to: u16) {
        let range = self.ends[collapse + 1] as usize..self.ends[collapse] as usize;
        let all = self.triangles.as_flattened_mut();
        for corner in &self.corners[range] {
            all[*corner as usize] = to;
        }
    }

    /// The triangles of the position that is `splits` away from the base mesh.
    pub(crate) fn triangles(&self, splits: usize) -> &[[u16; 3]] {
        &self.triangles[..self.alive[splits] as usize]
    }

    /// By place in the finest mesh: place among the triangles; the base mesh's come first.
    pub(crate) fn places(&self) -> &[u32] {
        &self.place
    }
}

/// The corners at each vertex that collapses, as lists.
struct Lists {
    /// By collapse.
    first: Vec<u32>,
    /// By corner.
    next: Vec<u32>,
}

impl Lists {
    fn of_collapsed(mesh: &ProgressiveMesh<'_>) -> Self {
        let all = mesh.triangles.as_flattened();
        let mut lists = Lists { first: vec![NONE; mesh.targets.len()], next: vec![NONE; all.len()] };
        for (corner, vertex) in (0..).zip(all) {
            if let Some(list) = usize::from(*vertex).checked_sub(mesh.base_vertex_count) {
                lists.push(list, corner);
            }
        }
        lists
    }

    fn push(&mut self, list: usize, corner: u32) {
        self.next[corner as usize] = std::mem::replace(&mut self.first[list], corner);
    }
}
