//! Specks: what of an outline is next to nothing and lies far from all the rest, such as a stray return of a scanner. Whoever looked at them as well
//! would see nothing of the model.

use nalgebra::{Point3, Vector3};

/// Of the surface, what specks are together, at most.
const SHARE: f64 = 0.01;
/// Of the surface, what is left out at each end of each axis to find where most of the model is.
const TAIL: f64 = 0.005;
/// How far from the rest a speck lies at least, by the diagonal of what most of the model takes.
const FAR: f64 = 0.35;
/// How often the box grows by what is near it: a chain of parts longer than this is no model.
const STEPS: usize = 64;

/// A box.
#[derive(Clone, Copy, Debug)]
struct Extent {
    low: Point3<f64>,
    high: Point3<f64>,
}

impl Extent {
    const NOTHING: Extent = Extent {
        low: Point3::new(f64::INFINITY, f64::INFINITY, f64::INFINITY),
        high: Point3::new(f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY),
    };

    fn add(&mut self, other: &Extent) {
        self.low = self.low.inf(&other.low);
        self.high = self.high.sup(&other.high);
    }

    /// The least distance of two boxes.
    fn apart(&self, other: &Extent) -> f64 {
        Vector3::from_fn(|axis, _| {
            (self.low[axis] - other.high[axis]).max(other.low[axis] - self.high[axis]).max(0.0)
        })
        .norm()
    }
}

/// Triangles that hang together by common points.
struct Part {
    extent: Extent,
    area: f64,
    triangles: Vec<u32>,
}

/// Which triangles are specks, and their share of the surface; none where that is not next to nothing.
pub(super) fn specks(points: &[Point3<f64>], triangles: &[[u32; 3]]) -> (Vec<bool>, f64) {
    let mut is_speck = vec![false; triangles.len()];
    let parts = parts(points, triangles);
    let total: f64 = parts.iter().map(|part| part.area).sum();
    let bulk = bulk(&parts, points, triangles);
    let reach = FAR * (bulk.high - bulk.low).norm();
    if parts.len() < 2 || !(total > 0.0 && total.is_finite() && reach > 0.0) {
        return (is_speck, 0.0);
    }

    // What is large belongs to the model wherever it is, and so does what is near to something that does.
    let mut model = bulk;
    let (large, mut small): (Vec<Part>, Vec<Part>) =
        parts.into_iter().partition(|part| part.area > SHARE * total);
    large.iter().for_each(|part| model.add(&part.extent));
    for _ in 0..STEPS {
        let (near, far): (Vec<Part>, Vec<Part>) =
            small.into_iter().partition(|part| model.apart(&part.extent) <= reach);
        small = far;
        if near.is_empty() {
            break;
        }
        near.iter().for_each(|part| model.add(&part.extent));
    }
    let share = small.iter().map(|part| part.area).sum::<f64>() / total;
    if small.is_empty() || share > SHARE {
        return (is_speck, 0.0);
    }
    small.iter().flat_map(|part| &part.triangles).for_each(|place| is_speck[*place as usize] = true);
    (is_speck, share)
}

/// The box of most of the surface: on each axis without the outermost of it.
fn bulk(parts: &[Part], points: &[Point3<f64>], triangles: &[[u32; 3]]) -> Extent {
    let total: f64 = parts.iter().map(|part| part.area).sum();
    let mut bulk = Extent::NOTHING;
    for axis in 0..3 {
        let middle = |corners: &[u32; 3]| corners.map(|c| points[c as usize][axis]).iter().sum::<f64>() / 3.0;
        let mut along: Vec<(f64, f64)> =
            triangles.iter().map(|corners| (middle(corners), area(points, corners))).collect();
        along.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut before = 0.0;
        for (at, area) in along {
            before += area;
            if before >= TAIL * total && before - area <= (1.0 - TAIL) * total {
                (bulk.low[axis], bulk.high[axis]) = (bulk.low[axis].min(at), bulk.high[axis].max(at));
            }
        }
    }
    bulk
}

