//! The vertex hierarchy and its active front: Hoppe's view-dependent progressive mesh (1997, sections 3 and 4; 1998), for half-edge collapses.

use crate::fan::{Faces, NONE};
use crate::simplify::{Collapse, simplify};
use chpm_mesh::{TriMesh, geom};

/// The next split of a vertex that is not in the mesh.
const UNBORN: u32 = NONE - 1;

/// A vertex split: `kept` stays and a new vertex comes, which is the one behind the base vertices by the split's index.
/// Coarser splits have smaller indices, and so have the vertices and faces that they bring.
#[derive(Clone, Copy, Debug)]
struct Split {
    kept: u32,
    /// The splits that the two vertices can undergo afterwards.
    next: [u32; 2],
    /// The split that makes the vertex what this one splits.
    parent: u32,
    /// The faces that it brings.
    faces: [u32; 2],
    /// The faces that must be there: Hoppe's fn0 to fn3.
    outer: [u32; 4],
    /// Never less than those of the splits below.
    error: f32,
    /// A sphere about `kept` that holds everything below.
    radius: f32,
}

/// All splits of a mesh, and its base mesh.
pub(crate) struct Hierarchy {
    splits: Vec<Split>,
    /// By face: the split that brings it.
    makers: Vec<u32>,
    positions: Vec<[f32; 3]>,
    base: Mesh,
    /// By vertex: its number in the source.
    sources: Vec<u32>,
}

/// A selectively refined mesh.
#[derive(Clone, Default)]
pub(crate) struct Mesh {
    faces: Faces,
    /// By vertex: the split that it can undergo.
    next: Vec<u32>,
    /// The vertices that are there.
    front: Vec<u32>,
    stack: Vec<u32>,
}

/// What a refinement did.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Tally {
    /// Vertices whose error was held against the view.
    pub(crate) questions: u64,
    /// Faces that were looked up because a split depends on them.
    pub(crate) checks: u64,
    /// Vertex splits.
    pub(crate) splits: u64,
    /// Of these, splits that others had to wait for.
    pub(crate) forced: u64,
}

impl Hierarchy {
    /// Collapses a mesh as far as it goes.
    pub(crate) fn new(mesh: &TriMesh) -> anyhow::Result<Self> {
        let (collapses, rest) = simplify(mesh)?;
        let count = collapses.len();
        let sources = vertex_order(mesh, &collapses);
        let vertices = numbers(&sources, mesh.positions.len());
        let base_faces = (0..mesh.triangles.len() as u32).filter(|face| rest.is_active(*face));
        let mut order: Vec<u32> = base_faces.collect();
        let mut makers = vec![NONE; order.len()];
        for (index, collapse) in (0..).zip(collapses.iter().rev()) {
            let brought = collapse.faces.into_iter().filter(|face| *face != NONE);
            order.extend(brought);
            makers.resize(order.len(), index);
        }
        let faces = numbers(&order, mesh.triangles.len());
        let face = |f: u32| if f == NONE { NONE } else { faces[f as usize] };

        let mut splits: Vec<Split> = Vec::with_capacity(count);
        let mut latest = vec![NONE; mesh.positions.len()];
        for (index, collapse) in (0..count as u32).rev().zip(&collapses) {
            let ends = [collapse.kept, collapse.removed];
            let next = ends.map(|v| latest[v as usize]);
            let [p, q] = ends.map(|v| mesh.positions[v as usize]);
            let (mut error, mut radius) = (collapse.error, geom::distance(p, q));
            for (below, away) in next.into_iter().zip([0.0, radius]).filter(|(below, _)| *below != NONE) {
                // Finer splits come first here.
                let below = &mut splits[count - 1 - below as usize];
                below.parent = index;
                error = error.max(below.error);
                radius = radius.max(away + f64::from(below.radius));
            }
            latest[collapse.kept as usize] = index;
            splits.push(Split {
                kept: vertices[collapse.kept as usize],
                next,
                parent: NONE,
                faces: collapse.faces.map(face),
                outer: collapse.outer.map(face),
                error,
                radius: geom::round_up(radius),
            });
        }
        splits.reverse();

        let renumbered =
            |f: &u32| rest.corners[*f as usize].map(|v| if v == NONE { v } else { vertices[v as usize] });
        let corners = order.iter().map(renumbered).collect();
        let is_base = |f: u32| f != NONE && rest.is_active(f);
        let beside = |f: &u32| match is_base(*f) {
            true => rest.across[*f as usize].map(face),
            false => [NONE; 3],
        };
        let across = order.iter().map(beside).collect();
        let base_count = (mesh.positions.len() - count) as u32;
        let mut next: Vec<u32> = sources[..base_count as usize].iter().map(|v| latest[*v as usize]).collect();
        next.resize(sources.len(), UNBORN);
        Ok(Hierarchy {
            splits,
            makers,
            positions: sources.iter().map(|v| mesh.positions[*v as usize]).collect(),
            base: Mesh {
                faces: Faces { corners, across },
                next,
                front: (0..base_count).collect(),
                stack: Vec::new(),
            },
            sources,
        })
    }

    /// The base mesh, with room for all that can come.
    pub(crate) fn base(&self) -> Mesh {
        let mut base = self.base.clone();
        base.front.reserve_exact(self.splits.len());
        base
    }

    /// Goes over the front once and splits every vertex as long as `wants` asks for it, by its position, and the error and
    /// radius of the split. Vertices that come are asked in turn.
    pub(crate) fn refine(&self, mesh: &mut Mesh, wants: impl Fn([f32; 3], f32, f32) -> bool) -> Tally {
        let mut tally = Tally::default();
        let mut place = 0;
        while let Some(&vertex) = mesh.front.get(place) {
            place += 1;
            while let Some(split) = self.splits.get(mesh.next[vertex as usize] as usize) {
                tally.questions += 1;
                if !wants(self.positions[vertex as usize], split.error, split.radius) {
                    break;
                }
                self.force(mesh, mesh.next[vertex as usize], &mut tally);
            }
        }
        tally
    }

