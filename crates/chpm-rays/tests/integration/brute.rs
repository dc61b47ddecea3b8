//! Every ray beside all triangles, by signs of volumes that are exact.

use super::scene::{Corners, built, cast, less, mesh_within, rays_at};
use chpm_rays::{Bound, Ray, Seek};
use chpm_synth::hard::CASES;
use robust::{Coord3D, orient3d};

/// How a ray meets a triangle, as far as that is certain.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Meets {
    Surely(f64),
    /// Through an edge or a vertex, or nearly: rounding of the direction decides.
    Perhaps(f64, f64),
    Not,
}

fn coord(p: [f64; 3]) -> Coord3D<f64> {
    Coord3D { x: p[0], y: p[1], z: p[2] }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn meets(ray: &Ray, corners: &Corners) -> Meets {
    let [a, b, c] = corners.map(|corner| corner.map(f64::from));
    let to: [f64; 3] = std::array::from_fn(|i| ray.origin[i] + ray.direction[i]);
    let (p, q) = (coord(ray.origin), coord(to));
    let volumes = [[b, c], [c, a], [a, b]].map(|[x, y]| orient3d(p, q, coord(x), coord(y)));
    let length = dot(ray.direction, ray.direction).sqrt();
    let far = [a, b, c].iter().flat_map(|p| less(*p, ray.origin)).fold(0.0, |m: f64, x| m.max(x.abs()));
    let noise = 1e-13 * length * far * far + f64::MIN_POSITIVE;
    let (sure, near) = (volumes.iter().all(|v| *v > noise) || volumes.iter().all(|v| *v < -noise), {
        volumes.iter().all(|v| *v > -noise) || volumes.iter().all(|v| *v < noise)
    });
    if !near {
        return Meets::Not;
    }
    let sum: f64 = volumes.iter().sum();
    let along = |p: [f64; 3]| dot(less(p, ray.origin), ray.direction) / length;
    let deep = [a, b, c].map(along);
    let margin = 1e-12 * far;
    if !sure {
        let low = deep.iter().copied().fold(f64::INFINITY, f64::min) - margin;
        let high = deep.iter().copied().fold(f64::NEG_INFINITY, f64::max) + margin;
        return if high < 0.0 || low > ray.reach { Meets::Not } else { Meets::Perhaps(low, high) };
    }
    let distance = (0..3).map(|i| volumes[i] / sum * deep[i]).sum::<f64>();
    match distance {
        d if d < -margin || d > ray.reach + margin => Meets::Not,
        d if d < margin || d > ray.reach - margin => Meets::Perhaps(d - margin, d + margin),
        d => Meets::Surely(d),
    }
}

/// What a ray meets is what brute force says, or, where rounding decides, one of what it may be.
fn check(name: &str, ray: &Ray, triangles: &[(Corners, u32, u32)], got: Option<chpm_rays::Hit>) -> bool {
    let found: Vec<(Meets, u32, u32)> =
        triangles.iter().map(|(corners, cluster, place)| (meets(ray, corners), *cluster, *place)).collect();
    let sure = found.iter().filter_map(|(m, ..)| if let Meets::Surely(d) = m { Some(*d) } else { None });
    let nearest = sure.fold(f64::INFINITY, f64::min);
    let close = |d: f64| 1e-9 * (d.abs() + ray.origin.iter().fold(0.0, |m: f64, x| m.max(x.abs())));
    match got {
        None => assert!(nearest == f64::INFINITY, "{name}: {ray:?} meets something at {nearest}"),
        Some(hit) => {
            assert!(hit.distance <= nearest + close(hit.distance), "{name}: {ray:?} {hit:?} {nearest}");
            let own = found
                .iter()
                .find(|(_, cluster, place)| (*cluster, *place) == (hit.cluster.0, hit.triangle))
                .unwrap_or_else(|| panic!("{name}: {hit:?} is of no triangle of the mesh"));
            let is_right = match own.0 {
                Meets::Surely(d) => (d - hit.distance).abs() <= close(d),
                Meets::Perhaps(low, high) => {
                    hit.distance >= low - close(low) && hit.distance <= high + close(high)
                }
                Meets::Not => false,
            };
            assert!(is_right, "{name}: {ray:?} {hit:?} {own:?}");
            let at: [f64; 3] = std::array::from_fn(|i| ray.origin[i] + ray.direction[i]);
            let length = dot(ray.direction, ray.direction).sqrt();
            let on: [f64; 3] =
                std::array::from_fn(|i| ray.origin[i] + (at[i] - ray.origin[i]) / length * hit.distance);
            let off = less(on, hit.point);
            assert!(
                dot(off, off).sqrt() <= 1e-6 * (hit.distance + close(hit.distance) * 1e9),
                "{name}: {hit:?}"
            );
        }
    }
    nearest < f64::INFINITY
}

#[test]
fn rays_meet_what_brute_force_meets_in_all_hard_cases() {
    let mut sure = 0;
    for case in &CASES {
        let file = built(&case.mesh(1500));
        let largest = file.groups().iter().map(|group| group.max_error).fold(0.0, f32::max);
        for (error, bound) in [
            (-1.0, Bound::LEAVES),
            (0.0, Bound::within(0.0)),
            (0.02 * f64::from(largest), Bound::within(0.02 * f64::from(largest))),
            (0.3 * f64::from(largest), Bound::within(0.3 * f64::from(largest))),
            (f64::INFINITY, Bound::within(f64::INFINITY)),
        ] {
            let triangles = mesh_within(&file, error);
            if triangles.is_empty() {
                continue;
            }
            let rays = rays_at(&triangles, 250, 7);
            let nearest = cast(&file, &rays, &bound, Seek::Nearest);
            let any = cast(&file, &rays, &bound, Seek::Any);
            // By the groups, which bounds that grow go by.
            let grown = Bound { spread: f64::MIN_POSITIVE, ..bound };
            assert!(
                !grown.is_common() && cast(&file, &rays, &grown, Seek::Nearest) == nearest,
                "{}",
                case.name
            );
            for ((ray, (hit, distance)), (other, _)) in rays.iter().zip(&nearest).zip(&any) {
                sure += usize::from(check(case.name, ray, &triangles, *hit));
                assert_eq!(hit.is_some(), other.is_some(), "{}: {ray:?}", case.name);
                assert_eq!(hit.map_or(f64::INFINITY, |hit| hit.distance), *distance, "{}", case.name);
            }
        }
    }
    assert!(sure > 5000, "{sure} rays certainly meet something");
}
