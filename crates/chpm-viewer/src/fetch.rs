//! Pages from the file, read and checked by threads of their own: no frame waits for the disk.
//!
//! Pages are read by their place in the file (`pread`) into memory of their own and never touched in the map. So what they take is
//! known to the byte and kept within a budget, nothing of them stays resident behind one's back, and a file that is truncated
//! meanwhile is an error with a name, not a signal. The next page in the queue is announced to the system while one is read.
//!
//! Who wants pages decides which (`chpm_refine::Residency`); here is only the doing. What arrives is handed out in the order of
//! cluster ids, whichever thread came first.

mod page;
mod queue;

pub use page::PageData;

use crate::ViewerError;
use crate::tint::Tint;
use chpm_extmem::{Access, MappedFile};
use chpm_format::Chpm;
use chpm_mesh::{Bytes, ClusterId};
use queue::{Queue, Urgency};
use std::fs::File;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// A page that came, or why it cannot.
pub type Arrival = (ClusterId, Result<Arc<PageData>, ViewerError>);

/// Threads that read pages. Dropping it waits for the pages that are being read, not for those in the queue.
#[derive(Debug)]
pub struct Fetch {
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
}

/// State that the threads share.
#[derive(Debug)]
struct Shared {
    file: Arc<Chpm<MappedFile>>,
    /// The same file once more, for reading at an offset.
    /// The file, and its volumes if it has any.
    pages: Vec<File>,
    /// Bytes that each page takes.
    lens: Vec<u64>,
    queue: Mutex<Queue>,
    /// Something to read has come, or room for it, or the end.
    work: Condvar,
    /// Something was read, or nothing more can be.
    news: Condvar,
    /// Bytes that blocks may take, and that those do which wait to be taken.
    room: AtomicU64,
    blocks: AtomicU64,
    /// Colours of blocks.
    tint: Tint,
}

/// Bytes that each page takes when it is there: what it has when it is not packed, and its sheet.
pub(crate) fn held_bytes(file: &Chpm<MappedFile>, tint: &Tint) -> Vec<u64> {
    let ids = (0..file.header().cluster_count).map(ClusterId);
    let sheet = |id: ClusterId| tint.longest_sheet().map_or(0, |_| page::sheet_bytes(file, id));
    ids.map(|id| file.page_len(id) + sheet(id)).collect()
}

impl Fetch {
    /// Starts `threads` readers (one at least) for a file, and for blocks in some colours. The bytes of all pages that they read and that anybody still holds, with
    /// the sheets of what is drawn with sheets, stay within `budget`, or within the roots' bytes if they are more: without the roots nothing can be drawn.
    ///
    /// # Errors
    /// [`ViewerError::Open`] if the file cannot be opened a second time, [`ViewerError::Thread`] if the system refuses a thread.
    pub(crate) fn tinted(
        file: Arc<Chpm<MappedFile>>,
        tint: Tint,
        threads: usize,
        budget: Bytes,
    ) -> Result<Self, ViewerError> {
        let open = |part: &MappedFile| {
            let path = part.path();
            File::open(path).map_err(|source| ViewerError::Open { path: path.to_path_buf(), source })
        };
        let pages = file.parts().map(open).collect::<Result<_, _>>()?;
        let lens = held_bytes(&file, &tint);
        let roots = file.roots().map(|root| lens[root.index()]).sum();
        let (room, blocks) = (AtomicU64::new(0), AtomicU64::new(0));
        let queue = Mutex::new(Queue::new(lens.clone(), budget.0.max(roots)));
        let shared = Arc::new(Shared {
            file,
            pages,
            lens,
            queue,
            work: Condvar::new(),
            news: Condvar::new(),
            room,
            blocks,
            tint,
        });
        let mut fetch = Fetch { shared, threads: Vec::new() };
        for index in 0..threads.max(1) {
            let shared = Arc::clone(&fetch.shared);
            let thread = thread::Builder::new().name(format!("fetch {index}"));
            let thread = thread.spawn(move || shared.serve()).map_err(ViewerError::Thread)?;
            fetch.threads.push(thread);
        }
        Ok(fetch)
    }

    /// Has the readers make the blocks of pages too ([`PageData::block`]), from now on. Those that wait to be taken have so many bytes,
    /// beside the budget; without room a block is made by who asks for it.
    pub fn make_blocks(&self, room: Bytes) {
        self.shared.room.store(room.0, Ordering::Relaxed);
    }

    /// Asks for a page that a view wants. Those asked for first come first, before all that is read ahead. Asking for a page that is
    /// on its way changes nothing but that; one that arrived before and was handed out is read again.
    ///
    /// # Panics
    /// For a cluster that the file does not have.
    pub fn request(&self, cluster: ClusterId) {
        self.ask(cluster, Urgency::Wanted);
    }

    /// Asks for a page that a view may want soon.
    ///
    /// # Panics
    /// As [`Fetch::request`].
    pub fn request_ahead(&self, cluster: ClusterId) {
        self.ask(cluster, Urgency::Ahead);
    }

    fn ask(&self, cluster: ClusterId, urgency: Urgency) {
        if self.shared.lock().request(cluster, urgency) {
            self.shared.work.notify_one();
        }
    }

