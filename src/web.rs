//! The page and the reader that browsers are given, as they are in `web/`.

use crate::cmd::reading;
use anyhow::Result;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_refine::Portrait;
use serde_json::json;

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
        "view/colors.js", "view/facing.js", "view/main.js", "view/model.js", "view/orbit.js", "view/renderer.js",
        "chpm/index.js", "chpm/file.js", "chpm/frustum.js", "chpm/mesh.js", "chpm/packed.js", "chpm/page.js", "chpm/records.js", "chpm/select.js",
        "chpm/source.js", "chpm/three.js", "chpm/xxh3.js", "chpm/zstd.js";
};

/// The page for a model: it has what decides from where the model is seen first, which the page does not find out by itself. `name` is
/// the model's address, where the page's own does not tell it.
pub(crate) fn page_for(file: &Chpm<MappedFile>, name: Option<&str>) -> Result<String> {
    let portrait = reading(file, || Ok(Portrait::of_file(file)?))?;
    let stance = portrait.stance();
    // Single precision is what the file has; more digits say nothing.
    let points = portrait.outermost();
    let points: Vec<[f32; 3]> = points.iter().map(|p| [p.x as f32, p.y as f32, p.z as f32]).collect();
    let sight: [f64; 3] = stance.sight().into();
    let stretch: [f64; 3] = portrait.stretch().into();
    let view = json!({
        "up": stance.up().to_string(),
        "sight": sight,
        "points": points,
        "stretch": stretch,
        "note": portrait.note(),
    });
    fn escaped(text: &str) -> String {
        text.replace('&', "&amp;").replace('"', "&quot;").replace('<', "&lt;")
    }
    let named = name.map_or_else(String::new, |name| format!(" data-file=\"{}\"", escaped(name)));
    let body = format!("<body{named} data-view=\"{}\">", escaped(&view.to_string()));
    Ok(page_text().replacen("<body>", &body, 1))
}

/// The page without a model.
fn page_text() -> &'static str {
    FILES.iter().find(|file| file.path == PAGE).map_or("", |file| file.text)
}
