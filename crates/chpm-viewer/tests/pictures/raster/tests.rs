//! Pictures with exact answers.

use super::*;
use proptest::prelude::*;

/// Sixteen by eight pixels; at depth 1, a pixel is a quarter wide, and columns and rows are counted from the upper left corner.
fn camera() -> Camera {
    let camera = Camera::looking([0.0; 3], [0.0, 0.0, -1.0]);
    Camera { fov: 2.0 * 1f64.atan().to_degrees(), ..camera }
}

const SIZE: [u32; 2] = [16, 8];

fn raster() -> Raster {
    Raster::new(&camera(), SIZE, 0.0).unwrap()
}

/// The point that is seen at a place of the image, at a depth.
fn point([x, y]: [f64; 2], depth: f64) -> [f64; 3] {
    [depth * (x - 8.0) / 4.0, depth * (4.0 - y) / 4.0, -depth]
}

fn id(triangle: u32) -> TriangleId {
    TriangleId { model: 0, cluster: ClusterId(0), triangle }
}

fn draw(raster: &mut Raster, n: u32, corners: [[f64; 2]; 3], depth: f64) {
    raster.draw(id(n), corners.map(|corner| point(corner, depth)));
}

/// A letter for each pixel, a row for each row.
fn text(raster: &Raster) -> Vec<String> {
    let letter = |id: &Option<TriangleId>| id.map_or('.', |id| char::from(b'a' + id.triangle as u8));
    let pixels: Vec<char> = raster.ids().pixels.iter().map(letter).collect();
    pixels.chunks(16).map(|row| row.iter().collect()).collect()
}

#[test]
fn samples_are_the_centres_of_pixels() {
    let mut raster = raster();
    // Its lower left corner is cut off where x + y = 7: the samples there lie on the edge.
    draw(&mut raster, 0, [[2.0, 1.0], [6.0, 1.0], [2.0, 5.0]], 3.0);
    let rows = text(&raster);
    assert_eq!(rows[1..5], ["..aaa...........", "..aa............", "..a.............", "................"]);
    assert!(rows[0].chars().chain(rows[5].chars()).all(|c| c == '.'));
}

#[test]
fn an_edge_belongs_to_the_one_that_it_is_the_top_or_left_of() {
    let mut raster = raster();
    // A square with corners at samples, cut along its diagonal: the sides at the top and on the left are in it, the others are not.
    let [a, b, c, d] = [[2.5, 1.5], [5.5, 1.5], [5.5, 4.5], [2.5, 4.5]];
    draw(&mut raster, 0, [a, b, c], 1.0);
    draw(&mut raster, 1, [a, d, c], 1.0);
    assert_eq!(
        text(&raster)[1..5],
        ["..aaa...........", "..baa...........", "..bba...........", "................"]
    );
    assert!(!raster.is_certain(16 + 2), "on an edge");
    assert!(!raster.is_certain(2 * 16 + 3), "on the diagonal");
    assert!(raster.is_certain(2 * 16 + 4) && raster.is_certain(0));
}

#[test]
fn the_nearest_is_seen_from_either_side_in_any_order() {
    let near = [[2.0, 1.0], [12.0, 1.0], [2.0, 7.0]];
    let far = [[0.0, 0.0], [0.0, 8.0], [16.0, 8.0]];
    let (mut first, mut second) = (raster(), raster());
    draw(&mut first, 0, near, 2.0);
    draw(&mut first, 1, far, 2.001);
    draw(&mut second, 1, [far[1], far[0], far[2]], 2.001);
    draw(&mut second, 0, near, 2.0);
    assert_eq!(text(&first), text(&second));
    assert_eq!(text(&first)[5], "bbaabbbbbbb.....");
    let place = 5 * 16 + 2;
    assert!((first.depths()[place] - 2.0).abs() < 1e-12 && first.is_certain(place));
    assert_eq!(first.depths()[15], f64::INFINITY);
}

#[test]
fn equally_near_is_not_certain() {
    let mut raster = raster();
    let corners = [[0.0, 0.0], [16.0, 0.0], [0.0, 8.0]];
    draw(&mut raster, 0, corners, 1.0);
    draw(&mut raster, 1, corners, 1.0);
    assert!(text(&raster)[0].starts_with("aaa"), "the first one stays");
    assert!((0..16).all(|place| raster.pixels[place].seen.is_none() || !raster.is_certain(place)));
    // And a nearer third one settles it.
    draw(&mut raster, 2, corners, 0.5);
    assert!(text(&raster)[0].starts_with("ccc") && raster.is_certain(1));
}

/// Depth across a tilted triangle is perspective: halfway in the image is nearer than halfway in space.
#[test]
fn depth_is_perspective() {
    let mut raster = raster();
    let (near, far) = (1.0, 3.0);
    raster.draw(id(0), [point([0.0, 0.5], near), point([16.0, 0.5], far), point([0.0, 8.5], near)]);
    let place = 16;
    // Row 1, column 0: a sixteenth and half a pixel into the triangle.
    let expected = 1.0 / (1.0 / near + (0.5 / 16.0) * (1.0 / far - 1.0 / near));
    assert!((raster.depths()[place] - expected).abs() < 1e-12);
}

