//! From a page and the one above to the chained form.

use super::base::{Base, NOWHERE};
use super::rings::{Gone, Rings, TOLD_AT_ONCE};
use super::{CHAINED_MAGIC, ODD, RUNS, Shares, symbol_of};
use crate::error::FormatError;
use crate::packed::bits::{BitWriter, put_difference};
use crate::packed::connect::NONE;
use crate::packed::streams::{Part, Written};
use crate::packed::view::View;
use crate::packed::{Damage, HEAD_LEN, KEPT, arrays, index_len};
use crate::page::{PAGE_HEADER_LEN, PARTS, Page};
use chpm_mesh::Attributes;
use std::io;

/// Collapses that are followed for each vertex and triangle, in the mean: pages that take more are not chained.
const MOST_STEPS: usize = 256;

/// A triangle where it comes in: the vertex that brings it, its number in the page, its corners then.
type Birth = (u16, u32, [u16; 3]);

/// A triangle that a split adds: its third corner, whether that comes before the new vertex, its number in the page and by how many corners it is turned.
type Coming = (u16, bool, (u32, u8));

/// Buffers of chaining, kept from page to page.
pub(super) struct Writer {
    base: Base,
    rings: Rings,
    streams: Written,
    walk_bits: BitWriter,
    bits: BitWriter,
    /// Bits that say which vertices are split.
    which: u64,
    births: Vec<Birth>,
    /// How many more collapses may be followed.
    steps: usize,
    /// By triangle of the growing mesh: that of the page, and by how many corners it is turned.
    origins: Vec<(u32, u8)>,
    /// The page's vertex of each number, and the other way.
    order: Vec<u16>,
    numbers: Vec<u16>,
    /// Base vertices that the page above has.
    used: usize,
    /// By vertex from `used` on: the one that it is guessed about, and where its links end.
    middles: Vec<(u16, u32)>,
    goes: Vec<bool>,
    come: Vec<Coming>,
    shares: Shares,
}

impl Writer {
    pub(super) fn new() -> io::Result<Self> {
        Ok(Writer {
            base: Base::default(),
            rings: Rings::new(),
            streams: Written::new()?,
            walk_bits: BitWriter::default(),
            bits: BitWriter::default(),
            which: 0,
            births: Vec::new(),
            steps: 0,
            origins: Vec::new(),
            order: Vec::new(),
            numbers: Vec::new(),
            used: 0,
            middles: Vec::new(),
            goes: Vec::new(),
            come: Vec::new(),
            shares: Shares::new(),
        })
    }

