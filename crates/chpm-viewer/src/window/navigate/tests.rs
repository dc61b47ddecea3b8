use super::*;
use proptest::prelude::*;

fn bounds() -> Aabb {
    Aabb { min: [-1.0, -2.0, -3.0], max: [3.0, 2.0, 1.0] }
}

fn navigator() -> Navigator {
    Navigator::new(&bounds(), [0.0; 3])
}

/// Long enough for all motion to end.
fn rest(navigator: &mut Navigator) {
    for _ in 0..10_000 {
        if !navigator.step(0.02) {
            return;
        }
    }
    panic!("it moves for ever: {navigator:?}");
}

fn apart(a: [f64; 3], b: [f64; 3]) -> f64 {
    (Point3::from(a) - Point3::from(b)).norm()
}

fn sight(camera: &Camera) -> Vector3<f64> {
    (Point3::from(camera.target) - Point3::from(camera.position)).normalize()
}

#[test]
fn it_begins_at_the_view_of_the_whole() {
    let (camera, framing) = (navigator().camera(), Camera::framing(&bounds()));
    assert!(apart(camera.position, framing.position) < 1e-12);
    assert!(apart(camera.target, framing.target) < 1e-12);
    assert_eq!((camera.up, camera.fov), (framing.up, framing.fov));
}

/// The picture of a camera whose picture leans, and the way on from it, about the axis that was upward before.
#[test]
fn a_camera_that_leans_is_rolled() {
    for degrees in [-170.0, -90.0, -5.0, 0.0, 20.0, 90.0, 135.0] {
        let mut navigator = navigator();
        navigator.turn([80.0, 60.0], 500.0);
        rest(&mut navigator);
        let upright = navigator.camera();
        navigator.roll(degrees);
        let camera = navigator.camera();
        let mut other = self::navigator();
        assert!(other.resume(&camera));
        assert!((other.rolled() - degrees).abs() < 1e-9, "{degrees}: {}", other.rolled());
        let aside = (other.camera().axes()[0] - camera.axes()[0]).norm();
        assert!(aside < 1e-9 && other.up() == upright.up);
        assert!(apart(other.camera().position, camera.position) < 1e-9);
        // A turn to the side keeps the height above the model.
        other.roll(-degrees);
        other.turn([100.0, 0.0], 500.0);
        rest(&mut other);
        assert!((other.camera().position[1] - camera.position[1]).abs() < 1e-9);
        assert!(!other.resume(&Camera { fov: f64::NAN, ..camera }));
        // One that stands upright has no roll left.
        assert!(other.resume(&upright) && other.rolled().abs() < 1e-9);
    }
}

#[test]
fn a_drag_of_an_image_to_the_right_is_half_a_turn_to_the_left() {
    let mut navigator = navigator();
    let before = navigator.camera();
    navigator.turn([250.0, 0.0], 500.0);
    let ahead = navigator.destination();
    rest(&mut navigator);
    let quarter = navigator.camera();
    assert_eq!(ahead, quarter);
    // From the front (+z) of the model the camera goes to its left (-x): the model turns with the hand.
    let distance = apart(before.position, before.target);
    assert!(apart(quarter.target, before.target) < 1e-12);
    let expected = [before.target[0] - distance, before.target[1], before.target[2]];
    assert!(apart(quarter.position, expected) < 1e-9, "{quarter:?}");
    navigator.turn([250.0, 0.0], 500.0);
    rest(&mut navigator);
    assert!((sight(&navigator.camera()) + sight(&before)).norm() < 1e-9);
}

#[test]
fn a_drag_downward_looks_from_above_and_stops_before_the_pole() {
    let mut navigator = navigator();
    navigator.turn([0.0, 1e6], 500.0);
    rest(&mut navigator);
    let camera = navigator.camera();
    assert!(camera.position[1] > camera.target[1] && sight(&camera).y < -0.999);
    assert!(sight(&camera).cross(&Vector3::y()).norm() > 5e-4);
}

#[test]
fn looking_around_keeps_the_eye() {
    let mut navigator = navigator();
    navigator.set_pivot(Pivot::Eye);
    let before = navigator.camera();
    navigator.turn([100.0, 0.0], 500.0);
    while navigator.step(0.004) {
        assert!(apart(navigator.camera().position, before.position) < 1e-9);
    }
    let after = navigator.camera();
    assert!(sight(&after).x > 0.1 && sight(&after).y.abs() < 1e-12, "to the right, level: {after:?}");
}

