//! Collapses beyond a hierarchy: a mesh that is proven to be within a distance of its source loses vertices as long as that can be proven on the spot.
//!
//! Each change concerns the faces about one vertex or two. Those must be within the distance of the source afterwards, and what was near them before must
//! be within it of the faces there; all other proofs stay as they are. So the mesh that is left is within the distance, both ways. What is
//! cheapest by quadrics of the source comes first (Garland and Heckbert 1997), and what cannot be proven waits until something about it changes. A vertex that two become
//! is one of the source's, not always one of the two.
#![forbid(unsafe_code)]

mod cover;
mod near;
mod places;
mod surface;

use chpm_measure::Tiles;
use chpm_measure::box_tree::BoxTree;
use chpm_measure::proof::{Allowed, LOSS, Prover, Verdict};
use chpm_mesh::geom::to_f64;
use chpm_mesh::{Aabb, TriMesh};
use chpm_qem::Quadric;
use cover::{Cover, grown, meet};
use near::{Answer, Near};
use places::Places;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use surface::{Change, Ring, Surface};

/// Rings of vertices about a change whose faces what lies under it may be near to.
const RINGS: usize = 3;
/// Pieces that a triangle may be cut into besides those for what lies under it.
const LEAST: u64 = 256;
/// Triangles under a change that are looked at first: one in so many.
const SAMPLED: usize = 16;
/// Vertices or faces to look at that come to a piece's work.
const SCANNED: u64 = 16;
/// Faces about a vertex beyond which it stays as it is, and its other faces are not looked for near a change.
const MOST: usize = 128;
/// Faces near a change beyond which it is left.
const CROWD: usize = 2048;
/// Triangles of the source after which it is asked whether to stop.
const ASKED: usize = 1 << 12;
/// Weight of squared distances beside those from planes.
const SHORT: f64 = 5e-7;

/// How long to look for collapses.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Pieces of triangles to look at, about: a measure of time that is the same on every machine.
    pub pieces: u64,
    /// Vertices of the source to try as the one that two become, the cheapest first; besides the two.
    pub places: usize,
}

/// Pieces of triangles that are looked at in a minute, about.
const MINUTE: u64 = 16_000_000;
/// Triangles of a source up to which a mesh is taken further if nothing else is asked for.
const FURTHER: u64 = 4_000_000;

/// Level of `--effort`, from 0 to 3; if nothing is asked for, as far as a minute goes, about, and of a large source what is stored.
pub fn level(asked: Option<u8>, triangles: u64) -> u8 {
    asked.unwrap_or(if triangles <= FURTHER { 2 } else { 0 })
}

impl Effort {
    /// Effort of a level; none where it asks for what is stored, or for what the proof of that gives.
    pub fn of(level: u8) -> Option<Self> {
        match level {
            0 | 1 => None,
            2 => Some(Effort { pieces: MINUTE, places: 3 }),
            _ => Some(Effort { pieces: u64::MAX, places: 16 }),
        }
    }
}

/// A mesh that is left.
#[derive(Clone, Debug, Default)]
pub struct Reduced {
    /// Vertices: of the mesh that was given, and after those of the source.
    pub vertices: Vec<u32>,
    /// Corners, by place in `vertices`.
    pub triangles: Vec<[u32; 3]>,
}

