//! One page in memory of its own.

use super::Shared;
use crate::ViewerError;
use crate::gpu::Block;
use crate::gpu::block::Layout;
use chpm_extmem::MappedFile;
use chpm_extmem::platform::read_exact_at;
use chpm_format::{Chpm, Page, Sheet, SheetLayout, SheetRecord};
use chpm_mesh::{Chart, ClusterId};
use chpm_texture::sheet::Sizes;
use std::fmt;
use std::fs::File;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// A cluster's page, and its sheet where that is drawn, read and checked: ready to be played and uploaded. Its bytes count against the budget of the [`super::Fetch`]
/// that read it until it is dropped.
pub struct PageData {
    cluster: ClusterId,
    /// In words, since a page is read in place and needs their alignment.
    words: Vec<u32>,
    len: usize,
    /// Who is told when the bytes go.
    charged: Option<Arc<Shared>>,
    /// Block for the GPU, until somebody takes it; its bytes are taken from [`Shared`]'s room for blocks.
    block: Mutex<Option<Block>>,
    /// Its sheet as it is stored, where it is drawn; and as the GPU is to have it, until somebody takes that, from the same room.
    sheet: Option<Stored>,
    texels: Mutex<Option<Sizes>>,
}

/// A sheet whose layout was checked, and whose image was not decoded.
struct Stored {
    record: SheetRecord,
    layout: SheetLayout,
    image: Vec<u8>,
    /// Its image could not be decoded.
    is_damaged: AtomicBool,
}

/// Bytes that a sheet takes beside its page.
pub(super) fn sheet_bytes(file: &Chpm<MappedFile>, cluster: ClusterId) -> u64 {
    let record = &file.sheets()[cluster.index()];
    let triangles = u64::from(file.clusters()[cluster.index()].triangle_count);
    let charts = u64::from(record.chart_count) * size_of::<Chart>() as u64;
    u64::from(record.image_len) + charts + 2 * triangles
}

impl PageData {
    /// Reads a page at its place and checks all of it.
    pub(super) fn read(
        file: &Chpm<MappedFile>,
        pages: &[File],
        cluster: ClusterId,
        with_sheet: bool,
    ) -> Result<Self, ViewerError> {
        let record = &file.clusters()[cluster.index()];
        let mut len = record.page_len as usize;
        let mut words = vec![0; len.div_ceil(size_of::<u32>())];
        let bytes = &mut bytemuck::cast_slice_mut(&mut words)[..len];
        read(file, pages, cluster, bytes, file.page_place(cluster))?;
        let page = file.page_checked_in(cluster, bytes);
        let page = page.map_err(|source| ViewerError::Page { path: path(file), source })?;
        if let Some(unpacked) = page.into_words() {
            (words, len) = (unpacked, file.page_len(cluster) as usize);
        }
        let sheet = if with_sheet { Stored::read(file, pages, cluster)? } else { None };
        let (block, texels) = (Mutex::new(None), Mutex::new(None));
        Ok(PageData { cluster, words, len, charged: None, block, sheet, texels })
    }

    /// Counts it, and makes the block too if there is room.
    pub(super) fn charged_to(mut self, shared: Arc<Shared>) -> Self {
        let (file, tint) = (&shared.file, &shared.tint);
        let layout = Layout::of(file, self.cluster, tint);
        if shared.take_room(layout.vertex_bytes()) {
            self.block = Mutex::new(Some(Block::tinted(&self.page(), tint, layout.charts)));
        }
        if let (Some(sheet), Some(longest)) = (&self.sheet, tint.longest_sheet())
            && shared.take_room(Sizes::bytes_of(sheet.record.size, longest))
        {
            let texels = sheet.texels(longest);
            if texels.is_none() {
                shared.give_room_back(Sizes::bytes_of(sheet.record.size, longest));
            }
            self.texels = Mutex::new(texels);
        }
        self.charged = Some(shared);
        self
    }

    /// Charts of the sheet's layout, and the chart of each triangle of the finest mesh; none where no sheet is drawn.
    pub fn layout_of_sheet(&self) -> Option<&SheetLayout> {
        self.sheet.as_ref().map(|sheet| &sheet.layout)
    }

