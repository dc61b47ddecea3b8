//! Collapses beyond a hierarchy: a mesh that is proven to be within a distance of its source loses vertices as long as that can be proven on the spot.
//!
//! Each half-edge collapse changes the faces about one vertex. Those must be within the distance of the source, and what lay near the faces before must
//! be within it of the faces there afterwards; all other proofs stay as they are. So the mesh that is left is within the distance, both ways. What is
//! cheapest by quadrics comes first (Garland and Heckbert 1997), and what cannot be proven waits until something about it changes.
#![forbid(unsafe_code)]

mod cover;
mod surface;

use chpm_measure::Tiles;
use chpm_measure::proof::{Allowed, LOSS, Prover, Verdict};
use chpm_mesh::{Aabb, TriMesh};
use chpm_qem::Quadric;
use cover::Cover;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use surface::{Collapse, Surface};

/// Rings of vertices about a change whose faces what lies under it may be near to.
const RINGS: usize = 3;
/// Pieces that a triangle may be cut into besides those for what lies under it.
const LEAST: u64 = 256;

/// How long to look for collapses.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Pieces of triangles to look at, about: a measure of time that is the same on every machine.
    pub pieces: u64,
    /// Neighbours of a vertex to try, the cheapest first.
    pub targets: usize,
}

/// Faces of a mesh within `distance` of a source, both ways, after as many collapses as could be proven. The mesh given must be within that distance.
/// `triangles` are those of `source`. `is_stopped` is asked now and then.
pub fn reduce(
    mesh: &TriMesh,
    (source, triangles): (&Tiles<'_>, &[[[f32; 3]; 3]]),
    distance: f64,
    effort: Effort,
    is_stopped: &(dyn Fn() -> bool + Sync),
) -> Vec<[u32; 3]> {
    let mut reducer = Reducer::new(mesh, (source, triangles), distance, effort, is_stopped);
    while reducer.pieces < effort.pieces && !is_stopped() && reducer.step() {}
    reducer.surface.left()
}

struct Reducer<'a> {
    surface: Surface<'a>,
    cover: Cover<'a>,
    quadrics: Vec<Quadric>,
    triangles: &'a [[[f32; 3]; 3]],
    to_source: Prover<'a>,
    allowed: Allowed,
    is_stopped: &'a (dyn Fn() -> bool + Sync),
    /// Cost, vertex, and the change of it that the cost is of.
    queue: BinaryHeap<Reverse<(u64, u32, u32)>>,
    changes: Vec<u32>,
    pieces: u64,
    targets: usize,
    neighbours: Vec<(u32, u32)>,
    others: Vec<(u32, u32)>,
    under: Vec<u32>,
}