/// Faces of a mesh within `distance` of a source, both ways, after as many collapses as could be proven. The mesh given must be within that distance.
/// `is_stopped` is asked now and then.
pub fn reduce(
    mesh: &TriMesh,
    (tiles, source): (&Tiles<'_>, &TriMesh),
    distance: f64,
    effort: Effort,
    is_stopped: &(dyn Fn() -> bool + Sync),
) -> Reduced {
    let mut reducer = Reducer::new(mesh, (tiles, source), distance, effort, is_stopped);
    while reducer.pieces < effort.pieces && !is_stopped() && reducer.step() {}
    Reduced { triangles: reducer.surface.left(), vertices: reducer.origins }
}

struct Reducer<'a> {
    surface: Surface,
    /// Of each vertex, where it is from, as in [`Reduced`].
    origins: Vec<u32>,
    cover: Cover,
    places: Places<'a>,
    quadrics: Vec<Quadric>,
    source: &'a TriMesh,
    to_source: Prover<'a>,
    /// Squared, with rounding on the safe side.
    most: f64,
    reach: f64,
    is_stopped: &'a (dyn Fn() -> bool + Sync),
    /// Cost of the edge between two vertices, and the changes of these that it is of.
    queue: BinaryHeap<Reverse<(u64, u32, u32, u32)>>,
    changes: Vec<u32>,
    pieces: u64,
    effort: Effort,
    ring: Ring,
    others: Ring,
    under: Vec<u32>,
    near: Near,
    used: Vec<(u32, u32)>,
    about: Vec<u32>,
    faces: Vec<u32>,
    edges: Ring,
    ways: Vec<Way>,
    change: Change,
    unknown: Vec<u32>,
    allowed: Allowed,
}

/// A way to make one vertex of two.
#[derive(Clone, Copy, Debug)]
struct Way {
    cost: f64,
    from: u32,
    to: u32,
    origin: u32,
    at: [f32; 3],
}