    /// Takes a request back, whatever has become of it: nothing arrives for it any more. A page that was handed out is not touched;
    /// its memory is free when the last one who holds it lets go.
    ///
    /// # Panics
    /// As [`Fetch::request`].
    pub fn evict(&self, cluster: ClusterId) {
        // Dropped after the lock is open again: a page that goes gives its bytes back, and asks for the lock to do so.
        let dropped = self.shared.lock().evict(cluster);
        drop(dropped);
        // The next in the queue may have room where this one had none.
        self.shared.work.notify_all();
        self.shared.news.notify_all();
    }

    /// Pages that arrived since the last call, by cluster ids. Never waits.
    pub fn try_arrived(&mut self) -> Vec<Arrival> {
        self.shared.lock().take_arrived()
    }

    /// Waits until all that was asked for is there, and answers what arrived since the last call, by cluster ids. Comes back early, with
    /// less, if the rest finds no room within the budget: somebody must let pages go before it can come.
    pub fn wait_arrived(&mut self) -> Vec<Arrival> {
        let mut queue = self.shared.lock();
        while queue.is_moving() {
            queue = self.shared.news.wait(queue).unwrap_or_else(PoisonError::into_inner);
        }
        queue.take_arrived()
    }

    /// The same, but no longer than this.
    pub fn wait_arrived_for(&mut self, patience: Duration) -> Vec<Arrival> {
        let until = Instant::now() + patience;
        let mut queue = self.shared.lock();
        while queue.is_moving() {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            queue = self.shared.news.wait_timeout(queue, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        queue.take_arrived()
    }
}

/// Access for tests and measurements.
#[cfg(feature = "internals")]
impl Fetch {
    /// Readers for blocks in the file's own colours, without sheets.
    ///
    /// # Errors
    /// As the viewer's.
    pub fn new(file: Arc<Chpm<MappedFile>>, threads: usize, budget: Bytes) -> Result<Self, ViewerError> {
        let tint = Tint::of(&file, None).with_sheets_to(None);
        Fetch::tinted(file, tint, threads, budget)
    }

    /// Pages asked for that have not arrived.
    pub fn pending(&self) -> usize {
        self.shared.lock().pending()
    }

    /// Bytes of the pages that are there, handed out or not, or being read.
    pub fn held(&self) -> Bytes {
        Bytes(self.shared.lock().held())
    }

    /// Bytes of the blocks that were made and not taken.
    pub fn blocks(&self) -> Bytes {
        Bytes(self.shared.blocks.load(Ordering::Relaxed))
    }

    /// The most bytes that were held at once.
    pub fn peak(&self) -> Bytes {
        Bytes(self.shared.lock().peak())
    }
}

impl Drop for Fetch {
    fn drop(&mut self) {
        self.shared.lock().close();
        self.shared.work.notify_all();
        for thread in self.threads.drain(..) {
            // A reader that panicked has said so on its own.
            let _ = thread.join();
        }
        // What nobody has fetched holds on to the queue that holds it.
        drop(self.try_arrived());
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Queue> {
        // The queue is consistent between its calls, whatever happened to a thread that held it.
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A reader's life: the most urgent page that has room, until the end.
    fn serve(self: &Arc<Self>) {
        let mut queue = self.lock();
        while !queue.is_closed() {
            let Some((cluster, next)) = queue.start() else {
                self.news.notify_all();
                queue = self.work.wait(queue).unwrap_or_else(PoisonError::into_inner);
                continue;
            };
            drop(queue);
            if let Some(next) = next {
                self.announce(next);
            }
            let page = self.read(cluster);
            queue = self.lock();
            let unwanted = queue.finish((cluster, page));
            drop(queue);
            self.news.notify_all();
            drop(unwanted);
            queue = self.lock();
        }
    }

    fn announce(&self, cluster: ClusterId) {
        let record = &self.file.clusters()[cluster.index()];
        let (part, offset) = self.file.page_place(cluster);
        if let Some(map) = self.file.parts().nth(part) {
            map.advise_range(Access::WillNeed, offset as usize, record.page_len as usize);
        }
    }

    /// Reads and checks. What the page takes is given back by its drop, and here if there will be none.
    fn read(self: &Arc<Self>, cluster: ClusterId) -> Result<Arc<PageData>, ViewerError> {
        let page = PageData::read(&self.file, &self.pages, cluster, self.tint.longest_sheet().is_some());
        match page {
            Ok(page) => Ok(Arc::new(page.charged_to(Arc::clone(self)))),
            Err(error) => {
                self.give_back(self.lens[cluster.index()]);
                Err(error)
            }
        }
    }

    /// Counts a block, if there is room for it.
    fn take_room(&self, bytes: u64) -> bool {
        let room = self.room.load(Ordering::Relaxed);
        self.blocks
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |blocks: u64| {
                blocks.checked_add(bytes).filter(|blocks| *blocks <= room)
            })
            .is_ok()
    }

    fn give_room_back(&self, bytes: u64) {
        self.blocks.fetch_sub(bytes, Ordering::Relaxed);
    }

    /// Room again.
    fn give_back(&self, bytes: u64) {
        self.lock().give_back(bytes);
        self.work.notify_all();
    }
}
