//! Whole frames along a path of which everything is in memory: what refining, making triangles of the positions that move, and
//! drawing them cost.

use crate::film::{Film, Shot, mean, median, ms};
use chpm_refine::CameraPath;
use chpm_viewer::{Accuracy, FrameRequest, Gpu};
use std::error::Error;
use std::path::Path;
use std::sync::Arc;

const FRAMES: usize = 100;

/// Image and pixels of error.
const CASES: [([u32; 2], f64); 3] = [([512, 512], 1.0), ([512, 512], 4.0), ([1920, 1080], 4.0)];

/// A row for each path, case, and culling.
pub(crate) fn run(gpu: &Arc<Gpu>, path: &Path) -> Result<(), Box<dyn Error>> {
    println!(
        "path,width,height,poe,culling,frames,clusters,triangles,uploaded_bytes,thread_ms,pm_ms,processor_ms,mean_ms,median_ms,longest_ms"
    );
    for name in ["orbit", "dive"] {
        for (viewport, poe) in CASES {
            for culling in [false, true] {
                let shots = go(gpu, path, name, viewport, poe, culling)?;
                println!("{name},{},{},{poe},{culling},{FRAMES},{}", viewport[0], viewport[1], row(&shots));
            }
        }
    }
    Ok(())
}

/// The second time along a path; the first one brings everything.
fn go(
    gpu: &Arc<Gpu>,
    path: &Path,
    name: &str,
    viewport: [u32; 2],
    poe: f64,
    culling: bool,
) -> Result<Vec<Shot>, Box<dyn Error>> {
    let mut film = Film::open(gpu, path)?;
    let way = match name {
        "dive" => CameraPath::dive(&film.viewer.bounds(), film.point()?, FRAMES),
        // A quarter of the way around.
        _ => CameraPath::orbit(&film.viewer.bounds(), 4 * FRAMES),
    };
    let origin = film.viewer.origin().map(|x| -x);
    let mut shots = Vec::new();
    for _ in 0..2 {
        shots.clear();
        for camera in &way.cameras[..FRAMES] {
            shots.push(film.shoot(&FrameRequest {
                accuracy: Accuracy::PoE(poe),
                frustum_culling: culling,
                occlusion_culling: culling,
                ..FrameRequest::new(camera.relative_to(origin), viewport)
            })?);
        }
    }
    Ok(shots)
}

fn row(shots: &[Shot]) -> String {
    let mean = |of: fn(&Shot) -> f64| mean(shots.iter().map(of));
    format!(
        "{:.0},{:.0},{:.0},{:.3},{:.3},{:.2},{:.2},{:.2},{:.2}",
        mean(|shot| shot.stats.clusters_drawn as f64),
        mean(|shot| shot.stats.triangles as f64),
        mean(|shot| shot.stats.uploaded_bytes as f64),
        mean(|shot| ms(shot.stats.times.total)),
        mean(|shot| ms(shot.stats.times.pm)),
        mean(|shot| shot.processor_ms),
        mean(|shot| shot.ms),
        median(shots.iter().map(|shot| shot.ms)),
        shots.iter().map(|shot| shot.ms).fold(0.0, f64::max),
    )
}
