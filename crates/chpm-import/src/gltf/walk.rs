//! Walks over the vertices and the triangles of a scene, window by window.

use super::accessor::{Elements, Reader, WINDOW};
use super::coats::Coat;
use super::parts::{Mode, Parts, Placed};
use super::scene::Placement;
use crate::error::ImportError;

/// Vertices of the scene, one set after the other.
#[derive(Default)]
pub(super) struct VertexWalk {
    instance: usize,
    set: usize,
    /// Vertices of the instances before.
    before: u64,
    open: Option<OpenSet>,
}

struct OpenSet {
    placement: Placement,
    of_normals: Placement,
    /// The vertex that comes next, and how many are left.
    next: u64,
    left: u64,
    positions: Option<Reader>,
    normals: Option<Reader>,
    colors: Option<Reader>,
    coordinates: Option<Reader>,
}

/// Some vertices; what was not asked for, or is not there, is empty.
#[derive(Default)]
pub(super) struct Window {
    /// The number of the first one in the scene.
    pub(super) first: u64,
    /// Where they are placed.
    pub(super) positions: Vec<[f64; 3]>,
    pub(super) normals: Vec<[f64; 3]>,
    pub(super) colors: Vec<[u8; 4]>,
    /// Texture coordinates.
    pub(super) coordinates: Vec<[f32; 2]>,
}

/// Which attributes of vertices to read.
#[derive(Clone, Copy, Default)]
pub(super) struct Wanted {
    pub(super) positions: bool,
    pub(super) normals: bool,
    pub(super) colors: bool,
    pub(super) coordinates: bool,
}

impl VertexWalk {
    /// The next vertices, with what of them is `wanted`. None behind the last.
    pub(super) fn next(&mut self, parts: &Parts, wanted: Wanted) -> Result<Option<Window>, ImportError> {
        loop {
            if let Some(open) = self.open.as_mut().filter(|open| open.left > 0) {
                return open.read().map(Some);
            }
            self.set += usize::from(self.open.take().is_some());
            if self.instance == parts.instances.len() {
                return Ok(None);
            }
            match parts.sets(self.instance, self.before).nth(self.set) {
                Some(placed) => self.open = Some(OpenSet::new(&placed, wanted)),
                None => {
                    self.before += parts.len(self.instance);
                    (self.instance, self.set) = (self.instance + 1, 0);
                }
            }
        }
    }
}

impl OpenSet {
    fn new(placed: &Placed<'_>, wanted: Wanted) -> OpenSet {
        let Placed { set, placement, first } = *placed;
        OpenSet {
            placement: *placement,
            of_normals: placement.of_normals(),
            next: first,
            left: set.positions.count,
            positions: wanted.positions.then(|| set.positions.reader()),
            normals: set.normals.as_ref().filter(|_| wanted.normals).map(Elements::reader),
            colors: set.colors.as_ref().filter(|_| wanted.colors).map(Elements::reader),
            coordinates: set.coordinates.as_ref().filter(|_| wanted.coordinates).map(Elements::reader),
        }
    }

    fn read(&mut self) -> Result<Window, ImportError> {
        let mut window = Window { first: self.next, ..Window::default() };
        let mut numbers = Vec::new();
        let threes = |numbers: &[f64]| numbers.as_chunks::<3>().0.to_vec();
        if let Some(positions) = &mut self.positions {
            positions.read(&mut numbers)?;
            window.positions = threes(&numbers);
            window.positions.iter_mut().for_each(|p| *p = self.placement.point(*p));
        }
        if let Some(normals) = &mut self.normals {
            normals.read(&mut numbers)?;
            window.normals = threes(&numbers);
            window.normals.iter_mut().for_each(|n| *n = self.of_normals.normal(*n));
        }
        if let Some(colors) = &mut self.colors {
            colors.read(&mut numbers)?;
            window.colors = numbers.chunks_exact(colors.width()).map(color).collect();
        }
        if let Some(coordinates) = &mut self.coordinates {
            coordinates.read(&mut numbers)?;
            let twos = numbers.as_chunks::<2>().0.iter();
            window.coordinates = twos.map(|uv| uv.map(|x| x as f32)).collect();
        }
        let count = self.left.min(WINDOW as u64);
        self.next += count;
        self.left -= count;
        Ok(window)
    }
}

