//! Whether random legal cuts hold together (I7), by a checker that knows meshes only: no clusters, no quadrics.
//!
//! A cut is welded only where clusters say that they share a vertex, and looked at from outside: an edge of one
//! face, or of any other odd number, may be only where the source has one. Edges of four faces may be anywhere, since the
//! topology may have changed; they let nothing through.
//!
//! Every cut is looked at cluster by cluster, each triangle of it, and its odd edges as they are together (`seams`). One of many, and any
//! in which that finds something, is extracted and looked at as one mesh too: that is what is told.

mod seams;

use crate::progress::Meter;
use crate::stop;
use anyhow::Result;
use chpm_build::Cancel;
use chpm_format::Chpm;
use chpm_measure::bvh::squared_distance;
use chpm_measure::crack::T_JUNCTION_TOLERANCE;
use chpm_measure::{Bvh, Crack, cracks};
use chpm_mesh::geom::to_f64;
use chpm_mesh::{Level, TriMesh};
use chpm_refine::{CameraPath, Cut, Hierarchy, RefineError, View, extract, random_cut, select};
use nalgebra::Point3;
use rayon::prelude::*;
use seams::Seams;

/// Cuts whose faults are told; further ones are counted.
const TOLD: usize = 20;
/// One of so many cuts is looked at as one mesh whatever its seams are.
const WHOLE: u64 = 64;
/// Pixels of error in a camera's image of 512 x 512: 16 for the first camera, half as much for every next one, and again from 16.
const PIXELS: f64 = 16.0;
const HALVINGS: u64 = 12;

/// What was found.
#[derive(Debug)]
pub(crate) struct Cuts {
    /// Cuts that were drawn.
    pub(crate) count: u32,
    /// Seed of the first one.
    pub(crate) seed: u64,
    /// Triangles of all of them.
    pub(crate) triangles: u64,
    /// The first faults, of one cut each.
    pub(crate) faults: Vec<String>,
    /// Places that are wrong, over all cuts.
    pub(crate) fault_count: u64,
}

/// Draws `count` cuts from `seed` on and checks each against the finest mesh of the file, several at a time. Even seeds are random
/// legal cuts, odd ones what random cameras select. The pages of the file must be sound.
pub(crate) fn check<D: AsRef<[u8]> + Sync>(
    file: &Chpm<D>,
    count: u32,
    seed: u64,
    meter: &Meter,
    cancel: &Cancel,
) -> Result<Cuts> {
    meter.start("cuts", count.into());
    let border = Border::of(&extract(file, &Cut::at_level(file, Level(0)))?);
    let checker = Checker { file, hierarchy: Hierarchy::new(file), border };
    let looked_at: Vec<Looked> = (0..u64::from(count))
        .into_par_iter()
        .map_init(Seams::default, |seams, i| {
            stop::check(cancel)?;
            let looked = checker.look(seams, seed.wrapping_add(i), i % WHOLE == 0);
            meter.add(1);
            looked
        })
        .collect::<Result<_>>()?;
    meter.finish();
    let mut found = Cuts { count, seed, triangles: 0, faults: Vec::new(), fault_count: 0 };
    for (i, looked) in (0..).zip(looked_at) {
        found.triangles += looked.triangles;
        if let Some((places, message)) = looked.fault {
            found.note(seed.wrapping_add(i), places, &message);
        }
    }
    Ok(found)
}

struct Checker<'a, D> {
    file: &'a Chpm<D>,
    hierarchy: Hierarchy,
    border: Border,
}

/// What a cut showed.
#[derive(Default)]
struct Looked {
    triangles: u64,
    /// Number of wrong places, and the first one.
    fault: Option<(usize, String)>,
}

