//! Texture coordinates and materials of an OBJ's faces. Coordinates may come behind the faces that name them, so faces are kept until all
//! have come, and then handed over as triangles.

use super::libraries::{Libraries, Paint};
use super::statements::Joined;
use crate::batch::Batch;
use crate::error::{ImportError, SourceError};
use crate::lines::{meaning, number, words};
use crate::location::excerpt;
use crate::stream::{self, Tap};
use crate::supply::Supply;
use crate::texture::Cutter;
use chpm_extmem::{BufferWriter, Cached, Column, Store};
use chpm_texture::TexturedTriangle;
use std::collections::BTreeSet;

/// Numbers of kept faces that are read at once; a larger face is read by itself.
const WINDOW: usize = 1 << 16;
/// Coordinate of a corner that names none.
const NONE: u32 = u32::MAX;

/// Coordinates and faces so far.
pub(super) struct Wedges {
    pub(super) libraries: Libraries,
    coordinates: BufferWriter<[f32; 2]>,
    /// Of each face with a material: how many numbers follow, its surface, then of each corner its vertex and its coordinate.
    faces: BufferWriter<u32>,
    /// The material that was named last, and what it is, once there are images.
    name: Vec<u8>,
    surface: Option<u32>,
    face: Vec<u32>,
    /// Names of materials that faces have and no library had until then.
    unknown: BTreeSet<Vec<u8>>,
    store: Store,
}

impl Wedges {
    pub(super) fn new(libraries: Libraries, store: &Store) -> Result<Wedges, ImportError> {
        Ok(Wedges {
            libraries,
            coordinates: BufferWriter::new(store, "texture coordinates", 0)?,
            faces: BufferWriter::new(store, "textured faces", 0)?,
            name: Vec::new(),
            surface: None,
            face: Vec::new(),
            unknown: BTreeSet::new(),
            store: store.clone(),
        })
    }

    pub(super) fn is_textured(&self) -> bool {
        self.libraries.table.is_textured()
    }

    /// Coordinates that were read.
    pub(super) fn len(&self) -> u64 {
        self.coordinates.len() as u64
    }

    /// An `mtllib` statement. So many coordinates came before it that were not kept.
    pub(super) fn library(&mut self, names: &[u8], skipped: &mut u64) -> Result<(), ImportError> {
        self.libraries.add(names)?;
        if *skipped > 0 && self.is_textured() {
            self.reread(*skipped)?;
            *skipped = 0;
        }
        self.look_up();
        Ok(())
    }

    /// Reads the first so many coordinates of the file again.
    fn reread(&mut self, count: u64) -> Result<(), ImportError> {
        let (path, cancel) = (self.libraries.path.clone(), &self.libraries.cancel);
        let unread = |source| SourceError::Read { path: path.clone(), source };
        let (budget, fail_points) = (&self.store.budget, self.store.workdir.fail_points());
        let tap = Tap::open(&Supply::file(&path)?, fail_points, cancel).map_err(unread)?;
        let opened = stream::open(&tap, 0, budget.available_for_work()).map_err(unread)?;
        let _window = budget.reserve_work("the window of a zstd stream", opened.window)?;

        let mut lines = Joined::new(opened.stream);
        while self.len() < count && lines.advance()? {
            let mut words = words(meaning(lines.current()));
            if words.next() == Some(b"vt") {
                self.coordinate(words)?;
            }
        }
        Ok(())
    }

