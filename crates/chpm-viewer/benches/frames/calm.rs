//! Cost of occlusion culling where nothing is hidden: a terrain from above, each frame with and without it in turn.

use crate::film::{Film, Shot, median};
use chpm_refine::Camera;
use chpm_viewer::{Accuracy, FrameRequest, Gpu};
use std::error::Error;
use std::path::Path;
use std::sync::Arc;

const FRAMES: usize = 64;
/// Times along each path, the first of which reads the pages and does not count.
const ROUNDS: usize = 6;

/// A camera for each frame, over the unit square, looking down: where it stands, and how high.
type Way = fn(f64) -> ([f64; 2], f64);

const STILL: Way = |_| ([0.5, 0.5], 0.8);
const DRIFT: Way = |t| ([0.35 + 0.3 * t, 0.45 + 0.1 * t], 0.6);
const SINK: Way = |t| ([0.5, 0.5], 1.4 * 0.25_f64.powf(t));

/// With image and pixels of error.
const CASES: [(&str, Way, [u32; 2], f64); 7] = [
    ("still", STILL, [512, 512], 1.0),
    ("drift", DRIFT, [512, 512], 1.0),
    ("sink", SINK, [512, 512], 1.0),
    ("drift", DRIFT, [512, 512], 4.0),
    ("sink", SINK, [512, 512], 4.0),
    ("drift", DRIFT, [1920, 1080], 4.0),
    ("sink", SINK, [1920, 1080], 4.0),
];

/// Follows the ways over a terrain, and prints a row for each.
pub(crate) fn run(gpu: &Arc<Gpu>, path: &Path) -> Result<(), Box<dyn Error>> {
    println!(
        "way,width,height,poe,frames,clusters,triangles,occluded,tested,off_ms,on_ms,time_ratio,off_processor_ms,on_processor_ms,processor_ratio,median_pair_ratio,off_longest_ms,on_longest_ms"
    );
    for (name, way, viewport, poe) in CASES {
        let row = compare(gpu, path, viewport, poe, way)?;
        println!("{name},{},{},{poe},{FRAMES},{row}", viewport[0], viewport[1]);
    }
    Ok(())
}

/// The same frames with and without, in turn. Ratios of sums are the medians of the rounds; a test now and then would not show in
/// medians of frames.
fn compare(
    gpu: &Arc<Gpu>,
    path: &Path,
    viewport: [u32; 2],
    poe: f64,
    way: Way,
) -> Result<String, Box<dyn Error>> {
    let mut films = [Film::open(gpu, path)?, Film::open(gpu, path)?];
    let mut rounds: Vec<[Vec<Shot>; 2]> = Vec::new();
    for round in 0..ROUNDS {
        let mut shots = [Vec::new(), Vec::new()];
        for frame in 0..FRAMES {
            let ([x, y], z) = way(frame as f64 / (FRAMES - 1) as f64);
            let camera = Camera::looking([x, y, z], [x, y, 0.0]);
            // Who comes first finds other caches.
            for on in [(round + frame) % 2, (round + frame + 1) % 2] {
                let request = FrameRequest {
                    accuracy: Accuracy::PoE(poe),
                    occlusion_culling: on == 1,
                    ..FrameRequest::new(camera, viewport)
                };
                shots[on].push(films[on].shoot(&request)?);
            }
        }
        if round > 0 {
            rounds.push(shots);
        }
    }
    let mean = |shots: &[Shot], of: fn(&Shot) -> f64| shots.iter().map(of).sum::<f64>() / FRAMES as f64;
    let means = |on: usize, of: fn(&Shot) -> f64| median(rounds.iter().map(|shots| mean(&shots[on], of)));
    let ratio = |of: fn(&Shot) -> f64| median(rounds.iter().map(|[off, on]| mean(on, of) / mean(off, of)));
    let pairs = rounds.iter().flat_map(|[off, on]| on.iter().zip(off).map(|(on, off)| on.ms / off.ms));
    let longest = |on: usize| {
        let longest = |shots: &[Vec<Shot>; 2]| shots[on].iter().map(|shot| shot.ms).fold(0.0, f64::max);
        median(rounds.iter().map(longest))
    };
    Ok(format!(
        "{:.0},{:.0},{:.1},{:.1},{:.3},{:.3},{:.3},{:.3},{:.3},{:.3},{:.3},{:.2},{:.2}",
        means(1, |shot| shot.stats.clusters_drawn as f64),
        means(1, |shot| shot.stats.triangles as f64),
        means(1, |shot| shot.stats.occluded as f64),
        means(1, |shot| shot.stats.tested as f64),
        means(0, |shot| shot.ms),
        means(1, |shot| shot.ms),
        ratio(|shot| shot.ms),
        means(0, |shot| shot.processor_ms),
        means(1, |shot| shot.processor_ms),
        ratio(|shot| shot.processor_ms),
        median(pairs),
        longest(0),
        longest(1),
    ))
}
