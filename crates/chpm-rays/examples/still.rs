//! A still with a shadow by rays, at pixels of error 0, 0.5, 1, 2, 4, 8: processor time, pages, bytes, and how far it is from that of error 0.
//!
//! Usage: `still FILE.chpm SIZE MEMORY_MIB [PICTURES]`; with PICTURES a PGM for each is written to PICTURES-0.pgm and so on. A pixel's offset is the distance of its point from
//! that of error 0 in pixels at that distance; a pixel that only one of them has is counted apart.

use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::Bytes;
use chpm_rays::{Bound, Caster, Hit, Memory, Ray, Seek};
use std::error::Error;

type Vector = [f64; 3];

fn add(a: Vector, b: Vector, factor: f64) -> Vector {
    std::array::from_fn(|i| a[i] + factor * b[i])
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(a: Vector) -> Vector {
    let length = dot(a, a).sqrt();
    a.map(|x| x / length)
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Seconds of all threads, as Linux counts them.
fn processor() -> Result<f64, Box<dyn Error>> {
    let mut sum = 0.0;
    for task in std::fs::read_dir("/proc/self/task")? {
        let text = std::fs::read_to_string(task?.path().join("schedstat"))?;
        sum += text.split(' ').next().unwrap_or_default().parse::<f64>()? * 1e-9;
    }
    Ok(sum)
}

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [path, size, memory, pictures @ ..] = words.as_slice() else {
        return Err("FILE.chpm SIZE MEMORY_MIB [PICTURES]".into());
    };
    let file = Chpm::open(MappedFile::open(std::path::Path::new(path))?)?;
    let size: usize = size.parse()?;
    let memory = Bytes::mib(memory.parse()?);
    let header = file.header();
    let [low, high] = [header.aabb_min, header.aabb_max].map(|corner| corner.map(f64::from));
    let middle: Vector = std::array::from_fn(|i| 0.5 * (low[i] + high[i]));
    let diagonal = header.aabb().diagonal();

    // The whole model, seen from above one corner.
    let toward = unit([0.5, -0.75, 0.45]);
    let eye = add(middle, toward, 1.2 * diagonal);
    let way = toward.map(|x| -x);
    let right = unit(cross(way, [0.0, 0.0, 1.0]));
    let up = cross(right, way);
    let half = 0.45;
    let pixel = 2.0 * half / size as f64;
    let light = unit([-0.3, -0.4, 0.85]);
    let at = |i: usize| (i as f64 + 0.5) * pixel - half;
    let rays: Vec<Ray> = (0..size * size)
        .map(|n| Ray::new(eye, unit(add(add(way, right, at(n % size)), up, -at(n / size)))))
        .collect();

    let mut first: Vec<Option<Hit>> = Vec::new();
    let mut first_gray: Vec<u8> = Vec::new();
    println!(
        "poe,seconds,pages,different,bytes,hits,rms of grey,rms of offsets,off by more than poe,in one only"
    );
    for poe in [0.0, 0.5, 1.0, 2.0, 4.0, 8.0] {
        let bound = if poe > 0.0 { Bound::from_eye(eye, poe * pixel) } else { Bound::LEAVES };
        let mut caster = Caster::new(&file, Memory::divide(memory, rayon::current_num_threads()));
        let begun = processor()?;
        let mut hits = Vec::with_capacity(rays.len());
        caster.cast(&rays, &bound, Seek::Nearest, &|| true, |hit, _| hits.push(hit))?;
        // Toward the light from each point, on the side that it is seen from, at the camera's own mesh: only rounding needs a bias.
        let shadow: Vec<Ray> = hits
            .iter()
            .flatten()
            .map(|hit| {
                let lift = 1e-7 * diagonal;
                let side = if dot(hit.normal, way) > 0.0 { -lift } else { lift };
                Ray::new(add(hit.point, hit.normal, side), light)
            })
            .collect();
        let mut dark = Vec::with_capacity(shadow.len());
        caster.cast(&shadow, &bound, Seek::Any, &|| true, |hit, _| dark.push(hit.is_some()))?;
        let seconds = processor()? - begun;

        let mut dark = dark.into_iter();
        let gray: Vec<u8> = hits
            .iter()
            .map(|hit| {
                let Some(hit) = hit else { return 255 };
                let facing = if dot(hit.normal, way) > 0.0 { -1.0 } else { 1.0 };
                let lit = (facing * dot(hit.normal, light)).max(0.0);
                let lit = if dark.next() == Some(true) { 0.0 } else { lit };
                (40.0 + 180.0 * lit) as u8
            })
            .collect();
        if let [name] = pictures {
            let head = format!("P5\n{size} {size}\n255\n");
            std::fs::write(format!("{name}-{poe}.pgm"), [head.as_bytes(), &gray].concat())?;
        }
        if first.is_empty() {
            (first, first_gray) = (hits.clone(), gray.clone());
        }
        let (mut squares, mut off, mut alone, mut both) = (0.0, 0, 0, 0);
        for (hit, exact) in hits.iter().zip(&first) {
            match (hit, exact) {
                (Some(hit), Some(exact)) => {
                    let offset = (hit.distance - exact.distance).abs() / (pixel * exact.distance);
                    squares += offset * offset;
                    off += u64::from(offset > poe + 1e-9);
                    both += 1;
                }
                (None, None) => {}
                _ => alone += 1,
            }
        }
        let grey = gray.iter().zip(&first_gray).map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2)).sum::<f64>();
        let reads = caster.reads();
        println!(
            "{poe},{seconds:.2},{},{},{},{},{:.2},{:.2},{off},{alone}",
            reads.pages,
            reads.different,
            reads.bytes,
            hits.iter().flatten().count(),
            (grey / gray.len() as f64).sqrt(),
            (squares / f64::from(both.max(1))).sqrt(),
        );
    }
    Ok(())
}
