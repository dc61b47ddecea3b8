//! The reader: places vertices, joins those of equal position, and makes triangles of corners.

use super::accessor::WINDOW;
use super::coats::Coat;
use super::parts::Parts;
use super::walk::{Corner, TriangleWalk, VertexWalk, Wanted};
use crate::batch::{Batch, BatchKind, Tally};
use crate::error::{ImportError, SourceError};
use crate::joined::{Keys, Numbers, Pairs, SortedKeys, pair};
use crate::location::SourceLocation;
use crate::options::Invalid;
use crate::ply::Warning;
use crate::reader::{MeshReader, SourceInfo};
use crate::texture::{self, Table};
use crate::vertex_format::VertexFormat;
use crate::vertex_set::VertexSet;
use chpm_extmem::{BufferWriter, Cached, Cancel, Reservation, Sorted, Sorter, Store};
use chpm_mesh::FAR;
use chpm_texture::TexturedTriangle;
use std::path::PathBuf;

/// A glTF that is being read.
pub(super) struct GltfReader {
    encoding: &'static str,
    parts: Parts,
    names: Vec<PathBuf>,
    /// Images, where some are asked for.
    table: Option<Table>,
    invalid_data: Invalid,
    store: Store,
    cancel: Cancel,
    phase: Phase,
    walk: VertexWalk,
    /// Vertices and faces that were delivered.
    delivered: u64,
    faces: u64,
    /// Vertices whose normals were added up.
    blended: u64,
    /// Vertices of which others had another colour.
    other_colors: u64,
    /// Vertices, as they are delivered, whose positions are not finite.
    invalid: VertexSet,
    tally: Tally,
    /// Bytes of positions and indices that were read.
    bytes: u64,
    _share: Reservation,
}

/// Phases, one after the other.
enum Phase {
    /// Positions are read.
    Keys(Keys),
    /// Equal ones are found.
    Groups(SortedKeys, Found),
    /// Normals of vertices that are joined are read.
    Normals(Pairs, Sorter<u128>, Found),
    /// Vertices are delivered.
    Vertices(Box<Delivery>),
    Triangles(Box<TriangleWalk>, Numbers, Option<Coordinates>),
    Ended,
}

/// Vertices of equal position.
struct Found {
    /// Each of them, with the first.
    members: Sorter<u64>,
    /// The same again, where normals are to be read first.
    of_normals: Option<Sorter<u64>>,
    /// The first, with each other.
    others: Sorter<u64>,
    /// The first of the last ones.
    first: Option<u32>,
}

/// State of the delivery of vertices.
struct Delivery {
    members: Pairs,
    others: Pairs,
    normals: Option<Normals>,
    /// Colours of vertices that are joined, by the first of these.
    colors: Sorter<u64>,
    /// Vertices that are not delivered, with the number that they have now.
    joined: Sorter<u64>,
    /// Texture coordinates of all vertices, delivered or not.
    coordinates: Option<BufferWriter<[f32; 2]>>,
}

/// Texture coordinates by vertex of the scene.
type Coordinates = Cached<[f32; 2]>;

impl GltfReader {
    pub(super) fn new(
        encoding: &'static str,
        parts: Parts,
        (names, table): (Vec<PathBuf>, Option<Table>),
        invalid_data: Invalid,
        (store, cancel): (&Store, &Cancel),
        share: Reservation,
    ) -> Self {
        let keys = Keys::new(parts.format.coordinates.are_double(), store);
        GltfReader {
            encoding,
            parts,
            names,
            table,
            invalid_data,
            store: store.clone(),
            cancel: cancel.clone(),
            phase: Phase::Keys(keys),
            walk: VertexWalk::default(),
            delivered: 0,
            faces: 0,
            blended: 0,
            other_colors: 0,
            invalid: VertexSet::default(),
            tally: Tally::default(),
            bytes: 0,
            _share: share,
        }
    }

