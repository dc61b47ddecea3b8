//! How a model stands and which of its sides is shown, by what it rests on and how much of it is seen.

use super::direction::{Side, Up, sight};
use super::ground::{Ground, patches};
use super::outline::Outline;
use super::sight::{Seen, look};
use nalgebra::Vector3;
use std::f64::consts::FRAC_PI_2;
use std::fmt::Write;

/// How a model stands and which side is shown.
#[derive(Clone, PartialEq, Debug)]
pub struct Stance {
    up: Up,
    /// Radians to the right and upward from the front.
    angles: (f64, f64),
    why: String,
}

/// Prior weight of a direction: files have y or z upward.
fn habit(up: Up) -> f64 {
    match (up.axis(), up.is_negative()) {
        (1, false) => 0.30,
        (2, false) => 0.25,
        _ => 0.0,
    }
}

/// Of the silhouette from above, what has to touch the ground to be stood on.
const SUPPORT: f64 = 0.15;
/// How far what stands firmly can be tilted before it falls, as a slope: 8.5 degrees. Less of that counts for less.
const FIRM: f64 = 0.15;
/// Below this share of the longest side, a height is that of something flat, such as a landscape, of which the open side is the upper one.
const FLAT: f64 = 0.5;
/// The same for what is hardly more than a picture, and shown like one.
const SHEET: f64 = 0.02;
/// Ratio from which on a model lies, and is seen from above: its silhouette from there by that of its widest side.
const LIES: f64 = 1.4;
/// How much wider another side than the front has to be, to be shown.
const WIDER: f64 = 1.6;
/// Ratio below which a view is edge-on: its silhouette by that from another side at the same height.
const EDGE_ON: f64 = 0.5;
/// Elevation of the view of a standing model, radians.
const ABOVE: f64 = 10.0 * std::f64::consts::PI / 180.0;

impl Stance {
    /// The stance of a model; what is told is not chosen.
    pub fn of(outline: &Outline, up: Option<Up>, side: Option<Side>) -> Self {
        let mut why = String::new();
        let up = up.unwrap_or_else(|| upright(outline, &mut why));
        let angles = side.map_or_else(|| shown(outline, up, &mut why), Side::angles);
        Stance { up, angles, why }
    }

    /// The direction that is up.
    pub fn up(&self) -> Up {
        self.up
    }

    /// Where the camera looks along.
    pub fn sight(&self) -> Vector3<f64> {
        sight(self.up, self.angles)
    }

    /// Choice and reasons, in words; empty where nothing was chosen.
    pub fn why(&self) -> &str {
        &self.why
    }
}

/// The direction that is most probably up.
fn upright(outline: &Outline, why: &mut String) -> Up {
    let patches = patches(outline);
    let rated = Up::ALL.map(|up| (up, Ground::of(outline, &patches, up)));
    fn open(ground: &Ground) -> f64 {
        ground.open * (1.0 - ground.height / FLAT).max(0.0)
    }
    fn points(up: Up, ground: &Ground) -> f64 {
        // What barely touches the ground says nothing.
        let support = if ground.support > SUPPORT { ground.support } else { 0.0 };
        // Nor does a tip on which something balances; but what is flat below was made to stand on.
        let support = (support * (ground.steady / FIRM).min(1.0)).max(support.min(ground.base));
        habit(up) + support + 0.1 * ground.base + 0.5 * ground.lopsided + 3.0 * open(ground)
    }
    // Of equal ones the first, which is the more usual one.
    let mut best = rated[0];
    for (up, ground) in rated {
        if points(up, &ground) > points(best.0, &best.1) + 1e-6 {
            best = (up, ground);
        }
    }
    let (up, ground) = best;
    fn percent(share: f64) -> f64 {
        (100.0 * share).round()
    }
    let reason = match ground {
        Ground { support, base, .. } if support > SUPPORT || base > SUPPORT => {
            format!("it stands on {} % of its ground, {} % flat", percent(support), percent(base))
        }
        _ if open(&ground) > 0.1 => "it is flat and open above".to_owned(),
        _ => "no side that it could stand on is found, and most files have that".to_owned(),
    };
    // Writing to a string cannot fail.
    let _ = write!(why, "up is {up}: {reason}");
    up
}

