//! The one answer to how a whole model is looked at when nobody says how: for stills, windows, paths, pages and thumbnails.

use super::direction::{Side, Up};
use super::heights;
use super::outline::{Outline, Window};
use super::stance::Stance;
use crate::error::RefineError;
use crate::view::Camera;
use chpm_format::{Chpm, Metadata, shown};
use chpm_mesh::Aabb;
use nalgebra::{Point3, Vector3};
use std::f64::consts::PI;

/// A model as it stands, and the cameras that show all of it. Coordinates are those of the outline (of a file, relative to its origin), each
/// multiplied by [`Portrait::stretch`].
#[derive(Clone, PartialEq, Debug)]
pub struct Portrait {
    outline: Outline,
    bounds: Aabb,
    stance: Stance,
    /// Factor on heights, that is z, where it is not 1.
    heights: Option<f64>,
}

/// The stance that a file tells.
pub fn told_by(metadata: &Metadata) -> (Option<Up>, Option<Side>) {
    let up = metadata.setting(shown::UP).and_then(|up| up.parse().ok());
    (up, metadata.setting(shown::VIEW).and_then(Side::named))
}

/// Directions in which the outermost points of an outline are looked for.
const DIRECTIONS: u32 = 256;

impl Portrait {
    /// Of an outline; `bounds` is looked at where it has no triangles. What is told is not chosen.
    pub fn new(outline: Outline, bounds: Aabb, up: Option<Up>, side: Option<Side>) -> Self {
        let stance = Stance::of(&outline, up, side);
        Portrait { outline, bounds, stance, heights: None }
    }

    /// Of a file, as it says that it stands, or else as it stands best. Reads the pages of one of its levels.
    ///
    /// # Errors
    /// [`RefineError::Format`] for a damaged page.
    pub fn of_file<D: AsRef<[u8]>>(file: &Chpm<D>) -> Result<Self, RefineError> {
        let (outline, bounds) = (Outline::of_file(file)?, file.header().aabb());
        let (up, side) = file.metadata().map(|metadata| told_by(&metadata)).unwrap_or_default();
        Ok(Portrait::new(outline, bounds, up, side).with_heights(file.header().origin, up, side))
    }

    /// The same, lower where it is a terrain whose heights are in another unit than its places: as it is, it is one upright line. `origin` is
    /// what coordinates are relative to; what is told of the stance is not chosen.
    pub fn with_heights(self, origin: [f64; 3], up: Option<Up>, side: Option<Side>) -> Self {
        let Some(scale) = heights::scale(&self.outline, origin) else { return self };
        let outline = self.outline.moved(|[x, y, z]| [x, y, scale * z]);
        let (mut bounds, up) = (self.bounds, up.or_else(|| "z".parse().ok()));
        (bounds.min[2], bounds.max[2]) =
            ((scale * f64::from(bounds.min[2])) as f32, (scale * f64::from(bounds.max[2])) as f32);
        Portrait { heights: Some(scale), ..Portrait::new(outline, bounds, up, side) }
    }

    /// Factor on each coordinate in the picture.
    pub fn stretch(&self) -> Vector3<f64> {
        Vector3::new(1.0, 1.0, self.heights.unwrap_or(1.0))
    }

    /// Note about heights that are not drawn as the model has them.
    pub fn note(&self) -> Option<String> {
        let times = (1.0 / self.heights?).round();
        Some(format!("heights divided by {times}: places look like degrees, heights like metres"))
    }

    /// How it stands, and why.
    pub fn stance(&self) -> &Stance {
        &self.stance
    }

    /// Reasons of the choice, in words: the stance, and parts left out of the frame.
    pub fn why(&self) -> String {
        let left_out = Some(self.outline.left_out()).filter(|share| *share > 0.0);
        let specks = left_out
            .map(|share| format!("specks far away, {:.2} % of the surface, are not framed", 100.0 * share));
        let told = [Some(self.stance.why().to_owned()), specks, self.note()];
        let told: Vec<String> = told.into_iter().flatten().filter(|text| !text.is_empty()).collect();
        told.join("; ")
    }

    /// The box of all that is framed.
    pub fn frame(&self) -> Aabb {
        let points: Vec<[f32; 3]> =
            self.outline.framed(&self.bounds).map(|p| [p.x as f32, p.y as f32, p.z as f32]).collect();
        Aabb::of_points(&points)
    }

    /// The same from another side.
    pub fn from_side(&self, side: Side) -> Self {
        Portrait { stance: Stance::of(&self.outline, Some(self.stance.up()), Some(side)), ..self.clone() }
    }

    /// The camera that sees all of it from as near as it can, in an image of this width by height.
    pub fn camera(&self, aspect: f64) -> Camera {
        let (sight, up, fov) = (self.stance.sight(), self.stance.up().vector(), Camera::DEFAULT_FOV);
        self.outline.fit(&self.bounds, sight, up, fov, Window::of_image(aspect, fov))
    }

