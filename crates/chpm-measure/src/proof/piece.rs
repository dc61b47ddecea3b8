//! A part of a triangle, and how it is cut.

use super::triangle::Corners;
use chpm_mesh::geom;
use nalgebra::{Point3, Vector3};

/// Most corners of a piece.
const MOST: usize = 12;
/// Cuts one after the other that a piece may come from: what rounding moves its corners by adds up.
pub(crate) const DEEPEST: u8 = 90;

/// A convex polygon. Its corners are where they are computed to be; whatever is cut, the pieces together are an image of the
/// triangle that moves no point by more than rounding.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Piece {
    corners: [Point3<f64>; MOST],
    len: u8,
    depth: u8,
}

/// A plane; what lies along its normal is outside.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane {
    pub(crate) normal: Vector3<f64>,
    pub(crate) at: Point3<f64>,
}

impl Piece {
    pub(crate) fn of(triangle: Corners) -> Self {
        let mut piece = Piece::empty(0);
        triangle.into_iter().for_each(|corner| piece.push(geom::to_f64(corner)));
        piece
    }

    fn empty(depth: u8) -> Self {
        Piece { corners: [Point3::origin(); MOST], len: 0, depth }
    }

    fn push(&mut self, corner: Point3<f64>) {
        self.corners[usize::from(self.len)] = corner;
        self.len += 1;
    }

    pub(crate) fn corners(&self) -> &[Point3<f64>] {
        &self.corners[..usize::from(self.len)]
    }

    /// Cuts that it comes from; more than [`DEEPEST`] there must not be.
    pub(crate) fn depth(&self) -> u8 {
        self.depth
    }

    pub(crate) fn middle(&self) -> Point3<f64> {
        let share = 1.0 / f64::from(self.len);
        Point3::from(self.corners().iter().map(|corner| corner.coords * share).sum::<Vector3<f64>>())
    }

    /// The largest distance of a corner from a point.
    pub(crate) fn radius(&self, from: Point3<f64>) -> f64 {
        self.corners().iter().map(|corner| (corner - from).norm()).fold(0.0, f64::max)
    }

    /// Splits into the parts inside and outside of a plane; points that are outside by less than `slack` are inside. None where rounding has bent the piece, or
    /// its parts would have too many corners.
    pub(crate) fn cut(&self, plane: &Plane, slack: f64) -> Option<[Option<Piece>; 2]> {
        let mut heights = [0.0; MOST];
        let count = usize::from(self.len);
        for (height, corner) in heights.iter_mut().zip(self.corners()) {
            *height = plane.normal.dot(&(corner - plane.at));
        }
        let heights = &heights[..count];

        if heights.iter().all(|height| *height <= slack) {
            return Some([Some(*self), None]);
        }
        if heights.iter().all(|height| *height > 0.0) {
            return Some([None, Some(*self)]);
        }

        // A convex polygon crosses a plane twice; another one was bent by rounding.
        let crosses = |i: usize| (heights[i] > 0.0) != (heights[(i + 1) % count] > 0.0);
        if (0..count).filter(|i| crosses(*i)).count() != 2 || count + 2 > MOST {
            return None;
        }

        let (mut inside, mut outside) = (Piece::empty(self.depth + 1), Piece::empty(self.depth + 1));
        for (i, corner) in self.corners().iter().enumerate() {
            let part = if heights[i] > 0.0 { &mut outside } else { &mut inside };
            part.push(*corner);
            if crosses(i) {
                let next = (i + 1) % count;
                let share = heights[i] / (heights[i] - heights[next]);
                let between = corner + (self.corners[next] - corner) * share.clamp(0.0, 1.0);
                inside.push(between);
                outside.push(between);
            }
        }

        Some([Some(inside), Some(outside)])
    }

    /// Halves across the longest way from corner to corner.
    pub(crate) fn halves(&self) -> Option<[Piece; 2]> {
        let (mut longest, mut plane) = (0.0, None);
        for (i, a) in self.corners().iter().enumerate() {
            for b in &self.corners()[i + 1..] {
                let along = b - a;
                if along.norm_squared() > longest {
                    longest = along.norm_squared();
                    plane = Some(Plane { normal: along, at: a + along * 0.5 });
                }
            }
        }
        match self.cut(&plane?, 0.0) {
            Some([Some(inside), Some(outside)]) => Some([inside, outside]),
            _ => self.fans(),
        }
    }

    /// Two parts by a straight line from the first corner.
    fn fans(&self) -> Option<[Piece; 2]> {
        let count = usize::from(self.len);
        if count < 4 {
            return None;
        }
        let mut parts = [Piece::empty(self.depth + 1); 2];
        let half = count / 2;
        self.corners[..=half].iter().for_each(|corner| parts[0].push(*corner));
        self.corners[half..count].iter().chain(&self.corners[..1]).for_each(|corner| parts[1].push(*corner));
        Some(parts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(piece: &Piece) -> f64 {
        let corners = piece.corners();
        let twice = (2..corners.len())
            .map(|i| (corners[i - 1] - corners[0]).cross(&(corners[i] - corners[0])).norm());
        0.5 * twice.sum::<f64>()
    }

    #[test]
    fn what_is_cut_is_all_there() {
        let whole = Piece::of([[0.0; 3], [4.0, 0.0, 1.0], [1.0, 3.0, 0.0]]);
        let mut pieces = vec![whole];
        for i in 0..40 {
            let angle = f64::from(i);
            let plane = Plane {
                normal: Vector3::new(angle.cos(), angle.sin(), 0.1),
                at: Point3::new(1.6, 1.0 + 0.01 * angle, 0.3),
            };
            pieces = pieces
                .into_iter()
                .flat_map(|piece| match piece.cut(&plane, 0.0) {
                    Some(parts) => parts.into_iter().flatten().collect(),
                    None => piece.halves().expect("two halves").to_vec(),
                })
                .collect();
        }
        assert!(pieces.len() > 100);
        let sum: f64 = pieces.iter().map(area).sum();
        assert!((sum - area(&whole)).abs() < 1e-12, "{sum}");
    }

    #[test]
    fn halves_get_smaller_and_a_point_has_none() {
        let mut piece = Piece::of([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        for _ in 0..40 {
            piece = piece.halves().expect("two halves")[0];
        }
        assert!(piece.radius(piece.middle()) < 1e-5);
        assert!(Piece::of([[1.0; 3]; 3]).halves().is_none());
    }
}
