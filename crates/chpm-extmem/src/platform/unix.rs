//! Parts of the platform that Linux, macOS and their relatives share.

use super::Kind;
use crate::Access;
use memmap2::{Advice, Mmap, MmapMut, UncheckedAdvice};
use nix::errno::Errno;
use nix::fcntl::OFlag;
use nix::libc::c_int;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::resource::{Resource, getrlimit};
use nix::sys::signal::{SaFlags, SigAction, SigHandler, SigSet, Signal, raise, sigaction};
use nix::time::{ClockId, clock_gettime};
use std::ffi::{OsStr, OsString};
use std::fs::{self, File, FileType};
use std::io::{self, Read};
use std::os::fd::AsFd;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{FileExt, FileTypeExt, MetadataExt, OpenOptionsExt};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

/// The path of standard input.
pub const STDIN: &str = "/dev/stdin";

/// Device and number of a file: equal for two names of one file.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct FileId {
    device: u64,
    /// Number of the file on its device.
    pub number: u64,
}

/// The file at a path, or that a link there points at.
///
/// # Errors
/// Those of the system.
pub fn id_at(path: &Path) -> io::Result<FileId> {
    fs::metadata(path).map(|found| id(&found))
}

fn id(found: &fs::Metadata) -> FileId {
    FileId { device: found.dev(), number: found.ino() }
}

/// Whether an open file, or folder from [`open_folder`], is the one at `path`.
pub(crate) fn is_at(file: &File, path: &Path) -> bool {
    matches!((file.metadata(), id_at(path)), (Ok(opened), Ok(found)) if id(&opened) == found)
}

/// The kind of what is at a path, or of what a link there points at.
///
/// # Errors
/// Those of the system.
pub fn kind_at(path: &Path) -> io::Result<Kind> {
    Ok(kind(fs::metadata(path)?.file_type()))
}

/// Whether an error says that whoever read a pipe has closed it.
pub fn is_closed_pipe(error: &io::Error) -> bool {
    error.kind() == io::ErrorKind::BrokenPipe
}

/// Whether an error says that a file stays because somebody has it open: never here.
pub(crate) fn is_in_use(_: &io::Error) -> bool {
    false
}

/// The kind of a thing.
pub fn kind(found: FileType) -> Kind {
    match () {
        () if found.is_file() => Kind::File,
        () if found.is_dir() => Kind::Folder,
        () if found.is_fifo() => Kind::Pipe,
        () if found.is_socket() => Kind::Socket,
        () if found.is_char_device() => Kind::Terminal,
        () if found.is_block_device() => Kind::Blocks,
        () => Kind::Other,
    }
}

/// Opens a file to read, and never waits for somebody at the other end of a pipe.
///
/// # Errors
/// Those of the system.
pub fn open_to_read(path: &Path) -> io::Result<File> {
    File::options().read(true).custom_flags(OFlag::O_NONBLOCK.bits()).open(path)
}

/// Opens a folder, to lock it.
pub(crate) fn open_folder(path: &Path) -> io::Result<File> {
    File::open(path)
}

/// Reads all of `bytes` at a place, from any thread.
///
/// # Errors
/// Those of the system; the end of the file before.
pub fn read_exact_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<()> {
    file.read_exact_at(bytes, offset)
}

/// Writes all of `bytes` at a place, from any thread.
///
/// # Errors
/// Those of the system.
pub fn write_all_at(file: &File, bytes: &[u8], offset: u64) -> io::Result<()> {
    file.write_all_at(bytes, offset)
}

/// Has the names in a folder on the disk.
///
/// # Errors
/// Those of the system.
pub fn sync_folder(path: &Path) -> io::Result<()> {
    File::open(path)?.sync_all()
}

/// Bytes that a user without privileges may still write to the file system of `path`.
pub(crate) fn free_bytes(path: &Path) -> Option<u64> {
    let found = nix::sys::statvfs::statvfs(path).ok()?;
    // The types differ between systems.
    #[allow(clippy::unnecessary_cast)]
    (found.blocks_available() as u64).checked_mul(found.fragment_size() as u64)
}

/// The first `most` bytes of a name.
pub(crate) fn first_bytes(name: &OsStr, most: usize) -> OsString {
    OsStr::from_bytes(&name.as_bytes()[..most]).to_owned()
}

/// Processor time that this thread has used.
pub fn thread_time() -> Option<Duration> {
    clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID).ok().map(Duration::from)
}

/// Processor time that all threads of this process have used.
pub fn process_time() -> Option<Duration> {
    clock_gettime(ClockId::CLOCK_PROCESS_CPUTIME_ID).ok().map(Duration::from)
}

