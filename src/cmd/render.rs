//! `chpm render`: a picture of a file, without a window.

use super::Verdict;
use crate::output;
use crate::picture::{self, DeviceArgs, LookArgs};
use crate::report::count;
use crate::stop::{self, Stop};
use crate::view::{self, Viewport};
use anyhow::Result;
use chpm_format::Chpm;
use chpm_mesh::Bytes;
use chpm_refine::Camera;
use chpm_viewer::{Accuracy, FrameRequest, IdImage, Image, Stats, TriangleId, headless};
use serde_json::json;
use std::io::Write;
use std::path::PathBuf;

/// What `chpm render` is told.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file
    file: PathBuf,
    /// Where the picture is taken from, in the model's coordinates: position, target, and the vertical field of view in degrees (45 if
    /// not given); +y is upward. If not given, the whole model is looked at along the z axis, from its positive end
    #[arg(long, value_name = "PX,PY,PZ,TX,TY,TZ[,FOV]", value_parser = view::camera, allow_hyphen_values = true)]
    camera: Option<Camera>,
    /// Width and height of the image, in pixels
    #[arg(long, value_name = "WxH", default_value_t = Viewport([1024, 768]))]
    viewport: Viewport,
    /// Pixels of error that are allowed
    #[arg(long, value_name = "P", default_value = "1", value_parser = view::pixels)]
    poe: f64,
    /// The finest mesh that draws about N triangles at most
    #[arg(long, value_name = "N", conflicts_with = "poe")]
    triangles: Option<u64>,
    /// Draw and refine what is hidden, too; the picture is the same
    #[arg(long)]
    no_occlusion: bool,
    /// Instead of a picture, the item buffer: each triangle in a colour of its own that does not depend on light or camera, on black.
    /// Beyond 16 million triangles in the file, colours repeat
    #[arg(long, conflicts_with_all = ["color", "smooth", "wireframe", "one_sided", "background"])]
    ids: bool,
    #[command(flatten)]
    look: LookArgs,
    /// Main memory for the parts of the file that are in use, as in 256M
    #[arg(long, value_name = "SIZE", default_value = "1G")]
    memory: Bytes,
    #[command(flatten)]
    device: DeviceArgs,
    /// The PNG to write; - for standard output
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Replace the output if it exists
    #[arg(short, long)]
    force: bool,
    /// Write the counts and times as JSON
    #[arg(long)]
    json: bool,
}

/// Draws and writes.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let cancel = stop.heed();
    let png = output::RENDER.create(&args.output, args.force, &[&args.file])?;
    let mut out = output::messages([&png], args.json, false)?;
    let mut viewer = args.device.open(&args.file, args.memory)?;
    let camera = args.camera.unwrap_or_else(|| viewer.framing());
    let request = FrameRequest {
        accuracy: args.triangles.map_or(Accuracy::PoE(args.poe), Accuracy::Triangles),
        look: args.look.look(),
        occlusion_culling: !args.no_occlusion,
        wait: true,
        ..FrameRequest::new(camera, args.viewport.0)
    };
    let (image, stats) = if args.ids {
        let (ids, stats) = headless::ids(&mut viewer, &request)?;
        (item_buffer(&ids, viewer.file()), stats)
    } else {
        headless::image(&mut viewer, &request)?
    };
    stop::check(&cancel)?;
    picture::write_png(&image, png)?;
    let adapter = viewer.gpu().describe();
    if args.json {
        let image = json!({ "width": image.size[0], "height": image.size[1] });
        writeln!(
            out,
            "{:#}",
            json!({ "image": image, "adapter": adapter, "frame": picture::as_json(&stats) })
        )?;
    } else {
        print(args, &stats, &adapter, &mut out)?;
    }
    out.flush()?;
    Ok(Verdict::Good)
}

fn print(args: &Args, stats: &Stats, adapter: &str, out: &mut impl Write) -> Result<()> {
    writeln!(
        out,
        "{}: {} triangles at {:.3} pixels of error, from {} clusters; {} more lie outside the image, {} are hidden",
        args.output.display(),
        count(stats.triangles),
        stats.poe,
        count(stats.clusters_drawn),
        count(stats.frustum_culled),
        count(stats.occluded),
    )?;
    writeln!(
        out,
        "{:.0} ms on {adapter}; {} of pages, {} on the GPU",
        1e3 * stats.times.total.as_secs_f64(),
        Bytes(stats.resident_bytes),
        Bytes(stats.gpu_bytes),
    )?;
    Ok(())
}

/// A colour for every triangle: its number in the file, scattered so that neighbours differ.
fn item_buffer<D: AsRef<[u8]>>(ids: &IdImage, file: &Chpm<D>) -> Image {
    let mut before = 0_u64;
    let mut first = |count: u32| {
        before += u64::from(count);
        before - u64::from(count)
    };
    let firsts: Vec<u64> = file.clusters().iter().map(|cluster| first(cluster.triangle_count)).collect();
    let pixel = |id: &Option<TriangleId>| {
        let number = |id: &TriangleId| firsts[id.cluster.index()] + u64::from(id.triangle) + 1;
        let [red, green, blue] = scattered(id.as_ref().map_or(0, number));
        [red, green, blue, 255]
    };
    Image { size: ids.size, pixels: ids.pixels.iter().flat_map(pixel).collect() }
}

/// One to one from numbers below 2^24, zero to black: an odd factor has an inverse.
fn scattered(number: u64) -> [u8; 3] {
    let [red, green, blue, ..] = (number.wrapping_mul(0x9e37_79b1)).to_le_bytes();
    [red, green, blue]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn colours_of_triangles_differ() {
        let colors: BTreeSet<[u8; 3]> = (0..100_000).chain(16_700_000..(1 << 24)).map(scattered).collect();
        assert_eq!(colors.len(), 100_000 + (1 << 24) - 16_700_000);
        assert_eq!(scattered(0), [0; 3]);
    }
}
