//! Which way a smooth surface faces at a vertex, of a source without normals: what its faces have in common, and what a crease keeps apart.
//!
//! A vertex has one direction for all of its faces, whatever position of the progressive mesh they are of. Where they make one smooth
//! surface it is the normal. On a crease it is the line of the crease: each face keeps its own side of it, and loses only what it leans
//! along it. So nothing is doubled, and a pixel needs no more than its own face to know on which side it is.

use crate::octahedral;
use nalgebra::Vector3;

/// Cosine of the crease angle, 40 degrees: faces that lean more from each other are not smooth with one another, unless others about the same
/// vertex lie between.
const CREASE: f64 = 0.766_044_443_118_978;
/// Cosine of half of it: whatever is within it of a mean is within it of each other.
const HALF: f64 = 0.939_692_620_785_908;
/// Groups of faces whose means make a smaller sine are two sides of one plane.
const SHEET: f64 = 0.34;
/// The sine up to which more groups than two have one line in common.
const ALONG: f64 = 0.17;
/// A group of a face or two with less than this share of all area is a needle that a simplification has left standing, and makes no crease.
const NEEDLE: f64 = 0.04;
/// Faces beyond which each is held against the mean alone.
const MANY: usize = 128;

/// Use of a face's plane at a vertex, by a pixel.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Facing {
    /// A smooth surface: its normal takes the plane's place.
    Toward([f64; 3]),
    /// A crease: the plane loses what it leans along this line.
    Along([f64; 3]),
    /// A corner, or nothing known: the plane stays.
    Flat,
}

impl Facing {
    /// Of a vertex, by the normals of the faces about it, each as long as its area.
    pub fn of_faces(areas: &[[f64; 3]]) -> Self {
        fn area(area: &[f64; 3]) -> Vector3<f64> {
            Vector3::from(*area)
        }
        let sum: Vector3<f64> = areas.iter().map(area).sum();
        let faces = || areas.iter().map(area).filter_map(|area| unit(area).map(|unit| (unit, area)));
        let mean = unit(sum);
        if mean.is_some_and(|mean| faces().all(|(face, _)| face.dot(&mean) > HALF)) {
            return Facing::toward(sum);
        }
        if areas.len() > MANY {
            let is_smooth = mean.is_some_and(|mean| faces().all(|(face, _)| face.dot(&mean) > CREASE));
            return if is_smooth { Facing::toward(sum) } else { Facing::Flat };
        }
        let means = groups(&faces().collect::<Vec<_>>());
        match means[..] {
            [] => Facing::Flat,
            [sum] => Facing::toward(sum),
            _ => Facing::between(&means),
        }
    }

    /// A normal of the source's; zero is none.
    pub fn of_normal(normal: [f32; 3]) -> Self {
        Facing::toward(Vector3::from(normal.map(f64::from)))
    }

    fn toward(sum: Vector3<f64>) -> Self {
        unit(sum).map_or(Facing::Flat, |unit| Facing::Toward(unit.into()))
    }

    /// Of groups of faces that are apart.
    fn between(means: &[Vector3<f64>]) -> Self {
        let Some(means) = means.iter().map(|mean| unit(*mean)).collect::<Option<Vec<_>>>() else {
            return Facing::Flat;
        };
        let pairs =
            means.iter().enumerate().flat_map(|(i, a)| means[i + 1..].iter().map(move |b| a.cross(b)));
        let widest = pairs.max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()));
        match widest.and_then(|line| Some((line.norm(), unit(line)?))) {
            Some((sine, line)) if sine > SHEET => {
                let common = means.iter().all(|mean| mean.dot(&line).abs() < ALONG);
                if common { Facing::Along(line.into()) } else { Facing::Flat }
            }
            // Both sides of a sheet, or faces that go around either way.
            _ => Facing::toward(means[0] - means[means.len() - 1]),
        }
    }

    /// Normal at a vertex that becomes of the plane of one of its faces, which is of length 1.
    pub fn of_plane(&self, plane: [f64; 3]) -> [f64; 3] {
        let plane = Vector3::from(plane);
        let made = match self {
            Facing::Toward(normal) => Vector3::from(*normal) * Vector3::from(*normal).dot(&plane),
            Facing::Along(line) => plane - Vector3::from(*line) * Vector3::from(*line).dot(&plane),
            Facing::Flat => plane,
        };
        made.into()
    }

    /// As a vertex has it: a direction as a point of the unfolded octahedron, 16 bits a side, of which the last tells a crease.
    pub fn code(self) -> u32 {
        let (direction, crease) = match self {
            Facing::Toward(direction) => (direction, 0),
            Facing::Along(direction) => (direction, 1),
            Facing::Flat => return FLAT,
        };
        let Some([u, v]) = octahedral::square(direction) else { return FLAT };
        fn pack(t: f64) -> u32 {
            u32::from((t.clamp(-1.0, 1.0) * 32767.0).round() as i16 as u16)
        }
        match (pack(u) & !1 | crease) | pack(v) << 16 {
            // Any other corner of the square is the same direction.
            FLAT => (pack(1.0) & !1 | crease) | pack(1.0) << 16,
            code => code,
        }
    }

    /// The one of a code, but for what sixteen bits lose.
    pub fn of_code(code: u32) -> Self {
        if code == FLAT {
            return Facing::Flat;
        }
        fn unpack(bits: u32) -> f64 {
            (f64::from(bits as u16 as i16) / 32767.0).max(-1.0)
        }
        let direction = octahedral::direction([unpack(code & 0xffff), unpack(code >> 16)]);
        if code & 1 == 1 { Facing::Along(direction) } else { Facing::Toward(direction) }
    }
}

