use super::*;
use crate::bvh::squared_distance;
use chpm_mesh::{Aabb, TriMesh};
use chpm_synth::{Shape, Synth, hand};
use proptest::prelude::*;

const LIMIT: u64 = 100_000;

/// A mesh as a surface of tiles of `each` triangles.
fn tiles(mesh: &TriMesh, each: usize) -> Tiles<'_> {
    let parts: Vec<&[[u32; 3]]> = mesh.triangles.chunks(each).collect();
    let bounds =
        |part: &[[u32; 3]]| Aabb::of_points(part.iter().flatten().map(|v| &mesh.positions[*v as usize]));
    let boxes = parts.iter().map(|part| bounds(part)).collect();
    Tiles::new(boxes, u64::MAX, move |tile| TriMesh::new(mesh.positions.clone(), parts[tile].to_vec()))
}

fn prover<'a>(target: &'a Tiles<'a>) -> Prover<'a> {
    Prover::new(target, &|| false)
}

fn triangles(mesh: &TriMesh) -> impl Iterator<Item = Corners> + '_ {
    mesh.triangles.iter().map(|t| mesh.corners(*t))
}

/// The largest distance of `a`'s points from `b`, between two bounds, and the most pieces that a triangle took.
fn interval(a: &TriMesh, b: &TriMesh) -> ([f64; 2], u64) {
    let target = tiles(b, 5);
    let mut prover = prover(&target);
    for triangle in triangles(a) {
        prover.within(triangle, &Allowed::Same(f64::MAX), LIMIT);
    }
    let mut lower = prover.far().map_or(0.0, |(distance, _)| distance);
    let (mut upper, mut pieces) = (0.0f64, 0);
    for triangle in triangles(a) {
        upper = upper.max(prover.farthest(triangle, &mut lower, 0.01, LIMIT).0);
    }
    for triangle in triangles(a) {
        pieces = pieces.max(prover.within(triangle, &Allowed::Same(upper), LIMIT).pieces);
    }
    ([lower, upper], pieces)
}

fn verdict(triangle: Corners, b: &TriMesh, distance: f64) -> Verdict {
    prover(&tiles(b, 5)).within(triangle, &Allowed::Same(distance), LIMIT).verdict
}

fn moved(mesh: &TriMesh, by: [f32; 3]) -> TriMesh {
    let positions = mesh.positions.iter().map(|p| std::array::from_fn(|a| p[a] + by[a])).collect();
    TriMesh::new(positions, mesh.triangles.clone())
}

/// The largest distance of samples: all corners of a fine subdivision.
fn sampled(a: &TriMesh, b: &TriMesh, steps: u32) -> f64 {
    let mut upper = 0.0f64;
    for corners in triangles(a) {
        let [p, q, r] = corners.map(chpm_mesh::geom::to_f64);
        for i in 0..=steps {
            for j in 0..=steps - i {
                let part = |k: u32| f64::from(k) / f64::from(steps);
                let point = p + (q - p) * part(i) + (r - p) * part(j);
                let nearest = triangles(b).map(|t| squared_distance(point, t)).fold(f64::INFINITY, f64::min);
                upper = upper.max(nearest.sqrt());
            }
        }
    }
    upper
}

