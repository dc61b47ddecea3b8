//! Members of a group whose last collapses cost far more than those of the others: they keep these for the level above, where more of what surrounds them may go.
//!
//! All members are drawn with the error of the worst. Where most vertices are shared, as in small clusters, or all of what is coarse lies in one member, half of
//! its triangles go at many times the error of the others, and that is the least error of all groups above.

use chpm_qem::Collapse;

/// This share of the group's collapses tells what errors are usual.
const USUAL: f64 = 0.75;
/// So many times the usual error is too much.
const TOO_MUCH: f32 = 2.0;

/// Most triangles that such a member leaves, by those of a leaf: a quarter of it is what is usual.
pub(super) const MOST_LEFT: usize = 2;

/// Scratch.
#[derive(Debug, Default)]
pub(super) struct Errors(Vec<f32>);

impl Errors {
    /// The largest error that members are to have, from the errors of all their collapses; infinite if there are none.
    pub(super) fn limit<'a>(&mut self, members: impl Iterator<Item = &'a [f32]>) -> f32 {
        self.0.clear();
        members.for_each(|errors| self.0.extend_from_slice(errors));
        let usual = (self.0.len() as f64 * USUAL) as usize;
        if usual >= self.0.len() {
            return f32::INFINITY;
        }
        TOO_MUCH * *self.0.select_nth_unstable_by(usual, f32::total_cmp).1
    }
}

/// How many of a member's collapses stay: those up to the limit, and as many more as it takes to go down from `triangles` to about `most`, so that
/// clusters do not grow from level to level. All of them go from `triangles` to `left`; the first `group_border` have to stay.
pub(super) fn kept(
    collapses: &[Collapse],
    group_border: usize,
    limit: f32,
    [triangles, left]: [usize; 2],
    most: usize,
) -> usize {
    let within = collapses.partition_point(|collapse| collapse.error <= limit);
    let needed = match triangles.saturating_sub(most) {
        0 => 0,
        surplus => (collapses.len() * surplus).div_ceil(triangles.saturating_sub(left).max(1)),
    };
    within.max(needed).max(group_border).min(collapses.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn collapses(errors: &[f32]) -> Vec<Collapse> {
        errors.iter().map(|error| Collapse { from: 0, to: 1, error: *error }).collect()
    }

    #[test]
    fn what_three_quarters_have_is_usual() {
        let mut errors = Errors::default();
        assert_eq!(errors.limit([].into_iter()), f32::INFINITY);
        assert_eq!(errors.limit([&[5.0][..]].into_iter()), 10.0);
        let members = [&[9.0, 2.0, 1.0][..], &[], &[50.0, 3.0, 1.0, 1.0, 1.0]];
        assert_eq!(errors.limit(members.into_iter()), 18.0);
    }

    #[test]
    fn a_member_that_runs_away_keeps_what_is_dear() {
        let all = collapses(&[1.0, 1.0, 2.0, 3.0, 8.0, 90.0]);
        assert_eq!(kept(&all, 0, 4.0, [12, 6], 12), 4);
        assert_eq!(kept(&all, 0, 90.0, [12, 6], 12), 6);
        assert_eq!(kept(&all, 5, 4.0, [12, 6], 12), 5);
        // It has to go down to 7, for which five of the six collapses are needed.
        assert_eq!(kept(&all, 0, 4.0, [12, 6], 7), 5);
        assert_eq!(kept(&all, 0, 4.0, [12, 6], 3), 6);
        assert_eq!(kept(&[], 0, 4.0, [12, 12], 3), 0);
    }
}
