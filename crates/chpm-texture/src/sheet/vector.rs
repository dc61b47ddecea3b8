//! Vectors of three f64, with the order of operations written down.

pub(super) type Vector = [f64; 3];

pub(super) fn sub(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(super) fn add(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(super) fn scale(a: Vector, by: f64) -> Vector {
    [a[0] * by, a[1] * by, a[2] * by]
}

pub(super) fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The vector of length one; none for what has hardly any.
pub(super) fn unit(a: Vector) -> Option<Vector> {
    let length = dot(a, a).sqrt();
    (length > f64::MIN_POSITIVE && length.is_finite()).then(|| scale(a, 1.0 / length))
}

/// Twice the area of a triangle, along its normal.
pub(super) fn doubled_area([a, b, c]: [Vector; 3]) -> Vector {
    cross(sub(b, a), sub(c, a))
}

/// Two directions that are perpendicular to a unit vector and to one another; with it they are right-handed.
pub(super) fn beside(d: Vector) -> [Vector; 2] {
    // The axis that is farthest from it.
    let least = (0..3).fold(0, |least, axis| if d[axis].abs() < d[least].abs() { axis } else { least });
    let mut axis = [0.0; 3];
    axis[least] = 1.0;
    let right = unit(cross(axis, d)).unwrap_or([1.0, 0.0, 0.0]);
    [right, cross(d, right)]
}
