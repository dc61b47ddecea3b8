//! Work of one contender in its process.

use super::{Contender, DIVISORS, clod, in_core};
use anyhow::Result;
use chpm_build::config::{Layout, Topology};
use chpm_build::{BuildConfig, Cancel, Resources, Silent, build};
use chpm_extmem::{MappedFile, Store};
use chpm_format::{BoundaryMode, Chpm};
use chpm_import::ply::{self, Encoding};
use chpm_mesh::{Bytes, TriMesh};
use chpm_refine::{Cut, extract};
use chpm_verify::Points;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// From the source to the contender's output: what is timed. A simplifier goes down to the coarsest mesh in one run.
pub(crate) fn run(
    contender: Contender,
    source: &Path,
    output: &Path,
    memory: Bytes,
    cancel: &Cancel,
) -> Result<()> {
    if contender.is_chpm() {
        build(source, output, &config(contender, memory), &Silent, cancel)?;
        return Ok(());
    }
    let mesh = read(source)?;
    if contender == Contender::MeshoptClod {
        return clod::write(&mesh, output);
    }
    let coarsest = mesh.triangles.len() as u64 / DIVISORS[DIVISORS.len() - 1];
    for lod in simplified(contender, &mesh, &[coarsest])? {
        write(&lod, output)?;
    }
    Ok(())
}

/// Meshes of at most so many triangles, which fall; `output` is what [`run`] has left. Written beside it; not timed.
pub(crate) fn meshes(contender: Contender, source: &Path, output: &Path, limits: &[u64]) -> Result<()> {
    let lods = if contender.is_chpm() {
        let file = Chpm::open(MappedFile::open(output)?)?;
        limits
            .iter()
            .map(|limit| Ok(extract(&file, &Cut::at_triangles(&file, *limit)?)?))
            .collect::<Result<Vec<TriMesh>>>()?
    } else {
        simplified(contender, &read(source)?, limits)?
    };
    limits.iter().zip(&lods).try_for_each(|(limit, lod)| write(lod, &mesh_path(output, *limit)))
}

/// Where [`meshes`] writes one.
pub(crate) fn mesh_path(output: &Path, limit: u64) -> PathBuf {
    output.with_extension(format!("{limit}.ply"))
}

fn simplified(contender: Contender, mesh: &TriMesh, limits: &[u64]) -> Result<Vec<TriMesh>> {
    match contender {
        Contender::MeshoptClod => clod::meshes(mesh, limits),
        Contender::MeshoptSimplify => in_core::by_meshopt(mesh, limits),
        Contender::Kernel => in_core::by_kernel(mesh, limits),
        _ => Ok(in_core::by_plain(mesh, limits)),
    }
}

fn config(contender: Contender, memory: Bytes) -> BuildConfig {
    let mut config = BuildConfig { overwrite: true, ..BuildConfig::default() };
    config.resources.memory = memory;
    match contender {
        Contender::ChpmOneThread => config.resources.threads = 1,
        Contender::ChpmLock => config.settings.boundary = BoundaryMode::Lock,
        Contender::ChpmKeep => config.settings.topology = Topology::Keep,
        Contender::ChpmNoLayout => config.settings.layout = Layout::Simplification,
        _ => {}
    }
    config
}

/// Positions, rounded to single precision, and triangles of a mesh of any format.
pub(crate) fn read(path: &Path) -> Result<TriMesh> {
    let store = Store::create(&std::env::temp_dir(), Resources::default().memory.0)?;
    Ok(Points::read(path, &store, &Silent, &Cancel::default())?.relative([0.0; 3]))
}

fn write(mesh: &TriMesh, path: &Path) -> Result<()> {
    let mut out = BufWriter::new(File::create(path)?);
    ply::write_mesh(&mut out, mesh, Encoding::BinaryLittleEndian)?;
    Ok(out.flush()?)
}
