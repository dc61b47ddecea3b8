//! Cuts within a distance, by what is stored or, where it is asked for, by proof: then coarser ones do.

use crate::progress::Meter;
use crate::stop;
use crate::threads::ThreadArgs;
use anyhow::Result;
use chpm_extmem::{Cancel, MappedFile};
use chpm_format::Chpm;
use chpm_refine::{Cut, Request};
use chpm_verify::certify::{self, FOUND, Proven};

/// The cut of a request, and how far it is from the source if that was proven anew, on these threads. `rounding` and `bytes` are those of [`Request::cut`].
pub(crate) fn cut(
    file: &Chpm<MappedFile>,
    request: &Request,
    (rounding, bytes): (f64, u64),
    threads: Option<&ThreadArgs>,
    meter: &Meter,
    cancel: &Cancel,
) -> Result<(Cut, Option<f32>)> {
    if let (Some(threads), Some(distance)) = (threads, request.distance(file, rounding)) {
        let tiles = bytes.saturating_sub(FOUND * file.clusters().len() as u64);
        let coarsest = || certify::coarsest(file, distance, tiles, meter, cancel);
        if let Some(Proven { cut, distance }) = threads.pool()?.install(coarsest)? {
            return Ok((cut, Some(distance)));
        }
    }
    Ok((request.cut(file, rounding, bytes, || stop::check(cancel))?, None))
}
