//! Packed pages: every bit of a page in less than half of its bytes. FORMAT.md, "Packed page", says what each byte means.
//!
//! Triangles come first, as a walk from each to the next (`connect`). Numbers that belong to vertices are then told in the order of the
//! walk, as differences from what the vertices before make likely. zstd makes the symbols short.

mod bits;
mod connect;
mod follow;
mod view;

use crate::error::{FormatError, Place, invalid, require_eq};
use crate::page::{PAGE_HEADER_LEN, Page, PageHeader};
use bits::{BitReader, BitWriter, difference_of, put_difference, unfold};
use bytemuck::Zeroable;
use chpm_mesh::{Attributes, ClusterId, Octahedral};
use connect::{NONE, Writer};
use follow::Follower;
use std::cell::RefCell;
use std::io;
use std::mem;
use view::{View, turned};
use zstd::stream::raw::{CParameter, Encoder, InBuffer, Operation, OutBuffer};

/// First four bytes of a packed page, "CPGP".
pub const PACKED_MAGIC: u32 = u32::from_le_bytes(*b"CPGP");
/// A page is at most so many times as long as it is packed, so that what a reader allocates has a bound by the file's length.
pub(crate) const MOST_TIMES: usize = 64;
/// The head of a packed page: that of the page up to what is reserved, the view of the positions, and the lengths of the open bits.
const HEAD_LEN: usize = 48;
const KEPT: usize = mem::offset_of!(PageHeader, reserved);
/// Higher ones find next to nothing more in symbols.
const LEVEL: i32 = 1;

