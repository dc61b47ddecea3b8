//! Groups that an earlier build has done: a result goes by a hash of all that decides it ([`key`]), in which shared vertices are numbered by the group alone
//! ([`ids`]).

mod entry;
mod ids;
mod key;

use super::group::{GroupDone, GroupTask};
use crate::error::BuildError;
use crate::memo::{Kind, Memo};
pub(super) use key::Reader;

/// What becomes of a group: as the memo has it, or else as `run` does it.
pub(super) fn group(
    memo: &Memo,
    task: &GroupTask<'_>,
    group: &[u32],
    reader: &mut Reader,
    run: impl FnOnce() -> Result<GroupDone, BuildError>,
) -> Result<GroupDone, BuildError> {
    // Errors of a root are found beside meshes far below it.
    if group.iter().any(|node| task.tree.is_root(*node)) {
        return run();
    }
    let (key, ids) = reader.key(task, group)?;
    if let Some((bytes, kept)) = memo.find(Kind::Group, key)? {
        return Ok(GroupDone { kept: Some(kept), ..entry::decode(task, &bytes, &ids)? });
    }
    let done = run()?;
    let bytes = entry::encode(task, &done, &ids)?;
    Ok(GroupDone { kept: Some(memo.add(Kind::Group, key, &bytes)?), ..done })
}
