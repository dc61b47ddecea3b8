//! One page in memory of its own.

use super::Shared;
use crate::ViewerError;
use crate::gpu::Block;
use crate::gpu::block::Layout;
use chpm_extmem::MappedFile;
use chpm_extmem::platform::read_exact_at;
use chpm_format::{Chpm, Page};
use chpm_mesh::ClusterId;
use std::fmt;
use std::fs::File;
use std::sync::{Arc, Mutex, PoisonError};

/// A cluster's page, read and checked: ready to be played and uploaded. Its bytes count against the budget of the [`super::Fetch`]
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
}

impl PageData {
    /// Reads a page at its place and checks all of it.
    pub(super) fn read(
        file: &Chpm<MappedFile>,
        pages: &File,
        cluster: ClusterId,
    ) -> Result<Self, ViewerError> {
        let record = &file.clusters()[cluster.index()];
        let mut len = record.page_len as usize;
        let mut words = vec![0; len.div_ceil(size_of::<u32>())];
        let bytes = &mut bytemuck::cast_slice_mut(&mut words)[..len];
        fn path(file: &Chpm<MappedFile>) -> std::path::PathBuf {
            file.get_ref().path().to_path_buf()
        }
        read_exact_at(pages, bytes, record.page_offset).map_err(|source| ViewerError::Read {
            cluster,
            path: path(file),
            offset: record.page_offset,
            len: record.page_len,
            source,
        })?;
        let page = file.page_checked_in(cluster, bytes);
        let page = page.map_err(|source| ViewerError::Page { path: path(file), source })?;
        if let Some(unpacked) = page.into_words() {
            (words, len) = (unpacked, file.page_len(cluster) as usize);
        }
        Ok(PageData { cluster, words, len, charged: None, block: Mutex::new(None) })
    }

    /// Counts it, and makes the block too if there is room.
    pub(super) fn charged_to(mut self, shared: Arc<Shared>) -> Self {
        let (file, tint) = (&shared.file, shared.tint());
        let record = &file.clusters()[self.cluster.index()];
        let layout = Layout::new(record.vertex_count, record.triangle_count, tint.is_there());
        if shared.take_room(layout.vertex_bytes()) {
            self.block = Mutex::new(Some(Block::tinted(&self.page(), tint)));
        }
        self.charged = Some(shared);
        self
    }

    /// Block for the GPU: made by the reader and handed out once, or made now.
    pub fn block(&self) -> Block {
        self.take_block().unwrap_or_else(|| match &self.charged {
            Some(shared) => Block::tinted(&self.page(), shared.tint()),
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
        drop(self.take_block());
        if let Some(shared) = self.charged.take() {
            // The memory first, then the word that it is free.
            self.words = Vec::new();
            shared.give_back(self.len as u64);
        }
    }
}

impl fmt::Debug for PageData {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "PageData({}, {} bytes)", self.cluster, self.len)
    }
}
