//! Quality of one halving beside the oracle, which keeps every half-edge's cost up to date and picks the least.

use crate::play::free;
use chpm_measure::{deviation, naive};
use chpm_mesh::Aabb;
use chpm_synth::{Shape, Synth};

/// Distances below this share of the model's size are what single precision rounds.
const ROUNDING: f64 = 1e-6;

/// Measured, ours over the oracle's at the same triangle count: root mean square 0.65 to 1.05, median 0.98; maximum 0.17 to 1.09, median
/// 0.72, but for the plates with 1.55, where the distances are what single precision rounds.
#[test]
fn a_half_deviates_no_more_than_the_oracles() {
    use Shape::*;
    let models = [
        (Terrain, 1),
        (Terrain, 2),
        (Terrain, 3),
        (Isosurface, 1),
        (Isosurface, 2),
        (Isosurface, 3),
        (Isosurface, 4),
        (Torus, 0),
        (Plates, 1),
        (Plates, 2),
        (Sphere, 0),
    ];
    let (mut rms, mut max) = (Vec::new(), Vec::new());
    for (shape, seed) in models {
        let mesh = Synth::new(shape, 4500, seed).to_mesh();
        let ours = free(&mesh, mesh.triangles.len() / 2);
        let oracle = naive::simplify(&mesh, ours.triangle_count, &[]);
        assert!(!ours.stalled && oracle.triangles.len() <= ours.triangle_count);
        let (a, b) = (deviation(&mesh, &ours.mesh, 6), deviation(&mesh, &oracle, 6));
        let floor = ROUNDING * Aabb::of_points(&mesh.positions).diagonal();
        let ratio = |a: f64, b: f64| a.max(floor) / b.max(floor);
        rms.push(ratio(a.rms(), b.rms()));
        max.push(ratio(a.max(), b.max()));
    }
    rms.sort_by(f64::total_cmp);
    max.sort_by(f64::total_cmp);
    let median = models.len() / 2;
    assert!(rms[median] <= 1.002 && rms[models.len() - 1] <= 1.1, "{rms:?}");
    assert!(max[median] <= 0.8 && max[models.len() - 1] <= 1.6, "{max:?}");
}

/// A collapse that costs nothing must not be passed over for a short one that costs little: flat faces go before curved ones.
#[test]
fn planes_go_before_anything_curved() {
    let mesh = Synth::new(Shape::Plates, 4500, 1).to_mesh();
    let half = free(&mesh, mesh.triangles.len() / 2);
    let size = Aabb::of_points(&mesh.positions).diagonal();
    assert!(deviation(&mesh, &half.mesh, 6).max() < 5e-5 * size);
}
