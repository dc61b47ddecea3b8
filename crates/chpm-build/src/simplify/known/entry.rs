//! Results as they are kept: a record, and behind it the blobs that its places are of.

use super::ids::Ids;
use crate::error::BuildError;
use crate::memo::{opened, sealed};
use crate::report::LevelReport;
use crate::simplify::PageRef;
use crate::simplify::group::{GroupDone, GroupTask};
use chpm_format::Page;

type Members = Vec<(PageRef, LevelReport)>;

/// A group's result with the group's own numbers of shared vertices; places count from the first blob.
pub(super) fn encode(task: &GroupTask<'_>, done: &GroupDone, ids: &Ids) -> Result<Vec<u8>, BuildError> {
    let (mut blobs, mut blob) = (Vec::new(), Vec::new());
    let mut members = done.members.clone();
    for (page, _) in &mut members {
        let in_pages = page.in_pages();
        for (is_page, (place, len)) in [true, false].into_iter().zip(in_pages) {
            task.built.pages.read(*place, len, &mut blob)?;
            if is_page {
                Page::renumber(&mut blob, |id| ids.number(id))?;
            }
            *place = blobs.len() as u64;
            blobs.extend_from_slice(&blob);
        }
        for (place, len) in page.beside() {
            task.displacements[task.level as usize].read(*place, len, &mut blob)?;
            *place = blobs.len() as u64;
            blobs.extend_from_slice(&blob);
        }
    }
    let removed: Vec<u32> = done.removed.iter().map(|id| ids.number(*id)).collect();
    sealed(&(members, removed), &blobs)
}

/// The result in the ids of this model, its blobs spooled.
pub(super) fn decode(task: &GroupTask<'_>, bytes: &[u8], ids: &Ids) -> Result<GroupDone, BuildError> {
    let ((mut members, removed), blobs) = opened::<(Members, Vec<u32>)>(bytes)?;
    let id = |number: u32| ids.id(number).unwrap_or(u32::MAX);
    for (page, _) in &mut members {
        let mut own = blobs.get(page.offset, page.len as usize)?.to_vec();
        Page::renumber(&mut own, id)?;
        let [_, (lasting, lasting_len)] = page.in_pages();
        if lasting_len > 0 {
            *lasting = task.built.pages.append(blobs.get(*lasting, lasting_len)?)?;
        }
        page.offset = task.built.pages.append(&own)?;
        for (place, len) in page.beside() {
            *place = task.displacements[task.level as usize].append(blobs.get(*place, len)?)?;
        }
    }
    Ok(GroupDone { members, removed: removed.into_iter().map(id).collect() })
}
