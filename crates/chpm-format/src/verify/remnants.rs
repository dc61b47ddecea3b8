//! Checks of a page's remnants: each is what is left of a component just before that vanishes (I8), and no farther from it than what the page says.

use super::{Invariant, Report};
use crate::error::FilePart;
use crate::page::Page;
use crate::reader::Chpm;
use crate::remnant::Remnant;
use chpm_mesh::{ClusterId, Places};

pub(super) fn check<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    id: ClusterId,
    page: &Page<'_>,
    places: &mut Places,
    report: &mut Report,
) {
    let all = file.remnants();
    let first = all.partition_point(|remnant| remnant.cluster < id.0);
    for remnant in all[first..].iter().take_while(|remnant| remnant.cluster == id.0) {
        check_one(remnant, page, places, FilePart::Page(id), report);
    }
}

fn check_one(remnant: &Remnant, page: &Page<'_>, places: &mut Places, place: FilePart, report: &mut Report) {
    let corners = remnant.corners;
    match Remnant::corners_of(page, corners[0].into(), places) {
        Ok(found) => {
            let message = format_args!("a remnant of the corners {found:?} expected, got {corners:?}");
            report.expect(found == corners, Invariant::Vertices, place, message);
        }
        Err(error) => report.expect(false, Invariant::Vertices, place, error),
    }
    let shared = page.shared().any(|(vertex, _)| corners.contains(&vertex));
    let message = format_args!("a remnant of vertices that are not shared expected, at {corners:?}");
    report.expect(!shared, Invariant::Boundary, place, message);
    let (most, got) = (page.error_at(corners[0].into()), remnant.bound);
    let message = format_args!("a remnant within the error {most} expected, got {got}");
    report.expect(got <= most, Invariant::Nesting, place, message);
}
