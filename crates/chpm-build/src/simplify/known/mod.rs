//! Groups that an earlier build has done: a result goes by a hash of all that decides it ([`key`]), in which shared vertices are numbered by the group alone
//! ([`ids`]).

mod entry;
mod ids;
mod key;

use super::group::{GroupDone, GroupTask};
use crate::error::BuildError;
use crate::memo::{Memo, Owner};
pub(super) use key::Reader;

/// Result of a group, which is one of those of its level: as the memo has it, or else as `run` does it.
pub(super) fn group(
    memo: &Memo,
    task: &GroupTask<'_>,
    (index, group): (usize, &[u32]),
    reader: &mut Reader,
    run: impl FnOnce() -> Result<GroupDone, BuildError>,
) -> Result<GroupDone, BuildError> {
    // Errors of a root are found beside meshes far below it.
    if group.iter().any(|node| task.tree.is_root(*node)) {
        return run();
    }
    let ((key, ids), owner) = (reader.key(task, group)?, Owner::Group(task.level, index));
    if let Some(bytes) = memo.find(owner, key)? {
        return entry::decode(task, &bytes, &ids);
    }
    let done = run()?;
    memo.add(owner, key, &entry::encode(task, &done, &ids)?)?;
    Ok(done)
}
