//! Rays of files, walls and what is seen, as files and numbers.

use super::harness::Folder;
use chpm_mesh::TriMesh;
use chpm_synth::{Shape, Synth};
use serde_json::Value;

fn told(folder: &Folder, words: &str) -> Value {
    serde_json::from_str(&folder.stdout(words)).expect("JSON")
}

/// A sphere of radius 1 in small clusters, and rays: at it from 3 away, past it, from inside, and one that ends before.
fn ball() -> Folder {
    let folder = Folder::new();
    folder.stdout("synth sphere --triangles 6000 -o ball.ply -q");
    folder.stdout("build ball.ply -q --cluster-triangles 256");
    folder.write(
        "some.rays",
        "ox,oy,oz,dx,dy,dz,reach\n3,0.01,0.02,-2,0,0,inf\n3,0,1.5,-1,0,0,inf\n0,0,0,0.1,0.2,0.3,9\n0,3,0.01,0,-1,0,1.5\n",
    );
    folder
}

/// Rows of CSV; nothing is no number.
fn rows(bytes: &[u8]) -> Vec<Vec<f64>> {
    let text = String::from_utf8(bytes.to_vec()).unwrap();
    text.lines()
        .skip(1)
        .map(|line| line.split(',').map(|x| x.parse().unwrap_or(f64::NAN)).collect())
        .collect()
}

#[test]
fn rays_meet_a_sphere_where_it_is() {
    let folder = ball();
    let value = told(&folder, "rays ball.chpm some.rays -o hits.csv -q --json");
    let number = |key: &str| value[key].as_u64().unwrap();
    assert_eq!((number("count"), number("hits"), number("misses"), number("proven_misses")), (4, 2, 2, 2));
    assert_eq!((value["error"].as_f64(), value["distance"].as_f64()), (Some(0.0), Some(0.0)));
    let hits = rows(&folder.read("hits.csv"));
    assert_eq!(hits.iter().map(|row| row[0]).collect::<Vec<_>>(), [1.0, 0.0, 1.0, 0.0]);
    assert!((hits[0][1] - 2.0).abs() < 0.01 && (hits[2][1] - 1.0).abs() < 0.01, "{hits:?}");
    for (row, from, way) in
        [(0, [3.0, 0.01, 0.02], [-1.0, 0.0, 0.0]), (2, [0.0; 3], [0.267_261, 0.534_522, 0.801_784])]
    {
        for axis in 0..3 {
            let along = from[axis] + way[axis] * hits[row][1];
            assert!((hits[row][2 + axis] - along).abs() < 1e-5, "{row}: {hits:?}");
        }
        let facing: f64 = (0..3).map(|axis| hits[row][5 + axis] * hits[row][2 + axis]).sum();
        assert!(facing > 0.98, "the normal points outward: {hits:?}");
    }
    assert!(hits[1][1..].iter().all(|x| x.is_nan()) && hits[0].len() == 10);
    let text = folder.stdout("rays ball.chpm some.rays -q");
    assert!(text.contains("hits and misses are the source's"), "{text}");
}

#[test]
fn a_coarse_mesh_proves_misses_and_lower_bounds() {
    let folder = ball();
    let value = told(&folder, "rays ball.chpm some.rays --error 5% -o hits.csv -q --json");
    let within = value["distance"].as_f64().unwrap();
    assert!(within > 0.0 && value["proven_misses"] == 2, "{value}");
    let hits = rows(&folder.read("hits.csv"));
    let exact = [2.0, f64::INFINITY, 1.0, f64::INFINITY];
    for (row, exact) in hits.iter().zip(exact) {
        let least = row[10];
        assert!(least <= exact + 0.01, "{hits:?}");
        assert!(
            exact.is_infinite() && least.is_infinite() || least > exact - 3.0 * within - 0.01,
            "{hits:?}"
        );
    }
    let text = folder.stdout("rays ball.chpm some.rays --error 5% -q");
    assert!(text.contains("Hits are not proven"), "{text}");
}

