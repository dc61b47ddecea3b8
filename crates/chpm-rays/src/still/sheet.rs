//! The image of a cluster's surface, as rays see it.

use chpm_format::{Sheet, SheetRecord};
use chpm_texture::sheet::{Painted, Sizes};

/// Most bytes of an image in all sizes, which a million texels have: it is halved until it has no more, whatever the memory, which is not to show.
pub(super) const MOST: u64 = 6 << 20;

/// Longest side, texels, that a sheet is seen with.
fn longest(record: &SheetRecord) -> u32 {
    let mut longest = u32::from(record.size[0].max(record.size[1]));
    while longest > 1 && Sizes::bytes_of(record.size, longest) > MOST {
        longest /= 2;
    }
    longest
}

/// Bytes that the sheet of a cluster of so many triangles takes.
pub(super) fn bytes_of(record: &SheetRecord, triangles: u32) -> u64 {
    let texels = Sizes::bytes_of(record.size, longest(record));
    texels + 40 * u64::from(record.chart_count) + 2 * u64::from(triangles)
}

/// Decodes a sheet; none where its image is damaged.
pub(super) fn painted(sheet: Sheet<'_>) -> Option<Painted> {
    let Sheet { record, layout, image } = sheet;
    let triangles = (layout.origin, layout.charts, layout.chart_of);
    Painted::new((image, record.size, longest(&record)), record.texel, triangles)
}
