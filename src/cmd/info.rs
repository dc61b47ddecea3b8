//! `chpm info`: what a file says about itself, without reading a page unless asked to.

use super::{Verdict, open, reading, stdout};
use crate::caches::{self, Drawn};
use crate::memory::{self, MemoryArgs};
use crate::number::Units;
use crate::progress::line;
use crate::report::{self, LevelRow, count, per_triangle};
use anyhow::Result;
use chpm_extmem::MappedFile;
use chpm_format::packed::{self, PARTS};
use chpm_format::{Chpm, Metadata, SectionKind};
use chpm_mesh::{Bytes, ClusterId, Counted, GroupId};
use serde_json::{Value, json};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// What `chpm info` is told.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file
    file: PathBuf,
    /// Also read every page and tell how often a vertex cache misses for a triangle
    #[arg(long)]
    cache: bool,
    /// Also read every page and tell what its bytes are for
    #[arg(long)]
    parts: bool,
    /// As JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// Where the bytes of a file are.
struct Sizes {
    file: u64,
    tables: u64,
    pages: u64,
    padding: u64,
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
        let mut value = as_json(&args.file, file, metadata.as_ref(), &levels, &sizes);
        if let Some(parts) = parts {
            let name = |part: &str| part.replace(' ', "_");
            let bytes = parts.map(|bytes| bytes.round() as u64);
            value["bytes"]["parts"] = PARTS.map(name).into_iter().zip(bytes).collect();
        }
        if let Some([all, roots]) = drawn {
            value["vertex_cache"] =
                json!({ "size": caches::SIZE, "clusters": all.as_json(), "roots": roots.as_json() });
        }
        writeln!(out, "{value:#}")?;
    } else {
        print_model(&args.file, file, metadata.as_ref(), &mut out)?;
        print_tables(&levels, &mut out)?;
        print_sizes(file, &sizes, &mut out)?;
        parts.map_or(Ok(()), |parts| print_parts(file, &sizes, parts, &mut out))?;
        drawn.map_or(Ok(()), |drawn| print_caches(drawn, &mut out))?;
        metadata.as_ref().map_or(Ok(()), |metadata| print_provenance(metadata, &mut out))?;
    }
    out.flush()?;
    Ok(Verdict::Good)
}

impl Sizes {
    fn of<D: AsRef<[u8]>>(file: &Chpm<D>) -> Self {
        let pages: u64 = file.clusters().iter().map(|cluster| u64::from(cluster.page_len)).sum();
        let section = file.sections().find(|(kind, _)| *kind == SectionKind::Pages);
        let padded = section.map_or(pages, |(_, range)| range.len() as u64);
        let whole = file.header().file_len;
        Sizes { file: whole, tables: whole - padded, pages, padding: padded - pages }
    }
}

fn print_model<D: AsRef<[u8]>>(
    path: &Path,
    file: &Chpm<D>,
    metadata: Option<&Metadata>,
    out: &mut impl Write,
) -> io::Result<()> {
    let h = file.header();
    let attributes = match (h.attributes().normals, h.attributes().colors) {
        (false, false) => "positions only",
        (true, false) => "with normals",
        (false, true) => "with colours",
        (true, true) => "with normals and colours",
    };
    writeln!(
        out,
        "{}: CHPM {}.{}, by {}",
        path.display(),
        h.version_major,
        h.version_minor,
        metadata.map_or("unknown", |metadata| &metadata.generator)
    )?;
    let (vertices, triangles) =
        (Counted(h.source_vertex_count, "vertex"), Counted(h.source_triangle_count, "triangle"));
    writeln!(out, "model      {triangles}, {vertices}, {attributes}")?;
    writeln!(out, "box        {:?} to {:?}, origin {:?}", h.aabb_min, h.aabb_max, h.origin)?;
    writeln!(
        out,
        "hierarchy  {} ({}, {} at the top) in {}, {}, {}",
        Counted(h.cluster_count.into(), "cluster"),
        Counted(h.leaf_count.into(), "leaf"),
        count(h.root_count.into()),
        Counted(h.level_count.into(), "level"),
        Counted(h.group_count.into(), "group"),
        Counted(h.shared_vertex_count.into(), "shared vertex"),
    )?;
    writeln!(
        out,
        "error      up to {} units ({}); distance {}; boundary {}",
        Units(h.max_error.into()),
        error_kind(file),
        max_distance(file)
            .map_or("unknown".to_owned(), |distance| format!("up to {} units", Units(distance.into()))),
        boundary(file)
    )
}

fn print_tables(levels: &[LevelRow], out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "\n{}", report::levels_table(levels))?;
    if let Some(refusals) = report::refusals_table(levels) {
        writeln!(out, "\n{refusals}")?;
    }
    Ok(())
}

fn print_sizes<D: AsRef<[u8]>>(file: &Chpm<D>, sizes: &Sizes, out: &mut impl Write) -> io::Result<()> {
    let Sizes { file: whole, tables, pages, padding } = *sizes;
    writeln!(
        out,
        "\nsize       {} ({} bytes): pages {}, padding {} ({:.1} %), tables {}; {:.1} bytes a source triangle",
        Bytes(whole),
        count(whole),
        Bytes(pages),
        Bytes(padding),
        100.0 * padding as f64 / whole as f64,
        Bytes(tables),
        per_triangle(whole, file.header().source_triangle_count),
    )
}

