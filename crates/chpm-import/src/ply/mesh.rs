//! PLY as a format among others.

use super::PlyReader;
use crate::batch::{Batch, BatchKind};
use crate::error::ImportError;
use crate::format::{Format, Likeness};
use crate::reader::{MeshReader, Opening, SourceInfo, Start};
use crate::steps::Steps;
use crate::stream::Stream;
use crate::vertex_format::VertexFormat;
use chpm_mesh::Scalar;

/// Stanford PLY.
pub(crate) const FORMAT: Format =
    Format { name: "PLY", extensions: &["ply"], sniff, open: PlyMesh::open, names: None };

fn sniff(start: &Start<'_>) -> Likeness {
    let is_ply = match start.head {
        b"ply" => true,
        head => head.starts_with(b"ply") && matches!(head[3], b'\n' | b'\r' | b' '),
    };
    if is_ply { Likeness::Certain } else { Likeness::None }
}

/// A PLY, without the triangles that hang across steps of a range grid.
struct PlyMesh {
    reader: PlyReader<Stream>,
    steps: Option<Steps>,
}

impl PlyMesh {
    fn open(opening: Opening<'_>) -> Result<Box<dyn MeshReader>, ImportError> {
        let reader = PlyReader::new(opening.stream, opening.options)?;
        let steps = reader.has_grid().then(|| Steps::new(opening.store)).transpose()?;
        Ok(Box::new(PlyMesh { reader, steps }))
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
        Ok(kind)
    }

    fn finish(self: Box<Self>) -> Result<SourceInfo, ImportError> {
        let header = self.reader.header();
        let mut warnings: Vec<String> = self.reader.warnings().iter().map(ToString::to_string).collect();
        warnings.extend(self.steps.and_then(|steps| steps.warning()));
        Ok(SourceInfo {
            encoding: header.format.to_string(),
            vertex_count: header.vertex_count,
            face_count: header.face_count,
            comments: header.comments.clone(),
            tally: self.reader.tally(),
            warnings,
            ..SourceInfo::default()
        })
    }
}
