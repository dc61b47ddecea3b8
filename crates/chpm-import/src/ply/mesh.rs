//! PLY as a format among others.

use super::PlyReader;
use super::texture::{self, Texture};
use crate::batch::{Batch, BatchKind};
use crate::error::ImportError;
use crate::format::{Format, Likeness, without_mark};
use crate::reader::{MeshReader, Opening, SourceInfo, Start};
use crate::steps::Steps;
use crate::stream::Stream;
use crate::vertex_format::VertexFormat;
use chpm_extmem::Cancel;
use chpm_mesh::{Counted, Scalar};

/// Stanford PLY.
pub(crate) const FORMAT: Format = Format {
    name: "PLY",
    extensions: &["ply"],
    is_list: false,
    sniff,
    open: PlyMesh::open,
    names: Some(texture::files),
};

fn sniff(start: &Start<'_>) -> Likeness {
    let is_ply = match without_mark(start.head) {
        b"ply" => true,
        head => head.starts_with(b"ply") && matches!(head[3], b'\n' | b'\r' | b' '),
    };
    if is_ply { Likeness::Certain } else { Likeness::None }
}

/// A PLY, without the triangles that hang across steps of a range grid.
struct PlyMesh {
    reader: PlyReader<Stream>,
    steps: Option<Steps>,
    texture: Option<Texture>,
    cancel: Cancel,
}

impl PlyMesh {
    fn open(opening: Opening<'_>) -> Result<Box<dyn MeshReader>, ImportError> {
        let Opening { stream, options, store, cancel, supply, .. } = opening;
        let images = options.images;
        let mut reader = PlyReader::new(stream, options)?;
        let steps = reader.has_grid().then(|| Steps::new(store)).transpose()?;
        let texture = Texture::find(&mut reader, supply, images, (store, cancel))?;
        Ok(Box::new(PlyMesh { reader, steps, texture, cancel: cancel.clone() }))
    }
}

impl MeshReader for PlyMesh {
    fn format(&self) -> VertexFormat {
        self.reader.vertex_format()
    }

    fn scalars(&self) -> &[Scalar] {
        self.reader.scalars()
    }

    fn declared(&self) -> Option<(u64, u64)> {
        let header = self.reader.header();
        Some((header.vertex_count, header.face_count))
    }

    fn next(&mut self, batch: &mut Batch) -> Result<BatchKind, ImportError> {
        let kind = self.reader.next_batch(batch)?;
        if let Some(mut steps) = self.steps.take() {
            steps.vertices(batch)?;
            self.steps = Some(if kind == BatchKind::Triangles { steps.triangles(batch)? } else { steps });
        }
        if let Some(texture) = &mut self.texture {
            texture.complete(&mut self.reader, kind, batch)?;
        }
        Ok(kind)
    }

    fn finish(self: Box<Self>) -> Result<SourceInfo, ImportError> {
        let PlyMesh { reader, steps, texture, cancel } = *self;
        let header = reader.header();
        let mut info = SourceInfo {
            encoding: header.format.to_string(),
            vertex_count: header.vertex_count,
            face_count: header.face_count,
            comments: header.comments.clone(),
            tally: reader.tally(),
            warnings: reader.warnings().iter().map(ToString::to_string).collect(),
            ..SourceInfo::default()
        };
        info.warnings.extend(steps.and_then(|steps| steps.warning()));
        if let Some(Texture { mut table, degenerate, joined, .. }) = texture {
            info.tally.degenerate_faces += degenerate;
            let told = || {
                format!("joined {joined} vertices of equal position, which texture coordinates had doubled")
            };
            info.warnings.extend((joined > 0).then(told));
            let wrong = reader.wrongly_textured();
            if wrong > 0 {
                table.lack(format!(
                    "{} without an image: none of that number is there, or coordinates are not those of the corners",
                    Counted(wrong, "face")
                ))?;
            }
            info.warnings.extend(table.warnings());
            info.beside = table.beside(&cancel)?;
            info.textures = table.finish(false);
        }
        Ok(info)
    }
}
