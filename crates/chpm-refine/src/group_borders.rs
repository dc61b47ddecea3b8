//! The borders inside a group, undone vertex by vertex: a vertex comes back in all members that have it, or in none.

use chpm_format::Page;
use std::collections::BTreeMap;

/// Positions of a group's members on the way to their finest meshes, the worst error first.
pub(crate) struct GroupBorders<'a> {
    pages: &'a [Page<'a>],
    /// By member: shared id by vertex.
    id_of: Vec<BTreeMap<usize, u32>>,
    /// Members and vertices by shared id.
    places: BTreeMap<u32, Vec<(usize, usize)>>,
    /// The positions of all members after every step; the first are those that it started with.
    states: Vec<Vec<usize>>,
}

impl<'a> GroupBorders<'a> {
    /// Members at these positions, which agree on the group borders.
    pub(crate) fn new(pages: &'a [Page<'a>], positions: Vec<usize>) -> Self {
        let (mut id_of, mut places) = (Vec::new(), BTreeMap::<u32, Vec<_>>::new());
        for (member, (page, at)) in pages.iter().zip(&positions).enumerate() {
            let shared = page.shared().map(|(vertex, id)| (usize::from(vertex), id));
            let to_come: BTreeMap<usize, u32> = shared.filter(|(vertex, _)| vertex >= at).collect();
            to_come.iter().for_each(|(vertex, id)| places.entry(*id).or_default().push((member, *vertex)));
            id_of.push(to_come);
        }
        GroupBorders { pages, id_of, places, states: vec![positions] }
    }

    /// The members' positions after so many steps.
    pub(crate) fn positions(&self, step: usize) -> &[usize] {
        &self.states[step]
    }

    /// Goes on until all members are at their finest meshes; answers the number of steps.
    pub(crate) fn undo_all(&mut self) -> usize {
        while let Some(next) = self.next() {
            self.states.push(next);
        }
        self.states.len() - 1
    }

    /// The next vertex of the worst member, with all that it brings.
    fn next(&self) -> Option<Vec<usize>> {
        let mut positions = self.states.last()?.clone();
        let coarse =
            (0..self.pages.len()).filter(|member| positions[*member] < self.pages[*member].vertex_count());
        let error = |member: &usize| self.pages[*member].error_at(positions[*member]);
        // The first of equals.
        let worst = coarse.rev().max_by(|a, b| error(a).total_cmp(&error(b)))?;
        let mut wanted = vec![(worst, positions[worst])];
        while let Some((member, vertex)) = wanted.pop() {
            let from = positions[member];
            positions[member] = from.max(vertex + 1);
            for (_, id) in self.id_of[member].range(from..positions[member]) {
                wanted.extend(self.places[id].iter().filter(|(other, _)| *other != member));
            }
        }
        Some(positions)
    }
}