impl<D: AsRef<[u8]>> Checker<'_, D> {
    fn look(&self, seams: &mut Seams, seed: u64, whole: bool) -> Result<Looked> {
        match self.try_look(seams, seed, whole) {
            Ok(looked) => Ok(looked),
            // What the file itself makes impossible is told by the other checks, with a place.
            Err(error @ RefineError::Format(_)) => Err(error.into()),
            Err(error) => Ok(Looked { triangles: 0, fault: Some((1, error.to_string())) }),
        }
    }

    fn try_look(&self, seams: &mut Seams, seed: u64, whole: bool) -> Result<Looked, RefineError> {
        let cut = draw(self.file, &self.hierarchy, seed)?;
        cut.check(self.file)?;
        seams.enter(self.file, &cut)?;
        let mut looked = Looked { triangles: seams.triangles(), fault: None };
        if whole || !self.border.holds(seams) {
            let mesh = extract(self.file, &cut)?;
            let leaks = self.border.leaks(&mesh);
            looked.fault = leaks.first().map(|first| {
                let first = first.tell(&mesh, self.file.header().origin);
                let rest = leaks.len() - 1;
                let more = if rest > 0 { format!("; {rest} more in this cut") } else { String::new() };
                (leaks.len(), format!("{first}{more}"))
            });
        }
        Ok(looked)
    }
}

/// The cut of a seed.
pub(crate) fn draw<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    hierarchy: &Hierarchy,
    seed: u64,
) -> Result<Cut, RefineError> {
    let path = CameraPath::random(&file.header().aabb(), seed, 1);
    match path.cameras.first() {
        Some(camera) if seed % 2 == 1 => {
            let pixels = PIXELS * 0.5_f64.powi((seed / 2 % HALVINGS) as i32);
            select(file, hierarchy, &View::new(camera, [512, 512], pixels)?)
        }
        _ => random_cut(file, seed),
    }
}

impl Cuts {
    fn note(&mut self, seed: u64, places: usize, message: &str) {
        self.fault_count += places as u64;
        if self.faults.len() < TOLD {
            self.faults.push(format!("I7 boundary: cut of seed {seed}: {message}"));
        }
    }
}

/// Bits of a position, -0.0 and 0.0 being one: a level of detail keeps vertices of the source and moves none.
type Place = [u32; 3];

fn place(position: &[f32; 3]) -> Place {
    position.map(|x| (x + 0.0).to_bits())
}

/// Where a level of detail may have edges of an odd number of faces.
struct Border {
    outline: Outline,
    /// The ends of its edges, ascending.
    vertices: Vec<Place>,
}

impl Border {
    fn of(source: &TriMesh) -> Self {
        let outline =
            Outline::of(odd_edges(source).map(|(edge, _)| edge.map(|v| source.positions[v as usize])));
        let mut vertices: Vec<Place> = outline.slivers.positions.iter().map(place).collect();
        vertices.sort_unstable();
        vertices.dedup();
        Border { outline, vertices }
    }

    /// Whether the odd edges of a cut are where the source has some, and the border meets itself nowhere anew. Where it does, `leaks`
    /// finds nothing either: that asks the second of edges of one face alone.
    fn holds(&self, seams: &Seams) -> bool {
        let own = Outline::of(seams.odd_edges());
        own.slivers.positions.iter().all(|end| self.has(end))
            && self.cracks(&own.slivers).iter().all(|crack| self.is_old(crack, &own.slivers, &own))
    }

    fn has(&self, position: &[f32; 3]) -> bool {
        self.vertices.binary_search(&place(position)).is_ok()
    }

    fn cracks(&self, lod: &TriMesh) -> Vec<Crack> {
        cracks(lod, &self.outline.slivers)
    }

    /// Whether a vertex inside an edge of `lod`, whose odd edges are `own`, says nothing: where the source's border comes to one place
    /// more than once, only positions hold it together, and an edge may come to pass a vertex. No more ways may lead
    /// from there than in the source, where a passing edge counts as the two that it was.
    fn is_old(&self, crack: &Crack, lod: &TriMesh, own: &Outline) -> bool {
        let &Crack::TJunction { vertex, edge: [a, b] } = crack else { return false };
        let [point, a, b] = [vertex, a, b].map(|v| to_f64(lod.positions[v as usize]));
        let reach = T_JUNCTION_TOLERANCE * (b - a).norm();
        // Borders that are about as close to each other may have come closer.
        own.ways(point, reach, reach) <= self.outline.ways(point, 4.0 * reach, reach)
    }

