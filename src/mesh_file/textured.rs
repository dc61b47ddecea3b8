//! The mesh of a cut with its sheets: a GLB that has them, or a glTF, an OBJ or a PLY with images beside it.

use super::{MeshFormat, Ready, facts};
use crate::companions::{Companions, Written, container};
use crate::progress::Meter;
use crate::stop;
use crate::whole::{Order, Whole};
use anyhow::{Result, bail};
use chpm_build::Cancel;
use chpm_export::{Atlases, PartImage, textured_mtl, write_textured, write_textured_obj, write_textured_ply};
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_refine::Cut;

/// Bytes that writing takes for a mesh of so many triangles.
pub(crate) fn memory(file: &Chpm<MappedFile>, side: u32, triangles: u64) -> u64 {
    Atlases::memory(file, side, triangles)
}

impl Ready<'_, '_> {
    /// Writes the mesh with images of at most `side` texels a side.
    pub(crate) fn write_textured(
        self,
        file: &Chpm<MappedFile>,
        cut: &Cut,
        side: u32,
        meter: &Meter,
        cancel: &Cancel,
    ) -> Result<()> {
        let offset = self.offset();
        let Ready { target, mesh, frame, turn, bounds, .. } = self;
        let (path, format) = (&target.args.output, target.format);
        let whole = Whole::new(mesh, frame, Order::File, cancel)?;
        let mut facts = facts(file, &whole, target.by, bounds, offset, turn);
        facts.scalars.clear();
        let atlases = Atlases::new(file, cut, side, !target.args.no_normals);
        meter.start("write", atlases.len() as u64);
        let parts = atlases.parts(file, || stop::check(cancel), || meter.add(1))?;

        let mut beside = Companions::new(path, target.args.force, format == MeshFormat::Gltf);
        let comment = format!("chpm {}, error {:e}", target.by, bounds.error);
        let origin = facts.placement.origin;
        let mut written = match format {
            MeshFormat::Glb | MeshFormat::Gltf => {
                let mut parts = parts;
                if format == MeshFormat::Gltf {
                    let images = beside.add_images(&parts)?;
                    parts
                        .iter_mut()
                        .zip(images)
                        .for_each(|(part, name)| part.image = PartImage::Beside(name));
                }
                let container = container(target.output, target.buffer);
                let container = write_textured(container, &facts, &parts, target.args.meshopt)?;
                Written::gltf(container, mesh.triangle_count() > 0)
            }
            MeshFormat::Obj => {
                let images = beside.add_images(&parts)?;
                let mtl = beside.add(".mtl", textured_mtl(&images).as_bytes())?;
                Written::alone(write_textured_obj(target.output, &parts, origin, &comment, &mtl)?)
            }
            MeshFormat::Ply => {
                let images = beside.add_images(&parts)?;
                Written::alone(write_textured_ply(target.output, &parts, origin, &comment, &images)?)
            }
            MeshFormat::Stl => bail!("an STL has no room for images: choose .glb, .gltf, .obj or .ply"),
        };
        written.beside.extend(beside.into_files());
        file.get_ref().check_unchanged()?;
        written.publish()?;
        meter.finish();
        Ok(())
    }
}
