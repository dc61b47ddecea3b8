//! Paint of the leaves' triangles: textured triangles of the source, found by the places of their corners.

use crate::context::Context;
use crate::error::BuildError;
use crate::ingest::{Painted, Wedge, place_of};
use crate::trim::Built;
use bytemuck::{Pod, Zeroable};
use chpm_extmem::{BufferWriter, Column, Sorter};
use chpm_format::Page;

/// A leaf's triangle.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Pod, Zeroable)]
#[repr(C)]
struct OfLeaf {
    place: [u64; 2],
    leaf: u32,
    triangle: u32,
}

/// A leaf's triangle and what it shows.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Pod, Zeroable, Debug)]
#[repr(C)]
pub(super) struct Shown {
    leaf: u32,
    pub(super) triangle: u32,
    pub(super) wedge: Wedge,
}

/// All of them, by leaf and triangle.
pub(super) struct Found {
    shown: Column<Shown>,
    /// Where each leaf begins, and the end.
    first: Vec<usize>,
}

impl Found {
    pub(super) fn new(built: &Built, painted: &Painted, context: &Context<'_>) -> Result<Self, BuildError> {
        let Built { tree, clusters, .. } = built;
        let leaves = tree.level(0).len();
        let mut of_leaves = Sorter::new(&context.store, "triangles of leaves");
        let mut bytes = Vec::new();
        for leaf in (0..leaves as u32).filter(|leaf| clusters.is_built(*leaf)) {
            context.check()?;
            let page = clusters.page(leaf);
            clusters.pages.read(page.offset, page.len as usize, &mut bytes)?;
            let page = Page::view(&bytes)?;
            for (triangle, corners) in (0..).zip(page.triangles) {
                let (place, _) = place_of(corners.map(|corner| page.positions[usize::from(corner)]));
                of_leaves.push(OfLeaf { place, leaf, triangle })?;
            }
        }
        let mut wedges = Sorter::new(&context.store, "textured triangles");
        painted.each(context, |wedge| Ok(wedges.push(wedge)?))?;

        // Of several at one place, the first is the first's.
        let (mut of_leaves, mut wedges) = (of_leaves.finish()?, wedges.finish()?);
        let mut shown = Sorter::new(&context.store, "what triangles show");
        let (mut next_leaf, mut next_wedge) = (of_leaves.next()?, wedges.next()?);
        while let (Some(OfLeaf { place, leaf, triangle }), Some(wedge)) = (next_leaf, next_wedge) {
            if place == wedge.place {
                shown.push(Shown { leaf, triangle, wedge })?;
            }
            if place <= wedge.place {
                next_leaf = of_leaves.next()?;
            }
            if place >= wedge.place {
                next_wedge = wedges.next()?;
            }
        }

        let mut shown = shown.finish()?;
        let mut column = BufferWriter::new(&context.store, "what triangles show", 0)?;
        let mut first = Vec::with_capacity(leaves + 1);
        while let Some(next) = shown.next()? {
            while first.len() <= next.leaf as usize {
                first.push(column.len());
            }
            column.extend_from_slice(&[next])?;
        }
        first.resize(leaves + 1, column.len());
        Ok(Found { shown: column.finish_column()?, first })
    }

    /// Those of a leaf.
    pub(super) fn of<'a>(
        &'a self,
        leaf: u32,
        scratch: &'a mut Vec<Shown>,
    ) -> Result<&'a [Shown], BuildError> {
        let [begin, end] = [leaf as usize, leaf as usize + 1].map(|at| self.first[at]);
        Ok(self.shown.read(begin..end, scratch)?)
    }
}
