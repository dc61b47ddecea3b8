//! How far boxes of two models are apart at least.

use crate::pose::Between;
use chpm_space::Block;

impl Between {
    /// The squared distance of a box of the first model and one of the second, or less: by the box about either in the frame of the other.
    #[inline]
    pub(crate) fn squared(&self, a: &Block, b: &Block) -> f64 {
        let away = self.rotation * b.middle + self.translation - a.middle;
        let in_a = Block::outside(away.abs() - a.half - self.absolute * b.half);
        let turned = self.rotation.tr_mul(&away);
        let in_b = Block::outside(turned.abs() - b.half - self.absolute.tr_mul(&a.half));
        in_a.max(in_b)
    }
}