/// No direction: a corner of the square.
pub const FLAT: u32 = 0x8001_8001;

/// The normal of a face, as long as twice its area.
pub fn area(positions: &[[f32; 3]], corners: &[u16; 3]) -> [f64; 3] {
    let [a, b, c] = corners.map(|v| Vector3::from(positions[usize::from(v)].map(f64::from)));
    (b - a).cross(&(c - a)).into()
}

/// Which way each vertex of a mesh faces.
pub fn facings(positions: &[[f32; 3]], triangles: &[[u16; 3]]) -> Vec<Facing> {
    // Faces vertex by vertex: where those of each end, and below that, where they begin.
    let mut ends = vec![0_usize; positions.len()];
    triangles.as_flattened().iter().for_each(|vertex| ends[usize::from(*vertex)] += 1);
    let mut sum = 0;
    for end in &mut ends {
        sum += *end;
        *end = sum - *end;
    }
    let mut areas = vec![[0.0; 3]; sum];
    for corners in triangles {
        let area = area(positions, corners);
        for vertex in corners {
            let place = &mut ends[usize::from(*vertex)];
            areas[*place] = area;
            *place += 1;
        }
    }
    let begins = std::iter::once(0).chain(ends.iter().copied());
    begins.zip(&ends).map(|(begin, end)| Facing::of_faces(&areas[begin..*end])).collect()
}

fn unit(v: Vector3<f64>) -> Option<Vector3<f64>> {
    let longest = v.amax();
    let even = v / longest;
    (longest > 0.0 && longest.is_finite()).then(|| even / even.norm())
}

