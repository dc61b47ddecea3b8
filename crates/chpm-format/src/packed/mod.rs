//! Packed pages: every bit of a page in less than half of its bytes. FORMAT.md, "Packed page", says what each byte means.
//!
//! Triangles come first, as a walk from each to the next (`connect`). Numbers that belong to vertices are then told in the order of the
//! walk, as differences from what the vertices before make likely. zstd makes the symbols short.

mod around;
mod bits;
mod chained;
mod connect;
mod follow;
mod pack;
mod streams;
mod unpack;
mod view;

use crate::error::{FilePart, FormatError, invalid};
pub use crate::page::PARTS;
use crate::page::{PAGE_HEADER_LEN, Page, PageHeader};
pub use chained::{CHAINED_MAGIC, Chained, chain, chained_sizes, parent_place, unchain};
use chpm_mesh::{Attributes, ClusterId};
use pack::Packer;
use std::cell::RefCell;
use std::io;
use std::mem;
use unpack::Unpacker;

/// First four bytes of a packed page, "CPGP".
pub const PACKED_MAGIC: u32 = u32::from_le_bytes(*b"CPGP");
/// A page is at most so many times as long as it is packed, so that what a reader allocates has a bound by the file's length.
pub(crate) const MOST_TIMES: usize = 64;
/// The head of a packed page: that of the page up to what is reserved, the view of the positions, how corners are told, the lengths of the
/// open bits.
const HEAD_LEN: usize = 48;
const KEPT: usize = mem::offset_of!(PageHeader, reserved);
/// How a page says at which corners triangles start: each by itself, or at the least.
const TOLD: u8 = 1;
const LEAST_FIRST: u8 = 2;
/// A rule that a packed page breaks.
#[derive(Clone, Copy, Debug)]
struct Damage(&'static str);

impl From<Damage> for FormatError {
    fn from(damage: Damage) -> Self {
        invalid(PLACE, "packed page", damage.0, "another")
    }
}

const PLACE: FilePart = FilePart::Page(ClusterId::NONE);

/// Arrays of numbers that belong to vertices, other than positions: how many numbers a vertex has in each.
fn arrays(attributes: Attributes) -> impl Iterator<Item = usize> {
    let normals = attributes.normals.then_some(3).or(attributes.octahedral.then_some(2));
    let words = std::iter::repeat_n(1, attributes.scalar_words.into());
    normals.into_iter().chain(attributes.colors.then_some(4)).chain(words)
}

/// Symbols that say by which view the words of a scalar are numbers.
const VIEW_SYMBOLS: usize = 2;

/// Symbols of a page at most: those of triangles are as many as there are, or three more for each.
fn most_symbols(header: &PageHeader, attributes: Attributes) -> usize {
    let (v, t) = (header.vertex_count as usize, header.triangle_count as usize);
    let numbers: usize = arrays(attributes).sum();
    let collapses = v - header.base_vertex_count as usize;
    let views = VIEW_SYMBOLS * usize::from(attributes.scalar_words);
    views + 4 * t + v * (1 + 3 + numbers) + 2 * collapses + header.shared_count as usize + v.div_ceil(8)
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
