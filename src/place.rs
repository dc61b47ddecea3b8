//! A place on the earth, and the frame there: east, north, up.

use std::str::FromStr;

/// Longitude and latitude in degrees, and height above the ellipsoid of WGS 84 in metres.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Place {
    longitude: f64,
    latitude: f64,
    height: f64,
}

/// Half of the equator's diameter in metres, and the square of the meridian's eccentricity (WGS 84).
const EQUATOR: f64 = 6_378_137.0;
const ECCENTRICITY: f64 = 6.694_379_990_141_316_5e-3;

impl Place {
    /// What takes metres to the east, to the north and upward from here to earth-centred coordinates, column by column.
    pub(crate) fn frame(self) -> [f64; 16] {
        let ((so, co), (sa, ca)) =
            (self.longitude.to_radians().sin_cos(), self.latitude.to_radians().sin_cos());
        let across = EQUATOR / (1.0 - ECCENTRICITY * sa * sa).sqrt();
        let level = (across + self.height) * ca;
        let (x, y, z) = (level * co, level * so, (across * (1.0 - ECCENTRICITY) + self.height) * sa);
        [-so, co, 0.0, 0.0, -sa * co, -sa * so, ca, 0.0, ca * co, ca * so, sa, 0.0, x, y, z, 1.0]
    }
}

/// Numbers with commas between them.
fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let all: Option<Vec<f64>> =
        text.split(',').map(|number| number.trim().parse().ok().filter(|x: &f64| x.is_finite())).collect();
    all?.try_into().ok()
}

impl FromStr for Place {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match numbers(text) {
            Some([longitude, latitude, height]) if longitude.abs() <= 360.0 && latitude.abs() <= 90.0 => {
                Ok(Place { longitude, latitude, height })
            }
            _ => Err(format!(
                "'{text}' is no place: expected degrees of longitude and latitude, and metres, as in 13.4,52.5,34"
            )),
        }
    }
}

/// Sixteen numbers, column by column, of which the last row is 0, 0, 0, 1.
pub(crate) fn transform(text: &str) -> Result<[f64; 16], String> {
    let is_affine = |m: &[f64; 16]| [m[3], m[7], m[11], m[15]] == [0.0, 0.0, 0.0, 1.0];
    numbers(text).filter(is_affine).ok_or_else(|| {
        format!("'{text}' is no transform: expected 16 numbers, column by column, as in 1,0,0,0,0,1,0,0,0,0,1,0,DX,DY,DZ,1")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_stand_upright_where_they_should() {
        let frame = |text: &str| text.parse::<Place>().unwrap().frame();
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
            assert!(bad.parse::<Place>().is_err(), "{bad}");
        }
    }

    #[test]
    fn transforms_are_affine() {
        assert!(transform("1,0,0,0,0,1,0,0,0,0,1,0,5,6,7,1").is_ok());
        for bad in ["1,2,3", "1,0,0,0,0,1,0,0,0,0,1,0,5,6,7,2", "1,0,0,1,0,1,0,0,0,0,1,0,5,6,7,1", "x"] {
            assert!(transform(bad).is_err(), "{bad}");
        }
    }
}
