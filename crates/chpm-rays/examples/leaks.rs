//! Rays from inside of a closed model at its vertices, edges and faces, at leaves, at one error and at mixed levels: how many get out.
//!
//! Usage: `cargo run --release -p chpm-rays --example leaks -- FILE.chpm X,Y,Z RAYS`, where X,Y,Z is inside, in the model's coordinates.

use chpm_format::Chpm;
use chpm_mesh::{Bytes, ClusterId, Places};
use chpm_rays::{Bound, Caster, Memory, Ray, Seek};
use std::error::Error;
use std::time::Instant;

/// Rays of a batch.
const BATCH: u64 = 1 << 18;

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [path, inside, count] = words.as_slice() else { return Err("FILE.chpm X,Y,Z RAYS".into()) };
    let file = Chpm::open(std::fs::read(path)?)?;
    let inside: Vec<f64> = inside.split(',').map(str::parse).collect::<Result<_, _>>()?;
    let origin = file.header().origin;
    let inside: [f64; 3] = std::array::from_fn(|axis| inside[axis] - origin[axis]);
    let count: u64 = count.parse()?;
    let largest = file.groups().iter().map(|group| f64::from(group.max_error)).fold(0.0, f64::max);
    let size = file.header().aabb().diagonal();

    let corner = file.header().aabb().max.map(f64::from);
    let bounds = [
        ("leaves", Bound::LEAVES),
        ("a hundredth of the largest error", Bound::within(0.01 * largest)),
        ("a third of it", Bound::within(0.3 * largest)),
        ("growing from a corner", Bound::from_eye(corner, 0.3 * largest / size)),
        ("growing fast from it", Bound::from_eye(corner, 3.0 * largest / size)),
        (
            "growing from it and along the ray",
            Bound { spread: 0.3 * largest / size, ..Bound::from_eye(corner, 0.3 * largest / size) },
        ),
    ];
    let mut caster = Caster::new(&file, Memory::new(Bytes(1 << 32), BATCH as usize));
    let mut seed = 1_u64;
    let mut share = move || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1_u64 << 53) as f64
    };
    let each = count.div_ceil(bounds.len() as u64);
    println!("rays,bound,missed,seconds");
    for (name, bound) in bounds {
        let begun = Instant::now();
        let (mut done, mut missed) = (0, 0);
        while done < each {
            // A cluster at random, at one of its meshes; its triangles one after the other.
            let cluster = (share() * file.clusters().len() as f64) as u32;
            let page = file.page(ClusterId(cluster))?;
            let page = page.view();
            let n = if share() < 0.5 { page.vertex_count() } else { page.base_vertex_count };
            let mut places = Places::default();
            places.go_to(&page.progressive_mesh(), n);
            let triangles: Vec<[u16; 3]> = places.triangles(page.triangles).collect();
            if triangles.is_empty() {
                continue;
            }
            let aimed = |number: u64| {
                let triangle = triangles[(share() * triangles.len() as f64) as usize];
                let [a, b, c] = triangle.map(|v| page.positions[usize::from(v)].map(f64::from));
                let (s, t) = (share(), share());
                let target: [f64; 3] = std::array::from_fn(|i| match number % 4 {
                    0 | 1 => a[i],
                    2 => a[i] + s * (b[i] - a[i]),
                    _ => a[i] + s * t * (b[i] - a[i]) + s * (1.0 - t) * (c[i] - a[i]),
                });
                Ray::new(inside, std::array::from_fn(|axis| target[axis] - inside[axis]))
            };
            let rays: Vec<Ray> = (0..BATCH / 16).map(aimed).collect();
            caster.cast(&rays, &bound, Seek::Any, &|| true, |hit, _| missed += u64::from(hit.is_none()))?;
            done += rays.len() as u64;
        }
        println!("{done},{name},{missed},{:.1}", begun.elapsed().as_secs_f64());
    }
    Ok(())
}
