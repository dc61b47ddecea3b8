//! Boxes in a model's own frame.

use nalgebra::Vector3;

/// A box in a model's own frame, by its middle and half its size.
#[derive(Clone, Copy, Debug)]
pub struct Block {
    /// Its middle.
    pub middle: Vector3<f64>,
    /// Half its size.
    pub half: Vector3<f64>,
}

impl Block {
    /// By its corners.
    #[inline]
    pub fn new(min: [f32; 3], max: [f32; 3]) -> Self {
        Block::wide(min.map(f64::from), max.map(f64::from))
    }

    /// By corners that need more digits.
    #[inline]
    pub fn wide(min: [f64; 3], max: [f64; 3]) -> Self {
        let (min, max) = (Vector3::from(min), Vector3::from(max));
        Block { middle: (min + max) * 0.5, half: (max - min) * 0.5 }
    }

    /// Half its diagonal.
    pub fn size(&self) -> f64 {
        self.half.norm()
    }

    /// The squared distance of a point.
    #[inline]
    pub fn squared_from(&self, point: &Vector3<f64>) -> f64 {
        Block::outside((point - self.middle).abs() - self.half)
    }

    /// The squared length of what is beyond, by axis.
    #[inline]
    pub fn outside(beyond: Vector3<f64>) -> f64 {
        let x = beyond.map(|x| x.max(0.0));
        x.dot(&x)
    }
}