/// NumPy's arrays hold the numbers of CSV, whichever goes in.
#[test]
fn arrays_and_text_say_the_same_whatever_the_threads_and_the_memory() {
    let folder = ball();
    let rays = rows(&folder.read("some.rays"));
    let dict = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({}, 7), }}\n", rays.len());
    let mut bytes = [&b"\x93NUMPY\x01\x00"[..], &(dict.len() as u16).to_le_bytes(), dict.as_bytes()].concat();
    rays.iter().flatten().for_each(|x| bytes.extend(x.to_le_bytes()));
    folder.write("some.npy", bytes);
    folder.stdout("rays ball.chpm some.rays --error 1% -o a.csv -q --threads 1");
    folder.stdout("rays ball.chpm some.npy --error 1% -o b.csv -q --threads 3 --memory 80M");
    assert_eq!(folder.read("a.csv"), folder.read("b.csv"));
    folder.stdout("rays ball.chpm some.npy --error 1% -o c.npy -q");
    let array = folder.read("c.npy");
    let start = 10 + usize::from(u16::from_le_bytes([array[8], array[9]]));
    let numbers: Vec<f64> =
        array[start..].chunks_exact(8).map(|x| f64::from_le_bytes(x.try_into().unwrap())).collect();
    let expected: Vec<f64> = rows(&folder.read("a.csv")).concat();
    assert!(numbers.len() == 44 && start % 64 == 0);
    assert!(numbers.iter().zip(&expected).all(|(a, b)| a == b || a.is_nan() && b.is_nan()), "{numbers:?}");
}

#[test]
fn what_is_no_ray_is_refused_with_its_place() {
    let folder = ball();
    folder.write("bad.rays", "0,0,0,0,0,1\n0,0,0,1,0\n");
    folder.write("zero.rays", "# none\n0,0,0,0,0,0\n");
    folder.write("short.npy", b"\x93NUMPY\x01\x00\xff\xff{");
    folder.write("no.rays", "");
    let before = folder.names();
    for (words, told) in [
        ("bad.rays", "'bad.rays', line 2"),
        ("zero.rays", "'zero.rays', line 2"),
        ("short.npy", "numpy.save"),
        ("gone.rays", "gone.rays"),
        ("some.rays --error=-1", "--error"),
        ("some.rays -o a.png", "rays writes CSV and NumPy"),
        ("some.rays --memory 1M", "--memory"),
    ] {
        let error = folder.stderr(
            &format!("rays ball.chpm -q -o out.csv {words}")
                .replace("-o out.csv some.rays -o", "some.rays -o"),
            2,
        );
        assert!(error.contains(told), "{words}: {error}");
    }
    assert_eq!(folder.names(), before);
    assert_eq!(told(&folder, "rays ball.chpm no.rays -q --json")["count"], 0);
}

/// Two spheres about one middle, the inner one turned inside out.
fn shell(inner: f32) -> TriMesh {
    let mut mesh = Synth::new(Shape::Sphere, 12_000, 1).to_mesh();
    let count = mesh.positions.len() as u32;
    let inside: Vec<[f32; 3]> = mesh.positions.iter().map(|p| p.map(|x| x * inner)).collect();
    let turned: Vec<[u32; 3]> =
        mesh.triangles.iter().map(|[a, b, c]| [a + count, c + count, b + count]).collect();
    mesh.positions.extend(inside);
    mesh.triangles.extend(turned);
    mesh
}