#[test]
fn known_distances_are_enclosed() {
    let plane = hand::grid(4, 4);
    let triangle = |corners: Corners| TriMesh::new(corners.to_vec(), vec![[0, 1, 2]]);
    let apart = triangle([[0.0, 0.0, 1.0], [4.0, 0.0, 1.0], [0.0, 4.0, 3.0]]);
    // The deepest point below a roof is inside both triangles of the floor.
    let roof = TriMesh::new(
        vec![[-2.0, -2.0, 0.0], [2.0, -2.0, 0.0], [2.0, 2.0, 0.0], [-2.0, 2.0, 0.0], [0.0, 0.0, 1.0]],
        vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]],
    );
    let floor = TriMesh::new(roof.positions[..4].to_vec(), vec![[0, 1, 2], [0, 2, 3]]);
    let side = triangle([[5.0, 0.0, 0.0], [5.0, 1.0, 0.0], [7.0, 0.0, 0.0]]);
    for (name, a, b, expected) in [
        ("itself", &plane, &plane, 0.0),
        ("parallel", &moved(&plane, [0.0, 0.0, 0.25]), &plane, 0.25),
        ("aslant", &apart, &plane, 3.0),
        ("roof", &roof, &floor, 1.0),
        ("floor", &floor, &roof, 2.0 / 5f64.sqrt()),
        ("beside", &side, &plane, 3.0),
    ] {
        let ([lower, upper], _) = interval(a, b);
        assert!(lower <= expected && expected <= upper, "{name}: {lower} {upper}");
        assert!(upper - lower <= 0.0101 * expected + 1e-10, "{name}: {lower} {upper}");
        for t in triangles(a) {
            assert_eq!(verdict(t, b, expected), Verdict::Within, "{name}");
        }
        let beyond = |t| match verdict(t, b, expected - 1e-3) {
            Verdict::Beyond(witness) => {
                assert!(witness.distance > expected - 1e-3 && witness.distance <= expected, "{witness:?}");
                true
            }
            other => {
                assert_eq!(other, Verdict::Within, "{name}");
                false
            }
        };
        assert!(expected == 0.0 || triangles(a).filter(|t| beyond(*t)).count() > 0, "{name}");
    }
}

#[test]
fn other_triangles_of_the_same_plane_are_no_distance_away() {
    // No edge of one is one of the other, and nothing is left between: a few pieces for each overlap.
    let fine = hand::grid(40, 40);
    let [a, b, c] = [[0.3, 0.2, 0.0], [39.7, 11.1, 0.0], [7.9, 38.3, 0.0]];
    let target = tiles(&fine, 64);
    let found = prover(&target).within([a, b, c], &Allowed::Same(0.0), LIMIT);
    assert_eq!(found.verdict, Verdict::Within);
    let overlaps = 2.0 * 0.5 * (39.4 * 38.1 - 10.9 * 7.6);
    assert!(found.pieces < 8 * overlaps as u64, "{} of {overlaps}", found.pieces);
    assert!(found.reached <= 40.0 * 2.0 * LOSS, "{}", found.reached);
    // The same on a slope, where singles are off the plane by their rounding and no more.
    let slope = |p: &[f32; 3]| [p[0] * 0.1, p[1] * 0.1, (0.037 * p[0] - 0.011 * p[1]) * 0.3];
    let fine = TriMesh::new(fine.positions.iter().map(slope).collect(), fine.triangles.clone());
    let [a, b, c] = [a, b, c].map(|p| slope(&p));
    let target = tiles(&fine, 64);
    let found = prover(&target).within([a, b, c], &Allowed::Same(1e-7), LIMIT);
    assert_eq!(found.verdict, Verdict::Within);
    assert!(found.pieces < 12 * overlaps as u64, "{} of {overlaps}", found.pieces);
}

#[test]
fn creases_of_needles_take_a_few_pieces_for_each() {
    // A million times as long as wide, and a ridge along every second edge.
    let positions: Vec<[f32; 3]> = (0..=30)
        .flat_map(|i| {
            [[0.0, i as f32 * 1e-6, (i % 2) as f32 * 4e-7], [1.0, i as f32 * 1e-6, (i % 2) as f32 * 4e-7]]
        })
        .collect();
    let needles = (0..30).flat_map(|i| [[2 * i, 2 * i + 1, 2 * i + 3], [2 * i, 2 * i + 3, 2 * i + 2]]);
    let mesh = TriMesh::new(positions, needles.collect());
    let target = tiles(&mesh, 7);
    for y in 8..20 {
        let middle = y as f32 * 1e-6;
        let across = [[0.0, middle, 5e-7], [1.0, middle - 6e-6, 6e-7], [1.0, middle + 7e-6, 5e-7]];
        let found = prover(&target).within(across, &Allowed::Same(5.8e-7), LIMIT);
        assert!(found.verdict == Verdict::Within && found.pieces < 2000, "{found:?}");
    }
}

#[test]
fn giving_up_is_no_proof() {
    let fine = hand::grid(40, 40);
    let target = tiles(&fine, 64);
    let big = [[0.3, 0.2, 0.0], [39.7, 11.1, 0.0], [7.9, 38.3, 0.0]];
    for limit in [1, 10, 500] {
        let found = prover(&target).within(big, &Allowed::Same(0.0), limit);
        assert_eq!((found.verdict, found.pieces), (Verdict::Undecided, limit));
        assert!(found.reached > 1.0, "{found:?}");
    }
}

