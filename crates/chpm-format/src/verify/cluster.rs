//! Checks of one page, next to its record.

use super::remnants;
use super::shared::SharedIds;
use super::tables::page_padding_is_zero;
use super::{Invariant, Report};
use crate::error::FilePart;
use crate::header::BoundaryMode;
use crate::header::VERSION_MINOR;
use crate::page::{PAGE_HEADER_LEN, Page};
use crate::parts::count_base_triangles;
use crate::reader::Chpm;
use chpm_mesh::geom::distance;
use chpm_mesh::{Aabb, ClusterId, Places, Scalar, scalar_places};
use std::mem;

/// The most that rounding to f32 can move a point of the box by, and what is lost where that is stored.
fn rounding(bounds: &Aabb) -> f64 {
    let corners = [bounds.min, bounds.max];
    let reach = corners.as_flattened().iter().fold(0.0, |reach: f64, x| reach.max(f64::from(x.abs())));
    reach * f64::from(f32::EPSILON) + 8.0 * f64::from(f32::from_bits(1))
}

/// The most that going to a lattice moves a point by, besides what [`rounding`] does.
fn half_step(step: Option<f64>) -> f64 {
    step.map_or(0.0, |step| 3f64.sqrt() / 2.0 * step * (1.0 + f64::EPSILON * 4.0))
}

/// Checks a cluster by itself and takes its shared vertices in.
pub(super) fn check<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    id: ClusterId,
    page: &Page<'_>,
    scratch: &mut Scratch,
    shared: &mut SharedIds,
    report: &mut Report,
) {
    let place = FilePart::Page(id);
    check_zeros(file, id, report);
    check_bounds(file, id, page, report);
    if let Some(step) = scratch.lattice_step {
        let off = page.positions.as_flattened().iter().find(|x| (f64::from(**x) / step).fract() != 0.0);
        let message =
            format_args!("multiples of the lattice's step {step:e} expected, one coordinate is {off:?}");
        report.expect(off.is_none(), Invariant::Coverage, place, message);
    }

    let base = count_base_triangles(&page.progressive_mesh(), &mut scratch.places);
    let message =
        format_args!("{} triangles in the base mesh expected, got {base}", page.base_triangle_count);
    report.expect(base == page.base_triangle_count, Invariant::ProgressiveMesh, place, message);

    remnants::check(file, id, page, &mut scratch.places, report);
    let record = &file.clusters()[id.index()];
    let leaf = record.is_leaf();
    let message = "a leaf expected where triangles are not the source's";
    report.expect(leaf || !record.is_trimmed(), Invariant::Coverage, FilePart::Cluster(id), message);
    // What vanished before the detail below was left out keeps its vertex.
    if leaf && !record.is_trimmed() {
        scratch.used.clear();
        scratch.used.resize(page.vertex_count(), false);
        page.triangles.as_flattened().iter().for_each(|v| scratch.used[usize::from(*v)] = true);
        let most = rounding(&file.header().aabb()) + half_step(scratch.lattice_step);
        let message = format_args!(
            "no error in the source's own triangles but that of rounding, at most {most:e}, expected, got {:e}",
            record.min_error
        );
        report.expect(
            f64::from(record.min_error) <= most,
            Invariant::Coverage,
            FilePart::Cluster(id),
            message,
        );
        let unused = scratch.used.iter().filter(|used| !**used).count();
        let message =
            format_args!("triangles over every vertex of a leaf expected, {unused} vertices have none");
        report.expect(unused == 0, Invariant::Coverage, place, message);
    }
    list_shared(file, id, page, shared, report);
}

/// Takes the shared vertices of a cluster in.
pub(super) fn list_shared<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    id: ClusterId,
    page: &Page<'_>,
    shared: &mut SharedIds,
    report: &mut Report,
) {
    let (record, place) = (&file.clusters()[id.index()], FilePart::Page(id));
    let locked = file.header().boundary_mode() == Some(BoundaryMode::Lock);
    for (local, shared_id) in page.shared() {
        if !shared.has(shared_id) {
            continue;
        }
        let position = page.positions[usize::from(local)].map(f32::to_bits);
        shared.list(shared_id, position, id, (record.level, record.group()), report);
        let collapses = usize::from(local) >= page.base_vertex_count;
        if collapses {
            shared.collapse(shared_id, record.group());
        }
        if locked && collapses {
            let message = format_args!("shared vertex {shared_id} collapses, though boundaries are locked");
            report.expect(false, Invariant::Boundary, place, message);
        }
    }
}

/// Buffers that are used again for every page.
#[derive(Default)]
pub(super) struct Scratch {
    pub(super) places: Places,
    pub(super) used: Vec<bool>,
    /// As the file tells it.
    pub(super) lattice_step: Option<f64>,
}

fn check_zeros<D: AsRef<[u8]>>(file: &Chpm<D>, id: ClusterId, report: &mut Report) {
    let place = FilePart::Page(id);
    let reserved = mem::offset_of!(crate::PageHeader, reserved)..PAGE_HEADER_LEN;
    let zero = file.header().version_minor > VERSION_MINOR
        || file.is_packed(id)
        || file.page_bytes(id)[reserved].iter().all(|b| *b == 0);
    report.expect(zero, Invariant::Bytes, place, "zero expected in reserved fields");
    report.expect(page_padding_is_zero(file, id), Invariant::Bytes, place, "zeros expected behind the page");
}

/// Numbers are finite; the boxes and spheres hold the vertices (I6).
fn check_bounds<D: AsRef<[u8]>>(file: &Chpm<D>, id: ClusterId, page: &Page<'_>, report: &mut Report) {
    let place = FilePart::Page(id);
    report.expect(page.is_finite(), Invariant::Bytes, place, "finite numbers expected");

    for (words, Scalar { name, kind, range }) in scalar_places(file.scalars()) {
        let values = (0..page.vertex_count()).map(|v| kind.value(&page.scalars_of(v)[words.clone()]));
        let outside = values.filter(|value| !range.holds(*value)).count();
        let message =
            format_args!("values of {name:?} in the range of SCALARS expected, {outside} are outside");
        report.expect(outside == 0, Invariant::Bytes, place, message);
    }

    let record = &file.clusters()[id.index()];
    let bounds = Aabb::of_points(page.positions);
    let (min, max) = (bounds.min, bounds.max);
    let message = format_args!(
        "vertices from {:?} to {:?} expected, got {min:?} to {max:?}",
        record.aabb_min, record.aabb_max
    );
    report.expect(record.aabb().contains(&bounds), Invariant::Nesting, place, message);
    let group = &file.groups()[record.group as usize];
    for (sphere, of) in [(record.sphere(), "the cluster"), (group.sphere(), "its group")] {
        let reach = page.positions.iter().map(|p| distance(sphere.center, *p)).fold(0.0, f64::max);
        let message = format_args!(
            "vertices within {} of {:?}, the centre of {of}, expected, one is {reach} away",
            sphere.radius, sphere.center
        );
        report.expect(reach <= f64::from(sphere.radius), Invariant::Nesting, place, message);
    }
}