    /// Appends the chained form and answers the number of each vertex, if there is one.
    pub(super) fn write(
        &mut self,
        raw: &[u8],
        page: &Page<'_>,
        parent: &Page<'_>,
        place: u16,
        out: &mut Vec<u8>,
    ) -> Result<Option<Vec<u16>>, FormatError> {
        let base = page.base_vertex_count;
        if raw[KEPT..PAGE_HEADER_LEN].iter().any(|byte| *byte != 0) {
            return Ok(None);
        }
        self.steps = MOST_STEPS * (page.vertex_count() + page.triangles.len());
        self.play(page);
        if self.steps == 0 {
            return Ok(None);
        }
        let (births, of_base) = (&self.births, |birth: &&Birth| usize::from(birth.0) < base);
        let triangles = births.iter().take_while(of_base).map(|(_, triangle, corners)| (*triangle, *corners));
        if !self.base.find(page, triangles, parent) {
            return Ok(None);
        }
        self.streams.clear();
        self.walk_bits.clear();
        self.bits.clear();
        if self.put_base(page, parent).is_err() {
            return Ok(None);
        }
        if self.put_splits(page).is_err() || self.steps == 0 {
            return Ok(None);
        }
        let view = View::of(page.positions.as_flattened());
        self.put_array(page.positions.iter().map(|p| p.map(|x| view.integer(x).unwrap_or_default())));
        if !page.normals.is_empty() {
            self.put_array(
                page.normals.iter().map(|n| n.map(|x| View::Binary.integer(x).unwrap_or_default())),
            );
        }
        if !page.octahedral.is_empty() {
            self.put_array(page.octahedral.iter().map(|n| n.steps()));
        }
        if !page.colors.is_empty() {
            self.put_array(page.colors.iter().map(|c| c.map(u32::from)));
        }
        for word in 0..page.attributes().scalar_words.into() {
            let (numbers, view) = View::of_word(page, word);
            self.streams.symbols.extend_from_slice(&view.bytes());
            self.put_array(numbers.iter().map(|x| [view.integer(*x).unwrap_or_default()]));
        }
        self.put_codes(page);
        if !self.put_shared(page, parent) {
            return Ok(None);
        }

        out.extend_from_slice(&CHAINED_MAGIC.to_le_bytes());
        out.extend_from_slice(&raw[4..KEPT]);
        out.extend_from_slice(&view.bytes());
        out.extend_from_slice(&place.to_le_bytes());
        for bits in [&mut self.walk_bits, &mut self.bits] {
            bits.finish();
            out.extend_from_slice(&(bits.bytes.len() as u32).to_le_bytes());
        }
        out.extend_from_slice(&self.walk_bits.bytes);
        out.extend_from_slice(&self.bits.bytes);
        self.streams.compress(out)?;
        Ok(Some(self.numbers.clone()))
    }

    /// Bits of the page that was written last, by [`PARTS`].
    pub(super) fn sizes(&self, attributes: Attributes) -> [u64; PARTS.len()] {
        let mut sizes = [0; PARTS.len()];
        let arrays = arrays(attributes).map(|_| 6);
        let kinds = [1, 1, 0].into_iter().chain(arrays).chain([4, 5, 5]);
        let mut before = Part::default();
        for (part, kind) in self.streams.parts.iter().zip(kinds) {
            sizes[kind] += part.bits - before.bits + 8 * (part.written - before.written) as u64;
            before = *part;
        }
        sizes[1] += 8 * self.walk_bits.bytes.len() as u64 - self.which;
        sizes[3] = self.which;
        sizes[7] = 8 * HEAD_LEN as u64;
        sizes
    }

    /// Finds where each triangle comes in, and with which corners; those of the base mesh come first.
    fn play(&mut self, page: &Page<'_>) {
        let base = page.base_vertex_count;
        self.births.clear();
        for (triangle, corners) in (0..).zip(page.triangles) {
            let mut corners = *corners;
            let last = loop {
                let last = *corners.iter().max().unwrap_or(&0);
                let Some(at) = usize::from(last).checked_sub(base).filter(|_| self.steps > 0) else {
                    break 0;
                };
                self.steps -= 1;
                let target = page.targets[at];
                if corners.contains(&target) {
                    break last;
                }
                corners.iter_mut().filter(|corner| **corner == last).for_each(|corner| *corner = target);
            };
            self.births.push((last, triangle, corners));
        }
        self.births.sort_unstable_by_key(|(last, triangle, _)| (*last, *triangle));
    }

