//! `EXT_meshopt_compression`: the three codecs and the filters, total on any bytes.
//!
//! Written after the extension's specification; what the encoders of the library make is read back in the tests.

use super::document::{Compressed, Filter, Mode, refused};
use crate::error::ImportError;

/// Vertices of a block share a baseline; bytes of a group share a width.
const BLOCK_BYTES: usize = 8192;
const MOST_BLOCK: usize = 256;
const GROUP: usize = 16;
/// Bytes at the end of compressed vertices, at least.
const LEAST_TAIL: usize = 32;

/// The bytes of a view. `None` if the data is damaged.
pub(super) fn decode(bytes: &[u8], view: &Compressed) -> Result<Vec<u8>, ImportError> {
    let (count, stride) = (view.count as usize, view.byte_stride as usize);
    let damaged = || refused("its meshopt data is damaged; copy the file again");
    let is_fit = match view.mode {
        Mode::Attributes => stride.is_multiple_of(4) && (4..=256).contains(&stride),
        Mode::Triangles => (stride == 2 || stride == 4) && count.is_multiple_of(3),
        Mode::Indices => stride == 2 || stride == 4,
    };
    if !is_fit || (view.mode != Mode::Attributes && view.filter != Filter::None) {
        return Err(refused(format!(
            "a meshopt view of mode {:?} cannot have a stride of {stride}",
            view.mode
        )));
    }
    let mut out = match view.mode {
        Mode::Attributes => vertices(bytes, count, stride),
        Mode::Triangles => triangles(bytes, count).map(|indices| narrowed(&indices, stride)),
        Mode::Indices => sequence(bytes, count).map(|indices| narrowed(&indices, stride)),
    }
    .ok_or_else(damaged)?;
    match (view.filter, stride) {
        (Filter::None, _) => {}
        (Filter::Octahedral, 4) => out.chunks_exact_mut(4).for_each(octahedral_8),
        (Filter::Octahedral, 8) => out.chunks_exact_mut(8).for_each(octahedral_16),
        (Filter::Exponential, _) => out.chunks_exact_mut(4).for_each(exponential),
        (filter, _) => return Err(refused(format!("meshopt's filter {filter:?} is not read for vertices"))),
    }
    Ok(out)
}

fn narrowed(indices: &[u32], stride: usize) -> Vec<u8> {
    match stride {
        2 => indices.iter().flat_map(|index| (*index as u16).to_le_bytes()).collect(),
        _ => indices.iter().flat_map(|index| index.to_le_bytes()).collect(),
    }
}

/// Bytes that are read front to back.
struct Cursor<'a>(&'a [u8]);

impl<'a> Cursor<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    fn byte(&mut self) -> Option<u8> {
        Some(self.take(1)?[0])
    }

    /// A number of up to five bytes of seven bits.
    fn number(&mut self) -> Option<u32> {
        let mut value = 0;
        for shift in [0, 7, 14, 21, 28] {
            let byte = self.byte()?;
            value |= u32::from(byte & 127) << shift;
            if byte < 128 {
                break;
            }
        }
        Some(value)
    }

    /// A number as its difference to `last`.
    fn index(&mut self, last: u32) -> Option<u32> {
        Some(last.wrapping_add(unfolded(self.number()?)))
    }
}

/// A signed number from one whose lowest bit is the sign.
fn unfolded(value: u32) -> u32 {
    (value >> 1) ^ 0u32.wrapping_sub(value & 1)
}

