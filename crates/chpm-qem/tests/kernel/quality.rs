//! Quality beside the oracle.
use crate::play::{free,run};
use chpm_measure::{deviation, naive};
use chpm_mesh::synth::{Shape, Synth};

#[test]
fn table() {
    for (shape, n) in [(Shape::Terrain, 5000u64), (Shape::Isosurface, 5000), (Shape::Torus, 4000), (Shape::Plates, 5000), (Shape::Sphere,4000)] {
        for seed in 1..=4u64 {
            for keep in [2usize, 8] {
            let mesh = Synth::new(shape, n, seed).to_mesh();
            let ours = free(&mesh, mesh.triangles.len() / keep);
            let oracle = naive::simplify(&mesh, ours.triangle_count, &[]);
            let (a, b) = (deviation(&mesh, &ours.mesh, 8), deviation(&mesh, &oracle, 8));
            println!("{shape} {seed} 1/{keep} tris {} oracle {} | max {:.3e} {:.3e} {:.3} | rms {:.3e} {:.3e} {:.3} | stored {:.3e} st/max {:.3} st/rms {:.2}", ours.triangle_count, oracle.triangles.len(), a.max(), b.max(), a.max()/b.max(), a.rms(), b.rms(), a.rms()/b.rms(), ours.max_error(), f64::from(ours.max_error())/a.max(), f64::from(ours.max_error())/a.rms());
            }
        }
    }
    let _ = run;
}