/// Bytes of all pages by [`PARTS`]. Those of packed pages are found by packing them once more.
fn parts(file: &Chpm<MappedFile>) -> Result<[f64; PARTS.len()]> {
    let mut sums = [0; PARTS.len()];
    for id in (0..file.header().cluster_count).map(ClusterId) {
        let page = file.page(id)?;
        let sizes = match file.is_packed(id) {
            true => packed::sizes(page.bytes_or(&[]))?,
            false => page.view().sizes(),
        };
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
    let rest = [("tables", sizes.tables as f64), ("padding", sizes.padding as f64)];
    let all = PARTS.into_iter().zip(parts).chain(rest);
    let told = all.map(|(part, bytes)| format!("{part} {:.3}", bytes / triangles));
    writeln!(out, "parts      {} bytes a source triangle", told.collect::<Vec<_>>().join(", "))
}

fn print_caches([all, roots]: [Drawn; 2], out: &mut impl Write) -> io::Result<()> {
    let told = |drawn: Drawn| drawn.acmr().map(|acmr| format!("{acmr:.3}")).join(", ");
    writeln!(
        out,
        "cache      {} misses a triangle at the finest, middle and base positions; roots {} (first in, first out, {} vertices)",
        told(all),
        told(roots),
        caches::SIZE
    )
}

fn print_provenance(metadata: &Metadata, out: &mut impl Write) -> io::Result<()> {
    let source = &metadata.source;
    writeln!(
        out,
        "source     {}: {}, {}, {}, {}, xxh3 {:016x}",
        source.name,
        Bytes(source.byte_len),
        source.encoding,
        Counted(source.vertex_count, "vertex"),
        Counted(source.face_count, "face"),
        source.hash,
    )?;
    for comment in &source.comments {
        writeln!(out, "           {comment}")?;
    }
    let settings: Vec<String> =
        metadata.settings.iter().map(|(name, value)| format!("{name} {value}")).collect();
    writeln!(out, "settings   {}", settings.join(", "))?;
    for warning in &metadata.warnings {
        writeln!(out, "warning: {warning}")?;
    }
    let repairs = report::repair_lines(&metadata.repairs);
    if !repairs.is_empty() {
        writeln!(out, "found in the source:\n{}", repairs.join("\n"))?;
    }
    Ok(())
}

fn as_json<D: AsRef<[u8]>>(
    path: &Path,
    file: &Chpm<D>,
    metadata: Option<&Metadata>,
    levels: &[LevelRow],
    sizes: &Sizes,
) -> Value {
    let h = file.header();
    let source = metadata.map(|metadata| &metadata.source).map(|source| {
        json!({
            "name": source.name,
            "bytes": source.byte_len,
            // As text: a 64-bit number is more than a JSON number holds for many readers.
            "xxh3": format!("{:016x}", source.hash),
            "encoding": source.encoding,
            "vertices": source.vertex_count,
            "faces": source.face_count,
            "comments": source.comments,
        })
    });
    json!({
        "schema": "chpm-info/1",
        "file": path.display().to_string(),
        "version": format!("{}.{}", h.version_major, h.version_minor),
        "generator": metadata.map(|metadata| &metadata.generator),
        "triangles": h.source_triangle_count,
        "vertices": h.source_vertex_count,
        "normals": h.attributes().normals,
        "colors": h.attributes().colors,
        "origin": h.origin,
        "box": { "min": h.aabb_min, "max": h.aabb_max },
        "max_error": h.max_error,
        "max_distance": max_distance(file),
        "error_kind": error_kind(file),
        "boundary": boundary(file),
        "counts": {
            "clusters": h.cluster_count,
            "leaves": h.leaf_count,
            "roots": h.root_count,
            "groups": h.group_count,
            "levels": h.level_count,
            "shared_vertices": h.shared_vertex_count,
        },
        "levels": levels,
        "bytes": {
            "file": sizes.file,
            "tables": sizes.tables,
            "pages": sizes.pages,
            "padding": sizes.padding,
            "per_triangle": per_triangle(sizes.file, h.source_triangle_count),
        },
        "source": source,
        "settings": metadata.map(|metadata| report::object(metadata.settings.clone())),
        "repairs": metadata.map(|metadata| report::object(metadata.repairs.clone())),
        "warnings": metadata.map(|metadata| &metadata.warnings),
    })
}

/// The largest distance of any mesh of the file to the source; unknown where it does not tell what has vanished.
fn max_distance<D: AsRef<[u8]>>(file: &Chpm<D>) -> Option<f32> {
    let gaps = (0..file.groups().len() as u32).map(|id| file.gaps(GroupId(id)).base);
    file.has_gaps().then(|| gaps.fold(file.header().max_error, f32::max))
}

fn error_kind<D: AsRef<[u8]>>(file: &Chpm<D>) -> String {
    file.header().error_kind().map_or_else(|| "unknown".to_owned(), |kind| kind.to_string())
}

fn boundary<D: AsRef<[u8]>>(file: &Chpm<D>) -> String {
    file.header().boundary_mode().map_or_else(|| "unknown".to_owned(), |mode| mode.to_string())
}
