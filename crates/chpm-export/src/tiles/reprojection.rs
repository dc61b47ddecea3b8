//! Coordinates of a projected system (UTM, national grids) as metres about a place on the earth, whose surface is not flat and whose north is not the
//! grid's.

use crate::error::ExportError;
use nalgebra::{Matrix3, Vector3};
use std::fmt;
use std::sync::Arc;

/// Where a point of the model is in the frame of the tiles, in metres; none outside of the system.
pub type Map = dyn Fn([f64; 3]) -> Option<[f64; 3]> + Send + Sync;

/// A smooth map from the model's coordinates to the frame of the tiles, and how it changes errors and boxes.
#[derive(Clone)]
pub struct Reprojection {
    name: String,
    map: Arc<Map>,
    /// Takes directions along, at the middle of the model.
    turn: Matrix3<f64>,
    /// How much longer a short length becomes at most.
    scale: f64,
    /// How fast a straight line bends at most, by the square of its length.
    bend: f64,
}

/// Steps of differences in the model's units: for first ones, and at least for second ones, which rounding would hide.
const STEP: f64 = 10.0;
const LEAST: f64 = 100.0;
/// How much more than at the places that are looked at.
const SAFETY: f64 = 2.0;

impl Reprojection {
    /// Takes a map whose name tells it from others. Between the corners of a model's box its derivatives are looked at in 27 places, to know what
    /// becomes of errors and straight edges; second ones, which vary little over a model, are taken twice.
    ///
    /// # Errors
    /// [`ExportError::Outside`] if a part of the box is outside of the system.
    pub fn new(name: String, corners: [[f64; 3]; 2], map: Arc<Map>) -> Result<Reprojection, ExportError> {
        let [min, max] = corners;
        let at = |place: [f64; 3]| {
            map(place)
                .filter(|found| found.iter().all(|x| x.is_finite()))
                .map(Vector3::from)
                .ok_or_else(|| ExportError::Outside { system: name.clone(), place })
        };
        let lattice = |i: usize| {
            let steps = [i % 3, i / 3 % 3, i / 9];
            let share = |axis: usize| steps[axis] as f64 / 2.0;
            std::array::from_fn(|axis| min[axis] + share(axis) * (max[axis] - min[axis]))
        };
        let along = |place: [f64; 3], way: [f64; 3], step: f64| {
            std::array::from_fn::<f64, 3, _>(|axis| place[axis] + step * way[axis])
        };

        let (mut scale, mut bend, mut turn) = (0.0_f64, 0.0_f64, Matrix3::identity());
        let half = (0..3).map(|axis| max[axis] - min[axis]).fold(0.0, f64::max) / 2.0;
        for i in 0..27 {
            let place = lattice(i);
            let mut jacobian = Matrix3::zeros();
            for axis in 0..3 {
                let mut way = [0.0; 3];
                way[axis] = 1.0;
                let [before, after] = [at(along(place, way, -STEP))?, at(along(place, way, STEP))?];
                jacobian.set_column(axis, &((after - before) / (2.0 * STEP)));
            }
            scale = scale.max(jacobian.singular_values().max());
            if i == 13 {
                turn = jacobian;
            }
            let middle = at(place)?;
            for way in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.7, 0.7, 0.1], [0.7, -0.7, 0.1]]
            {
                let step = half.clamp(LEAST, 100.0 * LEAST);
                let [before, after] = [at(along(place, way, -step))?, at(along(place, way, step))?];
                bend = bend.max((before + after - 2.0 * middle).norm() / (step * step));
            }
        }
        Ok(Reprojection { name, map, turn, scale: scale * (1.0 + 1e-6), bend: SAFETY * bend })
    }

    /// Whether it makes a mirror image, as of axes to the south and west.
    pub fn is_mirror(&self) -> bool {
        self.turn.determinant() < 0.0
    }

    /// A point of the model in the frame of the tiles.
    ///
    /// # Errors
    /// [`ExportError::Outside`].
    pub(super) fn place(&self, place: [f64; 3]) -> Result<[f64; 3], ExportError> {
        (self.map)(place).ok_or_else(|| ExportError::Outside { system: self.name.clone(), place })
    }

    /// Moves positions, which are relative to `origin`, and turns normals.
    pub(super) fn apply(
        &self,
        origin: [f64; 3],
        positions: &mut [[f32; 3]],
        normals: &mut [[f32; 3]],
    ) -> Result<(), ExportError> {
        for position in positions {
            let there = std::array::from_fn(|axis| origin[axis] + f64::from(position[axis]));
            *position = self.place(there)?.map(|x| x as f32);
        }
        // A normal stays at right angles to what it is normal to.
        let turn = self.turn.try_inverse().unwrap_or_else(Matrix3::identity).transpose();
        for normal in normals {
            let turned = (turn * Vector3::from(normal.map(f64::from))).try_normalize(0.0);
            *normal = turned.map_or(*normal, |turned| turned.map(|x| x as f32).into());
        }
        Ok(())
    }

    /// How far the image of a straight line of this length is from the straight line between its ends, at most.
    fn sag(&self, length: f64) -> f64 {
        self.bend * length * length / 8.0
    }

    /// A bound in metres of what was within `error`, in a box of this diagonal: edges are straight here, too.
    pub(super) fn error(&self, error: f64, diagonal: f64) -> f64 {
        self.scale * error + self.sag(diagonal)
    }

    /// A box about the image of a box: its middle and half of each axis, which are at right angles.
    pub(super) fn volume(&self, middle: [f64; 3], half: [f64; 3]) -> Result<[[f64; 3]; 4], ExportError> {
        let mut ways = [Vector3::zeros(); 3];
        for axis in 0..3 {
            let end = |sign: f64| {
                let mut end = middle;
                end[axis] += sign * half[axis].max(STEP);
                self.place(end).map(Vector3::from)
            };
            ways[axis] = (end(1.0)? - end(-1.0)?) / (2.0 * half[axis].max(STEP));
        }
        let east = ways[0].normalize();
        let north = (ways[1] - east * east.dot(&ways[1])).normalize();
        let axes = [east, north, east.cross(&north)];
        let diagonal = 2.0 * half.iter().map(|x| x * x).sum::<f64>().sqrt();
        let around = axes.map(|axis| {
            let reach = (0..3).map(|k| (half[k] * ways[k].dot(&axis)).abs()).sum::<f64>();
            // What bends is as far from the plane through the middle as a line of twice the length sags.
            let most = reach + 4.0 * self.sag(diagonal);
            (axis * most).into()
        });
        Ok([self.place(middle)?, around[0], around[1], around[2]])
    }
}

impl PartialEq for Reprojection {
    fn eq(&self, other: &Reprojection) -> bool {
        self.name == other.name && self.turn == other.turn
    }
}

impl fmt::Debug for Reprojection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {:?}", self.name, self.turn)
    }
}