/// What a packed page does not keep to.
#[derive(Clone, Copy, Debug)]
struct Damage(&'static str);

impl From<Damage> for FormatError {
    fn from(damage: Damage) -> Self {
        invalid(PLACE, "packed page", damage.0, "another")
    }
}

const PLACE: Place = Place::Page(ClusterId::NONE);

/// Arrays of numbers that belong to vertices, other than positions: how many numbers a vertex has in each.
fn arrays(attributes: Attributes) -> impl Iterator<Item = usize> {
    let normals = attributes.normals.then_some(3).or(attributes.octahedral.then_some(2));
    normals.into_iter().chain(attributes.colors.then_some(4))
}

/// Symbols of a page at most: those of triangles are as many as there are, or three more for each.
fn most_symbols(header: &PageHeader, attributes: Attributes) -> usize {
    let (v, t) = (header.vertex_count as usize, header.triangle_count as usize);
    let numbers: usize = arrays(attributes).sum();
    let collapses = v - header.base_vertex_count as usize;
    4 * t + v * (1 + 3 + numbers) + 2 * collapses + header.shared_count as usize + v.div_ceil(8)
}

/// The end of a stream.
#[derive(Clone, Copy, Default)]
struct Part {
    symbols: usize,
    bits: u64,
    written: usize,
}

/// What packing works with, kept from page to page.
struct Packer {
    writer: Writer,
    walk_bits: BitWriter,
    bits: BitWriter,
    symbols: Vec<u8>,
    /// Where zstd begins anew, with statistics of its own; the open bits up to there; the bytes that zstd had written.
    parts: Vec<Part>,
    numbers: Vec<u32>,
    zstd: Encoder<'static>,
}

/// What unpacking works with.
struct Unpacker {
    walk: Follower,
    symbols: Vec<u8>,
    /// Vertex of each rank, and rank of each vertex.
    order: Vec<u16>,
    ranks: Vec<u16>,
    numbers: Vec<u32>,
    zstd: zstd::bulk::Decompressor<'static>,
}

thread_local! {
    static PACKER: RefCell<Option<Packer>> = const { RefCell::new(None) };
    static UNPACKER: RefCell<Option<Unpacker>> = const { RefCell::new(None) };
}

/// Appends the packed form of a page and answers whether there is one that is shorter than the page itself; else `out` is as before.
///
/// # Errors
/// What [`Page::parse`] refuses; [`FormatError::Write`] where zstd fails.
pub fn pack(raw: &[u8], out: &mut Vec<u8>) -> Result<bool, FormatError> {
    let page = Page::parse(raw)?;
    if raw[KEPT..PAGE_HEADER_LEN].iter().any(|byte| *byte != 0) {
        return Ok(false);
    }
    let start = out.len();
    with_packer(|packer| packer.pack(raw, &page, out))?;
    let len = out.len() - start;
    let shorter = len < raw.len() && raw.len() <= MOST_TIMES * len;
    if !shorter {
        out.truncate(start);
    }
    Ok(shorter)
}

/// Bits of a page's packed form by what they are for, in the order of [`PARTS`].
///
/// # Errors
/// As [`pack`].
pub fn sizes(raw: &[u8]) -> Result<[u64; PARTS.len()], FormatError> {
    let page = Page::parse(raw)?;
    with_packer(|packer| {
        packer.pack(raw, &page, &mut Vec::new())?;
        Ok(packer.sizes(page.attributes()))
    })
}

/// What the bytes of a page are for; [`Page::sizes`] has those of one that is not packed.
pub const PARTS: [&str; 8] = [
    "positions",
    "connectivity",
    "order of vertices",
    "collapses",
    "error codes",
    "shared vertices",
    "attributes",
    "heads",
];

fn with_packer<T>(work: impl FnOnce(&mut Packer) -> io::Result<T>) -> Result<T, FormatError> {
    PACKER.with_borrow_mut(|packer| {
        let packer = match packer {
            Some(packer) => packer,
            None => packer.insert(Packer::new()?),
        };
        Ok(work(packer)?)
    })
}

/// Fills `raw` with the page of a packed one, which must be as long as the packed page's counts say.
///
/// # Errors
/// [`FormatError::Value`] where the bytes are no packed page of that length. What comes out is a page as long as it should be, but its
/// content is to be checked like that of any other.
pub fn unpack(packed: &[u8], raw: &mut [u8]) -> Result<(), FormatError> {
    UNPACKER.with_borrow_mut(|unpacker| {
        let unpacker = match unpacker {
            Some(unpacker) => unpacker,
            None => unpacker.insert(Unpacker::new()?),
        };
        unpacker.unpack(packed, raw)
    })
}

/// Short repetitions in symbols are chance, and take longer to decode than they save.
fn encoder() -> io::Result<Encoder<'static>> {
    let mut encoder = Encoder::new(LEVEL)?;
    encoder.set_parameter(CParameter::MinMatch(7))?;
    Ok(encoder)
}

impl Packer {
    fn new() -> io::Result<Self> {
        Ok(Packer {
            writer: Writer::default(),
            walk_bits: BitWriter::default(),
            bits: BitWriter::default(),
            symbols: Vec::new(),
            parts: Vec::new(),
            numbers: Vec::new(),
            zstd: encoder()?,
        })
    }

    fn pack(&mut self, raw: &[u8], page: &Page<'_>, out: &mut Vec<u8>) -> io::Result<()> {
        self.symbols.clear();
        self.parts.clear();
        self.walk_bits.clear();
        self.bits.clear();
        self.writer.write(page.triangles, page.vertex_count(), &mut self.walk_bits);
        self.put_order(page.base_vertex_count);
        let written = &self.writer.symbols;
        for stream in [&written.edges, &written.thirds, &written.corners] {
            self.symbols.extend_from_slice(stream);
            self.parts.push(Part { symbols: self.symbols.len(), bits: self.bits.count(), written: 0 });
        }
        let view = self.put_positions(page.positions);
        if !page.normals.is_empty() {
            self.put_array(
                page.normals.iter().map(|n| n.map(|x| View::Binary.integer(x).unwrap_or_default())),
                middle,
            );
        }
        if !page.octahedral.is_empty() {
            self.put_array(page.octahedral.iter().map(|n| n.steps()), middle);
        }
        if !page.colors.is_empty() {
            self.put_array(page.colors.iter().map(|c| c.map(u32::from)), middle);
        }
        self.put_collapses(page);

        let head = out.len();
        out.extend_from_slice(&PACKED_MAGIC.to_le_bytes());
        out.extend_from_slice(&raw[4..KEPT]);
        out.extend_from_slice(&view.bytes());
        out.extend_from_slice(&[0; 2]);
        let open = [&mut self.walk_bits, &mut self.bits];
        for bits in open {
            bits.finish();
            out.extend_from_slice(&(bits.bytes.len() as u32).to_le_bytes());
        }
        debug_assert_eq!(out.len() - head, HEAD_LEN);
        out.extend_from_slice(&self.walk_bits.bytes);
        out.extend_from_slice(&self.bits.bytes);
        self.compress(out)
    }

