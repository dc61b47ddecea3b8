//! Cameras and images on the command line.

use crate::number;
use anyhow::{Context, Result, ensure};
use chpm_extmem::{MappedFile, read_text};
use chpm_format::Chpm;
use chpm_mesh::Bytes;
use chpm_refine::{Camera, CameraPath, View};
use std::fmt;
use std::path::Path;
use std::str::FromStr;

/// The image and what is allowed in it, but for the pixels of error.
#[derive(clap::Args, Clone, Copy, Debug)]
pub(crate) struct ImageArgs {
    /// Width and height of the image, in pixels
    #[arg(long, value_name = "WxH", default_value_t = Viewport([512, 512]))]
    pub(crate) viewport: Viewport,
    /// Leave what is outside the image as coarse as it gets
    #[arg(long)]
    pub(crate) cull: bool,
}

impl ImageArgs {
    /// View of a file by a camera in the source's coordinates.
    pub(crate) fn view(&self, file: &Chpm<MappedFile>, camera: &Camera, pixels: f64) -> Result<View> {
        let camera = camera.relative_to(file.header().origin);
        let view = View::new(&camera, self.viewport.0, pixels)
            .with_context(|| format!("cannot look at '{}' so", file.get_ref().path().display()))?;
        Ok(view.with_culling(self.cull))
    }
}

/// Most bytes of a file of cameras.
const MOST_PATH: Bytes = Bytes::mib(64);

/// A file of cameras.
pub(crate) fn read_path(path: &Path) -> Result<CameraPath> {
    let name = path.display();
    let text = read_text(path, MOST_PATH.0).with_context(|| format!("cannot read '{name}'"))?;
    let path: CameraPath = text.parse().with_context(|| format!("cannot read '{name}'"))?;
    ensure!(!path.cameras.is_empty(), "'{name}' has no camera; make a path with chpm path");
    Ok(path)
}

/// The camera that looks at a whole model, in the source's coordinates.
pub(crate) fn framing(file: &Chpm<MappedFile>) -> Camera {
    from_file(file, &Camera::framing(&file.header().aabb()))
}

/// A camera in file coordinates, in the source's.
pub(crate) fn from_file(file: &Chpm<MappedFile>, camera: &Camera) -> Camera {
    camera.relative_to(file.header().origin.map(|x| -x))
}

/// `512x512`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Viewport(pub(crate) [u32; 2]);

impl fmt::Display for Viewport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.0[0], self.0[1])
    }
}

impl FromStr for Viewport {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        fn size(text: &str) -> Option<u32> {
            text.parse().ok().filter(|n| *n > 0)
        }
        let sizes = text.split_once('x').and_then(|(w, h)| Some(Viewport([size(w)?, size(h)?])));
        sizes.ok_or_else(|| {
            format!("'{text}' is no viewport: write width and height in pixels, as in 1920x1080")
        })
    }
}

/// `px,py,pz,tx,ty,tz` or with the field of view behind.
pub(crate) fn camera(text: &str) -> Result<Camera, String> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|n| n.trim().parse().ok().filter(|n: &f64| n.is_finite())).collect();
    let (numbers, fov) = match numbers.as_deref() {
        Some([six @ .., fov]) if six.len() == 6 => (six.to_vec(), *fov),
        Some(six) if six.len() == 6 => (six.to_vec(), Camera::DEFAULT_FOV),
        _ => return Err(format!("'{text}' is no camera: write px,py,pz,tx,ty,tz or px,py,pz,tx,ty,tz,fov")),
    };
    fn point(from: usize, numbers: &[f64]) -> [f64; 3] {
        std::array::from_fn(|axis| numbers[from + axis])
    }
    Ok(Camera { fov, ..Camera::looking(point(0, &numbers), point(3, &numbers)) })
}

/// Pixels of error: a finite number that is not negative.
pub(crate) fn pixels(text: &str) -> Result<f64, String> {
    number::decimal(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_are_six_or_seven_numbers() {
        let six = camera("-1,2.5,3e1, 0,0,0").unwrap();
        assert_eq!((six.position, six.target, six.fov), ([-1.0, 2.5, 30.0], [0.0; 3], 45.0));
        assert_eq!(camera("1,2,3,4,5,6,7").unwrap(), Camera { fov: 7.0, ..camera("1,2,3,4,5,6").unwrap() });
        for bad in ["", "1,2,3", "1,2,3,4,5,x", "1,2,3,4,5,6,7,8", "1,2,3,4,5,inf"] {
            assert!(camera(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn viewports_are_two_sizes() {
        assert_eq!("640x480".parse::<Viewport>().unwrap().to_string(), "640x480");
        for bad in ["", "640", "0x480", "640x", "640x-1", "1x2x3"] {
            assert!(bad.parse::<Viewport>().is_err(), "{bad}");
        }
    }

    #[test]
    fn pixels_are_not_negative() {
        assert_eq!(pixels("0.5"), Ok(0.5));
        assert!(["-1", "nan", "inf", "many"].iter().all(|bad| pixels(bad).is_err()));
    }
}
