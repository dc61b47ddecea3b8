use super::*;
use std::collections::{BTreeMap, BTreeSet};

/// Vertices less edges plus faces, after asserting that every edge is walked once in each direction and that the faces
/// about every vertex are one fan.
fn euler_of_closed(mesh: &TriMesh, name: &str) -> i64 {
    let mut next = BTreeMap::new();
    let mut edges = BTreeSet::new();
    for &[a, b, c] in &mesh.triangles {
        for (u, v, w) in [(a, b, c), (b, c, a), (c, a, b)] {
            assert!(edges.insert((u, v)), "{name}: {u} to {v} is walked twice");
            next.insert((u, v), w);
        }
    }

    let mut valence = vec![0; mesh.positions.len()];
    let mut start = vec![None; mesh.positions.len()];
    for &(u, v) in &edges {
        assert!(edges.contains(&(v, u)), "{name}: {u} to {v} is a boundary");
        valence[u as usize] += 1;
        start[u as usize] = Some(v);
    }

    for (u, first) in start.iter().enumerate() {
        let first = first.unwrap_or_else(|| panic!("{name}: {u} is isolated"));
        let (mut at, mut steps) = (first, 0);
        loop {
            at = next[&(u as u32, at)];
            steps += 1;
            if at == first {
                break;
            }
        }
        assert_eq!(steps, valence[u], "{name}: {u} has several fans");
    }

    mesh.positions.len() as i64 - edges.len() as i64 / 2 + mesh.triangles.len() as i64
}

/// Six times the enclosed volume; positive where faces look outward.
fn volume(mesh: &TriMesh) -> f64 {
    mesh.triangles
        .iter()
        .map(|t| {
            let [a, b, c] = mesh.corners(*t).map(chpm_mesh::geom::to_f64);
            a.coords.dot(&b.coords.cross(&c.coords))
        })
        .sum()
}

fn components(mesh: &TriMesh) -> usize {
    let mut up: Vec<usize> = (0..mesh.positions.len()).collect();
    fn root(up: &mut [usize], mut x: usize) -> usize {
        while up[x] != x {
            up[x] = up[up[x]];
            x = up[x];
        }
        x
    }
    for &[a, b, c] in &mesh.triangles {
        for (u, v) in [(a, b), (b, c)] {
            let (u, v) = (root(&mut up, u as usize), root(&mut up, v as usize));
            up[u.max(v)] = u.min(v);
        }
    }
    (0..up.len()).filter(|&v| up[v] == v).count()
}

#[test]
fn counts_are_exact_and_near_the_target() {
    for shape in Shape::ALL {
        for target in [0, 1, 100, 3_000, 5_003, 20_000, 100_000] {
            for seed in [0, 9] {
                let synth = Synth::new(shape, target, seed);
                let mesh = synth.to_mesh();
                assert_eq!(synth.vertex_count(), mesh.positions.len() as u64, "{shape} {target}");
                assert_eq!(synth.triangle_count(), mesh.triangles.len() as u64, "{shape} {target}");
                assert!(!mesh.triangles.is_empty(), "{shape} {target}");
                let off = mesh.triangles.len() as f64 / target as f64 - 1.0;
                assert!(target < 3_000 || off.abs() <= 0.05, "{shape} {target}: off by {off}");
                let mut used = vec![false; mesh.positions.len()];
                mesh.triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
                assert!(used.iter().all(|u| *u), "{shape} {target}");
                assert!(mesh.positions.iter().flatten().all(|x| x.is_finite()));
            }
        }
    }
}

#[test]
fn closed_shapes_are_closed_and_look_outward() {
    for target in [100, 3_000, 30_000] {
        for (shape, euler) in [(Shape::Sphere, 2), (Shape::Torus, 0)] {
            let mesh = Synth::new(shape, target, 0).to_mesh();
            assert_eq!(euler_of_closed(&mesh, &shape.to_string()), euler);
            assert!(volume(&mesh) > 0.0, "{shape}");
        }
        let mesh = Synth::new(Shape::Plates, target, 0).to_mesh();
        // Four plates of genus 1 to 4, as often as it takes.
        let parts = components(&mesh) as i64;
        assert_eq!(parts % 4, 0);
        assert_eq!(euler_of_closed(&mesh, "plates"), 2 * parts - 2 * 10 * parts / 4);
        assert!(volume(&mesh) > 0.0);
    }
    for (name, mesh, euler) in [
        ("tetrahedron", hand::tetrahedron(), 2),
        ("cube", hand::cube(), 2),
        ("icosphere", hand::icosphere(2), 2),
    ] {
        assert_eq!(euler_of_closed(&mesh, name), euler);
        assert!(volume(&mesh) > 0.0, "{name}");
    }
    assert_eq!(volume(&hand::cube()), 6.0);
}

#[test]
fn isosurfaces_are_closed_with_many_components_and_handles() {
    for (target, seed) in [(100, 1), (5_000, 2), (100_000, 3)] {
        let mesh = Synth::new(Shape::Isosurface, target, seed).to_mesh();
        let euler = euler_of_closed(&mesh, "isosurface");
        let parts = components(&mesh) as i64;
        assert!(volume(&mesh) > 0.0);
        if target == 100_000 {
            let genus = (2 * parts - euler) / 2;
            assert!(parts > 100 && genus > 100, "{parts} components, genus {genus}");
        }
    }
}