    /// Ends a stream of symbols.
    fn end_part(&mut self) {
        self.parts.push(Part { symbols: self.symbols.len(), bits: self.bits.count(), written: 0 });
    }

    /// Bits of the page that was packed last, by [`PARTS`].
    fn sizes(&self, attributes: Attributes) -> [u64; PARTS.len()] {
        let mut sizes = [0; PARTS.len()];
        let arrays = arrays(attributes).map(|_| 6);
        let kinds = [2, 1, 1, 1, 0].into_iter().chain(arrays).chain([3, 4, 5, 5]);
        let mut before = Part::default();
        for (part, kind) in self.parts.iter().zip(kinds) {
            sizes[kind] += part.bits - before.bits + 8 * (part.written - before.written) as u64;
            before = *part;
        }
        sizes[1] += 8 * self.walk_bits.bytes.len() as u64;
        sizes[7] = 8 * HEAD_LEN as u64;
        sizes
    }

    /// The vertex of each rank: one of the base mesh by the difference to the last of these, another as it is.
    fn put_order(&mut self, base: usize) {
        let len = index_len(self.writer.order.len() - base);
        let mut last = 0;
        for vertex in self.writer.order.iter().copied().map(u32::from) {
            match vertex.checked_sub(base as u32) {
                Some(index) => {
                    self.symbols.push(ELSEWHERE);
                    self.bits.put(index, len);
                }
                None => {
                    put_difference(vertex.wrapping_sub(last), &mut self.symbols, &mut self.bits);
                    last = vertex;
                }
            }
        }
        self.end_part();
    }

    fn put_positions(&mut self, positions: &[[f32; 3]]) -> View {
        let view = View::decimal_of(positions.as_flattened()).unwrap_or(View::Binary);
        self.put_array(positions.iter().map(|p| p.map(|x| view.integer(x).unwrap_or_default())), across);
        view
    }

    /// Numbers of vertices, `N` each, as differences from a guess.
    fn put_array<const N: usize>(
        &mut self,
        of: impl ExactSizeIterator<Item = [u32; N]>,
        guess: fn(u32, u32, u32) -> u32,
    ) {
        self.numbers.clear();
        self.numbers.extend(of.flatten());
        let vertices: &[[u32; N]] = self.numbers.as_chunks().0;
        let order = &self.writer.order;
        for (rank, (vertex, g)) in order.iter().zip(&self.writer.walk.guesses).enumerate() {
            let at = |rank: u16| vertices[usize::from(order[usize::from(rank)])];
            let (a, b, c) = if rank == 0 { ([0; N], [0; N], [0; N]) } else { (at(g.a), at(g.b), at(g.c)) };
            let own = vertices[usize::from(*vertex)];
            for i in 0..N {
                put_difference(
                    own[i].wrapping_sub(guess(a[i], b[i], c[i])),
                    &mut self.symbols,
                    &mut self.bits,
                );
            }
        }
        self.end_part();
    }