    /// Does a piece of work.
    fn step(&mut self, batch: &mut Batch) -> Result<BatchKind, ImportError> {
        self.cancel.check().map_err(|_| SourceError::Cancelled)?;
        match std::mem::replace(&mut self.phase, Phase::Ended) {
            Phase::Keys(mut keys) => {
                self.phase = match self.read_keys(&mut keys)? {
                    true => Phase::Keys(keys),
                    false => Phase::Groups(keys.finish()?, self.found()),
                };
            }
            Phase::Groups(mut keys, mut found) => {
                self.phase = match find(&mut keys, &mut found)? {
                    true => Phase::Groups(keys, found),
                    false => self.found_all(found)?,
                };
            }
            Phase::Normals(mut members, mut normals, found) => {
                self.phase = match self.read_normals(&mut members, &mut normals)? {
                    true => Phase::Normals(members, normals, found),
                    false => Phase::Vertices(Box::new(self.delivery(found, Some(normals))?)),
                };
            }
            Phase::Vertices(mut delivery) => {
                self.phase = match self.deliver(&mut delivery, batch)? {
                    true => Phase::Vertices(delivery),
                    false => {
                        self.other_colors = several(delivery.colors.finish()?)?;
                        let vertices = self.parts.vertices;
                        let numbers = Numbers::new(delivery.joined, vertices, &self.store, &self.cancel)?;
                        let coordinates =
                            delivery.coordinates.map(BufferWriter::finish_column).transpose()?;
                        Phase::Triangles(Box::default(), numbers, coordinates.map(Cached::new))
                    }
                };
            }
            Phase::Triangles(mut walk, mut numbers, mut coordinates) => {
                if self.deliver_triangles(&mut walk, &mut numbers, &mut coordinates, batch)? {
                    self.phase = Phase::Triangles(walk, numbers, coordinates);
                }
                return Ok(BatchKind::Triangles);
            }
            Phase::Ended => return Ok(BatchKind::End),
        }
        Ok(BatchKind::Vertices)
    }

    fn found(&self) -> Found {
        let sorter = || Sorter::new(&self.store, "vertices of equal position");
        let of_normals = self.parts.format.attributes.normals.then(sorter);
        Found { members: sorter(), of_normals, others: sorter(), first: None }
    }

    /// Hands the positions that come next to the sort; false if there are none.
    fn read_keys(&mut self, keys: &mut Keys) -> Result<bool, ImportError> {
        let Some(window) = self.walk.next(&self.parts, Wanted { positions: true, ..Wanted::default() })?
        else {
            return Ok(false);
        };
        for (vertex, position) in (window.first..).zip(&window.positions) {
            // What is not finite is dealt with when it is delivered.
            if position.iter().all(|x| x.is_finite()) {
                keys.push(*position, vertex as u32)?;
            }
        }
        self.bytes += 12 * window.positions.len() as u64;
        Ok(true)
    }

    /// All vertices of equal position are known.
    fn found_all(&mut self, mut found: Found) -> Result<Phase, ImportError> {
        self.walk = VertexWalk::default();
        Ok(match found.of_normals.take() {
            None => Phase::Vertices(Box::new(self.delivery(found, None)?)),
            Some(members) => {
                let normals = Sorter::new(&self.store, "normals of joined vertices");
                Phase::Normals(Pairs::new(members)?, normals, found)
            }
        })
    }

    /// Takes the normals of those among the next vertices that are joined; false if no vertex is left.
    fn read_normals(&mut self, members: &mut Pairs, normals: &mut Sorter<u128>) -> Result<bool, ImportError> {
        let Some(window) = self.walk.next(&self.parts, Wanted { normals: true, ..Wanted::default() })? else {
            return Ok(false);
        };
        for (vertex, normal) in (window.first..).zip(&window.normals) {
            if let Some(first) = members.of(vertex as u32)?
                && let Some(normal) = finite(*normal).filter(|normal| *normal != [0.0; 3])
            {
                normals.push(Normals::item(first, normal))?;
            }
        }
        Ok(true)
    }

    fn delivery(&mut self, found: Found, normals: Option<Sorter<u128>>) -> Result<Delivery, ImportError> {
        self.walk = VertexWalk::default();
        let is_textured = self.table.as_ref().is_some_and(Table::is_textured);
        let coordinates = is_textured.then(|| BufferWriter::new(&self.store, "texture coordinates", 0));
        Ok(Delivery {
            members: Pairs::new(found.members)?,
            others: Pairs::new(found.others)?,
            normals: normals.map(Normals::new).transpose()?,
            colors: Sorter::new(&self.store, "colours of joined vertices"),
            joined: Sorter::new(&self.store, "joined vertices"),
            coordinates: coordinates.transpose()?,
        })
    }

