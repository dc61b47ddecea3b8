//! Settings that go together for a kind of model.

use clap::ValueEnum;

/// A kind of model. What it sets is in the manual, with figures; what is given besides wins.
#[derive(ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Preset {
    /// Range scans and photogrammetry: dust is left out (--min-component 0.5%), pages are packed
    Scan,
    /// Mechanical parts: holes and handles stay (--topology keep), pages are packed
    Cad,
    /// Isosurfaces of volumes: dust is left out (--min-component 1%), clusters are larger and share less (--cluster-triangles 8192), pages are packed
    Isosurface,
    /// Height fields: clusters are larger (--cluster-triangles 8192), pages are packed
    Terrain,
    /// A small file for a first look: no detail below 0.1% of the diagonal (--finest-error 0.1%), pages are packed
    Preview,
}

impl Preset {
    /// As it is typed.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Preset::Scan => "scan",
            Preset::Cad => "cad",
            Preset::Isosurface => "isosurface",
            Preset::Terrain => "terrain",
            Preset::Preview => "preview",
        }
    }

    /// Names and values of options; a switch has no value.
    pub(crate) fn settings(self) -> &'static [(&'static str, &'static str)] {
        match self {
            Preset::Scan => &[("min-component", "0.5%"), ("pages", "packed")],
            Preset::Cad => &[("topology", "keep"), ("pages", "packed")],
            Preset::Isosurface => {
                &[("min-component", "1%"), ("cluster-triangles", "8192"), ("pages", "packed")]
            }
            Preset::Terrain => &[("cluster-triangles", "8192"), ("pages", "packed")],
            Preset::Preview => &[("finest-error", "0.1%"), ("pages", "packed")],
        }
    }
}
