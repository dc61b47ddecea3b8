//! What the examples that measure have in common.

use std::error::Error;
use std::fs;

/// Triangles to unpack at least.
pub(crate) const TRIANGLES: u64 = 40_000_000;

/// Seconds of the processor that this process has used, outside of the system, in steps of a hundredth.
pub(crate) fn user_time() -> Result<f64, Box<dyn Error>> {
    let stat = fs::read_to_string("/proc/self/stat")?;
    let behind_name = stat.rsplit(") ").next().unwrap_or_default();
    Ok(behind_name.split(' ').nth(11).unwrap_or_default().parse::<f64>()? / 100.0)
}

/// The file that is named, in words, so that it can be read in place; its name and its length in bytes.
pub(crate) fn named() -> Result<(String, Vec<u64>, usize), Box<dyn Error>> {
    let name = std::env::args().nth(1).ok_or("name a .chpm file")?;
    let bytes = fs::read(&name)?;
    let mut words = vec![0u64; bytes.len().div_ceil(8)];
    bytemuck::cast_slice_mut(&mut words)[..bytes.len()].copy_from_slice(&bytes);
    Ok((name, words, bytes.len()))
}