fn area(points: &[Point3<f64>], corners: &[u32; 3]) -> f64 {
    let [a, b, c] = corners.map(|corner| points[corner as usize]);
    0.5 * (b - a).cross(&(c - a)).norm()
}

fn parts(points: &[Point3<f64>], triangles: &[[u32; 3]]) -> Vec<Part> {
    let mut leaders: Vec<u32> = (0..points.len() as u32).collect();

    for [a, b, c] in triangles {
        for (one, other) in [(a, b), (a, c)] {
            let (one, other) = (find(&mut leaders, *one), find(&mut leaders, *other));
            leaders[one.max(other) as usize] = one.min(other);
        }
    }

    let mut numbers = vec![usize::MAX; points.len()];
    let mut parts: Vec<Part> = Vec::new();
    for (place, corners) in (0..).zip(triangles) {
        let number = &mut numbers[find(&mut leaders, corners[0]) as usize];
        if *number == usize::MAX {
            *number = parts.len();
            parts.push(Part { extent: Extent::NOTHING, area: 0.0, triangles: Vec::new() });
        }

        let part = &mut parts[*number];
        part.triangles.push(place);
        part.area += area(points, corners);
        for corner in corners {
            let at = points[*corner as usize];
            part.extent.add(&Extent { low: at, high: at });
        }
    }
    parts
}

fn find(leaders: &mut [u32], mut point: u32) -> u32 {
    while leaders[point as usize] != point {
        let above = leaders[leaders[point as usize] as usize];
        leaders[point as usize] = above;
        point = above;
    }
    point
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grid of so many squares a side, a unit wide, at a place.
    fn sheet(side: u32, width: f64, at: [f64; 3], mesh: &mut (Vec<Point3<f64>>, Vec<[u32; 3]>)) {
        let first = mesh.0.len() as u32;
        let row = side + 1;
        let along = |n: u32| width * f64::from(n) / f64::from(side);
        mesh.0.extend(
            (0..row * row).map(|n| Point3::new(at[0] + along(n % row), at[1] + along(n / row), at[2])),
        );
        for place in (0..side * side).map(|n| first + n / side * row + n % side) {
            mesh.1.extend([[place, place + 1, place + row], [place + 1, place + row + 1, place + row]]);
        }
    }

    fn told(mesh: &(Vec<Point3<f64>>, Vec<[u32; 3]>)) -> usize {
        specks(&mesh.0, &mesh.1).0.iter().filter(|is| **is).count()
    }

    #[test]
    fn far_dust_is_left_out_and_parts_are_not() {
        let mut model = (Vec::new(), Vec::new());
        sheet(20, 1.0, [5.0, 0.0, 0.0], &mut model);
        assert_eq!(told(&model), 0);
        // A small part beside it, and one beside that.
        sheet(1, 0.02, [6.3, 0.0, 0.0], &mut model);
        sheet(1, 0.02, [6.6, 0.3, 0.0], &mut model);
        assert_eq!(told(&model), 0);
        // Dust, at two places.
        sheet(1, 0.02, [40.0, 0.0, 7.0], &mut model);
        sheet(1, 0.03, [0.0, 0.0, -300.0], &mut model);
        let (specks, share) = specks(&model.0, &model.1);
        assert_eq!(specks.iter().filter(|is| **is).count(), 4);
        assert!(specks.iter().rev().take(4).all(|is| *is) && share > 0.0 && share < 0.01, "{share}");
        // Something as large as the model is no speck, however far.
        sheet(3, 1.0, [900.0, 0.0, 0.0], &mut model);
        assert!(told(&model) < 10);
    }

    #[test]
    fn much_dust_is_a_cloud_and_belongs_to_the_model() {
        let mut model = (Vec::new(), Vec::new());
        sheet(20, 1.0, [0.0; 3], &mut model);
        for n in 0..40 {
            sheet(1, 0.05, [30.0 + f64::from(n), 0.0, 0.0], &mut model);
        }
        assert_eq!(told(&model), 0);
        assert_eq!(specks(&[], &[]).0.len(), 0);
        let flat = [Point3::origin(); 3];
        assert_eq!(specks(&flat, &[[0, 1, 2]]), (vec![false], 0.0));
    }
}