    /// Places of a level of detail where it lets the background through and the source does not.
    fn leaks(&self, lod: &TriMesh) -> Vec<Leak> {
        let odd: Vec<_> = odd_edges(lod).collect();
        let is_new = |edge: &[u32; 2]| !edge.iter().all(|v| self.has(&lod.positions[*v as usize]));
        let opened = odd.iter().filter(|(edge, _)| is_new(edge));
        let mut leaks: Vec<Leak> = opened.map(|&(edge, faces)| Leak::Edge { edge, faces }).collect();
        let own = Outline::of(odd.iter().map(|(edge, _)| edge.map(|v| lod.positions[v as usize])));
        for crack in self.cracks(lod) {
            match crack {
                Crack::TJunction { vertex, edge } if !self.is_old(&crack, lod, &own) => {
                    leaks.push(Leak::TJunction { vertex, edge });
                }
                // An edge of one face is an odd edge, so this adds one only where the two checkers disagree.
                Crack::Opened { edge: [a, b] } => {
                    let known = Leak::Edge { edge: [a.min(b), a.max(b)], faces: 1 };
                    if !leaks.contains(&known) {
                        leaks.push(known);
                    }
                }
                Crack::TJunction { .. } => {}
            }
        }
        leaks
    }
}

/// The edges of an odd number of faces of a mesh, to be searched.
struct Outline {
    /// A sliver along each edge: a mesh with the same boundary, and nothing else to look at.
    slivers: TriMesh,
    bvh: Bvh,
}

impl Outline {
    fn of(edges: impl Iterator<Item = [[f32; 3]; 2]>) -> Self {
        let mut slivers = TriMesh::default();
        for [a, b] in edges {
            let first = slivers.positions.len() as u32;
            slivers.positions.extend([a, b, a]);
            slivers.triangles.push([first, first + 1, first + 2]);
        }
        let bvh = Bvh::new(&slivers.positions, &slivers.triangles);
        Outline { slivers, bvh }
    }

    /// How many ways lead from a point along edges that come within `reach`: one for an edge that ends within `at_end`, two for
    /// one that passes.
    fn ways(&self, point: Point3<f64>, reach: f64, at_end: f64) -> usize {
        let mut ways = 0;
        self.bvh.for_each_near(point, reach, &mut |id| {
            let corners = self.slivers.corners(self.slivers.triangles[id as usize]);
            if squared_distance(point, corners) <= reach * reach {
                let ends = corners[..2].iter().any(|end| (to_f64(*end) - point).norm() <= at_end);
                ways += if ends { 1 } else { 2 };
            }
        });
        ways
    }
}

/// A place that is wrong; vertices are the level of detail's.
#[derive(PartialEq, Debug)]
enum Leak {
    Edge { edge: [u32; 2], faces: usize },
    TJunction { vertex: u32, edge: [u32; 2] },
}

impl Leak {
    fn tell(&self, lod: &TriMesh, origin: [f64; 3]) -> String {
        let at = |v: u32| -> [f64; 3] {
            let p = lod.positions[v as usize];
            std::array::from_fn(|axis| origin[axis] + f64::from(p[axis]))
        };
        match *self {
            Leak::Edge { edge: [a, b], faces } => {
                let noun = if faces == 1 { "face" } else { "faces" };
                let (a, b) = (at(a), at(b));
                format!("the edge from {a:?} to {b:?} has {faces} {noun}, and the source is closed there")
            }
            Leak::TJunction { vertex, edge: [a, b] } => {
                format!("the vertex at {:?} lies inside the edge from {:?} to {:?}", at(vertex), at(a), at(b))
            }
        }
    }
}

