//! Half-edge collapses of a whole mesh in core, cheapest first, until none is left, with what a vertex split needs to undo each.
//!
//! Costs are Garland and Heckbert's quadrics; collapses keep the topology, boundaries, and the sides of faces.

use crate::fan::{Faces, Fan, NONE};
use chpm_mesh::{TriMesh, geom};
use chpm_qem::Quadric;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// A face may turn by no more than the angle of this cosine.
const LEAST_COSINE: f64 = 0.25;

/// One collapse, in the numbers of the source mesh.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Collapse {
    pub(crate) kept: u32,
    pub(crate) removed: u32,
    /// The face of the half edge from `removed` to `kept`, and the face of the opposite one.
    pub(crate) faces: [u32; 2],
    /// Neighbours of the first face at `kept` and at `removed`, then of the second.
    pub(crate) outer: [u32; 4],
    /// Root of the mean squared distance to the planes, object units.
    pub(crate) error: f32,
}

/// The collapses of a mesh in their order, and the mesh that is left.
pub(crate) fn simplify(mesh: &TriMesh) -> anyhow::Result<(Vec<Collapse>, Faces)> {
    let mut state = State::new(mesh)?;
    for vertex in 0..mesh.positions.len() as u32 {
        state.queue(vertex);
    }
    let mut collapses = Vec::with_capacity(mesh.positions.len());
    while let Some(Reverse((_, u, v, stamp))) = state.heap.pop() {
        if stamp != state.stamps[u as usize] {
            continue;
        }
        state.fan.collect(&state.faces, u, state.one[u as usize]);
        let at = state.fan.ring.iter().position(|w| *w == v);
        match at.filter(|at| state.allows(u, *at)) {
            Some(at) => collapses.push(state.collapse(u, at)),
            None => state.queue(u),
        }
    }
    Ok((collapses, state.faces))
}

struct State<'a> {
    mesh: &'a TriMesh,
    faces: Faces,
    /// A face of every vertex.
    one: Vec<u32>,
    quadrics: Vec<Quadric>,
    /// The cheapest collapse of each vertex: bits of the cost, which order as it does, the vertex, where it goes, its stamp then.
    heap: BinaryHeap<Reverse<(u64, u32, u32, u32)>>,
    stamps: Vec<u32>,
    /// By vertex: the last question that met it.
    seen: Vec<u32>,
    question: u32,
    /// About the vertex in question, and about the one that it goes to.
    fan: Fan,
    other: Fan,
    costs: Vec<(u64, usize)>,
}

impl<'a> State<'a> {
    fn new(mesh: &'a TriMesh) -> anyhow::Result<Self> {
        let faces = Faces::new(mesh)?;
        let count = mesh.positions.len();
        let mut one = vec![NONE; count];
        let mut degree = vec![0; count];
        let mut quadrics = vec![Quadric::default(); count];
        for (face, corners) in (0..).zip(&mesh.triangles) {
            let [a, b, c] = mesh.corners(*corners);
            let area = geom::area_vector(a, b, c);
            for i in 0..3 {
                let (v, w) = (corners[i], corners[(i + 1) % 3]);
                one[v as usize] = face;
                degree[v as usize] += 1;
                quadrics[v as usize].add_face(area);
                if faces.across[face as usize][i] == NONE {
                    let [p, q] = [v, w].map(|v| geom::to_f64(mesh.positions[v as usize]));
                    quadrics[v as usize].add_boundary(q - p, area);
                    quadrics[w as usize].add_boundary(q - p, area);
                }
            }
        }
        let mut fan = Fan::default();
        for v in (0..count as u32).filter(|v| one[*v as usize] != NONE) {
            fan.collect(&faces, v, one[v as usize]);
            anyhow::ensure!(fan.faces.len() == degree[v as usize], "vertex {v} has two fans");
        }
        Ok(State {
            mesh,
            faces,
            one,
            quadrics,
            heap: BinaryHeap::with_capacity(2 * count),
            stamps: vec![0; count],
            seen: vec![0; count],
            question: 0,
            fan,
            other: Fan::default(),
            costs: Vec::new(),
        })
    }

    fn cost(&self, u: u32, v: u32) -> f64 {
        let [p, q] = [u, v].map(|v| geom::to_f64(self.mesh.positions[v as usize]));
        self.quadrics[u as usize].at(q - p)
    }

