//! A mesh that lies in several files, which a list names: each is read in its turn.

use crate::batch::{Batch, BatchKind, MAX_VERTICES};
use crate::conf::Pose;
use crate::error::{ImportError, SourceError};
use crate::input::{self, Input};
use crate::options::{Keep, Options};
use crate::ply::PlyError;
use crate::reader::{Beside, MeshReader, SourceInfo};
use crate::supply::Supply;
use crate::texture::{Images, Textures};
use crate::vertex_format::{Coordinates, VertexFormat};
use chpm_extmem::{Cancel, Store};
use chpm_mesh::{Attributes, Counted, Scalar, scalar_words};
use chpm_texture::{Material, TexturedTriangle, Wrap};
use std::collections::BTreeSet;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// One of the files, and how it is moved into the model's frame, if it is.
pub(crate) type Member = (PathBuf, Option<Pose>);

/// Files one after the other. Vertices, faces, normals of corners and materials are numbered through all of them.
pub(crate) struct FileSet {
    list: PathBuf,
    members: Vec<Member>,
    options: Options,
    store: Store,
    cancel: Cancel,
    format: VertexFormat,
    /// Those that all files have.
    scalars: Vec<Scalar>,
    /// The file that is being read, and which one it is.
    current: Option<Input>,
    at: usize,
    /// Most bytes that have been read: a glTF's own and those taken from it, which are less when it has ended.
    told: u64,
    /// Vertices that 32 bits number.
    most: u64,
    /// Counts of what was delivered, and those of the files before.
    counts: Counts,
    before: Counts,
    /// Whether corners of the file that is being read have normals.
    has_corner_normals: bool,
    /// Files that have materials and no images.
    plain: u64,
    read: SourceInfo,
    /// The files in words, and what they lose since not all of them have it.
    what: String,
    warnings: Vec<String>,
}

#[derive(Clone, Copy, Default)]
struct Counts {
    vertices: u64,
    faces: u64,
    /// Normals of corners.
    normals: u64,
    materials: u32,
}

impl FileSet {
    /// Looks into every file of the list at `list`: attributes are kept only if all of them have them. `what` they are, in words.
    pub(crate) fn open(
        list: &Path,
        members: Vec<Member>,
        what: &str,
        options: Options,
        store: &Store,
        cancel: &Cancel,
    ) -> Result<Self, SourceError> {
        let (mut attributes, mut some) = (Attributes::ALL, Attributes::NONE);
        let mut scalars = Common::default();
        let mut coordinates = None;
        for (index, (file, pose)) in members.iter().enumerate() {
            let opened = open(file, options.clone(), store, cancel);
            let opened = opened.map_err(|error| named(list, index, error))?;
            let format = opened.vertex_format();
            (attributes, some) = (attributes.common(format.attributes), some.joined(format.attributes));
            scalars.add(opened.scalars());
            // What is turned is no single any more.
            let own = if pose.is_some() { Coordinates::Double } else { format.coordinates };
            coordinates = Some(match coordinates {
                Some(all) if all != own => Coordinates::Double,
                _ => own,
            });
        }
        let Common { all: scalars, dropped } = scalars;
        let scalars = scalars.unwrap_or_default();
        attributes.scalar_words = scalar_words(&scalars) as u8;

        let mut warnings = Vec::new();
        if some.normals && !attributes.normals {
            warnings.push(format!("dropped normals, which not all of the {what} have"));
        }
        if some.colors && !attributes.colors {
            warnings.push(format!("dropped colours, which not all of the {what} have"));
        }
        if !dropped.is_empty() {
            let names = dropped.into_iter().collect::<Vec<_>>().join(", ");
            warnings.push(format!("dropped scalars, which not all of the {what} have as one type: {names}"));
        }

        // Each file is to give the same in the same order.
        let keep = Keep { all: false, names: scalars.iter().map(|scalar| scalar.name.clone()).collect() };
        // Where no file has normals of vertices, corners of faces may have some.
        let normals = options.normals && (attributes.normals || !some.normals);
        let options = Options { normals, colors: attributes.colors, keep, ..options };
        let format = VertexFormat { coordinates: coordinates.unwrap_or(Coordinates::Single), attributes };
        Ok(FileSet {
            list: list.to_owned(),
            members,
            options,
            store: store.clone(),
            cancel: cancel.clone(),
            format,
            scalars,
            current: None,
            at: 0,
            told: 0,
            most: MAX_VERTICES,
            counts: Counts::default(),
            before: Counts::default(),
            has_corner_normals: false,
            plain: 0,
            read: SourceInfo::default(),
            what: what.to_owned(),
            warnings,
        })
    }

