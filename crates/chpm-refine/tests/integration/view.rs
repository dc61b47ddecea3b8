use chpm_mesh::Aabb;
use chpm_refine::{Camera, RefineError, Region, View};
use proptest::prelude::*;

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
}

fn sphere(center: [f64; 3], radius: f64) -> Region {
    Region::sphere(center, radius)
}

/// Camera at the zero point that looks along -z, 90 degrees, 100 x 200 pixels.
fn simple(near: f64, pixels: f64) -> View {
    let camera = Camera { fov: 90.0, near, ..Camera::looking([0.0; 3], [0.0, 0.0, -1.0]) };
    View::new(&camera, [200, 100], pixels).unwrap()
}

#[test]
fn a_pixel_covers_what_it_does_at_the_nearest_point() {
    let view = simple(0.0, 3.0);
    // 100 pixels cover twice the distance.
    let bound = view.bound(&sphere([0.0, 0.0, -10.0], 2.0));
    assert!(bound <= 3.0 * 0.02 * 8.0 && bound > 0.4799999, "{bound}");
    // Behind or beside is as near as before.
    assert_eq!(bound, view.bound(&sphere([0.0, 10.0, 0.0], 2.0)));
    assert_eq!(view.bound(&sphere([0.0, 0.0, -1.0], 1.5)), 0.0);
    let pixels = view.pixels_of(0.48, &sphere([0.0, 0.0, -10.0], 2.0));
    assert!((pixels - 3.0).abs() < 1e-6, "{pixels}");
    assert_eq!(view.pixels_of(1.0, &sphere([0.0; 3], 1.0)), f64::INFINITY);
    assert_eq!(view.pixels_of(0.0, &sphere([0.0; 3], 1.0)), 0.0);
}

#[test]
fn nothing_is_nearer_than_the_near_plane() {
    let view = simple(4.0, 1.0);
    let inside = view.bound(&sphere([0.0; 3], 1.0));
    assert!((0.0799999..=0.08).contains(&inside), "{inside}");
    assert_eq!(inside, view.bound(&sphere([0.0, 0.0, -5.0], 2.0)));
}

#[test]
fn culling_knows_five_planes() {
    let view = simple(1.0, 1.0).with_culling(true);
    // Half as high as wide: the sides are at 2 : 1 across and 1 : 1 upward.
    for (center, missed) in [
        ([0.0, 0.0, -10.0], false),
        ([0.0, 0.0, 10.0], true),
        ([19.0, 0.0, -10.0], false),
        ([23.0, 0.0, -10.0], true),
        ([-23.0, 0.0, -10.0], true),
        ([0.0, 9.0, -10.0], false),
        ([0.0, 12.0, -10.0], true),
        ([0.0, -12.0, -10.0], true),
        ([0.0, 0.0, 0.5], true),
        ([0.0, 0.0, -0.5], false),
    ] {
        let region = sphere(center, 1.0);
        assert_eq!(view.misses(&region), missed, "{center:?}");
        assert_eq!(view.bound(&region) == f32::INFINITY, missed, "{center:?}");
        assert_eq!(view.pixels_of(1.0, &region) == 0.0, missed, "{center:?}");
        let corners = [-1.0, 1.0].map(|side| center.map(|x| (x + 0.5 * side) as f32));
        assert_eq!(view.misses_box(&Aabb::of_points(&corners)), missed, "{center:?}");
    }
    assert!(view.misses_box(&Aabb::EMPTY));
}

/// A stretched view misses the same as a view of a file with such heights.
#[test]
fn a_stretched_view_sees_what_is_stretched() {
    let stretch = [1.0, 1.0, 0.01];
    let camera = Camera::looking([3.0, -8.0, 4.0], [0.0, 0.5, 0.25]);
    let view = View::new(&camera, [200, 100], 1.0).unwrap().with_culling(true);
    let stretched = view.stretched(stretch);
    let (mut missed, mut seen) = (0, 0);
    for n in 0..1000 {
        let at = [n % 10, n / 10 % 10, n / 100].map(|step| 2.0 * f64::from(step) - 9.0);
        let tall = [at[0], at[1], at[2] / stretch[2]];
        let around = |at: [f64; 3], z: f64| {
            Aabb::of_points(
                &[-0.5, 0.5].map(|side| [at[0] + side, at[1] + side, at[2] + z * side].map(|x| x as f32)),
            )
        };
        let misses = view.misses_box(&around(at, 1.0));
        assert_eq!(stretched.misses_box(&around(tall, 1.0 / stretch[2])), misses, "{at:?}");
        assert!(!stretched.misses(&sphere(tall, 0.1)) || view.misses(&sphere(at, 1e-3)), "{at:?}");
        *if misses { &mut missed } else { &mut seen } += 1;
    }
    assert!(missed > 100 && seen > 50, "{missed} {seen}");
    // Errors say nothing of it: all is as fine as it gets.
    assert_eq!(stretched.bound(&sphere([0.0, 0.0, 25.0], 1.0)), 0.0);
    assert_eq!(view.stretched([1.0; 3]), view);
}

