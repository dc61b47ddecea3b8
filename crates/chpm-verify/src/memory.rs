//! The memory that reading a `.chpm` may take, and how it is divided.

use crate::error::VerifyError;
use chpm_extmem::{MappedFile, process};
use chpm_format::{Chpm, SectionKind};
use chpm_measure::Searcher;
use chpm_mesh::{Bytes, MemorySize};
use rayon::ThreadPoolBuilder;

/// The program, its libraries and stacks, and what the allocator has not given back.
const PROGRAM: u64 = 24 << 20;
/// Pages of the file, and work on them: some groups of clusters at a time, at least.
const LEAST: u64 = 8 << 20;
/// Parts that a thread has begun, and leaves waiting for others that it takes from their threads.
const WAITING: u64 = 4;
/// Bytes of a triangle of such a part: itself, its corners, and its vertices with attributes.
const PART_BYTES: u64 = 96;
/// Multiple of bytes in which is told what is enough.
const UNIT: u64 = 1 << 20;

/// Divides `memory` by what reading `file` takes: the program, the tables, and `own` bytes that the verb has besides. Half of
/// what is left is for pages of the file, which go when it is used up; the answer is the other half.
///
/// # Errors
/// [`VerifyError::Memory`] if the tables alone take more.
pub fn divide(file: &Chpm<MappedFile>, memory: Bytes, own: u64) -> Result<u64, VerifyError> {
    let [half] = divide_among([(file, own)], memory)?;
    Ok(half)
}

/// How many threads find room in half of what `memory` leaves beside what reading `file` and the verb's `own` bytes take, at `each` bytes for a
/// thread, so that [`divide`] has enough for all of them. One at least: whether there is room for that, [`divide`] says.
pub fn threads(file: &Chpm<MappedFile>, memory: Bytes, own: u64, each: u64) -> usize {
    let fixed = fixed(file, own);
    let left = memory.0.saturating_sub(fixed);
    let most = (memory.0 / UNIT * UNIT).saturating_sub(fixed + LEAST);
    ((left / 2).min(most) / each.max(1)).max(1) as usize
}

/// The same as [`divide`] for several files, each of which has an equal share of `memory`. What is told to be enough is for all of them.
///
/// # Errors
/// [`VerifyError::Memory`] if the tables of one alone take more.
pub fn divide_among<const N: usize>(
    files: [(&Chpm<MappedFile>, u64); N],
    memory: Bytes,
) -> Result<[u64; N], VerifyError> {
    process::return_large_blocks();
    let fixed = files.map(|(file, own)| fixed(file, own));
    if let Some(place) = (0..N).max_by_key(|place| fixed[*place]) {
        let least = least(N, fixed[place]);
        if memory.0 < least {
            return Err(VerifyError::Memory {
                path: files[place].0.get_ref().path().to_owned(),
                asked: MemorySize(memory),
                least: MemorySize(Bytes(least)),
            });
        }
    }
    let mut halves = [0; N];
    for ((half, (file, _)), fixed) in halves.iter_mut().zip(files).zip(fixed) {
        *half = (memory.0 / N as u64).saturating_sub(fixed) / 2;
        // What chained pages rest on is kept unpacked: each page that is not there costs those above it once more. A quarter is for what unpacks them.
        let (above, mapped) = if file.header().is_chained() { (*half / 4, *half / 2) } else { (0, *half) };
        file.keep_above(above);
        file.get_ref().keep_resident(mapped);
    }
    Ok(halves)
}

/// Triangles of the cluster that has most.
pub(crate) fn largest(file: &Chpm<MappedFile>) -> u64 {
    file.clusters().iter().map(|cluster| cluster.triangle_count).max().unwrap_or(0).into()
}

/// Bytes that a thread takes which holds parts against a surface of tiles, none of more than so many triangles: tiles at hand, and the parts that wait meanwhile.
pub(crate) fn of_searcher(largest: u64) -> u64 {
    Searcher::bytes(largest) + WAITING * PART_BYTES * largest
}

/// Does `work`, which gets what is left of `free` bytes, on the threads at hand: as many of them as half of `free` has room for, where each takes `each` bytes
/// beside the first.
///
/// # Errors
/// [`VerifyError::Threads`], and those of `work`.
pub(crate) fn on_few<R: Send>(
    free: u64,
    each: u64,
    work: impl FnOnce(u64) -> Result<R, VerifyError> + Send,
) -> Result<R, VerifyError> {
    let at_hand = rayon::current_num_threads();
    let count = at_hand.min((free / 2 / each.max(1)) as usize + 1);
    let left = free - (count as u64 - 1) * each;
    if count == at_hand {
        return work(left);
    }
    let few = ThreadPoolBuilder::new().num_threads(count);
    few.build_scoped(|thread| thread.run(), |pool| pool.install(|| work(left)))?
}

/// Bytes that are taken whatever is read: the program, the tables, and the verb's own.
fn fixed(file: &Chpm<MappedFile>, own: u64) -> u64 {
    let tables =
        file.sections().filter(|(kind, _)| !matches!(kind, SectionKind::Pages | SectionKind::Texels));
    PROGRAM + tables.map(|(_, range)| range.len() as u64).sum::<u64>() + own
}

/// The memory with which so many files can be read of which the one that takes most takes `fixed` bytes.
fn least(files: usize, fixed: u64) -> u64 {
    files as u64 * (fixed + LEAST).next_multiple_of(UNIT)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_are_as_many_as_there_is_room_for() {
        let pool = ThreadPoolBuilder::new().num_threads(8).build().unwrap();
        let found = |free, each| {
            let work = |left| Ok((rayon::current_num_threads(), left));
            pool.install(|| on_few(free, each, work)).unwrap()
        };
        // Beside the first, in half of what is free.
        assert_eq!(found(0, 10), (1, 0));
        assert_eq!(found(19, 10), (1, 19));
        assert_eq!(found(60, 10), (4, 30));
        assert_eq!(found(1000, 10), (8, 930));
        assert_eq!(found(1000, 0), (8, 1000));
        let stopped = pool.install(|| on_few(0, 10, |_| Err::<(), _>(chpm_extmem::Cancelled.into())));
        assert!(matches!(stopped, Err(VerifyError::Cancelled(_))));
    }
}
