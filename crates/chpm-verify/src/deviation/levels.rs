//! Levels, one after the other: all clusters of a level at the same part of their collapses.

use super::{Judge, MemberDeviation, Vanished, Violations};
use crate::error::VerifyError;
use chpm_extmem::{Cancel, MappedFile, Progress};
use chpm_format::Chpm;
use chpm_measure::{Side, Tally};
use chpm_mesh::{GroupId, Level};
use chpm_refine::{Cut, Member, RefineError};

/// Deviation of a level, or of a cut.
#[derive(Clone, Debug)]
pub struct LevelDeviation {
    /// Clusters that were measured.
    pub clusters: u64,
    /// Triangles that they draw.
    pub triangles: u64,
    /// Largest stored error.
    pub stored: f32,
    /// Largest stored distance.
    pub distance: f32,
    /// From the source to the mesh.
    pub of_source: Side,
    /// From the mesh to the source.
    pub of_mesh: Side,
    /// Stored by measured distance, over the clusters for which there is such a ratio.
    pub ratio: Option<Spread>,
    /// Samples beyond the error, and within the distance.
    pub vanished: Vanished,
    /// Samples beyond what is stored.
    pub violations: Violations,
    /// Clusters with a violation.
    pub violating: u64,
}

/// How values are spread; of the nearest rank.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Spread {
    /// How many values there are.
    pub count: usize,
    /// The least.
    pub min: f64,
    /// Half of them are at most this.
    pub median: f64,
    /// 95 of 100 are at most this.
    pub p95: f64,
    /// The largest.
    pub max: f64,
}

impl Spread {
    /// None of no values.
    pub fn of(mut values: Vec<f64>) -> Option<Self> {
        values.sort_unstable_by(f64::total_cmp);
        let rank =
            |part: f64| values[((part * values.len() as f64).ceil() as usize).clamp(1, values.len()) - 1];
        let (count, [min, max]) = (values.len(), [values.first(), values.last()]);
        Some(Spread { count, min: *min?, median: rank(0.5), p95: rank(0.95), max: *max? })
    }
}

impl LevelDeviation {
    /// Sums up members. One that deviates by no more than rounding has no ratio.
    pub fn of(members: &[MemberDeviation], slack: f64) -> Self {
        let (mut of_source, mut of_mesh) = (Tally::default(), Tally::default());
        let (mut vanished, mut violations) = (Vanished::default(), Violations::default());
        for member in members {
            of_source.merge(&member.of_source);
            of_mesh.merge(&member.of_mesh);
            vanished.merge(&member.vanished);
            violations.merge(&member.violations);
        }
        let deviating = members.iter().filter(|m| m.measured() > slack);
        let ratios = deviating.map(|m| f64::from(m.distance) / m.measured()).collect();
        LevelDeviation {
            clusters: members.len() as u64,
            triangles: members.iter().map(|m| m.triangles).sum(),
            stored: members.iter().map(|m| m.stored).fold(0.0, f32::max),
            distance: members.iter().map(|m| m.distance).fold(0.0, f32::max),
            of_source: of_source.side(),
            of_mesh: of_mesh.side(),
            ratio: Spread::of(ratios),
            vanished,
            violations,
            violating: members.iter().filter(|m| m.violations.samples > 0).count() as u64,
        }
    }

    /// The larger maximum of both ways.
    pub fn max(&self) -> f64 {
        self.of_source.max.max(self.of_mesh.max)
    }

    /// The larger root mean square of both ways.
    pub fn rms(&self) -> f64 {
        self.of_source.rms.max(self.of_mesh.rms)
    }

    /// The larger mean of both ways.
    pub fn mean(&self) -> f64 {
        self.of_source.mean.max(self.of_mesh.mean)
    }
}

/// Measures every level at `positions` of its progressive meshes: the base mesh, and others at equal numbers of collapses from
/// there up. The finest meshes are the base meshes of the level below (I4). Hands each to `tell` with level and the part
/// of the collapses that is applied.
///
/// # Errors
/// As [`Judge::cut`].
pub fn levels(
    judge: &Judge<'_>,
    positions: u32,
    progress: &dyn Progress,
    cancel: &Cancel,
    mut tell: impl FnMut(u32, f64, LevelDeviation),
) -> Result<(), VerifyError> {
    let file = judge.file();
    for level in 0..file.levels().len() as u32 {
        for step in (0..positions).rev() {
            let part = 1.0 - f64::from(step) / f64::from(positions);
            let cut = at_position(file, level, part)?;
            let label = format!("level {level}, {:.0} %", 100.0 * part);
            let mut members = judge.cut(&cut, &label, progress, cancel)?;
            members.retain(|m| file.clusters()[m.member.cluster.index()].level == level);
            tell(level, part, LevelDeviation::of(&members, judge.slack()));
        }
    }
    Ok(())
}

/// The cut of a level with `part` of the collapses applied. A group has one error bound: what the member with most collapses has
/// there. Roots below the level stay at their finest meshes.
pub(crate) fn at_position(file: &Chpm<MappedFile>, level: u32, part: f64) -> Result<Cut, RefineError> {
    let cut = Cut::at_level(file, Level(level));
    let mut members = Vec::with_capacity(cut.members().len());
    for member in cut.members() {
        let record = &file.clusters()[member.cluster.index()];
        if record.level != level {
            members.push(*member);
            continue;
        }
        let vertices =
            file.page(member.cluster)?.view().vertices_for(bound(file, record.group(), part)?) as u32;
        members.push(Member { vertices, ..*member });
    }
    Ok(Cut::new(members))
}

fn bound(file: &Chpm<MappedFile>, group: GroupId, part: f64) -> Result<f32, RefineError> {
    if part >= 1.0 {
        return Ok(file.groups()[group.index()].max_error);
    }
    let collapses = file.coarse(group).iter().map(|id| {
        let record = &file.clusters()[*id as usize];
        (chpm_mesh::ClusterId(*id), record.vertex_count - record.base_vertex_count)
    });
    let Some((cluster, most)) = collapses.max_by_key(|(_, collapses)| *collapses) else { return Ok(0.0) };
    let page = file.page(cluster)?;
    let page = page.view();
    Ok(page.error_at(page.vertex_count() - (part * f64::from(most)) as usize))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spread_is_of_values_that_are_there() {
        assert_eq!(Spread::of(vec![]), None);
        let spread = Spread::of((1..=20).rev().map(f64::from).collect()).unwrap();
        assert_eq!(
            (spread.count, spread.min, spread.median, spread.p95, spread.max),
            (20, 1.0, 10.0, 19.0, 20.0)
        );
        let one = Spread::of(vec![3.0]).unwrap();
        assert_eq!((one.min, one.median, one.p95, one.max), (3.0, 3.0, 3.0, 3.0));
    }
}