    /// Applies a split after all that it depends on (Hoppe 1997, force_vsplit).
    fn force(&self, mesh: &mut Mesh, wanted: u32, tally: &mut Tally) {
        let mut stack = std::mem::take(&mut mesh.stack);
        stack.push(wanted);
        while let Some(&index) = stack.last() {
            let split = &self.splits[index as usize];
            let brings = self.base_count() + index;
            if mesh.next[brings as usize] != UNBORN {
                stack.pop();
            } else if mesh.next[split.kept as usize] != index {
                stack.push(split.parent);
            } else if let Some(face) = mesh.missing(&split.outer, &mut tally.checks) {
                stack.push(self.makers[face as usize]);
            } else {
                stack.pop();
                mesh.split(split, brings);
                tally.splits += 1;
                tally.forced += u64::from(index != wanted);
            }
        }
        mesh.stack = stack;
    }

    fn base_count(&self) -> u32 {
        self.base.front.len() as u32
    }

    /// The triangles of a mesh in the source's vertices, in an order that depends on the set of triangles alone.
    pub(crate) fn triangles(&self, mesh: &Mesh) -> Vec<[u32; 3]> {
        let there = mesh.faces.corners.iter().filter(|corners| corners[0] != NONE);
        canonical(there.map(|corners| corners.map(|v| self.sources[v as usize])))
    }
}

/// Triangles with their least corner first, sorted.
pub(crate) fn canonical(triangles: impl Iterator<Item = [u32; 3]>) -> Vec<[u32; 3]> {
    let turned =
        |[a, b, c]: [u32; 3]| [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap_or_default();
    let mut triangles: Vec<_> = triangles.map(turned).collect();
    triangles.sort_unstable();
    triangles
}

/// What survives, then what collapsed, the last first.
fn vertex_order(mesh: &TriMesh, collapses: &[Collapse]) -> Vec<u32> {
    let mut stays = vec![true; mesh.positions.len()];
    collapses.iter().for_each(|collapse| stays[collapse.removed as usize] = false);
    let base = (0..).zip(&stays).filter(|(_, stays)| **stays).map(|(v, _)| v);
    base.chain(collapses.iter().rev().map(|collapse| collapse.removed)).collect()
}

/// The place of everything in an order.
fn numbers(order: &[u32], count: usize) -> Vec<u32> {
    let mut numbers = vec![NONE; count];
    (0..).zip(order).for_each(|(place, item)| numbers[*item as usize] = place);
    numbers
}

impl Mesh {
    /// The first face that is not there.
    fn missing(&self, faces: &[u32; 4], checks: &mut u64) -> Option<u32> {
        faces.iter().copied().filter(|face| *face != NONE).find(|face| {
            *checks += 1;
            !self.faces.is_active(*face)
        })
    }

    fn split(&mut self, split: &Split, brings: u32) {
        let kept = split.kept;
        let [one, other] = split.faces;
        let [one_kept, one_brought, other_kept, other_brought] = split.outer;
        let next = |f: u32, by: usize| (f != NONE).then(|| (self.faces.corner(f, kept) + by) % 3);
        // Edges of the four that face each other until now, and the corners behind them.
        let sides = [next(one_kept, 2), next(one_brought, 0), next(other_kept, 0), next(other_brought, 2)];
        let ahead = |f: u32, edge: Option<usize>, by: usize| {
            edge.map(|edge| self.faces.corners[f as usize][(edge + by) % 3])
        };
        let one_apex = ahead(one_kept, sides[0], 0).or(ahead(one_brought, sides[1], 1));
        let other_apex = ahead(other_kept, sides[2], 1).or(ahead(other_brought, sides[3], 0));

        self.hand_over(
            kept,
            brings,
            if one == NONE { NONE } else { one_brought },
            other_brought,
            other == NONE,
        );
        for ((face, edge), new) in split.outer.into_iter().zip(sides).zip([one, one, other, other]) {
            if let Some(edge) = edge {
                self.faces.join(face, edge, new);
            }
        }
        if let Some(apex) = one_apex {
            self.faces.corners[one as usize] = [brings, kept, apex];
            self.faces.across[one as usize] = [other, one_kept, one_brought];
        }
        if let Some(apex) = other_apex {
            self.faces.corners[other as usize] = [brings, apex, kept];
            self.faces.across[other as usize] = [other_brought, other_kept, one];
        }
        self.next[kept as usize] = split.next[0];
        self.next[brings as usize] = split.next[1];
        self.front.push(brings);
    }

    /// Gives the faces from `first` to `last` about `kept` to the new vertex; along a boundary one end is open.
    fn hand_over(&mut self, kept: u32, brings: u32, first: u32, last: u32, open: bool) {
        let (mut face, end, backward) = if first == NONE { (last, NONE, true) } else { (first, last, false) };
        while face != NONE {
            let after = if backward { self.faces.cw(face, kept) } else { self.faces.ccw(face, kept) };
            let corner = self.faces.corner(face, kept);
            self.faces.corners[face as usize][corner] = brings;
            if face == end {
                return;
            }
            face = after;
        }
        assert!(backward || open, "the faces about {kept} end before {last}");
    }

    /// Number of faces that are there.
    pub(crate) fn triangle_count(&self) -> u64 {
        self.faces.corners.iter().filter(|corners| corners[0] != NONE).count() as u64
    }
}