#[test]
fn framing_shows_the_whole_box() {
    let bounds = Aabb::of_points(&[[1.0, 2.0, 3.0], [4.0, 9.0, 5.0]]);
    let (far, thin) = ([1e12, -3e11, -1e-20], [1e12, -3e11, 1e-20]);
    for bounds in [bounds, Aabb::of_points(&[[1.0; 3]]), Aabb::of_points(&[far, thin])] {
        let camera = Camera::framing(&bounds);
        let view = View::new(&camera, [100, 100], 1.0).unwrap().with_culling(true);
        assert!(!view.misses_box(&bounds));
        assert_eq!(camera.relative_to([1.0, 1.0, 1.0]).position[2], camera.position[2] - 1.0);
        let [right, ..] = camera.axes();
        let beside: [f64; 3] =
            (nalgebra::Point3::from(camera.target) + right * camera.position[2].abs()).into();
        assert!(beside != camera.target);
    }
}

#[test]
fn a_camera_goes_on_as_it_came() {
    let before = Camera::looking([1.0, 2.0, 3.0], [0.0, 0.0, 1.0]);
    let now = Camera { fov: 30.0, ..Camera::looking([2.0, 2.0, 2.5], [0.0, 1.0, 1.0]) };
    let expected = Camera { fov: 30.0, ..Camera::looking([6.0, 2.0, 0.5], [0.0, 5.0, 1.0]) };
    assert_eq!(now.onward(&before, 4.0), expected);
    assert_eq!(now.onward(&now, 4.0), now);
}

#[test]
fn what_is_no_view_is_refused() {
    let good = Camera::looking([0.0; 3], [1.0, 0.0, 0.0]);
    for camera in [
        Camera { position: [f64::NAN, 0.0, 0.0], ..good },
        Camera { target: [0.0; 3], ..good },
        Camera { target: [1e308; 3], ..good },
        Camera { fov: 0.0, ..good },
        Camera { fov: 180.0, ..good },
        Camera { near: -1.0, ..good },
        Camera { up: [f64::INFINITY, 0.0, 0.0], ..good },
    ] {
        let view = View::new(&camera, [10, 10], 1.0);
        assert!(matches!(view, Err(RefineError::View { .. })), "{camera:?}");
    }
    for (viewport, pixels) in [([0, 1], 1.0), ([1, 0], 1.0), ([1, 1], -1.0), ([1, 1], f64::NAN)] {
        assert!(View::new(&good, viewport, pixels).is_err(), "{viewport:?} {pixels}");
    }
    for up in [[0.0; 3], [2.0, 0.0, 0.0], [-1e-300, 0.0, 0.0]] {
        let view = View::new(&Camera { up, ..good }, [10, 10], 1.0).unwrap();
        assert!(!view.misses(&sphere([2.0, 0.0, 0.0], 0.1)) && view.misses(&sphere([-2.0, 0.0, 0.0], 0.1)));
    }
}

fn point(size: f64) -> impl Strategy<Value = [f64; 3]> {
    prop::array::uniform3(-size..size)
}

fn any_view() -> impl Strategy<Value = (Camera, View)> {
    let camera = (point(1e3), point(1.0), 1.0..170.0, prop::sample::select(vec![0.0, 0.5, 30.0]));
    let camera = camera.prop_map(|(position, target, fov, near)| Camera {
        fov,
        near,
        ..Camera::looking(position, target)
    });
    (camera, 0.0..50.0).prop_map(|(camera, pixels)| {
        (camera, View::new(&camera, [640, 480], pixels).unwrap().with_culling(true))
    })
}

