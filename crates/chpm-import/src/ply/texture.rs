//! Images that a PLY names in its comments, and texture coordinates of its vertices.
//!
//! Where vertices have coordinates, they are doubled along seams. Those of equal position, bit for bit, become one then: faces go by the
//! first.

use super::{
    PlyReader,
    header::{Header, words},
    schema::{find, texture_of_vertex},
    wedges::Wedges,
};
use crate::batch::{Batch, BatchKind};
use crate::error::ImportError;
use crate::joined::{Keys, Numbers, SortedKeys, pair};
use crate::stream::Stream;
use crate::supply::Supply;
use crate::texture::{Cutter, Images, Table, beside};
use chpm_extmem::{BufferWriter, Cached, Cancel, Sorter, Store};
use chpm_texture::{Alpha, TexturedTriangle, Wrap};
use std::path::{Path, PathBuf};

/// Images of a PLY.
pub(super) struct Texture {
    pub(super) table: Table,
    of_vertices: Option<OfVertices>,
    /// Faces that got two corners in one vertex.
    pub(super) degenerate: u64,
    /// Vertices of which others had the position.
    pub(super) joined: u64,
}

/// Coordinates of vertices.
struct OfVertices {
    /// The material of all faces, unless they say another.
    material: Option<u32>,
    state: State,
    vertices: u64,
    block: Vec<[f32; 2]>,
    store: Store,
    cancel: Cancel,
}

enum State {
    Growing(BufferWriter<[f32; 2]>, Keys),
    Known(Cached<[f32; 2]>, Numbers),
    Failed,
}

/// The images that comments name.
fn named(header: &Header) -> impl Iterator<Item = &str> {
    header.comments.iter().filter_map(|comment| {
        let keyword = words(comment).next().filter(|word| word.eq_ignore_ascii_case("TextureFile"))?;
        comment.trim_start().strip_prefix(keyword).map(str::trim)
    })
}

/// Finds the images.
fn table(
    header: &Header,
    path: &Path,
    images: Images,
    store: Option<&Store>,
) -> Result<(Table, Vec<u32>), ImportError> {
    let (mut table, mut materials) = (Table::new(images, store)?, Vec::new());
    for name in named(header) {
        let image = table.file(name, beside::find(name, path), Alpha::Ignored)?;
        materials.push(table.material(image, [1.0; 4], [Wrap::Repeat; 2])?);
    }
    Ok((table, materials))
}

/// The images that the PLY at `path` names, if it is textured.
pub(super) fn files(
    stream: Stream,
    path: &Path,
    images: Images,
    _: &Cancel,
) -> Result<Vec<PathBuf>, ImportError> {
    if images == Images::Ignored {
        return Ok(Vec::new());
    }
    // What is no PLY names no files; the reader says why.
    let Ok(header) = Header::parse(&mut super::source::Source::new(stream)) else { return Ok(Vec::new()) };
    Ok(table(&header, path, images, None)?.0.files().to_vec())
}

impl Texture {
    /// Has the reader hand over texture coordinates, if there are images.
    pub(super) fn find(
        reader: &mut PlyReader<Stream>,
        supply: &Supply,
        images: Images,
        (store, cancel): (&Store, &Cancel),
    ) -> Result<Option<Texture>, ImportError> {
        let header = reader.header();
        // Nothing lies beside a pipe.
        if images == Images::Ignored || supply.is_spooled() || named(header).next().is_none() {
            return Ok(None);
        }
        let (table, materials) = table(header, &supply.path, images, Some(store))?;
        let mut texture = Texture { table, of_vertices: None, degenerate: 0, joined: 0 };
        if !texture.table.is_textured() {
            return Ok(Some(texture));
        }

        let element = |name: &str| header.elements.iter().find(|element| element.name == name);
        let of_face = |name: &str| element("face").and_then(|face| find(face, name));
        let (coordinates, number) = (of_face("texcoord"), of_face("texnumber"));
        let of_vertices = element("vertex").filter(|_| coordinates.is_none()).and_then(texture_of_vertex);
        let material = materials.first().copied();
        let is_by_face = coordinates.is_some() || of_vertices.is_some() && number.is_some();
        let wedges = is_by_face.then(|| Wedges {
            materials,
            coordinates,
            number,
            cutter: Cutter::default(),
            uv: Vec::new(),
            wrong: 0,
        });
        if of_vertices.is_some() {
            let coordinates = BufferWriter::new(store, "texture coordinates", 0)?;
            let keys = Keys::new(reader.vertex_format().coordinates.are_double(), store);
            texture.of_vertices = Some(OfVertices {
                material: material.filter(|_| !is_by_face),
                state: State::Growing(coordinates, keys),
                vertices: 0,
                block: Vec::new(),
                store: store.clone(),
                cancel: cancel.clone(),
            });
        }
        reader.read_textures(of_vertices, wedges);
        Ok(Some(texture))
    }