#[test]
fn the_near_plane_cuts() {
    let corners = [[-9.0, -3.0, -0.5], [9.0, -3.0, -0.5], [0.0, 40.0, -20.0]];
    let behind = [[-9.0, -3.0, 5.0], [9.0, -3.0, 5.0], [0.0, 4.0, -20.0]];
    let draw = |corners, near| {
        let mut raster = Raster::new(&camera(), SIZE, near).unwrap();
        raster.draw(id(0), corners);
        raster
    };
    for (corners, near) in [(corners, 1.0), (corners, 0.0), (behind, 0.0), (behind, 2.0)] {
        let depths = draw(corners, near).depths();
        let seen: Vec<f64> = depths.iter().copied().filter(|depth| depth.is_finite()).collect();
        assert!(!seen.is_empty() && seen.iter().all(|depth| *depth >= near), "{near}");
    }
    assert!(draw(behind, 30.0).ids().pixels.iter().all(Option::is_none), "all of it is nearer");
    let cut = draw(corners, 3.0).ids().pixels.iter().flatten().count();
    assert!(cut < draw(corners, 0.0).ids().pixels.iter().flatten().count());
}

#[test]
fn what_no_camera_is_is_refused() {
    let camera = Camera { fov: 180.0, ..camera() };
    assert!(matches!(Raster::new(&camera, SIZE, 0.0), Err(ViewerError::View(_))));
    assert!(matches!(Raster::new(&self::camera(), [0, 8], 0.0), Err(ViewerError::View(_))));
}

fn corner() -> impl Strategy<Value = [f64; 2]> {
    // Quarters of a pixel: many samples lie on edges.
    (-8i32..72, -8i32..40).prop_map(|(x, y)| [f64::from(x) / 4.0, f64::from(y) / 4.0])
}

#[test]
fn what_has_no_area_leaves_doubt_and_nothing_else() {
    for line in
        [[[13.5, 1.0], [13.5, 1.0], [13.5, 4.0]], [[13.5, 1.0], [13.5, 3.0], [13.5, 4.0]], [[13.5, 2.5]; 3]]
    {
        let mut raster = raster();
        draw(&mut raster, 0, line, 1.0);
        assert!(raster.ids().pixels.iter().all(Option::is_none));
        let doubtful = (0..raster.ids().pixels.len()).filter(|place| !raster.is_certain(*place)).count();
        assert!((1..=3).contains(&doubtful), "{line:?}: {doubtful} pixels");
    }
}

proptest! {
    /// A triangle cut in three at an inner point: every sample that it covers is covered by exactly one of the parts.
    #[test]
    fn parts_leave_no_sample_out_and_take_none_twice(
        corners in [corner(), corner(), corner()], weights in [0.0f64..1.0, 0.0..1.0, 0.1..1.0]
    ) {
        let sum: f64 = weights.iter().sum();
        let inner = [0, 1].map(|axis| (0..3).map(|i| weights[i] * corners[i][axis]).sum::<f64>() / sum);
        let part = |i: usize| {
            let mut raster = raster();
            draw(&mut raster, 0, [corners[i], corners[(i + 1) % 3], inner], 1.0);
            raster.ids().pixels
        };
        let mut whole = raster();
        draw(&mut whole, 0, corners, 1.0);
        let parts = [part(0), part(1), part(2)];
        for (place, seen) in whole.ids().pixels.iter().enumerate() {
            let covered = parts.iter().filter(|part| part[place].is_some()).count();
            // The projection rounds the inner point: a sample at the outline may be won or lost with it.
            if whole.is_certain(place) || seen.is_some() {
                prop_assert_eq!(covered, usize::from(seen.is_some()), "pixel {}", place);
            }
        }
    }

    /// Where a pixel is certain, moving all corners by what hardware may changes nothing.
    #[test]
    fn certain_pixels_survive_rounding(
        triangles in prop::collection::vec(([corner(), corner(), corner()], 1.0f64..2.0), 1..12),
        moves in prop::collection::vec((-1.0f64..1.0, -1.0f64..1.0), 36),
    ) {
        let (mut exact, mut moved) = (raster(), raster());
        let mut moves = moves.into_iter().cycle();
        for (n, (corners, depth)) in (0..).zip(triangles) {
            draw(&mut exact, n, corners, depth);
            let corners = corners.map(|[x, y]| {
                let (dx, dy) = moves.next().unwrap_or_default();
                [x + dx / 512.0, y + dy / 512.0]
            });
            draw(&mut moved, n, corners, depth);
        }
        let (exact_ids, moved_ids) = (exact.ids().pixels, moved.ids().pixels);
        for place in 0..exact_ids.len() {
            if exact.is_certain(place) {
                prop_assert_eq!(exact_ids[place], moved_ids[place], "pixel {}", place);
            }
        }
    }
}