    /// Which file the next batch is of.
    pub(crate) fn at(&self) -> usize {
        self.at
    }

    /// An error for a file that is not what it was.
    pub(crate) fn changed(&self, at: usize) -> SourceError {
        let path = self.members.get(at).map_or_else(|| self.list.clone(), |(path, _)| path.clone());
        let source = io::Error::other("it has changed while it was read; try again");
        named(&self.list, at, SourceError::Read { path, source })
    }

    /// The same files, from the first one on.
    pub(crate) fn again(self) -> FileSet {
        let [counts, before] = [Counts::default(); 2];
        let read = SourceInfo::default();
        FileSet {
            current: None,
            at: 0,
            told: 0,
            counts,
            before,
            has_corner_normals: false,
            plain: 0,
            read,
            ..self
        }
    }

    fn refill(&mut self, batch: &mut Batch) -> Result<BatchKind, SourceError> {
        let Some((path, pose)) = self.members.get(self.at) else {
            *batch = Batch::default();
            return Ok(BatchKind::End);
        };
        let input = match &mut self.current {
            Some(input) => input,
            none => none.insert(open(path, self.options.clone(), &self.store, &self.cancel)?),
        };
        let kind = input.next_batch(batch)?;
        let too_many =
            |count| SourceError::of(path, PlyError::TooManyVertices { count, limit: MAX_VERTICES });

        // Numbers count through all files. A face may come before the vertices that it names: that all of them come is checked at the
        // file's end.
        let Counts { vertices: base, normals, materials, .. } = self.before;
        let faces = batch.triangles.as_flattened().iter().chain(batch.polygons.iter().flatten());
        let textured = batch.textured.iter().flat_map(|triangle| &triangle.vertices);
        let corners = batch.corner_normals.iter().map(|[vertex, _]| vertex);
        let has_only_triangles = batch.polygons.is_empty()
            && [batch.textured.len(), batch.corner_normals.len(), batch.listed_normals.len()] == [0; 3];
        let most = self.most;
        let beyond = faces.chain(textured).chain(corners).find(|v| u64::from(**v) + base >= most);
        match beyond {
            Some(_) if self.options.wide && has_only_triangles => batch.base = base,
            Some(beyond) => return Err(too_many(u64::from(*beyond) + base)),
            None => {}
        }
        let first = if batch.base == base || base >= most { 0 } else { base as u32 };
        batch.triangles.iter_mut().for_each(|triangle| *triangle = triangle.map(|v| v + first));
        batch.polygons.corners_mut().for_each(|corner| *corner += first);
        for triangle in &mut batch.textured {
            triangle.vertices = triangle.vertices.map(|v| v + first);
            if triangle.material != TexturedTriangle::NO_MATERIAL {
                triangle.material = triangle.material.saturating_add(materials);
                self.counts.materials = self.counts.materials.max(triangle.material.saturating_add(1));
            }
        }
        for [vertex, normal] in &mut batch.corner_normals {
            *vertex += first;
            let own = u64::from(*normal) + normals;
            *normal = if *normal == u32::MAX { *normal } else { u32::try_from(own).unwrap_or(u32::MAX) };
        }
        if let Some(pose) = pose {
            batch.listed_normals.iter_mut().for_each(|normal| turn(normal, pose));
        }
        self.counts.normals += batch.listed_normals.len() as u64;
        self.has_corner_normals |= !batch.corner_normals.is_empty();

        match kind {
            BatchKind::Vertices => {
                if self.format.coordinates.are_double() {
                    let singles = batch.vertices.positions.drain(..);
                    batch.positions_f64.extend(singles.map(|p| p.map(f64::from)));
                }
                if let Some(pose) = pose {
                    batch.positions_f64.iter_mut().for_each(|p| *p = pose.point(*p));
                    batch.vertices.normals.iter_mut().for_each(|normal| turn(normal, pose));
                }
                batch.invalid_vertices.iter_mut().for_each(|vertex| *vertex += base);
                batch.far.iter_mut().for_each(|place| place.index += base);
                batch.first = self.counts.vertices;
                self.counts.vertices += batch.vertex_count() as u64;
                if self.counts.vertices > most && !self.options.wide {
                    return Err(too_many(self.counts.vertices));
                }
            }
            BatchKind::Triangles => {
                batch.first = self.counts.faces;
                self.counts.faces += (batch.triangles.len() + batch.polygons.iter().count()) as u64;
            }
            BatchKind::End => {
                // More may come.
                *batch = Batch::default();
                let has_some = self.format.attributes.normals || self.has_corner_normals;
                if self.options.normals && !has_some && self.counts.vertices > base {
                    // Of all files, this one has none.
                    batch.corner_normals.push([first, u32::MAX]);
                }
                self.end_file()?;
                return Ok(BatchKind::Vertices);
            }
        }
        Ok(kind)
    }

