//! A model made of range scans: each is read in its turn and moved into the model's frame on the way.

use crate::batch::{Batch, BatchKind, MAX_VERTICES};
use crate::conf::{Pose, RangeScans};
use crate::error::{ImportError, SourceError};
use crate::input::Input;
use crate::options::{Keep, Options};
use crate::ply::PlyError;
use crate::reader::{Beside, MeshReader, SourceInfo};
use crate::supply::Supply;
use crate::texture::Images;
use crate::vertex_format::{Coordinates, VertexFormat};
use chpm_extmem::{Cancel, Store};
use chpm_mesh::{Attributes, Scalar, scalar_words};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Scans one after the other.
pub(crate) struct ScanSet {
    list: PathBuf,
    scans: Vec<(PathBuf, Pose)>,
    options: Options,
    store: Store,
    cancel: Cancel,
    format: VertexFormat,
    /// Those that all scans have.
    scalars: Vec<Scalar>,
    /// The scan that is being read, and which one it is.
    current: Option<Input>,
    at: usize,
    /// Vertices and faces of the scans before.
    base: u64,
    vertices: u64,
    faces: u64,
    read: SourceInfo,
}

impl ScanSet {
    /// Looks into every scan of the list, which lie relative to it: attributes are kept only if all of them have them.
    pub(crate) fn open(
        path: &Path,
        list: RangeScans,
        options: Options,
        store: &Store,
        cancel: &Cancel,
    ) -> Result<Self, SourceError> {
        // Whoever scans ranges has no images of them.
        let options = Options { images: Images::Ignored, ..options };
        let (mut attributes, mut some) = (Attributes::ALL, Attributes::NONE);
        let (mut scans, mut scalars) = (Vec::new(), Common::default());
        for (index, scan) in list.scans.into_iter().enumerate() {
            let file = path.with_file_name(&scan.file);
            let opened =
                open(&file, options.clone(), store, cancel).map_err(|error| named(path, index, error))?;
            let has = opened.vertex_format().attributes;
            (attributes, some) = (attributes.common(has), some.joined(has));
            scalars.add(opened.scalars());
            scans.push((file, scan.pose));
        }
        let Common { all: scalars, dropped } = scalars;
        let scalars = scalars.unwrap_or_default();
        attributes.scalar_words = scalar_words(&scalars) as u8;

        let mut read = SourceInfo { encoding: "range scans".to_owned(), ..SourceInfo::default() };
        if some.normals && !attributes.normals {
            read.warnings.push("dropped normals, which not all of the scans have".to_owned());
        }
        if some.colors && !attributes.colors {
            read.warnings.push("dropped colours, which not all of the scans have".to_owned());
        }

        if !dropped.is_empty() {
            let names = dropped.into_iter().collect::<Vec<_>>().join(", ");
            read.warnings
                .push(format!("dropped scalars, which not all of the scans have as one type: {names}"));
        }

        // Each scan is to give the same in the same order.
        let keep = Keep { all: false, names: scalars.iter().map(|scalar| scalar.name.clone()).collect() };
        let options = Options { normals: attributes.normals, colors: attributes.colors, keep, ..options };
        let format = VertexFormat { coordinates: Coordinates::Double, attributes };
        let (list, store, cancel) = (path.to_owned(), store.clone(), cancel.clone());
        Ok(ScanSet {
            list,
            scans,
            options,
            store,
            cancel,
            format,
            scalars,
            current: None,
            at: 0,
            base: 0,
            vertices: 0,
            faces: 0,
            read,
        })
    }