/// A point in a sphere, as far out as `share` says.
fn inside(center: [f64; 3], radius: f64, toward: [f64; 3], share: f64) -> [f64; 3] {
    let length = distance(toward, [0.0; 3]).max(1e-9);
    std::array::from_fn(|axis| center[axis] + toward[axis] / length * radius * share)
}

proptest! {
    #[test]
    fn bounds_are_never_too_large(
        (camera, view) in any_view(), center in point(1e3), radius in 0.0..500.0,
        toward in point(1.0), share in 0.0..=1.0,
    ) {
        let view = view.with_culling(false);
        let bound = view.bound(&sphere(center, radius));
        let away = distance(camera.position, inside(center, radius, toward, share)).max(camera.near);
        let pixels = f64::from(bound) * 480.0 / (2.0 * (0.5 * camera.fov.to_radians()).tan() * away);
        prop_assert!(bound == 0.0 || pixels <= view.pixels() * (1.0 + 1e-12), "{pixels} {}", view.pixels());
        let again = view.pixels_of(bound, &sphere(center, radius));
        prop_assert!(bound == 0.0 || again <= view.pixels() * (1.0 + 1e-12));
    }

    #[test]
    fn what_is_in_the_image_is_not_culled(
        (camera, view) in any_view(), center in point(1e3), radius in 0.0..500.0,
        toward in point(1.0), share in 0.0..=1.0,
    ) {
        // Whatever culls the sphere or a box culls all the points in it, and points are projected here.
        let p = inside(center, radius, toward, share);
        let forward: [f64; 3] = std::array::from_fn(|a| camera.target[a] - camera.position[a]);
        let away: [f64; 3] = std::array::from_fn(|a| p[a] - camera.position[a]);
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let depth = dot(away, forward) / distance(forward, [0.0; 3]);
        let across = (distance(away, [0.0; 3]).powi(2) - depth * depth).max(0.0).sqrt();
        // The circle in the image is inside the image.
        let seen = depth > camera.near && across < 0.999 * depth * (0.5 * camera.fov.to_radians()).tan();
        if seen {
            prop_assert!(!view.misses(&sphere(center, radius)));
            let corners = [p, center].map(|p| p.map(|x| x as f32));
            prop_assert!(!view.misses_box(&Aabb::of_points(&corners)) || depth - camera.near < 1e-3);
        }
    }

}

proptest! {
    // Roundings that matter are rare, and a case is cheap.
    #![proptest_config(ProptestConfig::with_cases(8192))]
    #[test]
    fn nested_spheres_never_disagree(
        (camera, view) in any_view(), center in point(1e3), radius in 0.0..500.0, random in point(1.0),
        share in 0.0..=1.0, where_it_touches in 0..3, touches_near_plane: bool,
    ) {
        let forward: [f64; 3] = std::array::from_fn(|a| camera.target[a] - camera.position[a]);
        let forward = forward.map(|x| x / distance(forward, [0.0; 3]));
        let depth = |p: [f64; 3]| -> f64 { (0..3).map(|a| forward[a] * (p[a] - camera.position[a])).sum() };
        let (center, radius) = if touches_near_plane {
            // In the image, so that no other plane decides.
            let aside = 3e-4 * camera.near * (0.5 * camera.fov.to_radians()).tan();
            let center: [f64; 3] = std::array::from_fn(|a| camera.position[a] + aside * center[a]);
            let back = camera.near - 1e-4 * radius - depth(center);
            let center = std::array::from_fn(|a| center[a] + back * forward[a]);
            (center, (camera.near - depth(center)).max(0.0))
        } else {
            (center, radius)
        };
        // The inner one touches the outer one from inside: where both are nearest to the eye, or to a plane, all is rounding.
        let toward = match where_it_touches {
            0 => random,
            1 => forward,
            _ => std::array::from_fn(|a| camera.position[a] - center[a]),
        };
        let inner = radius * (1.0 - share);
        let small = sphere(inside(center, radius, toward, share), inner);
        let away = distance(small.center, center);
        let radius = (away + inner) * (1.0 + 4.0 * f64::EPSILON);
        let large = Region { slack: 2.0 * Region::SLACK, ..sphere(center, radius) };
        prop_assert!(view.bound(&small) >= view.bound(&large));
        prop_assert!(view.misses(&small) || !view.misses(&large));
        let view = view.with_culling(false);
        prop_assert!(view.pixels_of(0.1, &small) <= view.pixels_of(0.1, &large));
    }
}

