//! Remnants: of a component that vanished by itself, the triangle that was left last.
//!
//! A reader that measures may draw it, so that what is missing is missing only where it is.

use crate::error::{FilePart, FormatError, invalid, require};
use crate::page::Page;
use crate::records::{ClusterRecord, GroupRecord};
use crate::section_kind::SectionKind;
use bytemuck::{Pod, Zeroable};
use chpm_mesh::{ClusterId, GroupId, Places};
use std::mem;

/// The last triangle of a component, and where its points are; see FORMAT.md, "Remnants".
#[derive(Clone, Copy, PartialEq, Pod, Zeroable, Debug, Default)]
#[repr(C)]
pub struct Remnant {
    /// Centre of a ball that holds all of the component's points.
    pub center: [f32; 3],
    /// Its radius.
    pub radius: f32,
    /// The cluster in which it vanishes.
    pub cluster: u32,
    /// Corners of the triangle in the cluster's page: the vertex whose collapse takes it away, where that goes, and the third one.
    pub corners: [u16; 3],
    /// Zero.
    pub reserved: [u8; 2],
    /// How far the component's points and the triangle are from each other at most, object units.
    pub bound: f32,
}

const _: () = assert!(mem::size_of::<Remnant>() == 32 && mem::offset_of!(Remnant, bound) == 28);

impl Remnant {
    /// The cluster in which it vanishes.
    pub fn cluster(&self) -> ClusterId {
        ClusterId(self.cluster)
    }

    /// Whether its cluster does not draw the component at a position.
    pub fn is_missing_at(&self, vertices: u32) -> bool {
        vertices <= u32::from(self.corners[0])
    }

    /// The order of the section.
    pub(crate) fn key(&self) -> (u32, [u16; 3]) {
        (self.cluster, self.corners)
    }

    /// The corners of the triangle that goes with a vertex's collapse, if nothing else hangs on any of them; `places` is scratch.
    ///
    /// # Errors
    /// [`FormatError::Value`] if that is not so.
    pub fn corners_of(page: &Page<'_>, vertex: usize, places: &mut Places) -> Result<[u16; 3], FormatError> {
        let place = FilePart::Section(SectionKind::Remnants);
        let wrong = |got: &str| invalid(place, "corners", "the last triangle of a component", got);
        let collapses = page.base_vertex_count..page.vertex_count();
        if !collapses.contains(&vertex) {
            return Err(wrong("a vertex that does not collapse"));
        }
        places.go_to(&page.progressive_mesh(), vertex + 1);
        let (from, to) = (vertex as u16, page.targets[vertex - page.base_vertex_count]);
        let first = places.triangles(page.triangles).find(|corners| corners.contains(&from));
        let third = first.and_then(|corners| corners.into_iter().find(|v| *v != from && *v != to));
        let third = third.ok_or_else(|| wrong("a vertex without triangles"))?;

        let own = [from, to, third];
        let hangs_on = |corners: &[u16; 3]| own.iter().any(|v| corners.contains(v));
        let is_alone = places
            .triangles(page.triangles)
            .filter(hangs_on)
            .all(|corners| own.iter().all(|v| corners.contains(v)));
        if is_alone { Ok(own) } else { Err(wrong("one that others hang on")) }
    }
}

/// Checks that each is of a vertex that its cluster has, and their order.
pub(crate) fn check(remnants: &[Remnant], clusters: &[ClusterRecord]) -> Result<(), FormatError> {
    let place = FilePart::Section(SectionKind::Remnants);
    for remnant in remnants {
        let Remnant { center, radius, corners: [from, to, third], bound, .. } = *remnant;
        let cluster = clusters.get(remnant.cluster().index()).ok_or_else(|| {
            invalid(place, "cluster", format_args!("less than {}", clusters.len()), remnant.cluster)
        })?;
        let collapses = cluster.base_vertex_count..cluster.vertex_count;
        let expected = format_args!("a vertex that collapses and two others before it, of {collapses:?}");
        let legal = collapses.contains(&from.into()) && to < from && third < from && to != third;
        require(legal, place, "corners", expected, format_args!("{:?}", remnant.corners))?;
        let finite = center.iter().all(|x| x.is_finite()) && radius.is_finite() && bound.is_finite();
        let expected = "finite numbers, no length negative";
        require(finite && radius >= 0.0 && bound >= 0.0, place, "ball and bound", expected, "others")?;
    }
    let sorted = remnants.is_sorted_by(|a, b| a.key() < b.key());
    require(sorted, place, "order", "by cluster and corners, each once", "another")
}

/// Checks what groups tell of components without a remnant.
pub(crate) fn check_rest(groups: &[GroupRecord]) -> Result<(), FormatError> {
    for (id, group) in (0..).map(GroupId).zip(groups) {
        let legal = group.rest >= 0.0 && group.rest <= group.gaps.base;
        let expected = format_args!("0 to {}", group.gaps.base);
        require(legal, FilePart::Group(id), "rest_gap", expected, group.rest)?;
    }
    Ok(())
}