impl<'a> Reducer<'a> {
    fn new(
        mesh: &TriMesh,
        (tiles, source): (&'a Tiles<'a>, &'a TriMesh),
        distance: f64,
        effort: Effort,
        is_stopped: &'a (dyn Fn() -> bool + Sync),
    ) -> Self {
        let surface = Surface::new(mesh.positions.clone(), mesh.triangles.clone());
        let all = mesh.positions.iter().chain(&source.positions).flatten();
        let largest = f64::from(all.fold(0.0, |largest: f32, x| largest.max(x.abs())));
        let count = surface.vertex_count();
        let within = (distance - LOSS * largest).max(0.0);
        let mut reducer = Reducer {
            cover: Cover::new(mesh.triangles.len()),
            places: Places::new(source),
            quadrics: vec![Quadric::default(); count],
            origins: (0..count as u32).collect(),
            surface,
            source,
            to_source: Prover::new(tiles, is_stopped),
            most: within * within,
            reach: distance * (1.0 + 1e-6) + 8.0 * LOSS * largest,
            is_stopped,
            queue: BinaryHeap::new(),
            changes: vec![0; count],
            pieces: 0,
            effort,
            ring: Ring::new(),
            others: Ring::new(),
            under: Vec::new(),
            near: Near::default(),
            used: Vec::new(),
            about: Vec::new(),
            faces: Vec::new(),
            edges: Ring::new(),
            ways: Vec::new(),
            change: Change::default(),
            unknown: Vec::new(),
            allowed: Allowed::Same(distance),
        };
        reducer.cover_source(mesh);
        reducer.add_quadrics();
        for v in 0..count as u32 {
            if reducer.pieces >= effort.pieces || is_stopped() {
                break;
            }
            reducer.enqueue_edges(v, |w| w > v);
        }
        reducer
    }

    /// Finds the faces that prove each triangle of the source.
    fn cover_source(&mut self, mesh: &TriMesh) {
        let faces: Vec<_> = mesh.triangles.iter().map(|t| mesh.corners(*t)).collect();
        let tree = BoxTree::of_triangles(&faces);
        let boxes: Vec<Aabb> = faces.iter().map(Aabb::of_points).collect();
        let (mut of, mut faces_of) = (Vec::new(), Vec::new());
        for (number, triangle) in self.source.triangles.iter().enumerate() {
            if number.is_multiple_of(ASKED) && (self.is_stopped)() {
                return;
            }
            let triangle = self.source.corners(*triangle);
            let grown = grown(&triangle, self.reach);
            let around = 0.5 * grown.diagonal();
            let mut squared = around * around * (1.0 + 1e-6);
            self.near.clear();
            tree.search(grown.center(), &mut squared, |place, _| {
                let face = tree.order()[place];
                if meet(&grown, &boxes[face as usize]) {
                    self.near.push(face, faces[face as usize]);
                }
            });
            let (before, mut pieces) = (of.len(), 0);
            faces_of.clear();
            faces_of.extend_from_slice(self.near.faces());
            let answer = self.near.proves(triangle.map(to_f64), self.most, &mut pieces, |face| {
                of.push((faces_of[face], number as u32));
            });
            if answer != Answer::Within {
                // Some of these do, whichever.
                of.truncate(before);
                of.extend(faces_of.iter().map(|face| (*face, number as u32)));
            }
        }
        of.sort_unstable();
        for same in of.chunk_by(|a, b| a.0 == b.0) {
            self.cover.add(same[0].0, same.iter().map(|(_, triangle)| *triangle));
        }
    }

    fn add_quadrics(&mut self) {
        for v in 0..self.surface.vertex_count() as u32 {
            if self.is_crowded(v) {
                continue;
            }
            self.surface.ring(v, &mut self.ring);
            for face in self.surface.star(v) {
                let corners = self.surface.face(*face);
                let area = self.surface.area_vector(corners);
                self.quadrics[v as usize].add_face(area);
                for (w, _) in self.ring.iter().filter(|(w, faces)| *faces == 1 && corners.contains(w)) {
                    let edge = self.surface.point(*w) - self.surface.point(v);
                    self.quadrics[v as usize].add_boundary(edge, area);
                }
            }
        }
    }

    /// Finds the ways to make one vertex of two, the cheapest first.
    fn find_ways(&mut self, a: u32, b: u32) {
        self.ways.clear();
        self.surface.ring(a, &mut self.ring);
        self.surface.ring(b, &mut self.others);
        let fans = [self.surface.is_fan(a, &self.ring), self.surface.is_fan(b, &self.others)];
        let [point_a, point_b] = [a, b].map(|v| self.surface.point(v));
        let mut both = self.quadrics[b as usize];
        both.add_moved(&self.quadrics[a as usize], point_b - point_a);
        // Where nothing tells places apart, what is near both comes first.
        let cost = |at: [f32; 3]| {
            let at = to_f64(at);
            both.at(at - point_b)
                + SHORT * both.area * ((at - point_a).norm_squared() + (at - point_b).norm_squared())
        };

        for (is_fan, from, to) in [(fans[0], a, b), (fans[1], b, a)] {
            let (origin, at) = (self.origins[to as usize], self.surface.position(to));
            if is_fan {
                self.ways.push(Way { cost: cost(at), from, to, origin, at });
            }
        }
        if fans == [true; 2] {
            let star = self.surface.star(a).iter().chain(self.surface.star(b)).copied();
            self.cover.under(star, &mut self.under);
            self.pieces += self.under.len() as u64 / SCANNED;
            let first = self.surface.vertex_count() as u32;
            self.places.find_cheapest(&self.under, self.effort.places, cost);
            self.ways.extend(self.places.cheapest().iter().map(|(cost, v)| Way {
                cost: *cost,
                from: a,
                to: b,
                origin: first + v,
                at: self.source.positions[*v as usize],
            }));
        }
        self.ways.sort_by(|x, y| x.cost.total_cmp(&y.cost));
    }

    /// Puts those edges of a vertex into the queue whose other ends are wanted.
    fn enqueue_edges(&mut self, vertex: u32, is_wanted: impl Fn(u32) -> bool) {
        if self.is_crowded(vertex) {
            return;
        }
        let mut ring = std::mem::take(&mut self.edges);
        self.surface.ring(vertex, &mut ring);
        for (v, _) in ring.iter().filter(|(v, _)| is_wanted(*v)) {
            if self.is_crowded(*v) {
                continue;
            }
            let (a, b) = (vertex.min(*v), vertex.max(*v));
            self.find_ways(a, b);
            if let Some(best) = self.ways.first() {
                let stamp = self.changes[a as usize].wrapping_add(self.changes[b as usize]);
                self.queue.push(Reverse((best.cost.to_bits(), a, b, stamp)));
            }
        }
        self.edges = ring;
    }

    fn is_crowded(&self, vertex: u32) -> bool {
        self.surface.star(vertex).len() > MOST
    }

    /// Tries the next edge; false if there is none.
    fn step(&mut self) -> bool {
        let Some(Reverse((_, a, b, stamp))) = self.queue.pop() else { return false };
        if stamp != self.changes[a as usize].wrapping_add(self.changes[b as usize])
            || self.surface.star(a).is_empty()
            || self.surface.star(b).is_empty()
        {
            return true;
        }
        self.find_ways(a, b);
        let ways = std::mem::take(&mut self.ways);
        for way in &ways {
            if self.try_one(way) {
                break;
            }
        }
        self.ways = ways;
        true
    }

    /// Carries a collapse out if what it comes to is proven.
    fn try_one(&mut self, way: &Way) -> bool {
        let (mut ring, mut others) = (std::mem::take(&mut self.ring), std::mem::take(&mut self.others));
        self.surface.ring(way.from, &mut ring);
        self.surface.ring(way.to, &mut others);
        let mut change = std::mem::take(&mut self.change);
        let is_legal = self.surface.collapse((way.from, &ring), (way.to, &others), way.at, &mut change);
        let is_done = is_legal && {
            let faces = change.gone.iter().chain(change.changed.iter().map(|(face, _)| face)).copied();
            self.cover.under(faces, &mut self.under);
            let before = self.surface.put(way.to, way.at);
            self.find_near(&change, [&ring, &others]);
            self.pieces += self.near.faces().len() as u64 / SCANNED;
            let is_crowded = self.near.faces().len() > CROWD;
            let is_proven = !is_crowded && self.keeps_source() && self.keeps_mesh(&change);
            self.surface.put(way.to, before);
            if is_proven {
                self.carry_out(way, &change, [&ring, &others]);
            }
            is_proven
        };
        (self.ring, self.others, self.change) = (ring, others, change);
        is_done
    }

    /// Finds all faces near a change, as they are afterwards.
    fn find_near(&mut self, change: &Change, rings: [&Ring; 2]) {
        self.near.clear();
        for (face, corners) in &change.changed {
            self.near.push(*face, self.surface.corners(*corners));
        }
        let (about, faces) = (&mut self.about, &mut self.faces);
        faces.clear();
        set(about, rings.into_iter().flatten().map(|(v, _)| *v));
        let mut before = 0;
        for _ in 0..RINGS {
            let stars = about.iter().map(|v| self.surface.star(*v));
            faces.extend(stars.filter(|star| star.len() <= MOST).flatten());
            set(about, faces[before..].iter().flat_map(|face| self.surface.face(*face)));
            before = faces.len();
        }
        faces.sort_unstable();
        faces.dedup();
        for face in faces {
            if !change.gone.contains(face) && !change.changed.iter().any(|(other, _)| other == face) {
                self.near.push(*face, self.surface.corners(self.surface.face(*face)));
            }
        }
    }

    /// Whether what lies under a change is within the distance of faces about it; finds which those are.
    fn keeps_source(&mut self) -> bool {
        self.used.clear();
        let mut unknown = std::mem::take(&mut self.unknown);
        unknown.clear();
        let mut is_kept = true;
        // A few from everywhere come first: if it fails, it fails early.
        'all: for first in 0..SAMPLED {
            for t in self.under.iter().skip(first).step_by(SAMPLED) {
                let before = self.used.len();
                let triangle = self.source.corners(self.source.triangles[*t as usize]);
                let used = &mut self.used;
                let answer = self.near.proves(triangle.map(to_f64), self.most, &mut self.pieces, |face| {
                    used.push((face as u32, *t));
                });
                match answer {
                    Answer::Within => {}
                    Answer::Beyond => {
                        is_kept = false;
                        break 'all;
                    }
                    Answer::Unknown => {
                        self.used.truncate(before);
                        unknown.push(*t);
                    }
                }
            }
        }
        let is_kept = is_kept && (unknown.is_empty() || self.proves_large(&unknown));
        self.unknown = unknown;
        is_kept
    }

