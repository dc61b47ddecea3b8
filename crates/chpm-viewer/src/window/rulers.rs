//! Rulers in a picture: a scale bar, the model's axes, the distance of two points.

use chpm_refine::Camera;
use nalgebra::{Point3, Vector3};

/// A bar of a round length in the model's units, at the distance of what is looked at: the length, and pixels, at most so many.
pub fn scale_bar(camera: &Camera, height: u32, most: f64) -> Option<(f64, f64)> {
    let distance = (Point3::from(camera.target) - Point3::from(camera.position)).norm();
    let pixel = 2.0 * (0.5 * camera.fov.to_radians()).tan() * distance / f64::from(height.max(1));
    let longest = pixel * most;
    if !(longest.is_finite() && longest > 0.0) {
        return None;
    }
    let decade = 10_f64.powf(longest.log10().floor());
    let round = [5.0, 2.0, 1.0].map(|digit| digit * decade).into_iter().find(|length| *length <= longest)?;
    Some((round, round / pixel))
}

/// Where the axes x, y and z of the model point in the image: to the right, downward, and away from the viewer.
pub fn triad(camera: &Camera) -> [[f64; 3]; 3] {
    let [right, up, forward] = camera.axes();
    [Vector3::x(), Vector3::y(), Vector3::z()]
        .map(|axis| [axis.dot(&right), -axis.dot(&up), axis.dot(&forward)])
}

/// A point that was picked on what is drawn, and how far that is from the source at most.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Mark {
    /// In the model's coordinates.
    pub point: [f64; 3],
    /// In its units.
    pub error: f64,
}

/// The distance of two points, and by how much that of the source's own points beside them may differ.
pub fn distance(a: &Mark, b: &Mark) -> (f64, f64) {
    ((Point3::from(b.point) - Point3::from(a.point)).norm(), a.error + b.error)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn camera() -> Camera {
        Camera { fov: 90.0, ..Camera::looking([0.0, 0.0, 10.0], [0.0; 3]) }
    }

    #[test]
    fn a_bar_is_as_long_as_it_says() {
        // Twenty units are 100 pixels high.
        assert_eq!(scale_bar(&camera(), 100, 30.0).map(|(length, _)| length), Some(5.0));
        let (length, pixels) = scale_bar(&camera(), 100, 60.0).unwrap();
        assert!(length == 10.0 && (pixels - 50.0).abs() < 1e-9, "{length} {pixels}");
        assert_eq!(scale_bar(&Camera { target: [0.0, 0.0, 10.0], ..camera() }, 100, 30.0), None);
    }

    #[test]
    fn axes_point_where_they_do_in_the_image() {
        let [x, y, z] = triad(&camera());
        let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(near(x, [1.0, 0.0, 0.0]) && near(y, [0.0, -1.0, 0.0]) && near(z, [0.0, 0.0, -1.0]));
    }

    #[test]
    fn a_distance_is_as_sure_as_its_ends() {
        let mark = |x, error| Mark { point: [x, 0.0, 0.0], error };
        assert_eq!(distance(&mark(1.0, 0.25), &mark(4.0, 0.5)), (3.0, 0.75));
    }

    proptest! {
        #[test]
        fn bars_are_round_and_fit(distance in 1e-6..1e9f64, most in 20.0..400.0f64) {
            let camera = Camera { position: [0.0, 0.0, distance], ..camera() };
            let (length, pixels) = scale_bar(&camera, 720, most).unwrap();
            prop_assert!(pixels <= most * (1.0 + 1e-9) && pixels > 0.39 * most, "{} {}", length, pixels);
            let digit = length / 10_f64.powf((length.log10() + 1e-9).floor());
            prop_assert!([1.0, 2.0, 5.0].iter().any(|round| (digit - round).abs() < 1e-6), "{}", length);
        }
    }
}