impl<'a> Reducer<'a> {
    fn new(
        mesh: &'a TriMesh,
        (source, triangles): (&'a Tiles<'a>, &'a [[[f32; 3]; 3]]),
        distance: f64,
        effort: Effort,
        is_stopped: &'a (dyn Fn() -> bool + Sync),
    ) -> Self {
        let surface = Surface::new(&mesh.positions, mesh.triangles.clone());
        let faces: Vec<_> = mesh.triangles.iter().map(|t| mesh.corners(*t)).collect();
        let both = triangles.iter().chain(&faces);
        let largest = both.flat_map(|t| t.as_flattened()).fold(0.0, |largest: f32, x| largest.max(x.abs()));
        let reach = distance * (1.0 + 1e-6) + 8.0 * LOSS * f64::from(largest);
        let count = surface.vertex_count();
        let mut reducer = Reducer {
            cover: Cover::new(triangles, &faces, reach),
            quadrics: vec![Quadric::default(); count],
            surface,
            triangles,
            to_source: Prover::new(source, is_stopped),
            allowed: Allowed::Same(distance),
            is_stopped,
            queue: BinaryHeap::new(),
            changes: vec![0; count],
            pieces: 0,
            targets: effort.targets,
            neighbours: Vec::new(),
            others: Vec::new(),
            under: Vec::new(),
        };
        reducer.add_quadrics();
        (0..count as u32).for_each(|v| reducer.enqueue(v));
        reducer
    }

    fn add_quadrics(&mut self) {
        for v in 0..self.surface.vertex_count() as u32 {
            self.surface.neighbours(v, &mut self.neighbours);
            for face in self.surface.star(v) {
                let corners = self.surface.face(*face);
                let area = self.surface.area_vector(corners);
                self.quadrics[v as usize].add_face(area);
                for (w, faces) in &self.neighbours {
                    if *faces == 1 && corners.contains(w) {
                        self.quadrics[v as usize].add_boundary(self.surface.edge(v, *w), area);
                    }
                }
            }
        }
    }

    /// The cheapest neighbours to go to, in that order.
    fn targets(&mut self, vertex: u32, found: &mut Vec<(f64, u32)>) {
        found.clear();
        self.surface.neighbours(vertex, &mut self.neighbours);
        if !self.surface.is_fan(vertex, &self.neighbours) {
            return;
        }
        let quadric = &self.quadrics[vertex as usize];
        for (v, _) in &self.neighbours {
            let edge = self.surface.edge(vertex, *v);
            found.push((quadric.at(edge) + 1e-6 * quadric.area * edge.norm_squared(), *v));
        }
        found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        found.truncate(self.targets);
    }

    fn enqueue(&mut self, vertex: u32) {
        let mut targets = Vec::new();
        self.targets(vertex, &mut targets);
        if let Some((cost, _)) = targets.first() {
            self.queue.push(Reverse((cost.max(0.0).to_bits(), vertex, self.changes[vertex as usize])));
        }
    }

    /// Tries the next vertex; false if there is none.
    fn step(&mut self) -> bool {
        let Some(Reverse((_, vertex, change))) = self.queue.pop() else { return false };
        if change != self.changes[vertex as usize] {
            return true;
        }
        let (mut targets, mut collapse) = (Vec::new(), Collapse::default());
        self.targets(vertex, &mut targets);
        for (_, to) in targets {
            let (neighbours, mut others) =
                (std::mem::take(&mut self.neighbours), std::mem::take(&mut self.others));
            let is_legal = self.surface.collapse(vertex, to, &neighbours, &mut others, &mut collapse);
            (self.neighbours, self.others) = (neighbours, others);
            if is_legal && self.try_one(&collapse) {
                return true;
            }
        }
        true
    }

    /// Carries a collapse out if what it comes to is proven.
    fn try_one(&mut self, collapse: &Collapse) -> bool {
        let near = self.near(collapse);
        let corners: Vec<[[f32; 3]; 3]> = near.iter().map(|(_, c)| self.surface.corners(*c)).collect();
        let star = self.surface.star(collapse.from).iter().copied();
        let mut under = std::mem::take(&mut self.under);
        self.cover.under(star, &mut under);
        let is_proven = self.keeps_source(&corners, &under) && self.keeps_mesh(collapse, under.len());
        if is_proven {
            self.carry_out(collapse, &near, &corners, &under);
        }
        self.under = under;
        is_proven
    }

    /// All faces near a change, as they are afterwards.
    fn near(&self, collapse: &Collapse) -> Vec<(u32, [u32; 3])> {
        let mut near = collapse.changed.clone();
        let mut about: Vec<u32> = self.neighbours.iter().map(|(v, _)| *v).collect();
        for _ in 0..RINGS {
            let mut next = Vec::new();
            for face in about.iter().flat_map(|v| self.surface.star(*v)) {
                let corners = self.surface.face(*face);
                if !corners.contains(&collapse.from) {
                    near.push((*face, corners));
                    next.extend(corners);
                }
            }
            next.sort_unstable();
            next.dedup();
            about = next;
        }

        near.sort_unstable();
        near.dedup();
        near
    }

    /// Whether what lies under the change is within the distance of faces about it.
    fn keeps_source(&mut self, near: &[[[f32; 3]; 3]], under: &[u32]) -> bool {
        let local = TriMesh::new(
            near.as_flattened().to_vec(),
            (0..near.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        );
        let bounds = Aabb::of_points(&local.positions);
        let tile = Tiles::new(vec![bounds], u64::MAX, |_| local.clone());
        let mut prover = Prover::new(&tile, self.is_stopped);
        let limit = LEAST * near.len() as u64;
        for t in under {
            let found = prover.within(self.triangles[*t as usize], &self.allowed, limit);
            self.pieces += found.pieces;
            if found.verdict != Verdict::Within {
                return false;
            }
        }
        true
    }

    /// Whether the faces that a collapse changes are within the distance of the source.
    fn keeps_mesh(&mut self, collapse: &Collapse, under: usize) -> bool {
        let limit = LEAST * (1 + under as u64);
        for (_, after) in &collapse.changed {
            let found = self.to_source.within(self.surface.corners(*after), &self.allowed, limit);
            self.pieces += found.pieces;
            if found.verdict != Verdict::Within {
                return false;
            }
        }
        true
    }

    fn carry_out(
        &mut self,
        collapse: &Collapse,
        near: &[(u32, [u32; 3])],
        corners: &[[[f32; 3]; 3]],
        under: &[u32],
    ) {
        let Collapse { from, to, .. } = *collapse;
        collapse.gone.iter().for_each(|face| self.cover.clear(*face));
        collapse.changed.iter().for_each(|(face, _)| self.cover.clear(*face));
        for ((face, _), corners) in near.iter().zip(corners) {
            self.cover.add(*face, corners, under);
        }
        let (quadric, edge) = (self.quadrics[from as usize], self.surface.edge(from, to));
        self.quadrics[to as usize].add_moved(&quadric, edge);
        self.surface.apply(collapse);
        self.changes[from as usize] += 1;
        let about = std::mem::take(&mut self.neighbours);
        for (v, _) in &about {
            self.changes[*v as usize] += 1;
            self.enqueue(*v);
        }
    }
}
