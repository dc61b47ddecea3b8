//! `chpm info`: what a file says about itself, without reading a page unless asked to.

use super::build::small;
use super::{Verdict, open, reading, stdout, word};
use crate::caches::{self, Drawn};
use crate::digest::{self, Sizes, boundary, error_kind, max_distance, normals_from};
use crate::escape::in_line;
use crate::json::file::{Corners, Counts, FileBytes, Info, InfoScalar, InfoSource, InfoVolume, VertexCache};
use crate::json::{self, named};
use crate::memory::{self, MemoryArgs};
use crate::progress::line;
use crate::report::{self, LevelRow, per_triangle};
use anyhow::Result;
use chpm_extmem::MappedFile;
use chpm_format::packed::PARTS;
use chpm_format::{Chpm, Metadata};
use chpm_mesh::{Bytes, ClusterId, Counted, Scalar};
use serde_json::{Map, Value};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Arguments of `chpm info`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file
    file: PathBuf,
    /// A row for each level: clusters, triangles, shared vertices, errors
    #[arg(long)]
    levels: bool,
    /// Collapses that were refused, by level and reason
    #[arg(long)]
    refusals: bool,
    /// What it was built from and how, warnings, and what was found in the source
    #[arg(long)]
    settings: bool,
    /// Read every page and tell how often a vertex cache misses for a triangle
    #[arg(long)]
    cache: bool,
    /// Read every page and tell what its bytes are for
    #[arg(long)]
    parts: bool,
    /// As JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// Prints the tables, or the JSON.
pub(crate) fn run(args: &Args) -> Result<Verdict> {
    let file = open(&args.file)?;
    memory::divide(&file, args.memory.memory(), 0)?;
    reading(&file, || show(&file, args))
}

fn show(file: &Chpm<MappedFile>, args: &Args) -> Result<Verdict> {
    // Nothing in it is needed for the rest.
    let metadata = file.metadata().inspect_err(|error| {
        line(&format!("warning: '{}' says nothing of where it comes from: {error}", args.file.display()));
    });
    let metadata = metadata.ok();
    let levels = report::levels_of(file);
    let sizes = Sizes::of(file);
    let drawn = args.cache.then(|| caches::draw(file)).transpose()?;
    let parts = args.parts.then(|| parts(file)).transpose()?;
    let mut out = stdout();
    if args.json {
        let mut info = info(&args.file, file, metadata.as_ref(), levels, &sizes);
        info.bytes.parts = parts.map(named_parts);
        info.vertex_cache = drawn.map(|[all, roots]| VertexCache {
            size: caches::SIZE,
            clusters: all.misses(),
            roots: roots.misses(),
        });
        json::print(&info, &mut out)?;
        out.flush()?;
        return Ok(Verdict::Good);
    }
    if !(args.levels || args.refusals || args.settings || args.parts || args.cache) {
        digest::print(&args.file, file, metadata.as_ref(), &levels, &mut out)?;
        let mut repairs = metadata.iter().flat_map(|metadata| &metadata.repairs).filter(|(_, n)| *n > 0);
        let warnings = metadata.as_ref().map_or(0, |metadata| metadata.warnings.len());
        if warnings > 0 || repairs.next().is_some() {
            let (warnings, repairs) = (Counted(warnings as u64, "warning"), repairs.count() + 1);
            writeln!(out, "\n{warnings}, {} of the source: --settings", Counted(repairs as u64, "finding"))?;
        }
        print_next(&args.file, &mut out)?;
    }
    if args.levels {
        writeln!(out, "{}", report::levels_table(&levels))?;
    }
    if args.refusals {
        match report::refusals_table(&levels) {
            Some(refusals) => writeln!(out, "{refusals}")?,
            None => writeln!(out, "no collapse was refused")?,
        }
    }
    if args.settings {
        metadata.as_ref().map_or(Ok(()), |metadata| print_provenance(metadata, &mut out))?;
    }
    parts.map_or(Ok(()), |parts| print_parts(file, &sizes, parts, &mut out))?;
    drawn.map_or(Ok(()), |drawn| print_caches(drawn, &mut out))?;
    out.flush()?;
    Ok(Verdict::Good)
}

/// Bytes of all pages by [`PARTS`]. Those of packed pages are found by packing them once more.
fn parts(file: &Chpm<MappedFile>) -> Result<[f64; PARTS.len()]> {
    let mut sums = [0; PARTS.len()];
    for id in (0..file.header().cluster_count).map(ClusterId) {
        let page = file.page(id)?;
        let sizes = file.page_sizes(id, &page)?;
        sums.iter_mut().zip(sizes).for_each(|(sum, bits)| *sum += bits);
    }
    Ok(sums.map(|bits| bits as f64 / 8.0))
}

fn print_parts<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    sizes: &Sizes,
    parts: [f64; PARTS.len()],
    out: &mut impl Write,
) -> io::Result<()> {
    let triangles = file.header().source_triangle_count.max(1) as f64;
    let tables = (sizes.tables - sizes.chunks) as f64;
    let rest = [("tables", tables), ("chunks", sizes.chunks as f64), ("padding", sizes.padding as f64)];
    let all = PARTS.into_iter().zip(parts).chain(rest);
    let told = all.map(|(part, bytes)| format!("{part} {:.3}", bytes / triangles));
    writeln!(out, "parts      {} bytes a source triangle", told.collect::<Vec<_>>().join(", "))
}

