//! What is left of components that have vanished: the points, and the lines, that their triangles were contracted to.
//!
//! Half-edge collapses take the corners of a triangle along chains of targets. When these end in fewer than three
//! vertices the triangle is gone, and what it was lies at the ends: usually on a vertex or an edge of triangles that are still
//! there, and then it is part of the surface. Where no triangle is left, as when a component vanishes, it is a
//! leftover. The merge that makes a parent drops vertices that no base triangle uses, so a leftover never moves
//! again, and the error that its cluster had when it came about holds for it in every coarser mesh.

use chpm_format::{Chpm, Page};
use chpm_measure::box_tree::BoxTree;
use chpm_mesh::{Aabb, ClusterId, ProgressiveMesh};
use chpm_refine::Member;
use nalgebra::Point3;

/// Two ends, which are equal for a point, and the stored error of the mesh that left it.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Leftover {
    ends: [[f32; 3]; 2],
    error: f32,
}

impl Leftover {
    /// The leftovers of a page's mesh of `n` vertices, apart from what its children have left.
    pub(super) fn of_page(page: &Page<'_>, n: usize) -> Vec<Leftover> {
        let error = page.error_at(n);
        let place = |v: u16| page.positions[usize::from(v)];
        let left = left_at(&page.progressive_mesh(), n);
        left.into_iter().map(|[a, b]| Leftover { ends: [place(a), place(b)], error }).collect()
    }
}

/// Ends of the leftovers of a mesh of `n` vertices, ascending.
fn left_at(mesh: &ProgressiveMesh<'_>, n: usize) -> Vec<[u16; 2]> {
    let mut ends: Vec<u16> = (0..n as u16).collect();
    for vertex in n..mesh.vertex_count {
        ends.push(ends[usize::from(mesh.targets[vertex - mesh.base_vertex_count])]);
    }
    let mut used = vec![false; n];
    let (mut edges, mut dead) = (Vec::new(), Vec::new());
    for corners in mesh.triangles {
        let [a, b, c] = corners.map(|v| ends[usize::from(v)]);
        if a != b && b != c && c != a {
            [a, b, c].into_iter().for_each(|v| used[usize::from(v)] = true);
            edges.extend([[a, b], [b, c], [c, a]].map(|[u, v]| [u.min(v), u.max(v)]));
        } else {
            dead.push([a.min(b).min(c), a.max(b).max(c)]);
        }
    }
    dead.sort_unstable();
    dead.dedup();
    edges.sort_unstable();
    dead.retain(|end| {
        let on_vertex = end[0] == end[1] && used[usize::from(end[0])];
        !on_vertex && edges.binary_search(end).is_err()
    });
    // A point that a line ends in says nothing more.
    let mut line_ends: Vec<u16> = dead.iter().filter(|[a, b]| a != b).flatten().copied().collect();
    line_ends.sort_unstable();
    dead.retain(|[a, b]| a != b || line_ends.binary_search(a).is_err());
    dead
}

/// The leftovers of a cut, to be searched.
pub(super) struct Leftovers {
    /// In the order of the tree's leaves.
    all: Vec<Leftover>,
    tree: BoxTree,
    slack: f64,
}

impl Leftovers {
    /// Gathers what the members have left at their positions, and every cluster below them at its base mesh; `base` has the
    /// latter by cluster. Each reaches as far as its own error and `slack`.
    pub(super) fn of_cut<D: AsRef<[u8]>>(
        file: &Chpm<D>,
        members: &[Member],
        base: &[Vec<Leftover>],
        slack: f64,
    ) -> Result<Self, chpm_format::FormatError> {
        let mut all = Vec::new();
        for member in members {
            all.extend(Leftover::of_page(&file.page(member.cluster)?, member.vertices as usize));
        }
        let below = below(file, members);
        all.extend(below.iter().zip(base).filter(|(below, _)| **below).flat_map(|(_, left)| left));
        Ok(Self::new(all, slack))
    }