    fn put_collapses(&mut self, page: &Page<'_>) {
        let ranks = &self.writer.ranks;
        for (from, to) in ranks[page.base_vertex_count..].iter().zip(page.targets) {
            let difference = u32::from(ranks[usize::from(*to)]).wrapping_sub((*from).into());
            put_difference(difference, &mut self.symbols, &mut self.bits);
        }
        self.end_part();
        let mut last = 0;
        for code in page.error_codes.iter().rev().copied().map(u32::from) {
            put_difference(code.wrapping_sub(last), &mut self.symbols, &mut self.bits);
            last = code;
        }
        self.end_part();
        let mut last = 0;
        for id in page.shared_ids {
            put_difference(id.wrapping_sub(last), &mut self.symbols, &mut self.bits);
            last = *id;
        }
        self.end_part();
        self.symbols.extend_from_slice(page.shared_bits);
        self.end_part();
    }

    fn compress(&mut self, out: &mut Vec<u8>) -> io::Result<()> {
        let (start, total) = (out.len(), self.symbols.len());
        out.resize(start + zstd::zstd_safe::compress_bound(total) + 64 * self.parts.len(), 0);
        self.zstd.reinit()?;
        self.zstd.set_pledged_src_size(Some(total as u64))?;
        let mut buffer = OutBuffer::around(&mut out[start..]);
        let mut from = 0;
        let last = self.parts.len() - 1;
        for (index, part) in self.parts.iter_mut().enumerate() {
            let mut input = InBuffer::around(&self.symbols[from..part.symbols]);
            while input.pos() < part.symbols - from {
                self.zstd.run(&mut input, &mut buffer)?;
            }
            from = part.symbols;
            if index < last {
                while self.zstd.flush(&mut buffer)? > 0 {}
            } else {
                while self.zstd.finish(&mut buffer, true)? > 0 {}
            }
            part.written = buffer.pos();
        }
        let len = buffer.pos();
        out.truncate(start + len);
        Ok(())
    }
}

/// The symbol of a vertex that is not of the base mesh.
const ELSEWHERE: u8 = 33;

/// Bits that an index below `count` needs.
fn index_len(count: usize) -> u32 {
    usize::BITS - count.saturating_sub(1).leading_zeros()
}

/// The fourth corner of a parallelogram.
fn across(a: u32, b: u32, c: u32) -> u32 {
    a.wrapping_add(b).wrapping_sub(c)
}

/// Half way between two.
fn middle(a: u32, b: u32, _: u32) -> u32 {
    ((i64::from(a as i32) + i64::from(b as i32)) >> 1) as u32
}

impl Unpacker {
    fn new() -> io::Result<Self> {
        Ok(Unpacker {
            walk: Follower::new(),
            symbols: Vec::new(),
            order: Vec::new(),
            ranks: Vec::new(),
            numbers: Vec::new(),
            zstd: zstd::bulk::Decompressor::new()?,
        })
    }