    /// Tells which triangles above are the base mesh, numbers its vertices, and begins the mesh.
    fn put_base(&mut self, page: &Page<'_>, parent: &Page<'_>) -> Result<(), Damage> {
        let count = page.vertex_count();
        self.rings.clear(count, page.triangles.len())?;
        self.origins.clear();
        self.order.clear();
        self.numbers.clear();
        self.numbers.resize(count, NONE);
        let (mut run, mut is_taken) = (0, false);
        for ((own, turn), above) in self.base.own.iter().zip(parent.triangles) {
            if (*own != NOWHERE) != is_taken {
                put_run(run, &mut self.streams.symbols, &mut self.walk_bits);
                (run, is_taken) = (0, !is_taken);
            }
            run += 1;
            if !is_taken {
                continue;
            }
            let corners = above.map(|above| {
                let vertex = self.base.own_of(above);
                if self.numbers[usize::from(vertex)] == NONE {
                    self.numbers[usize::from(vertex)] = self.order.len() as u16;
                    self.order.push(vertex);
                }
                self.numbers[usize::from(vertex)]
            });
            self.rings.add_base(corners)?;
            self.origins.push((*own, *turn));
        }
        put_run(run, &mut self.streams.symbols, &mut self.walk_bits);
        self.streams.end(0);
        self.rings.end_base();
        self.used = self.order.len();
        for vertex in 0..count as u16 {
            if self.numbers[usize::from(vertex)] == NONE {
                self.numbers[usize::from(vertex)] = self.order.len() as u16;
                self.order.push(vertex);
            }
        }
        Ok(())
    }

    fn put_splits(&mut self, page: &Page<'_>) -> Result<(), Damage> {
        let base = page.base_vertex_count;
        self.middles.clear();
        // What no triangle of the base mesh has is guessed from the vertex before.
        self.middles.extend((self.used..base).map(|own| ((own as u16).saturating_sub(1), 0)));
        self.which = 0;
        for (new, target) in (base as u16..).zip(page.targets) {
            let len = index_len(new.into());
            self.walk_bits.put(self.numbers[usize::from(*target)].into(), len);
            self.which += u64::from(len);
        }
        let mut births = &self.births[self.births.partition_point(|birth| usize::from(birth.0) < base)..];
        for (new, target) in (base as u16..).zip(page.targets) {
            let count = births.iter().take_while(|birth| birth.0 == new).count();
            let (own, rest) = births.split_at(count);
            births = rest;
            let middle = self.numbers[usize::from(*target)];
            self.goes.clear();
            for (triangle, place) in self.rings.corners(middle) {
                let (triangle, turn) = self.origins[usize::from(triangle)];
                let corner = usize::from(place + turn) % 3;
                let mut vertex = page.triangles[triangle as usize][corner];
                while vertex > new && self.steps > 0 {
                    self.steps -= 1;
                    vertex = page.targets[usize::from(vertex) - base];
                }
                self.goes.push(vertex == new);
            }
            let mut goes = self.goes.chunks(TOLD_AT_ONCE);
            let gone = self.rings.split([middle, new], |len| {
                let told = goes.next().unwrap_or_default().iter().rev();
                let bits = told.fold(0, |bits, goes| bits << 1 | u32::from(*goes));
                self.walk_bits.put(bits, len);
                bits
            })?;
            // Each with its third corner, whether that comes before the new vertex in its turn, and its place in the page.
            self.come.clear();
            self.come.extend(own.iter().map(|(_, triangle, corners)| {
                let corners = corners.map(|vertex| self.numbers[usize::from(vertex)]);
                let turn = corners.iter().position(|corner| *corner == middle).unwrap_or_default();
                let [second, third] = [corners[(turn + 1) % 3], corners[(turn + 2) % 3]];
                let is_front = third == new;
                (if is_front { second } else { third }, is_front, (*triangle, turn as u8))
            }));
            match ends(&self.rings, &gone, new, &self.come) {
                Some(ends) => {
                    self.streams.symbols.push(symbol_of(ends));
                    self.rings.fill([middle, new], &gone, ends)?;
                    let [fronts, backs] =
                        [true, false].map(|side| self.come.iter().filter(move |one| one.1 == side));
                    self.origins.extend(fronts.chain(backs).map(|one| one.2));
                }
                None => {
                    self.streams.symbols.push(ODD);
                    let len = index_len(new.into());
                    for (at, (third, is_front, origin)) in self.come.iter().enumerate() {
                        self.walk_bits.put(1, 1);
                        self.walk_bits.put((*third).into(), len);
                        self.walk_bits.put(u32::from(!is_front), 1);
                        let corners = if *is_front { [middle, *third, new] } else { [middle, new, *third] };
                        self.rings.add_odd(corners, &gone, at == 0)?;
                        self.rings.link(*third);
                        self.origins.push(*origin);
                    }
                    self.walk_bits.put(0, 1);
                }
            }
            self.middles.push((middle, self.rings.links().len() as u32));
        }
        self.streams.end(0);
        Ok(())
    }

