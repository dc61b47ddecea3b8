//! From a chained page and the one above to the page itself.

use super::rings::{Gone, Rings};
use super::{CHAINED_MAGIC, ODD, RUNS, Shares, ends_of};
use crate::error::{FormatError, invalid, require_eq};
use crate::packed::bits::BitReader;
use crate::packed::connect::NONE;
use crate::packed::streams::Streams;
use crate::packed::unpack::{expand, put_floats, take};
use crate::packed::view::View;
use crate::packed::{Damage, HEAD_LEN, KEPT, PLACE, VIEW_SYMBOLS, arrays, index_len};
use crate::page::{PAGE_HEADER_LEN, PAGE_MAGIC, Page, PageHeader};
use bytemuck::Zeroable;
use chpm_mesh::{Attributes, Octahedral};
use std::io;
use std::mem;

/// No id.
const NO_ID: u32 = u32::MAX;

/// Buffers of reading.
pub(super) struct Reader {
    rings: Rings,
    symbols: Vec<u8>,
    numbers: Vec<u32>,
    /// By vertex above: its number in the page.
    own: Vec<u16>,
    /// By number: the vertex above.
    above: Vec<u16>,
    /// By number from those above on: the vertex that it is guessed about, and where its links end.
    middles: Vec<(u16, u32)>,
    /// By number of those above: the id, and of all others that are shared the numbers.
    ids: Vec<u32>,
    places: Vec<usize>,
    shares: Shares,
    zstd: zstd::bulk::Decompressor<'static>,
}

impl Reader {
    pub(super) fn new() -> io::Result<Self> {
        Ok(Reader {
            rings: Rings::new(),
            symbols: Vec::new(),
            numbers: Vec::new(),
            own: Vec::new(),
            above: Vec::new(),
            middles: Vec::new(),
            ids: Vec::new(),
            places: Vec::new(),
            shares: Shares::new(),
            zstd: zstd::bulk::Decompressor::new()?,
        })
    }

    pub(super) fn read(
        &mut self,
        chained: &[u8],
        parent: &Page<'_>,
        raw: &mut [u8],
    ) -> Result<(), FormatError> {
        let (head, rest) = chained.split_at_checked(HEAD_LEN).ok_or(FormatError::Truncated {
            place: PLACE,
            expected: HEAD_LEN as u64,
            got: chained.len() as u64,
        })?;
        let mut header = PageHeader::zeroed();
        bytemuck::bytes_of_mut(&mut header)[..KEPT].copy_from_slice(&head[..KEPT]);
        if header.magic != CHAINED_MAGIC {
            return Err(invalid(PLACE, "magic", "\"CPGC\"", format_args!("{:08x}", header.magic)));
        }
        header.magic = PAGE_MAGIC;
        let attributes = header.check()?;
        require_eq(PLACE, "length of the page", header.payload_len(), raw.len() as u64)?;
        if attributes != parent.attributes() {
            return Err(Damage("the attributes of the page above").into());
        }
        let (view, lens) = (View::of_bytes([head[KEPT], head[KEPT + 1]]), &head[KEPT + 4..]);
        let view = view.ok_or(Damage("a view that is known"))?;
        let len = |i: usize| u32::from_le_bytes(lens.as_chunks().0[i]) as usize;
        let (walk_bits, rest) = rest.split_at_checked(len(0)).ok_or(Damage("open bits within the page"))?;
        let (bits, frame) = rest.split_at_checked(len(1)).ok_or(Damage("open bits within the page"))?;
        let mut symbols = mem::take(&mut self.symbols);
        let most = most_symbols(&header, attributes, parent);
        let done = expand(&mut self.zstd, frame, most, &mut symbols).and_then(|()| {
            let bits = (BitReader::new(walk_bits), BitReader::new(bits));
            self.fill(&header, attributes, view, parent, (Streams(&symbols), bits), raw)
        });
        self.symbols = symbols;
        done
    }

