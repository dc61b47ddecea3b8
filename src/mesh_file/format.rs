//! Formats that a mesh is written in.

use chpm_export::Turn;
use chpm_refine::Up;

/// Format of a mesh file.
#[derive(clap::ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum MeshFormat {
    /// Polygons with all attributes, in doubles where they are needed
    Ply,
    /// Triangles alone, in single precision unless it is text
    Stl,
    /// Text; colours without alpha
    Obj,
    /// Binary glTF 2.0, its positions relative to an origin where they need doubles
    Glb,
    /// The same as JSON, with a .bin beside it
    Gltf,
}

impl MeshFormat {
    const NAMES: [(&str, MeshFormat); 5] = [
        ("PLY", MeshFormat::Ply),
        ("STL", MeshFormat::Stl),
        ("OBJ", MeshFormat::Obj),
        ("GLB", MeshFormat::Glb),
        ("glTF", MeshFormat::Gltf),
    ];

    pub(super) fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(_, format)| *format == self).map_or("", |(name, _)| name)
    }

    /// The format of such a name.
    pub(super) fn named(name: &str) -> Option<MeshFormat> {
        Self::NAMES.iter().find(|(known, _)| *known == name).map(|(_, format)| *format)
    }

    /// How names of such files end.
    pub(super) fn extension(self) -> &'static str {
        match self {
            MeshFormat::Ply => "ply",
            MeshFormat::Stl => "stl",
            MeshFormat::Obj => "obj",
            MeshFormat::Glb => "glb",
            MeshFormat::Gltf => "gltf",
        }
    }

    /// Whether it is glTF, in one file or two.
    pub(super) fn is_gltf(self) -> bool {
        matches!(self, MeshFormat::Glb | MeshFormat::Gltf)
    }

    /// Which axis points up in such a file.
    pub(super) fn up(self) -> &'static str {
        match self {
            MeshFormat::Glb | MeshFormat::Gltf | MeshFormat::Obj => "y",
            MeshFormat::Ply | MeshFormat::Stl => "z",
        }
    }

    /// The turn after which a direction points up in such a file.
    pub(super) fn turn(self, up: Up) -> Turn {
        let to = if self.up() == "y" { Turn::to_y } else { Turn::to_z };
        to(up.axis(), up.is_negative())
    }
}
