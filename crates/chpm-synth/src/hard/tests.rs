use super::*;
use chpm_mesh::{Aabb, geom};
use std::collections::BTreeMap;

fn mesh(name: &str, triangles: u32) -> TriMesh {
    Case::find(name).unwrap_or_else(|| panic!("no case '{name}'")).mesh(triangles)
}

/// Faces of each edge.
fn edges(mesh: &TriMesh) -> BTreeMap<[u32; 2], usize> {
    let mut faces = BTreeMap::new();
    for [a, b, c] in &mesh.triangles {
        for (u, v) in [(a, b), (b, c), (c, a)] {
            *faces.entry([*u.min(v), *u.max(v)]).or_insert(0) += 1;
        }
    }
    faces
}

/// How many edges have how many faces.
fn faces_of_edges(mesh: &TriMesh) -> BTreeMap<usize, usize> {
    let mut counts = BTreeMap::new();
    edges(mesh).into_values().for_each(|faces| *counts.entry(faces).or_insert(0) += 1);
    counts
}

/// The longest side and twice the area.
fn longest_and_area(mesh: &TriMesh, triangle: &[u32; 3]) -> (f64, f64) {
    let [a, b, c] = mesh.corners(*triangle);
    let sides = [(a, b), (b, c), (c, a)].map(|(p, q)| geom::distance(p, q));
    (sides.into_iter().fold(0.0, f64::max), geom::area_vector(a, b, c).norm())
}

fn distinct(mesh: &TriMesh) -> usize {
    let mut places: Vec<[u32; 3]> = mesh.positions.iter().map(|p| p.map(f32::to_bits)).collect();
    places.sort_unstable();
    places.dedup();
    places.len()
}

#[test]
fn every_case_is_a_mesh_of_about_the_size_that_was_asked_for() {
    for case in &CASES {
        for wanted in [10_000, 40_000] {
            let mesh = case.mesh(wanted);
            let got = mesh.triangles.len() as f64;
            assert!((got / f64::from(wanted) - 1.0).abs() < 0.25, "{case:?}: {got} of {wanted}");
            assert!(mesh.positions.as_flattened().iter().all(|x| x.is_finite()), "{case:?}");
            let mut used = vec![false; mesh.positions.len()];
            mesh.triangles.as_flattened().iter().for_each(|v| used[*v as usize] = true);
            assert!(used.iter().all(|used| *used), "{case:?} has vertices that no triangle uses");
            assert!(mesh.triangles.iter().all(|[a, b, c]| a != b && b != c && c != a), "{case:?}");
        }
        let bits = |mesh: TriMesh| -> Vec<u32> {
            mesh.positions.concat().into_iter().map(f32::to_bits).chain(mesh.triangles.concat()).collect()
        };
        assert!(bits(case.mesh(3000)) == bits(case.mesh(3000)), "{case:?} differs from itself");
        assert!(!case.mesh(0).triangles.is_empty(), "{case:?}");
        assert!(case.full <= Case::MAX_TRIANGLES, "{case:?}");
    }
}

#[test]
fn names_are_words_and_differ() {
    let mut names: Vec<&str> = CASES.iter().map(|case| case.name).collect();
    assert!(names.iter().all(|name| name.chars().all(|c| c.is_ascii_lowercase() || c == '-')));
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), CASES.len());
    assert!(Case::find("plane").is_some() && Case::find("").is_none());
}

#[test]
fn numbers_are_what_they_are_called() {
    let extent = |name| {
        let bounds = Aabb::of_points(&mesh(name, 10_000).positions);
        (0..3).map(|a| f64::from(bounds.max[a]) - f64::from(bounds.min[a])).fold(0.0, f64::max)
    };
    for (name, expected) in [("tiny", 1e-9), ("huge", 1e9), ("denormals", 1e-40), ("far", 2000.0)] {
        assert!((extent(name) / expected - 1.0).abs() < 1e-2, "{name}: {}", extent(name));
    }
    assert!(
        mesh("far", 10_000).vertices.positions.as_flattened().iter().all(|x| *x > 9.9e6 && x.fract() == 0.0)
    );
    let coordinates = mesh("denormals", 10_000).vertices.positions;
    assert!(coordinates.as_flattened().iter().all(|x| *x == 0.0 || x.is_subnormal()));
    let heights: Vec<f32> = mesh("orders", 10_000).vertices.positions.iter().map(|p| p[2]).collect();
    let [low, high] = [f32::min, f32::max].map(|pick| heights.iter().copied().fold(1.0, pick));
    assert!(low < 1e-6 && high > 1e6, "{low} to {high}");
    let zeros = mesh("zeros", 10_000).vertices.positions;
    let count = |bits: u32| zeros.iter().filter(|p| p[0].to_bits() == bits).count();
    assert_eq!(count(0.0_f32.to_bits()), count((-0.0_f32).to_bits()));
    assert!(count(0.0_f32.to_bits()) > 10);
}

