//! Cost of pages that come from the disk on a moving path, frame by frame: cold (the system's cache of the file is dropped before each
//! round), warm (it is in that cache), and resident (all that the path draws is on the GPU beforehand). A resident frame's time is the
//! path's own; the rest of another's is due to I/O.

use crate::film::{Film, Shot, median, ms};
use chpm_refine::{Camera, CameraPath};
use chpm_viewer::{Accuracy, FrameRequest, Gpu};
use std::error::Error;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;

const FRAMES: usize = 150;
/// Frames until what the first view wants is there.
const WARM_UP: usize = 30;
const ROUNDS: usize = 5;
const VIEWPORT: [u32; 2] = [512, 512];
/// Pixels of error: few enough triangles that reading shows beside drawing.
const POE: f64 = 4.0;

/// Where pages are before a round.
const STATES: [&str; 3] = ["resident", "warm", "cold"];

/// By frame, medians over the rounds.
struct Course {
    ms: Vec<f64>,
    triangles: Vec<f64>,
    thread_ms: Vec<f64>,
    upload_ms: Vec<f64>,
    requested: f64,
    uploaded: f64,
}

/// A row for each path and state; times of whole frames, and of the thread that asks for them.
pub(crate) fn run(gpu: &Arc<Gpu>, path: &Path) -> Result<(), Box<dyn Error>> {
    println!(
        "path,state,width,height,poe,frames,triangles,requested_bytes,uploaded_bytes,median_ms,longest_ms,longest_by_median,over_twice,over_twice_if_resident,most_by_resident,most_beyond_resident_by_median,mean_beyond_resident_ms,thread_median_ms,thread_longest_ms,upload_longest_ms"
    );
    for name in ["dive", "random"] {
        let mut rounds: [Vec<Vec<Shot>>; 3] = Default::default();
        for _ in 0..ROUNDS {
            for (state, rounds) in STATES.iter().zip(&mut rounds) {
                rounds.push(go(gpu, path, name, state)?);
            }
        }
        let courses = rounds.map(|rounds| Course::of(&rounds));
        for (state, course) in STATES.iter().zip(&courses) {
            println!("{name},{state},{},{},{POE},{}", VIEWPORT[0], VIEWPORT[1], course.row(&courses[0]));
        }
    }
    Ok(())
}

impl Course {
    fn of(rounds: &[Vec<Shot>]) -> Self {
        let frames = |of: fn(&Shot) -> f64| -> Vec<f64> {
            (0..FRAMES - WARM_UP).map(|frame| median(rounds.iter().map(|shots| of(&shots[frame])))).collect()
        };
        let sum = |of: fn(&Shot) -> f64| median(rounds.iter().map(|shots| shots.iter().map(of).sum()));
        Course {
            ms: frames(|shot| shot.ms),
            triangles: frames(|shot| shot.stats.triangles as f64),
            thread_ms: frames(|shot| ms(shot.stats.times.total)),
            upload_ms: frames(|shot| ms(shot.stats.times.upload)),
            requested: sum(|shot| shot.stats.requested_bytes as f64),
            uploaded: sum(|shot| shot.stats.uploaded_bytes as f64),
        }
    }

    fn row(&self, resident: &Course) -> String {
        let most = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
        let middle = median(self.ms.iter().copied());
        let longest = most(&mut self.ms.iter().copied());
        let pairs = || self.ms.iter().zip(&resident.ms);
        // Frames that are longer than twice the median, and how many of those are where nothing is read either.
        let own = median(resident.ms.iter().copied());
        let long = || pairs().filter(|(ms, _)| **ms > 2.0 * middle);
        let both = long().filter(|(_, resident)| **resident > 2.0 * own).count();
        let beyond: f64 = pairs().map(|(ms, resident)| ms - resident).sum();
        format!(
            "{},{:.0},{:.0},{:.0},{middle:.2},{longest:.2},{:.2},{},{both},{:.2},{:.2},{:.2},{:.3},{:.3},{:.3}",
            self.ms.len(),
            self.triangles.iter().sum::<f64>() / self.ms.len() as f64,
            self.requested,
            self.uploaded,
            longest / middle,
            long().count(),
            most(&mut pairs().map(|(ms, resident)| ms / resident)),
            most(&mut pairs().map(|(ms, resident)| ms - resident)) / middle,
            beyond / self.ms.len() as f64,
            median(self.thread_ms.iter().copied()),
            most(&mut self.thread_ms.iter().copied()),
            most(&mut self.upload_ms.iter().copied()),
        )
    }
}

fn go(gpu: &Arc<Gpu>, path: &Path, name: &str, state: &str) -> Result<Vec<Shot>, Box<dyn Error>> {
    if state == "cold" {
        let dropped = Command::new("dd")
            .arg(format!("if={}", path.display()))
            .args(["iflag=nocache", "count=0"])
            .output()?;
        if !dropped.status.success() {
            return Err("dd did not drop the cache".into());
        }
    }
    let mut film = Film::open(gpu, path)?;
    let bounds = film.viewer.bounds();
    let way = match name {
        "dive" => CameraPath::dive(&bounds, film.point()?, FRAMES),
        _ => CameraPath::random(&bounds, 3, FRAMES),
    };
    let origin = film.viewer.origin().map(|x| -x);
    let request = |camera: &Camera| FrameRequest {
        accuracy: Accuracy::PoE(POE),
        ..FrameRequest::new(camera.relative_to(origin), VIEWPORT)
    };
    let cameras = &way.cameras[..FRAMES];
    if state == "resident" {
        for camera in cameras {
            film.shoot(&FrameRequest { wait: true, occlusion_culling: false, ..request(camera) })?;
        }
        // Back at the beginning.
        film.converge(&request(&cameras[0]))?;
    }
    let shots = cameras.iter().map(|camera| film.shoot(&request(camera)));
    Ok(shots.collect::<Result<Vec<_>, _>>()?.split_off(WARM_UP))
}