    fn unpack(&mut self, packed: &[u8], raw: &mut [u8]) -> Result<(), FormatError> {
        let (head, rest) = packed.split_at_checked(HEAD_LEN).ok_or(FormatError::Truncated {
            place: PLACE,
            expected: HEAD_LEN as u64,
            got: packed.len() as u64,
        })?;
        let header = self.header(head)?;
        let attributes = header.check()?;
        require_eq(PLACE, "length of the page", header.payload_len(), raw.len() as u64)?;
        let (how, lens) = head[KEPT..].split_at(4);
        let view = View::of_bytes([how[0], how[1]]).filter(|_| how[2..] == [0; 2]);
        let view = view.ok_or(Damage("a view that is known"))?;
        let len = |i: usize| u32::from_le_bytes(lens.as_chunks().0[i]) as usize;
        let (walk_bits, rest) = rest.split_at_checked(len(0)).ok_or(Damage("open bits within the page"))?;
        let (bits, frame) = rest.split_at_checked(len(1)).ok_or(Damage("open bits within the page"))?;
        let (mut walk_bits, mut bits) = (BitReader::new(walk_bits), BitReader::new(bits));
        let mut symbols = mem::take(&mut self.symbols);
        self.expand(frame, most_symbols(&header, attributes), &mut symbols)?;
        let mut streams = Streams(&symbols);

        let (head, body) = raw.split_at_mut(PAGE_HEADER_LEN);
        let of_codes = if attributes.octahedral { 3 * header.vertex_count as usize } else { 0 };
        let (mut body, octahedral) = body.split_at_mut(body.len() - of_codes);
        head.copy_from_slice(bytemuck::bytes_of(&header));
        let (v, t) = (header.vertex_count as usize, header.triangle_count as usize);
        let (base, shared) = (header.base_vertex_count as usize, header.shared_count as usize);
        let collapses = v - base;
        self.read_order(streams.next(v)?, base, &mut bits)?;
        let edges = streams.next(t)?;
        let apart = edges.iter().filter(|symbol| **symbol == 0).count();
        let corners = streams.next(t + 2 * apart)?;

        let positions = take(&mut body, 12 * v);
        let carried = |is_carried, len| if is_carried { len * v } else { 0 };
        let normals = take(&mut body, carried(attributes.normals, 12));
        let colors = take(&mut body, carried(attributes.colors, 4));
        let ids = take(&mut body, 4 * shared);
        let triangles = take(&mut body, 6 * t).as_chunks_mut().0;
        self.walk.read(&self.order, (edges, apart, corners), &mut walk_bits, triangles)?;
        walk_bits.finish()?;
        self.read_array::<3>(streams.next(3 * v)?, across, &mut bits);
        self.put_floats(positions, view)?;
        if attributes.normals {
            self.read_array::<3>(streams.next(3 * v)?, middle, &mut bits);
            self.put_floats(normals, View::Binary)?;
        }
        if attributes.octahedral {
            self.read_array::<2>(streams.next(2 * v)?, middle, &mut bits);
            let steps: &[[u32; 2]] = self.numbers.as_chunks().0;
            let out: &mut [Octahedral] = bytemuck::cast_slice_mut(octahedral);
            out.iter_mut().zip(steps).for_each(|(normal, steps)| *normal = Octahedral::from_steps(*steps));
        }
        if attributes.colors {
            self.read_array::<4>(streams.next(4 * v)?, middle, &mut bits);
            colors.iter_mut().zip(&self.numbers).for_each(|(byte, number)| *byte = *number as u8);
        }
        self.read_targets(streams.next(collapses)?, base, take(&mut body, 2 * collapses), &mut bits)?;
        let mut last = 0u32;
        let codes: &mut [[u8; 2]] = take(&mut body, 2 * collapses).as_chunks_mut().0;
        for (symbol, code) in streams.next(collapses)?.iter().zip(codes.iter_mut().rev()) {
            last = last.wrapping_add(bits.difference(*symbol));
            *code = (last as u16).to_le_bytes();
        }
        let mut last = 0u32;
        let ids: &mut [[u8; 4]] = ids.as_chunks_mut().0;
        for (symbol, id) in streams.next(shared)?.iter().zip(ids) {
            last = last.wrapping_add(bits.difference(*symbol));
            *id = last.to_le_bytes();
        }
        body.copy_from_slice(streams.next(v.div_ceil(8))?);
        let all = streams.0.is_empty();
        self.symbols = symbols;
        if !all {
            return Err(Damage("no more symbols than the page has").into());
        }
        Ok(bits.finish()?)
    }

    fn header(&self, head: &[u8]) -> Result<PageHeader, FormatError> {
        let mut header = PageHeader::zeroed();
        bytemuck::bytes_of_mut(&mut header)[..KEPT].copy_from_slice(&head[..KEPT]);
        if header.magic != PACKED_MAGIC {
            return Err(invalid(PLACE, "magic", "\"CPGP\"", format_args!("{:08x}", header.magic)));
        }
        header.magic = crate::page::PAGE_MAGIC;
        Ok(header)
    }

