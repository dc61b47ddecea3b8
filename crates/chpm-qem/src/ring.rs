//! The loop of edges about a vertex u, with all that tests and bounds need of it, coordinate by coordinate.
//!
//! It does not matter where a loop begins, but a collapse u -> v is looked at from v on. So everything is there twice, one after the
//! other: from any vertex on the whole loop follows without a gap.

use crate::one_ring::MAX_VALENCE;
use nalgebra::{Point3, Vector3};

/// Most vertices of a loop: a boundary vertex of the highest valence has one more than faces.
pub(crate) const MAX_LOOP: usize = MAX_VALENCE + 1;
/// Twice that, and one more: the loop is closed.
const ROOM: usize = 2 * MAX_LOOP + 2;

/// "The edge that this vertex leads has no face": it closes the loop of an open fan.
pub(crate) const NO_FACE: u32 = u32::MAX;

/// Vectors of a loop, by coordinate.
pub(crate) type Lanes<const ROOM: usize> = [[f64; ROOM]; 3];

/// A loop.
#[derive(Debug)]
pub(crate) struct Ring {
    len: usize,
    /// The place of u.
    apex: [f64; 3],
    vertices: [u16; ROOM],
    /// Face i is (u, l_i, l_i+1), or there is none.
    faces: [u32; ROOM],
    places: Lanes<ROOM>,
    /// The places relative to u.
    arms: Lanes<ROOM>,
    /// Twice the faces' areas, along their normals.
    areas: Lanes<ROOM>,
    /// Of the longest arm, squared.
    reach: f64,
}

impl Default for Ring {
    fn default() -> Self {
        Ring {
            len: 0,
            apex: [0.0; 3],
            vertices: [0; ROOM],
            faces: [0; ROOM],
            places: [[0.0; ROOM]; 3],
            arms: [[0.0; ROOM]; 3],
            areas: [[0.0; ROOM]; 3],
            reach: 0.0,
        }
    }
}

impl Ring {
    /// Begins a loop.
    pub(crate) fn clear(&mut self) {
        self.len = 0;
    }

    /// Appends the next vertex, and the face that it leads. There are no more than [`MAX_LOOP`].
    #[inline]
    pub(crate) fn push(&mut self, vertex: u16, face: u32) {
        self.vertices[self.len] = vertex;
        self.faces[self.len] = face;
        self.len += 1;
    }

    /// Looks up where u and the vertices of the loop are.
    pub(crate) fn place(&mut self, apex: [f64; 3], place: impl Fn(u16) -> [f64; 3]) {
        // It is no more than that, and the compiler need not test each place.
        let len = self.len.min(MAX_LOOP);
        self.apex = apex;
        for i in 0..len {
            let vertex = self.vertices[i];
            self.vertices[len + i] = vertex;
            self.faces[len + i] = self.faces[i];
            let at = place(vertex);
            for axis in 0..3 {
                let arm = at[axis] - apex[axis];
                (self.places[axis][i], self.places[axis][len + i]) = (at[axis], at[axis]);
                (self.arms[axis][i], self.arms[axis][len + i]) = (arm, arm);
            }
        }

        let [x, y, z] = &self.arms;
        let mut reach: f64 = 0.0;
        for i in 0..len {
            let next = i + 1;
            let area = [
                y[i] * z[next] - z[i] * y[next],
                z[i] * x[next] - x[i] * z[next],
                x[i] * y[next] - y[i] * x[next],
            ];
            for (areas, area) in self.areas.iter_mut().zip(area) {
                (areas[i], areas[len + i]) = (area, area);
            }
            let squared = x[i] * x[i] + y[i] * y[i] + z[i] * z[i];
            reach = if squared > reach { squared } else { reach };
        }

        self.reach = reach;
    }

    /// The loop from its i-th vertex on.
    #[inline]
    pub(crate) fn begun_at(&self, start: usize) -> RingView<'_> {
        RingView { ring: self, start }
    }

    /// The same, from a vertex on that it has.
    #[inline]
    pub(crate) fn seen_from(&self, vertex: u16) -> Option<RingView<'_>> {
        let start = self.vertices[..self.len].iter().position(|v| *v == vertex)?;
        Some(self.begun_at(start))
    }
}

/// A loop l_0 = v, l_1, ..., of `len` vertices, and after that v again.
#[derive(Clone, Copy)]
pub(crate) struct RingView<'a> {
    ring: &'a Ring,
    start: usize,
}

impl<'a> RingView<'a> {
    #[inline]
    pub(crate) fn len(self) -> usize {
        self.ring.len
    }

    /// By vertex: the face (u, l_i, l_i+1), or [`NO_FACE`]; after the collapse u -> v face i in 1..=len-2 is (v, l_i, l_i+1).
    #[inline]
    pub(crate) fn faces(self) -> &'a [u32] {
        &self.ring.faces[self.start..self.start + self.ring.len]
    }

    #[inline]
    pub(crate) fn vertices(self) -> &'a [u16] {
        &self.ring.vertices[self.start..self.start + self.ring.len]
    }

    #[inline]
    fn lanes(self, of: &'a Lanes<ROOM>) -> [&'a [f64]; 3] {
        let [x, y, z] = of;
        let all = self.start..self.start + self.ring.len + 1;
        [&x[all.clone()], &y[all.clone()], &z[all]]
    }

    /// The places, that of v once more at the end.
    #[inline]
    pub(crate) fn places(self) -> [&'a [f64]; 3] {
        self.lanes(&self.ring.places)
    }

    /// The places relative to u, likewise.
    #[inline]
    pub(crate) fn arms(self) -> [&'a [f64]; 3] {
        self.lanes(&self.ring.arms)
    }

    /// The vectors of twice the faces' areas, likewise.
    #[inline]
    pub(crate) fn areas(self) -> [&'a [f64]; 3] {
        self.lanes(&self.ring.areas)
    }

    /// The square of the longest arm.
    #[inline]
    pub(crate) fn reach(self) -> f64 {
        self.ring.reach
    }

    /// Where u is.
    #[inline]
    pub(crate) fn apex(self) -> Point3<f64> {
        Point3::from(self.ring.apex)
    }

    /// Where l_i is.
    #[inline]
    pub(crate) fn point(self, i: usize) -> Point3<f64> {
        let [x, y, z] = self.places();
        Point3::new(x[i], y[i], z[i])
    }

    /// Where l_i is relative to u.
    #[inline]
    pub(crate) fn arm(self, i: usize) -> Vector3<f64> {
        let [x, y, z] = self.arms();
        Vector3::new(x[i], y[i], z[i])
    }
}
