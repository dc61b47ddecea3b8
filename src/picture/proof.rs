//! The item-buffer test on a camera path: with every triangle in a colour of its own, culling must change no pixel.

use super::DeviceArgs;
use super::walk::Walk;
use crate::cmd::Verdict;
use crate::json::{self, seen};
use crate::progress::Meter;
use crate::report::count;
use crate::stop;
use anyhow::{Context, Result};
use chpm_build::Cancel;
use chpm_mesh::{Bytes, Counted};
use chpm_refine::Camera;
use chpm_viewer::{Accuracy, FrameRequest, IdImage, Viewer, headless};
use std::io::Write;

/// The two that are compared: each goes along the whole path, so that what is known of visibility is as old as it would be in a window.
struct Pair {
    culled: Viewer,
    complete: Viewer,
}

/// Comparisons, and parts that were left out meanwhile.
#[derive(Default)]
struct Proof {
    pixels: u64,
    different: u64,
    /// The first frame with a difference.
    first: Option<usize>,
    hidden: u64,
    outside: u64,
}

/// Draws every frame with culling, following the path, and without; compares what is seen.
pub(crate) fn run(
    walk: &Walk<'_>,
    device: &DeviceArgs,
    cancel: &Cancel,
    out: &mut impl Write,
) -> Result<Verdict> {
    let memory = walk.memory.unwrap_or(Bytes::mib(1024));
    let open = || device.open(walk.file, memory);
    let mut pair = Pair { culled: open()?, complete: open()? };
    let adapter = pair.culled.gpu().describe();

    let meter = Meter::new(walk.quiet);
    meter.start("walk", walk.path.cameras.len() as u64);
    let mut proof = Proof::default();
    for (index, camera) in walk.path.cameras.iter().enumerate() {
        stop::check(cancel)?;
        let compared = frame(walk, camera, &mut pair, &mut proof);
        let different = compared.with_context(|| format!("frame {index}"))?;
        if different > 0 {
            proof.first.get_or_insert(index);
        }
        proof.different += different;
        meter.add(1);
    }
    meter.finish();

    report(walk, &proof, &adapter, out)?;
    Ok(if proof.different == 0 { Verdict::Good } else { Verdict::Faulty })
}

/// The pixels of one frame that differ.
fn frame(walk: &Walk<'_>, camera: &Camera, pair: &mut Pair, proof: &mut Proof) -> Result<u64> {
    let request = FrameRequest {
        accuracy: Accuracy::PoE(walk.poe),
        wait: true,
        ..FrameRequest::new(*camera, walk.viewport)
    };
    let (got, stats) = headless::ids(&mut pair.culled, &request)?;
    let (expected, _) = headless::ids(&mut pair.complete, &request.without_culling())?;
    proof.pixels += got.pixels.len() as u64;
    proof.hidden += stats.occluded;
    proof.outside += stats.frustum_culled;
    Ok(different(&got, &expected))
}

fn different(a: &IdImage, b: &IdImage) -> u64 {
    a.pixels.iter().zip(&b.pixels).filter(|(a, b)| a != b).count() as u64
}

fn report(walk: &Walk<'_>, proof: &Proof, adapter: &str, out: &mut impl Write) -> Result<()> {
    let frames = walk.path.cameras.len() as u64;
    if walk.json {
        let proof = seen::WalkProve {
            schema: "chpm-walk-prove/1",
            frames,
            pixels: proof.pixels,
            different: proof.different,
            first_different_frame: proof.first,
            occluded: proof.hidden,
            frustum_culled: proof.outside,
            adapter: adapter.to_owned(),
        };
        return json::print(&proof, out);
    }

    writeln!(
        out,
        "{} of {}x{} on {adapter}: {} of {} pixels show another triangle with culling",
        Counted(frames, "frame"),
        walk.viewport[0],
        walk.viewport[1],
        count(proof.different),
        count(proof.pixels),
    )?;
    writeln!(
        out,
        "left out: {}, {} outside the image, over all frames",
        Counted(proof.hidden, "hidden cluster"),
        count(proof.outside)
    )?;
    if let Some(first) = proof.first {
        writeln!(out, "first in frame {first}")?;
    }
    Ok(())
}
