//! Groups of a level that other processes simplify: what they leave goes into parts, and is taken in in the order of the groups.

use super::dependency::GroupBorders;
use super::group::GroupDone;
use super::lasting::Lasting;
use super::{Clusters, Inputs, Levels, PageRef, cost, level_reports};
use crate::error::BuildError;
use crate::hierarchy::Tree;
use chpm_extmem::{Extent, ExtmemError, PartFile, PartWriter, Spool, Store};
use chpm_qem::{Displacement, DroppedComponent, FaceAttributeError};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;

/// Record of a part that has some groups of a level: pages first, and then what the level above reads beside them.
#[derive(Serialize, Deserialize)]
pub(crate) struct Handed {
    groups: Vec<GroupDone>,
    /// Bytes of all pages.
    pages: u64,
}

impl PageRef {
    /// The page and its remnants, which lie in the same spool.
    pub(super) fn in_pages(&mut self) -> [(&mut u64, usize); 2] {
        [
            (&mut self.offset, self.len as usize),
            (&mut self.lasting, self.lasting_count as usize * size_of::<Lasting>()),
        ]
    }

    /// Blobs that a parent reads beside the page: places and lengths of the base mesh's triangles, displacements, attribute errors and dropped components.
    pub(super) fn beside(&mut self) -> [(&mut u64, usize); 4] {
        let triangles = self.base_triangle_count as usize;
        [
            (&mut self.base_triangles, triangles * size_of::<[u16; 3]>()),
            (&mut self.displacements, triangles * size_of::<Displacement>()),
            (
                &mut self.attribute_errors,
                self.attribute_error_count as usize * size_of::<FaceAttributeError>(),
            ),
            (&mut self.dropped, self.dropped_count as usize * size_of::<DroppedComponent>()),
        ]
    }
}

/// Copies a blob, and notes where it is now.
fn copy(
    place: &mut u64,
    len: usize,
    spool: &Spool,
    scratch: &mut Vec<u8>,
    out: &mut PartWriter,
) -> Result<(), ExtmemError> {
    spool.read(*place, len, scratch)?;
    *place = out.append(scratch)?;
    Ok(())
}

impl Levels {
    /// The levels before anything is simplified.
    pub(crate) fn begin(inputs: &Inputs<'_>) -> Self {
        let shared = &inputs.decomposition.shared;
        let all_left = shared.interfaces().map(|(_, count)| count).collect();
        Levels::new(inputs.tree, all_left, &inputs.context.store)
    }

    /// Goes on to the next level, if all groups of this one have been taken in, and forms its groups.
    pub(crate) fn form(&mut self, inputs: &Inputs<'_>) -> Result<(), BuildError> {
        if self.first.is_some() {
            self.end(inputs)?;
        }
        if self.level < inputs.tree.level_count() {
            self.form_groups(&GroupBorders::at(self.level, inputs), inputs);
        }
        Ok(())
    }

    /// Triangles of each group of the level.
    pub(crate) fn weights(&self, inputs: &Inputs<'_>) -> Vec<u64> {
        let triangles = |node: &u32| cost::triangles(*node, inputs.tree, inputs.decomposition, &self.built);
        self.groups().iter().map(|group| group.iter().map(triangles).sum()).collect()
    }

    /// Simplifies some groups of the level, and writes what becomes of them in their order, whichever thread was done first.
    pub(crate) fn hand_over(
        &self,
        range: Range<usize>,
        inputs: &Inputs<'_>,
        out: &mut PartWriter,
    ) -> Result<Handed, BuildError> {
        let mut groups = match range.is_empty() {
            true => Vec::new(),
            false => self.simplify(range, &GroupBorders::at(self.level, inputs), inputs)?,
        };
        fn members(groups: &mut [GroupDone]) -> impl Iterator<Item = &mut PageRef> {
            groups.iter_mut().flat_map(|group| &mut group.members).map(|(page, _)| page)
        }
        let mut scratch = Vec::new();
        for page in members(&mut groups) {
            for (place, len) in page.in_pages() {
                copy(place, len, &self.built.pages, &mut scratch, out)?;
            }
        }
        let pages = out.len();
        for page in members(&mut groups) {
            for (place, len) in page.beside() {
                copy(place, len, &self.displacements[self.level as usize], &mut scratch, out)?;
                *place -= pages;
            }
        }
        Ok(Handed { groups, pages })
    }

    /// Takes in the next groups of the level, which `part` has.
    pub(crate) fn take_over(
        &mut self,
        part: &Arc<PartFile>,
        handed: Handed,
        inputs: &Inputs<'_>,
    ) -> Result<(), BuildError> {
        let Handed { groups, pages } = handed;
        if groups.is_empty() {
            return Ok(());
        }
        let beside = &mut self.displacements[self.level as usize];
        let before = [self.built.pages.earlier_len(), beside.earlier_len()];
        self.built.pages.push_earlier(Extent::new(Arc::clone(part), 0..pages)?);
        beside.push_earlier(Extent::new(Arc::clone(part), pages..part.len())?);
        for mut group in groups {
            for (page, _) in &mut group.members {
                page.in_pages().into_iter().for_each(|(place, _)| *place += before[0]);
                page.beside().into_iter().for_each(|(place, _)| *place += before[1]);
            }
            self.take(group, inputs.decomposition);
        }
        Ok(())
    }

    /// Whether the parts of the level had all its groups.
    pub(crate) fn is_whole(&self) -> bool {
        self.done == self.groups().len()
    }
}

impl Clusters {
    /// Moves the pages that this process has made into a part, in the order of the tree.
    pub(crate) fn hand_over(&mut self, out: &mut PartWriter, store: &Store) -> Result<(), BuildError> {
        let before = self.pages.earlier_len();
        let mut scratch = Vec::new();
        for page in self.refs.iter_mut().flatten().filter(|page| page.offset >= before) {
            for (place, len) in page.in_pages() {
                copy(place, len, &self.pages, &mut scratch, out)?;
                *place += before;
            }
        }
        // What only levels above would read has been where this process had it.
        self.refs.iter_mut().flatten().flat_map(PageRef::beside).for_each(|(place, _)| *place = 0);
        self.pages = self.pages.of_others(store);
        Ok(())
    }

    /// Takes in what [`Self::hand_over`] has put into `part`, and adds the sums of levels, which a record does not have.
    pub(crate) fn take_over(&mut self, part: &Arc<PartFile>, tree: &Tree) -> Result<(), BuildError> {
        self.pages.push_earlier(Extent::new(Arc::clone(part), 0..part.len())?);
        self.levels = level_reports(tree, &self.refs, &self.reports);
        Ok(())
    }
}
