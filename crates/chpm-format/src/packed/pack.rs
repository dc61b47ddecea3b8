//! From a page to its packed form.

use super::around::{Around, NEIGHBORS};
use super::bits::{BitWriter, put_difference};
use super::connect::Writer;
use super::view::View;
use super::{
    ELSEWHERE, HEAD_LEN, KEPT, LEAST_FIRST, PACKED_MAGIC, PARTS, TOLD, across, arrays, index_len, middle,
};
use crate::page::Page;
use chpm_mesh::Attributes;
use std::io;
use zstd::stream::raw::{CParameter, Encoder, InBuffer, Operation, OutBuffer};

/// Higher ones find next to nothing more in symbols.
const LEVEL: i32 = 1;

/// The end of a stream.
#[derive(Clone, Copy, Default)]
struct Part {
    symbols: usize,
    bits: u64,
    written: usize,
}

/// Buffers of packing, kept from page to page.
pub(super) struct Packer {
    writer: Writer,
    walk_bits: BitWriter,
    bits: BitWriter,
    symbols: Vec<u8>,
    /// Where zstd begins anew, with statistics of its own; the open bits up to there; the bytes that zstd had written.
    parts: Vec<Part>,
    numbers: Vec<u32>,
    around: Around,
    zstd: Encoder<'static>,
}

/// Short repetitions in symbols are chance, and take longer to decode than they save.
fn encoder() -> io::Result<Encoder<'static>> {
    let mut encoder = Encoder::new(LEVEL)?;
    encoder.set_parameter(CParameter::MinMatch(7))?;
    Ok(encoder)
}

impl Packer {
    pub(super) fn new() -> io::Result<Self> {
        Ok(Packer {
            writer: Writer::default(),
            walk_bits: BitWriter::default(),
            bits: BitWriter::default(),
            symbols: Vec::new(),
            parts: Vec::new(),
            numbers: Vec::new(),
            around: Around::new(),
            zstd: encoder()?,
        })
    }

    pub(super) fn pack(&mut self, raw: &[u8], page: &Page<'_>, out: &mut Vec<u8>) -> io::Result<()> {
        self.symbols.clear();
        self.parts.clear();
        self.walk_bits.clear();
        self.bits.clear();
        self.writer.write(page.triangles, page.vertex_count(), &mut self.walk_bits);
        self.put_order(page.base_vertex_count);
        let written = &self.writer.symbols;
        for stream in [&written.edges, &written.turns, &written.corners] {
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
        self.compress(out)
    }

    /// Ends a stream of symbols.
    fn end_part(&mut self) {
        self.parts.push(Part { symbols: self.symbols.len(), bits: self.bits.count(), written: 0 });
    }

    /// Bits of the page that was packed last, by [`PARTS`].
    pub(super) fn sizes(&self, attributes: Attributes) -> [u64; PARTS.len()] {
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
        let mut next = 0;
        for vertex in self.writer.order.iter().copied().map(u32::from) {
            match vertex.checked_sub(base as u32) {
                Some(index) => {
                    self.symbols.push(ELSEWHERE);
                    self.bits.put(index, len);
                }
                None => {
                    put_difference(vertex.wrapping_sub(next), &mut self.symbols, &mut self.bits);
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
                    &mut self.symbols,
                    &mut self.bits,
                );
            }
        }
        self.end_part();
    }

    /// The words of scalars, one array after the other, each with the view by which its bits are numbers.
    fn put_scalars(&mut self, page: &Page<'_>) {
        let words = usize::from(page.attributes().scalar_words);
        for word in 0..words {
            let column = page.scalars.chunks_exact(words).map(|row| f32::from_bits(row[word]));
            let numbers: Vec<f32> = column.collect();
            let view = View::of(&numbers);
            self.symbols.extend_from_slice(&view.bytes());
            self.put_array(numbers.iter().map(|x| [view.integer(*x).unwrap_or_default()]), middle);
        }
    }

    fn put_collapses(&mut self, page: &Page<'_>) {
        let ranks = &self.writer.ranks;
        self.around.clear(page.vertex_count());
        page.triangles.iter().for_each(|triangle| self.around.add(*triangle));

        for (vertex, to) in (page.base_vertex_count..).zip(page.targets) {
            if let Some(place) = self.around.of(vertex).iter().position(|next| next == to) {
                self.symbols.push(place as u8);
                continue;
            }
            let difference = u32::from(ranks[usize::from(*to)]).wrapping_sub(ranks[vertex].into());
            put_difference(difference, &mut self.symbols, &mut self.bits);
            if let Some(symbol) = self.symbols.last_mut() {
                *symbol += NEIGHBORS as u8;
            }
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
