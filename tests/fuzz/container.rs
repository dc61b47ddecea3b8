//! Damage to a `.chpm` that no checksum shows: fields of tables and pages are changed by what FORMAT.md says they are, and then every
//! checksum is made right again.

use crate::draw::Draw;
use chpm_format::checksum;
use std::ops::Range;

const CLUSTERS: u32 = 1;
const GROUPS: u32 = 2;
const MEMBERS: u32 = 3;
const LEVELS: u32 = 4;
const METADATA: u32 = 5;
const PAGES: u32 = 6;
const CHUNKS: u32 = 0x8000_0001;
/// Bytes of a record of CLUSTERS.
const RECORD: usize = 128;
const ENTRY: usize = 40;
// Where the offset, the length and the checksum are in an entry of the section table.
const OFFSET: usize = 8;
const LEN: usize = 16;
const SUM: usize = 32;

/// Does a few of these and seals the file.
pub(crate) fn damage(bytes: &mut Vec<u8>, draw: &mut Draw<'_>) {
    for _ in 0..draw.between(1, 4) {
        match draw.below(16) {
            0 => number(bytes, 0..248, draw),
            1 => {
                let end = 256 + entries(bytes) * ENTRY;
                number(bytes, 256..end, draw);
            }
            2..=7 => record(bytes, draw),
            8 => metadata(bytes, draw),
            9 => pages_change_places(bytes, draw),
            10 => cut_or_grow(bytes, draw),
            _ => page(bytes, draw),
        }
    }
    seal(bytes);
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
}

fn long(bytes: &[u8], at: usize) -> Option<u64> {
    Some(u64::from_le_bytes(bytes.get(at..at + 8)?.try_into().ok()?))
}

fn set_long(bytes: &mut [u8], at: usize, value: u64) {
    if let Some(place) = bytes.get_mut(at..at + 8) {
        place.copy_from_slice(&value.to_le_bytes());
    }
}

/// Entries of the section table.
fn entries(bytes: &[u8]) -> usize {
    word(bytes, 32).unwrap_or(0).min(64) as usize
}

/// Where the entry of a section is.
fn entry(bytes: &[u8], kind: u32) -> Option<usize> {
    (256..).step_by(ENTRY).take(entries(bytes)).find(|entry| word(bytes, *entry) == Some(kind))
}

/// Where a section is, as far as that is in the file.
fn section(bytes: &[u8], kind: u32) -> Option<Range<usize>> {
    place(bytes, entry(bytes, kind)?)
}

fn place(bytes: &[u8], entry: usize) -> Option<Range<usize>> {
    let start = usize::try_from(long(bytes, entry + OFFSET)?).ok()?;
    let end = start.checked_add(usize::try_from(long(bytes, entry + LEN)?).ok()?)?;
    (end <= bytes.len()).then_some(start..end)
}

/// Where the page of some cluster is.
fn some_page(bytes: &[u8], draw: &mut Draw<'_>) -> Option<(usize, Range<usize>)> {
    let clusters = section(bytes, CLUSTERS)?;
    let count = clusters.len() / RECORD;
    let record = clusters.start + draw.below(count.max(1)) * RECORD;
    let start = usize::try_from(long(bytes, record)?).ok()?;
    let end = start.checked_add(word(bytes, record + 8)? as usize)?;
    (count > 0 && end <= bytes.len()).then_some((record, start..end))
}

/// Another number in a place of a range: an odd one, one beside what was there, or one from elsewhere in it.
fn number(bytes: &mut [u8], range: Range<usize>, draw: &mut Draw<'_>) {
    let width = draw.pick(&[4, 4, 2, 8, 1]);
    if range.len() < width || range.end > bytes.len() {
        return;
    }
    let mut place = || range.start + draw.below(range.len() / width) * width;
    let (at, other) = (place(), place());
    let mut old = [0; 8];
    old[..width].copy_from_slice(&bytes[at..at + width]);
    let old = u64::from_le_bytes(old);
    let new = match draw.below(6) {
        0 => old.wrapping_add(1),
        1 => old.wrapping_sub(1),
        2 => draw.odd_integer(),
        3 => u64::from((draw.odd_float() as f32).to_bits()),
        4 => old ^ 1 << draw.below(8 * width),
        _ => return bytes.copy_within(other..other + width, at),
    };
    bytes[at..at + width].copy_from_slice(&new.to_le_bytes()[..width]);
}

