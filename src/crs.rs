//! Systems of projected coordinates (UTM, national grids) by their EPSG codes.

use crate::georeference::{Placed, earth_centred, frame_at};
use crate::number;
use anyhow::{Context, Result, anyhow, ensure};
use chpm_export::tiles::Reprojection;
use chpm_format::{Chpm, shown};
use proj4rs::Proj;
use proj4rs::transform::transform;
use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

/// A system whose x and y are lengths on a map, x mostly to the east, and whose z is a height in the same unit above the ellipsoid.
#[derive(Clone, Debug)]
pub(crate) struct Crs {
    code: u16,
    /// Metres from the ellipsoid up to where heights are zero.
    geoid: f64,
    from: Arc<Proj>,
    to: Arc<Proj>,
}

/// Degrees, on the ellipsoid of WGS 84.
const WGS_84: &str = "+proj=longlat +datum=WGS84 +no_defs";

/// Which system a model's coordinates are of.
#[derive(clap::Args, Clone, Debug)]
pub(crate) struct CrsArgs {
    /// The system that the coordinates are of, as in EPSG:32633, with z upward: it says where on the earth they are. If not given, that of `build --crs`, unless
    /// --origin is there
    #[arg(long, value_name = "EPSG:CODE", conflicts_with = "origin")]
    crs: Option<Crs>,
    /// Metres to add to heights that are not above the ellipsoid: how far above it the sea level of that place is, from -107 to 86
    #[arg(long, value_name = "METRES", allow_hyphen_values = true, value_parser = number::finite, conflicts_with = "origin")]
    geoid: Option<f64>,
}

impl CrsArgs {
    /// Whether one was typed.
    pub(crate) fn is_typed(&self) -> bool {
        self.crs.is_some()
    }

    /// The system that is typed, or that the file tells unless the model `is_elsewhere`.
    ///
    /// # Errors
    /// If the file tells a system that is not known, or there is none that heights are of.
    pub(crate) fn of<D: AsRef<[u8]>>(&self, file: &Chpm<D>, is_elsewhere: bool) -> Result<Option<Crs>> {
        let metadata = file.metadata()?;
        let own = metadata.setting(shown::CRS).filter(|_| !is_elsewhere && self.crs.is_none());
        let own = own.map(|own| own.parse::<Crs>().map_err(|error| anyhow!("the file's --crs: {error}")));
        let found = self.crs.clone().map(Ok).or(own).transpose()?;
        ensure!(found.is_some() || self.geoid.is_none(), "--geoid goes with --crs");
        Ok(found.map(|crs| Crs { geoid: self.geoid.unwrap_or(0.0), ..crs }))
    }
}

impl Crs {
    /// Metres of one unit of its coordinates.
    pub(crate) fn metres(&self) -> f64 {
        self.from.to_meter()
    }

    /// Longitude and latitude in degrees and height in metres above the ellipsoid of WGS 84 of a point; none outside of the system.
    pub(crate) fn geodetic(&self, [x, y, z]: [f64; 3]) -> Option<[f64; 3]> {
        let height = z * self.metres() + self.geoid;
        let mut point = (x, y, height);
        transform(&self.from, &self.to, &mut point).ok()?;
        // Those systems have two coordinates: heights are not above their ellipsoids, and have nothing to do with the way to another.
        let found = [point.0.to_degrees(), point.1.to_degrees(), height];
        found.iter().all(|x| x.is_finite()).then_some(found)
    }

    fn earth_centred(&self, point: [f64; 3]) -> Option<[f64; 3]> {
        self.geodetic(point).map(earth_centred)
    }

    /// The frame at the middle of a model's box, and the map to it.
    ///
    /// # Errors
    /// If a part of the box is outside of the system.
    pub(crate) fn place(&self, corners: [[f64; 3]; 2]) -> Result<(Placed, Reprojection)> {
        let [min, max] = corners;
        let middle: [f64; 3] = std::array::from_fn(|axis| min[axis].midpoint(max[axis]));
        let outside =
            || format!("{self} has no place for {middle:?}: the model's coordinates are of another system");
        let matrix = frame_at(self.geodetic(middle).with_context(outside)?);
        let own = self.clone();
        let map = move |point: [f64; 3]| {
            let there = own.earth_centred(point)?;
            let way: [f64; 3] = std::array::from_fn(|row| there[row] - matrix[12 + row]);
            Some(std::array::from_fn(|axis| (0..3).map(|row| matrix[4 * axis + row] * way[row]).sum()))
        };
        let name = if self.geoid == 0.0 { self.to_string() } else { format!("{self}, geoid {}", self.geoid) };
        let reprojection = Reprojection::new(name, corners, Arc::new(map))?;
        ensure!(!reprojection.is_mirror(), "{self} has axes to the south and west, which mirror a mesh");
        Ok((Placed { matrix, crs: Some(self.clone()), warning: None }, reprojection))
    }
}