    fn expand(&mut self, frame: &[u8], most: usize, symbols: &mut Vec<u8>) -> Result<(), FormatError> {
        symbols.clear();
        symbols.reserve(most);
        let expanded = self.zstd.decompress_to_buffer(frame, symbols);
        expanded.map_err(|error| {
            invalid(PLACE, "packed page", "a frame of zstd that holds its symbols", error)
        })?;
        Ok(())
    }

    fn read_order(&mut self, symbols: &[u8], base: usize, bits: &mut BitReader<'_>) -> Result<(), Damage> {
        let count = symbols.len();
        let len = index_len(count - base);
        self.ranks.clear();
        self.ranks.resize(count, NONE);
        self.order.clear();
        let mut last = 0u32;
        for (rank, symbol) in (0..).zip(symbols) {
            // Either of the two is as likely.
            let elsewhere = *symbol == ELSEWHERE;
            let (open, high) = difference_of(*symbol);
            let open = bits.take(if elsewhere { len } else { open });
            let next = last.wrapping_add(unfold(open | high));
            let vertex = if elsewhere { base as u32 + open } else { next };
            last = if elsewhere { last } else { next };
            match self.ranks.get_mut(vertex as usize) {
                Some(place) if *place == NONE => *place = rank,
                _ => return Err(Damage("every vertex once")),
            }
            self.order.push(vertex as u16);
        }
        Ok(())
    }

    /// Numbers of vertices.
    fn read_array<const N: usize>(
        &mut self,
        symbols: &[u8],
        guess: impl Fn(u32, u32, u32) -> u32,
        bits: &mut BitReader<'_>,
    ) {
        self.numbers.clear();
        self.numbers.resize(symbols.len(), 0);
        let vertices: &mut [[u32; N]] = self.numbers.as_chunks_mut().0;
        let symbols = symbols.as_chunks::<N>().0;
        for (symbols, [vertex, a, b, c]) in symbols.iter().zip(self.walk.guesses(symbols.len())) {
            // The first is guessed from itself, which is zero until it is known.
            let at = |vertex: &u16| vertices[usize::from(*vertex)];
            let (a, b, c) = (at(a), at(b), at(c));
            let differences = bits.differences(symbols);
            let own = &mut vertices[usize::from(*vertex)];
            for i in 0..N {
                own[i] = guess(a[i], b[i], c[i]).wrapping_add(differences[i]);
            }
        }
    }

    fn put_floats(&self, out: &mut [u8], view: View) -> Result<(), Damage> {
        let out: &mut [[u8; 4]] = out.as_chunks_mut().0;
        if view == View::Binary {
            for (number, bytes) in self.numbers.iter().zip(out) {
                *bytes = turned(*number).to_le_bytes();
            }
            return Ok(());
        }
        for (number, bytes) in self.numbers.iter().zip(out) {
            *bytes = view.float(*number).ok_or(Damage("a decimal number within bounds"))?.to_le_bytes();
        }
        Ok(())
    }

    fn read_targets(
        &self,
        symbols: &[u8],
        base: usize,
        out: &mut [u8],
        bits: &mut BitReader<'_>,
    ) -> Result<(), Damage> {
        let out: &mut [[u8; 2]] = out.as_chunks_mut().0;
        for ((symbol, from), target) in symbols.iter().zip(&self.ranks[base..]).zip(out) {
            let rank = u32::from(*from).wrapping_add(bits.difference(*symbol));
            let vertex = self.order.get(rank as usize).ok_or(Damage("a target that there is"))?;
            *target = vertex.to_le_bytes();
        }
        Ok(())
    }
}

/// Streams of symbols that follow one another.
struct Streams<'a>(&'a [u8]);

impl<'a> Streams<'a> {
    fn next(&mut self, len: usize) -> Result<&'a [u8], Damage> {
        self.0.split_off(..len).ok_or(Damage("as many symbols as the page has numbers"))
    }
}

/// Splits off what the caller knows to be there.
fn take<'a>(bytes: &mut &'a mut [u8], len: usize) -> &'a mut [u8] {
    bytes.split_off_mut(..len).unwrap_or_default()
}
