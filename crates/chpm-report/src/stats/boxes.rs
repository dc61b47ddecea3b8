//! Shapes of the clusters' boxes, and how much those that one split brings overlap.

use chpm_format::Chpm;
use chpm_mesh::{Aabb, GroupId};

fn sides(bounds: &Aabb) -> [f64; 3] {
    [0, 1, 2].map(|axis| f64::from(bounds.max[axis]) - f64::from(bounds.min[axis]))
}

/// The longest side by the second longest; none for a box that is a line or a point. The shortest says only how flat a piece of a surface is.
pub(super) fn aspect(bounds: &Aabb) -> Option<f64> {
    let mut sides = sides(bounds);
    sides.sort_unstable_by(f64::total_cmp);
    (sides[1] > 0.0).then(|| sides[2] / sides[1])
}

/// Half the surface of a box: flat boxes have one, too.
fn surface([x, y, z]: [f64; 3]) -> f64 {
    x * y + y * z + z * x
}

/// The part that two boxes have in common, by its surface; zero where they have none.
fn common(a: &Aabb, b: &Aabb) -> f64 {
    let both = Aabb {
        min: std::array::from_fn(|axis| a.min[axis].max(b.min[axis])),
        max: std::array::from_fn(|axis| a.max[axis].min(b.max[axis])),
    };
    let sides = sides(&both);
    if sides.iter().any(|side| *side < 0.0) { 0.0 } else { surface(sides) }
}

/// For each cluster the largest share of its box's surface that the box of another cluster which comes with the same split takes; none for
/// those that come alone, and boxes without a surface.
pub(super) fn overlaps<D: AsRef<[u8]>>(file: &Chpm<D>) -> Vec<Option<f64>> {
    let mut overlaps = vec![None; file.clusters().len()];
    for group in 0..file.groups().len() as u32 {
        let fine = file.fine(GroupId(group));
        for id in fine {
            let bounds = file.clusters()[*id as usize].aabb();
            let own = surface(sides(&bounds));
            let others = fine.iter().filter(|other| *other != id);
            let most = others
                .map(|other| common(&bounds, &file.clusters()[*other as usize].aabb()))
                .fold(None, most);
            overlaps[*id as usize] = most.filter(|_| own > 0.0).map(|most| most / own);
        }
    }
    overlaps
}

fn most(so_far: Option<f64>, next: f64) -> Option<f64> {
    Some(so_far.map_or(next, |so_far| so_far.max(next)))
}

/// Groups one below the other, from the top: the most splits that stand between a root and a leaf, and one.
pub(super) fn longest_path<D: AsRef<[u8]>>(file: &Chpm<D>) -> u32 {
    let mut order: Vec<u32> = (0..file.groups().len() as u32).collect();
    order.sort_by_key(|group| std::cmp::Reverse(file.groups()[*group as usize].level));
    let mut lengths = vec![1_u32; order.len()];
    for group in order {
        let length = lengths[group as usize];
        for fine in file.fine(GroupId(group)) {
            let below = file.clusters()[*fine as usize].group().index();
            lengths[below] = lengths[below].max(length + 1);
        }
    }
    lengths.into_iter().max().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_have_an_aspect_and_a_common_part() {
        let of = |max: [f32; 3]| Aabb { min: [0.0; 3], max };
        assert_eq!(aspect(&of([4.0, 2.0, 1.0])), Some(2.0));
        assert_eq!((aspect(&of([3.0, 3.0, 0.0])), aspect(&of([3.0, 0.0, 0.0]))), (Some(1.0), None));
        let right = Aabb { min: [1.0, 0.0, 0.0], max: [3.0, 2.0, 0.0] };
        assert_eq!(common(&of([2.0, 2.0, 0.0]), &right), 2.0);
        assert_eq!(common(&of([0.5, 2.0, 0.0]), &right), 0.0);
    }
}