/// Eight bits a channel, by the curve of sRGB, since glTF's colours are light; coverage goes by itself.
fn color(numbers: &[f64]) -> [u8; 4] {
    let mut color = [255; 4];
    for (at, (channel, x)) in color.iter_mut().zip(numbers).enumerate() {
        let value = if at < 3 { encoded(*x) } else { *x };
        // The cast clamps, and makes NaN zero.
        *channel = (value * 255.0).round() as u8;
    }
    color
}

/// Light by the curve of sRGB.
pub(super) fn encoded(x: f64) -> f64 {
    if x > 0.003_130_8 { 1.055 * libm::pow(x, 1.0 / 2.4) - 0.055 } else { 12.92 * x }
}

/// A corner: the number of its vertex in the scene; or, out of range, the index and how many vertices there are.
pub(super) type Corner = Result<u32, (u32, u64)>;

/// Triangles of the scene, one primitive after the other.
#[derive(Default)]
pub(super) struct TriangleWalk {
    /// Triangles that were read last.
    pub(super) triangles: Vec<[Corner; 3]>,
    /// Their coat.
    pub(super) coat: Option<Coat>,
    instance: usize,
    primitive: usize,
    before: u64,
    open: Option<OpenPrimitive>,
}

struct OpenPrimitive {
    indices: Option<Reader>,
    mode: Mode,
    is_mirrored: bool,
    /// Of the vertices that it takes corners from.
    first: u64,
    vertices: u64,
    /// Corners that are behind us, and that there are.
    corner: u64,
    corners: u64,
    /// The first corner, and the last two.
    fan: Corner,
    last: [Corner; 2],
}

impl TriangleWalk {
    /// Reads the corners that come next, and makes triangles of them; false behind the last.
    pub(super) fn next(&mut self, parts: &Parts) -> Result<bool, ImportError> {
        self.triangles.clear();
        loop {
            if let Some(open) = self.open.as_mut().filter(|open| open.corner < open.corners) {
                open.read(&mut self.triangles)?;
                return Ok(true);
            }
            self.primitive += usize::from(self.open.take().is_some());
            if self.instance == parts.instances.len() {
                return Ok(false);
            }
            match parts.triangles(self.instance, self.before).nth(self.primitive) {
                Some((primitive, placed)) => {
                    self.coat = primitive.coat;
                    self.open = Some(OpenPrimitive {
                        indices: primitive.indices.as_ref().map(|indices| indices.reader()),
                        mode: primitive.mode,
                        is_mirrored: placed.placement.is_mirrored(),
                        first: placed.first,
                        vertices: placed.set.positions.count,
                        corner: 0,
                        corners: primitive.corners,
                        fan: Ok(0),
                        last: [Ok(0); 2],
                    });
                }
                None => {
                    self.before += parts.len(self.instance);
                    (self.instance, self.primitive) = (self.instance + 1, 0);
                }
            }
        }
    }
}

impl OpenPrimitive {
    fn read(&mut self, triangles: &mut Vec<[Corner; 3]>) -> Result<(), ImportError> {
        let mut numbers = Vec::new();
        match &mut self.indices {
            Some(indices) => _ = indices.read(&mut numbers)?,
            None => {
                let end = self.corners.min(self.corner + WINDOW as u64);
                numbers.extend((self.corner..end).map(|corner| corner as f64));
            }
        }
        for index in numbers {
            let is_in_range = (index as u64) < self.vertices;
            let vertex = (self.first + index as u64) as u32;
            self.take(if is_in_range { Ok(vertex) } else { Err((index as u32, self.vertices)) }, triangles);
        }
        Ok(())
    }

    fn take(&mut self, corner: Corner, triangles: &mut Vec<[Corner; 3]>) {
        let [a, b] = self.last;
        let triangle = match self.mode {
            Mode::Triangles => (self.corner % 3 == 2).then_some([a, b, corner]),
            Mode::Strip if self.corner % 2 == 1 => Some([a, corner, b]),
            Mode::Strip => Some([a, b, corner]),
            Mode::Fan => Some([b, corner, self.fan]),
        };
        if let Some([a, b, c]) = triangle.filter(|_| self.corner >= 2) {
            triangles.push(if self.is_mirrored { [a, c, b] } else { [a, b, c] });
        }
        if self.corner == 0 {
            self.fan = corner;
        }
        self.last = [b, corner];
        self.corner += 1;
    }
}
