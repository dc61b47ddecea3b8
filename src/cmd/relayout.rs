//! `chpm relayout`: the same file with its pages stored otherwise, or in another order.

use super::{Verdict, open, reading, stdout};
use crate::args::Pages;
use crate::memory::{self, MemoryArgs};
use crate::output;
use crate::progress::Meter;
use crate::report::causes;
use crate::stop::Stop;
use crate::threads::ThreadArgs;
use anyhow::{Result, anyhow, ensure};
use chpm_build::config::Volumes;
use chpm_build::page_order::{self, Run};
use chpm_build::{Append, BuildError, FailPoints, OutputFiles};
use chpm_extmem::{MappedFile, same_file};
use chpm_format::{Chpm, ClusterRecord, FormatError, Tables, checksum, packed, volume};
use chpm_mesh::{Aabb, Bytes, ClusterId, GroupId};
use clap::ValueEnum;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Pages that are worked on before they are written.
const BATCH: usize = 64;

/// Arguments of `chpm relayout`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file
    file: PathBuf,
    /// The file to write
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// How pages are stored; as they are if not given
    #[arg(long, value_name = "HOW", value_enum, required_unless_present_any = ["order", "volume_size"])]
    pages: Option<Pages>,
    /// In which order pages are; as they are if not given
    #[arg(long, value_name = "NAME", value_enum)]
    order: Option<Order>,
    /// Pages in files of their own beside the output, of at most SIZE each; in one file with it if not given, or one
    #[arg(long, value_name = "SIZE", default_value_t = Volumes::One)]
    volume_size: Volumes,
    /// Replace the output if it exists
    #[arg(short, long)]
    force: bool,
    #[command(flatten)]
    threads: ThreadArgs,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    memory: MemoryArgs,
    /// Settings of how it is shown, in place of those that it has.
    #[arg(skip)]
    shown: Vec<(String, String)>,
}

/// In which order pages are.
#[derive(ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
enum Order {
    /// Those of a split side by side, the largest errors first, as a build has them
    Splits,
    /// From the coarsest level to the finest
    Levels,
}

/// Writes a file with its pages stored so, and what it keeps of how it is shown.
#[cfg(feature = "web")]
pub(super) fn store_pages(
    (file, path): (&Chpm<MappedFile>, &Path),
    output: &Path,
    (pages, shown): (Pages, Vec<(String, String)>),
    quiet: bool,
    memory: MemoryArgs,
    stop: &Stop,
) -> Result<u64> {
    let (model, file, output) = (file, path.to_owned(), output.to_owned());
    let (order, force, threads, pages) = (None, false, ThreadArgs::default(), Some(pages));
    let volume_size = Volumes::One;
    let args = Args { file, output, pages, order, volume_size, force, threads, quiet, memory, shown };
    rewrite(model, &args, stop)
}

/// Writes the file, and says how long it is.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let before = open(&args.file)?;
    let len = rewrite(&before, args, stop)?;
    output::finish(&args.output);
    let (from, triangles) = (before.stored_len(), before.header().source_triangle_count.max(1) as f64);
    let mut out = stdout();
    writeln!(
        out,
        "{}: {}, {:.2} bytes a source triangle ({}, {:.2}, before)",
        args.output.display(),
        Bytes(len),
        len as f64 / triangles,
        Bytes(from),
        from as f64 / triangles,
    )?;
    out.flush()?;
    Ok(Verdict::Good)
}

/// Bytes of the file that is written.
fn rewrite(file: &Chpm<MappedFile>, args: &Args, stop: &Stop) -> Result<u64> {
    output::RELAYOUT.check(&args.output)?;
    // Also where only volumes are called alike.
    let is_same = |a: &Path, b: &Path| same_file(a, b) || same_file(&volume::path(a, 1), &volume::path(b, 1));
    let is_input = is_same(&args.file, &args.output);
    ensure!(!is_input, "the output '{}' is the input itself; choose another name", args.output.display());
    let pool = args.threads.pool()?;
    memory::divide(file, args.memory.memory(), BATCH as u64 * largest(file))?;
    reading(file, || pool.install(|| write(file, args, stop)))
}

/// Bytes of memory for the largest page and its packed form.
fn largest(file: &Chpm<MappedFile>) -> u64 {
    let pages = (0..file.header().cluster_count).map(|id| file.page_len(ClusterId(id)));
    2 * pages.max().unwrap_or(0)
}

/// That a page is larger than a volume, which is no fault of the file that is read.
fn too_small(error: BuildError) -> anyhow::Error {
    anyhow!("--volume-size: {}", causes(&error.into()).join(": "))
}

