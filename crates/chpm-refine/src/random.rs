//! Random legal cuts, which reach states that no uniform rule reaches: for tests and for verification.

use crate::cut::{Cut, Member, position};
use crate::error::RefineError;
use crate::splits::{Splits, top_down};
use chpm_format::{BoundaryMode, Chpm, ClusterRecord, GroupRecord};

/// How often a group is split that could be.
const SPLIT: f64 = 0.75;

/// A legal cut that follows from `seed` alone. With locked boundaries any groups are split and every cluster is at a
/// position of its own; otherwise every group has an error bound of its own which, as a view's would, never falls from a
/// group to those below, and positions follow from it.
///
/// # Errors
/// [`RefineError::Format`] for a damaged page.
pub fn random_cut<D: AsRef<[u8]>>(file: &Chpm<D>, seed: u64) -> Result<Cut, RefineError> {
    let mut random = SplitMix(seed);
    match file.header().boundary_mode() {
        Some(BoundaryMode::Lock) => Ok(random_positions(file, &mut random)),
        _ => random_bounds(file, &mut random),
    }
}

fn random_positions<D: AsRef<[u8]>>(file: &Chpm<D>, random: &mut SplitMix) -> Cut {
    let splits = Splits::wanted(file, &top_down(file), |_, _| random.unit() < SPLIT);
    let anywhere = |(cluster, record): (_, &ClusterRecord)| {
        let collapses = record.vertex_count - record.base_vertex_count;
        let refined = (random.unit() * (f64::from(collapses) + 1.0)) as u32;
        Member { cluster, vertices: record.base_vertex_count + refined }
    };
    Cut::new(splits.active(file).map(anywhere).collect())
}

fn random_bounds<D: AsRef<[u8]>>(file: &Chpm<D>, random: &mut SplitMix) -> Result<Cut, RefineError> {
    let mut bounds = vec![0.0_f32; file.groups().len()];
    let splits = Splits::wanted(file, &top_down(file), |id, group| {
        let above = file.coarse(id).iter().map(|cluster| &file.clusters()[*cluster as usize]);
        let above = above.filter(|cluster| !cluster.is_root());
        let least = above.map(|cluster| bounds[cluster.parent_group().index()]).fold(0.0, f32::max);
        let bound = random_bound(group, random).max(least);
        bounds[id.index()] = bound;
        group.min_error > bound
    });
    let members =
        splits.active(file).map(|(cluster, record)| position(file, cluster, bounds[record.group().index()]));
    Ok(Cut::new(members.collect::<Result<_, _>>()?))
}

/// Below `min_error`, over many scales, or between it and `max_error`.
fn random_bound(group: &GroupRecord, random: &mut SplitMix) -> f32 {
    if random.unit() < SPLIT {
        group.min_error * (-20.0 * random.unit()).exp2() as f32
    } else {
        group.min_error + (group.max_error - group.min_error) * random.unit() as f32
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