    fn fill(
        &mut self,
        header: &PageHeader,
        attributes: Attributes,
        view: View,
        parent: &Page<'_>,
        (mut streams, (mut walk_bits, mut bits)): (Streams<'_>, (BitReader<'_>, BitReader<'_>)),
        raw: &mut [u8],
    ) -> Result<(), FormatError> {
        let (head, body) = raw.split_at_mut(PAGE_HEADER_LEN);
        head.copy_from_slice(bytemuck::bytes_of(header));
        let (v, t) = (header.vertex_count as usize, header.triangle_count as usize);
        let (base, shared) = (header.base_vertex_count as usize, header.shared_count as usize);
        let of_codes = if attributes.octahedral { 3 * v } else { 0 };
        let (mut body, octahedral) = body.split_at_mut(body.len() - of_codes);
        fn carried(is_carried: bool, len: usize, v: usize) -> usize {
            if is_carried { len * v } else { 0 }
        }
        let positions = take(&mut body, 12 * v);
        let normals = take(&mut body, carried(attributes.normals, 12, v));
        let colors = take(&mut body, carried(attributes.colors, 4, v));
        let words = usize::from(attributes.scalar_words);
        let scalars: &mut [[u8; 4]] = take(&mut body, 4 * words * v).as_chunks_mut().0;
        let ids = take(&mut body, 4 * shared);
        let triangles = take(&mut body, 6 * t).as_chunks_mut().0;
        let targets = take(&mut body, 2 * (v - base)).as_chunks_mut().0;
        let codes: &mut [[u8; 2]] = take(&mut body, 2 * (v - base)).as_chunks_mut().0;

        self.rings.clear(v, t)?;
        self.read_base(header, parent, &mut streams, &mut walk_bits)?;
        self.read_splits(base, targets, &mut streams, &mut walk_bits)?;
        walk_bits.finish()?;
        require_eq(PLACE, "triangles of the splits", t, self.rings.triangle_count())?;
        self.rings.put_triangles(triangles);

        let told = v - self.above.len();
        // Four numbers fit a register.
        let above = parent.positions;
        self.read_array::<3, 4>(|p| view.integers(above[p]), streams.next(3 * told)?, v, &mut bits)?;
        put_floats(self.numbers.as_chunks().0.iter().map(|[x, y, z, _]| [*x, *y, *z]), positions, view)?;
        if attributes.normals {
            let (above, view) = (parent.normals, View::Binary);
            self.read_array::<3, 4>(|p| view.integers(above[p]), streams.next(3 * told)?, v, &mut bits)?;
            put_floats(self.numbers.as_chunks().0.iter().map(|[x, y, z, _]| [*x, *y, *z]), normals, view)?;
        }
        if attributes.octahedral {
            let above = parent.octahedral;
            self.read_array::<2, 2>(|p| Some(above[p].steps()), streams.next(2 * told)?, v, &mut bits)?;
            let steps: &[[u32; 2]] = self.numbers.as_chunks().0;
            let out: &mut [Octahedral] = bytemuck::cast_slice_mut(octahedral);
            out.iter_mut().zip(steps).for_each(|(normal, steps)| *normal = Octahedral::from_steps(*steps));
        }
        if attributes.colors {
            let above = parent.colors;
            self.read_array::<4, 4>(
                |p| Some(above[p].map(u32::from)),
                streams.next(4 * told)?,
                v,
                &mut bits,
            )?;
            colors.iter_mut().zip(&self.numbers).for_each(|(byte, number)| *byte = *number as u8);
        }
        for word in 0..words {
            let view = streams.next(VIEW_SYMBOLS)?;
            let view = View::of_bytes([view[0], view[1]]).ok_or(Damage("a view that is known"))?;
            let above = parent.scalars;
            let number = |p: usize| view.integers([f32::from_bits(above[p * words + word])]);
            self.read_array::<1, 1>(number, streams.next(told)?, v, &mut bits)?;
            for (number, row) in self.numbers.iter().zip(scalars.chunks_exact_mut(words)) {
                let value = view.float(*number).ok_or(Damage("a decimal number within bounds"))?;
                row[word] = value.to_bits().to_le_bytes();
            }
        }

        let mut last = 0u32;
        for (symbol, code) in streams.next(v - base)?.iter().zip(codes.iter_mut().rev()) {
            last = last.wrapping_add(bits.difference(*symbol));
            *code = (last as u16).to_le_bytes();
        }
        // What comes last in the body.
        body.fill(0);
        self.read_shared(v, parent, (&mut streams, &mut bits), (body, ids.as_chunks_mut().0))?;
        streams.finish()?;
        Ok(bits.finish()?)
    }

    /// The base mesh: triangles above in their order, and their vertices as they come.
    fn read_base(
        &mut self,
        header: &PageHeader,
        parent: &Page<'_>,
        streams: &mut Streams<'_>,
        bits: &mut BitReader<'_>,
    ) -> Result<(), Damage> {
        self.own.clear();
        self.own.resize(parent.vertex_count(), NONE);
        self.above.clear();
        let most = header.base_vertex_count as usize;
        self.above.resize(most + 1, NONE);
        let (mut left, mut is_taken, mut used) = (parent.triangles, false, 0);
        loop {
            let len = RUNS.join(streams.one()?.into(), bits)? as usize;
            let run = left.split_off(..len).ok_or(Damage("a run within the page above"))?;
            for triangle in if is_taken { run } else { &[] } {
                let mut corners = [0; 3];
                for (corner, vertex) in corners.iter_mut().zip(triangle) {
                    let own = self.own.get_mut(usize::from(*vertex)).ok_or(Damage("a vertex above"))?;
                    // One that is new has the next number, which is less than none's.
                    *own = (*own).min(used);
                    *corner = *own;
                    let place = self.above.get_mut(usize::from(used)).ok_or(Damage("a base mesh above"))?;
                    *place = *vertex;
                    used += u16::from(*own == used);
                }
                self.rings.add_base(corners)?;
            }
            is_taken = !is_taken;
            if left.is_empty() {
                break;
            }
        }
        self.above.truncate(used.into());
        self.rings.end_base();
        let triangles = self.rings.triangle_count() == header.base_triangle_count as usize;
        if !triangles || self.above.len() > header.base_vertex_count as usize {
            return Err(Damage("a base mesh of the page above"));
        }
        Ok(())
    }

    fn read_splits(
        &mut self,
        base: usize,
        targets: &mut [[u8; 2]],
        streams: &mut Streams<'_>,
        bits: &mut BitReader<'_>,
    ) -> Result<(), Damage> {
        self.middles.clear();
        self.middles.extend((self.above.len()..base).map(|own| ((own as u16).saturating_sub(1), 0)));
        for (new, target) in (base as u16..).zip(&mut *targets) {
            let middle = bits.take(index_len(new.into())) as u16;
            if middle >= new {
                return Err(Damage("a vertex that is there"));
            }
            *target = middle.to_le_bytes();
        }
        let symbols = streams.next(targets.len())?;
        for ((new, target), symbol) in (base as u16..).zip(targets).zip(symbols) {
            let middle = u16::from_le_bytes(*target);
            let gone = self.rings.split([middle, new], |count| bits.take(count))?;
            match *symbol {
                ODD => self.read_odd([middle, new], &gone, bits)?,
                symbol => self.rings.fill([middle, new], &gone, ends_of(symbol)?)?,
            }
            self.middles.push((middle, self.rings.links().len() as u32));
        }
        Ok(())
    }

    #[cold]
    fn read_odd(
        &mut self,
        [middle, new]: [u16; 2],
        gone: &Gone,
        bits: &mut BitReader<'_>,
    ) -> Result<(), Damage> {
        let len = index_len(new.into());
        let mut is_first = true;
        while bits.take(1) != 0 {
            let third = bits.take(len) as u16;
            let is_front = bits.take(1) == 0;
            if third >= new || third == middle {
                return Err(Damage("three corners"));
            }
            let corners = if is_front { [middle, third, new] } else { [middle, new, third] };
            self.rings.add_odd(corners, gone, is_first)?;
            self.rings.link(third);
            is_first = false;
        }
        Ok(())
    }

    /// Numbers of vertices, `N` each with room for `L`: those above as they are there, all others as differences from a guess.
    fn read_array<const N: usize, const L: usize>(
        &mut self,
        above: impl Fn(usize) -> Option<[u32; N]>,
        symbols: &[u8],
        count: usize,
        bits: &mut BitReader<'_>,
    ) -> Result<(), Damage> {
        self.numbers.clear();
        self.numbers.resize(L * count, 0);
        let all: &mut [[u32; L]] = self.numbers.as_chunks_mut().0;
        for (numbers, vertex) in all.iter_mut().zip(&self.above) {
            let known = above(usize::from(*vertex)).ok_or(Damage("a number of the view"))?;
            numbers[..N].copy_from_slice(&known);
        }
        let used = self.above.len();
        let mut first = 0;
        let symbols: &[[u8; N]] = symbols.as_chunks().0;
        for ((vertex, (middle, end)), symbols) in (used..).zip(&self.middles).zip(symbols) {
            let links = &self.rings.links()[first as usize..*end as usize];
            first = *end;
            // The first is guessed from itself, which is zero until it is known.
            let guess = self.shares.guess(all, *middle, links);
            let differences = bits.differences(symbols);
            let own = &mut all[vertex];
            for i in 0..N {
                own[i] = guess[i].wrapping_add(differences[i]);
            }
        }
        Ok(())
    }

    /// Which vertices are shared, and their ids: those above as they are there, all others as they are told.
    fn read_shared(
        &mut self,
        count: usize,
        parent: &Page<'_>,
        (streams, bits): (&mut Streams<'_>, &mut BitReader<'_>),
        (shared, ids): (&mut [u8], &mut [[u8; 4]]),
    ) -> Result<(), Damage> {
        self.ids.clear();
        self.ids.resize(self.above.len(), NO_ID);
        let (mut known, mut above) = (0, parent.shared_ids.iter());
        for (byte, own) in parent.shared_bits.iter().zip(self.own.chunks(8)) {
            let mut byte = *byte;
            while byte != 0 {
                let own = own.get(byte.trailing_zeros() as usize).copied().unwrap_or(NONE);
                byte &= byte - 1;
                let id = *above.next().ok_or(Damage("as many ids as there are"))?;
                if own != NONE {
                    self.ids[usize::from(own)] = id;
                    known += 1;
                }
            }
        }
        let told = ids.len().checked_sub(known).ok_or(Damage("no more shared vertices than it has"))?;
        self.places.clear();
        let mut place = 0;
        for symbol in streams.next(told)? {
            let mut gap = RUNS.join((*symbol).into(), bits)? as usize;
            // Those above that are shared are not counted.
            while self.ids.get(place).is_some_and(|id| *id != NO_ID || gap > 0) {
                gap -= usize::from(self.ids[place] == NO_ID);
                place += 1;
            }
            place += gap;
            if place >= count {
                return Err(Damage("a shared vertex that is there"));
            }
            self.places.push(place);
            place += 1;
        }
        let mut last = 0u32;
        let mut told = streams.next(told)?.iter().zip(&self.places).map(|(symbol, place)| {
            last = last.wrapping_add(bits.difference(*symbol));
            (*place, last)
        });
        let of_base = self.places.partition_point(|place| *place < self.ids.len());
        told.by_ref().take(of_base).for_each(|(place, id)| self.ids[place] = id);
        let known = self.ids.iter().copied().enumerate().filter(|(_, id)| *id != NO_ID);
        let mut ids = ids.iter_mut();
        for (vertex, id) in known.chain(told) {
            shared[vertex / 8] |= 1 << (vertex % 8);
            *ids.next().ok_or(Damage("as many ids as there are"))? = id.to_le_bytes();
        }
        if ids.next().is_some() { Err(Damage("as many ids as there are")) } else { Ok(()) }
    }
}

/// Symbols of a page at most.
fn most_symbols(header: &PageHeader, attributes: Attributes, parent: &Page<'_>) -> usize {
    let numbers: usize = arrays(attributes).sum();
    let v = header.vertex_count as usize;
    let collapses = v - header.base_vertex_count as usize;
    let views = VIEW_SYMBOLS * usize::from(attributes.scalar_words);
    let runs = parent.triangles.len() + 2;
    runs + views + v * (3 + numbers) + 2 * collapses + 2 * header.shared_count as usize
}
