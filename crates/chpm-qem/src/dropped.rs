//! Components that vanish apart from everything else: where the points of the source were that nothing stands for any more.
//!
//! The error of a mesh counts such a component at its own size, since that is all that a picture misses. Whoever measures needs more: how
//! far its points are from what is still drawn. So they are kept, as balls, for as long as the hierarchy grows, and the distance to the
//! nearest vertex is found anew for every mesh; nothing adds up.

use crate::displacement::Displacement;
use crate::kd_tree::KdTree;
use bytemuck::{Pod, Zeroable};
use chpm_mesh::geom::{round_up, to_f64};
use nalgebra::{Point3, Vector3};

/// Relative rounding error of a ball's centre, with room.
const LOST: f64 = 1.0 / (1u64 << 50) as f64;

/// A ball about points of the source that have vanished, object units.
#[derive(Clone, Copy, PartialEq, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct DroppedComponent {
    center: [f32; 3],
    radius: f32,
}

/// The last face of a component that vanished.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct LastFace {
    /// The vertex whose collapse took it away.
    pub vertex: u16,
    /// How far its source points and the one triangle that was left are from each other at most, object units; infinite if it was not one.
    pub bound: f32,
}

impl DroppedComponent {
    /// The points that ended at `at`, after displacements in the box.
    pub(crate) fn new(at: Point3<f64>, ended: &Displacement) -> Self {
        let (lo, hi) = ended.reach();
        let (low, high) = (at - hi, at - lo);
        let center = nalgebra::center(&low, &high).coords.map(|x| x as f32);
        let rounded = Point3::from(center.map(f64::from));
        let farthest = (high - rounded).abs().sup(&(low - rounded).abs());
        // Far from zero a small box loses digits in the corners.
        let lost = LOST * low.coords.amax().max(high.coords.amax());
        DroppedComponent { center: center.into(), radius: round_up(farthest.norm() + lost) }
    }

    /// Whether all that is within `beyond` of a point is in it.
    pub(crate) fn holds(&self, point: &Point3<f64>, beyond: f64) -> bool {
        let reach = f64::from(self.radius) - beyond;
        reach >= 0.0 && (point - to_f64(self.center)).norm_squared() <= reach * reach * (1.0 - LOST)
    }

    /// Its centre and its radius.
    pub fn sphere(&self) -> ([f32; 3], f32) {
        (self.center, self.radius)
    }

    /// A ball about two.
    fn around(a: &DroppedComponent, b: &DroppedComponent) -> DroppedComponent {
        let (large, small) = if a.radius < b.radius { (b, a) } else { (a, b) };
        let way: Vector3<f64> = to_f64(small.center) - to_f64(large.center);
        let (length, reach) = (way.norm(), f64::from(large.radius));
        let beyond = length + f64::from(small.radius) - reach;
        if beyond <= 0.0 {
            return *large;
        }
        let center = (to_f64(large.center) + way * (0.5 * beyond / length)).coords.map(|x| x as f32);
        let rounded = Point3::from(center.map(f64::from));
        fn far(ball: &DroppedComponent, rounded: &Point3<f64>) -> f64 {
            (to_f64(ball.center) - *rounded).norm() + f64::from(ball.radius)
        }
        DroppedComponent {
            center: center.into(),
            radius: round_up(far(large, &rounded).max(far(small, &rounded))),
        }
    }
}

/// How far the points of all dropped components are from the nearest of some vertices, at most: 0 without components, infinite without vertices.
/// Rounded up.
pub fn gap(dropped: &[DroppedComponent], positions: &[[f32; 3]], vertices: impl Iterator<Item = u16>) -> f32 {
    if dropped.is_empty() {
        return 0.0;
    }
    let mut tree = KdTree::default();
    tree.fill(positions, vertices);
    let gaps = dropped.iter().map(|dropped| {
        let nearest = tree.nearest(to_f64(dropped.center), f64::INFINITY, |_| true);
        nearest.map_or(f64::INFINITY, |(squared, _)| squared.sqrt() + f64::from(dropped.radius))
    });
    round_up(gaps.fold(0.0, f64::max))
}

/// Puts neighbours together until there are at most `most`.
pub fn thin_out(dropped: &mut Vec<DroppedComponent>, most: usize) {
    while dropped.len() > most.max(1) {
        sort_along_boxes(dropped);
        let pairs = dropped.chunks(2).map(|pair| match pair {
            [a, b] => DroppedComponent::around(a, b),
            _ => pair[0],
        });
        *dropped = pairs.collect();
    }
}