#[test]
fn flat_ones_are_flat_to_the_last_bit() {
    for [x, y, z] in mesh("plane", 10_000).vertices.positions {
        assert_eq!(f64::from(z), 0.25 * f64::from(x) + 0.5 * f64::from(y));
    }
    for [x, y, z] in mesh("line", 10_000).vertices.positions {
        assert!(y == 2.0 * x && z == 4.0 * x);
    }
    let line = mesh("line", 10_000);
    assert_eq!(distinct(&line), line.positions.len());
    assert!(line.triangles.iter().all(|t| longest_and_area(&line, t).1 == 0.0));
    assert_eq!(distinct(&mesh("point", 10_000)), 1);
    let tube = mesh("cylinder", 10_000).vertices.positions;
    let mut rulings: Vec<[u32; 2]> = tube.iter().map(|p| [p[0], p[1]].map(f32::to_bits)).collect();
    rulings.sort_unstable();
    rulings.dedup();
    assert!(rulings.len().pow(2) <= 2 * tube.len(), "{} rulings", rulings.len());
    let folded = mesh("folded", 10_000);
    assert!(distinct(&folded) * 7 < folded.positions.len());
}

#[test]
fn plates_look_up_wherever_their_vertices_went() {
    for name in ["plane", "needles"] {
        let mesh = mesh(name, 10_000);
        assert!(
            mesh.triangles.iter().all(|t| {
                let [a, b, c] = mesh.corners(*t);
                geom::area_vector(a, b, c).z > 0.0
            }),
            "{name}"
        );
    }
}

#[test]
fn slivers_have_an_aspect_of_a_million() {
    let aspect = |mesh: &TriMesh, t: &[u32; 3]| {
        let (longest, area) = longest_and_area(mesh, t);
        longest * longest / area
    };
    let needles = mesh("needles", 10_000);
    let least = needles.triangles.iter().map(|t| aspect(&needles, t)).fold(f64::INFINITY, f64::min);
    assert!(least > 0.9e6, "{least}");
    let caps = mesh("caps", 10_000);
    let flat = caps.triangles.iter().filter(|t| aspect(&caps, t) > 0.9e6).count();
    assert_eq!(flat * 4, caps.triangles.len());
    assert_eq!(faces_of_edges(&caps).keys().copied().collect::<Vec<_>>(), [1, 2]);
}

#[test]
fn pieces_are_as_many_and_as_far_apart_as_they_should() {
    for name in ["soup", "unwelded"] {
        let mesh = mesh(name, 10_000);
        assert_eq!(mesh.positions.len(), 3 * mesh.triangles.len(), "{name}");
    }
    let full = Case::find("components").expect("a case").full;
    assert_eq!(full / 4, 100_000);
    assert_eq!(mesh("components", 10_000).vertices.positions.len(), 10_000);
    let giant = mesh("giant", 10_000);
    let large = giant.triangles.iter().filter(|t| longest_and_area(&giant, t).0 > 1e6).count();
    assert_eq!(large, 1);
}

#[test]
fn edges_have_as_many_faces_as_they_should() {
    let pages = faces_of_edges(&mesh("pages", 10_000));
    assert!((3..=50).all(|faces| pages.contains_key(&faces)), "{pages:?}");
    assert_eq!(pages.keys().max(), Some(&50));
    let kinds = |name| faces_of_edges(&mesh(name, 10_000)).into_keys().collect::<Vec<_>>();
    assert_eq!(kinds("doubled"), [2, 4]);
    assert_eq!(kinds("voxels"), [2, 4]);
    assert_eq!(kinds("cubes"), [2, 4, 8]);
    for closed in ["klein", "crossing", "spikes", "winding", "tiny", "poles", "components"] {
        assert_eq!(kinds(closed), [2], "{closed}");
    }
    for sheet in ["moebius", "fan", "sheets", "bow-ties", "zeros", "plane", "cylinder", "strip", "orders"] {
        assert_eq!(kinds(sheet), [1, 2], "{sheet}");
    }
    assert_eq!(mesh("fan", 10_000).triangles.iter().filter(|t| t.contains(&0)).count(), 10_000);
    let poles = mesh("poles", 10_000);
    let euler = poles.positions.len() + poles.triangles.len() - edges(&poles).len();
    assert_eq!(euler, 2);
    let moebius = mesh("moebius", 10_000);
    assert_eq!(moebius.positions.len() + moebius.triangles.len(), edges(&moebius).len());
}
