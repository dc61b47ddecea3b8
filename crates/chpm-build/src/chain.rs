//! Chaining of pages that lie in the output as they are, level by level from the top: each is told by one above, in the order that this one has got.

use crate::error::BuildError;
use crate::output::OutputFiles;
use chpm_format::{ClusterRecord, PACKED_ALIGN, Page, Remnant, Tables, checksum, packed};
use rayon::prelude::*;
use std::cmp::Reverse;
use std::ops::Range;

/// Pages for each thread that are worked on before they are written.
const BATCH: usize = 4;

/// A page where it lies: its first byte, and how many there are.
type Place = (u64, usize);

/// The bytes that are to be written of a page.
struct Stored {
    bytes: Vec<u8>,
    flag: u32,
    /// The page in its new order, and its vertices' numbers there.
    ordered: Option<packed::Chained>,
}

/// Chains the pages of `tables`, which lie in `out` at `places` as they are and end at `end`, and appends them there. Pages that cannot be chained are packed, if that makes
/// them shorter. Answers where each is stored; the tables have the lengths and checksums of that, and remnants the new numbers of vertices.
///
/// # Errors
/// [`BuildError::Extmem`] where the file cannot be read or written, [`BuildError::Format`] for a page that is none, and what `check` answers.
pub fn chain<E: From<BuildError>>(
    out: &mut OutputFiles,
    tables: &mut Tables,
    places: &[u64],
    end: u64,
    check: impl Fn() -> Result<(), E>,
) -> Result<Vec<u64>, E> {
    let raw: Vec<Place> =
        places.iter().zip(&tables.clusters).map(|(at, c)| (*at, c.page_len as usize)).collect();
    let above = above(tables);
    tables.remnants.sort_by_key(|remnant| remnant.cluster);
    let levels = tables.clusters.iter().map(|cluster| cluster.level);
    let mut order: Vec<(Reverse<u32>, u32)> = levels.map(Reverse).zip(0..).collect();
    order.sort_unstable();
    let (mut stored, mut append) = (vec![0; raw.len()], out.append(end.next_multiple_of(PACKED_ALIGN)));
    for level in order.chunk_by(|a, b| a.0 == b.0) {
        for batch in level.chunks(BATCH * rayon::current_num_threads()) {
            check()?;
            let done = (batch.par_iter())
                .map(|(_, id)| store(&*out, &raw, *id, &tables.members[above[*id as usize].clone()]));
            let done = done.collect::<Result<Vec<_>, _>>()?;
            for ((_, id), page) in batch.iter().zip(done) {
                let record = &mut tables.clusters[*id as usize];
                record.page_len = page.bytes.len() as u32;
                record.page_checksum = checksum(&page.bytes);
                record.flags = record.flags & !ClusterRecord::PACKED | page.flag;
                let len = (page.bytes.len() as u64).next_multiple_of(PACKED_ALIGN);
                let place = append.next(len)?;
                out.make_room(place + len)?;
                out.write_all_at(&page.bytes, place)?;
                stored[*id as usize] = place;
                let Some(packed::Chained { raw: ordered, vertices }) = page.ordered else { continue };
                renumber(&mut tables.remnants, *id, &vertices);
                out.write_all_at(&ordered, raw[*id as usize].0)?;
            }
        }
    }
    Ok(stored)
}

/// Moves stored pages together, in their order: none comes to lie on one that has not been moved, for each was placed by at least the length that it has.
///
/// # Errors
/// As [`chain`].
pub fn close_up<E: From<BuildError>>(
    out: &OutputFiles,
    tables: &mut Tables,
    places: &[u64],
    check: impl Fn() -> Result<(), E>,
) -> Result<(), E> {
    tables.assign_offsets().map_err(BuildError::from)?;
    let place_of = out.places(tables)?;
    let mut page = Vec::new();
    for (record, place) in tables.clusters.iter().zip(places) {
        check()?;
        page.resize(record.page_len as usize, 0);
        out.read_exact_at(&mut page, *place)?;
        // What was there before must not show between pages.
        page.resize(page.len().next_multiple_of(PACKED_ALIGN as usize), 0);
        out.write_all_at(&page, place_of(record.page_offset))?;
    }
    Ok(())
}

/// By cluster, the range of members that it replaces, in ascending order as the file has them.
fn above(tables: &mut Tables) -> Vec<Range<usize>> {
    let mut above = vec![0..0; tables.clusters.len()];
    for group in &tables.groups {
        fn range(first: u32, count: u32) -> Range<usize> {
            first as usize..first as usize + count as usize
        }
        let coarse = range(group.coarse_first, group.coarse_count);
        tables.members[coarse.clone()].sort_unstable();
        for fine in &tables.members[range(group.fine_first, group.fine_count)] {
            above[*fine as usize] = coarse.clone();
        }
    }
    above
}

fn store(out: &OutputFiles, places: &[Place], id: u32, above: &[u32]) -> Result<Stored, BuildError> {
    let raw = read(out, places[id as usize])?;
    let raw: &[u8] = &bytemuck::cast_slice(&raw)[..places[id as usize].1];
    let mut bytes = Vec::new();
    for (place, parent) in (0..=u16::MAX).zip(above) {
        let parent = places[*parent as usize];
        let words = read(out, parent)?;
        let parent = Page::view(&bytemuck::cast_slice(&words)[..parent.1])?;
        if let Some(ordered) = packed::chain(raw, &parent, place, &mut bytes)? {
            return Ok(Stored { bytes, flag: ClusterRecord::PACKED, ordered: Some(ordered) });
        }
    }
    if packed::pack(raw, &mut bytes)? {
        return Ok(Stored { bytes, flag: ClusterRecord::PACKED, ordered: None });
    }
    Ok(Stored { bytes: raw.to_vec(), flag: 0, ordered: None })
}

/// The bytes of a page, in words since it is looked at in place.
fn read(out: &OutputFiles, (at, len): Place) -> Result<Vec<u32>, BuildError> {
    let mut words = vec![0u32; len.div_ceil(size_of::<u32>())];
    out.read_exact_at(&mut bytemuck::cast_slice_mut(&mut words)[..len], at)?;
    Ok(words)
}

/// Gives the corners of a cluster's remnants their new numbers.
fn renumber(remnants: &mut [Remnant], cluster: u32, vertices: &[u16]) {
    let first = remnants.partition_point(|remnant| remnant.cluster < cluster);
    for remnant in remnants[first..].iter_mut().take_while(|remnant| remnant.cluster == cluster) {
        remnant.corners =
            remnant.corners.map(|corner| vertices.get(usize::from(corner)).copied().unwrap_or(corner));
    }
}
