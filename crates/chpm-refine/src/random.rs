//! Random legal cuts, which reach states that no uniform rule reaches: for tests and for verification.

use crate::cut::{Cut, Member};
use crate::error::RefineError;
use crate::hierarchy::Hierarchy;
use crate::select::select_by;
use crate::splits::{Splits, parents};
use chpm_format::{BoundaryMode, Chpm};
use chpm_mesh::GroupId;

/// A field has fewer balls than this; none is as likely as any other number.
const BALLS: f64 = 5.0;
/// Of most cuts hardly any group is left unsplit by chance, of some up to this share.
const MOST_RELUCTANT: f64 = 0.5;
/// The largest ball is as wide as the model, the smallest smaller by this power of two.
const HALVINGS: f64 = 8.0;

/// A legal cut that follows from `seed` alone, coarse in some places and fine in others: every cut has its own error almost
/// everywhere, and less in some balls of its own; some groups stay unsplit by chance. Errors are those of groups of a random level, so that cuts are as often shallow as
/// deep. Every group that is drawn then gets an error-bound of its own, of
/// those that leave it unsplit, and its clusters are positioned by it. With locked boundaries every cluster is at a position of its
/// own instead.
///
/// # Errors
/// [`RefineError::Format`] for a damaged page.
pub fn random_cut<D: AsRef<[u8]>>(file: &Chpm<D>, seed: u64) -> Result<Cut, RefineError> {
    let (mut random, hierarchy) = (SplitMix(seed), Hierarchy::new(file));
    let field = Field::new(file, &hierarchy, &mut random);
    match file.header().boundary_mode() {
        Some(BoundaryMode::Lock) => Ok(at_any_positions(file, &hierarchy, &field, &mut random)),
        _ => at_any_bounds(file, &hierarchy, &field, &mut random),
    }
}

/// Nothing but the clusters must agree.
fn at_any_positions<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    hierarchy: &Hierarchy,
    field: &Field,
    random: &mut SplitMix,
) -> Cut {
    let splits = Splits::wanted(file, hierarchy.top_down(), |group, _| {
        hierarchy.wants(group, field.bound(hierarchy, group)) && random.unit() >= field.reluctance
    });
    Cut::new(
        splits
            .active(file)
            .map(|(cluster, record)| {
                let collapses = record.vertex_count - record.base_vertex_count;
                let refined = (random.unit() * (f64::from(collapses) + 1.0)) as u32;
                Member { cluster, vertices: record.base_vertex_count + refined }
            })
            .collect(),
    )
}

/// As a view's, bounds never fall from a group to those below.
fn at_any_bounds<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    hierarchy: &Hierarchy,
    field: &Field,
    random: &mut SplitMix,
) -> Result<Cut, RefineError> {
    let mut bounds = vec![0.0_f32; file.groups().len()];
    for group in hierarchy.top_down() {
        let above = parents(file, *group).map(|above| bounds[above.index()]);
        let mut bound = above.fold(field.bound(hierarchy, *group), f32::max);
        if random.unit() < field.reluctance {
            bound = bound.max(hierarchy.split_error(*group).unwrap_or(0.0));
        }
        if !hierarchy.wants(*group, bound) {
            let room = file.groups()[group.index()].max_error - bound;
            bound += room.max(0.0) * random.unit() as f32;
        }
        bounds[group.index()] = bound;
    }
    select_by(file, hierarchy, |group| bounds[group.index()])
}

/// An error for every place. What a region needs is the least that any place of it needs, so regions that nest need no less
/// than what they hold.
struct Field {
    everywhere: f32,
    /// How often a group is not split though the field asks for it.
    reluctance: f64,
    balls: Vec<Ball>,
}

struct Ball {
    center: [f64; 3],
    radius: f64,
    error: f32,
}

impl Field {
    fn new<D: AsRef<[u8]>>(file: &Chpm<D>, hierarchy: &Hierarchy, random: &mut SplitMix) -> Self {
        // Groups come by falling level.
        let order = hierarchy.top_down();
        let level = |group: &GroupId| file.groups()[group.index()].level;
        let error = |at: u32, random: &mut SplitMix| {
            let start = order.partition_point(|group| level(group) > at);
            let end = order.partition_point(|group| level(group) >= at);
            let place = start + (random.unit() * (end - start) as f64) as usize;
            order.get(place).map_or(0.0, |group| {
                let group = &file.groups()[group.index()];
                group.min_error + (group.max_error - group.min_error) * random.unit() as f32
            })
        };
        let top = order.first().map_or(0, level);
        let coarsest = (random.unit() * (f64::from(top) + 1.0)) as u32;
        let everywhere = error(coarsest, random);
        let diagonal = file.header().aabb().diagonal();
        let count = (BALLS * random.unit()) as usize;
        let balls = (0..count).map(|_| {
            // Around a random cluster: as many balls of every size as there is detail.
            let cluster = (random.unit() * file.clusters().len() as f64) as usize;
            let (sphere, direction) =
                (file.clusters()[cluster].sphere(), [random.unit(), random.unit(), random.unit()]);
            let level = (random.unit() * (f64::from(coarsest) + 1.0)) as u32;
            Ball {
                center: [0, 1, 2].map(|axis| {
                    let offset = f64::from(sphere.radius) * (2.0 * direction[axis] - 1.0);
                    f64::from(sphere.center[axis]) + offset
                }),
                radius: diagonal * (-1.0 - HALVINGS * random.unit()).exp2(),
                error: error(level, random),
            }
        });
        let balls = balls.collect();
        let reluctance = MOST_RELUCTANT * random.unit().powi(3);
        Field { everywhere, reluctance, balls }
    }

    fn bound(&self, hierarchy: &Hierarchy, group: GroupId) -> f32 {
        let region = hierarchy.region(group);
        self.balls
            .iter()
            .filter(|ball| {
                let outside = [0, 1, 2]
                    .map(|a| (region.low[a] - ball.center[a]).max(ball.center[a] - region.high[a]).max(0.0));
                outside.iter().map(|x| x.powi(2)).sum::<f64>() <= ball.radius * ball.radius
            })
            .map(|ball| ball.error)
            .fold(self.everywhere, f32::min)
    }
}

/// Steele, Lea, Flood: Fast splittable pseudorandom number generators (2014), the SplitMix64 step.
pub(crate) struct SplitMix(pub(crate) u64);

impl SplitMix {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in `0..1`.
    pub(crate) fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }
}
