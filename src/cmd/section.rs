//! `chpm section`: the lines that planes cut out of a model.

use super::{Verdict, check_unchanged, open, reading};
use crate::crs::{Crs, CrsArgs};
use crate::georeference::{At, Georeference, Placed};
use crate::json::{self, made, named};
use crate::memory::{self, MemoryArgs};
use crate::number::{AtMost, Units};
use crate::output::{self, Output, Promise, Writes};
use crate::progress::{Meter, line};
use crate::report::{count, table};
use crate::section::{Axis, Drawing, Every, PlaneArg, Ratio, Sheet};
use crate::stop::Stop;
use crate::threads::ThreadArgs;
use crate::tolerance::{Tolerance, Unit};
use anyhow::{Result, bail, ensure};
use chpm_build::Cancel;
use chpm_build::config::Length;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::{Bytes, Counted, Level};
use chpm_refine::{Cut, Request};
use chpm_section::{Pages, Planes, Section, Slicer};
use rayon::ThreadPool;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Arguments of `chpm section`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file
    file: PathBuf,
    #[command(flatten)]
    cut: CutArgs,
    /// Cut a coarse mesh, as extract --error E selects it, for a first look: its points are within E of the source, but nothing bounds how far the source's own
    /// lines are from these
    #[arg(long, value_name = "E")]
    preview: Option<Length>,
    /// Unit of the model
    #[arg(long, value_name = "UNIT", value_enum)]
    unit: Option<Unit>,
    /// Write the lines. The name says the format: .svg, to scale, with a scale bar and heights; .dxf, release 12, a layer for each height; .geojson, with --crs or --origin;
    /// .csv, a row for each point. SVG where it says nothing; - for standard output
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Scale of an SVG; if not given the largest round one that fits a sheet of A4
    #[arg(long, value_name = "1:N", requires = "unit")]
    scale: Option<Ratio>,
    /// Where on the earth the model's zero point is, or what --origin-at names: degrees of longitude and latitude, and metres above the ellipsoid. Then x points east, y
    /// north and z up, and a unit has to be a metre
    #[arg(long, value_name = "LON,LAT,H", allow_hyphen_values = true)]
    origin: Option<Georeference>,
    /// Which point of the model is at --origin
    #[arg(long, value_name = "WHERE", value_enum, default_value_t = At::Zero, requires = "origin")]
    origin_at: At,
    #[command(flatten)]
    crs: CrsArgs,
    /// Replace the output if it exists
    #[arg(short, long)]
    force: bool,
    #[command(flatten)]
    threads: ThreadArgs,
    /// The numbers as JSON on stdout
    #[arg(long)]
    json: bool,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// By what is cut; one of these.
#[derive(clap::Args, Debug)]
struct CutArgs {
    /// A plane: its normal, and its distance from the zero point along it, in the model's units or, as in 2.5m, with --unit
    #[arg(long, value_name = "X,Y,Z:D", allow_hyphen_values = true, required_unless_present = "every")]
    plane: Option<PlaneArg>,
    /// A plane at every multiple of this along --axis: contours. In the model's units or, as in 1m, with --unit
    #[arg(long, value_name = "STEP", conflicts_with = "plane")]
    every: Option<Tolerance>,
    /// The axis that --every goes along
    #[arg(long, value_name = "AXIS", value_enum, default_value_t = Axis::Z, requires = "every")]
    axis: Axis,
}

/// Memory of a thread for a page, its triangles and the segments of one batch of planes, at most.
const WORK: u64 = 24 << 20;

/// Feet are of two lengths, which differ by less.
const SAME_UNIT: f64 = 1e-5;

/// Cuts, and writes what is asked for.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let file = open(&args.file)?;
    let target = args.output.as_deref().map(|path| Target::create(path, args, &file)).transpose()?;
    let out = output::messages(target.as_ref().map(|target| &target.output), args.json, args.quiet)?;
    let cancel = stop.heed();
    let (pool, free) = memory::workers(&args.threads, &file, args.memory.memory(), 0, WORK)?;
    let work = Work { args, file: &file, pool: &pool, free, cancel: &cancel };
    reading(&file, || work.cut(target, out))?;
    Ok(Verdict::Good)
}

/// The file that is written.
struct Target {
    format: &'static str,
    output: Output,
}