#[test]
fn who_stops_is_not_told_that_all_is_well() {
    let fine = hand::grid(40, 40);
    let target = tiles(&fine, 64);
    let big = [[0.3, 0.2, 0.0], [39.7, 11.1, 0.0], [7.9, 38.3, 0.0]];
    let found = Prover::new(&target, &|| true).within(big, &Allowed::Same(0.0), LIMIT);
    assert_eq!((found.verdict, found.pieces), (Verdict::Undecided, ASKED));
}

#[test]
fn nothing_is_infinitely_far() {
    let nothing = TriMesh::default();
    let found = prover(&tiles(&nothing, 5)).within([[1.0; 3]; 3], &Allowed::Same(f64::from(f32::MAX)), LIMIT);
    let Verdict::Beyond(witness) = found.verdict else { panic!("{found:?}") };
    assert_eq!((witness.distance, witness.at, found.reached), (f64::INFINITY, [1.0; 3], f64::INFINITY));
}

#[test]
fn shapes_without_area_and_of_any_size_are_judged() {
    for size in [1e-38f32, 1e-3, 1.0, 1e12, 1e36] {
        let scaled = |corners: Corners| corners.map(|p| p.map(|x| x * size));
        let mesh = |corners: Corners| TriMesh::new(scaled(corners).to_vec(), vec![[0, 1, 2]]);
        let far = f64::from(size);
        let needle = mesh([[0.0; 3], [1.0, 0.0, 0.0], [0.5, 0.0, 0.0]]);
        let point = mesh([[0.0, 0.0, 1.0]; 3]);
        let full = mesh([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]]);
        // The needle sticks out of the full triangle by its end.
        for (a, b, expected) in
            [(&needle, &full, 1.0 / 5f64.sqrt()), (&point, &full, 1.0), (&full, &point, 3f64.sqrt())]
        {
            let ([lower, upper], _) = interval(a, b);
            let expected = expected * far;
            assert!(
                lower <= expected * (1.0 + 1e-6) && expected <= upper * (1.0 + 1e-6),
                "{size}: {lower} {expected} {upper}"
            );
            assert!(upper <= lower * 1.0102, "{size}: {lower} {upper}");
        }
    }
}

#[test]
fn coincident_sheets_and_crowds_are_judged_in_few_pieces() {
    let sheet = hand::grid(6, 6);
    let mut many = sheet.clone();
    for _ in 0..20 {
        many.triangles.extend_from_slice(&sheet.triangles);
    }
    // Thousands of triangles about one edge.
    let turned = |i: u32| {
        let angle = f64::from(i) * 1e-3;
        [angle.cos() as f32, angle.sin() as f32, 0.3]
    };
    let mut book = TriMesh::new(vec![[0.0; 3], [0.0, 0.0, 1.0]], vec![]);
    for i in 0..3000 {
        book.positions.push(turned(i));
        book.triangles.push([0, 1, 2 + i]);
    }
    for mesh in [&many, &book] {
        let ([lower, upper], pieces) = interval(mesh, mesh);
        assert!(lower == 0.0 && upper <= 1e-11 && pieces < 50, "{lower} {upper} {pieces}");
    }
}

#[test]
fn tiles_answer_with_their_own_distances() {
    // Two sheets, one of which may be far and is, and one that may not be.
    let mut both = hand::grid(2, 2);
    let above = moved(&both, [0.0, 0.0, 10.0]);
    let count = both.positions.len() as u32;
    both.positions.extend(&above.positions);
    both.triangles.extend(above.triangles.iter().map(|t| t.map(|v| v + count)));
    let target = tiles(&both, 8);
    assert_eq!(target.count(), 2);
    let at = |z: f32| [[0.5, 0.5, z], [1.5, 0.5, z], [0.5, 1.5, z]];
    let ask = |z: f32, of: [f64; 2]| {
        prover(&target).within(at(z), &Allowed::own(&target, of.to_vec()), LIMIT).verdict
    };
    // Nearer to the lower one, which would allow less.
    assert_eq!(ask(4.0, [1.0, 6.0]), Verdict::Within);
    assert_eq!(ask(4.0, [4.0, 0.0]), Verdict::Within);
    let Verdict::Beyond(witness) = ask(4.0, [3.9, 5.9]) else { panic!("it is too far from both") };
    assert!(witness.distance > 3.99 && witness.distance <= 4.0 && witness.tile == 0, "{witness:?}");
}

