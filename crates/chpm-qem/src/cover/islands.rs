//! Small components of a reference, which may vanish as a whole.

use super::reference::Reference;
use crate::dropped::DroppedComponent;
use chpm_mesh::geom::to_f64;

/// Triangles that an island has at most: others do not vanish.
const MOST: usize = 256;

/// Which triangles have a common vertex, or are joined by such.
#[derive(Debug, Default)]
pub(crate) struct Islands {
    /// Per triangle its island; none of larger ones.
    of: Vec<Option<u32>>,
    /// The triangles, island by island, and where each ends.
    triangles: Vec<u32>,
    ends: Vec<usize>,
}

impl Islands {
    pub(crate) fn new(point_count: usize, triangles: &[[u32; 3]]) -> Self {
        let mut above: Vec<u32> = (0..point_count as u32).collect();
        for [a, b, c] in triangles {
            for other in [b, c] {
                let (one, other) = (top(&mut above, *a), top(&mut above, *other));
                above[one.max(other) as usize] = one.min(other);
            }
        }
        let mut all: Vec<(u32, u32)> =
            (0..).zip(triangles).map(|(index, corners)| (top(&mut above, corners[0]), index)).collect();
        all.sort_unstable();

        let mut islands = Islands { of: vec![None; triangles.len()], ..Islands::default() };
        for island in all.chunk_by(|a, b| a.0 == b.0).filter(|island| island.len() <= MOST) {
            let number = islands.ends.len() as u32;
            for (_, triangle) in island {
                islands.of[*triangle as usize] = Some(number);
                islands.triangles.push(*triangle);
            }
            islands.ends.push(islands.triangles.len());
        }
        islands
    }

    /// The triangles of the island that a triangle is of; none of larger ones.
    fn around(&self, triangle: u32) -> &[u32] {
        let Some(island) = self.of[triangle as usize] else { return &[] };
        let first = (island as usize).checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.triangles[first..self.ends[island as usize]]
    }
}

/// The least number of what is joined with one.
pub(super) fn top(above: &mut [u32], mut one: u32) -> u32 {
    while above[one as usize] != one {
        let next = above[above[one as usize] as usize];
        above[one as usize] = next;
        one = next;
    }
    one
}

impl Reference {
    /// Whether a triangle is of an island all of whose points of the source are in one of the balls.
    pub(crate) fn is_left_behind(&self, triangle: u32, balls: &[DroppedComponent]) -> bool {
        let island = self.islands.around(triangle);
        let is_inside = |ball: &DroppedComponent, triangle: &u32| {
            let beyond = f64::from(self.errors[*triangle as usize]);
            self.corners(*triangle).iter().all(|corner| ball.holds(&to_f64(*corner), beyond))
        };
        balls.iter().any(|ball| !island.is_empty() && island.iter().all(|one| is_inside(ball, one)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::displacement::Displacement;
    use nalgebra::{Point3, Vector3};

    #[test]
    fn an_island_is_left_behind_as_a_whole_or_not_at_all() {
        let mut reference = Reference::default();
        // Two triangles with a common corner, and one beside them.
        let places = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0].map(|x: f32| [x, (x * x) % 3.0, 0.0]);
        reference.add(&places, [([0, 1, 2], 0.25), ([2, 3, 4], 0.25), ([5, 6, 7], 0.25)].into_iter());
        reference.join();
        let ball = |low: f64, high: f64| {
            let box_of = Displacement::default().moved(Vector3::repeat(low), Vector3::repeat(high));
            DroppedComponent::new(Point3::origin(), &box_of)
        };
        let of = |ball: &DroppedComponent| {
            [0, 1, 2].map(|triangle| reference.is_left_behind(triangle, std::slice::from_ref(ball)))
        };
        assert_eq!(of(&ball(-9.0, 9.0)), [true; 3]);
        assert_eq!(of(&ball(-4.0, 0.5)), [true, true, false]);
        assert_eq!(of(&ball(-2.0, 0.5)), [false; 3], "the first triangle alone is inside");
        assert!(!reference.is_left_behind(0, &[]));
    }
}
