//! Shared vertices in the numbers of one group.

/// Numbers that a group gives its shared vertices, in the order in which they come up: the same whatever their ids are in the model.
#[derive(Debug, Default)]
pub(super) struct Ids {
    /// Ids of the model by number.
    by_number: Vec<u32>,
    /// Ids with their numbers, by id.
    by_id: Vec<(u32, u32)>,
}

impl Ids {
    /// Of ids as they come up.
    pub(super) fn of(met: &[u32]) -> Self {
        let mut first: Vec<(u32, u32)> = met.iter().copied().zip(0..).collect();
        first.sort_unstable();
        first.dedup_by_key(|(id, _)| *id);
        let mut by_number = first.clone();
        by_number.sort_unstable_by_key(|(_, at)| *at);
        let by_number: Vec<u32> = by_number.into_iter().map(|(id, _)| id).collect();
        let mut by_id: Vec<(u32, u32)> = by_number.iter().copied().zip(0..).collect();
        by_id.sort_unstable();
        Ids { by_number, by_id }
    }

    /// All ids, by number.
    pub(super) fn all(&self) -> &[u32] {
        &self.by_number
    }

    /// The number of an id that has come up.
    pub(super) fn number(&self, id: u32) -> u32 {
        self.by_id.binary_search_by_key(&id, |(id, _)| *id).map_or(u32::MAX, |at| self.by_id[at].1)
    }

    /// The id of a number; none if there is no such.
    pub(super) fn id(&self, number: u32) -> Option<u32> {
        self.by_number.get(number as usize).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_go_by_first_appearance() {
        let ids = Ids::of(&[40, 7, 40, 90, 7]);
        assert_eq!(ids.all(), [40, 7, 90]);
        assert_eq!([40, 7, 90, 8].map(|id| ids.number(id)), [0, 1, 2, u32::MAX]);
        assert_eq!([0, 1, 2, 3].map(|number| ids.id(number)), [Some(40), Some(7), Some(90), None]);
        // Other ids in the same places have the same numbers.
        let others = Ids::of(&[3, 5, 3, 4, 5]);
        assert_eq!([3, 5, 4].map(|id| others.number(id)), [0, 1, 2]);
    }
}
