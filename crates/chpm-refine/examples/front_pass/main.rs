//! Measures a refinement pass over some 10,000 active clusters, of a made-up file: a plane of 128 x 128 tiny leaf clusters
//! with a binary tree above. Run it with `cargo run --release -p chpm-refine --example front_pass`.

mod plane;

use chpm_format::Chpm;
use chpm_refine::{ActiveList, Camera, Hierarchy, RefineError, View, select};
use std::time::Instant;

const PASSES: usize = 1000;

/// Median time of many passes over views, microseconds.
fn passes(
    file: &Chpm<Vec<u8>>,
    hierarchy: &Hierarchy,
    list: &mut ActiveList,
    mut view: impl FnMut(usize) -> Result<View, RefineError>,
) -> Result<(f64, u64), RefineError> {
    let (mut times, mut changes) = (Vec::new(), 0);
    for pass in 0..PASSES {
        let view = view(pass)?;
        let start = Instant::now();
        let changed = list.update(file, hierarchy, &view, |_| true)?;
        times.push(1e6 * start.elapsed().as_secs_f64());
        changes += changed.checks();
    }
    times.sort_by(f64::total_cmp);
    Ok((times[PASSES / 2], changes))
}

fn main() -> Result<(), RefineError> {
    let file = plane::file()?;
    let hierarchy = Hierarchy::new(&file);
    let camera = Camera::looking([20.0, -10.0, 30.0], [64.0, 64.0, 0.0]);
    // The pixels of error that give some 10,000 clusters, by trial.
    let mut pixels = 1.0;
    let at = |camera: &Camera, pixels| View::new(camera, [1024, 1024], pixels);
    while select(&file, &hierarchy, &at(&camera, pixels)?)?.members().len() > 10_000 {
        pixels *= 1.01;
    }
    while select(&file, &hierarchy, &at(&camera, pixels)?)?.members().len() < 10_000 {
        pixels /= 1.001;
    }
    let mut list = ActiveList::new(&file);
    let start = Instant::now();
    let changes = list.update(&file, &hierarchy, &at(&camera, pixels)?, |_| true)?;
    println!("{} of {} clusters active, at {pixels:.3} pixels", list.len(), file.clusters().len());
    println!("from the root: {:.3} ms, {} checks", 1e3 * start.elapsed().as_secs_f64(), changes.checks());
    let (time, changes) = passes(&file, &hierarchy, &mut list, |_| at(&camera, pixels))?;
    println!("nothing changes: {time:.1} us ({changes} changes in {PASSES} passes)");
    let (time, changes) = passes(&file, &hierarchy, &mut list, |pass| {
        let [x, y, z] = camera.position;
        at(&Camera { position: [x + 0.01 * pass as f64, y, z], ..camera }, pixels)
    })?;
    println!("a moving camera: {time:.1} us ({changes} changes in {PASSES} passes)");
    Ok(())
}
