//! Reading ends soon after it was asked to, whatever is being read: sources without an end show it, since a loop that does not
//! look would not end either.

use super::input::Input;
use super::stream::Tap;
use super::supply::Supply;
use super::texture::Images;
use crate::batch::{Batch, BatchKind};
use crate::error::SourceError;
use crate::options::{Invalid, Options};
use chpm_extmem::{Cancel, FailPoints, Store};
use std::io::{self, Read, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

/// Bytes before the stop is asked for: more than any window.
const BEFORE: usize = 3 << 20;
/// Bytes that may be handed out after that.
const AFTER: usize = 1 << 20;

/// A beginning, then the same bytes again and again. Asks for the stop on the way, and counts what it hands out from then on.
struct Endless {
    head: Vec<u8>,
    body: Vec<u8>,
    at: usize,
    before: usize,
    after: Arc<AtomicUsize>,
    cancel: Cancel,
}

impl Read for Endless {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.at >= self.before {
            self.cancel.cancel();
            let after = self.after.fetch_add(buffer.len(), Relaxed) + buffer.len();
            assert!(after <= 4 * AFTER, "nobody looks");
        }
        for byte in buffer.iter_mut() {
            *byte = match self.head.get(self.at) {
                Some(byte) => *byte,
                None => self.body[(self.at - self.head.len()) % self.body.len()],
            };
            self.at += 1;
        }
        Ok(buffer.len())
    }
}

/// Reads until an error comes, which has to be the stop, and answers the bytes that were handed out after it was asked for.
fn stopped(name: &str, head: &[u8], body: &[u8], before: usize, invalid: Invalid) -> usize {
    let dir = tempfile::tempdir().unwrap();
    let store = Store::create(dir.path(), 1 << 20).unwrap();
    let (cancel, after) = (Cancel::default(), Arc::default());
    let source = Endless {
        head: head.to_vec(),
        body: body.to_vec(),
        at: 0,
        before,
        after: Arc::clone(&after),
        cancel: cancel.clone(),
    };
    let path = dir.path().join(name);
    std::fs::write(&path, "").unwrap();
    let supply = Supply::file(&path).unwrap();
    let tap = Tap::of(Box::new(source), 1 << 40, &FailPoints::default(), &cancel);
    let options = Options { invalid, ..Options::default() };
    let read = || -> Result<(), SourceError> {
        let mut input = Input::from_tap(&supply, tap, options, &store, true, &cancel)?;
        let mut batch = Batch::default();
        while input.next_batch(&mut batch)? != BatchKind::End {}
        Ok(())
    };
    let error = read().unwrap_err();
    assert!(cancel.is_cancelled(), "{name}: {error}");
    // A reader that is still being made does not know why it fails; whoever opens it does.
    let is_read =
        matches!(&error, SourceError::Cancelled) || error.to_string().contains("stopped on request");
    assert!(is_read, "{name}: {error}");
    after.load(Relaxed)
}

const VERTICES: &str = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
const FACES: &str = "element face 4000000000000\nproperty list uchar int vertex_indices\n";

