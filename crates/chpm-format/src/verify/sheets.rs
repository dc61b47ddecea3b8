//! Checks of a cluster's sheet (I13): it is what was written, its image has the size of its record, and every triangle is in its chart at every position.

use super::{Invariant, Report};
use crate::error::FilePart;
use crate::page::Page;
use crate::reader::Chpm;
use crate::section_kind::SectionKind;
use crate::sheet::Sheet;
use chpm_mesh::ClusterId;

pub(super) fn check<D: AsRef<[u8]>>(file: &Chpm<D>, id: ClusterId, page: &Page<'_>, report: &mut Report) {
    let place = FilePart::Sheet(id);
    let sheet = match file.sheet(id) {
        Ok(Some(sheet)) => sheet,
        Ok(None) => return,
        Err(error) => return report.expect(false, Invariant::Bytes, place, error),
    };
    check_bytes(file, &sheet, place, report);

    let [width, height] = sheet.record.size;
    let (expected, got) = ([u32::from(width), u32::from(height)], sheet.image_size());
    let message = format_args!("an image of {expected:?} texels expected, got {got:?}");
    report.expect(got == Some(expected), Invariant::Sheets, place, message);

    let outside = outside(&sheet, page);
    let message = format_args!("every triangle in its chart expected, {outside} are not at some position");
    report.expect(outside == 0, Invariant::Sheets, place, message);
}

/// Zeros where nothing else belongs, in the record and behind the sheet.
fn check_bytes<D: AsRef<[u8]>>(file: &Chpm<D>, sheet: &Sheet<'_>, place: FilePart, report: &mut Report) {
    let record = &sheet.record;
    report.expect(record.is_padded(), Invariant::Bytes, place, "zeros in reserved bytes expected");
    let end = record.offset + record.len();
    let next = file.sheets().get(record.cluster as usize + 1).map_or(end, |next| next.offset);
    let texels = file.sections().find(|(kind, _)| *kind == SectionKind::Texels);
    let first = texels.map_or(0, |(_, range)| range.start as u64);
    let padding = file.at(first + end, next - end);
    let zero = padding.is_some_and(|padding| padding.iter().all(|byte| *byte == 0));
    report.expect(zero, Invariant::Bytes, place, "zeros behind the sheet expected");
}

/// Triangles that leave their chart's rectangle at some position.
fn outside(sheet: &Sheet<'_>, page: &Page<'_>) -> usize {
    let (layout, mesh) = (&sheet.layout, page.progressive_mesh());
    let is_out = |(corners, chart): (&[u16; 3], &u16)| {
        let chart = &layout.charts[usize::from(*chart)];
        let holds =
            |corner: u16| chart.holds(chart.place(layout.origin, page.positions[usize::from(corner)]));
        let is_in = mesh.states(*corners).all(|state| state.into_iter().all(holds));
        !is_in
    };
    page.triangles.iter().zip(&layout.chart_of).filter(|triangle| is_out(*triangle)).count()
}
