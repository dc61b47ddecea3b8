//! Nearest distance from a point to a set of triangles, exact up to rounding.

use crate::box_tree::BoxTree;
use crate::parting::Parting;
use crate::proof::{Corners, Face};
use crate::shell::Shell;
use chpm_mesh::{Aabb, geom};
use nalgebra::{Point3, Vector3};

/// A hierarchy of boxes over triangles, with its own copy of their corners.
///
/// ```
/// use chpm_measure::Bvh;
///
/// let cube = chpm_synth::hand::cube();
/// let bvh = Bvh::new(&cube.positions, &cube.triangles);
/// assert_eq!(bvh.distance([0.5, 0.5, 3.0].into()), 2.0);
/// ```
#[derive(Clone, Debug)]
pub struct Bvh {
    tree: BoxTree,
    /// Corners, in the order of the leaves.
    corners: Vec<[[f32; 3]; 3]>,
    /// Of each, where searches come to many triangles for one that is nearest; else none.
    shells: Vec<Shell>,
}

/// The nearest triangle that a search has found.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Nearest {
    /// Distance; infinite where the set is empty or the point is not a number.
    pub distance: f64,
    /// Place of the triangle in the leaves: a hint for a nearby search.
    pub(crate) place: usize,
}

impl Bvh {
    /// Builds over `triangles`; those with the same three corners are one.
    ///
    /// # Panics
    /// If a triangle names a vertex that is not there.
    pub fn new(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Self {
        let different = different(triangles.iter().map(|t| t.map(|v| positions[v as usize])).collect());
        let tree = BoxTree::of_triangles(&different);
        let corners = tree.order().iter().map(|&i| different[i as usize]).collect();
        let mut bvh = Bvh { tree, corners, shells: Vec::new() };
        if bvh.is_crowded() {
            bvh.shells = bvh.corners.iter().copied().map(Shell::new).collect();
        }
        bvh
    }

    /// Whether searches come to many triangles in vain, as tried from points near some of them.
    fn is_crowded(&self) -> bool {
        let mut bounds = Aabb::EMPTY;
        self.corners.iter().flatten().for_each(|corner| bounds.add(*corner));
        let away = bounds.diagonal() / AWAY;
        let mut visits = 0;
        for [a, b, c] in self.corners.iter().step_by(self.corners.len() / TRIALS + 1) {
            let [a, b, c] = [geom::to_f64(*a), geom::to_f64(*b), geom::to_f64(*c)];
            let up = (b - a).cross(&(c - b)).try_normalize(f64::MIN_POSITIVE).unwrap_or_default();
            let (point, mut best) = (a + (b - a + (c - a)) / 3.0 + up * away, f64::INFINITY);
            self.tree.search(point, &mut best, |place, best| {
                visits += 1;
                *best = best.min(squared_distance(point, self.corners[place]));
            });
        }
        visits > CROWD * TRIALS
    }

    /// Bytes that one of so many triangles takes at most, unless these are a handful.
    pub(crate) fn bytes(triangles: u64) -> u64 {
        BYTES * triangles
    }

    /// Bytes of memory.
    pub fn len_bytes(&self) -> usize {
        self.tree.len_bytes() + size_of_val(&self.corners[..]) + size_of_val(&self.shells[..])
    }

    /// Separation of the two halves where their boxes overlap.
    pub(crate) fn halves(&self) -> Option<Parting> {
        self.tree.halves()
    }

    /// Distance from `point` to the nearest triangle; infinite where there is none.
    pub fn distance(&self, point: Point3<f64>) -> f64 {
        self.nearest(point, None).distance
    }

    /// The nearest triangle. A `hint` from a nearby point changes the time only.
    pub fn nearest(&self, point: Point3<f64>, hint: Option<Nearest>) -> Nearest {
        let hint = hint.map(|hint| hint.place).filter(|place| *place < self.corners.len());
        let mut best = hint.map_or(f64::INFINITY, |place| self.squared_distance(place, point));
        let place = self.improve(point, &mut best).or(hint).unwrap_or(0);
        Nearest { distance: best.sqrt(), place }
    }

    /// Corners of what was nearest, in the order in which they came; none where nothing was.
    pub fn corners_of(&self, nearest: &Nearest) -> Option<[[f32; 3]; 3]> {
        self.corners.get(nearest.place).copied().filter(|_| nearest.distance.is_finite())
    }

    /// Distance of what was nearest to another point; infinite where nothing was.
    pub(crate) fn distance_of(&self, nearest: Nearest, point: Point3<f64>) -> f64 {
        let corners = self.corners.get(nearest.place);
        corners.map_or(f64::INFINITY, |corners| squared_distance(point, *corners).sqrt())
    }

    /// Lowers `best`, a squared distance, to what the triangles are away at least, with rounding on the safe side.
    pub(crate) fn lower_bound(&self, point: Point3<f64>, best: &mut f64) {
        self.tree.search(point, best, |place, best| {
            if !self.is_farther(place, point, *best) {
                *best = best.min(Face::new(self.corners[place]).lower_bound(point).powi(2));
            }
        });
    }

    /// Whether it is known of a triangle without looking closer that it is no nearer than the root of `best`.
    #[inline]
    fn is_farther(&self, place: usize, point: Point3<f64>, best: f64) -> bool {
        let Some(shell) = self.shells.get(place) else { return false };
        shell.squared_distance_at_least(point, self.corners[place][0]) >= best
    }

    /// The triangle at a place.
    pub(crate) fn corners(&self, place: usize) -> Corners {
        self.corners[place]
    }

    /// Squared distance of the triangle at a place.
    pub(crate) fn squared_distance(&self, place: usize, point: Point3<f64>) -> f64 {
        squared_distance(point, self.corners[place])
    }

    /// Lowers `best`, a squared distance, to that of the nearest triangle, and answers its place; none if no triangle is nearer.
    pub(crate) fn improve(&self, point: Point3<f64>, best: &mut f64) -> Option<usize> {
        let mut found = None;
        // What is on the surface up to rounding is on it: nothing nearer is looked for among triangles that all come there.
        let rounding = (ROUNDING * point.coords.amax()).powi(2);
        if *best <= rounding {
            *best = 0.0;
        }
        self.tree.search(point, best, |place, best| {
            if self.is_farther(place, point, *best) {
                return;
            }
            let d = squared_distance(point, self.corners[place]);
            if d < *best {
                *best = if d <= rounding { 0.0 } else { d };
                found = Some(place);
            }
        });
        found
    }
}

/// Bytes of a triangle at most: corners, place, shell, and its share of nodes.
const BYTES: u64 = 256;

/// Searches that are tried, from points off some triangles by this part of the diagonal; if they come to more triangles than a crowd each, there are too many.
const TRIALS: usize = 16;
const AWAY: f64 = 64.0;
const CROWD: usize = 32;

/// Distances below this share of a point's largest coordinate are taken for none; 32 times what f64 rounds it by.
const ROUNDING: f64 = 32.0 * f64::EPSILON;

/// Each triangle once, whatever the order of its corners.
fn different(mut triangles: Vec<[[f32; 3]; 3]>) -> Vec<[[f32; 3]; 3]> {
    let mut order: Vec<(u64, u32)> = triangles.iter().map(sum).zip(0..).collect();
    order.sort_unstable();
    let mut twin = Vec::new();
    for same in order.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() > 1) {
        let mut keys: Vec<_> = same.iter().map(|(_, i)| (key(&triangles[*i as usize]), *i)).collect();
        keys.sort_unstable();
        twin.extend(keys.windows(2).filter(|pair| pair[0].0 == pair[1].0).map(|pair| pair[1].1));
    }
    if !twin.is_empty() {
        let mut is_twin = vec![false; triangles.len()];
        twin.iter().for_each(|i| is_twin[*i as usize] = true);
        let mut is_twin = is_twin.into_iter();
        triangles.retain(|_| !is_twin.next().unwrap_or(false));
    }
    triangles
}

