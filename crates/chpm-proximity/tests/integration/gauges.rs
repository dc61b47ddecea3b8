//! Distances of points against looking at every triangle.

use crate::site::{Built, Random};
use chpm_measure::Bvh;
use chpm_mesh::{Bytes, TriMesh, geom};
use chpm_proximity::{Gauge, Model, Pose};
use chpm_synth::hard::Case;
use chpm_synth::{Shape, Synth, hand};

/// Signed distances of points in the world.
fn measure(reference: &Built, points: &[[f32; 3]], tolerance: f64) -> Vec<f64> {
    let scan = Model::new(&reference.file, Bytes(0)).unwrap();
    let model = Model::new(&reference.file, Bytes(1 << 20)).unwrap();
    let still = Pose::IDENTITY;
    let gauge = Gauge::new(&scan, &model, [&still, &still], tolerance).unwrap();
    let mut found = Vec::new();
    gauge.measure(points, &mut found).unwrap();
    found
}

#[test]
fn distances_are_within_the_tolerance() {
    let mut random = Random::new(3);
    let meshes = [
        ("torus", Synth::new(Shape::Torus, 800, 0).to_mesh()),
        ("terrain", Synth::new(Shape::Terrain, 800, 1).to_mesh()),
        ("isosurface", Synth::new(Shape::Isosurface, 1500, 1).to_mesh()),
        ("soup", hand::soup(100)),
    ];
    for (name, mesh) in meshes {
        let bvh = Bvh::new(&mesh.positions, &mesh.triangles);
        let built = Built::new(name, mesh, [0.0; 3], name == "torus");
        let (center, size) = (built.center(), built.diagonal());
        // Points that wander, and some that jump, and vertices themselves.
        let mut at = center;
        let mut points: Vec<[f32; 3]> = (0..1200)
            .map(|i| {
                let step = if i % 100 == 0 { 1.0 } else { 0.02 };
                at = [0, 1, 2].map(|axis| {
                    let from = if i % 100 == 0 { center[axis] } else { at[axis] };
                    from + step * size * random.signed()
                });
                at.map(|x| x as f32)
            })
            .collect();
        points.extend(built.mesh.positions.iter().step_by(7));
        for tolerance in [0.0, 0.001 * size, 0.05 * size] {
            let found = measure(&built, &points, tolerance);
            assert_eq!(found.len(), points.len());
            for (point, distance) in points.iter().zip(&found) {
                let truth = bvh.distance(geom::to_f64(*point));
                let off = (distance.abs() - truth).abs();
                assert!(off <= tolerance + 1e-9 * size, "{name}, {point:?}: {distance} is not {truth}");
            }
        }
    }
}

#[test]
fn what_is_inside_is_negative() {
    for mesh in [hand::icosphere(3), hand::cube()] {
        let built = Built::new("closed", mesh, [0.0; 3], false);
        let center = built.center();
        let size = built.diagonal();
        let mut random = Random::new(9);
        let points: Vec<[f32; 3]> =
            (0..500).map(|_| center.map(|x| (x + size * random.signed()) as f32)).collect();
        let block = built.file.header().aabb();
        for (point, distance) in points.iter().zip(measure(&built, &points, 0.0)) {
            // The sphere's facets are within 2 % of it.
            let away = geom::distance(*point, center.map(|x| x as f32));
            let inside = match built.mesh.triangles.len() {
                12 => (0..3).all(|axis| block.min[axis] < point[axis] && point[axis] < block.max[axis]),
                _ if (away - 1.0).abs() < 0.02 => continue,
                _ => away < 1.0,
            };
            assert_eq!(distance < 0.0, inside, "{point:?}: {distance}");
        }
    }
}

/// How often a closed surface goes around a point: the solid angles of its triangles, in turns.
fn winding(mesh: &TriMesh, point: [f32; 3]) -> f64 {
    let angle = |triangle: &[u32; 3]| {
        let corners = triangle.map(|vertex| geom::to_f64(mesh.positions[vertex as usize]));
        let [a, b, c] = corners.map(|corner| corner - geom::to_f64(point));
        let [x, y, z] = [a, b, c].map(|way| way.norm());
        let below = x * y * z + a.dot(&b) * z + b.dot(&c) * x + c.dot(&a) * y;
        2.0 * a.dot(&b.cross(&c)).atan2(below)
    };
    mesh.triangles.iter().map(angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
}

#[test]
fn signs_are_those_of_the_winding_number_where_vertices_and_edges_are_nearest() {
    let spikes = |count| Case::find("spikes").unwrap().mesh(count);
    let mut random = Random::new(41);
    for (name, mesh) in [
        ("spikes", spikes(600)),
        ("more spikes", spikes(3000)),
        ("isosurface", Synth::new(Shape::Isosurface, 1500, 1).to_mesh()),
    ] {
        let built = Built::new(name, mesh, [0.0; 3], false);
        let (center, size) = (built.center(), built.diagonal());
        let mut about =
            |from: [f64; 3], reach: f64| from.map(|x| (x + reach * size * random.signed()) as f32);
        // Near and far from vertices, and around all of it.
        let mut points: Vec<[f32; 3]> = (0..1000).map(|_| about(center, 1.5)).collect();
        for vertex in built.mesh.positions.iter().cycle().take(1000) {
            points.push(about(vertex.map(f64::from), 0.01));
            points.push(about(vertex.map(f64::from), 0.2));
        }
        let sides: Vec<f64> = points.iter().map(|point| winding(&built.mesh, *point)).collect();
        for tolerance in [0.0, 0.002 * size] {
            let mut looked = [0; 2];
            for ((point, distance), turns) in
                points.iter().zip(measure(&built, &points, tolerance)).zip(&sides)
            {
                if distance.abs() <= tolerance + 1e-6 * size {
                    continue;
                }
                assert!((turns - turns.round()).abs() < 1e-6, "{name} is open: {turns}");
                assert_eq!(
                    distance < 0.0,
                    *turns > 0.5,
                    "{name}, {point:?}: {distance}, {turns}, {tolerance}"
                );
                looked[usize::from(distance < 0.0)] += 1;
            }
            assert!(looked[0] > 500 && looked[1] > 50, "{name}: {looked:?}");
        }
    }
}
