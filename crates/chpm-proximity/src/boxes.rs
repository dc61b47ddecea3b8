//! How far boxes of two models are apart at least.

use crate::pose::Between;
use nalgebra::Vector3;

/// A box in a model's own frame, by its middle and half its size.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Block {
    pub(crate) middle: Vector3<f64>,
    pub(crate) half: Vector3<f64>,
}

impl Block {
    #[inline]
    pub(crate) fn new(min: [f32; 3], max: [f32; 3]) -> Self {
        Block::wide(min.map(f64::from), max.map(f64::from))
    }

    #[inline]
    pub(crate) fn wide(min: [f64; 3], max: [f64; 3]) -> Self {
        let (min, max) = (Vector3::from(min), Vector3::from(max));
        Block { middle: (min + max) * 0.5, half: (max - min) * 0.5 }
    }

    pub(crate) fn size(&self) -> f64 {
        self.half.norm()
    }

    /// The squared distance of a point.
    #[inline]
    pub(crate) fn squared_from(&self, point: &Vector3<f64>) -> f64 {
        outside((point - self.middle).abs() - self.half)
    }
}

#[inline]
fn outside(beyond: Vector3<f64>) -> f64 {
    let x = beyond.map(|x| x.max(0.0));
    x.dot(&x)
}

impl Between {
    /// The squared distance of a box of the first model and one of the second, or less: by the box about either in the frame of the other.
    #[inline]
    pub(crate) fn squared(&self, a: &Block, b: &Block) -> f64 {
        let away = self.rotation * b.middle + self.translation - a.middle;
        let in_a = outside(away.abs() - a.half - self.absolute * b.half);
        let turned = self.rotation.tr_mul(&away);
        let in_b = outside(turned.abs() - b.half - self.absolute.tr_mul(&a.half));
        in_a.max(in_b)
    }
}