#[test]
fn what_is_dragged_stays_below_the_pointer() {
    let mut navigator = navigator();
    let before = navigator.camera();
    let depth = 0.5 * apart(before.position, before.target);
    navigator.pan([120.0, -30.0], 400.0, Some(depth));
    rest(&mut navigator);
    let after = navigator.camera();
    let unit = 2.0 * (0.5 * before.fov.to_radians()).tan() * depth / 400.0;
    let expected = [before.position[0] - 120.0 * unit, before.position[1] - 30.0 * unit, before.position[2]];
    assert!(apart(after.position, expected) < 1e-9);
    assert!((sight(&after) - sight(&before)).norm() < 1e-12);
}

#[test]
fn a_dolly_nears_the_point_by_its_factor() {
    let mut navigator = navigator();
    let (before, point) = (navigator.camera(), [0.5, 1.0, -0.25]);
    navigator.dolly(0.5, Some(point));
    rest(&mut navigator);
    let after = navigator.camera();
    assert!((apart(after.position, point) - 0.5 * apart(before.position, point)).abs() < 1e-9);
    assert!((sight(&after) - sight(&before)).norm() < 1e-12);
}

#[test]
fn a_dolly_ends_at_the_limits_without_drifting() {
    let mut navigator = navigator();
    for _ in 0..2000 {
        navigator.dolly(0.9, Some([1.0, 0.0, -1.0]));
    }
    rest(&mut navigator);
    let near = navigator.camera();
    navigator.dolly(0.9, Some([1.0, 0.0, -1.0]));
    rest(&mut navigator);
    assert!(apart(near.position, navigator.camera().position) < 1e-9);
    assert!(apart(near.position, near.target) > 0.0);
}

#[test]
fn a_focus_is_in_the_middle_from_as_far_away() {
    for pivot in [Pivot::Focus, Pivot::Eye] {
        let mut navigator = navigator();
        navigator.set_pivot(pivot);
        let (before, point) = (navigator.camera(), [2.0, -1.0, 0.5]);
        navigator.focus_on(point);
        rest(&mut navigator);
        let after = navigator.camera();
        assert!(apart(after.target, point) < 1e-9, "{pivot:?}: {after:?}");
        let distance = apart(after.position, point);
        assert!((distance - apart(before.position, point)).abs() < 1e-9);
        if pivot == Pivot::Eye {
            assert!(apart(after.position, before.position) < 1e-9);
        }
    }
}

#[test]
fn the_whole_model_fits_from_anywhere() {
    for aspect in [2.0, 0.5] {
        let mut navigator = navigator();
        navigator.turn([77.0, -55.0], 500.0);
        navigator.pan([300.0, 200.0], 500.0, None);
        navigator.dolly(0.01, None);
        rest(&mut navigator);
        let before = navigator.camera();
        navigator.fit(aspect);
        rest(&mut navigator);
        let camera = navigator.camera();
        assert!((sight(&camera) - sight(&before)).norm() < 1e-9);
        // All corners of the box are in the image, one of them near its border.
        let [right, up, ahead] = camera.axes();
        let rise = (0.5 * camera.fov.to_radians()).tan();
        let (low, high) = (bounds().min, bounds().max);
        let corner = |n: usize| {
            std::array::from_fn(|axis| f64::from(if n >> axis & 1 == 0 { low } else { high }[axis]))
        };
        let most = (0..8).map(|n| {
            let way = Point3::from(corner(n)) - Point3::from(camera.position);
            let away = way.dot(&ahead) * rise;
            (way.dot(&right) / (away * aspect)).abs().max((way.dot(&up) / away).abs())
        });
        let most = most.fold(0.0, f64::max);
        assert!((0.9..0.95).contains(&most), "{most}");
        navigator.home(aspect);
        rest(&mut navigator);
        assert!((sight(&navigator.camera()) - sight(&Camera::framing(&bounds()))).norm() < 1e-9);
    }
}

#[test]
fn flight_has_the_speed_of_one_distance_a_second_and_comes_to_rest() {
    let mut navigator = navigator();
    navigator.set_pivot(Pivot::Eye);
    navigator.set_distance(2.0);
    let before = navigator.camera();
    navigator.fly([0.0, 0.0, 1.0]);
    for _ in 0..300 {
        navigator.step(0.01);
    }
    // Speeding up costs the way of THRUST seconds.
    let flown = apart(navigator.camera().position, before.position);
    assert!((flown - 2.0 * (3.0 - THRUST)).abs() < 1e-6, "{flown}");
    navigator.fly([0.0; 3]);
    rest(&mut navigator);
    let stopped = apart(navigator.camera().position, before.position);
    assert!((stopped - 6.0).abs() < 0.01, "what speeding up cost, slowing down gives: {stopped}");
}