    /// Takes down what is known of a file that is read.
    fn end_file(&mut self) -> Result<(), SourceError> {
        if let (Some(input), Some((path, _))) = (self.current.take(), self.members.get(self.at)) {
            let (info, (len, hash)) = input.finish_apart()?;
            let all = &mut self.read;
            let first = Some(self.before.vertices);
            all.beside.push(Beside { path: path.clone(), first, len, hash });
            all.beside.extend(info.beside.into_iter().map(|beside| Beside { first: None, ..beside }));
            all.vertex_count += info.vertex_count;
            all.face_count += info.face_count;
            all.tally.add(&info.tally);
            let name = &info.name;
            all.warnings.extend(info.warnings.iter().map(|warning| format!("{name}: {warning}")));
            let numbers = self.before.materials..self.counts.materials;
            self.plain += u64::from(info.textures.is_none() && !numbers.is_empty());
            self.counts.materials = add(&mut all.textures, info.textures, numbers);
        }
        (self.before, self.has_corner_normals) = (self.counts, false);
        self.at += 1;
        Ok(())
    }
}

impl MeshReader for FileSet {
    fn format(&self) -> VertexFormat {
        self.format
    }

    fn scalars(&self) -> &[Scalar] {
        &self.scalars
    }

    fn bytes_beside(&self) -> u64 {
        self.told
    }

    fn next(&mut self, batch: &mut Batch) -> Result<BatchKind, ImportError> {
        let index = self.at;
        let kind = self.refill(batch).map_err(|error| named(&self.list, index, error))?;
        let ended: u64 = self.read.beside.iter().map(|file| file.len).sum();
        self.told = self.told.max(ended + self.current.as_ref().map_or(0, Input::bytes_read));
        Ok(kind)
    }

    fn finish(mut self: Box<Self>) -> Result<SourceInfo, ImportError> {
        self.read.encoding = self.what;
        self.read.warnings.splice(..0, self.warnings);
        if self.read.textures.is_some() && self.plain > 0 {
            let plain = Counted(self.plain, "file");
            self.read.warnings.push(format!("{plain} without images, white beside the others"));
        }
        Ok(self.read)
    }
}

/// The files that those of a list are made of: each, and behind it those that it names.
pub(crate) fn files(
    members: impl IntoIterator<Item = PathBuf>,
    images: Images,
    cancel: &Cancel,
) -> Result<Vec<PathBuf>, ImportError> {
    let mut files = Vec::new();
    for member in members {
        match input::files_as(&member, images, false, cancel) {
            Err(SourceError::Cancelled) => return Err(SourceError::Cancelled.into()),
            // What is wrong with it is told when it is read.
            Err(_) => files.push(member),
            Ok(found) => files.extend(found),
        }
    }
    Ok(files)
}

