//! The longest frame of a moving path whose pages come from the disk: the system's cache of the file is dropped before each round.

use crate::film::{Film, Shot, median, ms};
use chpm_refine::CameraPath;
use chpm_viewer::{Accuracy, FrameRequest, Gpu};
use std::error::Error;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;

const FRAMES: usize = 150;
/// Frames until what the first view wants is there.
const WARM_UP: usize = 30;
const ROUNDS: usize = 3;
const VIEWPORT: [u32; 2] = [512, 512];
/// Pixels of error: few enough triangles that reading shows beside drawing.
const POE: f64 = 4.0;

/// A row for each path; times of whole frames, and of the thread that asks for them.
pub(crate) fn run(gpu: &Arc<Gpu>, path: &Path) -> Result<(), Box<dyn Error>> {
    println!(
        "path,width,height,frames,requested_bytes,uploaded_bytes,median_ms,longest_ms,longest_by_median,thread_median_ms,thread_longest_ms,upload_longest_ms"
    );
    for name in ["dive", "random"] {
        let mut rounds = Vec::new();
        for _ in 0..ROUNDS {
            rounds.push(go(gpu, path, name)?);
        }
        let all = |of: fn(&Shot) -> f64, join: fn(Vec<f64>) -> f64| {
            median(rounds.iter().map(|shots| join(shots.iter().map(of).collect())))
        };
        let most = |values: Vec<f64>| values.into_iter().fold(0.0, f64::max);
        let sum = |values: Vec<f64>| values.into_iter().sum();
        let whole: fn(&Shot) -> f64 = |shot| shot.ms;
        let thread: fn(&Shot) -> f64 = |shot| ms(shot.stats.times.total);
        println!(
            "{name},{},{},{},{:.0},{:.0},{:.2},{:.2},{:.2},{:.3},{:.3},{:.3}",
            VIEWPORT[0],
            VIEWPORT[1],
            FRAMES - WARM_UP,
            all(|shot| shot.stats.requested_bytes as f64, sum),
            all(|shot| shot.stats.uploaded_bytes as f64, sum),
            all(whole, median),
            all(whole, most),
            all(whole, most) / all(whole, median),
            all(thread, median),
            all(thread, most),
            all(|shot| ms(shot.stats.times.upload), most),
        );
    }
    Ok(())
}

fn go(gpu: &Arc<Gpu>, path: &Path, name: &str) -> Result<Vec<Shot>, Box<dyn Error>> {
    let dropped = Command::new("dd")
        .arg(format!("if={}", path.display()))
        .args(["iflag=nocache", "count=0"])
        .output()?;
    if !dropped.status.success() {
        return Err("dd did not drop the cache".into());
    }
    let mut film = Film::open(gpu, path)?;
    let bounds = film.viewer.bounds();
    let root = film.viewer.file().roots().next().ok_or("no root")?;
    let point = film.viewer.file().page(root)?.positions[0].map(f64::from);
    let way = match name {
        "dive" => CameraPath::dive(&bounds, point, FRAMES),
        _ => CameraPath::random(&bounds, 3, FRAMES),
    };
    let mut shots = Vec::new();
    for camera in &way.cameras[..FRAMES] {
        let camera = camera.relative_to(film.viewer.origin().map(|x| -x));
        let request = FrameRequest { accuracy: Accuracy::PoE(POE), ..FrameRequest::new(camera, VIEWPORT) };
        shots.push(film.shoot(&request)?);
    }
    Ok(shots.split_off(WARM_UP))
}