#[test]
fn where_one_tile_allows_too_little_another_answers() {
    // Up to a wire, to its very distance; what is farther only the far point allows, at twice its distance.
    let positions = vec![[5.0, -9.0, 0.0], [5.0, 9.0, 0.0], [5.0, 0.0, 0.0], [-60.0, 1.0, 2.0]];
    let mesh = TriMesh::new(positions, vec![[0, 1, 2], [3, 3, 3]]);
    let target = tiles(&mesh, 1);
    let across = [[-1.0, 0.3, 0.1], [4.9, -2.0, 0.2], [4.8, 2.0, 1.7]];
    let found = prover(&target).within(across, &Allowed::own(&target, vec![2.5, 130.0]), LIMIT);
    assert!(found.verdict == Verdict::Within && found.pieces < 100, "{found:?}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 16, ..ProptestConfig::default() })]

    /// Samples never go beyond the upper bound, and nearly come up to the lower one.
    #[test]
    fn intervals_hold_what_samples_find(seed in 0u64..1000, other in 0u64..1000, fineness in 30u64..80) {
        let shape = |seed: u64| Shape::ALL[seed as usize % 5];
        let a = Synth::new(shape(seed), fineness, seed).to_mesh();
        let b = Synth::new(shape(other), 100, other).to_mesh();
        let ([lower, upper], _) = interval(&a, &b);
        let found = sampled(&a, &b, 8);
        prop_assert!(found <= upper + 1e-12, "{lower} {found} {upper}");
        prop_assert!(upper <= lower * 1.0101 + 1e-10, "{lower} {upper}");
        // Samples are this near to every point.
        let spacing = triangles(&a).map(|t| Face::new(t).radius()).fold(0.0, f64::max) / 4.0;
        prop_assert!(lower <= found + spacing, "{lower} {found}");
    }

    /// Triangles anywhere, slivers and crossing ones: what is within is, and a witness is one.
    #[test]
    fn verdicts_hold_for_samples(
        crowd in prop::collection::vec(prop::array::uniform3(prop::array::uniform3(-1.0f32..1.0)), 1..12),
        flatness in prop::array::uniform3(0i32..24),
        triangle in prop::array::uniform3(prop::array::uniform3(-1.0f32..1.0)),
        distance in 0.0f64..1.5,
    ) {
        let flat = |c: [f32; 3]| std::array::from_fn(|a| c[a] * 0.5f32.powi(flatness[a]));
        let crowd: Vec<Corners> = crowd.into_iter().map(|t| t.map(flat)).collect();
        let triangle = triangle.map(flat);
        let count = crowd.len() as u32;

        let mesh = TriMesh::new(
            crowd.as_flattened().to_vec(),
            (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        );
        let target = tiles(&mesh, 2);
        let found = prover(&target).within(triangle, &Allowed::Same(distance), LIMIT);
        let alone = TriMesh::new(triangle.to_vec(), vec![[0, 1, 2]]);
        let upper = sampled(&alone, &mesh, 30);

        match found.verdict {
            Verdict::Within => {
                prop_assert!(upper <= distance + 1e-9, "{upper} {distance}");
                prop_assert!(found.reached <= distance + 2.0 * LOSS);
            }
            Verdict::Beyond(witness) => {
                prop_assert!(witness.distance > distance);
                let nearest = crowd.iter().map(|t| squared_distance(witness.at.into(), *t));
                let nearest = nearest.fold(f64::INFINITY, f64::min).sqrt();
                prop_assert!(nearest >= witness.distance && nearest <= witness.distance + 1e-6, "{witness:?} {nearest}");
            }
            Verdict::Undecided => prop_assert!(false, "{found:?}"),
        }
        prop_assert!(upper <= found.reached + 1e-9, "{upper} {found:?}");
    }
}