#[test]
fn a_shell_is_as_thick_as_it_was_made() {
    let folder = Folder::new();
    folder.write_mesh("shell.ply", &shell(0.9));
    folder.stdout("build shell.ply -q --cluster-triangles 512");
    for (cone, off) in [("0", 2e-3), ("10", 2e-3), ("25", 6e-3)] {
        let value = told(&folder, &format!("thickness shell.chpm --cone {cone} -q --json"));
        let number = |key: &str| value[key].as_f64().unwrap();
        assert_eq!(
            (value["open"].as_u64(), value["rays"].as_u64()),
            (Some(0), Some(if cone == "0" { 1 } else { 7 }))
        );
        // On flat triangles of this size the sphere is missed by so much, and more where rays lean.
        assert!((number("min") - 0.1).abs() < off && (number("max") - 0.1).abs() < off, "{cone}: {value}");
    }
    folder.stdout("thickness shell.chpm -o walls.ply --svg walls.svg -q");
    let painted = folder.read_mesh("walls.ply");
    assert_eq!(painted.colors.len(), painted.positions.len());
    assert!(String::from_utf8(folder.read("walls.svg")).unwrap().contains("thickness, units"));
    let again = folder.stdout("thickness shell.chpm -q --json --threads 3 --memory 80M");
    assert_eq!(again, folder.stdout("thickness shell.chpm -q --json --threads 1"));

    // Behind an open sheet there is nothing.
    folder.stdout("synth terrain --triangles 3000 -o land.ply -q");
    folder.stdout("build land.ply -q");
    let text = folder.stdout("thickness land.chpm -q");
    assert!(text.contains("the surface is open there"), "{text}");
}

/// With all triangles the other way around.
fn turned(mut mesh: TriMesh) -> TriMesh {
    mesh.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
    mesh
}

/// Both, the second one moved along x.
fn beside(mut mesh: TriMesh, other: &TriMesh, by: f32) -> TriMesh {
    let count = mesh.positions.len() as u32;
    mesh.positions.extend(other.positions.iter().map(|[x, y, z]| [x + by, *y, *z]));
    mesh.triangles.extend(other.triangles.iter().map(|corners| corners.map(|v| v + count)));
    mesh
}

#[test]
fn what_is_inside_out_is_as_thick_as_what_is_not() {
    let folder = Folder::new();
    let near = |value: &Value, key: &str| (value[key].as_f64().unwrap() - 0.1).abs() < 2e-3;
    let right = shell(0.9);
    // Of walls of 0.25 times 0.4.
    let mut small = shell(0.75);
    small.positions.iter_mut().for_each(|p| *p = p.map(|x| 0.4 * x));
    for (name, mesh, expected) in [
        ("right", shell(0.9), [2, 0]),
        // The inner sphere's volume is above zero now, and it goes with the outer one.
        ("turned", turned(shell(0.9)), [2, 2]),
        ("one", beside(turned(shell(0.9)), &right, 3.0), [4, 2]),
        // Another shell in the cavity, turned as what is around it.
        ("ball", turned(beside(shell(0.9), &small, 0.1)), [4, 4]),
        ("inner", beside(shell(0.9), &turned(small), 0.1), [4, 2]),
    ] {
        folder.write_mesh("it.ply", &mesh);
        folder.stdout("build it.ply -fq --cluster-triangles 512");
        let value = told(&folder, "thickness it.chpm -q --json");
        assert!(value["open"] == 0 && near(&value, "min") && near(&value, "max"), "{name}: {value}");
        let found = [&value["components"], &value["components_turned"]].map(|n| n.as_u64().unwrap());
        assert_eq!((found, value["inside_out"].as_str()), (expected, Some("auto")), "{name}");
    }

    folder.write_mesh("it.ply", &turned(shell(0.9)));
    folder.stdout("build it.ply -fq --cluster-triangles 512");
    let text = folder.stdout("thickness it.chpm -q");
    assert!(text.contains("2 of 2 components are stored inside out"), "{text}");
    let forced = told(&folder, "thickness it.chpm -q --json --inside-out yes");
    let auto = told(&folder, "thickness it.chpm -q --json");
    assert_eq!((&forced["mean"], &forced["histogram"]), (&auto["mean"], &auto["histogram"]));
    assert!(forced["components"].is_null());
    let stored = told(&folder, "thickness it.chpm -q --json --inside-out no");
    assert!(stored["open"].as_u64() > Some(1000) && stored["max"].as_f64() > Some(1.5), "{stored}");
    let same = folder.stdout("thickness it.chpm -q --json --threads 3 --memory 80M");
    assert_eq!(same, folder.stdout("thickness it.chpm -q --json --threads 1"));
}