fn key(corners: &[[f32; 3]; 3]) -> [[u32; 3]; 3] {
    let mut bits = corners.map(|corner| corner.map(f32::to_bits));
    bits.sort_unstable();
    bits
}

/// Equal triangles have equal sums, which are quicker to sort than triangles; those of few others are equal.
fn sum(corners: &[[f32; 3]; 3]) -> u64 {
    let mixed = corners.map(|corner| {
        fn word(hash: u64, x: f32) -> u64 {
            (hash ^ u64::from(x.to_bits())).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29)
        }
        corner.into_iter().fold(0, word)
    });
    mixed.into_iter().fold(0, u64::wrapping_add)
}

/// Squared distance from a point to a triangle, which may have no area.
///
/// The nearest point is in the plane where the foot of the perpendicular is inside all three edges, and on an edge
/// otherwise; edges alone are right for a triangle without area. The plane is taken from the two shortest edges, which for
/// needles is as good as for any triangle; for a flat cap it is off by its aspect ratio times the rounding of f64.
pub fn squared_distance(point: Point3<f64>, corners: [[f32; 3]; 3]) -> f64 {
    let [a, b, c] = [geom::to_f64(corners[0]), geom::to_f64(corners[1]), geom::to_f64(corners[2])];
    let (ab, bc, ca) = ((b - a).norm_squared(), (c - b).norm_squared(), (a - c).norm_squared());
    // The corner between the two shortest edges comes first.
    if ab >= bc && ab >= ca {
        squared_distance_by_plane(point, [c, a, b])
    } else if ca >= bc {
        squared_distance_by_plane(point, [b, c, a])
    } else {
        squared_distance_by_plane(point, [a, b, c])
    }
}

