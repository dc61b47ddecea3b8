//! `chpm render`: a picture of a file, without a window.

use super::{Verdict, reading};
use crate::number::{Triangles, Units};
use crate::output;
use crate::picture::{self, DeviceArgs, LookArgs, StanceArgs};
use crate::progress::line;
use crate::report::count;
use crate::stop::{self, Stop};
use crate::view::{self, Viewport};
use anyhow::Result;
use chpm_format::Chpm;
use chpm_mesh::{Bytes, Counted};
use chpm_refine::{Camera, Stance};
use chpm_viewer::{Accuracy, FrameRequest, IdImage, Image, Stats, TriangleId, Viewer, headless};
use serde_json::json;
use std::io::Write;
use std::path::PathBuf;

/// What `chpm render` is told.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file
    file: PathBuf,
    /// Where the picture is taken from, in the model's coordinates: position, target, and the vertical field of view in degrees (45 if
    /// not given); y is up unless --up says otherwise. If not given, all of the model is looked at from as near as possible
    #[arg(long, value_name = "PX,PY,PZ,TX,TY,TZ[,FOV]", value_parser = view::camera, allow_hyphen_values = true,
        conflicts_with = "side")]
    camera: Option<Camera>,
    #[command(flatten)]
    stance: StanceArgs,
    /// Width and height of the image, in pixels
    #[arg(long, value_name = "WxH", default_value_t = Viewport([1024, 768]))]
    viewport: Viewport,
    /// Pixels of error that are allowed
    #[arg(long, value_name = "P", default_value = "1", value_parser = view::pixels)]
    poe: f64,
    /// The finest mesh that draws about N triangles at most, as in 20k, or a share of the model's, as in 1%
    #[arg(long, value_name = "N", conflicts_with = "poe")]
    triangles: Option<Triangles>,
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
    /// Exit with 1 where the picture is empty or coarser than was asked for; it is a warning if not given
    #[arg(long)]
    strict: bool,
    /// Write the counts and times as JSON
    #[arg(long)]
    json: bool,
}

/// Draws and writes.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let cancel = stop.heed();
    let png = output::RENDER.create(&args.output, args.force, &[&args.file])?;
    let mut out = output::messages([&png], args.json, false)?;

    // What is drawn, from where, and how fine.
    let mut viewer = args.device.open(&args.file, args.memory)?;
    let (camera, why) = camera(args, &viewer)?;
    let model = viewer.file().header().source_triangle_count;
    let wanted = args.triangles.map(|wanted| wanted.of(model));
    let request = FrameRequest {
        accuracy: wanted.map_or(Accuracy::PoE(args.poe), Accuracy::Triangles),
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

    // After the picture is published, nothing may fail but telling of it.
    let shortfall = shortfall(args, model, wanted, &stats, &image);
    stop::check(&cancel)?;
    picture::write_png(&image, png)?;

    let adapter = viewer.gpu().describe();
    if args.json {
        let image = json!({ "width": image.size[0], "height": image.size[1] });
        writeln!(
            out,
            "{:#}",
            json!({
                "schema": "chpm-render/1",
                "image": image,
                "adapter": adapter,
                "camera": picture::camera_as_json(&camera),
                "stance": why,
                "frame": picture::as_json(&stats),
            })
        )?;
    } else {
        print(args, &stats, &adapter, &mut out)?;
        if let Some(why) = why.filter(|why| !why.is_empty()) {
            writeln!(out, "{why} (--up and --view choose otherwise)")?;
        }
    }
    out.flush()?;
    if let Some(shortfall) = &shortfall {
        line(&format!("warning: {shortfall}"));
    }
    Ok(if shortfall.is_some() && args.strict { Verdict::Faulty } else { Verdict::Good })
}

/// Where the picture is taken from; and why, where nobody told.
fn camera(args: &Args, viewer: &Viewer) -> Result<(Camera, Option<String>)> {
    if let Some(camera) = args.camera {
        let up = args.stance.up.map_or(camera.up, |up| up.vector().into());
        return Ok((Camera { up, ..camera }, None));
    }
    let outline = reading(viewer.file(), || Ok(viewer.outline()?))?;
    let stance = Stance::of(&outline, args.stance.up, args.stance.side);
    let camera = viewer.fit(&outline, &stance, args.viewport.0);
    Ok((camera, Some(stance.why().to_owned())))
}

/// What was asked for and is not in the picture.
fn shortfall(args: &Args, model: u64, wanted: Option<u64>, stats: &Stats, image: &Image) -> Option<String> {
    let name = args.file.display();

    // Nothing but background.
    let behind = if args.ids { [0.0; 3] } else { args.look.look().background };
    // A colour may be rounded on its way through the GPU.
    let is_behind =
        |pixel: &[u8]| pixel.iter().zip(behind).all(|(got, c)| (f32::from(*got) - 255.0 * c).abs() < 2.0);
    if stats.triangles == 0 || image.pixels.chunks_exact(4).all(is_behind) {
        return Some(format!("the picture is empty: nothing of '{name}' is in view of the camera"));
    }

    // A number of triangles that the model does not have; else an error that it cannot keep.
    if let Some(asked) = wanted.filter(|asked| *asked > model) {
        let (model, asked) = (Counted(model, "triangle"), count(asked));
        return Some(format!("the finest mesh of '{name}' has {model}, fewer than {asked}"));
    }
    let is_coarse = wanted.is_none() && stats.poe > args.poe;
    is_coarse.then(|| {
        let (got, asked) = (Units(stats.poe), Units(args.poe));
        format!("the picture has up to {got} pixels of error, more than {asked}: '{name}' or --memory gives no less")
    })
}

fn print(args: &Args, stats: &Stats, adapter: &str, out: &mut impl Write) -> Result<()> {
    writeln!(
        out,
        "{}: {} at {:.3} pixels of error, from {}; outside the image: {}, hidden: {}",
        args.output.display(),
        Counted(stats.triangles, "triangle"),
        stats.poe,
        Counted(stats.clusters_drawn, "cluster"),
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
    // Triangles are numbered through, cluster after cluster.
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