    /// Queues the cheapest collapse that a vertex is allowed.
    fn queue(&mut self, u: u32) {
        self.stamps[u as usize] += 1;
        if self.one[u as usize] == NONE {
            return;
        }
        self.fan.collect(&self.faces, u, self.one[u as usize]);
        let mut costs = std::mem::take(&mut self.costs);
        costs.clear();
        // Adding zero turns -0, whose bits are the largest, into 0.
        costs
            .extend(self.fan.ring.iter().enumerate().map(|(at, v)| ((self.cost(u, *v) + 0.0).to_bits(), at)));
        costs.sort_unstable();
        if let Some((cost, at)) = costs.iter().find(|(_, at)| self.allows(u, *at)) {
            self.heap.push(Reverse((*cost, u, self.fan.ring[*at], self.stamps[u as usize])));
        }
        self.costs = costs;
    }

    /// Whether `u`, whose fan was collected, may go to a vertex of its ring.
    fn allows(&mut self, u: u32, at: usize) -> bool {
        let fan = &self.fan;
        let last = fan.ring.len() - 1;
        if !fan.closed && at != 0 && at != last {
            return false;
        }
        let v = fan.ring[at];
        let goes = fan.beside(at);
        // A face with two open edges stays: without it a bare edge could be left.
        let is_tip = |face: u32| self.faces.across[face as usize].iter().filter(|f| **f == NONE).count() >= 2;
        if goes.into_iter().any(|face| face != NONE && is_tip(face)) {
            return false;
        }
        self.other.collect(&self.faces, v, self.one[v as usize]);
        if fan.closed && self.other.closed && fan.ring.len() == 3 && self.other.ring.len() == 3 {
            return false;
        }
        // What both see is only what the faces that go have as their third corners.
        self.question += 1;
        fan.ring.iter().for_each(|w| self.seen[*w as usize] = self.question);
        let common = self.other.ring.iter().filter(|w| self.seen[**w as usize] == self.question).count();
        if common != goes.iter().filter(|face| **face != NONE).count() {
            return false;
        }
        let target = self.mesh.positions[v as usize];
        let stays = fan.faces.iter().filter(|face| !goes.contains(face));
        stays.map(|face| self.faces.corners[*face as usize]).all(|corners| {
            let [a, b, c] = self.mesh.corners(corners);
            let before = geom::area_vector(a, b, c);
            let moved = corners.map(|w| if w == u { target } else { self.mesh.positions[w as usize] });
            let after = geom::area_vector(moved[0], moved[1], moved[2]);
            before.norm() == 0.0 || after.dot(&before) > LEAST_COSINE * after.norm() * before.norm()
        })
    }

    fn collapse(&mut self, u: u32, at: usize) -> Collapse {
        let v = self.fan.ring[at];
        let error = self.cost(u, v) / self.quadrics[u as usize].area.max(f64::MIN_POSITIVE);
        let goes = self.fan.beside(at);
        let mut outer = [NONE; 4];
        for (side, face) in goes.into_iter().enumerate().filter(|(_, face)| *face != NONE) {
            let index = face as usize;
            let corner = self.faces.corner(face, u);
            // The edge opposite `u` is the one at `v`; the third one is at `u`.
            let at_kept = self.faces.across[index][(corner + 1) % 3];
            let at_removed = self.faces.across[index][if side == 0 { (corner + 2) % 3 } else { corner }];
            outer[2 * side..][..2].copy_from_slice(&[at_kept, at_removed]);
            let ends = [at_kept, at_removed].map(|f| if f == NONE { 0 } else { self.faces.edge_to(f, face) });
            self.faces.join(at_kept, ends[0], at_removed);
            self.faces.join(at_removed, ends[1], at_kept);
            let stays = if at_kept == NONE { at_removed } else { at_kept };
            let apex = self.faces.corners[index].into_iter().find(|w| *w != u && *w != v).unwrap_or(v);
            self.one[apex as usize] = stays;
            self.one[v as usize] = stays;
        }
        for face in self.fan.faces.iter().filter(|face| !goes.contains(face)) {
            let corner = self.faces.corner(*face, u);
            self.faces.corners[*face as usize][corner] = v;
        }
        for face in goes.into_iter().filter(|face| *face != NONE) {
            self.faces.corners[face as usize] = [NONE; 3];
        }
        self.one[u as usize] = NONE;
        self.stamps[u as usize] += 1;
        let [p, q] = [u, v].map(|v| geom::to_f64(self.mesh.positions[v as usize]));
        let moved = self.quadrics[u as usize];
        self.quadrics[v as usize].add_moved(&moved, q - p);
        self.fan.collect(&self.faces, v, self.one[v as usize]);
        let ring = std::mem::take(&mut self.fan.ring);
        ring.iter().for_each(|w| self.queue(*w));
        self.queue(v);
        Collapse { kept: v, removed: u, faces: goes, outer, error: error.sqrt() as f32 }
    }
}
