//! Prints the processor time of `parry3d` for distances of two meshes in the poses of a file: `peer A.ply B.ply POSES`. The boxes are made first, and their time is told;
//! each line is a pose's distance and its milliseconds. Single precision, in core.

use chpm_import::ply::{Options, read_mesh};
use parry3d::math::{Pose, Rotation, Vector};
use parry3d::query;
use parry3d::shape::TriMesh;
use std::error::Error;
use std::fs::{self, File};
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().collect();
    let [_, a, b, poses] = words.as_slice() else { return Err("peer A.ply B.ply POSES".into()) };
    let load = |path: &str| -> Result<(TriMesh, f64), Box<dyn Error>> {
        let mesh = read_mesh(File::open(path)?, Options::default())?.0;
        let points = mesh.positions.iter().map(|p| Vector::new(p[0], p[1], p[2])).collect();
        let start = Instant::now();
        let made = TriMesh::new(points, mesh.triangles).map_err(|error| format!("{path}: {error:?}"))?;
        Ok((made, start.elapsed().as_secs_f64()))
    };
    let ((a, first), (b, second)) = (load(a)?, load(b)?);
    println!("boxes: {:.3} s and {:.3} s", first, second);
    for line in fs::read_to_string(poses)?.lines() {
        let numbers: Vec<f32> = line.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
        let [x, y, z, i, j, k, w] = numbers.as_slice() else {
            return Err("X Y Z QX QY QZ QW expected".into());
        };
        let pose = Pose::from_parts(Vector::new(*x, *y, *z), Rotation::from_xyzw(*i, *j, *k, *w).normalize());
        let start = Instant::now();
        let distance = query::distance(&Pose::IDENTITY, &a, &pose, &b).map_err(|error| error.to_string())?;
        let distance = distance.distance;
        println!("{distance} {:.3}", 1000.0 * start.elapsed().as_secs_f64());
    }
    Ok(())
}
