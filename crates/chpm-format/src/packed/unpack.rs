//! From a packed page to the page itself.

use super::around::NEIGHBORS;
use super::bits::{BitReader, difference_of, unfold};
use super::connect::{NONE, corners_told};
use super::follow::Follower;
use super::streams::Streams;
use super::view::{View, turned};
use super::{
    Damage, ELSEWHERE, HEAD_LEN, KEPT, LEAST_FIRST, PACKED_MAGIC, PLACE, TOLD, VIEW_SYMBOLS, across,
    index_len, middle, most_symbols,
};
use crate::error::{FormatError, invalid, require_eq};
use crate::page::{PAGE_HEADER_LEN, PageHeader};
use bytemuck::Zeroable;
use chpm_mesh::Octahedral;
use std::io;
use std::mem;

/// Buffers of unpacking.
pub(super) struct Unpacker {
    walk: Follower,
    symbols: Vec<u8>,
    /// Vertex of each rank, and rank of each vertex.
    order: Vec<u16>,
    ranks: Vec<u16>,
    numbers: Vec<u32>,
    zstd: zstd::bulk::Decompressor<'static>,
}

impl Unpacker {
    pub(super) fn new() -> io::Result<Self> {
        Ok(Unpacker {
            walk: Follower::new(),
            symbols: Vec::new(),
            order: Vec::new(),
            ranks: Vec::new(),
            numbers: Vec::new(),
            zstd: zstd::bulk::Decompressor::new()?,
        })
    }