/// A field of a record, two records that change places, or one that comes twice.
fn record(bytes: &mut [u8], draw: &mut Draw<'_>) {
    let (kind, len) = draw.pick(&[
        (CLUSTERS, RECORD),
        (GROUPS, 64),
        (MEMBERS, 4),
        (LEVELS, 128),
        (CLUSTERS, RECORD),
        (CHUNKS, 8),
    ]);
    let Some(table) = section(bytes, kind) else { return };
    let count = table.len() / len;
    if count == 0 {
        return;
    }
    let mut place = || table.start + draw.below(count) * len;
    let (at, other) = (place(), place());
    match draw.below(8) {
        0 => bytes.copy_within(other..other + len, at),
        1 => {
            let (a, b) = (bytes[at..at + len].to_vec(), bytes[other..other + len].to_vec());
            bytes[at..at + len].copy_from_slice(&b);
            bytes[other..other + len].copy_from_slice(&a);
        }
        // The same field of another record.
        2 => {
            let field = draw.below(len / 4) * 4;
            bytes.copy_within(other + field..other + field + 4, at + field);
        }
        _ => number(bytes, at..at + len, draw),
    }
}

/// A field of a page's header, or a number in one of its arrays.
fn page(bytes: &mut [u8], draw: &mut Draw<'_>) {
    let Some((record, page)) = some_page(bytes, draw) else { return };
    if page.len() < 64 {
        return;
    }
    if draw.once_in(3) {
        let field = draw.below(9) * 4;
        number(bytes, page.start + field..page.start + field + 4, draw);
        // The record says the same, so that only what the page holds can show it.
        let twin = [None, None, Some(16), Some(20), Some(24), Some(28), Some(32), Some(48), None][field / 4];
        if let (Some(twin), true) = (twin, draw.once_in(2)) {
            bytes.copy_within(page.start + field..page.start + field + 4, record + twin);
        }
    } else {
        number(bytes, page.start + 64..page.end, draw);
    }
}

/// Other text, other lengths, or a body that is longer or shorter than it was.
fn metadata(bytes: &mut [u8], draw: &mut Draw<'_>) {
    let Some(body) = section(bytes, METADATA) else { return };
    number(bytes, body.clone(), draw);
    if draw.once_in(3) {
        // Behind it is the padding before the pages.
        let len = (body.len() + draw.below(40)).saturating_sub(20);
        let entry = entry(bytes, METADATA).unwrap_or(bytes.len());
        set_long(bytes, entry + LEN, len as u64);
    }
}

/// Two clusters have each other's page.
fn pages_change_places(bytes: &mut [u8], draw: &mut Draw<'_>) {
    let (Some((a, _)), Some((b, _))) = (some_page(bytes, draw), some_page(bytes, draw)) else { return };
    for at in 0..12 {
        bytes.swap(a + at, b + at);
    }
}

/// Another length, of which the header may or may not know.
fn cut_or_grow(bytes: &mut Vec<u8>, draw: &mut Draw<'_>) {
    let len = if draw.once_in(2) { bytes.len() + draw.below(9000) } else { draw.below(bytes.len() + 1) };
    bytes.resize(len, 0);
    if draw.once_in(2) && bytes.len() >= 32 {
        set_long(bytes, 24, len as u64);
    }
}

/// Makes every checksum right, as far as offsets lead into the file.
fn seal(bytes: &mut [u8]) {
    for at in section(bytes, CLUSTERS).unwrap_or_default().step_by(RECORD) {
        let (Some(start), Some(len)) = (long(bytes, at), word(bytes, at + 8)) else { continue };
        let end = start.saturating_add(len.into());
        if let Some(page) = bytes.get(start as usize..end as usize) {
            let sum = checksum(page);
            set_long(bytes, at + 96, sum);
        }
    }
    seal_chunks(bytes);
    let entries = entries(bytes);
    for entry in (256..).step_by(ENTRY).take(entries) {
        let (Some(range), Some(kind)) = (place(bytes, entry), word(bytes, entry)) else {
            continue;
        };
        // Pages have their own.
        if kind != PAGES {
            let sum = checksum(&bytes[range]);
            set_long(bytes, entry + SUM, sum);
        }
    }
    if let Some(table) = bytes.get(256..256 + entries * ENTRY) {
        let sum = checksum(table);
        set_long(bytes, 240, sum);
    }
    if bytes.len() >= 256 {
        let sum = checksum(&bytes[..248]);
        set_long(bytes, 248, sum);
    }
}

/// Makes the checksums of the tables' chunks right.
fn seal_chunks(bytes: &mut [u8]) {
    let Some(list) = section(bytes, CHUNKS) else { return };
    let chunk = long(bytes, list.start).unwrap_or(0).clamp(64, 1 << 20) as usize;
    let tables = [CLUSTERS, GROUPS, MEMBERS].into_iter().filter_map(|kind| section(bytes, kind));
    let sums: Vec<u64> = tables.flat_map(|table| bytes[table].chunks(chunk)).map(checksum).collect();
    for (at, sum) in list.step_by(8).skip(1).zip(sums) {
        set_long(bytes, at, sum);
    }
}