    fn new(mut all: Vec<Leftover>, slack: f64) -> Self {
        // What is left at one place counts once, with the largest error.
        let key = |left: &Leftover| left.ends.map(|end| end.map(f32::to_bits));
        all.sort_unstable_by(|a, b| key(a).cmp(&key(b)).then(b.error.total_cmp(&a.error)));
        all.dedup_by(|later, first| key(later) == key(first));
        let boxes: Vec<Aabb> = all.iter().map(|left| Aabb::of_points(&left.ends)).collect();
        let tree = BoxTree::reaching(&boxes, |i| f64::from(all[i].error) + slack);
        let all = tree.order().iter().map(|&i| all[i as usize]).collect();
        Leftovers { all, tree, slack }
    }

    /// Points and lines.
    pub(super) fn count(&self) -> usize {
        self.all.len()
    }

    /// Distance to the nearest leftover that reaches `point`: is no farther than its own error and the slack.
    pub(super) fn reach(&self, point: Point3<f64>) -> Option<f64> {
        let mut nearest = f64::INFINITY;
        self.tree.search(point, &mut nearest, |place, nearest| {
            let Leftover { ends: [a, b], error } = self.all[place];
            let squared = chpm_measure::bvh::squared_distance(point, [a, b, b]);
            if squared < *nearest && squared.sqrt() <= f64::from(error) + self.slack {
                *nearest = squared;
            }
        });
        nearest.is_finite().then(|| nearest.sqrt())
    }
}

/// Which clusters a cut's members replace, whole groups at a time.
fn below<D: AsRef<[u8]>>(file: &Chpm<D>, members: &[Member]) -> Vec<bool> {
    let mut below = vec![false; file.clusters().len()];
    let mut seen = vec![false; file.groups().len()];
    let mut stack: Vec<ClusterId> = members.iter().map(|m| m.cluster).collect();
    while let Some(cluster) = stack.pop() {
        let group = file.clusters()[cluster.index()].group();
        if !std::mem::replace(&mut seen[group.index()], true) {
            for fine in file.fine(group) {
                below[*fine as usize] = true;
                stack.push(ClusterId(*fine));
            }
        }
    }
    below
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_collapses_onto_the_surface_leaves_nothing() {
        // A square fan about vertex 4, which goes to 0; then 3 does.
        let fan = ProgressiveMesh {
            vertex_count: 5,
            base_vertex_count: 3,
            triangles: &[[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]],
            targets: &[0, 0],
        };
        for n in 3..=5 {
            assert!(left_at(&fan, n).is_empty(), "at {n} vertices");
        }
    }

    #[test]
    fn a_component_leaves_a_line_and_then_a_point() {
        // A triangle that stays, and a tetrahedron of vertices 3 to 6, which falls flat, then to a line, then to a point.
        let mesh = ProgressiveMesh {
            vertex_count: 7,
            base_vertex_count: 4,
            triangles: &[[0, 1, 2], [3, 4, 5], [3, 5, 6], [3, 6, 4], [4, 6, 5]],
            targets: &[3, 3, 4],
        };
        assert_eq!(left_at(&mesh, 7), [] as [[u16; 2]; 0]);
        // [3, 4, 5] and [3, 5, 4] are still there.
        assert_eq!(left_at(&mesh, 6), [] as [[u16; 2]; 0]);
        assert_eq!(left_at(&mesh, 5), [[3, 4]]);
        assert_eq!(left_at(&mesh, 4), [[3, 3]]);
    }

    #[test]
    fn a_leftover_reaches_as_far_as_its_error() {
        let line = Leftover { ends: [[0.0; 3], [4.0, 0.0, 0.0]], error: 1.0 };
        let point = Leftover { ends: [[0.0, 5.0, 0.0]; 2], error: 3.0 };
        let nearer = Leftover { error: 0.1, ..line };
        let of = |slack| Leftovers::new(vec![nearer, line, point], slack);
        assert_eq!(of(0.0).count(), 2, "what lies at one place is one");
        for (at, expected) in [
            ([2.0, 1.0, 0.0], Some(1.0)),
            ([2.0, 1.5, 0.0], None),
            ([0.0, 2.5, 0.0], Some(2.5)),
            ([0.0, 0.5, 0.0], Some(0.5)),
            ([5.5, 0.0, 0.0], None),
        ] {
            assert_eq!(of(0.0).reach(at.into()), expected, "{at:?}");
        }
        assert_eq!(of(0.5).reach([5.5, 0.0, 0.0].into()), Some(1.5));
        assert_eq!(Leftovers::new(Vec::new(), 1.0).reach([0.0; 3].into()), None);
    }
}
