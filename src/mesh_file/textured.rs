//! The mesh of a cut with its sheets: a GLB that has them, or a glTF, an OBJ or a PLY with images beside it.

use super::{MeshFormat, Ready, facts};
use crate::cmd::check_unchanged;
use crate::companions::{Companions, Written, container};
use crate::progress::Meter;
use crate::stop;
use anyhow::{Result, bail};
use chpm_build::Cancel;
use chpm_export::{
    Atlases, PartImage, TexturedPart, textured_mtl, write_textured, write_textured_obj, write_textured_ply,
};
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_refine::Cut;

/// Bytes that writing takes for a mesh of so many triangles.
pub(crate) fn memory(file: &Chpm<MappedFile>, side: u32, triangles: u64) -> u64 {
    Atlases::memory(file, side, triangles)
}

/// Bytes that parts take while others are made.
fn held(parts: &[TexturedPart]) -> u64 {
    let of = |part: &TexturedPart| {
        let image = match &part.image {
            PartImage::Inside(bytes) => bytes.len(),
            PartImage::Beside(_) => 0,
        };
        size_of_val(&*part.positions)
            + size_of_val(&*part.normals)
            + size_of_val(&*part.places)
            + size_of_val(&*part.triangles)
            + image
    };
    parts.iter().map(|part| of(part) as u64).sum()
}

impl Ready<'_, '_> {
    /// Writes the mesh of a cut, or levels of one each, with images of at most `side` texels a side. `room` refuses what takes too many bytes besides. The file
    /// has no name yet.
    pub(crate) fn write_textured(
        self,
        file: &Chpm<MappedFile>,
        cuts: &[&Cut],
        side: u32,
        room: &dyn Fn(u64) -> Result<()>,
        meter: &Meter,
        cancel: &Cancel,
    ) -> Result<Written> {
        let (offset, bounds) = (self.offset(), self.finest().bounds);
        let Ready { target, levels, frame, grid, turn, .. } = self;
        let (path, format) = (&target.args.output, target.format);
        let mut facts = facts(file, (&levels, frame.origin()), target.by, offset, turn);
        facts.scalars.clear();
        facts.grid = grid;
        let mut beside = Companions::new(path, &target.inputs, target.args.force, format == MeshFormat::Gltf);
        let (mut all, mut images) = (Vec::new(), Vec::new());
        let mut before = 0;
        for (cut, level) in cuts.iter().zip(&levels) {
            room(before + memory(file, side, level.mesh.triangle_count()))?;
            let atlases = Atlases::new(file, cut, side, !target.args.no_normals);
            meter.start("write", atlases.len() as u64);
            let mut parts = atlases.parts(file, || stop::check(cancel), || meter.add(1))?;
            meter.finish();
            if format != MeshFormat::Glb {
                beside.add_images(&mut parts, &mut images)?;
            }
            before += held(&parts);
            all.push(parts);
        }
        let comment = format!("chpm {}, error {:e}", target.by, bounds.error);
        let (origin, parts) = (facts.placement.origin, &all[0]);
        let mut written = match format {
            MeshFormat::Glb | MeshFormat::Gltf => {
                let has_mesh = levels.iter().any(|level| level.mesh.triangle_count() > 0);
                let container = container(target.output, target.buffer);
                let container = write_textured(container, &facts, &all, target.args.meshopt)?;
                Written::gltf(container, has_mesh)
            }
            MeshFormat::Obj => {
                let mtl = beside.add(".mtl", textured_mtl(&images).as_bytes())?;
                Written::alone(write_textured_obj(target.output, parts, origin, &comment, &mtl)?)
            }
            MeshFormat::Ply => {
                Written::alone(write_textured_ply(target.output, parts, origin, &comment, &images)?)
            }
            MeshFormat::Stl => bail!("an STL has no room for images: choose .glb, .gltf, .obj or .ply"),
        };
        written.beside.extend(beside.into_files());
        check_unchanged(file)?;
        Ok(written)
    }
}
