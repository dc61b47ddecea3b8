//! How deep random cuts go: `cargo run --release -p chpm-refine --example cut_depths -- FILE [N]` prints, by level, the mean share of the
//! model's surface (in leaves) that N random cuts have at that level, and how many of the cuts reach it.

use chpm_format::Chpm;
use chpm_refine::random_cut;
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let path = args.next().ok_or("a .chpm file expected")?;
    let count: u64 = args.next().map_or(Ok(100), |n| n.parse())?;
    let bytes = std::fs::read(path)?;
    let file = Chpm::open(bytes)?;
    let levels = file.levels().len();
    let (mut share, mut reached, mut triangles) = (vec![0.0; levels], vec![0; levels], Vec::new());
    for seed in 0..count {
        let cut = random_cut(&file, seed)?;
        let mut clusters = vec![0_u32; levels];
        for member in cut.members() {
            clusters[file.clusters()[member.cluster.index()].level as usize] += 1;
        }
        let leaves: f64 =
            clusters.iter().enumerate().map(|(level, n)| f64::from(*n) * (1_u64 << level) as f64).sum();
        for (level, n) in clusters.iter().enumerate() {
            share[level] += f64::from(*n) * (1_u64 << level) as f64 / leaves / count as f64;
            reached[level] += u64::from(*n > 0);
        }
        triangles.push(cut.triangle_count(&file)?);
    }
    triangles.sort_unstable();
    println!(
        "triangles: least {}, median {}, most {}",
        triangles[0],
        triangles[triangles.len() / 2],
        triangles[triangles.len() - 1]
    );
    for level in 0..levels {
        println!("level {level}: {:.1} % of the surface, in {} cuts", 100.0 * share[level], reached[level]);
    }
    Ok(())
}