    /// So many cameras around it, the first from the side that is shown and each further to the right, all from one distance.
    pub fn turn(&self, aspect: f64, count: u32) -> Vec<Camera> {
        let (sight, up, fov) = (self.stance.sight(), self.stance.up().vector(), Camera::DEFAULT_FOV);
        self.outline.turn(&self.bounds, sight, up, fov, Window::of_image(aspect, fov), count)
    }

    /// Few points that decide how near a camera may come, from any side: the outermost in many directions. The corners of the box
    /// where there is no outline.
    pub fn outermost(&self) -> Vec<Point3<f64>> {
        let points: Vec<Point3<f64>> = self.outline.framed(&self.bounds).collect();
        fn direction(n: u32) -> Vector3<f64> {
            // Evenly over the sphere: a spiral by the golden angle.
            let z = 1.0 - (2.0 * f64::from(n) + 1.0) / f64::from(DIRECTIONS);
            let (sin, cos) = (f64::from(n) * PI * (3.0 - 5.0_f64.sqrt())).sin_cos();
            let across = (1.0 - z * z).max(0.0).sqrt();
            Vector3::new(across * cos, across * sin, z)
        }
        let mut places: Vec<usize> = (0..DIRECTIONS)
            .filter_map(|n| {
                let direction = direction(n);
                (0..points.len()).max_by(|a, b| {
                    points[*a].coords.dot(&direction).total_cmp(&points[*b].coords.dot(&direction))
                })
            })
            .collect();
        places.sort_unstable();
        places.dedup();
        let mut outermost: Vec<Point3<f64>> = places.into_iter().map(|place| points[place]).collect();
        outermost.dedup();
        outermost
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box of quads, and a speck far away.
    fn boxed(speck: bool) -> Outline {
        let corner = |n: u8| [f32::from(n & 1), 2.0 * f32::from(n >> 1 & 1), 3.0 * f32::from(n >> 2)];
        let mut points: Vec<[f32; 3]> = (0..8).map(corner).collect();
        let quads = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
        let mut triangles: Vec<[u32; 3]> =
            quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
        if speck {
            points.extend([[500.0, 0.0, 0.0], [500.01, 0.0, 0.0], [500.0, 0.01, 0.0]]);
            triangles.push([8, 9, 10]);
        }
        Outline::of_mesh(&points, &triangles)
    }

    #[test]
    fn a_speck_does_not_move_the_camera() {
        let bounds = Aabb { min: [0.0; 3], max: [500.1, 2.0, 3.0] };
        let [bare, specked] =
            [false, true].map(|speck| Portrait::new(boxed(speck).without_specks(), bounds, None, None));
        assert_eq!(bare.camera(1.5), specked.camera(1.5));
        assert_eq!(bare.turn(1.0, 7), specked.turn(1.0, 7));
        assert!(specked.why().contains("specks far away") && !bare.why().contains("specks"));
    }

    #[test]
    fn what_has_next_to_no_size_is_looked_at_from_away() {
        let at = |z: f32| [5e6, -1_666_666.6, z];
        let points = [at(0.0), at(1e-20), at(0.0), at(1e-20)];
        let outline = Outline::of_mesh(&points, &[[0, 1, 2], [1, 2, 3]]);
        let camera = Portrait::new(outline, Aabb::of_points(&points), None, None).camera(1.0);
        assert_ne!(camera.position, camera.target);
    }

    #[test]
    fn few_points_frame_like_all() {
        // A ball of many points.
        let ball: Vec<[f32; 3]> = (0..4000)
            .map(|n| {
                let (z, turn) = (f64::from(n) / 2000.0 - 1.0, f64::from(n) * 2.4);
                let across = (1.0 - z * z).sqrt();
                [across * turn.cos(), across * turn.sin(), z].map(|x| x as f32)
            })
            .collect();
        let triangles: Vec<[u32; 3]> = (0..3998).map(|n| [n, n + 1, n + 2]).collect();
        let all = Portrait::new(Outline::of_mesh(&ball, &triangles), Aabb::of_points(&ball), None, None);
        let few: Vec<[f32; 3]> =
            all.outermost().iter().map(|p| [p.x as f32, p.y as f32, p.z as f32]).collect();
        assert!(few.len() > 100 && few.len() <= DIRECTIONS as usize, "{}", few.len());
        let triangles: Vec<[u32; 3]> = (0..few.len() as u32 - 2).map(|n| [n, n + 1, n + 2]).collect();
        let (up, side) = (Some(all.stance().up()), Some(Side::Front));
        let [all, few] = [
            all.from_side(Side::Front),
            Portrait::new(Outline::of_mesh(&few, &triangles), all.bounds, up, side),
        ];
        let away = |portrait: &Portrait| Point3::from(portrait.camera(1.0).position).coords.norm();
        assert!((away(&all) / away(&few) - 1.0).abs() < 0.01, "{} {}", away(&all), away(&few));
        // Without an outline, the box.
        let bare = Portrait::new(Outline::default(), Aabb { min: [-1.0; 3], max: [1.0; 3] }, None, None);
        assert_eq!(bare.outermost().len(), 8);
    }
}