impl fmt::Display for Crs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "EPSG:{}", self.code)
    }
}

impl FromStr for Crs {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let digits = match text.split_once(':') {
            Some((name, digits)) if name.eq_ignore_ascii_case("epsg") => digits,
            Some(_) => "",
            None => text,
        };
        let code: u16 =
            digits.parse().map_err(|_| format!("'{text}' is no code: write it as in EPSG:32633"))?;
        let known = crs_definitions::from_code(code);
        let known =
            known.ok_or_else(|| format!("EPSG:{code} is not known; --origin puts a model at a place"))?;
        let from = Proj::from_proj_string(known.proj4)
            .map_err(|error| format!("EPSG:{code} is of a kind that is not supported: {error}"))?;
        if from.is_latlong() || from.is_geocent() {
            let remedy = "reproject the model, as to UTM, or give --transform";
            return Err(format!("EPSG:{code} has no lengths on a map as its coordinates: {remedy}"));
        }
        let to = Proj::from_proj_string(WGS_84).map_err(|error| error.to_string())?;
        Ok(Crs { code, geoid: 0.0, from: Arc::new(from), to: Arc::new(to) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_where_other_programs_have_them() {
        // A point each, its place in degrees by PROJ 9, and how many metres they may be apart: national datums are shifted without grids.
        for (code, point, [longitude, latitude], metres) in [
            ("EPSG:32633", [391_779.0, 5_820_076.0], [13.404_994_930, 52.520_034_464], 1e-3),
            ("epsg:3857", [1_492_232.65, 6_894_701.26], [13.404_953_970, 52.520_007_974], 1e-3),
            ("32733", [500_000.0, 10_000_000.0], [15.0, 0.0], 1e-3),
            ("EPSG:2154", [652_000.0, 6_862_000.0], [2.345_811_959, 48.856_248_141], 1e-3),
            ("EPSG:2056", [2_600_000.0, 1_200_000.0], [7.438_632_421, 46.951_082_772], 0.1),
            ("EPSG:27700", [530_000.0, 180_000.0], [-0.128_353_940, 51.503_990_828], 0.1),
        ] {
            let crs: Crs = code.parse().unwrap();
            let [lon, lat, height] = crs.geodetic([point[0], point[1], 0.0]).unwrap();
            let across = (lon - longitude) * latitude.to_radians().cos();
            let apart = 111_320.0 * across.hypot(lat - latitude);
            assert!(apart < metres, "{code}: {lon} {lat} {height}: {apart}");
        }
        for bad in ["", "EPSG:", "ESRI:102100", "EPSG:1", "EPSG:99999", "EPSG:4326", "EPSG:4978", "utm"] {
            assert!(bad.parse::<Crs>().is_err(), "{bad}");
        }
    }

    #[test]
    fn a_mirror_image_is_refused() {
        let place = |code: &str, [x, y]: [f64; 2]| {
            let placed = code.parse::<Crs>().unwrap().place([[x, y, 0.0], [x + 100.0, y + 100.0, 10.0]]);
            placed.map_err(|error| error.to_string()).err().unwrap_or_default()
        };
        // In Slovakia, by axes to the south and west, and to the east and north.
        assert!(place("EPSG:8352", [1_280_000.0, 500_000.0]).contains("mirror"));
        assert_eq!(place("EPSG:8353", [-500_000.0, -1_280_000.0]), "");
        // In South Africa both are turned, which mirrors nothing.
        assert_eq!(place("EPSG:2048", [10_000.0, 3_700_000.0]), "");
    }

    #[test]
    fn feet_are_feet_in_height_too() {
        let [.., height] = "EPSG:2263".parse::<Crs>().unwrap().geodetic([1e6, 2e5, 1000.0]).unwrap();
        assert!((height - 304.8).abs() < 0.01, "{height}");
    }

    #[test]
    fn a_height_is_not_moved_with_the_datum() {
        for (code, x, y) in
            [(27700, 530e3, 180e3), (2056, 2.6e6, 1.2e6), (28992, 155e3, 463e3), (25832, 5e5, 5.5e6)]
        {
            let crs: Crs = format!("EPSG:{code}").parse().unwrap();
            assert_eq!(crs.geodetic([x, y, 100.0]).unwrap()[2], 100.0, "{code}");
            let crs = Crs { geoid: 46.0, ..crs };
            assert_eq!(crs.geodetic([x, y, 100.0]).unwrap()[2], 146.0, "{code} above the sea");
        }
    }
}