/// Two squares of 1 by 1, a fifth apart, whose triangles turn left as seen from outside; neither is closed.
fn plates() -> TriMesh {
    let side = 25_u32;
    let mut mesh = TriMesh::default();
    for (z, is_upper) in [(0.0, false), (0.2, true)] {
        let first = mesh.positions.len() as u32;
        for at in 0..side * side {
            let [x, y] = [at % side, at / side].map(|i| i as f32 / (side - 1) as f32);
            mesh.positions.push([x, y, z]);
        }
        for at in (0..side * (side - 1)).filter(|at| at % side < side - 1) {
            let [a, b, c, d] = [0, 1, side + 1, side].map(|step| first + at + step);
            let two = if is_upper { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] };
            mesh.triangles.extend(two);
        }
    }
    mesh
}

#[test]
fn plates_are_as_thick_as_they_are_apart() {
    let folder = Folder::new();
    for (mesh, count) in [(plates(), 0), (turned(plates()), 2)] {
        folder.write_mesh("plates.ply", &mesh);
        folder.stdout("build plates.ply -fq --cluster-triangles 256");
        let value = told(&folder, "thickness plates.chpm --cone 0 -q --json");
        assert_eq!((value["open"].as_u64(), value["vertices"].as_u64()), (Some(0), Some(1250)), "{value}");
        assert_eq!(
            (value["components"].as_u64(), value["components_turned"].as_u64()),
            (Some(2), Some(count))
        );
        for key in ["min", "max"] {
            assert!((value[key].as_f64().unwrap() - 0.2).abs() < 1e-6, "{value}");
        }
    }
    // A land is open, whichever side is up.
    folder.stdout("synth terrain --triangles 3000 -o land.ply -q");
    let land = folder.read_mesh("land.ply");
    for (mesh, name) in [(turned(land.clone()), "down"), (land, "up")] {
        folder.write_mesh("land.ply", &mesh);
        folder.stdout("build land.ply -fq");
        let value = told(&folder, "thickness land.chpm -q --json");
        assert_eq!(value["components_turned"], 0, "{name}");
        // What no vertex has, has no mean.
        let numbers = ["min", "max", "mean", "rms", "percentiles"].map(|key| value[key].is_null());
        assert_eq!(numbers, [value["vertices"] == 0; 5], "{value}");
    }
    folder.write("sheet.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n");
    folder.stdout("build sheet.off -q");
    let value = told(&folder, "thickness sheet.chpm -q --json");
    assert!(value["vertices"] == 0 && value["mean"].is_null() && value["percentiles"].is_null(), "{value}");
    for words in ["--error 1%", "--level 0"] {
        for view in ["--cull", "--viewport 100x100"] {
            let refused = folder.stderr(&format!("extract land.chpm {words} {view} -o no.ply"), 2);
            assert!(refused.contains("cannot be used with"), "{refused}");
        }
    }
}

#[test]
fn half_of_a_sphere_is_seen_from_far_away() {
    let folder = ball();
    let value = told(&folder, "visible ball.chpm --from 1000,0,0 --from=-1000,0,0 -q --json");
    let counts: Vec<u64> =
        value["histogram"].as_array().unwrap().iter().map(|x| x.as_u64().unwrap()).collect();
    let all = value["vertices"].as_u64().unwrap();
    assert_eq!(counts.iter().sum::<u64>(), all);
    // All from one of them, but for some about the rim.
    assert!(counts[1] > all * 95 / 100 && counts[0] + counts[2] < all / 20, "{value}");
    let near = told(&folder, "visible ball.chpm --from 2,0,0 -q --json");
    let seen = near["histogram"][1].as_u64().unwrap() as f64 / all as f64;
    // A cap of height 1 - 1/2, of the sphere's 2.
    assert!((seen - 0.25).abs() < 0.04, "{near}");
    let inside = told(&folder, "visible ball.chpm --from 0,0,0 -q --json");
    assert_eq!(inside["histogram"][1], all);
    folder.stdout("visible ball.chpm --from 2,0,0 -o seen.ply -q");
    let painted = folder.read_mesh("seen.ply");
    let (low, high) = (
        painted.positions.iter().position(|p| p[0] < -0.9),
        painted.positions.iter().position(|p| p[0] > 0.9),
    );
    assert_ne!(painted.colors[low.unwrap()], painted.colors[high.unwrap()]);
}
