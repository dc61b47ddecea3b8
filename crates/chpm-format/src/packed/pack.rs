//! From a page to its packed form.

use super::around::{Around, NEIGHBORS};
use super::bits::{BitWriter, put_difference};
use super::connect::Writer;
use super::streams::{Part, Written};
use super::view::View;
use super::{
    ELSEWHERE, HEAD_LEN, KEPT, LEAST_FIRST, PACKED_MAGIC, PARTS, TOLD, across, arrays, index_len, middle,
};
use crate::page::Page;
use chpm_mesh::Attributes;
use std::io;

/// Buffers of packing, kept from page to page.
pub(super) struct Packer {
    writer: Writer,
    walk_bits: BitWriter,
    bits: BitWriter,
    streams: Written,
    numbers: Vec<u32>,
    around: Around,
}

impl Packer {
    pub(super) fn new() -> io::Result<Self> {
        Ok(Packer {
            writer: Writer::default(),
            walk_bits: BitWriter::default(),
            bits: BitWriter::default(),
            streams: Written::new()?,
            numbers: Vec::new(),
            around: Around::new(),
        })
    }

    pub(super) fn pack(&mut self, raw: &[u8], page: &Page<'_>, out: &mut Vec<u8>) -> io::Result<()> {
        self.streams.clear();
        self.walk_bits.clear();
        self.bits.clear();
        self.writer.write(page.triangles, page.vertex_count(), &mut self.walk_bits);
        self.put_order(page.base_vertex_count);
        let written = &self.writer.symbols;
        for stream in [&written.edges, &written.turns, &written.corners] {
            self.streams.symbols.extend_from_slice(stream);
            self.streams.end(self.bits.count());
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
        self.put_scalars(page);
        self.put_collapses(page);

        let head = out.len();
        out.extend_from_slice(&PACKED_MAGIC.to_le_bytes());
        out.extend_from_slice(&raw[4..KEPT]);
        out.extend_from_slice(&view.bytes());
        out.extend_from_slice(&[if self.writer.turns { TOLD } else { LEAST_FIRST }, 0]);
        let open = [&mut self.walk_bits, &mut self.bits];
        for bits in open {
            bits.finish();
            out.extend_from_slice(&(bits.bytes.len() as u32).to_le_bytes());
        }
        debug_assert_eq!(out.len() - head, HEAD_LEN);
        out.extend_from_slice(&self.walk_bits.bytes);
        out.extend_from_slice(&self.bits.bytes);
        self.streams.compress(out)
    }

    /// Ends a stream of symbols.
    fn end_part(&mut self) {
        self.streams.end(self.bits.count());
    }

    /// Bits of the page that was packed last, by [`PARTS`].
    pub(super) fn sizes(&self, attributes: Attributes) -> [u64; PARTS.len()] {
        let mut sizes = [0; PARTS.len()];
        let arrays = arrays(attributes).map(|_| 6);
        let kinds = [2, 1, 1, 1, 0].into_iter().chain(arrays).chain([3, 4, 5, 5]);
        let mut before = Part::default();
        for (part, kind) in self.streams.parts.iter().zip(kinds) {
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
        let mut next = 0;
        for vertex in self.writer.order.iter().copied().map(u32::from) {
            match vertex.checked_sub(base as u32) {
                Some(index) => {
                    self.streams.symbols.push(ELSEWHERE);
                    self.bits.put(index, len);
                }
                None => {
                    put_difference(vertex.wrapping_sub(next), &mut self.streams.symbols, &mut self.bits);
                    next = vertex + 1;
                }
            }
        }
        self.end_part();
    }

    fn put_positions(&mut self, positions: &[[f32; 3]]) -> View {
        let view = View::of(positions.as_flattened());
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
                    &mut self.streams.symbols,
                    &mut self.bits,
                );
            }
        }
        self.end_part();
    }

    /// The words of scalars, one array after the other, each with the view by which its bits are numbers.
    fn put_scalars(&mut self, page: &Page<'_>) {
        for word in 0..page.attributes().scalar_words.into() {
            let (numbers, view) = View::of_word(page, word);
            self.streams.symbols.extend_from_slice(&view.bytes());
            self.put_array(numbers.iter().map(|x| [view.integer(*x).unwrap_or_default()]), middle);
        }
    }

    fn put_collapses(&mut self, page: &Page<'_>) {
        let ranks = &self.writer.ranks;
        self.around.clear(page.vertex_count());
        page.triangles.iter().for_each(|triangle| self.around.add(*triangle));

        for (vertex, to) in (page.base_vertex_count..).zip(page.targets) {
            if let Some(place) = self.around.of(vertex).iter().position(|next| next == to) {
                self.streams.symbols.push(place as u8);
                continue;
            }
            let difference = u32::from(ranks[usize::from(*to)]).wrapping_sub(ranks[vertex].into());
            put_difference(difference, &mut self.streams.symbols, &mut self.bits);
            if let Some(symbol) = self.streams.symbols.last_mut() {
                *symbol += NEIGHBORS as u8;
            }
        }

        self.end_part();

        let mut last = 0;
        for code in page.error_codes.iter().rev().copied().map(u32::from) {
            put_difference(code.wrapping_sub(last), &mut self.streams.symbols, &mut self.bits);
            last = code;
        }
        self.end_part();
        let mut last = 0;
        for id in page.shared_ids {
            put_difference(id.wrapping_sub(last), &mut self.streams.symbols, &mut self.bits);
            last = *id;
        }
        self.end_part();

        self.streams.symbols.extend_from_slice(page.shared_bits);
        self.end_part();
    }
}
