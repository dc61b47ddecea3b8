//! `chpm render`: a picture of a file, without a window.

mod rays;

use super::{Verdict, build, check_unchanged, temporary};
use crate::batch::inputs;
use crate::escape::in_line;
use crate::json::{self, seen};
use crate::number::{self, Triangles, Units};
use crate::output::{self, Output};
use crate::picture::rays::RayArgs;
use crate::picture::sheet::{numbered, sheet};
use crate::picture::{self, DeviceArgs, LookArgs, StanceArgs, StillArgs};
use crate::progress::{Meter, line};
use crate::proximity::{PoseArgs, place};
use crate::report::count;
use crate::stop::{self, Stop};
use crate::view::{self, Viewport};
use anyhow::{Context, Result, bail, ensure};
use chpm_build::BuildConfig;
use chpm_extmem::WorkDir;
use chpm_format::Chpm;
use chpm_mesh::{Bytes, Counted, Scalar, viridis};
use chpm_refine::{Camera, Portrait, Side};
use chpm_viewer::{Accuracy, FrameRequest, IdImage, Image, Look, Stats, headless};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Arguments of `chpm render`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file; or a mesh ({meshes}), which is built into a temporary folder first and leaves
    /// nothing behind
    file: PathBuf,
    /// Another one, or the same, that is drawn with it, put somewhere by --pose
    second: Option<PathBuf>,
    #[command(flatten)]
    poses: PoseArgs,
    /// Where the picture is taken from, in the model's coordinates: position, target, and the vertical field of view in degrees (45 if
    /// not given); y is up unless --up says otherwise. If not given, all of the model is looked at from as near as possible
    #[arg(long, value_name = "PX,PY,PZ,TX,TY,TZ[,FOV]", value_parser = view::camera, allow_hyphen_values = true,
        conflicts_with = "side")]
    camera: Option<Camera>,
    #[command(flatten)]
    stance: StanceArgs,
    /// So many pictures from all around, each from further to the right: NAME-1.png and so on
    #[arg(long, value_name = "N", conflicts_with = "camera", value_parser = number::count(1..=360_u32))]
    turntable: Option<u32>,
    /// All pictures in one, each with its name: those of --turntable, or else the model from the front, the right, the back, the left, above and a corner
    #[arg(long, conflicts_with = "camera")]
    contact_sheet: bool,
    /// Width and height of the image, in pixels; of each one where there are several
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
    #[arg(long, conflicts_with_all = ["color", "shading", "smooth", "wireframe", "one_sided", "background"])]
    ids: bool,
    /// The key light throws shadows, by a map as in the window: within two pixels of their edges they may differ from those of --rays
    #[arg(long, conflicts_with_all = ["ids", "rays"], help_heading = "Looks")]
    shadows: bool,
    #[command(flatten)]
    look: LookArgs,
    /// Colour by a named scalar, such as quality, from its lowest value (dark blue) to its highest (yellow); what is no number is grey. Its name
    /// and range are written below, with a bar of the colours
    #[arg(long, value_name = "NAME", conflicts_with_all = ["color", "ids"])]
    color_by: Option<String>,
    #[command(flatten)]
    still: StillArgs,
    #[command(flatten)]
    rays: RayArgs,
    /// Main memory for the parts of the file that are in use, as in 256M; of two, half for each, and what one cannot use for the other
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
    /// Write the counts and times as JSON; where there are several pictures, of the first
    #[arg(long)]
    json: bool,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
}

/// The sides that a contact sheet shows, where no turntable is asked for.
const SHEET: [Side; 6] = [Side::Front, Side::Right, Side::Iso, Side::Back, Side::Left, Side::Top];

