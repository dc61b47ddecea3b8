//! A `.chpm` as a tree of tiles: 3D Tiles 1.1.
//!
//! In a CHPM, groups of clusters are replaced as a whole; in a tileset every tile decides for itself. They decide alike where all coarse clusters of a
//! group have the group's sphere as their volume and the group's largest error as theirs, raised by a
//! last bit where it would not fall from a tile to those below. What is drawn of a cluster is its base mesh, since
//! seams are at base meshes where a neighbour is coarser; under each leaf there is one tile more, with its finest mesh. So a tileset has every
//! cut at base meshes of the file, and the source, and none of them has a crack.

mod content;
mod tileset;
mod tree;

pub use content::{Mesh, tile};
pub use tileset::{Tileset, tilesets};
pub use tree::Tree;

use crate::gltf::Placement;
use chpm_mesh::ClusterId;

/// How a model becomes tiles.
#[derive(Clone, PartialEq, Debug)]
pub struct Options {
    /// The program that writes them.
    pub generator: String,
    /// Whether the model's y axis points up, and not its z axis.
    pub y_up: bool,
    /// Whether the tiles are compressed with `EXT_meshopt_compression`.
    pub packed: bool,
    /// What takes the model's coordinates to those of the world, column by column.
    pub transform: Option<[f64; 16]>,
    /// Levels of the hierarchy that lie in one file of the tileset.
    pub span: u32,
}

impl Options {
    /// Levels to a file: 255 clusters.
    pub const SPAN: u32 = 8;

    fn placement(&self) -> Placement {
        if self.y_up { Placement::Here } else { Placement::ZUp }
    }

    /// A direction or a place of the model in a frame with z upward.
    fn upright(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        if self.y_up { [x, -z, y] } else { [x, y, z] }
    }
}

/// Files to a folder.
const FOLDER: u32 = 1000;

/// Where a tile lies in the tileset's folder.
pub fn tile_path(cluster: ClusterId, mesh: Mesh) -> String {
    let finest = if mesh == Mesh::Finest { "-finest" } else { "" };
    format!("tiles/{:03}/{}{finest}.glb", cluster.0 / FOLDER, cluster.0)
}

/// Where the tileset of what is below a cluster lies.
fn subtree_path(cluster: ClusterId) -> String {
    format!("subtrees/{:03}/{}.json", cluster.0 / FOLDER, cluster.0)
}
