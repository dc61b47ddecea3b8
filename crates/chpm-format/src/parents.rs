//! Pages that chained ones are told by, unpacked: some of them are kept, those that were used last.

use crate::error::{FilePart, FormatError, invalid};
use crate::page_buf::PageBuf;
use chpm_mesh::ClusterId;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Bytes of pages that are kept, unless somebody says otherwise.
const KEPT_BYTES: usize = 16 << 20;
/// Pages that each rest on the next, at most: hierarchies are balanced, and those that are as high have more clusters than ids.
const MOST_ABOVE: usize = 64;

/// A page that nobody changes any more.
pub(crate) type Parent = Arc<PageBuf<'static>>;

/// The pages that are kept, of one file.
#[derive(Debug, Default)]
pub(crate) struct Parents(Mutex<Kept>);

#[derive(Debug)]
struct Kept {
    pages: BTreeMap<ClusterId, (u64, Parent)>,
    bytes: usize,
    most_bytes: usize,
    /// Counts uses.
    clock: u64,
}

impl Default for Kept {
    fn default() -> Self {
        Kept { pages: BTreeMap::new(), bytes: 0, most_bytes: KEPT_BYTES, clock: 0 }
    }
}

impl Kept {
    fn get(&mut self, id: ClusterId) -> Option<Parent> {
        self.clock += 1;
        let (used, page) = self.pages.get_mut(&id)?;
        *used = self.clock;
        Some(Arc::clone(page))
    }

    fn put(&mut self, id: ClusterId, page: &Parent) {
        self.clock += 1;
        self.bytes += page.own_len();
        if let Some((_, before)) = self.pages.insert(id, (self.clock, Arc::clone(page))) {
            self.bytes -= before.own_len();
        }
        self.shrink();
    }

    /// Lets go of pages that are too many.
    fn shrink(&mut self) {
        while self.bytes > self.most_bytes && self.pages.len() > 1 {
            let oldest = self.pages.iter().min_by_key(|(_, (used, _))| *used).map(|(id, _)| *id);
            let Some((_, page)) = oldest.and_then(|id| self.pages.remove(&id)) else { return };
            self.bytes -= page.own_len();
        }
    }
}

/// A page that is not unpacked yet: itself, or the one above and what unpacks it with that.
pub(crate) enum Step<'a> {
    /// It rests on none.
    Whole(Parent),
    /// It rests on this one's, and its bytes are these.
    On(ClusterId, std::borrow::Cow<'a, [u8]>),
}

impl Parents {
    /// From now on keeps so many bytes, and one page at least.
    pub(crate) fn keep_bytes(&self, most: usize) {
        let mut kept = self.kept();
        kept.most_bytes = most;
        kept.shrink();
    }

    /// The page of a cluster: one that is kept, or what `step` says of it and of those above, unpacked from the top by `unchain`.
    pub(crate) fn page<'a, S>(
        &self,
        id: ClusterId,
        source: &mut S,
        step: impl Fn(&mut S, ClusterId) -> Result<Step<'a>, FormatError>,
        unchain: impl Fn(&mut S, ClusterId, &[u8], &PageBuf<'_>) -> Result<PageBuf<'static>, FormatError>,
    ) -> Result<Parent, FormatError> {
        let (mut way, mut at) = (Vec::new(), id);
        let mut page = loop {
            if let Some(page) = self.kept().get(at) {
                break page;
            }
            match step(source, at)? {
                Step::Whole(page) => {
                    self.kept().put(at, &page);
                    break page;
                }
                Step::On(parent, bytes) => {
                    way.push((at, bytes));
                    at = parent;
                }
            }
            if way.len() > MOST_ABOVE {
                let told = format_args!("{} and more", MOST_ABOVE);
                return Err(invalid(FilePart::Page(id), "pages above", "at most 64", told));
            }
        };
        for (id, bytes) in way.into_iter().rev() {
            page = Arc::new(unchain(source, id, &bytes, &page)?);
            self.kept().put(id, &page);
        }
        Ok(page)
    }

    pub(crate) fn get(&self, id: ClusterId) -> Option<Parent> {
        self.kept().get(id)
    }

    /// Keeps a page, unless it is here.
    pub(crate) fn keep(
        &self,
        id: ClusterId,
        page: impl FnOnce() -> Result<PageBuf<'static>, FormatError>,
    ) -> Result<(), FormatError> {
        if self.get(id).is_none() {
            let page = Arc::new(page()?);
            self.kept().put(id, &page);
        }
        Ok(())
    }

    fn kept(&self) -> std::sync::MutexGuard<'_, Kept> {
        // A page is put in whole or not at all.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