impl Target {
    fn create(path: &Path, args: &Args, file: &Chpm<MappedFile>) -> Result<Self> {
        let [svg, ..] = output::SECTION;
        let known = |format: &str| output::SECTION.into_iter().find(|writes| writes.format() == format);
        let writes: Option<Writes> = match output::promised(path) {
            Promise::Nothing => Some(svg),
            Promise::Format(format) => known(format),
            Promise::Unknown => None,
        };
        let Some(writes) = writes else {
            bail!(
                "section writes SVG, DXF, GeoJSON and CSV, and {}: choose another, or leave the extension out",
                output::otherwise(path)
            )
        };
        let format = writes.format();
        let crs = args.crs.of(file, false)?;
        if format == "GeoJSON" {
            ensure!(
                args.origin.is_some() || crs.is_some(),
                "GeoJSON is in longitude and latitude (WGS 84), and a mesh does not say where on the earth it is: add --crs EPSG:CODE or --origin LON,LAT,H, or \
                 write SVG, DXF or CSV, which are in the model's coordinates"
            );
            let metres = crs.as_ref().filter(|_| args.origin.is_none()).map_or(1.0, Crs::metres);
            ensure!(
                args.unit.is_none_or(|unit| (unit.metres() / metres - 1.0).abs() < SAME_UNIT),
                "--unit is another than that of the coordinates that --crs or --origin says the model has, {metres} m: leave it out, or scale the model"
            );
        } else {
            ensure!(
                args.origin.is_none() && !args.crs.is_typed(),
                "--origin and --crs are for GeoJSON, and {format} is in the model's coordinates: leave them out"
            );
        }
        ensure!(
            args.scale.is_none() || format == "SVG",
            "--scale is that of an SVG, and {format} has none: leave it out"
        );
        Ok(Target { format, output: writes.create(path, args.force, &[&args.file])? })
    }
}

struct Work<'w> {
    args: &'w Args,
    file: &'w Chpm<MappedFile>,
    pool: &'w ThreadPool,
    /// Bytes for lines.
    free: u64,
    cancel: &'w Cancel,
}

impl Work<'_> {
    fn cut(&self, target: Option<Target>, mut out: Box<dyn Write + '_>) -> Result<()> {
        let Work { args, file, cancel, .. } = *self;
        let header = file.header();
        let every = self.every()?;
        let planes = match (args.cut.plane, every) {
            (_, Some(every)) => every.planes(&header.aabb(), header.origin)?,
            (Some(plane), _) => plane.planes(args.unit)?,
            _ => bail!("neither --plane nor --every"),
        };
        let meter = Meter::new(args.quiet);
        let (mesh, preview, mut warnings) = self.mesh(&meter)?;
        let mut slicer = Slicer::new(file, &mesh, &planes);
        let mut sheet = self.sheet(&slicer, &planes, every);
        if target.as_ref().is_some_and(|target| target.format == "GeoJSON") {
            sheet.placed = self.placed()?;
        }
        warnings.extend(sheet.placed.iter().filter_map(|placed| placed.warning.clone()));

        meter.start("section", slicer.pages().read);
        let mut drawing = None;
        let mut told = Vec::new();
        let mut target = target;
        if let Some(Target { format, output }) = &mut target {
            drawing = Some(Drawing::begin(format, &sheet, output)?);
        }
        let go_on = || {
            meter.add(1);
            !cancel.is_cancelled()
        };
        loop {
            let sections = self.pool.install(|| slicer.next_sections(Bytes(self.free), go_on))?;
            if sections.is_empty() {
                break;
            }
            for section in sections {
                if let (Some(drawing), Some(target)) = (&mut drawing, &mut target) {
                    drawing.add(&sheet, &section, &mut target.output)?;
                }
                told.push(summary(&section));
            }
        }
        meter.finish();
        if told.iter().all(|section| section.lines == 0) {
            warnings.push("no plane cuts the model: there are no lines".to_owned());
        }

        let of = told
            .iter()
            .filter(|section| section.crossing > 0)
            .map(|section| (sheet.height(section.offset), section.crossing));
        warnings.extend(crossed(of));

        // Before the file gets its name: what was read has to be what was opened.
        check_unchanged(file)?;
        let format = target.as_ref().map(|target| target.format);
        if let (Some(drawing), Some(mut target)) = (drawing, target) {
            drawing.end(&sheet, &mut target.output)?;
            target.output.publish()?;
        }
        let pages = slicer.pages();
        let document = made::Section {
            schema: "chpm-section/1",
            file: named(&args.file),
            output: args.output.as_deref().map(named),
            format,
            normal: planes.normal(),
            preview,
            scale: (format == Some("SVG")).then(|| sheet.scale.describe()),
            pages: pages.read,
            page_bytes: pages.bytes,
            pages_crossed: pages.crossed,
            open_ends: told.iter().map(|section| section.open_ends).sum(),
            sections: told,
            warnings,
        };
        if args.json {
            json::print(&document, &mut out)?;
        } else {
            print(&document, &sheet, pages, &mut out)?;
        }
        out.flush()?;
        document.warnings.iter().for_each(|warning| line(&format!("warning: {warning}")));
        Ok(())
    }

    fn every(&self) -> Result<Option<Every>> {
        let CutArgs { every, axis, .. } = &self.args.cut;
        let Some(step) = every else { return Ok(None) };
        let step = step.length(self.args.unit)?.of(self.file.header().aabb().diagonal());
        Ok(Some(Every { axis: *axis, step }))
    }

    /// The mesh that is cut; for a preview, how far it is from the source, and what the file has less of.
    fn mesh(&self, meter: &Meter) -> Result<(Cut, Option<f64>, Vec<String>)> {
        let Work { args, file, free, cancel, .. } = *self;
        let Some(error) = args.preview else { return Ok((Cut::at_level(file, Level(0)), None, Vec::new())) };
        meter.start("select", u64::from(file.header().cluster_count));
        let request = Request::Within(error);
        let cut = request.cut(file, 0.0, free, || {
            meter.add(1);
            crate::stop::check(cancel)
        })?;
        meter.finish();
        let distance = cut.distance(file)?;
        let shortfall = request.shortfall(file, &cut, distance);
        let less = shortfall.map(|less| less.describe(args.file.display(), file.header().aabb().diagonal()));
        Ok((cut, Some(f64::from(distance)), less.into_iter().collect()))
    }

    fn sheet(&self, slicer: &Slicer<'_, MappedFile>, planes: &Planes, every: Option<Every>) -> Sheet {
        let args = self.args;
        let note = if args.preview.is_some() { "; preview, not exact" } else { "" };
        Sheet::new(&args.file, slicer, planes, every, (args.unit, args.scale), note)
    }

    /// Where on the earth the model is.
    fn placed(&self) -> Result<Option<Placed>> {
        let Work { args, file, .. } = *self;
        let (header, aabb) = (file.header(), file.header().aabb());
        let corners = [aabb.min, aabb.max]
            .map(|corner| std::array::from_fn(|axis| f64::from(corner[axis]) + header.origin[axis]));
        if let Some(origin) = args.origin {
            return Ok(Some(origin.place(args.origin_at, corners)));
        }
        let crs = args.crs.of(file, false)?;
        Ok(crs.map(|crs| crs.place(corners)).transpose()?.map(|(placed, _)| placed))
    }
}