#[test]
fn a_box_tells_how_near_something_is_where_the_sphere_does_not() {
    let view = simple(0.0, 3.0);
    // The eye is in the sphere, and ten units from the box.
    let slab =
        Region { low: [-50.0, -50.0, -20.0], high: [50.0, 50.0, -10.0], ..sphere([0.0, 0.0, -15.0], 75.0) };
    let bound = view.bound(&slab);
    assert!(bound <= 3.0 * 0.02 * 10.0 && bound > 0.5999, "{bound}");
}

proptest! {
    #[test]
    fn a_box_inside_another_is_never_nearer(
        low in prop::array::uniform3(-10.0..10.0f64),
        size in prop::array::uniform3(0.0..10.0f64),
        grow in prop::array::uniform6(0.0..3.0f64),
        eye in prop::array::uniform3(-30.0..30.0f64),
    ) {
        let camera = Camera::looking(eye, [eye[0], eye[1], eye[2] - 1.0]);
        let view = View::new(&camera, [200, 100], 1.0).unwrap();
        // Spheres around everything, so that the boxes decide.
        let all = sphere([0.0; 3], 100.0);
        let high = std::array::from_fn(|a| low[a] + size[a]);
        let small = Region { low, high, ..all };
        let large = Region {
            low: std::array::from_fn(|a| low[a] - grow[a]),
            high: std::array::from_fn(|a| high[a] + grow[a + 3]),
            ..all
        };
        prop_assert!(view.bound(&small) >= view.bound(&large));
    }

    #[test]
    fn a_box_inside_another_is_seen_by_nobody_who_does_not_see_that(
        low in prop::array::uniform3(-10.0..10.0f64),
        size in prop::array::uniform3(0.0..10.0f64),
        grow in prop::array::uniform6(prop::sample::select(vec![0.0, 1e-15, 2.0])),
        eye in prop::array::uniform3(-30.0..30.0f64),
        normal in prop::array::uniform3(-1.0..1.0f64),
        share in 0.0..1.0f64,
    ) {
        let high: [f64; 3] = std::array::from_fn(|a| low[a] + size[a]);
        // The plane touches the small box, or runs through it: there all is rounding.
        let along = |a: usize, near: bool| normal[a] * if (normal[a] > 0.0) == near { low[a] } else { high[a] };
        let [near, far] = [true, false].map(|near| (0..3).map(|a| along(a, near)).sum::<f64>());
        let camera = Camera::looking(eye, [eye[0] + 0.1, eye[1], eye[2] - 1.0]);
        let view = View::new(&camera, [200, 100], 1.0).unwrap();
        let all = sphere([0.0; 3], 100.0);
        let small = Region { low, high, ..all };
        let large = Region {
            low: std::array::from_fn(|a| low[a] - grow[a]),
            high: std::array::from_fn(|a| high[a] + grow[a + 3]),
            ..all
        };
        for offset in [near, near - 1e-15, near + share * (far - near)] {
            let view = view.clipped(normal, offset);
            prop_assert!(view.misses(&small) || !view.misses(&large));
            prop_assert!(view.clips(&small) || !view.clips(&large));
        }
        // Clearly on one side of it.
        prop_assert!(view.clipped(normal, near - 1e-9).clips(&small));
        prop_assert!(!view.clipped(normal, near + 1e-9).clips(&small) && !view.clips(&small));
    }
}

#[test]
fn a_box_is_missed_where_its_sphere_is_not() {
    let view = simple(0.0, 1.0);
    // The sphere reaches into the image, the box stays beside it; one without end is everywhere.
    let beside =
        Region { low: [30.0, -9.0, -11.0], high: [50.0, 9.0, -9.0], ..sphere([40.0, 0.0, -10.0], 30.0) };
    assert!(view.misses(&beside) && !view.misses(&sphere([40.0, 0.0, -10.0], 30.0)));
    let clipped = view.clipped([0.0, 0.0, -1.0], 5.0);
    assert!(clipped.clips(&beside) && !view.clips(&beside) && !clipped.clips(&sphere([0.0; 3], 1.0)));
}
