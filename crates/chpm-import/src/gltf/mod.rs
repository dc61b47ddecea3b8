//! glTF 2.0, as JSON with files or data beside it, and as a GLB: the triangles of its default scene.
//!
//! Nodes place meshes by matrices or by translation, rotation and scale, one in another; a placement that mirrors turns triangles
//! over, so that their front stays in front. Coordinates are what they become by that, y up, and nothing else is done to them. Triangles,
//! strips and fans are read, with positions, normals and the first colours, of all types that the standard and
//! `KHR_mesh_quantization` know, with sparse accessors and `EXT_meshopt_compression`. Lines, points, skins and
//! morphs are left out; of materials, base colours and their images are found where images are asked for. Colours are light in glTF, and become sRGB of eight bits.
//!
//! Exporters split a vertex wherever its normal, colour or texture coordinate differs, which cuts the surface there. So vertices
//! whose positions are equal, bit for bit, after they were placed, become one: the first in the order of the file. **It keeps its
//! own colour**, since a mean would be one that the source never had, and gets **the sum of the different normals**, at length
//! one, each counted once however many vertices and triangles have it: a soup of facets is shaded as a smooth surface then, whatever
//! way it was cut into triangles. Where the sum is zero, as on the two sides of a sheet, it keeps its own.
//!
//! The JSON is held in memory; all else is read from its file where it is needed, in windows.

mod accessor;
mod coats;
mod document;
mod mesh;
mod meshopt;
mod parts;
mod scene;
#[cfg(test)]
mod tests;
mod text;
mod views;
mod walk;

use crate::error::{ImportError, SourceError};
use crate::format::{Format, Likeness, is_text, without_mark};
use crate::reader::{MeshReader, Opening, Start};
use crate::stream::Stream;
use crate::texture::Images;
use chpm_extmem::Cancel;
use coats::{Coats, Places};
use document::Document;
use mesh::GltfReader;
use parts::Parts;
use std::collections::BTreeSet;
use std::io::Read;
use std::path::{Path, PathBuf};
use views::{Region, Scratch, Views};

/// glTF, as text or binary.
pub(crate) const FORMAT: Format =
    Format { name: "glTF", extensions: &["glb", "gltf"], is_list: false, sniff, open, names: Some(files) };

/// Bytes of memory that each byte of JSON may become.
const BLOW_UP: u64 = 32;

fn is_glb(head: &[u8]) -> bool {
    head.starts_with(b"glTF")
}

fn sniff(start: &Start<'_>) -> Likeness {
    let text = without_mark(start.head).trim_ascii_start();
    let has_asset = || start.head.windows(7).any(|bytes| bytes == b"\"asset\"");
    match () {
        () if is_glb(start.head) => Likeness::Certain,
        () if text.first() == Some(&b'{')
            && is_text(start.head)
            && (start.is_named("gltf") || has_asset()) =>
        {
            Likeness::Likely
        }
        () => Likeness::None,
    }
}

fn open(opening: Opening<'_>) -> Result<Box<dyn MeshReader>, ImportError> {
    let Opening { mut stream, start, options, store, cancel, supply } = opening;
    let is_glb = is_glb(start.head);
    let mut scratch = Scratch::new(store);
    let text = text::read(&mut stream, is_glb, &mut |bytes| scratch.write(bytes))?;
    let share = store.budget.reserve_work("the JSON of a glTF", BLOW_UP * text.json.len() as u64)?;
    let document = Document::parse(&text.json)?;
    let names = named(&document, &supply.path)?;
    if supply.is_spooled() && !names.is_empty() {
        return Err(SourceError::NamesFiles { path: supply.path.clone(), what: "a glTF" }.into());
    }

    // What is not compressed is read where it lies.
    let binary = match (text.binary, start.len) {
        (None, _) => None,
        (Some((from, len)), Some(whole)) => {
            let unread = |source| SourceError::Read { path: supply.path.clone(), source };
            let file = supply.open().map_err(unread)?;
            let len = len.min(whole.saturating_sub(from));
            let path = (supply.path.clone(), !supply.is_spooled());
            Some(Region::of(file, path, from, len, store.workdir.fail_points()))
        }
        (Some((_, len)), None) => Some(spooled(&mut stream.take(len), Scratch::new(store))?),
    };
    let data = (&scratch.finish()?, &text.payloads[..]);
    let mut views = Views::open(&document, binary.as_ref(), data, &supply.path, (store, cancel))?;
    let inner = Some((&mut views, data.0, data.1));
    let places = Places { path: &supply.path, is_pipe: supply.is_spooled(), inner };
    let coats = Coats::find(&text.json, options.images, places, Some(store))?;
    let textured = coats.as_ref().filter(|coats| coats.table.is_textured());
    let parts = Parts::new(&document, &mut views, &options, textured)?;
    drop(views);
    drop(document);
    let encoding = if is_glb { "gltf, binary" } else { "gltf, json" };
    let table = coats.map(|coats| coats.table);
    Ok(Box::new(GltfReader::new(encoding, parts, (names, table), options.invalid, (store, cancel), share)))
}

/// Copies what is left of a stream.
fn spooled(stream: &mut dyn Read, mut scratch: Scratch<'_>) -> Result<Region, ImportError> {
    let mut block = vec![0; 1 << 16];
    let mut offset = 0;
    loop {
        match stream.read(&mut block) {
            Ok(0) => return scratch.finish(),
            Ok(count) => scratch.write(&block[..count])?,
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => continue,
            Err(source) => return Err(ImportError::Read { offset, source }),
        }
        offset += 1;
    }
}

/// The files that a glTF at `path` names.
fn files(mut stream: Stream, path: &Path, images: Images, _: &Cancel) -> Result<Vec<PathBuf>, ImportError> {
    let mut head = [0; 4];
    let count = stream.by_ref().take(4).read(&mut head);
    let count = count.map_err(|source| ImportError::Read { offset: 0, source })?;
    let is_glb = is_glb(&head);
    let text = text::read(&mut (&head[..count]).chain(stream), is_glb, &mut |_| Ok(()))?;
    let mut files = named(&Document::parse(&text.json)?, path)?;
    files.extend(coats::files(&text.json, path, images)?);
    Ok(files)
}

/// The files of buffers, each once.
fn named(document: &Document, path: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let (mut files, mut seen) = (Vec::new(), BTreeSet::new());
    for uri in document.buffers.iter().filter_map(|buffer| buffer.uri.as_deref()) {
        if !uri.starts_with("data:") {
            let file = views::beside(uri, path)?;
            if seen.insert(file.clone()) {
                files.push(file);
            }
        }
    }
    Ok(files)
}