/// Files that the process may have open at a time.
///
/// # Errors
/// Those of the system.
pub fn open_files() -> io::Result<u64> {
    Ok(getrlimit(Resource::RLIMIT_NOFILE)?.0)
}

/// The error of a full disk.
pub(crate) fn error_of_full_disk() -> io::Error {
    Errno::ENOSPC.into()
}

/// The error of a disk that fails.
pub(crate) fn error_of_device() -> io::Error {
    Errno::EIO.into()
}

/// Ends the process as nothing in it can prevent.
pub(crate) fn end_process() -> io::Error {
    // A signal to oneself arrives before this returns.
    raise(Signal::SIGKILL).err().map_or_else(error_of_device, io::Error::from)
}

/// Has another program, under a name, take the place of this one. Comes back with the reason where it cannot.
pub fn replace_process(command: &mut Command, name: &OsStr) -> io::Error {
    command.arg0(name).exec()
}

/// A pipe that is read without waiting for it.
#[derive(Debug)]
pub struct Pipe(File);

impl Pipe {
    /// Opens the pipe at `path`, whoever writes there, now or later.
    ///
    /// # Errors
    /// Those of the system.
    pub fn open(path: &Path) -> io::Result<Pipe> {
        open_to_read(path).map(Pipe)
    }

    /// Reads what there is, 0 bytes behind the last one; none if nothing came for `wait` milliseconds.
    ///
    /// # Errors
    /// Those of the system.
    pub fn read(&mut self, bytes: &mut [u8], wait: u16) -> io::Result<Option<usize>> {
        let mut ends = [PollFd::new(self.0.as_fd(), PollFlags::POLLIN)];
        match poll(&mut ends, PollTimeout::from(wait)) {
            Ok(0) | Err(Errno::EINTR) => return Ok(None),
            ready => ready?,
        };
        match self.0.read(bytes) {
            Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted) => {
                Ok(None)
            }
            read => read.map(Some),
        }
    }
}

/// Tells the system how a map will be read. A refused hint is ignored, and so is what lies beyond the end.
pub(crate) fn advise(map: &Mmap, access: Access, offset: usize, len: usize) {
    let start = offset.min(map.len());
    let _ = map.advise_range(advice(access), start, len.min(map.len() - start));
}

/// The same for all of a buffer.
pub(crate) fn advise_buffer(map: &MmapMut, access: Access) {
    let _ = map.advise(advice(access));
}

fn advice(access: Access) -> Advice {
    match access {
        Access::Sequential => Advice::Sequential,
        Access::Random => Advice::Random,
        Access::WillNeed => Advice::WillNeed,
    }
}

/// Drops the pages of a map from this process's resident memory; they are read again when touched.
pub(crate) fn drop_pages(map: &Mmap) {
    // SAFETY: a read-only map of a file: dropped pages are read back from the file unchanged.
    let _ = unsafe { map.unchecked_advise(UncheckedAdvice::DontNeed) };
}

/// Whether METIS's C code has the variables of each thread that it asks for.
#[cfg_attr(not(feature = "metis"), allow(dead_code))]
pub(crate) const THREADS_KEEP_VARIABLES: bool = true;

/// The action of a signal, to be set back.
#[cfg_attr(not(feature = "metis"), allow(dead_code))]
#[derive(Debug)]
pub(crate) struct SignalAction(Signal, SigAction);

#[cfg_attr(not(feature = "metis"), allow(dead_code))]
impl SignalAction {
    /// The signals that METIS raises where it cannot go on.
    pub(crate) const OF_METIS: [Signal; 2] = [Signal::SIGABRT, Signal::SIGTERM];

    /// Has `handler` called when the signal comes, and answers what it did before.
    ///
    /// # Safety
    /// The handler may be called at any time, in any thread, until it is set back.
    pub(crate) unsafe fn set(signal: Signal, handler: extern "C" fn(c_int)) -> io::Result<SignalAction> {
        let action = SigAction::new(SigHandler::Handler(handler), SaFlags::SA_RESTART, SigSet::empty());
        // SAFETY: as the caller promises.
        Ok(SignalAction(signal, unsafe { sigaction(signal, &action) }?))
    }

    /// Sets it back.
    ///
    /// # Safety
    /// Whoever set what was there before still answers for it.
    pub(crate) unsafe fn restore(self) {
        // SAFETY: as the caller promises.
        let _ = unsafe { sigaction(self.0, &self.1) };
    }
}
