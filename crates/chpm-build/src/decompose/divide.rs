//! The source in regions of some dozen leaf clusters, each small enough to be worked on in memory by itself.
//!
//! Vertices are numbered by coarse cell, triangles get the new numbers, the graph of cells is cut into regions (`homes`), and each
//! triangle goes to the region that has most of its corners (`route`). A vertex that a triangle of another region uses is a border
//! vertex: that region gets a copy of it, and its border number says that both are one (`borders`). How many regions there are depends
//! on the source alone, not on the budget.

mod borders;
mod route;
mod split;
mod step;

use super::homes::{self, Cut, Homes};
use super::load::Material;
use super::region::Mesh;
use super::size::{Shares, Size};
use crate::config::{Normals, Settings};
use crate::context::Context;
use crate::error::BuildError;
use crate::ids::Id;
use crate::vertex_columns::{ColumnMap, VertexColumns};
use bytemuck::Pod;
use chpm_extmem::{Column, Reservation, Store, process};
use chpm_mesh::{Aabb, Attributes, Octahedral};

pub(crate) use borders::{Borders, Foreign};
pub(crate) use route::Routed;
pub(crate) use split::is_too_large;

/// Memory for the blocks of all regions' triangles.
const BLOCKS: usize = 8 << 20;

/// The source in regions.
pub(crate) struct Divided<I: Id> {
    vertices: VertexColumns,
    homes: Homes,
    routed: Routed<I>,
    borders: Borders<I>,
    _share: Reservation,
}

/// Divides the source for `leaves` leaf clusters.
pub(crate) fn run<I: Id>(
    vertices: VertexColumns,
    triangles: Column<[I; 3]>,
    bounds: Aabb,
    leaves: u32,
    settings: &Settings,
    context: &Context<'_>,
) -> Result<Divided<I>, BuildError> {
    let cut = homes::run(vertices, triangles, bounds, leaves, settings, context)?;
    let Cut { vertices, triangles, homes } = cut;

    // Triangles go first; regions that got too many are split; then it is known which vertices of others each region has.
    let mut routed = Routed::new(homes.count(), &context.store);
    let traced = context.trace.task("route");
    routed.take(&triangles, 0..triangles.len(), &homes, context)?;
    drop((triangles, traced));
    let _traced = context.trace.task("exchange");
    routed.split(&homes, settings, context)?;
    let borders = Borders::of(&mut routed, &homes, context)?;
    // What the counts of topology and the shared vertices keep for each.
    let len = if settings.normals == Normals::Computed { 20 + size_of::<Octahedral>() } else { 20 };
    let bytes = len as u64 * u64::from(borders.count());
    let _share = context.store.budget.reserve_work("border vertices", bytes)?;
    process::return_free_pages();
    Ok(Divided { vertices, homes, routed, borders, _share })
}

impl<I: Id> Divided<I> {
    /// The same with the vertices on disk, so that regions have more memory.
    pub(crate) fn moved_to_disk(self, store: &Store) -> Result<Self, BuildError> {
        Ok(Divided { vertices: self.vertices.map(&ToDisk(store))?, ..self })
    }

    /// Number of regions. Those behind the homes have no vertices of their own.
    pub(crate) fn region_count(&self) -> usize {
        self.routed.region_count()
    }

    /// Number of border vertices.
    pub(crate) fn border_count(&self) -> u32 {
        self.borders.count()
    }

    /// Shares of the regions in so many leaves.
    pub(super) fn shares(&self, leaves: u32) -> Shares {
        self.routed.shares(leaves, &self.homes)
    }

    /// Attributes of the vertices.
    pub(crate) fn carried(&self) -> Attributes {
        self.vertices.attributes()
    }

    /// How much a region has.
    pub(crate) fn size(&self, region: usize) -> Size {
        self.borders.size(region, self.routed.triangles.len(region), &self.homes)
    }

    /// The mesh of a region.
    pub(crate) fn load(&self, region: usize, context: &Context<'_>) -> Result<Mesh, BuildError> {
        let mut material = Material {
            triangles: Vec::new(),
            foreign: Vec::new(),
            border: self.borders.own(region)?,
            first_border: self.borders.first(region),
        };
        self.routed.triangles.read(region, &mut material.triangles)?;
        self.borders.foreign.read(region, &mut material.foreign)?;
        material.load(region, &self.homes, &self.vertices, context)
    }
}

/// Moves columns to disk.
struct ToDisk<'a>(&'a Store);

impl ColumnMap for ToDisk<'_> {
    fn map<T: Pod + Send + Sync>(&self, column: Column<T>, _: &'static str) -> Result<Column<T>, BuildError> {
        Ok(column.moved_to_disk(self.0)?)
    }
}