/// Draws and writes.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    args.poses.check(args.second.as_deref())?;
    if args.rays.rays {
        return rays::run(args, stop);
    }
    let light = match args.still.light[..] {
        [] => Look::LIGHT,
        [light] => light.0,
        _ => bail!("several lights: only --rays draws them; add it, or give --light once"),
    };
    let cancel = stop.heed();
    let pngs = outputs(args)?;
    let mut out = output::messages(&pngs, args.json, false)?;

    // What is drawn, from where, and how fine.
    // What draws is looked for before a mesh is built, which may take long.
    let gpu = sources(args).any(inputs::is_mesh).then(|| args.device.gpu()).transpose()?;
    let models = sources(args).map(|source| Ready::new(source, args, stop)).collect::<Result<Vec<_>>>()?;
    let places = args.poses.poses().map(|pose| place(&pose));
    let files: Vec<_> = models.iter().map(|model| model.file.as_path()).zip(places).collect();
    let gpu = gpu.map_or_else(|| args.device.gpu(), Ok)?;
    let mut viewer = args.device.open_colored(gpu, &files, args.memory, args.color_by.as_deref())?;
    let legend = legend(args, viewer.scalar(), viewer.files().flat_map(|file| file.scalars()))?;
    let Views { cameras, why, note } = views(args, || {
        // It names the file of two that it is about; a change meanwhile is the reason for whatever came of it.
        let portrait = viewer.portrait(args.stance.up, args.stance.side);
        viewer.files().try_for_each(|file| check_unchanged(file))?;
        Ok((portrait?, viewer.origin()))
    })?;
    let model = viewer.files().map(|file| file.header().source_triangle_count).sum();
    let wanted = args.triangles.map(|wanted| wanted.of(model));
    let look = Look {
        transparent: args.still.transparent,
        studio: args.still.studio,
        light,
        shadows: args.shadows,
        ..args.look.look_on(args.still.studio)
    };

    let (mut first, mut short) = (None, None);
    let mut gallery = Gallery::new(args, pngs, [note.clone(), legend]);
    for (place, camera) in cameras.iter().enumerate() {
        let request = FrameRequest {
            accuracy: wanted.map_or(Accuracy::PoE(args.poe), Accuracy::Triangles),
            look,
            occlusion_culling: !args.no_occlusion,
            wait: true,
            samples: args.still.samples,
            clip: args.still.clip,
            ..FrameRequest::new(*camera, args.viewport.0)
        };
        let told = || format!("cannot draw '{}' so", args.file.display());
        let (image, stats) = if args.ids {
            let (ids, stats) = headless::ids(&mut viewer, &request).with_context(told)?;
            (item_buffer(&ids, viewer.files()), stats)
        } else {
            headless::image(&mut viewer, &request).with_context(told)?
        };
        stop::check(&cancel)?;
        short = short.or_else(|| {
            let why = shortfall(args, model, wanted, &stats, &image)?;
            let of = cameras.len();
            Some(if of > 1 { format!("view {} of {of}: {why}", place + 1) } else { why })
        });
        first.get_or_insert(stats);
        gallery.add(place, image)?;
    }
    let (stats, shortfall): (Stats, Option<String>) = (first.unwrap_or_default(), short);
    let size = gallery.publish(look)?;

    let adapter = viewer.gpu().describe();
    if args.json {
        let render = seen::Render {
            schema: "chpm-render/1",
            image: seen::Size { width: size[0], height: size[1] },
            views: cameras.len(),
            adapter,
            camera: cameras.first().map(picture::camera_as_json),
            stance: why,
            frame: picture::as_json(&stats),
        };
        json::print(&render, &mut out)?;
    } else {
        print(args, &stats, &adapter, &mut out)?;
        print_views(cameras.len(), why, &mut out)?;
    }
    out.flush()?;
    Ok(judge(args, note, shortfall))
}

/// Says how many pictures there are, and why they are taken from there.
fn print_views(views: usize, why: Option<String>, out: &mut impl Write) -> Result<()> {
    if views > 1 {
        writeln!(out, "{} in all", Counted(views as u64, "view"))?;
    }
    if let Some(why) = why.filter(|why| !why.is_empty()) {
        writeln!(out, "{why} (--up and --view choose otherwise)")?;
    }
    Ok(())
}

/// Warns of what is not as it was asked for.
fn judge(args: &Args, note: Option<String>, shortfall: Option<String>) -> Verdict {
    if let Some(note) = &note {
        line(&format!(
            "warning: {note}; errors and distances mix both units: project such a model to metres before it is built"
        ));
    }
    if let Some(shortfall) = &shortfall {
        line(&format!("warning: {shortfall}"));
    }
    if shortfall.is_some() && args.strict { Verdict::Faulty } else { Verdict::Good }
}

/// Pictures on their way to their files.
struct Gallery<'a> {
    args: &'a Args,
    files: std::vec::IntoIter<Output>,
    /// Those that become one.
    drawn: Vec<Image>,
    written: Vec<Output>,
    note: Option<String>,
    legend: Option<String>,
}

impl<'a> Gallery<'a> {
    fn new(args: &'a Args, files: Vec<Output>, [note, legend]: [Option<String>; 2]) -> Self {
        Gallery { args, files: files.into_iter(), drawn: Vec::new(), written: Vec::new(), note, legend }
    }

