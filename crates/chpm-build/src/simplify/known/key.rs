//! Keys: a hash of all that decides what becomes of a group, but for the ids of its shared vertices.

use super::ids::Ids;
use crate::error::BuildError;
use crate::memo::{Key, hash_value};
use crate::simplify::group::GroupTask;
use chpm_format::Page;
use xxhash_rust::xxh3::Xxh3;

/// A vertex that is not shared after all.
const NONE: u32 = u32::MAX;

/// Bits of a shared vertex: it stays for now, and only members of the group have it.
const LOCKED: u8 = 1;
const INSIDE: u8 = 2;

/// Scratch for keys.
#[derive(Default)]
pub(in crate::simplify) struct Reader {
    bytes: Vec<u8>,
    /// Ids of shared vertices, as the group's members have them one after another.
    met: Vec<u32>,
}

impl Reader {
    /// The key of a group, and its numbers of shared vertices.
    pub(super) fn key(&mut self, task: &GroupTask<'_>, group: &[u32]) -> Result<(Key, Ids), BuildError> {
        let mut hash = Xxh3::new();
        let settings = task.settings;
        let decides =
            ("group", settings.keep, settings.topology, settings.layout, task.level, task.most_lasting());
        hash_value(&mut hash, &(decides, task.decomposition.rounding))?;
        self.met.clear();
        for node in group {
            let children = task.built.children(task.tree, *node);
            hash_value(&mut hash, &(children.len() as u64))?;
            match children {
                [] => self.add_leaf(&mut hash, task, *node)?,
                _ => children.iter().try_for_each(|child| self.add_child(&mut hash, task, *child))?,
            }
        }

        let ids = Ids::of(&self.met);
        self.met.iter().for_each(|id| hash.update(&ids.number(*id).to_le_bytes()));
        for id in ids.all() {
            let mut done = 0;
            if *id != NONE && task.is_locked(*id) {
                let inside = task.group_borders.is_inside(*id, group);
                done = LOCKED | if inside { INSIDE } else { 0 };
            }
            hash.update(&[done, u8::from(*id == NONE)]);
        }
        Ok((hash.digest128(), ids))
    }

    /// A leaf's part of the source.
    fn add_leaf(&mut self, hash: &mut Xxh3, task: &GroupTask<'_>, leaf: u32) -> Result<(), BuildError> {
        let page = task.decomposition.read_leaf(leaf, &mut self.bytes)?;
        self.met.extend(page.ids().map(|id| id.unwrap_or(NONE)));
        self.add_page(hash)
    }

    /// Everything that a parent reads of a child.
    fn add_child(&mut self, hash: &mut Xxh3, task: &GroupTask<'_>, child: u32) -> Result<(), BuildError> {
        let mut page = task.built.page(child);
        task.built.pages.read(page.offset, page.len as usize, &mut self.bytes)?;
        self.met.extend(Page::view(&self.bytes)?.shared().map(|(_, id)| id));
        self.add_page(hash)?;
        let told = (page.bare_count, page.gaps.base, page.rest, page.group_error);
        hash_value(hash, &(told, page.source, page.deviation))?;
        let beside = &task.displacements[task.tree.nodes[child as usize].level as usize];
        for (place, len) in page.beside() {
            beside.read(*place, len, &mut self.bytes)?;
            hash_value(hash, &(len as u64))?;
            hash.update(&self.bytes);
        }
        Ok(())
    }

    /// The page that was read, without its ids.
    fn add_page(&mut self, hash: &mut Xxh3) -> Result<(), BuildError> {
        Page::renumber(&mut self.bytes, |_| 0)?;
        hash_value(hash, &(self.bytes.len() as u64))?;
        hash.update(&self.bytes);
        Ok(())
    }
}
