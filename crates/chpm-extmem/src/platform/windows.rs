//! Windows.
//!
//! A file that is mapped cannot be truncated or replaced there: whoever tries gets an error, and nobody reads what is gone. On a drive of the network
//! that goes away the system ends the process.

use super::{Kind, absolute};
use crate::Access;
use memmap2::{Mmap, MmapMut};
use std::ffi::{OsStr, OsString, c_int};
use std::fs::{self, File, FileType, OpenOptions};
use std::io;
use std::os::windows::ffi::{OsStrExt, OsStringExt};
use std::os::windows::fs::{FileExt, OpenOptionsExt};
use std::os::windows::io::{AsHandle, AsRawHandle};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;
use std::{mem, ptr};
use windows_sys::Win32::Foundation::{
    ERROR_DISK_FULL, ERROR_IO_DEVICE, ERROR_NOT_SUPPORTED, ERROR_PIPE_NOT_CONNECTED, ERROR_SHARING_VIOLATION,
    FILETIME,
};
use windows_sys::Win32::Storage::FileSystem::{
    BY_HANDLE_FILE_INFORMATION, FILE_FLAG_BACKUP_SEMANTICS, GetDiskFreeSpaceExW, GetFileInformationByHandle,
};
use windows_sys::Win32::System::ProcessStatus::{K32GetProcessMemoryInfo, PROCESS_MEMORY_COUNTERS};
use windows_sys::Win32::System::Threading::{GetCurrentProcess, GetProcessTimes, TerminateProcess};

/// Whether keyboards have a Command key, which is the one for shortcuts.
pub const HAS_COMMAND_KEY: bool = false;

/// The path that stands for standard input, which has none: the functions here know it.
pub const STDIN: &str = r"\\.\standard input";

/// File in a folder that says by its lock that somebody is at work: folders cannot be locked.
const HELD: &str = ".held";

/// Volume and number of a file: equal for two names of one file.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct FileId {
    volume: u32,
    /// Number of the file on its volume.
    pub number: u64,
}

/// The file at a path, or that a link there points at.
///
/// # Errors
/// Those of the system.
pub fn id_at(path: &Path) -> io::Result<FileId> {
    // Without this flag folders cannot be opened; without access rights what others have open can.
    id(&File::options().access_mode(0).custom_flags(FILE_FLAG_BACKUP_SEMANTICS).open(path)?)
}

fn id(file: &File) -> io::Result<FileId> {
    // SAFETY: all-zero bytes are a value of this type, which has numbers only.
    let mut found: BY_HANDLE_FILE_INFORMATION = unsafe { mem::zeroed() };
    // SAFETY: the handle is open as long as `file`, and `found` is of the type that is filled.
    if unsafe { GetFileInformationByHandle(file.as_raw_handle(), &mut found) } == 0 {
        return Err(io::Error::last_os_error());
    }
    let number = u64::from(found.nFileIndexHigh) << 32 | u64::from(found.nFileIndexLow);
    Ok(FileId { volume: found.dwVolumeSerialNumber, number })
}

/// Whether an open file, or folder from [`open_folder`], is the one at `path`.
pub(crate) fn is_at(file: &File, path: &Path) -> bool {
    matches!((id(file), id_at(&lock_of(path))), (Ok(opened), Ok(found)) if opened == found)
}

fn lock_of(path: &Path) -> PathBuf {
    if path.is_dir() { path.join(HELD) } else { path.to_owned() }
}

/// The kind of what is at a path, or of what a link there points at. Standard input counts as a pipe, whatever it is.
///
/// # Errors
/// Those of the system.
pub fn kind_at(path: &Path) -> io::Result<Kind> {
    if path == Path::new(STDIN) {
        return Ok(Kind::Pipe);
    }
    Ok(kind(fs::metadata(path)?.file_type()))
}

/// Whether an error says that whoever read a pipe has closed it.
pub fn is_closed_pipe(error: &io::Error) -> bool {
    error.kind() == io::ErrorKind::BrokenPipe || error.raw_os_error() == Some(ERROR_PIPE_NOT_CONNECTED as i32)
}

/// Whether an error says that a file stays because somebody has it open.
pub(crate) fn is_in_use(error: &io::Error) -> bool {
    error.raw_os_error() == Some(ERROR_SHARING_VIOLATION as i32)
}

/// The kind of a thing.
pub fn kind(found: FileType) -> Kind {
    match () {
        () if found.is_file() => Kind::File,
        () if found.is_dir() => Kind::Folder,
        () => Kind::Other,
    }
}

/// Opens a file to read.
///
/// # Errors
/// Those of the system.
pub fn open_to_read(path: &Path) -> io::Result<File> {
    // With this flag a folder opens, too, and can be told from what may not be read.
    File::options().read(true).custom_flags(FILE_FLAG_BACKUP_SEMANTICS).open(path)
}

