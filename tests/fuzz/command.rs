//! The command as a process: how it ends, what it leaves, and the memory that it took.

use crate::judge::Failure;
use crate::settings::MEMORY;
use nix::sys::resource::{UsageWho, getrusage};
use std::path::Path;
use std::process::Command;

/// Runs `chpm` in a folder; it must end with one of the codes, say no word of a panic, and stay within its memory.
pub(crate) fn chpm(folder: &Path, words: &[&str], codes: &[i32]) -> Result<i32, Failure> {
    let before = largest(UsageWho::RUSAGE_CHILDREN);
    let output = Command::new(env!("CARGO_BIN_EXE_chpm"))
        .current_dir(folder)
        .args(words)
        .output()
        .map_err(|error| Failure::new("spawn", error.to_string()))?;
    let (told, line) = (String::from_utf8_lossy(&output.stderr), format!("chpm {}", words.join(" ")));
    let said = String::from_utf8_lossy(&output.stdout);
    let Some(code) = output.status.code() else {
        return Err(Failure::new("signal", format!("{line}: {}: {told}", output.status)));
    };
    if told.contains("panicked") {
        return Err(Failure::new("panic", format!("{line}: {told}")));
    }
    if !codes.contains(&code) {
        return Err(Failure::new(
            "exit code",
            format!("{line}: {codes:?} expected, got {code}: {said}{told}"),
        ));
    }
    // The largest of all children so far: only one that is larger than those before it can be told. A child begins as large as the
    // process that starts it, which is small.
    let after = largest(UsageWho::RUSAGE_CHILDREN);
    if after > before && after > MEMORY && largest(UsageWho::RUSAGE_SELF) < MEMORY {
        return Err(Failure::new("memory", format!("{line}: {} MiB were resident", after >> 20)));
    }
    Ok(code)
}

/// What `chpm` writes to its output.
pub(crate) fn said(folder: &Path, words: &[String]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_chpm")).current_dir(folder).args(words).output();
    output
        .map_or_else(|error| error.to_string(), |output| String::from_utf8_lossy(&output.stdout).into_owned())
}

/// Most bytes that were resident.
fn largest(of: UsageWho) -> u64 {
    getrusage(of).map_or(0, |usage| u64::try_from(usage.max_rss()).unwrap_or(0) << 10)
}

/// Names in a folder, hidden ones too.
pub(crate) fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder").flatten();
    let mut names: Vec<_> = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}
