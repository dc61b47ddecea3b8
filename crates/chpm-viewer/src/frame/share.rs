//! How models share what a picture may use.

use crate::error::ViewerError;
use chpm_mesh::Bytes;

/// Smallest and largest memory that a model can use.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Need {
    pub(super) least: u64,
    pub(super) most: u64,
}

/// The part of each model: as much for each, but what one cannot use is left to the others, and each has what it cannot do without. All of
/// it goes to a single one. `None` if it does not suffice for what they need at least.
fn shares(all: Bytes, needs: &[Need]) -> Option<Vec<Bytes>> {
    let mut left = all.0.checked_sub(needs.iter().map(|need| need.least).sum())?;
    // Beyond what each needs; who can use least is served first, and the last has the rest.
    let mut order: Vec<usize> = (0..needs.len()).collect();
    order.sort_by_key(|place| needs[*place].most);
    let mut parts = vec![Bytes(0); needs.len()];
    for (served, place) in order.into_iter().enumerate() {
        let Need { least, most } = needs[place];
        let others = (needs.len() - served) as u64;
        let fair = if others == 1 { left } else { (left / others).min(most.saturating_sub(least)) };
        parts[place] = Bytes(least + fair);
        left -= fair;
    }
    Some(parts)
}

/// Parts of a budget for models that need so much.
///
/// # Errors
/// [`ViewerError::Budget`] where it does not suffice. One alone says itself what it lacks.
pub(super) fn budget_shares(
    what: &'static str,
    all: Bytes,
    needs: &[Need],
) -> Result<Vec<Bytes>, ViewerError> {
    let parts = if needs.len() == 1 { Some(vec![all]) } else { shares(all, needs) };
    parts.ok_or_else(|| {
        let needed = Bytes(needs.iter().map(|need| need.least).sum());
        ViewerError::Budget { what, needed, got: all }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_one_cannot_use_the_other_has() {
        let need = |least, most| Need { least, most };
        let parts = |all, needs: &[Need]| {
            shares(Bytes(all), needs).map(|parts| parts.iter().map(|part| part.0).collect::<Vec<_>>())
        };
        assert_eq!(parts(100, &[need(10, 50)]), Some(vec![100]));
        assert_eq!(parts(100, &[need(10, 5000), need(10, 3000)]), Some(vec![50, 50]));
        assert_eq!(parts(100, &[need(10, 5000), need(10, 20)]), Some(vec![80, 20]));
        assert_eq!(parts(100, &[need(10, 20), need(10, 5000)]), Some(vec![20, 80]));
        assert_eq!(parts(100, &[need(70, 5000), need(30, 20)]), Some(vec![70, 30]));
        assert_eq!(parts(99, &[need(70, 5000), need(30, 20)]), None);
        assert_eq!(parts(0, &[]), Some(vec![]));
    }
}