#[test]
fn a_journey_ends_at_the_camera_and_takes_the_short_way() {
    let mut navigator = navigator();
    let from = |angle: f64| {
        let (s, c) = angle.sin_cos();
        Camera { fov: 30.0, ..Camera::looking([1.0 + 9.0 * s, 0.0, -1.0 + 9.0 * c], [1.0, 0.0, -1.0]) }
    };
    assert!(navigator.jump(&from(3.0)));
    assert!(navigator.travel(&from(-3.0)));
    while navigator.step(0.01) {
        assert!(navigator.camera().position[2] < -1.0, "behind the model all the way");
    }
    assert!(apart(navigator.camera().position, from(-3.0).position) < 1e-9);
    assert_eq!(navigator.camera().fov, 30.0);
}

#[test]
fn another_axis_upward_keeps_eye_and_sight() {
    let mut navigator = navigator();
    navigator.turn([50.0, 20.0], 500.0);
    rest(&mut navigator);
    let before = navigator.camera();
    navigator.set_up([0.0, 0.0, 5.0]);
    let after = navigator.camera();
    assert_eq!(after.up, [0.0, 0.0, 1.0]);
    assert!(apart(after.position, before.position) < 1e-9 && apart(after.target, before.target) < 1e-9);
    navigator.home(1.0);
    rest(&mut navigator);
    assert!((sight(&navigator.camera()) - Vector3::y()).norm() < 1e-9, "from the front of a z-up model");
}

#[test]
fn cameras_that_none_can_be_are_not_heeded() {
    let mut navigator = navigator();
    let before = navigator.camera();
    let good = Camera::looking([0.0, 0.0, 9.0], [0.0; 3]);
    for bad in [
        Camera { position: [f64::NAN, 0.0, 0.0], ..good },
        Camera { target: good.position, ..good },
        Camera { target: [f64::INFINITY, 0.0, 0.0], ..good },
        Camera { fov: 0.0, ..good },
        Camera { fov: f64::NAN, ..good },
        Camera { position: [1e300, 0.0, 0.0], ..good },
    ] {
        assert!(!navigator.jump(&bad) && !navigator.travel(&bad), "{bad:?}");
    }
    assert_eq!(navigator.camera(), before);
    assert!(navigator.jump(&Camera { up: [0.0; 3], ..good }), "any axis serves");
}

#[derive(Clone, Debug)]
enum Deed {
    Turn([f64; 2]),
    Pan([f64; 2], Option<f64>),
    Dolly(f64, Option<[f64; 3]>),
    Focus([f64; 3]),
    Fly([f64; 3]),
    Distance(f64),
    Fit(f64),
    Home(f64),
    Pivot(Pivot),
    Up([f64; 3]),
    Jump([f64; 3], [f64; 3]),
    Step(f64),
}

/// Any number, the worst included.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![-500.0..500.0, -2.0..2.0, any::<f64>(), Just(0.0), Just(f64::NAN), Just(f64::INFINITY)]
}

fn point() -> impl Strategy<Value = [f64; 3]> {
    [number(), number(), number()]
}

fn deed() -> impl Strategy<Value = Deed> {
    let pivot = prop_oneof![Just(Pivot::Eye), Just(Pivot::Focus)];
    prop_oneof![
        [number(), number()].prop_map(Deed::Turn),
        ([number(), number()], prop::option::of(number())).prop_map(|(d, z)| Deed::Pan(d, z)),
        (number(), prop::option::of(point())).prop_map(|(f, p)| Deed::Dolly(f, p)),
        point().prop_map(Deed::Focus),
        point().prop_map(Deed::Fly),
        number().prop_map(Deed::Distance),
        number().prop_map(Deed::Fit),
        number().prop_map(Deed::Home),
        pivot.prop_map(Deed::Pivot),
        point().prop_map(Deed::Up),
        (point(), point()).prop_map(|(p, t)| Deed::Jump(p, t)),
        number().prop_map(Deed::Step),
        (0.0..0.1).prop_map(Deed::Step),
    ]
}

fn do_it(navigator: &mut Navigator, deed: &Deed) {
    match *deed {
        Deed::Turn(drag) => navigator.turn(drag, 480.0),
        Deed::Pan(drag, depth) => navigator.pan(drag, 480.0, depth),
        Deed::Dolly(factor, point) => navigator.dolly(factor, point),
        Deed::Focus(point) => navigator.focus_on(point),
        Deed::Fly(thrust) => navigator.fly(thrust),
        Deed::Distance(distance) => navigator.set_distance(distance),
        Deed::Fit(aspect) => navigator.fit(aspect),
        Deed::Home(aspect) => navigator.home(aspect),
        Deed::Pivot(pivot) => navigator.set_pivot(pivot),
        Deed::Up(up) => navigator.set_up(up),
        Deed::Jump(position, target) => {
            navigator.jump(&Camera::looking(position, target));
        }
        Deed::Step(seconds) => {
            navigator.step(seconds);
        }
    }
}