/// Adds the table of a file whose triangles have these numbers of materials. Returns the number that comes next.
fn add(all: &mut Option<Textures>, table: Option<Textures>, numbers: Range<u32>) -> u32 {
    // A file without images has numbers of its own all the same.
    const WHITE: Material = Material { image: None, factor: [1.0; 4], wrap: [Wrap::Repeat; 2] };
    let mut end = numbers.end;
    if let Some(table) = table {
        let all = all.get_or_insert_with(|| Textures {
            tints: table.tints,
            are_plain: true,
            ..Textures::default()
        });
        all.tints &= table.tints;
        all.are_plain &= table.are_plain;
        let images = all.images.len() as u32;
        let own =
            |material: Material| Material { image: material.image.map(|image| image + images), ..material };
        all.materials.resize(numbers.start as usize, WHITE);
        all.materials.extend(table.materials.into_iter().map(own));
        all.images.extend(table.images);
        end = end.max(all.materials.len() as u32);
    }
    if let Some(all) = all {
        all.materials.resize(end as usize, WHITE);
    }
    end
}

fn turn(normal: &mut [f32; 3], pose: &Pose) {
    *normal = pose.direction(normal.map(f64::from)).map(|x| x as f32);
}

/// The scalars that all files have, by name and type.
#[derive(Default)]
struct Common {
    all: Option<Vec<Scalar>>,
    /// Names of those that only some have.
    dropped: BTreeSet<String>,
}

impl Common {
    fn add(&mut self, of_file: &[Scalar]) {
        let Some(all) = &mut self.all else {
            self.all = Some(of_file.to_vec());
            return;
        };
        let only_there = of_file.iter().filter(|scalar| !all.contains(scalar));
        self.dropped.extend(only_there.map(|scalar| scalar.name.clone()));
        let only_here = all.extract_if(.., |scalar| !of_file.contains(scalar));
        self.dropped.extend(only_here.map(|scalar| scalar.name));
    }
}

fn open(path: &Path, options: Options, store: &Store, cancel: &Cancel) -> Result<Input, SourceError> {
    Input::open_as(&Supply::file(path)?, options, store, false, cancel)
}

/// Error of a file, with its list.
fn named(list: &Path, index: usize, error: SourceError) -> SourceError {
    match error {
        SourceError::Cancelled | SourceError::Extmem(_) => error,
        error => SourceError::Member { list: list.to_owned(), index, error: Box::new(error) },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A set of four scans of three vertices, of which the last two are beyond what 32 bits number: only seven are to be.
    fn read(wide: bool, face: &str) -> Result<(Vec<[u64; 3]>, SourceInfo), String> {
        let dir = tempfile::tempdir().unwrap();
        let ply = |corners: &str| {
            format!(
                "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                 element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n{corners}\n"
            )
        };
        let paths: Vec<PathBuf> = (0..4).map(|scan| dir.path().join(format!("{scan}.ply"))).collect();
        for (scan, path) in paths.iter().enumerate() {
            std::fs::write(path, ply(if scan == 3 { face } else { "3 0 1 2" })).unwrap();
        }
        let store = Store::create(dir.path(), 1 << 20).unwrap();
        let options = Options { wide, ..Options::default() };
        let members = paths.into_iter().map(|path| (path, None)).collect();
        let list = dir.path().join("list.conf");
        let set = FileSet::open(&list, members, "scans", options, &store, &Cancel::default()).unwrap();
        let mut set = Box::new(FileSet { most: 7, ..set });
        let (mut triangles, mut batch) = (Vec::new(), Batch::default());
        loop {
            let kind = set.next(&mut batch).map_err(|error| error.to_string())?;
            triangles.extend(batch.triangles.iter().map(|t| t.map(|v| batch.base + u64::from(v))));
            if kind == BatchKind::End {
                return Ok((triangles, set.finish().unwrap()));
            }
        }
    }

    #[test]
    fn vertices_beyond_32_bits_count_from_a_base_where_that_is_understood() {
        let (triangles, info) = read(true, "3 2 1 0").unwrap();
        assert_eq!(triangles, [[0, 1, 2], [3, 4, 5], [6, 7, 8], [11, 10, 9]]);
        assert_eq!((info.vertex_count, info.face_count), (12, 4));
        let refused = read(false, "3 2 1 0").unwrap_err();
        assert!(refused.contains("2.ply") && refused.contains("vertices"), "{refused}");
        // Polygons are cut later, by numbers of 32 bits.
        let refused = read(true, "4 0 1 2 0").unwrap_err();
        assert!(refused.contains("3.ply") && refused.contains("vertices"), "{refused}");
    }
}