    /// As [`Reducer::keeps_source`], of triangles that are large beside the distance.
    fn proves_large(&mut self, triangles: &[u32]) -> bool {
        let faces = self.near.corners();
        let corners = faces.as_flattened().to_vec();
        let local =
            TriMesh::new(corners, (0..faces.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect());
        let tile = Tiles::new(vec![Aabb::of_points(&local.positions)], u64::MAX, |_| local.clone());
        let mut prover = Prover::new(&tile, self.is_stopped);
        let limit = LEAST * faces.len() as u64;
        for t in triangles {
            let corners = self.source.corners(self.source.triangles[*t as usize]);
            let found = prover.within(corners, &self.allowed, limit);
            self.pieces += found.pieces;
            if found.verdict != Verdict::Within {
                return false;
            }
            let grown = grown(&corners, self.reach);
            let reached = (0..).zip(faces).filter(|(_, face)| meet(&grown, &Aabb::of_points(*face)));
            self.used.extend(reached.map(|(face, _)| (face, *t)));
        }
        true
    }

    /// Whether the faces that change are within the distance of the source.
    fn keeps_mesh(&mut self, change: &Change) -> bool {
        let limit = LEAST * (1 + self.under.len() as u64);
        for (_, after) in &change.changed {
            let found = self.to_source.within(self.surface.corners(*after), &self.allowed, limit);
            self.pieces += found.pieces;
            if found.verdict != Verdict::Within {
                return false;
            }
        }
        true
    }

    fn carry_out(&mut self, way: &Way, change: &Change, rings: [&Ring; 2]) {
        let mut quadric = Quadric::default();
        for v in [way.from, way.to] {
            quadric.add_moved(&self.quadrics[v as usize], to_f64(way.at) - self.surface.point(v));
        }
        self.quadrics[way.to as usize] = quadric;
        self.origins[way.to as usize] = way.origin;
        self.surface.apply(change);

        change.gone.iter().for_each(|face| self.cover.clear(*face));
        change.changed.iter().for_each(|(face, _)| self.cover.clear(*face));
        self.used.sort_unstable();
        for same in self.used.chunk_by(|a, b| a.0 == b.0) {
            let face = self.near.faces()[same[0].0 as usize];
            self.cover.add(face, same.iter().map(|(_, triangle)| *triangle));
        }

        let mut about = std::mem::take(&mut self.about);
        set(&mut about, rings.into_iter().flatten().map(|(v, _)| *v).filter(|v| *v != way.from));
        self.changes[way.from as usize] += 1;
        about.iter().for_each(|v| self.changes[*v as usize] += 1);
        for v in &about {
            self.enqueue_edges(*v, |w| w > *v || about.binary_search(&w).is_err());
        }
        self.about = about;
    }
}

/// Makes a list these numbers, each once, in ascending order.
fn set(list: &mut Vec<u32>, numbers: impl Iterator<Item = u32>) {
    list.clear();
    list.extend(numbers);
    list.sort_unstable();
    list.dedup();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_sources_are_not_taken_further_unless_that_is_asked_for() {
        assert_eq!([level(None, FURTHER), level(None, FURTHER + 1)], [2, 0]);
        assert_eq!([level(Some(3), u64::MAX), level(Some(0), 1)], [3, 0]);
        assert!(Effort::of(1).is_none() && Effort::of(3).unwrap().pieces > Effort::of(2).unwrap().pieces);
    }
}
