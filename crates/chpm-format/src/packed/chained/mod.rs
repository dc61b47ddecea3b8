//! Chained pages: what the base mesh is comes from a page above, and all other vertices and triangles by vertex splits.
//!
//! The finest mesh of a coarse cluster holds the base meshes of the fine ones that replace it (I4). So a page says which of its triangles those are, and then, split
//! by split, which vertex is split, which of the triangles about it the new vertex takes, and how far that is from the middle of its ring. FORMAT.md, "Chained page".

mod base;
mod read;
mod rings;
mod write;

use super::Damage;
use super::bits::Near;
use crate::error::FormatError;
use crate::page::{PARTS, Page};
use read::Reader;
use std::cell::RefCell;
use write::Writer;

/// First four bytes of a chained page, "CPGC".
pub const CHAINED_MAGIC: u32 = u32::from_le_bytes(*b"CPGC");
/// Lengths of runs: of triangles of the page above, of vertices that are not shared.
const RUNS: Near = Near(16);
/// The symbol of a split of which each triangle is told by itself.
const ODD: u8 = 0;

/// The symbol of a split that is not odd, by whether triangles come in front of those that go and behind.
fn symbol_of([in_front, behind]: [bool; 2]) -> u8 {
    1 + 2 * u8::from(!in_front) + u8::from(!behind)
}

/// Its parts.
#[inline]
fn ends_of(symbol: u8) -> Result<[bool; 2], Damage> {
    let told = symbol.wrapping_sub(1);
    if told < 4 { Ok([told & 2 == 0, told & 1 == 0]) } else { Err(Damage("a split that is known")) }
}

/// A share is a part of so many bits.
const SHARE_BITS: u32 = 20;

/// Factors that make a mean of a sum.
struct Shares([i64; 64]);

impl Shares {
    fn new() -> Self {
        Shares(std::array::from_fn(|count| (1 << SHARE_BITS) / count.max(1) as i64))
    }

    /// The number that is as far from `middle` as the numbers of `links` are from it in the mean, the middle itself being one of them.
    #[inline(always)]
    fn guess<const N: usize>(&self, all: &[[u32; N]], middle: u16, links: &[u16]) -> [u32; N] {
        let at = all[usize::from(middle)];
        let mut sums = [0u32; N];
        for link in links {
            let link = all[usize::from(*link)];
            for i in 0..N {
                sums[i] = sums[i].wrapping_add(link[i].wrapping_sub(at[i]));
            }
        }
        let count = links.len() + 1;
        let share = self.0.get(count).copied().unwrap_or_else(|| (1 << SHARE_BITS) / count as i64);
        std::array::from_fn(|i| {
            let mean = i64::from(sums[i] as i32) * share >> SHARE_BITS;
            at[i].wrapping_add(mean as u32)
        })
    }
}

/// The outcome of [`chain`].
#[derive(Debug)]
pub struct Chained {
    /// The page with its vertices and triangles in the order that the chained page has them in.
    pub raw: Vec<u8>,
    /// By vertex of the page that was given: which one it is there.
    pub vertices: Vec<u16>,
}

thread_local! {
    static WRITER: RefCell<Option<Writer>> = const { RefCell::new(None) };
    static READER: RefCell<Option<Reader>> = const { RefCell::new(None) };
}

/// Appends the chained form of a page, whose base mesh is a part of the finest mesh of `parent`, and answers the page in the order that comes of it; none
/// where there is no such form, and then `out` is as before. `place` is that of the parent among the coarse clusters of its group.
///
/// # Errors
/// What [`Page::parse`] refuses; [`FormatError::Write`] where zstd fails.
pub fn chain(
    raw: &[u8],
    parent: &Page<'_>,
    place: u16,
    out: &mut Vec<u8>,
) -> Result<Option<Chained>, FormatError> {
    let page = Page::parse(raw)?;
    let start = out.len();
    let order = WRITER.with_borrow_mut(|writer| {
        let writer = match writer {
            Some(writer) => writer,
            None => writer.insert(Writer::new()?),
        };
        writer.write(raw, &page, parent, place, out)
    })?;
    let len = out.len() - start;
    let is_short = len < raw.len() && raw.len() <= super::MOST_TIMES * len;
    let Some(vertices) = order.filter(|_| is_short) else {
        out.truncate(start);
        return Ok(None);
    };
    let mut ordered = vec![0; raw.len()];
    unchain(&out[start..], parent, &mut ordered)?;
    Ok(Some(Chained { raw: ordered, vertices }))
}

/// Bits of a page's chained form by what they are for, in the order of [`PARTS`]; none where there is no such form.
///
/// # Errors
/// As [`chain`].
pub fn chained_sizes(raw: &[u8], parent: &Page<'_>) -> Result<Option<[u64; PARTS.len()]>, FormatError> {
    let mut out = Vec::new();
    if chain(raw, parent, 0, &mut out)?.is_none() {
        return Ok(None);
    }
    let attributes = parent.attributes();
    Ok(WRITER.with_borrow(|writer| writer.as_ref().map(|writer| writer.sizes(attributes))))
}

/// The parent of a chained page, by its place among the coarse clusters of its group; none where bytes do not begin like a chained page.
pub fn parent_place(bytes: &[u8]) -> Option<u16> {
    let head = bytes.first_chunk::<{ super::HEAD_LEN }>()?;
    let place = u16::from_le_bytes([head[super::KEPT + 2], head[super::KEPT + 3]]);
    head.starts_with(&CHAINED_MAGIC.to_le_bytes()).then_some(place)
}

/// Fills `raw` with the page of a chained one, which must be as long as its counts say.
///
/// # Errors
/// As [`super::unpack`]; and what comes out is to be checked likewise.
pub fn unchain(chained: &[u8], parent: &Page<'_>, raw: &mut [u8]) -> Result<(), FormatError> {
    READER.with_borrow_mut(|reader| {
        let reader = match reader {
            Some(reader) => reader,
            None => reader.insert(Reader::new()?),
        };
        reader.read(chained, parent, raw)
    })
}