    /// Delivers those of the next vertices that are the first of their position; false if no vertex is left.
    fn deliver(&mut self, delivery: &mut Delivery, batch: &mut Batch) -> Result<bool, ImportError> {
        let attributes = self.parts.format.attributes;
        let is_double = self.parts.format.coordinates.are_double();
        let wanted = Wanted {
            positions: true,
            normals: attributes.normals,
            colors: attributes.colors,
            coordinates: delivery.coordinates.is_some(),
        };
        let Some(window) = self.walk.next(&self.parts, wanted)? else { return Ok(false) };
        if let Some(coordinates) = &mut delivery.coordinates {
            let mut own = window.coordinates;
            own.resize(window.positions.len(), [f32::NAN; 2]);
            coordinates.extend_from_slice(&own)?;
        }
        batch.first = self.delivered;
        for (at, position) in window.positions.iter().enumerate() {
            let vertex = (window.first + at as u64) as u32;
            let first = delivery.members.of(vertex)?;
            let color = window.colors.get(at).copied().unwrap_or([255; 4]);
            if attributes.colors
                && let Some(first) = first
            {
                delivery.colors.push(pair(first, u32::from_le_bytes(color)))?;
            }
            if first.is_some_and(|first| first != vertex) {
                continue;
            }
            while let Some(other) = delivery.others.of(vertex)? {
                delivery.joined.push(pair(other, self.delivered as u32))?;
            }

            let mut position = *position;
            if let Some(&value) = position.iter().find(|x| !x.is_finite()) {
                if self.invalid_data == Invalid::Refuse {
                    return Err(ImportError::NotFinite { place: place(vertex), value });
                }
                position = [0.0; 3];
                self.invalid.insert(self.delivered);
                self.tally.dropped_vertices += 1;
                batch.invalid_vertices.push(self.delivered);
            }
            if position.iter().any(|x| x.abs() > FAR) {
                batch.far.push(SourceLocation { index: self.delivered, ..place(vertex) });
            }
            match is_double {
                true => batch.positions_f64.push(position),
                false => batch.vertices.positions.push(position.map(|x| x as f32)),
            }
            if let Some(normals) = &mut delivery.normals {
                let sum = normals.sum(vertex)?;
                self.blended += u64::from(sum.is_some());
                // Vertices that no triangle has may have none.
                let own = finite(window.normals.get(at).copied().unwrap_or_default());
                self.tally.zeroed_normals += u64::from(own.is_none());
                batch.vertices.normals.push(sum.or(own).unwrap_or_default());
            }
            if attributes.colors {
                batch.vertices.colors.push(color);
            }
            self.delivered += 1;
        }
        Ok(true)
    }

    /// Delivers the triangles that come next; false if there are none.
    fn deliver_triangles(
        &mut self,
        walk: &mut TriangleWalk,
        numbers: &mut Numbers,
        coordinates: &mut Option<Coordinates>,
        batch: &mut Batch,
    ) -> Result<bool, ImportError> {
        batch.first = self.faces;
        let is_any = walk.next(&self.parts)?;
        for corners in &walk.triangles {
            let mut triangle = [0; 3];
            let mut is_valid = true;
            for (vertex, corner) in triangle.iter_mut().zip(corners) {
                match *corner {
                    Ok(corner) => *vertex = numbers.of(corner)?,
                    Err((index, vertices)) if self.invalid_data == Invalid::Refuse => {
                        let place =
                            SourceLocation { element: "triangle".to_owned(), ..place(self.faces as u32) };
                        return Err(ImportError::IndexOutOfRange { place, index: index.into(), vertices });
                    }
                    Err(_) => is_valid = false,
                }
                is_valid &= !self.invalid.contains((*vertex).into());
            }
            if !is_valid {
                self.tally.dropped_faces += 1;
            } else if batch.push_face(&triangle, &mut self.tally)
                && let (Some(coat), Some(coordinates)) = (walk.coat, &mut *coordinates)
            {
                batch.textured.push(textured(triangle, corners, coat, coordinates)?);
            }
        }
        self.faces += batch.triangles.len() as u64;
        self.bytes += 12 * walk.triangles.len() as u64;
        Ok(is_any)
    }
}

impl MeshReader for GltfReader {
    fn format(&self) -> VertexFormat {
        self.parts.format
    }

    fn bytes_beside(&self) -> u64 {
        self.bytes
    }

    fn next(&mut self, batch: &mut Batch) -> Result<BatchKind, ImportError> {
        batch.clear();
        self.step(batch)
    }

    fn finish(self: Box<Self>) -> Result<SourceInfo, ImportError> {
        let mut warnings = self.parts.warnings;
        let count = self.tally.zeroed_normals;
        warnings.extend((count > 0).then(|| Warning::NormalsZeroed { count }.to_string()));
        let count = self.blended;
        let blended = || format!("gave {count} vertices the sum of the different normals that they have");
        warnings.extend((count > 0).then(blended));
        let count = self.other_colors;
        let first = || format!("gave {count} vertices the first of the different colours that they have");
        warnings.extend((count > 0).then(first));

        let mut beside = Vec::new();
        for path in self.names {
            beside.push(texture::file_beside(&path, &self.cancel)?);
        }
        let mut textures = None;
        if let Some(table) = self.table {
            warnings.extend(table.warnings());
            beside.extend(table.beside(&self.cancel)?);
            textures = table.finish(true);
        }
        Ok(SourceInfo {
            encoding: self.encoding.to_owned(),
            vertex_count: self.parts.vertices,
            face_count: self.parts.faces,
            tally: self.tally,
            warnings,
            beside,
            textures,
            ..SourceInfo::default()
        })
    }
}