/// The angles of the side that is shown.
fn shown(outline: &Outline, up: Up, why: &mut String) -> (f64, f64) {
    let seen = |side: Side| look(outline, sight(up, side.angles()));
    let [front, right, top] = [Side::Front, Side::Right, Side::Top].map(seen);
    let (along, across) = (front.silhouette.max(right.silhouette), front.silhouette.min(right.silhouette));
    let height = outline.bounds().1[up.axis()] / outline.bounds().1.max();
    let separate = if why.is_empty() { "" } else { "; " };
    let mut tell = |text: String| {
        let _ = write!(why, "{separate}{text}");
    };

    if height < SHEET {
        tell("seen from above: it is flat".to_owned());
        return Side::Top.angles();
    }
    // What is long across is shown from there; and of an open surface, the outer side.
    let turns = right.silhouette > WIDER * front.silhouette;
    let pair = if turns { [Side::Right, Side::Left] } else { [Side::Front, Side::Back] };
    fn is_outside(seen: Seen) -> bool {
        seen.outside > 0.5 * seen.surface
    }
    let turned = pair.map(|side| is_outside(seen(side))) == [false, true];
    let side = if turned { pair[1] } else { pair[0] };
    let (around, _) = side.angles();
    if top.silhouette > LIES * along {
        let corner = (around + Side::Iso.angles().0, Side::Iso.angles().1);
        let other = broad(corner, up, outline);
        let why = if other.is_some() { ", and from another one it is seen edge-on" } else { "" };
        tell(format!("seen from a corner above: it lies more than it stands{why}"));
        return other.unwrap_or(corner);
    }
    if let Some(other) = broad((around, ABOVE), up, outline) {
        tell(format!("seen from another side than the {}, which is its edge", side.name()));
        return other;
    }
    let name = side.name();
    tell(match (turned, turns) {
        (true, _) => format!("seen from the {name}: its outer side"),
        (false, true) => {
            format!("seen from the {name}: it is {:.1} times as wide as the front", along / across)
        }
        // Lucy's back has as much to see as her front.
        (false, false) => format!("seen from the {name}, or from behind: nothing tells which"),
    });
    (around, ABOVE)
}

/// Where that is its edge, from another side at the same height.
fn broad(angles: (f64, f64), up: Up, outline: &Outline) -> Option<(f64, f64)> {
    let area = |angles: (f64, f64)| look(outline, sight(up, angles)).silhouette;
    let others = [1.0, 2.0, 3.0].map(|quarters| (angles.0 + quarters * FRAC_PI_2, angles.1));
    let best = others.into_iter().max_by(|a, b| area(*a).total_cmp(&area(*b))).unwrap_or(angles);
    (area(angles) < EDGE_ON * area(best)).then_some(best)
}

#[cfg(test)]
mod tests {
    use super::*;

    type Mesh = (Vec<[f32; 3]>, Vec<[u32; 3]>);

    /// A box, closed.
    fn add_box(mesh: &mut Mesh, low: [f32; 3], high: [f32; 3]) {
        let first = mesh.0.len() as u32;
        let corner =
            |n: usize| std::array::from_fn(|axis| if n >> axis & 1 == 0 { low[axis] } else { high[axis] });
        mesh.0.extend((0..8).map(corner));
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let halves = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
        mesh.1.extend(quads.into_iter().flat_map(halves).map(|corners| corners.map(|corner| first + corner)));
    }

