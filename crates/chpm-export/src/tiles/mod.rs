//! A `.chpm` as a tree of tiles: 3D Tiles 1.1.
//!
//! Groups are a directed acyclic graph; a tileset is a tree in which tiles decide alone. This module makes them decide alike: the tile of a cluster has its *group's* box and
//! `max_error`, the same for all coarse members (the box holds all that is below; spheres about spheres would grow level by level), and I6 keeps a group from being refined before its parents. Errors are raised by a last bit where they would not fall strictly: 3d-tiles-renderer
//! never stops at a tile whose error is no less than its parent's. Content is the *base* mesh, since borders are at base where a neighbour is
//! coarser; finest meshes crack. The box of the cluster itself is in `content.boundingVolume`. Under each leaf there is a tile with its finest mesh and `geometricError` 0: no border between
//! two groups of leaves collapses in either. Where the file has sheets, a tile shows its cluster's, bytes as they are; two tiles of a leaf show one file. The tree is not in the file: a fine cluster is a part of the coarse cluster of its group with most of its base triangles (I4), asked only where a
//! group has several. For settled views any member would do as a parent; while tiles load, a parent covers what its children do. A tileset of its own begins wherever the level divided by
//! eight changes. Tested: a viewer of 30 lines in `tests/integration/tiles.rs`, and 3d-tiles-renderer in Chromium by hand (`tests/tiles/check.mjs`).

mod archive;
mod content;
mod normals;
mod reprojection;
#[cfg(test)]
mod tests;
mod tileset;
mod tree;

pub use archive::Archive;
pub(crate) use content::mesh_of;
pub use content::{Mesh, tile, tile_image};
pub use normals::SharedNormals;
pub use reprojection::{Map, Reprojection};
pub use tileset::{Tileset, tilesets};
pub(crate) use tree::GroupBounds;
pub use tree::Tree;

use crate::gltf::Placement;
use crate::turn::Turn;
use chpm_mesh::ClusterId;

/// How a model becomes tiles.
#[derive(Clone, PartialEq, Debug)]
pub struct Options {
    /// The program that writes them.
    pub generator: String,
    /// The turn that makes the model's y axis point up.
    pub turn: Turn,
    /// Whether tiles get normals where the file has none.
    pub normals: bool,
    /// Whether the tiles are compressed with `EXT_meshopt_compression`.
    pub packed: bool,
    /// Matrix from the model's coordinates to those of the world, column by column; from the frame of `reprojection`, if there is one.
    pub transform: Option<[f64; 16]>,
    /// The map to that frame, of models with z upward.
    pub reprojection: Option<Reprojection>,
    /// Levels of the hierarchy that lie in one file of the tileset.
    pub span: u32,
}

impl Options {
    /// Levels to a file: 255 clusters.
    pub const SPAN: u32 = 8;

    fn placement(&self) -> Placement {
        Placement { turn: self.turn, ..Placement::HERE }
    }

    fn upright(&self, place: [f64; 3]) -> [f64; 3] {
        upright(self.turn, place)
    }
}

/// A direction or a place of the model in a frame with z upward, which is what viewers make of glTF's y.
pub fn upright(turn: Turn, place: [f64; 3]) -> [f64; 3] {
    Turn::to_z(1, false).apply(turn.apply(place))
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