fn summary(section: &Section) -> made::PlaneSection {
    made::PlaneSection {
        offset: section.offset,
        lines: section.lines.len() as u64,
        closed: section.lines.iter().filter(|line| line.is_closed).count() as u64,
        open_ends: section.open_ends(),
        points: section.points(),
        length: section.length(),
        area: section.area(),
        crossing: section.crossing(),
    }
}

/// Words about planes whose closed lines cross each other: where, and how many.
fn crossed(planes: impl Iterator<Item = (String, u64)>) -> Option<String> {
    /// Places that are named.
    const NAMED: usize = 5;
    let (places, counts): (Vec<String>, Vec<u64>) = planes.unzip();
    let named = places.get(..NAMED).unwrap_or(&places);
    let more = match places.len() - named.len() {
        _ if named.is_empty() => return None,
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let at = named.join(", ");
    Some(format!(
        "{} closed lines cross others at {at}{more}: the area there is not told; solids overlap",
        count(counts.iter().sum())
    ))
}

fn print(told: &made::Section, sheet: &Sheet, pages: Pages, out: &mut impl Write) -> Result<()> {
    let row = |section: &made::PlaneSection| {
        let made::PlaneSection { offset, lines, closed, open_ends, length, area, .. } = section;
        let area = area.map_or("-".to_owned(), |area| Units(area).to_string());
        let length = Units(*length).to_string();
        vec![sheet.height(*offset), count(*lines), count(*closed), count(*open_ends), length, area]
    };
    let header = ["at", "lines", "closed", "open ends", "length", "area"];
    writeln!(out, "{}", table(&header, told.sections.iter().map(row)))?;
    let Pages { read, bytes, crossed } = pages;
    writeln!(out, "{} read, {}; {} crossed", Counted(read, "page"), Bytes(bytes), count(crossed))?;
    if told.open_ends > 0 {
        writeln!(
            out,
            "{} ends are open: the surface has a boundary there, or its triangles share no vertices",
            count(told.open_ends)
        )?;
    }
    if let Some(distance) = told.preview {
        writeln!(
            out,
            "a preview: the mesh that was cut is within {} units of the source, but nothing bounds how far the source's own lines are from these",
            AtMost(distance)
        )?;
    }
    if let (Some(output), Some(format)) = (&told.output, told.format) {
        let scale = told.scale.as_ref().map_or(String::new(), |scale| format!(", {scale}"));
        writeln!(out, "{output}: {format}{scale}")?;
    }
    Ok(())
}