/// Sums of the areas of faces that are smooth with one another, by one after the other; in the order of their first faces, without needles.
fn groups(faces: &[(Vector3<f64>, Vector3<f64>)]) -> Vec<Vector3<f64>> {
    let mut of: Vec<usize> = (0..faces.len()).collect();
    for (face, (normal, _)) in faces.iter().enumerate() {
        for before in 0..face {
            let (own, other) = (of[face], of[before]);
            if own != other && normal.dot(&faces[before].0) > CREASE {
                let (low, high) = (own.min(other), own.max(other));
                of.iter_mut().filter(|group| **group == high).for_each(|group| *group = low);
            }
        }
    }
    let all: f64 = faces.iter().map(|(_, area)| area.norm()).sum();
    let of = &of;
    let members =
        |first: usize| faces.iter().zip(of).filter(move |(_, of)| **of == first).map(|((_, area), _)| area);
    let is_needle = |first: &usize| {
        members(*first).count() <= 2 && members(*first).map(|area| area.norm()).sum::<f64>() < NEEDLE * all
    };
    let firsts = (0..faces.len()).filter(|face| of[*face] == *face);
    firsts.filter(|first| !is_needle(first)).map(|first| members(first).sum()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Normal at a vertex that a shader makes of a face's normal.
    fn made(facing: Facing, face: [f64; 3]) -> Vector3<f64> {
        Vector3::from(facing.of_plane(Vector3::from(face).normalize().into())).normalize()
    }

    fn side(degrees: f64) -> [f64; 3] {
        let angle = degrees.to_radians();
        [angle.cos(), angle.sin(), 0.0]
    }

    #[test]
    fn a_smooth_vertex_has_the_mean() {
        let Facing::Toward(n) = Facing::of_faces(&[side(-15.0), side(15.0)]) else { panic!("not smooth") };
        assert!((Vector3::from(n) - Vector3::x()).norm() < 1e-12);
        // One after the other they go around a corner of any angle.
        let around = Facing::of_faces(&[side(0.0), side(90.0), side(30.0), side(60.0)]);
        assert!(matches!(around, Facing::Toward(_)), "{around:?}");
        assert_eq!(Facing::of_faces(&[[0.0; 3]]), Facing::Flat);
        assert_eq!(Facing::of_faces(&[]), Facing::Flat);
        // Whatever the size.
        let tiny = Facing::of_faces(&[[1e-200, 0.0, 0.0], [0.0, 0.0, 0.0]]);
        assert_eq!(tiny, Facing::Toward([1.0, 0.0, 0.0]));
    }

    /// The rim of a cylinder: its side is round, its cap is flat.
    #[test]
    fn a_crease_keeps_both_sides_and_rounds_along_it() {
        let cap = [0.0, 0.0, 1.0];
        let rim = Facing::of_faces(&[side(-11.0), cap, side(11.0)]);
        assert!(matches!(rim, Facing::Along(_)), "{rim:?}");
        for face in [side(-11.0), side(11.0)] {
            assert!((made(rim, face) - Vector3::x()).norm() < 1e-12, "the same for both faces of the side");
        }
        assert!((made(rim, cap) - Vector3::z()).norm() < 1e-12);
        // A chamfer has the same line.
        let chamfer = Facing::of_faces(&[side(0.0), [1.0, 0.0, 1.0], cap]);
        assert_eq!(made(chamfer, cap), Vector3::z());
        assert!(matches!(chamfer, Facing::Along(_)), "{chamfer:?}");
    }

    #[test]
    fn a_needle_makes_no_crease() {
        let needle = side(90.0).map(|x| 0.02 * x);
        let smooth = Facing::of_faces(&[side(0.0), needle, side(10.0)]);
        assert!(matches!(smooth, Facing::Toward(_)), "{smooth:?}");
        // Of more faces, it is the edge of a thin plate.
        let edge = Facing::of_faces(&[side(0.0), needle, needle, needle, side(10.0)]);
        assert!(matches!(edge, Facing::Along(_)), "{edge:?}");
    }

    #[test]
    fn corners_stay_and_sheets_have_two_sides() {
        let corner = Facing::of_faces(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        assert_eq!(corner, Facing::Flat);
        // Whichever way its faces go around, a sheet has one plane.
        let sheet = Facing::of_faces(&[[0.0, 0.1, 1.0], [0.0, 0.1, -1.0]]);
        for face in [[0.0, 0.1, 1.0], [0.0, 0.1, -1.0]] {
            assert!(made(sheet, face).z.abs() > 0.999, "{sheet:?}");
        }
        let many: Vec<[f64; 3]> = (0..200).map(|face| side(f64::from(face))).collect();
        assert_eq!(Facing::of_faces(&many), Facing::Flat);
    }

    /// The order of faces decides nothing but the last bits of sums.
    #[test]
    fn whatever_the_order_of_faces() {
        let faces = [side(0.0), side(30.0), [0.0, 0.0, 2.0], side(60.0), [0.1, 0.0, 1.0]];
        let turned = |by: usize| {
            let mut faces = faces;
            faces.rotate_left(by);
            Facing::of_faces(&faces)
        };
        for by in 0..faces.len() {
            for face in faces {
                assert!((made(turned(by), face) - made(turned(0), face)).norm() < 1e-9, "{by}");
            }
        }
    }

    #[test]
    fn codes_keep_directions() {
        let decode = |code: u32| match Facing::of_code(code) {
            Facing::Toward(way) | Facing::Along(way) => Vector3::from(way),
            Facing::Flat => panic!("a direction"),
        };
        for (x, y, z) in
            [(1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.3, -0.5, -0.2), (-1e-6, -1e-6, -1.0), (-0.1, 0.0, 0.3)]
        {
            let way = Vector3::<f64>::new(x, y, z).normalize();
            for (facing, crease) in [(Facing::Toward(way.into()), 0), (Facing::Along(way.into()), 1)] {
                let code = facing.code();
                assert!((decode(code) - way).norm() < 2e-4, "{way:?}");
                assert!(code & 1 == crease && code != FLAT, "{facing:?}");
            }
        }
        assert_eq!((Facing::Flat.code(), Facing::of_normal([0.0; 3]).code()), (FLAT, FLAT));
    }
}
