//! Charts: parts of a cluster's surface that are projected onto a plane each, where an image holds their colours.

use bytemuck::{Pod, Zeroable};

/// An orthogonal projection of some triangles to a rectangle of an image. Nothing is stored for a corner: where it is in the image follows from where it is
/// in space, at every position of a progressive mesh.
#[derive(Clone, Copy, PartialEq, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Chart {
    /// Texels to the right, and downwards, for each unit of the model.
    pub axes: [[f32; 3]; 2],
    /// Where the origin of the projection is in the image, texels.
    pub offset: [f32; 2],
    /// Column, row, width and height of the rectangle, texels.
    pub rect: [u16; 4],
}

impl Chart {
    /// Where a point is in the image, in texels from its upper left corner; `origin` is that of the image's charts.
    ///
    /// ```
    /// use chpm_mesh::Chart;
    ///
    /// let chart = Chart { axes: [[2.0, 0.0, 0.0], [0.0, -2.0, 0.0]], offset: [4.0, 20.0], rect: [0, 0, 32, 32] };
    /// assert_eq!(chart.place([1.0, 0.0, 0.0], [2.0, 3.0, 9.0]), [6.0, 14.0]);
    /// ```
    pub fn place(&self, origin: [f32; 3], point: [f32; 3]) -> [f64; 2] {
        let [x, y, z]: [f64; 3] = std::array::from_fn(|i| f64::from(point[i]) - f64::from(origin[i]));
        std::array::from_fn(|k| {
            let [a, b, c] = self.axes[k].map(f64::from);
            a * x + b * y + c * z + f64::from(self.offset[k])
        })
    }

    /// Whether a place is in the rectangle.
    pub fn holds(&self, [x, y]: [f64; 2]) -> bool {
        let [left, top, width, height] = self.rect.map(f64::from);
        x >= left && y >= top && x <= left + width && y <= top + height
    }
}