/// Vertices: byte by byte through a block, each as its difference to that of the vertex before.
fn vertices(bytes: &[u8], count: usize, stride: usize) -> Option<Vec<u8>> {
    let (&header, rest) = bytes.split_first()?;
    if header != 0xa0 {
        return None;
    }
    let tail = stride.max(LEAST_TAIL);
    let body = rest.len().checked_sub(tail)?;
    let mut last = rest[rest.len() - stride..].to_vec();
    let mut data = Cursor(&rest[..body]);
    let block = (BLOCK_BYTES / stride / GROUP * GROUP).min(MOST_BLOCK);

    let mut out = Vec::new();
    let mut deltas = [0; MOST_BLOCK];
    let mut done = 0;
    while done < count {
        let vertices = block.min(count - done);
        let start = out.len();
        out.resize(start + vertices * stride, 0);
        for (channel, last) in last.iter_mut().enumerate() {
            unpack(&mut data, &mut deltas[..vertices.next_multiple_of(GROUP)])?;
            for (vertex, delta) in deltas[..vertices].iter().enumerate() {
                let delta = (delta >> 1) ^ 0u8.wrapping_sub(delta & 1);
                *last = last.wrapping_add(delta);
                out[start + vertex * stride + channel] = *last;
            }
        }
        done += vertices;
    }
    data.0.is_empty().then_some(out)
}

/// Groups of 16 bytes, each of which has a width of 0, 2, 4 or 8 bits.
fn unpack(data: &mut Cursor<'_>, out: &mut [u8]) -> Option<()> {
    let widths = data.take((out.len() / GROUP).div_ceil(4))?;
    for (group, bytes) in out.chunks_exact_mut(GROUP).enumerate() {
        match widths[group / 4] >> (group % 4 * 2) & 3 {
            0 => bytes.fill(0),
            1 => narrow(data, bytes, 2)?,
            2 => narrow(data, bytes, 4)?,
            _ => bytes.copy_from_slice(data.take(GROUP)?),
        }
    }
    Some(())
}

/// Bytes of a few bits; the greatest says that the byte comes whole, behind all of them.
fn narrow(data: &mut Cursor<'_>, out: &mut [u8], bits: usize) -> Option<()> {
    let packed = data.take(GROUP * bits / 8)?;
    let greatest = (1 << bits) - 1;
    for (at, byte) in out.iter_mut().enumerate() {
        let shift = 8 - bits - at * bits % 8;
        let value = packed[at * bits / 8] >> shift & greatest;
        *byte = if value == greatest { data.byte()? } else { value };
    }
    Some(())
}

/// Edges and vertices of the triangles before, which the next one may share.
struct Fifos {
    edges: [[u32; 2]; 16],
    edge: usize,
    vertices: [u32; 16],
    vertex: usize,
}

impl Fifos {
    fn push_edge(&mut self, edge: [u32; 2]) {
        self.edges[self.edge] = edge;
        self.edge = (self.edge + 1) % 16;
    }

    fn push_vertex(&mut self, vertex: u32) {
        self.vertices[self.vertex] = vertex;
        self.vertex = (self.vertex + 1) % 16;
    }

    /// The edge that was pushed `back` pushes before the last.
    fn edge(&self, back: u8) -> [u32; 2] {
        self.edges[(self.edge + 15 - usize::from(back)) % 16]
    }

    fn vertex(&self, back: u8) -> u32 {
        self.vertices[(self.vertex + 15 - usize::from(back)) % 16]
    }
}