    /// With z up: a desk, a column on a plinth, a horse of boxes along y, and hills.
    fn known() -> [(&'static str, Mesh); 4] {
        let [mut desk, mut column, mut horse, mut hills] = [const { (Vec::new(), Vec::new()) }; 4];

        add_box(&mut desk, [-2.0, -1.0, 1.4], [2.0, 1.0, 1.5]);
        add_box(&mut horse, [-0.4, -1.5, 1.2], [0.4, 1.5, 2.2]);
        add_box(&mut horse, [-0.2, 1.2, 2.0], [0.2, 1.6, 3.4]);
        for (x, y) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            add_box(&mut desk, [1.9 * x - 0.05, 0.9 * y - 0.05, 0.0], [1.9 * x + 0.05, 0.9 * y + 0.05, 1.4]);
            add_box(&mut horse, [0.3 * x - 0.1, 1.3 * y - 0.1, 0.0], [0.3 * x + 0.1, 1.3 * y + 0.1, 1.2]);
        }
        add_box(&mut column, [-1.0, -1.0, 0.0], [1.0, 1.0, 0.5]);
        add_box(&mut column, [-0.5, -0.6, 0.5], [0.5, 0.6, 6.0]);

        let side = 40;
        for place in 0..side * side {
            let [x, y] = [place % side, place / side].map(|n| 0.2 * n as f32);
            hills.0.push([x, y, (1.3 * x).sin() * (0.9 * y).cos()]);
            if place % side + 1 < side && place + side < side * side {
                hills
                    .1
                    .extend([[place, place + 1, place + side], [place + 1, place + side + 1, place + side]]);
            }
        }

        [("desk", desk), ("column", column), ("horse", horse), ("hills", hills)]
    }

    /// Turned so that what was z is `up`, and what was y goes where the back is then.
    fn turned(mesh: &Mesh, up: Up) -> Mesh {
        let (up, ahead) = (up.vector(), up.ahead());
        let aside = ahead.cross(&up);
        let turn = |p: &[f32; 3]| {
            let [x, y, z] = p.map(f64::from);
            (aside * x + ahead * y + up * z).map(|x| x as f32).into()
        };
        (mesh.0.iter().map(turn).collect(), mesh.1.clone())
    }

    fn outline((points, triangles): &Mesh) -> Outline {
        Outline::of_mesh(points, triangles)
    }

    #[test]
    fn what_stands_on_something_stands_upright_whichever_axis_that_is() {
        for (name, mesh) in known() {
            // A desk stands on its board as well, and boxes on their sides: there only the habit of files speaks for the feet.
            let is_sure = ["column", "hills"].contains(&name);
            for up in Up::ALL.into_iter().filter(|up| is_sure || habit(*up) > 0.0) {
                let turned = outline(&turned(&mesh, up));
                let stance = Stance::of(&turned, None, None);
                assert_eq!(stance.up(), up, "{name}: {}", stance.why());
                assert!(stance.why().contains(&format!("up is {up}")), "{name}: {}", stance.why());
                assert_eq!(Stance::of(&turned, Some(up), None).angles, stance.angles);
            }
        }
    }

    #[test]
    fn what_is_long_is_seen_from_its_side_and_what_lies_from_above() {
        let z = Up::nearest(Vector3::z());
        for (name, mesh) in known() {
            let stance = Stance::of(&outline(&mesh), Some(z), None);
            let told = match name {
                "horse" => "right",
                "hills" | "desk" => "corner above",
                _ => "front",
            };
            assert!(stance.why().contains(told), "{name}: {}", stance.why());
            let is_guess = stance.why().contains("or from behind: nothing tells which");
            assert_eq!(is_guess, name == "column", "{}", stance.why());
        }
        // A wall that is open, turned away from who looks from the front.
        let wall = |turned: bool| {
            let triangle = if turned { [0, 2, 1] } else { [0, 1, 2] };
            (vec![[0.0, 0.0, 0.0], [3.0, 0.1, 0.0], [0.0, 0.5, 3.0]], vec![triangle])
        };
        assert!(Stance::of(&outline(&wall(false)), Some(z), None).why().contains("the front"));
        assert!(Stance::of(&outline(&wall(true)), Some(z), None).why().contains("the back"));
    }