    /// Adds to a batch what is known by vertex.
    pub(super) fn complete(
        &mut self,
        reader: &mut PlyReader<Stream>,
        kind: BatchKind,
        batch: &mut Batch,
    ) -> Result<(), ImportError> {
        let Some(own) = &mut self.of_vertices else { return Ok(()) };
        match kind {
            BatchKind::Vertices => own.vertices(reader, batch),
            BatchKind::Triangles => {
                self.joined += own.know()?;
                self.degenerate += own.triangles(batch)?;
                Ok(())
            }
            BatchKind::End => Ok(()),
        }
    }
}

impl OfVertices {
    fn vertices(&mut self, reader: &mut PlyReader<Stream>, batch: &Batch) -> Result<(), ImportError> {
        reader.take_coordinates(&mut self.block);
        if let State::Growing(coordinates, keys) = &mut self.state {
            coordinates.extend_from_slice(&self.block)?;
            let singles = batch.vertices.positions.iter().map(|p| p.map(f64::from));
            for position in singles.chain(batch.positions_f64.iter().copied()) {
                keys.push(position, self.vertices as u32)?;
                self.vertices += 1;
            }
        }
        Ok(())
    }

    /// All vertices have come: finds those of equal position, and answers how many are others' twins.
    fn know(&mut self) -> Result<u64, ImportError> {
        let (coordinates, keys) = match std::mem::replace(&mut self.state, State::Failed) {
            State::Growing(coordinates, keys) => (coordinates.finish_column()?, keys.finish()?),
            known => {
                self.state = known;
                return Ok(0);
            }
        };
        let (joined, count) = joined(keys, &self.store)?;
        let numbers = Numbers::of_firsts(joined, self.vertices, &self.store, &self.cancel)?;
        self.state = State::Known(Cached::new(coordinates), numbers);
        Ok(count)
    }

    /// Textured triangles of a batch, and then all of its corners as they are joined. Answers how many triangles are left out.
    fn triangles(&mut self, batch: &mut Batch) -> Result<u64, ImportError> {
        let State::Known(coordinates, numbers) = &mut self.state else { return Ok(0) };
        let mut uv_of = |vertex: u32| -> Result<[f32; 2], ImportError> {
            Ok(coordinates.get(vertex as usize)?.unwrap_or([f32::NAN; 2]))
        };
        if let Some(material) = self.material {
            for vertices in &batch.triangles {
                let [a, b, c] = *vertices;
                let uv = [uv_of(a)?, uv_of(b)?, uv_of(c)?];
                batch.textured.push(TexturedTriangle { vertices: *vertices, uv, material });
            }
            let (mut cutter, mut uv) = (Cutter::default(), Vec::new());
            for corners in batch.polygons.iter() {
                uv.clear();
                for corner in corners {
                    uv.push(uv_of(*corner)?);
                }
                cutter.cut(corners, &uv, material, &mut batch.textured);
            }
        } else {
            for triangle in &mut batch.textured {
                let [a, b, c] = triangle.vertices;
                triangle.uv = [uv_of(a)?, uv_of(b)?, uv_of(c)?];
            }
        }

        let triangles = batch.triangles.as_flattened_mut().iter_mut();
        let textured = batch.textured.iter_mut().flat_map(|triangle| &mut triangle.vertices);
        for corner in triangles.chain(textured).chain(batch.polygons.corners_mut()) {
            *corner = numbers.of(*corner)?;
        }
        let before = batch.triangles.len();
        batch.triangles.retain(|[a, b, c]| a != b && b != c && c != a);
        Ok((before - batch.triangles.len()) as u64)
    }
}

/// Vertices whose position an earlier one has, with the first that has it, and how many they are.
fn joined(mut keys: SortedKeys, store: &Store) -> Result<(Sorter<u64>, u64), ImportError> {
    let (mut joined, mut count) = (Sorter::new(store, "vertices of equal position"), 0);
    while let Some((vertex, first)) = keys.next()? {
        if vertex != first {
            joined.push(pair(vertex, first))?;
            count += 1;
        }
    }
    Ok((joined, count))
}