/// Opens the file that stands for a folder, to lock it.
pub(crate) fn open_folder(path: &Path) -> io::Result<File> {
    OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path.join(HELD))
}

/// Reads all of `bytes` at a place, from any thread. Moves the file's own place, which nobody who calls this uses.
///
/// # Errors
/// Those of the system; the end of the file before.
pub fn read_exact_at(file: &File, mut bytes: &mut [u8], mut offset: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        match file.seek_read(bytes, offset) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(count) => {
                bytes = &mut bytes[count..];
                offset += count as u64;
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// Writes all of `bytes` at a place, from any thread. Moves the file's own place, which nobody who calls this uses.
///
/// # Errors
/// Those of the system.
pub fn write_all_at(file: &File, mut bytes: &[u8], mut offset: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        match file.seek_write(bytes, offset) {
            Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
            Ok(count) => {
                bytes = &bytes[count..];
                offset += count as u64;
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// Nothing: the file system keeps a journal of names.
///
/// # Errors
/// None.
pub fn sync_folder(_: &Path) -> io::Result<()> {
    Ok(())
}

/// Has each file below a folder on the disk: there is no call for all of them.
///
/// # Errors
/// Those of the system.
pub fn sync_below(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        match kind(entry.file_type()?) {
            Kind::Folder => sync_below(&entry.path())?,
            Kind::File => File::options().write(true).open(entry.path())?.sync_all()?,
            _ => {}
        }
    }
    Ok(())
}

/// Two folders get each other's names, one after the other.
///
/// # Errors
/// Those of the system; both have their names then.
pub fn exchange(one: &Path, other: &Path) -> io::Result<()> {
    super::exchange_in_steps(one, other)
}

/// Gives a file its length, and takes the space on the disk.
pub(crate) fn allocate(file: &File, bytes: u64) -> io::Result<()> {
    file.set_len(bytes)
}

/// Bytes that the user may still write to the volume of `path`.
pub(crate) fn free_bytes(path: &Path) -> Option<u64> {
    let mut free = 0;
    let wide: Vec<u16> = path.as_os_str().encode_wide().chain([0]).collect();
    // SAFETY: the name ends in zero, the first number is of the type that is filled, the others are not wanted.
    let found = unsafe { GetDiskFreeSpaceExW(wide.as_ptr(), &mut free, ptr::null_mut(), ptr::null_mut()) };
    (found != 0).then_some(free)
}

/// The first characters of a name, of at most `most` units of 16 bits.
pub(crate) fn first_bytes(name: &OsStr, most: usize) -> OsString {
    let wide: Vec<u16> = name.encode_wide().take(most).collect();
    OsString::from_wide(&wide)
}

/// Files that the process may have open at a time: as many as there is memory for.
///
/// # Errors
/// None.
pub fn open_files() -> io::Result<u64> {
    Ok(1 << 24)
}

/// Nothing: large blocks are mapped one by one as it is.
pub(crate) fn map_large_blocks(_: i32) {}

/// Nothing: the system's own allocator does so by itself.
pub(crate) fn trim_heap() {}

/// The most bytes of physical memory that the process ever held.
pub fn peak_resident() -> Option<u64> {
    memory().map(|counters| counters.PeakWorkingSetSize as u64)
}

/// Bytes of physical memory that the process holds now.
pub fn resident() -> Option<u64> {
    memory().map(|counters| counters.WorkingSetSize as u64)
}

/// Processor time that this thread has used: not asked for.
pub fn thread_time() -> Option<Duration> {
    None
}

/// Processor time that all threads of this process have used.
pub fn process_time() -> Option<Duration> {
    let mut times = [FILETIME { dwLowDateTime: 0, dwHighDateTime: 0 }; 4];
    let [created, ended, kernel, user] = &mut times;
    // SAFETY: the handle is this process's own, which needs no closing, and the four are there to be written.
    let found = unsafe { GetProcessTimes(GetCurrentProcess(), created, ended, kernel, user) };
    // In steps of 100 nanoseconds.
    let steps = |time: &FILETIME| u64::from(time.dwHighDateTime) << 32 | u64::from(time.dwLowDateTime);
    (found != 0).then(|| Duration::from_nanos(100 * (steps(&times[2]) + steps(&times[3]))))
}

fn memory() -> Option<PROCESS_MEMORY_COUNTERS> {
    // SAFETY: all-zero bytes are a value of this type, which has numbers only.
    let mut counters: PROCESS_MEMORY_COUNTERS = unsafe { mem::zeroed() };
    let len = size_of::<PROCESS_MEMORY_COUNTERS>() as u32;
    // SAFETY: the handle is this process's own, which needs no closing, and `counters` has the length that is told.
    let found = unsafe { K32GetProcessMemoryInfo(GetCurrentProcess(), &mut counters, len) };
    (found != 0).then_some(counters)
}

/// The user's folder for what can be made again.
pub fn cache_folder() -> Option<PathBuf> {
    absolute("LOCALAPPDATA")
}

/// The user's folder for what programs remember.
pub fn state_folder() -> Option<PathBuf> {
    absolute("LOCALAPPDATA")
}

/// The name of this computer.
pub(crate) fn host_name() -> Option<String> {
    std::env::var("COMPUTERNAME").ok()
}

/// The error of a full disk.
pub(crate) fn error_of_full_disk() -> io::Error {
    io::Error::from_raw_os_error(ERROR_DISK_FULL as i32)
}

/// The error of a disk that fails.
pub(crate) fn error_of_device() -> io::Error {
    io::Error::from_raw_os_error(ERROR_IO_DEVICE as i32)
}

/// Ends the process as nothing in it can prevent.
pub(crate) fn end_process() -> io::Error {
    // SAFETY: the handle is this process's own.
    unsafe { TerminateProcess(GetCurrentProcess(), 1) };
    io::Error::last_os_error()
}

/// Answers that another program cannot take the place of this one.
pub fn replace_process(_: &mut Command, _: &OsStr) -> io::Error {
    io::Error::from_raw_os_error(ERROR_NOT_SUPPORTED as i32)
}

/// A pipe, which is waited for: a request to stop is heard when something comes.
#[derive(Debug)]
pub struct Pipe(File);

impl Pipe {
    /// Opens the pipe at `path`.
    ///
    /// # Errors
    /// Those of the system.
    pub fn open(path: &Path) -> io::Result<Pipe> {
        if path == Path::new(STDIN) {
            return Ok(Pipe(io::stdin().as_handle().try_clone_to_owned()?.into()));
        }
        File::open(path).map(Pipe)
    }

    /// Reads what there is, 0 bytes behind the last one.
    ///
    /// # Errors
    /// Those of the system.
    pub fn read(&mut self, bytes: &mut [u8], _: u16) -> io::Result<Option<usize>> {
        match io::Read::read(&mut self.0, bytes) {
            // The other end was closed.
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(Some(0)),
            read => read.map(Some),
        }
    }
}

/// Nothing: the system reads ahead by what it sees.
pub(crate) fn advise(_: &Mmap, _: Access, _: usize, _: usize) {}

/// Nothing, as above.
pub(crate) fn advise_buffer(_: &MmapMut, _: Access) {}

/// Nothing: the system takes pages back where memory is short.
pub(crate) fn drop_pages(_: &Mmap) {}

/// Nothing: a mapped file cannot be truncated.
#[derive(Debug)]
pub(crate) struct Guard;

impl Guard {
    pub(crate) fn of(_: &[u8]) -> Option<Guard> {
        None
    }

    pub(crate) fn is_cut(&self) -> bool {
        false
    }
}

/// The C library's handler of a signal.
type Handler = usize;

unsafe extern "C" {
    fn signal(signal: c_int, handler: Handler) -> Handler;
}

/// Whether METIS's C code has the variables of each thread that it asks for: MinGW's gcc ignores Microsoft's word for them.
#[cfg_attr(not(feature = "metis"), allow(dead_code))]
pub(crate) const THREADS_KEEP_VARIABLES: bool = cfg!(not(target_env = "gnu"));

/// The action of a signal, to be set back.
#[cfg_attr(not(feature = "metis"), allow(dead_code))]
#[derive(Debug)]
pub(crate) struct SignalAction(c_int, Handler);

#[cfg_attr(not(feature = "metis"), allow(dead_code))]
impl SignalAction {
    /// The signals that METIS raises where it cannot go on: SIGABRT and SIGTERM of the C library.
    pub(crate) const OF_METIS: [c_int; 2] = [22, 15];

    /// Has `handler` called when the signal comes, and answers what it did before.
    ///
    /// # Safety
    /// The handler may be called at any time, in any thread, until it is set back.
    pub(crate) unsafe fn set(of: c_int, handler: extern "C" fn(c_int)) -> io::Result<SignalAction> {
        // SAFETY: as the caller promises.
        match unsafe { signal(of, handler as *const () as Handler) } {
            Handler::MAX => Err(io::Error::last_os_error()),
            before => Ok(SignalAction(of, before)),
        }
    }

    /// Sets it back.
    ///
    /// # Safety
    /// Whoever set what was there before still answers for it.
    pub(crate) unsafe fn restore(self) {
        // SAFETY: as the caller promises.
        let _ = unsafe { signal(self.0, self.1) };
    }
}