    /// Whether its sheet is drawn, unless its image cannot be decoded.
    pub fn may_have_texels(&self) -> bool {
        self.sheet.as_ref().is_some_and(|sheet| !sheet.is_damaged.load(Ordering::Relaxed))
    }

    /// The sheet's texels: made by the reader and handed out once, or made now. None where no sheet is drawn, or its image cannot be decoded.
    pub fn texels(&self) -> Option<Sizes> {
        let longest = self.charged.as_ref()?.tint.longest_sheet()?;
        self.take_texels().or_else(|| self.sheet.as_ref()?.texels(longest))
    }

    fn take_texels(&self) -> Option<Sizes> {
        let texels = self.texels.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let (Some(_), Some(shared), Some(sheet)) = (&texels, &self.charged, &self.sheet) {
            let longest = shared.tint.longest_sheet().unwrap_or(0);
            shared.give_room_back(Sizes::bytes_of(sheet.record.size, longest));
        }
        texels
    }

    /// Block for the GPU: made by the reader and handed out once, or made now.
    pub fn block(&self) -> Block {
        self.take_block().unwrap_or_else(|| match &self.charged {
            Some(shared) => {
                Block::tinted(&self.page(), &shared.tint, shared.tint.charts(&shared.file, self.cluster))
            }
            None => Block::of_page(&self.page()),
        })
    }

    fn take_block(&self) -> Option<Block> {
        let block = self.block.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let (Some(block), Some(shared)) = (&block, &self.charged) {
            shared.give_room_back(block.layout().vertex_bytes());
        }
        block
    }

    /// The page. Looks at its header only.
    pub fn page(&self) -> Page<'_> {
        let bytes = &bytemuck::cast_slice(&self.words)[..self.len];
        Page::view(bytes).expect("it was checked when it was read, and nobody can change it")
    }
}

/// Access for tests and measurements.
#[cfg(feature = "internals")]
impl PageData {
    /// Whose page it is.
    pub fn cluster(&self) -> ClusterId {
        self.cluster
    }

    /// Bytes that it takes: those of the page when it is not packed.
    pub fn len_bytes(&self) -> u64 {
        self.len as u64
    }
}

impl Drop for PageData {
    fn drop(&mut self) {
        drop((self.take_block(), self.take_texels()));
        if let Some(shared) = self.charged.take() {
            // The memory first, then the word that it is free.
            (self.words, self.sheet) = (Vec::new(), None);
            shared.give_back(shared.lens[self.cluster.index()]);
        }
    }
}

impl Stored {
    /// Reads the sheet of a cluster and checks its layout; none where the file has none.
    fn read(
        file: &Chpm<MappedFile>,
        pages: &[File],
        cluster: ClusterId,
    ) -> Result<Option<Self>, ViewerError> {
        let Some((place, len)) = file.sheet_place(cluster) else { return Ok(None) };
        let mut bytes = vec![0; len as usize];
        read(file, pages, cluster, &mut bytes, place)?;
        let sheet = file.sheet_in(cluster, &bytes);
        let sheet = sheet.map_err(|source| ViewerError::Page { path: path(file), source })?;
        Ok(sheet.map(|Sheet { record, layout, image }| {
            let is_damaged = AtomicBool::new(false);
            Stored { record, layout, image: image.to_vec(), is_damaged }
        }))
    }

    fn texels(&self, longest: u32) -> Option<Sizes> {
        let texels = Sizes::decode(self.record.size, &self.image, longest);
        self.is_damaged.store(texels.is_none(), Ordering::Relaxed);
        texels
    }
}

fn path(file: &Chpm<MappedFile>) -> PathBuf {
    file.get_ref().path().to_path_buf()
}

fn read(
    file: &Chpm<MappedFile>,
    pages: &[File],
    cluster: ClusterId,
    bytes: &mut [u8],
    (part, offset): (usize, u64),
) -> Result<(), ViewerError> {
    let len = bytes.len() as u32;
    read_exact_at(&pages[part], bytes, offset).map_err(|source| ViewerError::Read {
        cluster,
        path: file.parts().nth(part).unwrap_or(file.get_ref()).path().to_path_buf(),
        offset,
        len,
        source,
    })
}

impl fmt::Debug for PageData {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "PageData({}, {} bytes)", self.cluster, self.len)
    }
}
