//! Levels of detail out of a file: in one glTF, or each in a file of its own.

use super::Args;
use crate::cmd::Verdict;
use crate::json::{self, made, named};
use crate::memory;
use crate::mesh_file::{self, MeshArgs, MeshFile, Ready};
use crate::output;
use crate::progress::{Meter, line};
use crate::report::count;
use crate::stop::{self, Stop};
use anyhow::{Context, Result, bail, ensure};
use chpm_export::coverage;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::{Counted, Triangles};
use chpm_refine::{Cut, Extraction, Request};
use std::io::Write;

const BY: &str = "extract";

/// Selects and writes; all of the files get their names, or none.
pub(super) fn take(file: &Chpm<MappedFile>, args: &Args, free: u64, stop: &Stop) -> Result<Verdict> {
    let cancel = stop.heed();
    let wanted = &args.wanted.lods;
    let asked = falling(wanted, file.header().source_triangle_count)?;
    let is_apart = args.lods_apart || !args.mesh.has_levels(BY)?;
    let outputs: Vec<MeshArgs> = match is_apart {
        true => (0..wanted.len()).map(|level| args.mesh.of_level(BY, level)).collect::<Result<_>>()?,
        false => vec![args.mesh.clone()],
    };
    // Before the selection: a place that cannot be written is told at once.
    let targets: Vec<MeshFile<'_>> =
        outputs.iter().map(|mesh| mesh.create(BY, &[&args.file])).collect::<Result<_>>()?;
    let mut out = output::messages(targets.iter().map(|target| &target.output), args.json, args.quiet)?;
    super::check_textured(file, args, &targets)?;

    let meter = Meter::new(args.quiet);
    let requests: Vec<Request> = wanted.iter().map(|wanted| Request::Triangles(*wanted, None)).collect();
    let select = |request: &Request| request.cut(file, 0.0, free, || stop::check(&cancel));
    let cuts: Vec<Cut> = requests.iter().map(select).collect::<Result<_>>()?;
    let share = args.mesh.to_keep(free) / cuts.len() as u64;
    let mut meshes = Vec::new();
    for (request, cut) in requests.iter().zip(&cuts) {
        let mesh = Extraction::keeping(file, cut, share, || stop::check(&cancel))?;
        request
            .check(file, &mesh)
            .with_context(|| format!("'{}' does not have that", args.file.display()))?;
        meshes.push(mesh);
    }
    check_apart(args, &asked, &meshes)?;
    let orders = meshes.iter().map(|mesh| args.mesh.order_memory(mesh));
    let orders = if is_apart { orders.max().unwrap_or(0) } else { orders.sum() };
    let own = args.mesh.memory(BY, file)? + orders;
    let room = |bytes: u64| {
        memory::divide(file, args.memory.memory(), own + bytes)?;
        Ok(())
    };
    let images = args.texture_size.map_or(0, |side| {
        let each = meshes.iter().map(|mesh| mesh_file::textured_memory(file, side, mesh.triangle_count()));
        each.max().unwrap_or(0)
    });
    room(images)?;

    let all: Vec<&Extraction<'_, MappedFile>> = meshes.iter().collect();
    let of_target: Vec<&[&Extraction<'_, MappedFile>]> =
        if is_apart { all.chunks(1).collect() } else { vec![&all] };
    let readies: Vec<Ready<'_, '_>> = targets
        .into_iter()
        .zip(of_target)
        .map(|(target, meshes)| Ready::new(target, file, meshes, None, &cancel))
        .collect::<Result<_>>()?;
    let told = Told::new(file, args, &asked, &requests, &cuts, &readies);

    let mut written = Vec::new();
    let mut next = cuts.iter();
    for ready in readies {
        let own: Vec<&Cut> = next.by_ref().take(ready.levels.len()).collect();
        written.push(match args.texture_size {
            Some(side) => ready.write_textured(file, &own, side, &room, &meter, &cancel)?,
            None => ready.write(file, &meter, &cancel)?,
        });
    }
    written.into_iter().try_for_each(|written| written.publish())?;

    if args.json {
        json::print(&told.document, &mut out)?;
    } else {
        told.lines.iter().try_for_each(|line| writeln!(out, "{line}"))?;
    }
    out.flush()?;
    told.document.warnings.iter().for_each(|warning| line(&format!("warning: {warning}")));
    Ok(if !told.document.satisfied && args.strict { Verdict::Faulty } else { Verdict::Good })
}

/// How many triangles levels may have, which have to be fewer from one to the next.
fn falling(wanted: &[Triangles], model: u64) -> Result<Vec<u64>> {
    let asked: Vec<u64> = wanted.iter().map(|wanted| wanted.of(model)).collect();
    if let Some([finer, coarser]) = asked.array_windows().find(|[finer, coarser]| coarser >= finer) {
        bail!(
            "--lods goes from fine to coarse, and {} come after {}: give fewer from one to the next, as in 50k,10k,2k (a comma is between two levels, not in a number)",
            Counted(*coarser, "triangle"),
            count(*finer)
        );
    }
    Ok(asked)
}

/// Refuses levels that are the same mesh: the file has none between.
fn check_apart(args: &Args, asked: &[u64], meshes: &[Extraction<'_, MappedFile>]) -> Result<()> {
    for (asked, [finer, coarser]) in asked.windows(2).zip(meshes.array_windows()) {
        ensure!(
            coarser.triangle_count() < finer.triangle_count(),
            "'{}' has one mesh for {} and {} triangles, of {}: leave one of them out of --lods",
            args.file.display(),
            count(asked[0]),
            count(asked[1]),
            count(finer.triangle_count())
        );
    }
    Ok(())
}

/// Facts about the levels, for people and for programs.
struct Told {
    lines: Vec<String>,
    document: made::ExtractLods,
}

impl Told {
    fn new(
        file: &Chpm<MappedFile>,
        args: &Args,
        asked: &[u64],
        requests: &[Request],
        cuts: &[Cut],
        readies: &[Ready<'_, '_>],
    ) -> Self {
        let all = || readies.iter().flat_map(|ready| ready.levels.iter().map(move |level| (ready, *level)));
        let errors: Vec<f32> = all().map(|(_, level)| level.bounds.error).collect();
        let shares = coverage(&errors, file.header().aabb().diagonal());
        let (mut lines, mut levels, mut warnings) = (Vec::new(), Vec::new(), Vec::new());
        let mut less = Vec::new();
        for (number, (ready, level)) in all().enumerate() {
            let (mesh, share) = (ready.json(level), shares[number]);
            let outline = mesh_file::outline(level.mesh, level.bounds, "units");
            let seen = match share > 0.0 {
                true => format!("down to {:.1}% of an image's height", 100.0 * share),
                false => "however small it is".to_owned(),
            };
            lines.push(format!("{}, level {number}: {outline}; {seen}", mesh.output));
            let shortfall = requests[number].shortfall(file, &cuts[number], level.bounds.distance);
            let diagonal = file.header().aabb().diagonal();
            less.extend(shortfall.map(|less| less.describe(args.file.display(), diagonal)));
            let clusters = cuts[number].members().len();
            levels.push(made::Lod { asked: asked[number], clusters, coverage: share, mesh });
        }
        let satisfied = less.is_empty();
        let blurred =
            args.texture_size.is_none().then(|| mesh_file::without_images(file, &args.mesh)).flatten();
        let told = readies.iter().flat_map(|ready| ready.warnings.iter().cloned());
        for warning in told.chain(less).chain(blurred) {
            // Files of one model have the same faults.
            if !warnings.contains(&warning) {
                warnings.push(warning);
            }
        }
        lines.extend(readies.first().and_then(|ready| ready.upright.clone()));
        let document = made::ExtractLods {
            schema: "chpm-extract-lods/1",
            file: named(&args.file),
            satisfied,
            warnings,
            levels,
        };
        Told { lines, document }
    }
}