/// Edges of an odd number of faces, with that number, by ascending vertices.
fn odd_edges(mesh: &TriMesh) -> impl Iterator<Item = ([u32; 2], usize)> {
    let sides = |[a, b, c]: &[u32; 3]| [[*a, *b], [*b, *c], [*c, *a]].map(|[u, v]| [u.min(v), u.max(v)]);
    let mut edges: Vec<[u32; 2]> = mesh.triangles.iter().flat_map(sides).collect();
    edges.sort_unstable();
    let counted: Vec<_> = edges.chunk_by(|a, b| a == b).map(|same| (same[0], same.len())).collect();
    counted.into_iter().filter(|(_, faces)| faces % 2 == 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_mesh::synth::{Shape, Synth, hand};

    #[test]
    fn a_mesh_leaks_nowhere_against_itself() {
        for mesh in [
            hand::cube(),
            hand::grid(4, 3),
            hand::edge_fan(5),
            hand::moebius(9),
            hand::soup(4),
            Synth::new(Shape::Plates, 3000, 2).to_mesh(),
        ] {
            assert_eq!(Border::of(&mesh).leaks(&mesh), []);
        }
    }

    #[test]
    fn a_missing_triangle_leaks_at_its_three_sides() {
        let source = hand::icosphere(2);
        let mut lod = source.clone();
        let [a, b, c] = lod.triangles.remove(77);
        let leaks = Border::of(&source).leaks(&lod);
        let mut sides = [[a, b], [b, c], [c, a]].map(|[u, v]| [u.min(v), u.max(v)]);
        sides.sort_unstable();
        assert_eq!(leaks, sides.map(|edge| Leak::Edge { edge, faces: 1 }));
        let [[u, v], ..] = sides;
        let [p, q] = [u, v].map(|v| source.positions[v as usize].map(f64::from));
        let told = leaks[0].tell(&lod, [0.0; 3]);
        assert_eq!(told, format!("the edge from {p:?} to {q:?} has 1 face, and the source is closed there"));
    }

    #[test]
    fn a_third_face_leaks_and_a_fourth_mends_it() {
        let source = hand::cube();
        let mut lod = source.clone();
        let [a, b, c] = lod.triangles[3];
        lod.triangles.push([a, b, c]);
        assert_eq!(Border::of(&source).leaks(&lod).len(), 3);
        lod.triangles.push([a, b, c]);
        assert_eq!(Border::of(&source).leaks(&lod), []);
    }

    #[test]
    fn a_vertex_inside_an_open_edge_leaks_unless_the_source_has_it() {
        let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0]];
        let apart = TriMesh::new(positions.clone(), vec![[0, 3, 1], [1, 3, 2], [0, 2, 4]]);
        // All ends of the edges that are open above are on its border, so that only the vertex is left to be found.
        let source = TriMesh::new(positions, vec![[0, 3, 1], [1, 3, 2], [0, 1, 4]]);
        let leaks = Border::of(&source).leaks(&apart);
        assert_eq!(leaks, [Leak::TJunction { vertex: 1, edge: [0, 2] }]);
        assert!(leaks[0].tell(&apart, [10.0, 0.0, 0.0]).contains("[11.0, 0.0, 0.0] lies inside"));
        assert_eq!(Border::of(&apart).leaks(&apart), []);
    }

    #[test]
    fn a_border_that_meets_itself_is_open_there_anyway() {
        let corners = [[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0]];
        let lod = TriMesh::new(corners.to_vec(), vec![[0, 3, 1], [1, 3, 2], [0, 2, 4]]);
        // Two sheets that share no vertex: one has 0.0 where the other has -0.0.
        let mut positions = corners.to_vec();
        positions.extend([[-0.0; 3], [1.0, -0.0, 0.0], [2.0, -0.0, -0.0]]);
        let sheets = TriMesh::new(positions, vec![[0, 3, 1], [1, 3, 2], [5, 6, 4], [6, 7, 4]]);
        assert_eq!(Border::of(&sheets).leaks(&lod), []);
        // Another edge past the place, or another vertex there, is one too many: nothing in the source was like that.
        for more in [[0, 2, 3], [1, 3, 4]] {
            let mut crowded = lod.clone();
            let first = crowded.positions.len() as u32;
            crowded.positions.extend(more.map(|v| corners[v]));
            crowded.triangles.push([first, first + 1, first + 2]);
            let leaks = Border::of(&sheets).leaks(&crowded);
            assert!(leaks.contains(&Leak::TJunction { vertex: 1, edge: [0, 2] }), "{leaks:?}");
        }
        // One sheet, with a vertex where four edges of the border end.
        let tied = TriMesh::new(corners.to_vec(), vec![[0, 3, 1], [1, 2, 4]]);
        let lod = TriMesh::new(corners.to_vec(), vec![[0, 3, 2], [1, 2, 4]]);
        assert_eq!(Border::of(&tied).leaks(&lod), []);
    }
}
