//! Images: their sizes, and their strips in order.

use crate::TextureError;
use crate::piece::strip_height;
use crate::texels::Texels;
use chpm_extmem::{Cancel, ExtmemError, Reservation, Store};
use chpm_image::{ImageError, ImageRows};
use std::collections::BTreeMap;
use std::io::{self, BufRead};

/// Opens an image by its number. An image may be opened twice: for its size, then for its pixels.
pub type OpenImage<'a> = dyn FnMut(u32) -> io::Result<Box<dyn BufRead + Send>> + 'a;

fn open(image: u32, memory: u64, open_image: &mut OpenImage<'_>) -> Result<ImageRows, TextureError> {
    let bytes = open_image(image).map_err(|source| TextureError::Open { image, source })?;
    ImageRows::open(bytes, memory).map_err(|source| TextureError::Image { image, source })
}

/// Opens an image, if there is memory for its decoder and for what `beside` says of its size.
pub(crate) fn open_within(
    store: &Store,
    image: u32,
    beside: impl Fn([u32; 2]) -> u64,
    open_image: &mut OpenImage<'_>,
) -> Result<(ImageRows, Reservation), TextureError> {
    let rows = open(image, u64::MAX, open_image)?;
    let beside = beside(rows.size());
    let memory = match store.budget.reserve_work("an image", rows.memory() + beside) {
        // The image says how it would take less.
        Err(ExtmemError::Budget { used, limit, .. }) => {
            open(image, limit.saturating_sub(used + beside), open_image)?;
            store.budget.reserve_work("an image", rows.memory() + beside)?
        }
        memory => memory?,
    };
    Ok((rows, memory))
}

/// Sizes of the images that were asked for.
#[derive(Default)]
pub(crate) struct Sizes(BTreeMap<u32, [u32; 2]>);

impl Sizes {
    pub(crate) fn get(
        &mut self,
        image: u32,
        open_image: &mut OpenImage<'_>,
    ) -> Result<[u32; 2], TextureError> {
        if let Some(size) = self.0.get(&image) {
            return Ok(*size);
        }
        let size = open(image, u64::MAX, open_image)?.size();
        self.0.insert(image, size);
        Ok(size)
    }
}

/// An image, of which one strip is at hand.
pub(crate) struct Strips {
    image: u32,
    rows: ImageRows,
    /// The strip at hand, and how many were read.
    texels: Texels,
    strip: Option<u32>,
    done: u32,
    pixels: Vec<[u8; 4]>,
    _memory: Reservation,
}

impl Strips {
    /// Opens an image, if there is memory for its decoder and a strip.
    pub(crate) fn open(
        store: &Store,
        image: u32,
        open_image: &mut OpenImage<'_>,
    ) -> Result<Self, TextureError> {
        let strip = |[width, height]: [u32; 2]| {
            Texels::bytes(width as usize, strip_height(width).min(height) as usize)
        };
        let (rows, memory) = open_within(store, image, strip, open_image)?;
        let texels = Texels::new(rows.size()[0] as usize);
        Ok(Strips { image, rows, texels, strip: None, done: 0, pixels: Vec::new(), _memory: memory })
    }

    /// Goes on to a strip, at or after the one at hand.
    pub(crate) fn go_to(&mut self, strip: u32, cancel: &Cancel) -> Result<(), TextureError> {
        if self.strip == Some(strip) {
            return Ok(());
        }
        let height = strip_height(self.size()[0]) as usize;
        while self.done <= strip {
            cancel.check()?;
            let image = self.image;
            let error = |source: ImageError| TextureError::Image { image, source };
            self.rows.read_rows(height, &mut self.pixels).map_err(error)?;
            self.done += 1;
        }
        self.texels.fill(&self.pixels);
        self.strip = Some(strip);
        Ok(())
    }

    pub(crate) fn size(&self) -> [u32; 2] {
        self.rows.size()
    }

    /// The strip at hand, and the row that it begins with.
    pub(crate) fn texels(&self) -> (&Texels, i64) {
        (&self.texels, i64::from(self.strip.unwrap_or(0)) * i64::from(strip_height(self.size()[0])))
    }
}
