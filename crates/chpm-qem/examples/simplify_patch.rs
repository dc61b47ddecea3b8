//! Simplifies one patch with a bound: `cargo run -p chpm-qem --example simplify_patch -- [TRIANGLES]`.
//!
//! A wavy sheet is taken down to so many triangles. Its border is locked, as if other patches went on there, so that it still fits to
//! them. The error that is printed is proven: no point of the sheet is farther than that from what is left, and the other way round.

use chpm_qem::{Decimator, Patch};
use std::error::Error;

const SIDE: u16 = 65;

fn main() -> Result<(), Box<dyn Error>> {
    let target = std::env::args().nth(1).map_or(Ok(1000), |text| text.parse())?;

    // A patch is plain slices: positions, triangles, and who has to stay.
    let places = (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y)));
    let height = |x: u16, y: u16| 2.0 * (f32::from(x) / 9.0).sin() * (f32::from(y) / 7.0).cos();
    let positions: Vec<[f32; 3]> =
        places.clone().map(|(x, y)| [f32::from(x), f32::from(y), height(x, y)]).collect();
    let locked: Vec<bool> = places.clone().map(|(x, y)| x.min(y) == 0 || x.max(y) == SIDE - 1).collect();
    let mut triangles = Vec::new();
    for (x, y) in places.filter(|(x, y)| x.max(y) < &(SIDE - 1)) {
        let [a, b, c, d] = [(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)].map(|(x, y)| y * SIDE + x);
        triangles.extend([[a, b, c], [a, c, d]]);
    }
    let patch = Patch { positions: &positions, triangles: &triangles, locked: &locked, ..Patch::default() };

    // The decimator is scratch: one for each thread, used for patch after patch. It starts from an error of 0.
    let mut decimator = Decimator::default();
    let outcome = decimator.decimate(&patch, target, 0.0);
    println!("{} of {} triangles are left", outcome.triangle_count, triangles.len());
    for tenth in (1..=10).map(|tenth| outcome.collapses.len() * tenth / 10) {
        if let Some(collapse) = tenth.checked_sub(1).and_then(|last| outcome.collapses.get(last)) {
            println!("after {tenth:5} collapses the error is at most {:.4}", collapse.error);
        }
    }

    // What comes out is an order of collapses. Playing it gives the mesh at any step; here, at the last one.
    let mut place: Vec<u16> = (0..SIDE * SIDE).collect();
    for collapse in outcome.collapses.iter().rev() {
        place[usize::from(collapse.from)] = place[usize::from(collapse.to)];
    }
    let corners = triangles.iter().map(|triangle| triangle.map(|v| place[usize::from(v)]));
    let left = corners.filter(|[a, b, c]| a != b && b != c && c != a).count();
    assert_eq!(left, outcome.triangle_count);
    Ok(())
}
