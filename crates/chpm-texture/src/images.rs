//! Images: their sizes, and their strips in order.

use crate::TextureError;
use crate::piece::strip_height;
use crate::texels::Texels;
use crate::tiles::{TileRows, Tiles};
use chpm_extmem::{Cancel, ExtmemError, Reservation, Store};
use chpm_image::{Alpha, ImageError, ImageRows};
use std::collections::BTreeMap;
use std::io::{self, BufRead};

/// An image from its first byte on.
pub struct OpenedImage {
    /// The file's.
    pub bytes: Box<dyn BufRead + Send>,
    /// The meaning of its alpha.
    pub alpha: Alpha,
}

/// Opens an image by its number. An image may be opened twice: for its size, then for its pixels.
pub type OpenImage<'a> = dyn FnMut(u32) -> io::Result<OpenedImage> + 'a;

fn open(image: u32, memory: u64, open_image: &mut OpenImage<'_>) -> Result<ImageRows, TextureError> {
    let OpenedImage { bytes, alpha } =
        open_image(image).map_err(|source| TextureError::Open { image, source })?;
    let rows = ImageRows::open(bytes, memory).map_err(|source| TextureError::Image { image, source })?;
    Ok(rows.with_alpha(alpha))
}

/// Width and height of an image.
pub(crate) fn open_size(image: u32, open_image: &mut OpenImage<'_>) -> Result<[u32; 2], TextureError> {
    Ok(open(image, u64::MAX, open_image)?.size())
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

/// Where the pixels of images come from, strip by strip.
pub enum Images<'a, 'b> {
    /// They are decoded.
    Files(&'a mut OpenImage<'b>),
    /// They have been decoded before.
    Tiles(&'a Tiles),
}

impl<'a> Images<'a, '_> {
    fn size(&mut self, image: u32) -> Result<[u32; 2], TextureError> {
        match self {
            Images::Files(open_image) => open_size(image, open_image),
            Images::Tiles(tiles) => Ok(tiles.size(image)),
        }
    }

    /// An image's rows, if there is memory for them and so much beside.
    fn open(
        &mut self,
        store: &Store,
        image: u32,
        beside: impl Fn([u32; 2]) -> u64,
    ) -> Result<(Rows<'a>, Reservation), TextureError> {
        match self {
            Images::Files(open_image) => {
                let (rows, memory) = open_within(store, image, beside, open_image)?;
                Ok((Rows::Decoded(rows), memory))
            }
            Images::Tiles(tiles) => {
                let rows = tiles.rows(image);
                let bytes = rows.memory() + beside(tiles.size(image));
                Ok((Rows::Tiles(rows), store.budget.reserve_work("an image", bytes)?))
            }
        }
    }
}

/// Rows of an image, from the top.
enum Rows<'a> {
    Decoded(ImageRows),
    Tiles(TileRows<'a>),
}

/// Sizes of the images that were asked for.
#[derive(Default)]
pub(crate) struct Sizes(BTreeMap<u32, [u32; 2]>);

impl Sizes {
    pub(crate) fn get(&mut self, image: u32, images: &mut Images<'_, '_>) -> Result<[u32; 2], TextureError> {
        if let Some(size) = self.0.get(&image) {
            return Ok(*size);
        }
        let size = images.size(image)?;
        self.0.insert(image, size);
        Ok(size)
    }
}

/// An image, of which one strip is at hand.
pub(crate) struct Strips<'a> {
    image: u32,
    rows: Rows<'a>,
    size: [u32; 2],
    /// The strip at hand, and how many were read.
    texels: Texels,
    strip: Option<u32>,
    done: u32,
    pixels: Vec<[u8; 4]>,
    _memory: Reservation,
}

impl<'a> Strips<'a> {
    /// Opens an image, if there is memory for its rows and a strip.
    pub(crate) fn open(store: &Store, image: u32, images: &mut Images<'a, '_>) -> Result<Self, TextureError> {
        let strip = |[width, height]: [u32; 2]| {
            Texels::bytes(width as usize, strip_height(width).min(height) as usize)
        };
        let size = images.size(image)?;
        let (rows, memory) = images.open(store, image, strip)?;
        let texels = Texels::new(size[0] as usize);
        Ok(Strips { image, rows, size, texels, strip: None, done: 0, pixels: Vec::new(), _memory: memory })
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
            match &mut self.rows {
                Rows::Decoded(rows) => rows.read_rows(height, &mut self.pixels).map_err(error)?,
                Rows::Tiles(rows) => rows.read(height, &mut self.pixels)?,
            };
            self.done += 1;
        }
        self.texels.fill(&self.pixels);
        self.strip = Some(strip);
        Ok(())
    }

    pub(crate) fn size(&self) -> [u32; 2] {
        self.size
    }

    /// The strip at hand, and the row that it begins with.
    pub(crate) fn texels(&self) -> (&Texels, i64) {
        (&self.texels, i64::from(self.strip.unwrap_or(0)) * i64::from(strip_height(self.size()[0])))
    }
}