/// Indices of triangles.
fn triangles(bytes: &[u8], count: usize) -> Option<Vec<u32>> {
    let (&header, rest) = bytes.split_first()?;
    if header & 0xf0 != 0xe0 || header & 15 > 1 {
        return None;
    }
    let least_far = if header & 15 == 1 { 13 } else { 15 };
    let (rest, table) = rest.split_at_checked(rest.len().checked_sub(16)?)?;
    let (codes, data) = rest.split_at_checked(count / 3)?;
    let mut data = Cursor(data);
    let mut fifos = Fifos { edges: [[u32::MAX; 2]; 16], edge: 0, vertices: [u32::MAX; 16], vertex: 0 };
    let (mut next, mut last) = (0u32, 0u32);
    let mut out = Vec::with_capacity(count);
    for &code in codes {
        if code < 0xf0 {
            let [a, b] = fifos.edge(code >> 4);
            let far = code & 15;
            let c = match far {
                0 => {
                    next = next.wrapping_add(1);
                    next.wrapping_sub(1)
                }
                _ if far < least_far => fifos.vertex(far),
                13 => last.wrapping_sub(1),
                14 => last.wrapping_add(1),
                _ => data.index(last)?,
            };
            if far >= least_far {
                last = c;
            }
            if far == 0 || far >= least_far {
                fifos.push_vertex(c);
            }
            fifos.push_edge([c, b]);
            fifos.push_edge([a, c]);
            out.extend([a, b, c]);
            continue;
        }

        let pair = if code < 0xfe { table[usize::from(code & 15)] } else { data.byte()? };
        let kinds = [if code == 0xff { 15 } else { 0 }, pair >> 4, pair & 15];
        if code >= 0xfe && pair == 0 {
            next = 0;
        }
        // New vertices are numbered first, then those of the fifo are looked up, which nothing was pushed to in between.
        let mut corners = [0; 3];
        for (corner, kind) in corners.iter_mut().zip(kinds) {
            *corner = match kind {
                0 => {
                    next = next.wrapping_add(1);
                    next.wrapping_sub(1)
                }
                15 if code >= 0xfe => 0,
                back => fifos.vertex(back - 1),
            };
        }
        for (corner, kind) in corners.iter_mut().zip(kinds) {
            if kind == 15 && code >= 0xfe {
                last = data.index(last)?;
                *corner = last;
            }
        }
        let [a, b, c] = corners;
        for (place, (corner, kind)) in corners.iter().zip(kinds).enumerate() {
            if place == 0 || kind == 0 || kind == 15 && code >= 0xfe {
                fifos.push_vertex(*corner);
            }
        }
        [[b, a], [c, b], [a, c]].into_iter().for_each(|edge| fifos.push_edge(edge));
        out.extend(corners);
    }
    data.0.is_empty().then_some(out)
}

/// Indices in any order.
fn sequence(bytes: &[u8], count: usize) -> Option<Vec<u32>> {
    let (&header, rest) = bytes.split_first()?;
    if header & 0xf0 != 0xd0 || header & 15 > 1 {
        return None;
    }
    let mut data = Cursor(&rest[..rest.len().checked_sub(4)?]);
    let mut last = [0u32; 2];
    let mut out = Vec::new();
    for _ in 0..count {
        let value = data.number()?;
        let last = &mut last[(value & 1) as usize];
        *last = last.wrapping_add(unfolded(value >> 1));
        out.push(*last);
    }
    data.0.is_empty().then_some(out)
}

/// A unit vector from two numbers on an octahedron, and what one is.
fn octahedral(x: f32, y: f32, one: f32, most: f32) -> [f32; 3] {
    let z = one - x.abs() - y.abs();
    let fold = z.min(0.0);
    let x = x + if x >= 0.0 { fold } else { -fold };
    let y = y + if y >= 0.0 { fold } else { -fold };
    let scale = most / (x * x + y * y + z * z).sqrt();
    [x, y, z].map(|v| (v * scale).round())
}

fn octahedral_8(bytes: &mut [u8]) {
    let [x, y, one] = [0, 1, 2].map(|i| f32::from(bytes[i] as i8));
    for (byte, value) in bytes.iter_mut().zip(octahedral(x, y, one, 127.0)) {
        *byte = (value as i8) as u8;
    }
}

fn octahedral_16(bytes: &mut [u8]) {
    let [x, y, one] = [0, 1, 2].map(|i| f32::from(i16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]])));
    for (pair, value) in bytes.chunks_exact_mut(2).zip(octahedral(x, y, one, 32767.0)) {
        pair.copy_from_slice(&(value as i16).to_le_bytes());
    }
}

/// Single precision from a mantissa of 24 bits and an exponent of eight.
fn exponential(bytes: &mut [u8]) {
    let bits = i32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    let value = f64::from(bits << 8 >> 8) * libm::exp2(f64::from(bits >> 24));
    bytes.copy_from_slice(&(value as f32).to_le_bytes());
}
