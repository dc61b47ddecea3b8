//! Refinement and occlusion of some 10,000 active clusters, of a made-up file.

use crate::film::{Film, Shot, median, ms};
use crate::plane;
use chpm_refine::{Camera, Hierarchy, View, select};
use chpm_viewer::{Accuracy, FrameRequest, Gpu, Stats};
use std::error::Error;
use std::sync::Arc;
use std::time::Duration;

const FRAMES: usize = 15;

pub(crate) fn run(gpu: &Arc<Gpu>) -> Result<(), Box<dyn Error>> {
    let file = plane::file()?;
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("plane.chpm");
    std::fs::write(&path, file.bytes())?;
    let mut film = Film::open(gpu, &path)?;
    // All of the plane is in the image, and nothing hides it.
    let camera = Camera { fov: 90.0, ..Camera::looking([64.0, 0.0, 80.0], [64.0, 60.0, 0.0]) };
    let hierarchy = Hierarchy::new(&file);
    let mut pixels = 1.0;
    let count = |pixels| {
        let view = View::new(&camera, [256, 256], pixels)?;
        select(&file, &hierarchy, &view).map(|cut| cut.members().len())
    };
    while count(pixels)? < 10_000 {
        pixels /= 1.01;
    }
    let request = FrameRequest { accuracy: Accuracy::PoE(pixels), ..FrameRequest::new(camera, [256, 256]) };
    for occlusion_culling in [true, false] {
        let request = FrameRequest { occlusion_culling, ..request };
        film.converge(&request)?;
        for moving in [false, true] {
            let step = |frame: usize| {
                let [x, y, z] = camera.position;
                let along = if moving { 0.01 * frame as f64 } else { 0.0 };
                FrameRequest { camera: Camera { position: [x + along, y, z], ..camera }, ..request }
            };
            let shots: Vec<Shot> = (0..FRAMES).map(|n| film.shoot(&step(n))).collect::<Result<_, _>>()?;
            let part = |of: fn(&Stats) -> Duration| median(shots.iter().map(|shot| ms(of(&shot.stats))));
            println!(
                "{} active clusters, {} drawn, occlusion culling {occlusion_culling}, moving {moving}: refine {:.3} ms, occlusion {:.3} ms, draw list {:.3} ms, frame {:.1} ms",
                shots[FRAMES - 1].stats.clusters_active,
                shots[FRAMES - 1].stats.clusters_drawn,
                part(|s| s.times.refine),
                part(|s| s.times.occlusion),
                part(|s| s.times.pm),
                median(shots.iter().map(|shot| shot.ms))
            );
        }
    }
    Ok(())
}
