//! The page and the reader that browsers are given, as they are in `web/`.

mod script;

use crate::cmd::reading;
use anyhow::Result;
use chpm_extmem::MappedFile;
use chpm_format::{Chpm, shown};
use chpm_refine::Portrait;
use chpm_report::chart::in_xml;
use script::script;
use serde_json::{Value, json};

/// A file of the page.
pub(crate) struct WebFile {
    /// Its path below the page's folder.
    pub(crate) path: &'static str,
    /// Media type, for the browser.
    pub(crate) media_type: &'static str,
    /// Content.
    pub(crate) text: &'static str,
}

macro_rules! web_files {
    ($($media_type:literal: $($path:literal),+;)+) => {
        &[$($(WebFile {
            path: $path,
            media_type: $media_type,
            text: include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/web/", $path)),
        }),+),+]
    };
}

/// The page that shows a model.
pub(crate) const PAGE: &str = "view.html";

/// All that the page loads.
pub(crate) const FILES: &[WebFile] = web_files! {
    "text/html; charset=utf-8": "view.html";
    "text/css; charset=utf-8": "view/style.css";
    "text/javascript; charset=utf-8":
        "view/ambient.js", "view/colors.js", "view/crossing.js", "view/drawing.js", "view/facing.js", "view/glide.js", "view/line.js", "view/main.js", "view/model.js", "view/nest.js", "view/occlusion.js", "view/orbit.js",
        "view/outline.js", "view/overlay.js", "view/painter.js", "view/panel.js", "view/pick.js", "view/renderer.js", "view/section.js", "view/sight.js", "view/texture.js", "view/worker.js",
        "chpm/index.js", "chpm/chained.js", "chpm/copies.js", "chpm/decoder.js", "chpm/file.js", "chpm/frustum.js", "chpm/mesh.js", "chpm/packed.js", "chpm/page.js", "chpm/pieces.js", "chpm/prefetched.js", "chpm/records.js",
        "chpm/regions.js", "chpm/select.js", "chpm/sheets.js", "chpm/source.js", "chpm/three.js", "chpm/volumes.js", "chpm/xxh3.js", "chpm/zstd.js";
};

/// Facts that a page for one model is given beside the model itself.
#[derive(Default)]
pub(crate) struct Given {
    /// The model's title, where its file has none.
    pub(crate) title: Option<String>,
    /// The model's address, where the page's own does not tell it.
    pub(crate) name: Option<String>,
    /// Where its notes are, if it has any.
    pub(crate) notes: Option<&'static str>,
    /// Its pieces, where it is in pieces.
    pub(crate) pieces: Option<Value>,
}

/// The page for a model: it has what decides from where the model is seen first, which the page does not find out by itself, and how it is to be shown.
pub(crate) fn page_for(file: &Chpm<MappedFile>, given: &Given) -> Result<String> {
    let portrait = reading(file, || Ok(Portrait::of_file(file)?))?;
    let stance = portrait.stance();
    // Single precision is what the file has; more digits say nothing.
    let points = portrait.outermost();
    let points: Vec<[f32; 3]> = points.iter().map(|p| [p.x as f32, p.y as f32, p.z as f32]).collect();
    let sight: [f64; 3] = stance.sight().into();
    let stretch: [f64; 3] = portrait.stretch().into();
    let metadata = file.metadata().unwrap_or_default();
    let title = metadata.setting(shown::TITLE).or(given.title.as_deref());
    let view = json!({
        "up": stance.up().to_string(),
        "sight": sight,
        "points": points,
        "stretch": stretch,
        "note": portrait.note(),
        "title": title,
        "credit": metadata.setting(shown::CREDIT),
        "background": metadata.setting(shown::BACKGROUND),
        "first": first(file),
        "pieces": given.pieces,
        "notes": given.notes,
    });
    let named =
        given.name.as_ref().map_or_else(String::new, |name| format!(" data-file=\"{}\"", escaped(name)));
    let body = format!("<body{named} data-view=\"{}\">", escaped(&view.to_string()));
    let title = format!("<title>{}</title>", escaped(title.unwrap_or("chpm")));
    Ok(page_text().replacen("<body>", &body, 1).replacen("<title>chpm</title>", &title, 1))
}

/// The same with all that it loads, but for the model, in itself.
pub(crate) fn whole_page(file: &Chpm<MappedFile>, given: &Given) -> Result<String> {
    let page = page_for(file, given)?;
    let style = format!("<style>\n{}</style>", text_of("view/style.css"));
    let script = format!("<script type=\"module\" id=\"chpm-script\">\n{}</script>", script());
    let page = page.replacen("<link rel=\"stylesheet\" href=\"view/style.css\" />", &style, 1);
    Ok(page.replacen("<script type=\"module\" src=\"view/main.js\"></script>", &script, 1))
}

/// Most bytes of the roots' pages for the page to ask for them before it knows where they are.
const MOST_FIRST: u64 = 1 << 20;

/// Ranges that a page asks for at once: the beginning of the file, and the roots' pages.
fn first(file: &Chpm<MappedFile>) -> Vec<[u64; 2]> {
    let head = [0, (file.bytes().len() as u64).min(32 << 10)];
    // The page learns from these where its volumes are.
    if file.header().has_volumes() {
        return vec![head];
    }
    let roots = file.roots().map(|root| &file.clusters()[root.index()]);
    let ends = roots.map(|root| (root.page_offset, root.page_offset + u64::from(root.page_len)));
    let (start, end) = ends.fold((u64::MAX, 0), |(low, high), (from, to)| (low.min(from), high.max(to)));
    match end.checked_sub(start).filter(|len| (1..=MOST_FIRST).contains(len)) {
        Some(len) => vec![head, [start, len]],
        None => vec![head],
    }
}

fn escaped(text: &str) -> String {
    in_xml(text).replace('&', "&amp;").replace('"', "&quot;").replace('<', "&lt;")
}

/// The text of a file of the page.
fn text_of(path: &str) -> &'static str {
    FILES.iter().find(|file| file.path == path).map_or("", |file| file.text)
}

/// The page without a model.
fn page_text() -> &'static str {
    text_of(PAGE)
}