fn print_next(path: &Path, out: &mut impl Write) -> Result<()> {
    let triangles = small(path)?;
    let path = word(path);
    let mut next = Vec::new();
    if cfg!(feature = "viewer") {
        next.push((format!("chpm view {path}"), "look at it"));
    }
    next.push((format!("chpm stats {path}"), "where it is good, and where not"));
    next.push((format!("chpm extract {path} --triangles {triangles} -o small.ply"), "one mesh of it"));
    next.push((format!("chpm info {path} --levels --refusals --settings"), "all that it says of itself"));
    let width = next.iter().map(|(command, _)| command.len()).max().unwrap_or(0);
    writeln!(out, "\nnext:")?;
    for (command, does) in next {
        writeln!(out, "  {command:<width$}  {does}")?;
    }
    Ok(())
}

fn print_caches([all, roots]: [Drawn; 2], out: &mut impl Write) -> io::Result<()> {
    fn drawn_text(drawn: Drawn) -> String {
        drawn.acmr().map(|acmr| format!("{acmr:.3}")).join(", ")
    }
    writeln!(
        out,
        "cache      {} misses a triangle at the finest, middle and base positions; roots {} (first in, first out, {} vertices)",
        drawn_text(all),
        drawn_text(roots),
        caches::SIZE
    )
}

fn print_provenance(metadata: &Metadata, out: &mut impl Write) -> io::Result<()> {
    let source = &metadata.source;
    writeln!(
        out,
        "source     {}: {}, {}, {}, {}, xxh3 {:016x}",
        in_line(&source.name),
        Bytes(source.byte_len),
        in_line(&source.encoding),
        Counted(source.vertex_count, "vertex"),
        Counted(source.face_count, "face"),
        source.hash,
    )?;
    for comment in &source.comments {
        writeln!(out, "           {}", in_line(comment))?;
    }
    writeln!(out, "settings")?;
    for (name, value) in &metadata.settings {
        writeln!(out, "  {} {}", in_line(name), in_line(value))?;
    }
    for warning in &metadata.warnings {
        writeln!(out, "warning: {}", in_line(warning))?;
    }
    let repairs = report::repair_lines(&metadata.repairs);
    if !repairs.is_empty() {
        writeln!(out, "found in the source:\n{}", repairs.join("\n"))?;
    }
    Ok(())
}

/// A named scalar, for programs.
fn scalar(scalar: &Scalar) -> InfoScalar {
    let Scalar { name, kind, range } = scalar;
    InfoScalar {
        name: name.clone(),
        r#type: kind.to_string(),
        low: range.low,
        high: range.high,
        count: range.count,
    }
}

/// Bytes of pages by what they are for.
fn named_parts(parts: [f64; PARTS.len()]) -> Map<String, Value> {
    let names = PARTS.map(|part| part.replace(' ', "_"));
    names.into_iter().zip(parts.map(|bytes| Value::from(bytes.round() as u64))).collect()
}

/// All of it, for programs.
fn info(
    path: &Path,
    file: &Chpm<MappedFile>,
    metadata: Option<&Metadata>,
    levels: Vec<LevelRow>,
    sizes: &Sizes,
) -> Info {
    let h = file.header();
    Info {
        schema: "chpm-info/1",
        file: named(path),
        version: format!("{}.{}", h.version_major, h.version_minor),
        generator: metadata.map(|metadata| metadata.generator.clone()),
        triangles: h.source_triangle_count,
        vertices: h.source_vertex_count,
        normals: h.attributes().has_normals(),
        normals_from: normals_from(file, metadata),
        colors: h.attributes().colors,
        scalars: file.scalars().iter().map(scalar).collect(),
        origin: h.origin,
        r#box: Corners { min: h.aabb_min, max: h.aabb_max },
        max_error: h.max_error,
        max_distance: max_distance(file),
        remnants: file.remnants().len(),
        error_kind: error_kind(file),
        boundary: boundary(file),
        counts: Counts {
            clusters: h.cluster_count,
            leaves: h.leaf_count,
            roots: h.root_count,
            groups: h.group_count,
            levels: h.level_count,
            shared_vertices: h.shared_vertex_count,
        },
        levels,
        bytes: FileBytes {
            file: sizes.file,
            tables: sizes.tables,
            chunks: sizes.chunks,
            pages: sizes.pages,
            padding: sizes.padding,
            per_triangle: per_triangle(sizes.file, h.source_triangle_count),
            parts: None,
        },
        volumes: file.volumes().iter().map(volume).collect(),
        vertex_cache: None,
        source: metadata.map(source),
        settings: metadata.map(|metadata| report::object(metadata.settings.clone())),
        repairs: metadata.map(|metadata| report::object(metadata.repairs.clone())),
        warnings: metadata.map(|metadata| metadata.warnings.clone()),
    }
}

/// A file of pages, for programs.
fn volume(file: &MappedFile) -> InfoVolume {
    InfoVolume { file: named(file.path()), bytes: file.len() as u64 }
}

/// Facts of the source.
fn source(metadata: &Metadata) -> InfoSource {
    let source = &metadata.source;
    InfoSource {
        name: source.name.clone(),
        bytes: source.byte_len,
        xxh3: format!("{:016x}", source.hash),
        encoding: source.encoding.clone(),
        vertices: source.vertex_count,
        faces: source.face_count,
        comments: source.comments.clone(),
    }
}
