//! The page and the reader that browsers are given, as they are in `web/`.

/// A file of the page.
pub(crate) struct WebFile {
    /// Its path below the page's folder.
    pub(crate) path: &'static str,
    /// What it is, for the browser.
    pub(crate) media_type: &'static str,
    /// What is in it.
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
        "view/main.js", "view/model.js", "view/orbit.js", "view/renderer.js",
        "chpm/index.js", "chpm/file.js", "chpm/mesh.js", "chpm/packed.js", "chpm/page.js", "chpm/records.js", "chpm/select.js",
        "chpm/source.js", "chpm/three.js", "chpm/xxh3.js", "chpm/zstd.js";
};
