//! How long the viewer looks for the surface at a pixel: in the depths of the picture that is there, as navigation does, and on the source's own triangles, as
//! measuring does; and the frame after the latter, which draws anew.

use crate::film::median;
use chpm_refine::Camera;
use chpm_viewer::{Accuracy, Budgets, FrameRequest, Gpu, Viewer, headless};
use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

const SIZES: [[u32; 2]; 2] = [[512, 512], [1280, 800]];
/// Pixels of each picture, in rows and columns.
const GRID: u32 = 16;

/// Picks over a model as it is framed, and prints a row for each size of the picture.
pub(crate) fn run(gpu: &Arc<Gpu>, path: &Path) -> Result<(), Box<dyn Error>> {
    println!(
        "width,height,triangles,frame_ms,hits,pick_ms,exact_hits,exact_ms,longest_exact_ms,frame_after_ms"
    );
    for viewport in SIZES {
        let mut viewer = Viewer::open(Arc::clone(gpu), path, Budgets::default())?;
        let camera: Camera = viewer.framing();
        let request =
            FrameRequest { accuracy: Accuracy::PoE(1.0), wait: true, ..FrameRequest::new(camera, viewport) };
        let draw = |viewer: &mut Viewer| -> Result<(f64, u64), Box<dyn Error>> {
            let begun = Instant::now();
            let (_, stats) = headless::image(viewer, &request)?;
            Ok((ms(begun), stats.triangles))
        };
        draw(&mut viewer)?;
        let (frame, triangles) = draw(&mut viewer)?;
        let pixels = (0..GRID * GRID).map(|n| {
            [n % GRID, n / GRID]
                .iter()
                .zip(viewport)
                .map(|(at, size)| (2 * at + 1) * size / (2 * GRID))
                .collect()
        });
        let pixels: Vec<Vec<u32>> = pixels.collect();
        let (mut picks, mut exact, mut after, mut hits) = (Vec::new(), Vec::new(), Vec::new(), [0, 0]);
        for pixel in &pixels {
            let begun = Instant::now();
            hits[0] += u32::from(viewer.pick([pixel[0], pixel[1]])?.is_some());
            picks.push(ms(begun));
        }
        for pixel in &pixels {
            let begun = Instant::now();
            hits[1] += u32::from(viewer.exact(&request, [pixel[0], pixel[1]])?.is_some());
            exact.push(ms(begun));
            after.push(draw(&mut viewer)?.0);
        }
        let longest = exact.iter().copied().fold(0.0, f64::max);
        println!(
            "{},{},{triangles},{frame:.2},{},{:.3},{},{:.3},{longest:.3},{:.2}",
            viewport[0],
            viewport[1],
            hits[0],
            median(picks),
            hits[1],
            median(exact),
            median(after),
        );
    }
    Ok(())
}

fn ms(begun: Instant) -> f64 {
    1e3 * begun.elapsed().as_secs_f64()
}