    /// Takes the next one.
    fn add(&mut self, place: usize, mut image: Image) -> Result<()> {
        // Colours of an item buffer are numbers, and nothing may lie over them.
        let words = if self.args.ids {
            Vec::new()
        } else {
            let words = [label(self.args, place), self.note.clone(), self.legend.clone()];
            words.into_iter().flatten().collect()
        };
        if !words.is_empty() {
            image.caption(&words.join("; "));
        }
        if self.legend.is_some() {
            image.color_bar(viridis);
        }
        if self.args.contact_sheet {
            self.drawn.push(image);
        } else if let Some(png) = self.files.next() {
            self.written.push(picture::write_png(&image, png)?);
        }
        Ok(())
    }

    /// Lets all of them appear; answers the size of the first. After it, nothing may fail but telling of them.
    fn publish(mut self, look: Look) -> Result<[u32; 2]> {
        let mut size = self.args.viewport.0;
        if let (true, Some(png)) = (self.args.contact_sheet, self.files.next()) {
            let [red, green, blue] = look.background.map(|c| (255.0 * c).round() as u8);
            let black = if self.args.ids { [0, 0, 0, 255] } else { [red, green, blue, 255] };
            let sheet = sheet(&self.drawn, if look.transparent { [0; 4] } else { black });
            size = sheet.size;
            self.written.push(picture::write_png(&sheet, png)?);
        }
        for png in self.written {
            png.publish()?;
        }
        Ok(size)
    }
}

/// The models, as they were named.
fn sources(args: &Args) -> impl Iterator<Item = &Path> {
    [Some(args.file.as_path()), args.second.as_deref()].into_iter().flatten()
}

/// A model that can be opened. A mesh becomes a file that goes with its folder.
struct Ready {
    file: PathBuf,
    _folder: Option<WorkDir>,
}

impl Ready {
    fn new(source: &Path, args: &Args, stop: &Stop) -> Result<Self> {
        if !inputs::is_mesh(source) {
            return Ok(Ready { file: source.to_owned(), _folder: None });
        }
        let folder = temporary()?;
        let file = folder.path().join("model.chpm");
        let mut config = BuildConfig::default();
        config.settings.scalars.names.extend(args.color_by.clone());
        build::build(source, &file, &config, &Meter::new(args.quiet), stop)?;
        Ok(Ready { file, _folder: Some(folder) })
    }
}

/// Legend of colours that show a scalar, if it was found among those that are known.
fn legend<'a>(
    args: &Args,
    found: Option<&Scalar>,
    known: impl Iterator<Item = &'a Scalar>,
) -> Result<Option<String>> {
    let Some(name) = &args.color_by else { return Ok(None) };
    let Some(Scalar { name, range, .. }) = found else {
        let (file, known) = (args.file.display(), known.map(|scalar| in_line(&scalar.name)));
        let known: Vec<_> = known.collect();
        ensure!(!known.is_empty(), "--color-by: '{file}' has no scalars; build it with --keep {name}");
        bail!("--color-by: '{file}' has no scalar '{name}'; it has {}", known.join(", "))
    };
    Ok(Some(format!("{}: {} to {}", in_line(name), range.low, range.high)))
}

/// The files to write: one, or one for each view.
fn outputs(args: &Args) -> Result<Vec<Output>> {
    let apart = args.turntable.filter(|_| !args.contact_sheet).map_or(1, |count| count as usize);
    let inputs: Vec<&Path> = sources(args).collect();
    let create = |path: &Path| output::RENDER.create(path, args.force, &inputs);
    if apart == 1 {
        return Ok(vec![create(&args.output)?]);
    }
    ensure!(
        !output::is_stdout(&args.output),
        "several pictures cannot go to standard output: name a file, or ask for --contact-sheet"
    );
    (0..apart).map(|place| create(&numbered(&args.output, place, apart))).collect()
}

/// Where pictures are taken from; and why, where nobody told; and what they have to say of the model's heights.
struct Views {
    cameras: Vec<Camera>,
    why: Option<String>,
    note: Option<String>,
}