    pub(super) fn unpack(&mut self, packed: &[u8], raw: &mut [u8]) -> Result<(), FormatError> {
        let (head, rest) = packed.split_at_checked(HEAD_LEN).ok_or(FormatError::Truncated {
            place: PLACE,
            expected: HEAD_LEN as u64,
            got: packed.len() as u64,
        })?;
        let header = self.header(head)?;
        let attributes = header.check()?;
        require_eq(PLACE, "length of the page", header.payload_len(), raw.len() as u64)?;
        let (how, lens) = head[KEPT..].split_at(4);
        let view = View::of_bytes([how[0], how[1]]).ok_or(Damage("a view that is known"))?;
        if !matches!(how[2..], [TOLD | LEAST_FIRST, 0]) {
            return Err(Damage("a way of telling corners that is known").into());
        }
        let len = |i: usize| u32::from_le_bytes(lens.as_chunks().0[i]) as usize;
        let (walk_bits, rest) = rest.split_at_checked(len(0)).ok_or(Damage("open bits within the page"))?;
        let (bits, frame) = rest.split_at_checked(len(1)).ok_or(Damage("open bits within the page"))?;
        let (mut walk_bits, mut bits) = (BitReader::new(walk_bits), BitReader::new(bits));
        let mut symbols = mem::take(&mut self.symbols);
        expand(&mut self.zstd, frame, most_symbols(&header, attributes), &mut symbols)?;
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
        let with_edge = edges.iter().filter(|symbol| **symbol != 0).count();
        let turns = streams.next(if how[2] == TOLD { with_edge } else { 0 })?;
        let corners = streams.next(edges.iter().map(|symbol| corners_told(*symbol)).sum())?;

        let positions = take(&mut body, 12 * v);
        fn carried(is_carried: bool, len: usize, v: usize) -> usize {
            if is_carried { len * v } else { 0 }
        }
        let normals = take(&mut body, carried(attributes.normals, 12, v));
        let colors = take(&mut body, carried(attributes.colors, 4, v));
        let scalars = take(&mut body, 4 * usize::from(attributes.scalar_words) * v);
        let ids = take(&mut body, 4 * shared);
        let triangles = take(&mut body, 6 * t).as_chunks_mut().0;
        let symbols_of_walk = (edges, turns, corners);
        match how[2] {
            TOLD => self.walk.read::<true>(&self.order, symbols_of_walk, &mut walk_bits, triangles)?,
            _ => self.walk.read::<false>(&self.order, symbols_of_walk, &mut walk_bits, triangles)?,
        }
        walk_bits.finish()?;
        self.read_array::<3>(streams.next(3 * v)?, across, &mut bits);
        put_floats(self.numbers.as_chunks().0.iter().copied(), positions, view)?;
        if attributes.normals {
            self.read_array::<3>(streams.next(3 * v)?, middle, &mut bits);
            put_floats(self.numbers.as_chunks().0.iter().copied(), normals, View::Binary)?;
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
        self.read_scalars(&mut streams, scalars, attributes.scalar_words.into(), &mut bits)?;
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
        let all = streams.finish();
        self.symbols = symbols;
        all?;
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

    fn read_order(&mut self, symbols: &[u8], base: usize, bits: &mut BitReader<'_>) -> Result<(), Damage> {
        let count = symbols.len();
        let len = index_len(count - base);
        self.ranks.clear();
        self.ranks.resize(count, NONE);
        self.order.clear();
        let mut next = 0u32;
        for (rank, symbol) in (0..).zip(symbols) {
            // Either of the two is as likely.
            let elsewhere = *symbol == ELSEWHERE;
            let (open, high) = difference_of(*symbol);
            let open = bits.take(if elsewhere { len } else { open });
            let own = next.wrapping_add(unfold(open | high));
            let vertex = if elsewhere { base as u32 + open } else { own };
            next = if elsewhere { next } else { own.wrapping_add(1) };
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

    /// The words of scalars, one array after the other.
    fn read_scalars(
        &mut self,
        streams: &mut Streams<'_>,
        out: &mut [u8],
        words: usize,
        bits: &mut BitReader<'_>,
    ) -> Result<(), Damage> {
        let out: &mut [[u8; 4]] = out.as_chunks_mut().0;
        for word in 0..words {
            let view = streams.next(VIEW_SYMBOLS)?;
            let view = View::of_bytes([view[0], view[1]]).ok_or(Damage("a view that is known"))?;
            self.read_array::<1>(streams.next(out.len() / words)?, middle, bits);
            for (number, row) in self.numbers.iter().zip(out.chunks_exact_mut(words)) {
                let value = view.float(*number).ok_or(Damage("a decimal number within bounds"))?;
                row[word] = value.to_bits().to_le_bytes();
            }
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
        for ((vertex, symbol), target) in (base..).zip(symbols).zip(out) {
            if let Some(next) = self.walk.around.of(vertex).get(usize::from(*symbol)) {
                *target = next.to_le_bytes();
                continue;
            }
            let difference = bits.difference(*symbol - NEIGHBORS as u8);
            let rank = u32::from(self.ranks[vertex]).wrapping_add(difference);
            let to = self.order.get(rank as usize).ok_or(Damage("a target that there is"))?;
            *target = to.to_le_bytes();
        }
        Ok(())
    }
}

/// Splits off what the caller knows to be there.
pub(super) fn take<'a>(bytes: &mut &'a mut [u8], len: usize) -> &'a mut [u8] {
    bytes.split_off_mut(..len).unwrap_or_default()
}

/// Writes the floats of numbers, three of each vertex.
pub(super) fn put_floats(
    numbers: impl Iterator<Item = [u32; 3]>,
    out: &mut [u8],
    view: View,
) -> Result<(), Damage> {
    let out: &mut [[u8; 12]] = out.as_chunks_mut().0;
    fn put(out: &mut [u8; 12], floats: [u32; 3]) {
        let words: &mut [[u8; 4]] = out.as_chunks_mut().0;
        words.iter_mut().zip(floats).for_each(|(bytes, float)| *bytes = float.to_le_bytes());
    }
    // A loop of its own for each view.
    match view {
        View::Lattice { .. } => {
            let float = |number: u32| view.float(number).unwrap_or_default().to_bits();
            numbers.zip(out).for_each(|(numbers, out)| put(out, numbers.map(float)));
        }
        View::Binary => numbers.zip(out).for_each(|(numbers, out)| put(out, numbers.map(turned))),
        View::Decimal { .. } => {
            for (numbers, out) in numbers.zip(out) {
                let [x, y, z] = numbers.map(|number| view.float(number));
                let floats = x.zip(y).zip(z).ok_or(Damage("a decimal number within bounds"))?;
                put(out, [floats.0.0, floats.0.1, floats.1].map(f32::to_bits));
            }
        }
    }
    Ok(())
}

/// Expands a frame of symbols, `most` at most.
pub(super) fn expand(
    zstd: &mut zstd::bulk::Decompressor<'static>,
    frame: &[u8],
    most: usize,
    symbols: &mut Vec<u8>,
) -> Result<(), FormatError> {
    symbols.clear();
    symbols.reserve(most);
    let expanded = zstd.decompress_to_buffer(frame, symbols);
    expanded
        .map_err(|error| invalid(PLACE, "packed page", "a frame of zstd that holds its symbols", error))?;
    Ok(())
}