/// A triangle with the coordinates of its corners, each of which is a vertex of the scene.
fn textured(
    vertices: [u32; 3],
    corners: &[Corner; 3],
    coat: Coat,
    coordinates: &mut Coordinates,
) -> Result<TexturedTriangle, ImportError> {
    let mut triangle = TexturedTriangle { vertices, uv: [[f32::NAN; 2]; 3], material: coat.plain };
    let Some(painted) = coat.painted else { return Ok(triangle) };
    triangle.material = painted.material;
    for (uv, corner) in triangle.uv.iter_mut().zip(corners) {
        if let Some(own) = coordinates.get(corner.map_or(usize::MAX, |vertex| vertex as usize))? {
            *uv = painted.place(own);
        }
    }
    Ok(triangle)
}

/// How many higher numbers of sorted pairs have several lower ones.
fn several(mut sorted: Sorted<u64>) -> Result<u64, ImportError> {
    let (mut count, mut last, mut is_counted) = (0, None, false);
    while let Some(next) = sorted.next()? {
        let is_same = last.is_some_and(|last: u64| last >> 32 == next >> 32);
        is_counted &= is_same;
        if is_same && last != Some(next) && !is_counted {
            (count, is_counted) = (count + 1, true);
        }
        last = Some(next);
    }
    Ok(count)
}

/// Takes some vertices in the order of their positions; false if none are left.
fn find(keys: &mut SortedKeys, found: &mut Found) -> Result<bool, ImportError> {
    for _ in 0..WINDOW {
        let Some((vertex, first)) = keys.next()? else { return Ok(false) };
        if vertex == first {
            continue;
        }
        let is_new = found.first.replace(first) != Some(first);
        for member in is_new.then_some(first).into_iter().chain([vertex]) {
            found.members.push(pair(member, first))?;
            if let Some(members) = &mut found.of_normals {
                members.push(pair(member, first))?;
            }
        }
        found.others.push(pair(first, vertex))?;
    }
    Ok(true)
}

fn place(vertex: u32) -> SourceLocation {
    SourceLocation { element: "vertex".to_owned(), index: vertex.into(), offset: 0, line: None }
}

fn finite(normal: [f64; 3]) -> Option<[f32; 3]> {
    Some(normal.map(|x| x as f32)).filter(|normal| normal.iter().all(|x| x.is_finite()))
}

/// Different normals of joined vertices, by the first of these.
struct Normals {
    sorted: Sorted<u128>,
    next: Option<u128>,
}

impl Normals {
    fn new(sorter: Sorter<u128>) -> Result<Normals, ImportError> {
        let mut sorted = sorter.finish()?;
        let next = sorted.next()?;
        Ok(Normals { sorted, next })
    }

    fn item(first: u32, normal: [f32; 3]) -> u128 {
        // Adding zero takes the sign from a zero, and changes nothing else.
        let words = normal.map(|x| u128::from((x + 0.0).to_bits()));
        words.into_iter().fold(u128::from(first), |item, word| item << 32 | word)
    }

    /// The sum of the normals of `vertex`, at length one; none if there are no two different ones, or if it is zero.
    fn sum(&mut self, vertex: u32) -> Result<Option<[f32; 3]>, ImportError> {
        let (mut sum, mut count, mut last) = ([0.0; 3], 0, None);
        while let Some(item) = self.next.filter(|item| (item >> 96) as u32 == vertex) {
            if last.replace(item) != Some(item) {
                let normal = [64, 32, 0].map(|shift| f64::from(f32::from_bits((item >> shift) as u32)));
                let length = normal.iter().map(|x| x * x).sum::<f64>().sqrt();
                sum = [0, 1, 2].map(|axis| sum[axis] + normal[axis] / length);
                count += 1;
            }
            self.next = self.sorted.next()?;
        }
        let length = sum.iter().map(|x| x * x).sum::<f64>().sqrt();
        let is_sum = count > 1 && length > LEAST_SUM;
        Ok(is_sum.then(|| sum.map(|x| (x / length) as f32)))
    }
}

/// A sum of normals that is shorter has no direction.
const LEAST_SUM: f64 = 1e-6;