/// As [`squared_distance`], the plane taken from the edges at the first corner.
#[inline]
fn squared_distance_by_plane(point: Point3<f64>, [a, b, c]: [Point3<f64>; 3]) -> f64 {
    let (ab, bc, ca) = (b - a, c - b, a - c);
    let normal = ca.cross(&ab);
    let area_squared = normal.norm_squared();
    let inside = |from: &Point3<f64>, along: &Vector3<f64>| along.cross(&(point - from)).dot(&normal) >= 0.0;
    if area_squared > 0.0 && inside(&a, &ab) && inside(&b, &bc) && inside(&c, &ca) {
        let height = normal.dot(&(point - a));
        return height * height / area_squared;
    }
    let segment = squared_distance_to_segment;
    segment(point, a, ab).min(segment(point, b, bc)).min(segment(point, c, ca))
}

#[inline]
fn squared_distance_to_segment(point: Point3<f64>, a: Point3<f64>, along: Vector3<f64>) -> f64 {
    let away = point - a;
    let (reach, length_squared) = (along.dot(&away), along.norm_squared());
    // Also where it has no length.
    if reach <= 0.0 || length_squared <= 0.0 {
        return away.norm_squared();
    }
    if reach >= length_squared {
        return (away - along).norm_squared();
    }
    (point - (a + along * (reach / length_squared))).norm_squared()
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_synth::{Shape, Synth, hand};
    use proptest::prelude::*;

    #[test]
    fn distances_to_one_triangle() {
        let triangle = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0]];
        for (point, expected) in [
            ([1.0, 1.0, 2.0], 4.0),
            ([1.0, 1.0, 0.0], 0.0),
            ([2.0, -1.0, 0.0], 1.0),
            ([-3.0, -4.0, 0.0], 25.0),
            ([6.0, 0.0, 0.0], 4.0),
            ([4.0, 3.0, 0.0], 5.76),
        ] {
            let d = squared_distance(point.into(), triangle);
            assert!((d - expected).abs() < 1e-12, "{point:?}: {d}");
        }
        let needle = [[0.0; 3], [2.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
        assert_eq!(squared_distance([1.5, 2.0, 0.0].into(), needle), 4.0);
        assert_eq!(squared_distance([0.0, 3.0, 4.0].into(), [[0.0; 3]; 3]), 25.0);
        // A needle with its short side anywhere, and a point above it.
        let (a, b, c) = ([0.0, 1e-6, 0.0], [0.0, -1e-6, 0.0], [1.0, 0.0, 0.0]);
        for needle in [[a, b, c], [b, c, a], [c, a, b], [a, c, b]] {
            let d = squared_distance([0.3, 0.0, 2.0].into(), needle);
            assert!((d - 4.0).abs() < 1e-14, "{d}");
        }
    }

    #[test]
    fn an_empty_set_is_infinitely_far() {
        assert_eq!(Bvh::new(&[], &[]).distance(Point3::origin()), f64::INFINITY);
        let cube = hand::cube();
        let bvh = Bvh::new(&cube.positions, &cube.triangles);
        assert_eq!(bvh.distance([f64::NAN, 0.0, 0.0].into()), f64::INFINITY);
        assert_eq!(bvh.distance([0.5, 0.5, 0.4].into()), 0.4);
    }

    #[test]
    fn equal_triangles_do_not_upset_the_build() {
        let mesh = hand::grid(1, 1);
        let many = vec![mesh.triangles[0]; 1000];
        let bvh = Bvh::new(&mesh.positions, &many);
        assert_eq!(bvh.distance([0.5, 0.25, 3.0].into()), 3.0);
        assert_eq!(bvh.corners.len(), 1);
    }

    #[test]
    fn equal_triangles_are_one_whatever_their_corners_order() {
        let [a, b, c] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let all =
            vec![[a, b, c], [b, a, c], [c, a, b], [a, b, b], [b, b, a], [a, a, b], [a, c, [-0.0, 1.0, 1.0]]];
        assert_eq!(different(all), [[a, b, c], [a, b, b], [a, a, b], [a, c, [-0.0, 1.0, 1.0]]]);
    }

    #[test]
    fn a_point_on_many_triangles_asks_few() {
        // All have the origin's neighbourhood in common, and no two are equal.
        let turned = |i: u32| {
            let angle = f64::from(i) * 1e-3;
            let far = |angle: f64| [(100.0 * angle.cos()) as f32, (100.0 * angle.sin()) as f32, 0.3];
            [far(angle), far(angle + 2.0), far(angle + 4.0)]
        };
        let corners: Vec<[[f32; 3]; 3]> = (0..2000).map(turned).collect();
        let triangles: Vec<[u32; 3]> = (0..2000).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let bvh = Bvh::new(corners.as_flattened(), &triangles);
        for point in [[1.0, 2.0, f64::from(0.3_f32)], [-3.0, 0.7, f64::from(0.3_f32)]] {
            let (mut visits, mut best) = (0, f64::INFINITY);
            bvh.tree.search(point.into(), &mut best, |place, best| {
                visits += 1;
                let d = bvh.squared_distance(place, point.into());
                *best = if d.sqrt() <= 3.0 * ROUNDING { 0.0 } else { best.min(d) };
            });
            assert!(best == 0.0 && visits <= 8, "{visits} visits, {best}");
        }
    }

    #[test]
    fn long_triangles_askew_ask_few() {
        let ring = |i: u32, height: f32| {
            let angle = 0.2 + 1.2 * f64::from(i) / 2000.0;
            [angle.cos() as f32, angle.sin() as f32, height]
        };
        let blades: Vec<[[f32; 3]; 3]> =
            (0..2000).map(|i| [[0.0, 0.0, 1.0], ring(i, 0.0), ring(i + 1, 0.0)]).collect();
        let pages: Vec<[[f32; 3]; 3]> =
            (0..2000).map(|i| [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], ring(i, 0.1)]).collect();
        // Two fans of different size on one another, one of them upside down.
        let below = blades[..1900].iter().map(|t| t.map(|[x, y, z]| [x, y, -z]));
        let fans: Vec<[[f32; 3]; 3]> = blades.iter().copied().chain(below).collect();
        for (corners, point) in
            [(blades, [0.4, 0.3, 0.5]), (fans, [0.4, 0.3, -0.5]), (pages, [0.3, 0.2, 0.1])]
        {
            let triangles: Vec<[u32; 3]> =
                (0..corners.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
            let bvh = Bvh::new(corners.as_flattened(), &triangles);
            let (mut visits, mut best) = (0, f64::INFINITY);
            bvh.tree.search(point.into(), &mut best, |place, best| {
                visits += 1;
                *best = best.min(bvh.squared_distance(place, point.into()));
            });
            let all = corners.iter().map(|t| squared_distance(point.into(), *t));
            assert_eq!(best, all.fold(f64::INFINITY, f64::min));
            assert!(visits <= 16, "{visits} visits");
        }
    }

    #[test]
    fn crowds_are_seen_and_answer_as_every_triangle_does() {
        let wave = |x: f32| (0.05 * x).sin();
        // Needles on a bent sheet, and a hundred rough sheets on one another.
        let needle = |i: u32| {
            let end = |i: u32, y: f32| [1e-3 * i as f32, y, wave(i as f32 + 30.0 * y)];
            let [a, b, c, d] = [end(i, 0.0), end(i + 1, 0.0), end(i, 1.0), end(i + 1, 1.0)];
            [[a, b, c], [b, d, c]]
        };
        let needles: Vec<[[f32; 3]; 3]> = (0..500).flat_map(needle).collect();
        let sheet = hand::grid(5, 5);
        let rough = |sheet_at: u32, [x, y, _]: [f32; 3]| {
            [x, y, 1e-3 * sheet_at as f32 + 0.3 * (7.0 * x + 3.0 * y).sin()]
        };
        let sheets: Vec<[[f32; 3]; 3]> = (0..100)
            .flat_map(|at| sheet.triangles.iter().map(move |t| (at, t)))
            .map(|(at, t)| t.map(|v| rough(at, sheet.positions[v as usize])))
            .collect();
        let plain = hand::grid(30, 30);
        let plain = plain.triangles.iter().map(|t| t.map(|v| plain.positions[v as usize])).collect();
        for (corners, is_crowd) in [(needles, true), (sheets, true), (plain, false)] {
            let triangles: Vec<[u32; 3]> =
                (0..corners.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
            let bvh = Bvh::new(corners.as_flattened(), &triangles);
            assert_eq!(bvh.shells.len(), if is_crowd { bvh.corners.len() } else { 0 });
            let mut hint = None;
            for i in 0..200 {
                let i = f64::from(i);
                let point: Point3<f64> = [0.011 * i, 2.0 * (0.3 * i).sin(), 1.5 * (0.17 * i).cos()].into();
                let all = corners.iter().map(|t| squared_distance(point, *t));
                let nearest = bvh.nearest(point, hint);
                assert_eq!(nearest.distance, all.fold(f64::INFINITY, f64::min).sqrt(), "{point:?}");
                hint = Some(nearest);
            }
        }
    }

    proptest! {
        #[test]
        fn agrees_with_looking_at_every_triangle(
            seed in 0u64..1000,
            point in prop::array::uniform3(-0.5f64..1.5),
            other in prop::array::uniform3(-0.5f64..1.5),
        ) {
            let shape = Shape::ALL[seed as usize % 5];
            let mesh = Synth::new(shape, 600, seed).to_mesh();
            let bvh = Bvh::new(&mesh.positions, &mesh.triangles);
            let all = mesh.triangles.iter().map(|t| squared_distance(point.into(), mesh.corners(*t)));
            let least = all.fold(f64::INFINITY, f64::min).sqrt();
            prop_assert!((bvh.distance(point.into()) - least).abs() <= 1e-12);
            let hint = bvh.nearest(other.into(), None);
            let hinted = bvh.nearest(point.into(), Some(hint));
            prop_assert!((hinted.distance - least).abs() <= 1e-12);
        }
    }
}