    fn refill(&mut self, batch: &mut Batch) -> Result<BatchKind, SourceError> {
        let Some((path, pose)) = self.scans.get(self.at) else {
            *batch = Batch::default();
            return Ok(BatchKind::End);
        };
        let input = match &mut self.current {
            Some(input) => input,
            none => none.insert(open(path, self.options.clone(), &self.store, &self.cancel)?),
        };

        match input.next_batch(batch)? {
            BatchKind::Vertices => {
                batch.positions_f64.extend(batch.vertices.positions.drain(..).map(|p| p.map(f64::from)));
                batch.positions_f64.iter_mut().for_each(|p| *p = pose.point(*p));
                let normals = &mut batch.vertices.normals;
                normals.iter_mut().for_each(|n| *n = pose.direction(n.map(f64::from)).map(|x| x as f32));

                // Indices count through all scans.
                batch.invalid_vertices.iter_mut().for_each(|vertex| *vertex += self.base);
                batch.far.iter_mut().for_each(|place| place.index += self.base);
                batch.first = self.vertices;
                self.vertices += batch.positions_f64.len() as u64;
                if self.vertices > MAX_VERTICES {
                    let source = PlyError::TooManyVertices { count: self.vertices, limit: MAX_VERTICES };
                    return Err(SourceError::of(path, source));
                }
                Ok(BatchKind::Vertices)
            }
            BatchKind::Triangles => {
                // A face may come before the vertices that it names: that all of them come is checked at the scan's end.
                fn beyond(v: u32, base: u64) -> bool {
                    u64::from(v) + base >= MAX_VERTICES
                }
                let corners = batch.triangles.as_flattened().iter().chain(batch.polygons.iter().flatten());
                if let Some(v) = corners.copied().find(|v| beyond(*v, self.base)) {
                    let count = u64::from(v) + self.base;
                    let source = PlyError::TooManyVertices { count, limit: MAX_VERTICES };
                    return Err(SourceError::of(path, source));
                }

                let base = self.base as u32;
                batch.triangles.iter_mut().for_each(|triangle| *triangle = triangle.map(|v| v + base));
                batch.polygons.corners_mut().for_each(|corner| *corner += base);
                batch.first = self.faces;
                self.faces += (batch.triangles.len() + batch.polygons.iter().count()) as u64;
                Ok(BatchKind::Triangles)
            }
            BatchKind::End => {
                if let Some(input) = self.current.take() {
                    let scan = input.finish()?;
                    let all = &mut self.read;
                    let (path, first) = (path.clone(), Some(self.base));
                    all.beside.push(Beside { path, first, len: scan.byte_len, hash: scan.hash });
                    all.vertex_count += scan.vertex_count;
                    all.face_count += scan.face_count;
                    all.tally.add(&scan.tally);
                    let name = &scan.name;
                    all.warnings.extend(scan.warnings.iter().map(|warning| format!("{name}: {warning}")));
                }
                self.base = self.vertices;
                self.at += 1;
                // Nothing came of this call, and more may come.
                *batch = Batch::default();
                Ok(BatchKind::Vertices)
            }
        }
    }
}

impl MeshReader for ScanSet {
    fn format(&self) -> VertexFormat {
        self.format
    }

    fn scalars(&self) -> &[Scalar] {
        &self.scalars
    }

    fn bytes_beside(&self) -> u64 {
        let read: u64 = self.read.beside.iter().map(|scan| scan.len).sum();
        read + self.current.as_ref().map_or(0, Input::bytes_read)
    }

    fn next(&mut self, batch: &mut Batch) -> Result<BatchKind, ImportError> {
        let index = self.at;
        Ok(self.refill(batch).map_err(|error| named(&self.list, index, error))?)
    }

    fn finish(self: Box<Self>) -> Result<SourceInfo, ImportError> {
        Ok(self.read)
    }
}

/// The scalars that all scans have, by name and type.
#[derive(Default)]
struct Common {
    all: Option<Vec<Scalar>>,
    /// Names of those that only some have.
    dropped: BTreeSet<String>,
}

impl Common {
    fn add(&mut self, of_scan: &[Scalar]) {
        let Some(all) = &mut self.all else {
            self.all = Some(of_scan.to_vec());
            return;
        };
        let only_there = of_scan.iter().filter(|scalar| !all.contains(scalar));
        self.dropped.extend(only_there.map(|scalar| scalar.name.clone()));
        let only_here = all.extract_if(.., |scalar| !of_scan.contains(scalar));
        self.dropped.extend(only_here.map(|scalar| scalar.name));
    }
}

fn open(path: &Path, options: Options, store: &Store, cancel: &Cancel) -> Result<Input, SourceError> {
    Input::open_as(&Supply::file(path)?, options, store, false, cancel)
}

/// Error of a scan, with the scan's name.
fn named(list: &Path, index: usize, error: SourceError) -> SourceError {
    match error {
        SourceError::Cancelled | SourceError::Extmem(_) => error,
        error => SourceError::Scan { list: list.to_owned(), index, error: Box::new(error) },
    }
}
