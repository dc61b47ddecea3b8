//! A place on the earth, and the frame there: east, north, up.

use crate::crs::Crs;
use crate::report::count;
use clap::ValueEnum;
use std::str::FromStr;

/// Longitude and latitude in degrees, and height above the ellipsoid of WGS 84 in metres.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Georeference {
    longitude: f64,
    latitude: f64,
    height: f64,
}

/// Half of the equator's diameter in metres, and the square of the meridian's eccentricity (WGS 84).
const EQUATOR: f64 = 6_378_137.0;
const ECCENTRICITY: f64 = 6.694_379_990_141_316_5e-3;

/// Metres beyond which a model is not where it was meant to be: from its place along the ground, or from the ellipsoid.
const NEAR: f64 = 100e3;

/// How far a model is from where it was put, in metres.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Far {
    /// From the place to the nearest of it.
    pub(crate) away: f64,
    /// From the ellipsoid to the farthest of it; negative below it.
    pub(crate) height: f64,
}

/// Which point of a model is at its place.
#[derive(ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum At {
    /// Where its coordinates are zero: for those that are metres from the place
    Zero,
    /// The middle of its box: for projected coordinates (UTM, national grids), whose zero point is far away
    #[value(alias = "center")]
    Centre,
}

/// A model on the earth.
#[derive(Clone, Debug)]
pub(crate) struct Placed {
    /// From the model, z upward, to earth-centred coordinates, column by column.
    pub(crate) matrix: [f64; 16],
    /// Where it is by its coordinates, if these are of a system.
    pub(crate) crs: Option<Crs>,
    /// Where that is not on the ground.
    pub(crate) warning: Option<String>,
}

impl Placed {
    /// Longitude and latitude in degrees, and height above the ellipsoid, of a point of the model.
    pub(crate) fn geodetic(&self, point: [f64; 3]) -> [f64; 3] {
        match &self.crs {
            // The whole box was looked at when it was placed.
            Some(crs) => crs.geodetic(point).unwrap_or([f64::NAN; 3]),
            None => geodetic(applied(&self.matrix, point)),
        }
    }
}

fn applied(matrix: &[f64; 16], [x, y, z]: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|row| matrix[row] * x + matrix[4 + row] * y + matrix[8 + row] * z + matrix[12 + row])
}

impl Georeference {
    /// Puts a model here, whose box has these corners.
    pub(crate) fn place(self, at: At, corners: [[f64; 3]; 2]) -> Placed {
        let [min, max] = corners;
        let about = match at {
            At::Zero => [0.0; 3],
            At::Centre => std::array::from_fn(|axis| min[axis].midpoint(max[axis])),
        };
        let warning = self.far(about, corners).map(|Far { away, height }| {
            let [away, to] = [away, height.abs()].map(|metres| count((metres / 1e3).round() as u64));
            let side = if height < 0.0 { "below" } else { "above" };
            let remedy = match at {
                At::Zero => {
                    "projected coordinates (UTM, national grids) have their zero point far away, and take --origin-at centre; a unit has to be a metre"
                }
                At::Centre => "a unit has to be a metre",
            };
            format!("the model begins {away} km from its --origin, and reaches {to} km {side} the ellipsoid: {remedy}")
        });
        Placed { matrix: self.frame_about(about), crs: None, warning }
    }

    /// Matrix from metres to the east, to the north and upward from here to earth-centred coordinates, column by column.
    pub(crate) fn frame(self) -> [f64; 16] {
        frame_at([self.longitude, self.latitude, self.height])
    }
}

/// Matrix from metres to the east, to the north and upward from a place, in degrees and metres, to earth-centred coordinates, column by column.
pub(crate) fn frame_at(place: [f64; 3]) -> [f64; 16] {
    let [(so, co), (sa, ca)] = [place[0], place[1]].map(|degrees| degrees.to_radians().sin_cos());
    let [x, y, z] = earth_centred(place);
    [-so, co, 0.0, 0.0, -sa * co, -sa * so, ca, 0.0, ca * co, ca * so, sa, 0.0, x, y, z, 1.0]
}

