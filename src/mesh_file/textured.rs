//! The mesh of a cut with its sheets: a GLB that has them, or an OBJ or a PLY with images beside it.

use super::{MeshFormat, Ready, facts};
use crate::progress::Meter;
use crate::stop;
use crate::whole::{Order, Whole};
use anyhow::{Context, Result, bail};
use chpm_build::Cancel;
use chpm_export::{
    Atlases, PartImage, TexturedPart, textured_mtl, write_textured, write_textured_obj, write_textured_ply,
};
use chpm_extmem::{AtomicFile, MappedFile};
use chpm_format::Chpm;
use chpm_refine::Cut;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Bytes that writing takes for a mesh of so many triangles.
pub(crate) fn memory(file: &Chpm<MappedFile>, side: u32, triangles: u64) -> u64 {
    Atlases::memory(file, side, triangles)
}

/// Files beside an output.
struct Beside<'a> {
    output: &'a Path,
    force: bool,
    written: Vec<AtomicFile>,
}

impl Beside<'_> {
    /// Writes one whose name is the output's with another end, which is answered.
    fn add(&mut self, end: &str, bytes: &[u8]) -> Result<String> {
        let stem = self.output.file_stem().unwrap_or_default().to_str().with_context(|| {
            format!("'{}' has a name that its images cannot be called after", self.output.display())
        })?;
        // Words of an OBJ end at blanks.
        let name = format!("{}{end}", stem.replace(char::is_whitespace, "_"));
        let path: PathBuf = self.output.with_file_name(&name);
        let mut file = AtomicFile::create(&path, self.force)?;
        file.write_all(bytes).with_context(|| format!("cannot write '{}'", path.display()))?;
        self.written.push(file);
        Ok(name)
    }

    /// Images of parts, by number; answers their names.
    fn add_images(&mut self, parts: &[TexturedPart]) -> Result<Vec<String>> {
        let mut names = Vec::new();
        for (number, part) in parts.iter().enumerate() {
            let end = format!(".{number}.{}", if part.is_png { "png" } else { "jpg" });
            match &part.image {
                PartImage::Inside(bytes) => names.push(self.add(&end, bytes)?),
                PartImage::Beside(name) => names.push(name.clone()),
            }
        }
        Ok(names)
    }

    fn publish(self) -> Result<()> {
        Ok(self.written.into_iter().try_for_each(AtomicFile::publish)?)
    }
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

        let mut beside = Beside { output: path, force: target.args.force, written: Vec::new() };
        let comment = format!("chpm {}, error {:e}", target.by, bounds.error);
        let origin = facts.placement.origin;
        let output = match format {
            MeshFormat::Glb => write_textured(target.output, &facts, &parts, target.args.meshopt)?,
            MeshFormat::Obj => {
                let images = beside.add_images(&parts)?;
                let mtl = beside.add(".mtl", textured_mtl(&images).as_bytes())?;
                write_textured_obj(target.output, &parts, origin, &comment, &mtl)?
            }
            MeshFormat::Ply => {
                let images = beside.add_images(&parts)?;
                write_textured_ply(target.output, &parts, origin, &comment, &images)?
            }
            MeshFormat::Stl => bail!("an STL has no room for images: choose .glb, .obj or .ply"),
        };
        file.get_ref().check_unchanged()?;
        // First, so that no mesh is there without them.
        beside.publish()?;
        output.publish()?;
        meter.finish();
        Ok(())
    }
}