/// Pages first, each behind the one before; then the tables, which say where these are.
fn write(file: &Chpm<MappedFile>, args: &Args, stop: &Stop) -> Result<u64> {
    let (meter, cancel) = (Meter::new(args.quiet), stop.heed());
    let mut tables = Tables::of(file)?;
    tables.metadata.show(args.shown.clone());
    let was = match (tables.header.packed, tables.header.chained) {
        (_, true) => Pages::Chained,
        (true, false) => Pages::Packed,
        (false, false) => Pages::Raw,
    };
    let pages = args.pages.unwrap_or(was);
    ensure!(
        pages != Pages::Chained || tables.sheets.is_empty(),
        "'{}' has sheets, which know triangles by their order, and chained pages have another: store it with --pages packed",
        args.file.display()
    );
    tables.header.volume_size = args.volume_size.size();
    (tables.header.packed, tables.header.chained) = (pages != Pages::Raw, pages == Pages::Chained);
    tables.header.chunked = true;
    let ids = order(file, args.order);
    tables.reorder(&ids);

    let mut out = OutputFiles::create(&args.output, args.volume_size, args.force, FailPoints::default())?;
    let mut append = out.append(tables.first_sheet_offset()?);
    write_sheets(file, &ids, &tables, &mut out, &mut append)?;
    let align = if tables.header.packed { chpm_format::PACKED_ALIGN } else { chpm_format::PAGE_ALIGN };
    let mut end = 0;
    meter.start("relayout", ids.len() as u64);
    let mut places = Vec::new();
    for (batch, records) in ids.chunks(BATCH).zip(tables.clusters.chunks_mut(BATCH)) {
        crate::stop::check(&cancel)?;
        let stored = batch.par_iter().map(|id| store(file, *id, pages)).collect::<Result<Vec<_>, _>>()?;
        for (record, (bytes, flag)) in records.iter_mut().zip(stored) {
            let len = (bytes.len() as u64).next_multiple_of(align);
            let place = append.next(len).map_err(too_small)?;
            end = place + len;
            out.make_room(end)?;
            out.write_all_at(&bytes, place)?;
            places.push(place);
            record.page_len = bytes.len() as u32;
            record.page_checksum = checksum(&bytes);
            record.flags = record.flags & ClusterRecord::TRIMMED | flag;
        }
        meter.add(batch.len() as u64);
    }
    meter.finish();
    if pages == Pages::Chained {
        let check = || crate::stop::check(&cancel);
        let places = chpm_build::chain(&mut out, &mut tables, &places, end, check)?;
        chpm_build::close_up(&out, &mut tables, &places, check)?;
    }

    Ok(out.publish(&mut tables)?)
}

/// Writes the sheets of the clusters, which no order of pages changes.
fn write_sheets(
    file: &Chpm<MappedFile>,
    ids: &[ClusterId],
    tables: &Tables,
    out: &mut OutputFiles,
    append: &mut Append,
) -> Result<()> {
    // The first page comes right behind the last sheet's padding.
    let pages = tables.first_page_offset()? - tables.first_sheet_offset()?;
    let ends = tables.sheets.iter().skip(1).map(|next| next.offset).chain([pages]);
    for ((id, record), end) in ids.iter().zip(&tables.sheets).zip(ends) {
        // One that is damaged is told, and not copied.
        file.sheet(*id)?;
        let len = end - record.offset;
        let place = append.next(len).map_err(too_small)?;
        out.make_room(place + len)?;
        out.write_all_at(file.sheet_bytes(*id).unwrap_or_default(), place)?;
    }
    Ok(())
}

/// The clusters in the order that their pages are to have, the roots first in any.
fn order(file: &Chpm<MappedFile>, order: Option<Order>) -> Vec<ClusterId> {
    let record = |id: &ClusterId| &file.clusters()[id.index()];
    let mut ids: Vec<ClusterId> = (0..file.header().cluster_count).map(ClusterId).collect();
    match order {
        None => {}
        Some(Order::Levels) => ids.sort_by_key(|id| Reverse(record(id).level)),
        Some(Order::Splits) => ids = page_order::order(runs(file)).into_iter().map(ClusterId).collect(),
    }
    ids.sort_by_key(|id| !record(id).is_root());
    ids
}

/// Pages that are read together: roots, and the fine clusters of groups.
fn runs(file: &Chpm<MappedFile>) -> Vec<Run> {
    let roots = file.roots().map(|root| run_of(file, f32::INFINITY, vec![root.0]));
    let groups = (0..file.groups().len() as u32).map(|group| file.fine(GroupId(group)));
    let splits = groups.filter(|fine| !fine.is_empty()).map(|fine| {
        let own_groups = fine.iter().map(|id| file.clusters()[*id as usize].group());
        let errors = own_groups.map(|group| file.groups()[group.index()].max_error);
        run_of(file, errors.fold(0.0, f32::max), fine.to_vec())
    });
    roots.chain(splits).collect()
}

fn run_of(file: &Chpm<MappedFile>, error: f32, clusters: Vec<u32>) -> Run {
    let mut bounds = Aabb::EMPTY;
    clusters.iter().for_each(|id| bounds.merge(&file.clusters()[*id as usize].aabb()));
    Run { error, center: bounds.center().coords.map(|x| x as f32).into(), clusters }
}

/// A page as it is to be stored, and the flag that says so. A page that packing does not make shorter stays as it is.
fn store(file: &Chpm<MappedFile>, id: ClusterId, pages: Pages) -> Result<(Vec<u8>, u32), FormatError> {
    let page = file.page_checked(id)?;
    let raw = page.bytes_or(file.page_bytes(id));
    let mut bytes = Vec::new();
    if pages == Pages::Packed && packed::pack(raw, &mut bytes)? {
        return Ok((bytes, ClusterRecord::PACKED));
    }
    Ok((raw.to_vec(), 0))
}