/// Coordinates about the middle of the earth of a place, in degrees and metres above the ellipsoid.
pub(crate) fn earth_centred([longitude, latitude, height]: [f64; 3]) -> [f64; 3] {
    let [(so, co), (sa, ca)] = [longitude, latitude].map(|degrees: f64| degrees.to_radians().sin_cos());
    let across = EQUATOR / (1.0 - ECCENTRICITY * sa * sa).sqrt();
    let level = (across + height) * ca;
    [level * co, level * so, (across * (1.0 - ECCENTRICITY) + height) * sa]
}

impl Georeference {
    /// The frame in which `[x, y, z]` to the east, the north and upward is at this place.
    pub(crate) fn frame_about(self, [x, y, z]: [f64; 3]) -> [f64; 16] {
        let mut frame = self.frame();
        for row in 0..3 {
            frame[12 + row] -= frame[row] * x + frame[4 + row] * y + frame[8 + row] * z;
        }
        frame
    }

    /// Whether what lies between two corners in that frame is somewhere else than on the earth or near the place: how far.
    pub(crate) fn far(self, about: [f64; 3], [min, max]: [[f64; 3]; 2]) -> Option<Far> {
        let frame = self.frame_about(about);
        let outside: [f64; 3] =
            std::array::from_fn(|axis| (min[axis] - about[axis]).max(about[axis] - max[axis]).max(0.0));
        let away = outside[0].hypot(outside[1]);
        let heights = (0..8).map(|corner| {
            let [x, y, z]: [f64; 3] =
                std::array::from_fn(|axis| if corner >> axis & 1 == 0 { min[axis] } else { max[axis] });
            geodetic(applied(&frame, [x, y, z]))[2]
        });
        let height = heights.fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
        (away > NEAR || height.abs() > NEAR).then_some(Far { away, height })
    }
}

/// Longitude and latitude in degrees and height above the ellipsoid of earth-centred coordinates, by Bowring's formula; repeated, since its error grows with
/// the height.
fn geodetic([x, y, z]: [f64; 3]) -> [f64; 3] {
    let flat = (1.0 - ECCENTRICITY).sqrt();
    let level = x.hypot(y);
    let mut reduced = (z / flat).atan2(level);
    let mut latitude = 0.0_f64;
    for _ in 0..3 {
        let (s, c) = reduced.sin_cos();
        let rise = z + ECCENTRICITY / flat * EQUATOR * s.powi(3);
        latitude = rise.atan2(level - ECCENTRICITY * EQUATOR * c.powi(3));
        reduced = (flat * latitude.sin()).atan2(latitude.cos());
    }
    let (s, c) = latitude.sin_cos();
    let height = level * c + z * s - EQUATOR * (1.0 - ECCENTRICITY * s * s).sqrt();
    [y.atan2(x).to_degrees(), latitude.to_degrees(), height]
}

/// Numbers with commas between them.
fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let all: Option<Vec<f64>> =
        text.split(',').map(|number| number.trim().parse().ok().filter(|x: &f64| x.is_finite())).collect();
    all?.try_into().ok()
}

impl FromStr for Georeference {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match numbers(text) {
            Some([longitude, latitude, height]) if longitude.abs() <= 360.0 && latitude.abs() <= 90.0 => {
                Ok(Georeference { longitude, latitude, height })
            }
            _ => Err(format!(
                "'{text}' is no place: expected degrees of longitude and latitude, and metres, as in 13.4,52.5,34"
            )),
        }
    }
}