#[test]
fn every_loop_over_input_heeds_a_stop() {
    let ply = |format: &str, elements: &str| format!("ply\nformat {format} 1.0\n{elements}end_header\n");
    let text = |elements: &str| ply("ascii", elements);
    let binary = |elements: &str| ply("binary_little_endian", elements);

    let fixed = "element junk 4000000000000\nproperty double a\nproperty int b\n";
    let lists = "element junk 4000000000000\nproperty list uchar int b\n";
    let mut stl = vec![0; 80];
    stl.extend(u32::MAX.to_le_bytes());
    let faceless = format!("{FACES}{VERTICES}");
    let faces = format!("{VERTICES}{FACES}");
    let corners = "0 0 0\n1 0 0\n0 1 0\n";
    let zeros = [0u8; 36];

    let cases: [(&str, Vec<u8>, &[u8], Invalid); 14] = [
        ("fixed.ply", binary(&format!("{fixed}{faces}")).into(), b"\0", Invalid::Refuse),
        ("lists.ply", binary(&format!("{lists}{faces}")).into(), b"\x01abcd", Invalid::Refuse),
        ("words.ply", text(&format!("{fixed}{faces}")).into(), b"1 2\n", Invalid::Refuse),
        ("blank.ply", text(&faces).into(), b"\n", Invalid::Refuse),
        ("early.ply", text(&faceless).into(), b"3 0 1 2\n", Invalid::Refuse),
        ("dropped.ply", (text(&faces) + corners).into(), b"3 0 1 9\n", Invalid::Drop),
        (
            "degenerate.ply",
            [binary(&faces).as_bytes(), &zeros].concat(),
            b"\x02\0\0\0\0\x01\0\0\0",
            Invalid::Refuse,
        ),
        ("comments.obj", b"v 0 0 0\n".to_vec(), b"# nothing\n", Invalid::Refuse),
        ("before.obj", b"# nothing\n".to_vec(), b"vt 0 0\n", Invalid::Refuse),
        ("dropped.obj", b"v 0 0 0\n".to_vec(), b"f 7 8 9\n", Invalid::Drop),
        ("dropped.stl", stl.clone(), &[0xff; 50], Invalid::Drop),
        ("names.stl", b"solid\n".to_vec(), b"endsolid\nsolid\n", Invalid::Refuse),
        ("degenerate.stl", stl, &[0; 50], Invalid::Refuse),
        ("list.conf", b"bmesh a.ply 0 0 0 0 0 0 1\n".to_vec(), b"# nothing\n", Invalid::Refuse),
    ];

    for (name, head, body, invalid) in cases {
        let after = stopped(name, &head, body, BEFORE, invalid);
        assert!(after <= AFTER, "{name}: {after} bytes");
    }
}

#[test]
fn unpacking_heeds_a_stop() {
    let head = format!(
        "ply\nformat binary_little_endian 1.0\nelement junk 4000000000000\nproperty int b\n{VERTICES}{FACES}end_header\n"
    );
    let zeros = vec![0; 1 << 20];
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
    let mut zstd = zstd::Encoder::new(Vec::new(), 1).unwrap();
    let mut write = |bytes: &[u8]| {
        gzip.write_all(bytes).unwrap();
        zstd.write_all(bytes).unwrap();
    };
    write(head.as_bytes());
    (0..64).for_each(|_| write(&zeros));
    for (name, bytes) in [("a.ply.gz", gzip.finish().unwrap()), ("a.ply.zst", zstd.finish().unwrap())] {
        // The file is in memory at once: only what comes out of it is left to look at.
        let after = stopped(name, &bytes, &bytes, 5, Invalid::Refuse);
        assert!(after <= AFTER, "{name}: {after} bytes");
    }
}

#[test]
fn whole_files_are_hashed_until_a_stop() {
    let cancel = Cancel::default();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a");
    std::fs::write(&path, vec![0; 1000]).unwrap();
    let files = [path.clone()];
    assert_eq!(super::input::fingerprint(&files, &cancel).unwrap().0, 1000);
    cancel.cancel();
    assert!(matches!(super::input::fingerprint(&files, &cancel), Err(SourceError::Cancelled)));
    assert!(matches!(
        super::input::files(Path::new(&path), Images::Ignored, &cancel),
        Err(SourceError::Cancelled)
    ));
}

/// A frame of a few bytes that asks for a window of 256 MiB to be unpacked in.
#[test]
fn a_window_is_granted_by_more_memory() {
    let frame = [&[0x28, 0xb5, 0x2f, 0xfd, 0, 18 << 3, 4 << 3 | 1, 0, 0][..], b"ply\n"].concat();
    let read = |memory: u64| {
        let cancel = Cancel::default();
        let tap = Tap::of(Box::new(io::Cursor::new(frame.clone())), 13, &FailPoints::default(), &cancel);
        super::stream::open(&tap, 4, memory).map(|opened| opened.head)
    };
    assert_eq!(read(1 << 30).unwrap(), b"ply\n");
    let error = read(1 << 29).unwrap_err().to_string();
    assert!(error.contains("more than 128 MiB") && error.contains("raise --memory"), "{error}");
}
