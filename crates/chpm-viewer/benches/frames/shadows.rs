//! Cost of shadows: an orbit without and with them in turn, and the same at rest, where the map is kept.

use crate::film::{Film, Shot, median};
use chpm_refine::CameraPath;
use chpm_viewer::{FrameRequest, Gpu, Look};
use std::error::Error;
use std::path::Path;
use std::sync::Arc;

const VIEWPORT: [u32; 2] = [1920, 1080];
/// Frames of a way around; those of a processor that draws.
const FRAMES: usize = 48;
const SLOW_FRAMES: usize = 8;
/// Times around, the first of which reads the pages and does not count.
const ROUNDS: usize = 3;

/// What light does.
const LOOKS: [(&str, bool, bool); 3] =
    [("none", false, false), ("shadows", true, false), ("shadows and corners", true, true)];

/// Goes around a model, and rests, and prints a row for each.
pub(crate) fn run(gpu: &Arc<Gpu>, path: &Path) -> Result<(), Box<dyn Error>> {
    let mut films = [Film::open(gpu, path)?, Film::open(gpu, path)?, Film::open(gpu, path)?];
    let file = films[0].viewer.file();
    let all = file.header().source_triangle_count;
    let origin = films[0].viewer.origin();
    let frames = if gpu.is_software() { SLOW_FRAMES } else { FRAMES };
    let cameras: Vec<_> = CameraPath::orbit(&films[0].viewer.bounds(), frames)
        .cameras
        .iter()
        .map(|camera| camera.relative_to(origin.map(|x| -x)))
        .collect();
    let request = |camera, place: usize| {
        let (_, shadows, occlusion) = LOOKS[place];
        let look = Look { shadows, occlusion, ..Look::default() };
        FrameRequest { look, ..FrameRequest::new(camera, VIEWPORT) }
    };
    println!(
        "motion,light,frames,ms,longest_ms,ratio,median_pair_ratio,maps,object_triangles,visible_triangles,visible_clusters,caster_clusters,map_triangles"
    );

    let mut shots: [Vec<Shot>; 3] = Default::default();
    for round in 0..ROUNDS {
        for (frame, camera) in cameras.iter().enumerate() {
            for turn in 0..3 {
                // Who comes first finds other caches.
                let place = (turn + frame + round) % 3;
                let shot = films[place].shoot(&request(*camera, place))?;
                if round > 0 {
                    shots[place].push(shot);
                }
            }
        }
    }
    print("orbit", &shots, all);

    let mut rest: [Vec<Shot>; 3] = Default::default();
    for camera in cameras.iter().step_by(frames / 4) {
        for (place, film) in films.iter_mut().enumerate() {
            film.converge(&request(*camera, place))?;
            film.repeat(&request(*camera, place), 2)?;
        }
        for _ in 0..frames / 4 {
            for (place, film) in films.iter_mut().enumerate() {
                rest[place].push(film.shoot(&request(*camera, place))?);
            }
        }
    }
    print("rest", &rest, all);

    // As the window has it: a picture that is still right is not drawn at all.
    let mut kept: [Vec<Shot>; 3] = Default::default();
    for (place, film) in films.iter_mut().enumerate() {
        let request = FrameRequest { kept: true, ..request(cameras[0], place) };
        film.converge(&request)?;
        kept[place] = film.repeat(&request, frames)?;
    }
    print("kept", &kept, all);
    Ok(())
}

fn print(motion: &str, shots: &[Vec<Shot>; 3], all: u64) {
    let middle = |shots: &[Shot], of: fn(&Shot) -> f64| median(shots.iter().map(of));
    let without = middle(&shots[0], |shot| shot.ms);
    for ((name, ..), shots_of) in LOOKS.iter().zip(shots) {
        let pairs = shots_of.iter().zip(&shots[0]).map(|(with, without)| with.ms / without.ms);
        let ms = middle(shots_of, |shot| shot.ms);
        println!(
            "{motion},{name},{},{ms:.3},{:.3},{:.3},{:.3},{},{all},{:.0},{:.0},{:.0},{:.0}",
            shots_of.len(),
            shots_of.iter().map(|shot| shot.ms).fold(0.0, f64::max),
            ms / without,
            median(pairs),
            shots_of.iter().map(|shot| shot.stats.shadow_maps).sum::<u64>(),
            middle(shots_of, |shot| shot.stats.triangles as f64),
            middle(shots_of, |shot| shot.stats.clusters_drawn as f64),
            middle(shots_of, |shot| shot.stats.shadow_casters as f64),
            middle(shots_of, |shot| shot.stats.shadow_triangles as f64),
        );
    }
}