    /// A `vt` statement. What is no number is nowhere, and corners that name it have no coordinate.
    pub(super) fn coordinate<'a>(
        &mut self,
        mut words: impl Iterator<Item = &'a [u8]>,
    ) -> Result<(), ImportError> {
        let mut next = || words.next().map_or(Ok(0.0), |word| number(Some(word))).unwrap_or(f32::NAN);
        let uv = [next(), next()];
        Ok(self.coordinates.extend_from_slice(&[uv])?)
    }

    /// A `usemtl` statement.
    pub(super) fn choose(&mut self, name: &[u8]) {
        self.name.clear();
        self.name.extend_from_slice(name);
        self.look_up();
    }

    fn look_up(&mut self) {
        self.surface = self.libraries.surface_of(&self.name).filter(|_| self.is_textured());
    }

    /// Begins a face.
    pub(super) fn begin(&mut self) {
        self.face.clear();
        self.face.extend([0, self.surface.unwrap_or(NONE)]);
    }

    /// A corner of the face, as it is written.
    pub(super) fn corner(&mut self, vertex: u32, word: &[u8]) {
        if self.surface.is_none() {
            return;
        }
        let index =
            word.split(|byte| *byte == b'/').nth(1).and_then(|digits| number::<i64>(Some(digits)).ok());
        let coordinate = index.and_then(|index| match index {
            ..0 => self.len().checked_add_signed(index),
            _ => (index as u64).checked_sub(1),
        });
        self.face.extend([vertex, coordinate.and_then(|at| u32::try_from(at).ok()).unwrap_or(NONE)]);
    }

    /// Keeps the face.
    pub(super) fn end(&mut self) -> Result<(), ImportError> {
        if self.surface.is_some() {
            self.face[0] = self.face.len() as u32 - 1;
            self.faces.extend_from_slice(&self.face)?;
        } else if !self.name.is_empty()
            && !self.unknown.contains(&self.name)
            && self.libraries.surface_of(&self.name).is_none()
        {
            self.libraries.table.count(self.name.len())?;
            self.unknown.insert(self.name.clone());
        }
        Ok(())
    }

    /// All has come.
    pub(super) fn finish(mut self) -> Result<Faces, ImportError> {
        let is_textured = self.is_textured();
        for name in self.unknown.iter().filter(|_| is_textured) {
            let name = excerpt(name);
            let told =
                format!("material '{name}' was in no library when faces named it, which have no image");
            self.libraries.table.lack(told)?;
        }
        Ok(Faces {
            coordinates: Cached::new(self.coordinates.finish_column()?),
            faces: self.faces.finish_column()?,
            libraries: self.libraries,
            at: 0,
            scratch: Vec::new(),
            cutter: Cutter::default(),
            corners: Vec::new(),
            uv: Vec::new(),
        })
    }
}

/// Faces whose coordinates are known.
pub(super) struct Faces {
    pub(super) libraries: Libraries,
    coordinates: Cached<[f32; 2]>,
    faces: Column<u32>,
    at: usize,
    scratch: Vec<u32>,
    cutter: Cutter,
    corners: Vec<u32>,
    uv: Vec<[f32; 2]>,
}

impl Faces {
    /// Hands over those that come next; false if none are left.
    pub(super) fn next(&mut self, out: &mut Vec<TexturedTriangle>) -> Result<bool, ImportError> {
        if self.at >= self.faces.len() {
            return Ok(false);
        }
        let mut scratch = std::mem::take(&mut self.scratch);
        let window = self.at..self.faces.len().min(self.at + WINDOW);
        let mut faces = self.faces.read(window, &mut scratch)?.to_vec();
        if faces[0] as usize >= faces.len() {
            faces = self.faces.read(self.at..self.at + 1 + faces[0] as usize, &mut scratch)?.to_vec();
        }
        for face in crate::polygon::each(&faces) {
            self.at += 1 + face.len();
            self.face(face, out)?;
            if out.len() >= Batch::FULL {
                break;
            }
        }
        self.scratch = scratch;
        Ok(true)
    }

    fn face(&mut self, face: &[u32], out: &mut Vec<TexturedTriangle>) -> Result<(), ImportError> {
        let surface = &self.libraries.surfaces[face[0] as usize];
        self.corners.clear();
        self.uv.clear();
        for [vertex, coordinate] in face[1..].as_chunks::<2>().0 {
            let uv = self.coordinates.get(*coordinate as usize)?.unwrap_or([f32::NAN; 2]);
            self.corners.push(*vertex);
            self.uv.push([0, 1].map(|axis| uv[axis] * surface.scale[axis] + surface.offset[axis]));
        }

        let is_placed = self.uv.as_flattened().iter().all(|x| x.is_finite());
        let material = match &surface.paint {
            Paint::One(material) if is_placed => *material,
            Paint::Tiles(tiles, missing) if is_placed => {
                let tile = to_tile(&mut self.uv);
                tile.and_then(|tile| tiles.get(&tile)).copied().unwrap_or(*missing)
            }
            _ => surface.plain,
        };
        if !is_placed {
            self.uv.fill([0.0; 2]);
        }
        self.cutter.cut(&self.corners, &self.uv, material, out);
        Ok(())
    }
}

/// The number of the tile that the middle of some coordinates is in, which are relative to its corner from then on.
fn to_tile(uv: &mut [[f32; 2]]) -> Option<u16> {
    let count = uv.len() as f64;
    let [u, v] = [0, 1].map(|axis| (uv.iter().map(|uv| f64::from(uv[axis])).sum::<f64>() / count).floor());
    if !(0.0..10.0).contains(&u) || !(0.0..900.0).contains(&v) {
        return None;
    }
    uv.iter_mut().for_each(|uv| *uv = [uv[0] - u as f32, uv[1] - v as f32]);
    Some(1001 + u as u16 + 10 * v as u16)
}