#[test]
fn spheres_and_tori_are_round() {
    for p in &Synth::new(Shape::Sphere, 5_000, 0).to_mesh().positions {
        assert!((chpm_mesh::geom::distance(*p, [0.0; 3]) - 1.0).abs() < 1e-6);
    }
    for p in &Synth::new(Shape::Torus, 5_000, 0).to_mesh().positions {
        let [x, y, z] = p.map(f64::from);
        let from_circle = ((x * x + y * y).sqrt() - 1.0).hypot(z);
        assert!((from_circle - 0.4).abs() < 1e-6);
    }
}

#[test]
fn terrain_is_one_rough_sheet() {
    let mesh = Synth::new(Shape::Terrain, 20_000, 1).to_mesh();
    let heights = chpm_mesh::Aabb::of_points(&mesh.positions);
    assert_eq!((heights.min[0], heights.max[1]), (0.0, 1.0));
    assert!(heights.max[2] - heights.min[2] > 0.05);
    assert!(mesh.triangles.iter().all(|t| {
        let [a, b, c] = mesh.corners(*t);
        chpm_mesh::geom::area_vector(a, b, c).z > 0.0
    }));
    assert_eq!(components(&mesh), 1);
}

#[test]
fn plates_have_slivers_with_area() {
    for target in [3_000, 40_000] {
        let mesh = Synth::new(Shape::Plates, target, 0).to_mesh();
        let aspect = |t: &[u32; 3]| {
            let [a, b, c] = mesh.corners(*t);
            let longest = [(a, b), (b, c), (c, a)]
                .map(|(p, q)| chpm_mesh::geom::distance(p, q))
                .into_iter()
                .fold(0.0, f64::max);
            let area = chpm_mesh::geom::area_vector(a, b, c).norm();
            assert!(area > 0.0);
            longest * longest / area
        };
        assert!(mesh.triangles.iter().map(aspect).fold(0.0, f64::max) >= 1000.0, "{target}");
    }
}

#[test]
fn seeds_matter_and_repeat() {
    for shape in [Shape::Terrain, Shape::Isosurface, Shape::Plates] {
        let mesh = |seed| Synth::new(shape, 20_000, seed).to_mesh();
        assert_eq!(mesh(1), mesh(1), "{shape}");
        assert_ne!(mesh(1), mesh(2), "{shape}");
    }
}

#[test]
fn an_error_of_the_sink_stops_and_returns() {
    for shape in Shape::ALL {
        let synth = Synth::new(shape, 50_000, 0);
        let mut batches = 0;
        let result = synth.for_each_triangles(&mut |_| {
            batches += 1;
            if batches == 2 { Err("full") } else { Ok(()) }
        });
        assert_eq!((result, batches), (Err("full"), 2), "{shape}");
    }
}

#[test]
fn shapes_are_read_as_they_are_written() {
    for shape in Shape::ALL {
        assert_eq!(shape.to_string().parse(), Ok(shape));
    }
    let error = "cone".parse::<Shape>().unwrap_err().to_string();
    assert!(error.contains("'cone'") && error.contains("isosurface"), "{error}");
}

#[test]
fn a_plant_has_as_many_parts_as_are_asked_for() {
    for (parts, target) in [(1, 2_000), (7, 7_000), (60, 30_000), (200, 300_000)] {
        let synth = Synth::plant(parts, target, 3);
        let mesh = synth.to_mesh();
        assert_eq!(synth.vertex_count(), mesh.positions.len() as u64);
        assert_eq!(synth.triangle_count(), mesh.triangles.len() as u64);
        let off = mesh.triangles.len() as f64 / target as f64 - 1.0;
        assert!(parts < 7 || off.abs() <= 0.05, "{parts} {target}: off by {off}");
        assert_eq!(components(&mesh) as u64, parts);
        euler_of_closed(&mesh, "plant");
    }
    // Each part is in a cell of its own, and each is closed and turned outward.
    let mesh = Synth::plant(27, 30_000, 1).to_mesh();
    let mut volumes = BTreeMap::<[i64; 3], f64>::new();
    for corners in &mesh.triangles {
        let corners = mesh.corners(*corners).map(chpm_mesh::geom::to_f64);
        let cells = corners.map(|p| [p.x, p.y, p.z].map(|x| x.floor() as i64));
        assert!(cells[0] == cells[1] && cells[0] == cells[2], "{cells:?}");
        let [a, b, c] = corners;
        *volumes.entry(cells[0]).or_default() += a.coords.dot(&b.coords.cross(&c.coords)) / 6.0;
    }
    assert_eq!(volumes.len(), 27);
    assert!(volumes.values().all(|volume| (1e-4..0.8).contains(volume)), "{volumes:?}");
    // Three kinds, of which pipes have a bore: genus 1 in place of 0.
    let euler = euler_of_closed(&mesh, "plant");
    assert!(euler % 2 == 0 && (20..54).contains(&euler), "{euler}");
    assert_ne!(Synth::plant(27, 30_000, 2).to_mesh(), mesh);
    assert_eq!(Synth::plant(27, 30_000, 1).to_mesh(), mesh);
    assert_eq!("plant".parse(), Ok(Shape::Plant));
    assert_eq!(components(&Synth::new(Shape::Plant, 20_000, 1).to_mesh()), 10);
}