proptest! {
    /// Whatever is done, there is a camera, and its up axis is across its sight.
    #[test]
    fn any_deeds_leave_a_camera(deeds in prop::collection::vec(deed(), 1..60), far in prop_oneof![Just(0.0f64), Just(1e6f64)]) {
        let mut navigator = Navigator::new(&bounds(), [far, -far, 0.0]);
        for deed in &deeds {
            do_it(&mut navigator, deed);
            let camera = navigator.camera();
            let numbers = [camera.position, camera.target, camera.up];
            prop_assert!(numbers.as_flattened().iter().all(|x| x.is_finite()), "{camera:?}");
            prop_assert!(chpm_refine::View::new(&camera, [640, 480], 1.0).is_ok(), "{camera:?}");
            let across = sight(&camera).cross(&Vector3::from(camera.up)).norm();
            prop_assert!(across > 1e-4, "{camera:?}: {across}");
        }
        navigator.fly([0.0; 3]);
        for _ in 0..2000 { navigator.step(0.05); }
        prop_assert!(!navigator.is_moving(), "{navigator:?}");
    }

    /// Two short steps lead where one long one does.
    #[test]
    fn frame_rates_do_not_show(turn in [-200.0..200.0, -100.0..100.0f64], factor in 0.5..2.0f64,
                               seconds in 0.01..0.5f64, share in 0.1..0.9f64) {
        let mut once = navigator();
        once.turn(turn, 480.0);
        once.dolly(factor, None);
        let mut twice = once.clone();
        once.step(seconds);
        twice.step(seconds * share);
        twice.step(seconds * (1.0 - share));
        let (once, twice) = (once.camera(), twice.camera());
        let size = apart(once.position, once.target);
        prop_assert!(apart(once.position, twice.position) < 1e-4 * size);
        // Flight straight ahead likewise.
        let mut once = navigator();
        once.fly([0.3, 0.0, 1.0]);
        let mut twice = once.clone();
        once.step(seconds);
        twice.step(seconds * share);
        twice.step(seconds * (1.0 - share));
        prop_assert!(apart(once.camera().position, twice.camera().position) < 1e-9 * size);
    }

    /// A camera is where it was set.
    #[test]
    fn a_camera_that_was_set_is_there(position in [-50.0..50.0, -50.0..50.0, -50.0..50.0f64],
                                      target in [-5.0..5.0, -5.0..5.0, -5.0..5.0f64]) {
        let camera = Camera::looking(position, target);
        prop_assume!(sight(&camera).y.abs() < 0.99 && apart(position, target) > 0.1);
        for pivot in [Pivot::Focus, Pivot::Eye] {
            let mut navigator = navigator();
            navigator.set_pivot(pivot);
            prop_assert!(navigator.jump(&camera));
            prop_assert!(apart(navigator.camera().position, position) < 1e-10);
            prop_assert!(apart(navigator.camera().target, target) < 1e-10);
            prop_assert!(!navigator.is_moving());
        }
    }
}

#[test]
fn every_axis_comes_upward_at_once_with_the_whole_model_in_view() {
    let mut navigator = navigator();
    let mut seen = Vec::new();
    for _ in Up::ALL {
        navigator.dolly(0.2, None);
        navigator.next_up(1.5);
        assert!(!navigator.is_moving(), "at once");
        let camera = navigator.camera();
        assert_eq!(Vector3::from(camera.up), navigator.upward().vector());
        assert!(camera.axes()[1].dot(&navigator.upward().vector()) > 0.5, "upright in the image");
        let distance = apart(camera.position, bounds().center().into());
        assert!(distance > 0.5 * bounds().diagonal());
        seen.push(navigator.upward());
        let again = navigator.destination();
        navigator.home(1.5);
        // But for what turning there by the shortest way rounds.
        let home = navigator.destination();
        let moved = apart(home.position, again.position).max(apart(home.target, again.target));
        assert!(moved < 1e-12 * bounds().diagonal() && home.up == again.up, "it is at home: {moved}");
    }
    assert!(Up::ALL.iter().all(|up| seen.contains(up)), "{seen:?}");
}