/// Sixteen numbers, column by column, of which the last row is 0, 0, 0, 1.
pub(crate) fn transform(text: &str) -> Result<[f64; 16], String> {
    fn is_affine(m: &[f64; 16]) -> bool {
        [m[3], m[7], m[11], m[15]] == [0.0, 0.0, 0.0, 1.0]
    }
    numbers(text).filter(is_affine).ok_or_else(|| {
        format!("'{text}' is no transform: expected 16 numbers, column by column, as in 1,0,0,0,0,1,0,0,0,0,1,0,DX,DY,DZ,1")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_stand_upright_where_they_should() {
        let frame = |text: &str| text.parse::<Georeference>().unwrap().frame();
        let near = |got: [f64; 16], expected: [f64; 16]| {
            let apart = got.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(apart < 1e-3, "{got:?}");
        };
        let gulf = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 6_378_237.0, 0.0, 0.0, 1.0];
        near(frame("0,0,100"), gulf);
        let pole = frame("0,90,0");
        near(
            pole,
            [0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 6_356_752.314_2, 1.0],
        );
        // Berlin's television tower, by another program.
        let [.., x, y, z, _] = frame("13.409419,52.520803,40");
        let apart = [x - 3_782_916.0, y - 901_891.0, z - 5_038_376.0].map(f64::abs);
        assert!(apart.iter().all(|x| *x < 2500.0), "{x} {y} {z}");
        for bad in ["", "1,2", "1,2,3,4", "1,91,0", "400,0,0", "nan,0,0", "a,b,c"] {
            assert!(bad.parse::<Georeference>().is_err(), "{bad}");
        }
    }

    #[test]
    fn places_on_the_ellipsoid_come_back() {
        for (longitude, latitude) in [(0.0, 0.0), (13.4, 52.5), (-120.0, -33.0), (5.0, 89.999), (0.0, -90.0)]
        {
            for told in [-12e3, -430.0, 0.0, 34.0, 8_848.0, 400e3, 36e6] {
                let [.., x, y, z, _] = Georeference { longitude, latitude, height: told }.frame();
                let [east, north, found] = geodetic([x, y, z]);
                assert!((found - told).abs() < 1e-3 + 1e-7 * told.abs(), "{latitude} {told} {found}");
                assert!((north - latitude).abs() < 1e-8, "{latitude} {told} {north}");
                assert!(latitude.abs() == 90.0 || (east - longitude).abs() < 1e-9, "{longitude} {east}");
            }
        }
    }

    #[test]
    fn what_is_far_from_the_place_is_told() {
        let place: Georeference = "13.4,52.5,34".parse().unwrap();
        let boxes = |at: [f64; 3], size: f64| [at, at.map(|x| x + size)];
        assert_eq!(place.far([0.0; 3], boxes([-50e3; 3], 99e3)), None);
        // By the radius at that latitude, 6,376,127 metres in that direction.
        let [min, max] = boxes([390e3, 5_820e3, 30.0], 500.0);
        let far = place.far([0.0; 3], [min, max]).unwrap();
        assert!((far.away - 5_833_052.0).abs() < 1.0 && (far.height - 2.27e6).abs() < 1e4, "{far:?}");
        let middle = std::array::from_fn(|axis| (min[axis] + max[axis]) / 2.0);
        assert_eq!(place.far(middle, [min, max]), None);
        let [.., x, y, z, _] = place.frame_about(middle);
        let frame = place.frame();
        let back: [f64; 3] = std::array::from_fn(|row| {
            frame[row] * middle[0] + frame[4 + row] * middle[1] + frame[8 + row] * middle[2] + [x, y, z][row]
        });
        assert!(back.iter().zip(&frame[12..]).all(|(a, b)| (a - b).abs() < 1e-6));
        // In millimetres, it would reach into space; on the equator, false eastings alone are near the ground.
        assert!(place.far([0.0; 3], boxes([0.0; 3], 500e3)).unwrap().away == 0.0);
        assert!(place.far([0.0; 3], boxes([500e3, 0.0, 0.0], 100.0)).unwrap().height < 100e3);
    }

    #[test]
    fn transforms_are_affine() {
        assert!(transform("1,0,0,0,0,1,0,0,0,0,1,0,5,6,7,1").is_ok());
        for bad in ["1,2,3", "1,0,0,0,0,1,0,0,0,0,1,0,5,6,7,2", "1,0,0,1,0,1,0,0,0,0,1,0,5,6,7,1", "x"] {
            assert!(transform(bad).is_err(), "{bad}");
        }
    }
}
