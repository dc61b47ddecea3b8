//! What a verb that reads a `.chpm` may have in memory, and how that is divided.

use crate::args::MemorySize;
use anyhow::{Result, ensure};
use chpm_extmem::{MappedFile, process};
use chpm_format::{Chpm, SectionKind};
use chpm_mesh::Bytes;

/// The program, its libraries and stacks, and what the allocator has not given back.
const PROGRAM: u64 = 24 << 20;
/// Pages of the file, and work on them: some groups of clusters at a time, at least.
const LEAST: u64 = 8 << 20;

/// The memory of a verb that only reads.
#[derive(clap::Args, Clone, Debug)]
pub(crate) struct MemoryArgs {
    /// Memory that the whole process stays below, as in 64M; refused if the file's tables alone take more
    #[arg(long, value_name = "SIZE", default_value = "1G")]
    memory: MemorySize,
}

impl MemoryArgs {
    /// What there is.
    pub(crate) fn memory(&self) -> Bytes {
        self.memory.0
    }
}

/// Divides `memory` by what reading `file` takes: the program, the tables, and `own` bytes that the verb has besides. Half of
/// what is left is for pages of the file, which go when it is used up; the answer is the other half.
pub(crate) fn divide(file: &Chpm<MappedFile>, memory: Bytes, own: u64) -> Result<u64> {
    divide_among(1, file, memory, own)
}

/// The same for one of so many files, each of which has its share of `memory`.
pub(crate) fn divide_among(files: u64, file: &Chpm<MappedFile>, memory: Bytes, own: u64) -> Result<u64> {
    process::return_large_blocks();
    let tables = file.sections().filter(|(kind, _)| *kind != SectionKind::Pages);
    let tables: u64 = tables.map(|(_, range)| range.len() as u64).sum();
    let fixed = PROGRAM + tables + own;
    let least = files * (fixed + LEAST).next_multiple_of(1 << 20);
    ensure!(
        memory.0 >= least,
        "--memory {} is less than it takes to read '{}' so: give it {} or more",
        MemorySize(memory),
        file.get_ref().path().display(),
        MemorySize(Bytes(least))
    );
    let half = (memory.0 / files - fixed) / 2;
    file.get_ref().keep_resident(half);
    Ok(half)
}