/// Sorts so that neighbours in the list are neighbours in space: halves across the longest side of the box, and each half again.
fn sort_along_boxes(dropped: &mut [DroppedComponent]) {
    if dropped.len() <= 2 {
        return;
    }
    let centers = dropped.iter().map(|dropped| Vector3::from(dropped.center));
    let low = centers.clone().fold(Vector3::repeat(f32::INFINITY), |low, center| low.inf(&center));
    let high = centers.fold(Vector3::repeat(f32::NEG_INFINITY), |high, center| high.sup(&center));
    let axis = (high - low).imax();
    fn key(dropped: &DroppedComponent, axis: usize) -> f32 {
        dropped.center[axis]
    }
    // A half of an even length, so that no pair is of both.
    let middle = (dropped.len() / 2).next_multiple_of(2);
    // All of it decides between equals, so that the order in which they came does not.
    dropped.sort_unstable_by(|a, b| {
        let (all_a, all_b) = (a.center.into_iter().chain([a.radius]), b.center.into_iter().chain([b.radius]));
        let others = || all_a.zip(all_b).map(|(a, b)| a.total_cmp(&b)).find(|order| order.is_ne());
        key(a, axis).total_cmp(&key(b, axis)).then_with(|| others().unwrap_or(std::cmp::Ordering::Equal))
    });
    let (left, right) = dropped.split_at_mut(middle.min(dropped.len()));
    sort_along_boxes(left);
    sort_along_boxes(right);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ball(center: [f32; 3], radius: f32) -> DroppedComponent {
        DroppedComponent { center, radius }
    }

    #[test]
    fn a_small_box_far_away_is_not_lost() {
        let tiny = Displacement::default().moved(Vector3::repeat(-1e-30), Vector3::repeat(1e-30));
        let ball = DroppedComponent::new(Point3::new(1e6, 1e6, 1e6), &tiny);
        assert!(ball.radius > 1e-30 && ball.radius < 1e-8, "{}", ball.radius);
    }

    #[test]
    fn a_gap_is_to_the_nearest_vertex_and_of_the_farthest_ball() {
        let vertices = [[0.0; 3], [10.0, 0.0, 0.0]];
        assert_eq!(gap(&[], &vertices, 0..0), 0.0);
        let balls = [ball([0.0, 1.0, 0.0], 0.5), ball([8.0, 0.0, 0.0], 1.0)];
        let found = f64::from(gap(&balls, &vertices, 0..2));
        assert!((3.0..3.0001).contains(&found), "{found}");
        assert_eq!(gap(&balls, &vertices, 1..1), f32::INFINITY);
    }

    proptest! {
        /// Every point of the box lies in the ball.
        #[test]
        fn a_ball_holds_its_points(
            at in prop::array::uniform3(-1e3f64..1e3),
            low in prop::array::uniform3(-9.0f64..0.0),
            high in prop::array::uniform3(0.0f64..9.0),
            share in prop::array::uniform3(0.0f64..1.0),
        ) {
            let ended = Displacement::default().moved(low.into(), high.into());
            let ball = DroppedComponent::new(at.into(), &ended);
            let point: [f64; 3] = std::array::from_fn(|a| at[a] - (low[a] + share[a] * (high[a] - low[a])));
            let distance = (Point3::from(point) - to_f64(ball.center)).norm();
            prop_assert!(distance <= f64::from(ball.radius));
            let size = (Vector3::from(high) - Vector3::from(low)).norm();
            prop_assert!(f64::from(ball.radius) <= 0.5 * size * 1.0001 + 1e-3);
        }

        /// Fewer balls hold what all of them held.
        #[test]
        fn fewer_balls_hold_the_same(
            balls in prop::collection::vec((prop::array::uniform3(-9.0f32..9.0), 0.0f32..2.0), 1..60),
            most in 0usize..20,
        ) {
            let all: Vec<DroppedComponent> = balls.iter().map(|(center, radius)| ball(*center, *radius)).collect();
            let mut fewer = all.clone();
            thin_out(&mut fewer, most);
            prop_assert!(fewer.len() <= most.max(1));
            let holds = |outer: &DroppedComponent, inner: &DroppedComponent| {
                let way = (to_f64(outer.center) - to_f64(inner.center)).norm();
                way + f64::from(inner.radius) <= f64::from(outer.radius) * (1.0 + 1e-12)
            };
            for one in &all {
                prop_assert!(fewer.iter().any(|outer| holds(outer, one)), "{one:?}");
            }
            let mut turned: Vec<DroppedComponent> = all.iter().rev().copied().collect();
            thin_out(&mut turned, most);
            prop_assert!(all.len() <= most || turned == fewer, "the order does not matter");
        }
    }
}
