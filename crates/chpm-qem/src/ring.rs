//! The loop of edges about a vertex u, with all that tests and bounds need of it, coordinate by coordinate.
//!
//! It does not matter where a loop begins, but a collapse u -> v is looked at from v on. So the loop is turned to begin there, and then
//! its places are looked up, two at a time, as registers hold them. What comes behind the last is v again, and again.

use crate::one_ring::MAX_VALENCE;
use bytemuck::cast_ref;
use nalgebra::{Point3, Vector3};
use std::ops::Range;
use wide::f64x2;

/// Most vertices of a loop: a boundary vertex of the highest valence has one more than faces.
pub(crate) const MAX_LOOP: usize = MAX_VALENCE + 1;
/// Pairs that a loop and its first vertex again may take, and one that is only looked at.
pub(crate) const PAIRS: usize = MAX_LOOP / 2 + 2;
/// Numbers that they are.
pub(crate) const ROOM: usize = 2 * PAIRS;

/// "The edge that this vertex leads has no face": it closes the loop of an open fan.
pub(crate) const NO_FACE: u32 = u32::MAX;

/// A number for each vertex of a loop.
pub(crate) type Pairs = [f64x2; PAIRS];

/// Those numbers, one by one.
#[inline]
pub(crate) fn each(pairs: &Pairs) -> &[f64; ROOM] {
    cast_ref(pairs)
}

/// Pairs of each number and the next one.
#[inline]
pub(crate) fn following(pairs: &Pairs, pair: usize) -> f64x2 {
    let ([_, first], [second, _]) = (pairs[pair].to_array(), pairs[pair + 1].to_array());
    f64x2::new([first, second])
}

/// A bit for each of a range.
#[inline]
pub(crate) fn bits(range: Range<usize>) -> u64 {
    (1 << range.end) - (1 << range.start)
}

/// A loop l_0 = v, l_1, ..., and after that v again.
#[derive(Debug)]
pub(crate) struct Ring {
    len: usize,
    /// The vertices as they were walked, and the face that each leads.
    walked: [(u16, u32); MAX_LOOP],
    is_turned: bool,
    /// The place of u.
    apex: [f64; 3],
    /// From v on.
    vertices: [u16; ROOM],
    faces: [u32; ROOM],
    places: [Pairs; 3],
    /// The places relative to u.
    arms: [Pairs; 3],
    /// Twice the faces' areas, along their normals.
    areas: [Pairs; 3],
    /// Of the longest arm, squared.
    reach: f64,
}

impl Default for Ring {
    fn default() -> Self {
        const NOTHING: [Pairs; 3] = [[f64x2::ZERO; PAIRS]; 3];
        Ring {
            len: 0,
            walked: [(0, 0); MAX_LOOP],
            is_turned: false,
            apex: [0.0; 3],
            vertices: [0; ROOM],
            faces: [0; ROOM],
            places: NOTHING,
            arms: NOTHING,
            areas: NOTHING,
            reach: 0.0,
        }
    }
}

impl Ring {
    /// Begins a loop.
    pub(crate) fn clear(&mut self) {
        (self.len, self.is_turned) = (0, false);
    }

    /// Appends the next vertex, and the face that it leads. There are no more than [`MAX_LOOP`].
    #[inline]
    pub(crate) fn push(&mut self, vertex: u16, face: u32) {
        if let Some(next) = self.walked.get_mut(self.len) {
            *next = (vertex, face);
            self.len += 1;
        }
    }

    /// Turns the loop to begin at one of its vertices, and looks up where all of them and u are; false if it has no such vertex.
    pub(crate) fn turn_to(&mut self, v: u16, apex: [f64; 3], place: impl Fn(u16) -> [f64; 3]) -> bool {
        // It is no more than that, and the compiler need not test each place.
        let len = self.len.min(MAX_LOOP);
        let Some(start) = self.walked[..len].iter().position(|(vertex, _)| *vertex == v) else {
            return false;
        };
        let (before, from) = self.walked[..len].split_at(start);
        for (i, (vertex, face)) in from.iter().chain(before).enumerate() {
            (self.vertices[i], self.faces[i]) = (*vertex, *face);
        }
        (self.vertices[len], self.vertices[len + 1]) = (v, v);
        (self.apex, self.is_turned) = (apex, true);
        let apex = apex.map(f64x2::splat);

        for pair in 0..self.pairs() {
            let (a, b) = (place(self.vertices[2 * pair]), place(self.vertices[2 * pair + 1]));
            for axis in 0..3 {
                let at = f64x2::new([a[axis], b[axis]]);
                self.places[axis][pair] = at;
                self.arms[axis][pair] = at - apex[axis];
            }
        }

        let [x, y, z] = &self.arms;
        let mut reach = f64x2::ZERO;
        for pair in 0..self.pairs() {
            let arm = [x[pair], y[pair], z[pair]];
            let next = [following(x, pair), following(y, pair), following(z, pair)];
            for axis in 0..3 {
                let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
                self.areas[axis][pair] = arm[j] * next[k] - arm[k] * next[j];
            }
            reach = reach.fast_max(arm[0] * arm[0] + arm[1] * arm[1] + arm[2] * arm[2]);
        }

        let [a, b] = reach.to_array();
        self.reach = if a > b { a } else { b };
        true
    }

    /// The loop, if it was turned to begin at a vertex.
    #[inline]
    pub(crate) fn seen_from(&self, v: u16) -> Option<&Ring> {
        (self.is_turned && self.vertices[0] == v).then_some(self)
    }

    #[inline]
    pub(crate) fn len(&self) -> usize {
        self.len.min(MAX_LOOP)
    }

    /// Pairs that the loop and its first vertex again take.
    #[inline]
    pub(crate) fn pairs(&self) -> usize {
        self.len() / 2 + 1
    }

    /// By vertex: the face (u, l_i, l_i+1), or [`NO_FACE`]; after the collapse u -> v face i in 1..=len-2 is (v, l_i, l_i+1).
    #[inline]
    pub(crate) fn faces(&self) -> &[u32] {
        &self.faces[..self.len()]
    }

    #[inline]
    pub(crate) fn vertices(&self) -> &[u16] {
        &self.vertices[..self.len()]
    }

    #[inline]
    pub(crate) fn places(&self) -> &[Pairs; 3] {
        &self.places
    }

    /// The places relative to u.
    #[inline]
    pub(crate) fn arms(&self) -> &[Pairs; 3] {
        &self.arms
    }

    /// The vectors of twice the faces' areas.
    #[inline]
    pub(crate) fn areas(&self) -> &[Pairs; 3] {
        &self.areas
    }

    /// The square of the longest arm.
    #[inline]
    pub(crate) fn reach(&self) -> f64 {
        self.reach
    }

    /// Where u is.
    #[inline]
    pub(crate) fn apex(&self) -> Point3<f64> {
        Point3::from(self.apex)
    }

    /// Where l_i is.
    #[inline]
    pub(crate) fn point(&self, i: usize) -> Point3<f64> {
        let [x, y, z] = &self.places;
        Point3::new(each(x)[i], each(y)[i], each(z)[i])
    }

    /// Where l_i is relative to u.
    #[inline]
    pub(crate) fn arm(&self, i: usize) -> Vector3<f64> {
        let [x, y, z] = &self.arms;
        Vector3::new(each(x)[i], each(y)[i], each(z)[i])
    }
}