    /// Round about x, with a blunt nose, four fins behind it and a thin tail.
    fn fish() -> Mesh {
        let (rings, sides) = (33_u32, 16_u32);
        let radius =
            |x: f32| if x < 1.0 { 0.5 * x.sqrt() } else { (0.5 - 0.09 * (x - 3.0).max(0.0)).max(0.02) };
        let point = |n: u32| {
            let (x, turn) =
                ((n / sides) as f32 * 0.25, (n % sides) as f32 * std::f32::consts::TAU / sides as f32);
            let radius = radius(x).max(0.02);
            [x, radius * turn.sin(), radius * turn.cos()]
        };
        let quad = |n: u32| {
            let (ring, side) = (n / sides * sides, n % sides);
            let [a, b] = [ring + side, ring + (side + 1) % sides];
            [[a, a + sides, b], [b, a + sides, b + sides]]
        };
        let mut fish: Mesh =
            ((0..rings * sides).map(point).collect(), (0..(rings - 1) * sides).flat_map(quad).collect());
        for (axis, end) in [(1, 1.3), (1, -1.3), (2, 1.3), (2, -1.3_f32)] {
            let first = fish.0.len() as u32;
            for (x, away) in [(1.0, 0.3), (3.0, 0.3), (2.0, 1.0)] {
                let mut point = [x, 0.0, 0.0];
                point[axis] = away * end;
                fish.0.push(point);
            }
            fish.1.extend([[first, first + 1, first + 2], [first, first + 2, first + 1]]);
        }

        fish
    }

    #[test]
    fn what_would_fall_over_does_not_stand() {
        let stance = Stance::of(&outline(&fish()), None, None);
        assert_eq!(stance.up(), Up::nearest(Vector3::y()), "{}", stance.why());
    }

    #[test]
    fn nothing_is_shown_edge_on() {
        // A sheet that leans back, away from who looks from the front, at all angles.
        for degrees in [5.0, 20.0, 35.0, 50.0, 80.0_f32] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            for toward in [-1.0, 1.0] {
                let at = |x: f32, along: f32| [x, toward * cos * along, sin * along];
                let points = vec![at(-1.0, 0.0), at(1.0, 0.0), at(1.0, 2.0), at(-1.0, 2.0)];
                // Both of its sides are outer ones.
                let triangles = vec![[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]];
                let sheet = Outline::of_mesh(&points, &triangles);
                let stance = Stance::of(&sheet, Some(Up::nearest(Vector3::z())), None);
                let seen = look(&sheet, stance.sight()).silhouette;
                assert!(seen > 0.9, "{degrees} {toward}: {seen} of 4, {}", stance.why());
            }
        }
    }

    #[test]
    fn what_is_told_is_not_chosen() {
        let column = outline(&known()[1].1);
        for up in Up::ALL {
            for (side, _) in Side::ALL {
                let stance = Stance::of(&column, Some(up), Some(side));
                assert_eq!((stance.up(), stance.why()), (up, ""));
                assert_eq!(stance.sight(), sight(up, side.angles()));
            }
        }
    }

    #[test]
    fn odd_models_have_a_stance() {
        let far = 1e7;
        let odd: [Mesh; 6] = [
            (Vec::new(), Vec::new()),
            (vec![[0.0; 3]; 3], vec![[0, 1, 2]]),
            (vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.2, 0.8, 0.0]], vec![[0, 1, 2]]),
            (vec![[0.0; 3], [0.0, 0.0, 1e3], [1e-4, 0.0, 5e2]], vec![[0, 1, 2]]),
            (vec![[far, far, far], [far + 4.0, far, far], [far, far + 3.0, far + 9.0]], vec![[0, 1, 2]]),
            (vec![[0.0; 3], [1e30, 0.0, 0.0], [0.0, 3e30, 1e30]], vec![[0, 1, 2]]),
        ];
        for mesh in odd {
            let stance = Stance::of(&outline(&mesh), None, None);
            assert!((stance.sight().norm() - 1.0).abs() < 1e-9 && !stance.why().is_empty(), "{mesh:?}");
        }
        // A triangle in a plane is seen from where it shows.
        let flat = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.2, 0.8, 0.0]];
        let stance = Stance::of(&outline(&(flat, vec![[0, 1, 2]])), None, None);
        assert!(stance.sight().z < -0.9, "{}", stance.why());
    }
}
