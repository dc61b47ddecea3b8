//! A page that can be looked at, wherever it lies.

use crate::error::FormatError;
use crate::packed;
use crate::page::Page;

/// A page in place, or one that was packed, in memory of its own.
#[derive(Clone, Debug)]
pub struct PageBuf<'a>(Kept<'a>);

#[derive(Clone, Debug)]
enum Kept<'a> {
    InPlace(Page<'a>),
    /// In words, since a page is read in place and needs their alignment; and how many bytes of them.
    Own(Vec<u32>, usize),
}

impl PageBuf<'_> {
    /// The page.
    pub fn view(&self) -> Page<'_> {
        match &self.0 {
            Kept::InPlace(page) => *page,
            Kept::Own(words, len) => {
                let bytes = &bytemuck::cast_slice(words)[..*len];
                Page::view(bytes).expect("it was looked at when it was unpacked, and nobody can change it")
            }
        }
    }

    /// Unpacks a page of `len` bytes.
    pub(crate) fn unpacked(packed: &[u8], len: u64) -> Result<Self, FormatError> {
        let len = len as usize;
        let mut words = vec![0; len.div_ceil(size_of::<u32>())];
        let bytes = &mut bytemuck::cast_slice_mut(&mut words)[..len];
        packed::unpack(packed, bytes)?;
        Self::in_words(words, len)
    }

    /// Unpacks a chained page of `len` bytes, which rests on the finest mesh of another.
    pub(crate) fn unchained(chained: &[u8], len: u64, parent: &Page<'_>) -> Result<Self, FormatError> {
        let len = len as usize;
        let mut words = vec![0; len.div_ceil(size_of::<u32>())];
        let bytes = &mut bytemuck::cast_slice_mut(&mut words)[..len];
        packed::unchain(chained, parent, bytes)?;
        Self::in_words(words, len)
    }

    /// Bytes of memory of its own.
    pub(crate) fn own_len(&self) -> usize {
        match &self.0 {
            Kept::InPlace(_) => 0,
            Kept::Own(words, _) => size_of_val(&words[..]),
        }
    }

    /// The page in memory of its own. `bytes` are those of one that lies in place.
    pub(crate) fn to_own(&self, bytes: &[u8]) -> Result<PageBuf<'static>, FormatError> {
        let bytes = self.bytes_or(bytes);
        let mut words = vec![0; bytes.len().div_ceil(size_of::<u32>())];
        bytemuck::cast_slice_mut(&mut words)[..bytes.len()].copy_from_slice(bytes);
        PageBuf::in_words(words, bytes.len())
    }

    /// A page in words, of which it has `len` bytes.
    pub(crate) fn in_words(words: Vec<u32>, len: usize) -> Result<Self, FormatError> {
        Page::view(&bytemuck::cast_slice(&words)[..len])?;
        Ok(PageBuf(Kept::Own(words, len)))
    }

    /// Its bytes when it is not packed; those given where it lies in place.
    pub fn bytes_or<'b>(&'b self, in_place: &'b [u8]) -> &'b [u8] {
        match &self.0 {
            Kept::InPlace(_) => in_place,
            Kept::Own(words, len) => &bytemuck::cast_slice(words)[..*len],
        }
    }

    /// The words that the page lies in, if it was packed.
    pub fn into_words(self) -> Option<Vec<u32>> {
        match self.0 {
            Kept::InPlace(_) => None,
            Kept::Own(words, _) => Some(words),
        }
    }
}

impl<'a> From<Page<'a>> for PageBuf<'a> {
    fn from(page: Page<'a>) -> Self {
        PageBuf(Kept::InPlace(page))
    }
}
