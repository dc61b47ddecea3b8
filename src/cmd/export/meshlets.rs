//! `chpm export --meshlets`: the hierarchy for mesh shaders, as one file.

use super::{Args, Work, computes, waiting, work};
use crate::cmd::{Verdict, open, reading, stdout};
use crate::json::{self, made, named};
use crate::memory;
use crate::mesh_file;
use crate::output::{self, EXPORT_MESHLETS};
use crate::progress::{Meter, line};
use crate::stop::Stop;
use anyhow::Result;
use chpm_export::meshlets::{Block, Rule, Totals, Writer, block};
use chpm_export::tiles::{Mesh, SharedNormals};
use chpm_extmem::{AtomicFile, MappedFile};
use chpm_format::Chpm;
use chpm_mesh::{Bytes, Counted};
use std::io::Write;
use std::path::Path;

/// Memory of a cluster besides the tables: records of its two meshes and of its group, and the rule.
const EACH: u64 = 2 * Writer::<AtomicFile>::EACH + 128;
/// How much more than for tiles a thread takes while a mesh is cut.
const CUTTING: u64 = 3;

/// Exports into a file.
pub(super) fn run(args: &Args, target: &Path, stop: &Stop) -> Result<Verdict> {
    EXPORT_MESHLETS.check(target)?;
    let cancel = stop.heed();
    let file = open(&args.file)?;
    let has_normals = computes(&file, args);
    let normals = if has_normals { SharedNormals::memory(&file) } else { 0 };
    let own = EACH * u64::from(file.header().cluster_count) + normals;
    let each = CUTTING * work(&file) + waiting(&file);
    let (pool, _) = memory::workers(&args.threads, &file, args.memory.memory(), own, each)?;

    let meter = Meter::new(args.quiet);
    let work = Work { file: &file, normals: has_normals, meter: &meter, cancel: &cancel };
    let warnings = warnings(&file);
    warnings.iter().for_each(|warning| line(&format!("warning: {warning}")));
    let totals = reading(&file, || pool.install(|| write(&work, target, args)))?;
    meter.finish();
    tell(args, target, &totals, warnings)?;
    Ok(Verdict::Good)
}

/// Remarks on what the file has and the output has not.
fn warnings(file: &Chpm<MappedFile>) -> Vec<String> {
    let images =
        "images have become colours of vertices: --3dtiles and `chpm extract --texture-size` write them";
    let images = file.header().has_sheets().then(|| images.to_owned());
    images.into_iter().chain(mesh_file::without(file.scalars())).collect()
}

fn write(work: &Work<'_>, target: &Path, args: &Args) -> Result<Totals> {
    let (file, limit) = (work.file, args.meshlet_triangles);
    let out = EXPORT_MESHLETS.create_file(target, args.force, &[&args.file])?;
    let rule = Rule::of(file);
    let normals = work.normals()?;
    let mut writer = Writer::new(out, file, &rule, limit, work.normals)?;
    let make = |cluster| {
        let meshes = Mesh::of(file, cluster).iter();
        let blocks = meshes.map(|mesh| Ok(block(file, &rule, cluster, *mesh, limit, normals.as_ref())?));
        blocks.collect::<Result<Vec<Block>>>()
    };
    work.in_order("meshlets", make, |blocks| Ok(blocks.iter().try_for_each(|block| writer.add(block))?))?;
    let (out, totals) = writer.finish()?;
    out.publish()?;
    output::finish(target);
    Ok(totals)
}

fn tell(args: &Args, target: &Path, totals: &Totals, warnings: Vec<String>) -> Result<()> {
    let mut out = stdout();
    let &Totals { meshes, meshlets, triangles, vertices, bytes } = totals;
    if args.json {
        let export = made::ExportMeshlets {
            schema: "chpm-export-meshlets/1",
            file: named(&args.file),
            output: named(target),
            meshes,
            meshlets,
            triangles,
            vertices,
            bytes,
            warnings,
        };
        json::print(&export, &mut out)?;
        return Ok(out.flush()?);
    }
    writeln!(
        out,
        "{}: {} of {} in {}, {}",
        target.display(),
        Counted(meshlets, "meshlet"),
        Counted(triangles, "triangle"),
        Counted(meshes, "mesh"),
        Bytes(bytes),
    )?;
    Ok(out.flush()?)
}