/// Cameras in the picture's coordinates. A portrait, and the origin of its own, are asked for where nobody told a camera.
fn views(args: &Args, portrait: impl FnOnce() -> Result<(Portrait, [f64; 3])>) -> Result<Views> {
    let rolled = |camera: Camera| camera.rolled(args.still.roll);
    if let Some(camera) = args.camera {
        let up = args.stance.up.map_or(camera.up, |up| up.vector().into());
        return Ok(Views { cameras: vec![rolled(Camera { up, ..camera })], why: None, note: None });
    }
    let [width, height] = args.viewport.0.map(f64::from);
    let aspect = width / height;
    let (portrait, origin) = portrait()?;
    let cameras = match (args.turntable, args.contact_sheet) {
        (Some(count), _) => portrait.turn(aspect, count),
        (None, true) => SHEET.map(|side| portrait.from_side(side).camera(aspect)).to_vec(),
        (None, false) => vec![portrait.camera(aspect)],
    };
    let placed = |camera: &Camera| rolled(camera.relative_to(origin.map(|x| -x)));
    let cameras = cameras.iter().map(placed).collect();
    Ok(Views { cameras, why: Some(portrait.why()), note: portrait.note() })
}

/// Caption of a picture on a contact sheet.
fn label(args: &Args, place: usize) -> Option<String> {
    args.contact_sheet
        .then(|| {
            args.turntable
                .map(|count| {
                    let degrees = (360.0 * place as f64 / f64::from(count) * 10.0).round() / 10.0;
                    format!("{degrees}\u{b0}")
                })
                .or_else(|| SHEET.get(place).map(|side| side.name().to_owned()))
        })
        .flatten()
}

/// Requests that the picture does not meet.
fn shortfall(args: &Args, model: u64, wanted: Option<u64>, stats: &Stats, image: &Image) -> Option<String> {
    let names: Vec<String> = sources(args).map(|source| format!("'{}'", source.display())).collect();
    let name = names.join(" and ");

    // Nothing but background.
    if args.still.transparent && image.pixels.chunks_exact(4).all(|pixel| pixel[3] == 0) {
        return Some(empty(&name, stats));
    }
    let behind = if args.ids { [0.0; 3] } else { args.look.look_on(args.still.studio).background };
    // A colour may be rounded on its way through the GPU.
    let is_behind =
        |pixel: &[u8]| pixel.iter().zip(behind).all(|(got, c)| (f32::from(*got) - 255.0 * c).abs() < 2.0);
    let is_bare = !args.still.transparent;
    if stats.triangles == 0 || is_bare && image.pixels.chunks_exact(4).all(is_behind) {
        return Some(empty(&name, stats));
    }

    // A number of triangles that the model does not have; else an error that it cannot keep.
    if let Some(asked) = wanted.filter(|asked| *asked > model) {
        let (model, asked) = (Counted(model, "triangle"), count(asked));
        return Some(format!("the finest mesh of {name} has {model}, fewer than {asked}"));
    }
    if wanted.is_none() && stats.poe > args.poe {
        let (got, asked) = (Units(stats.poe), Units(args.poe));
        return Some(format!(
            "the picture has up to {got} pixels of error, more than {asked}: {name} or --memory gives no less"
        ));
    }

    // The rest has only the mean of what is about each vertex.
    (stats.unpainted > 0).then(|| {
        let (lacking, all) = (count(stats.unpainted), Counted(stats.clusters_drawn, "cluster"));
        format!("{lacking} of {all} are drawn without their texture: --gpu-memory has no room, or {name} is damaged (chpm verify tells)")
    })
}

/// Why a picture shows nothing, as far as that is known.
fn empty(name: &str, stats: &Stats) -> String {
    if stats.triangles == 0 {
        return empty_view(name);
    }
    let drawn = Counted(stats.triangles, "triangle");
    format!(
        "the picture is empty: {drawn} of {name} drawn, no pixel covered: too small, seen from the edge, or coloured as the background"
    )
}

fn empty_view(name: &str) -> String {
    format!("the picture is empty: nothing of {name} is in view of the camera")
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

/// A colour for every triangle: its number in the files, scattered so that neighbours differ.
fn item_buffer<'a, D: AsRef<[u8]> + 'a>(
    ids: &IdImage,
    files: impl Iterator<Item = &'a Arc<Chpm<D>>>,
) -> Image {
    // Triangles are numbered through, cluster after cluster, and file after file.
    let (mut before, mut firsts) = (0_u64, Vec::<Vec<u64>>::new());
    for file in files {
        let of_clusters = file.clusters().iter().map(|cluster| {
            let first = before;
            before += u64::from(cluster.triangle_count);
            first
        });
        firsts.push(of_clusters.collect());
    }

    let pixels = ids.pixels.iter().flat_map(|id| {
        let number = id
            .as_ref()
            .map_or(0, |id| firsts[id.model as usize][id.cluster.index()] + u64::from(id.triangle) + 1);
        let [red, green, blue] = scattered(number);
        [red, green, blue, 255]
    });
    Image { size: ids.size, pixels: pixels.collect() }
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