    /// Numbers of the vertices that are not above, `N` each, as differences from a guess.
    fn put_array<const N: usize>(&mut self, of: impl ExactSizeIterator<Item = [u32; N]>) {
        let of: Vec<[u32; N]> = of.collect();
        let all: Vec<[u32; N]> = self.order.iter().map(|vertex| of[usize::from(*vertex)]).collect();
        let mut first = 0;
        for (vertex, (middle, end)) in (self.used..).zip(&self.middles) {
            let links = &self.rings.links()[first as usize..*end as usize];
            first = *end;
            let guess = if vertex == 0 { [0; N] } else { self.shares.guess(&all, *middle, links) };
            for i in 0..N {
                let difference = all[vertex][i].wrapping_sub(guess[i]);
                put_difference(difference, &mut self.streams.symbols, &mut self.bits);
            }
        }
        self.streams.end(self.bits.count());
    }

    fn put_codes(&mut self, page: &Page<'_>) {
        let mut last = 0;
        for code in page.error_codes.iter().rev().copied().map(u32::from) {
            put_difference(code.wrapping_sub(last), &mut self.streams.symbols, &mut self.bits);
            last = code;
        }
        self.streams.end(self.bits.count());
    }

    /// Tells which vertices are shared that are not above, or are not shared there, and their ids. Not where one is shared above in another way.
    fn put_shared(&mut self, page: &Page<'_>, parent: &Page<'_>) -> bool {
        let ids = |page: &Page<'_>| {
            let mut ids = vec![NOWHERE; page.vertex_count()];
            page.shared().for_each(|(vertex, id)| ids[usize::from(vertex)] = id);
            ids
        };
        let (own, above) = (ids(page), ids(parent));
        let mut told = Vec::new();
        let mut gap = 0;
        for (number, vertex) in self.order.iter().enumerate() {
            let id = own[usize::from(*vertex)];
            if number < self.used {
                let above = above[usize::from(self.base.above[usize::from(*vertex)])];
                if above != NOWHERE && above != id {
                    return false;
                }
                if above != NOWHERE {
                    continue;
                }
            }
            if id == NOWHERE {
                gap += 1;
                continue;
            }
            put_run(gap, &mut self.streams.symbols, &mut self.bits);
            told.push(id);
            gap = 0;
        }
        self.streams.end(self.bits.count());
        let mut last = 0;
        for id in told {
            put_difference(id.wrapping_sub(last), &mut self.streams.symbols, &mut self.bits);
            last = id;
        }
        self.streams.end(self.bits.count());
        true
    }
}

fn put_run(run: u32, symbols: &mut Vec<u8>, bits: &mut BitWriter) {
    let (symbol, len, open) = RUNS.split(run);
    symbols.push(symbol as u8);
    bits.put(open, len);
}

/// Whether triangles come in front of those that went and behind; none where others come as well, or those that went are not one after the other.
fn ends(rings: &Rings, gone: &Gone, new: u16, come: &[Coming]) -> Option<[bool; 2]> {
    let told = [true, false].map(|side| come.iter().any(|one| one.1 == side));
    let Some([first, last]) = rings.ends(gone, new) else {
        return (come.is_empty() && gone.is_whole()).then_some(told);
    };
    let is_there = |one: &Coming| one.0 == if one.1 { first.0 } else { last.0 };
    let is_all = come.len() == told.iter().filter(|told| **told).count() && come.iter().all(is_there);
    is_all.then_some(told)
}
