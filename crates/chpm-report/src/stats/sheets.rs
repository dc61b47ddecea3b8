//! Sheets of a level's clusters.

use super::{Row, Spread, by};
use chpm_extmem::MappedFile;
use chpm_format::{Chpm, SheetRecord};
use serde::Serialize;

/// The sheets of a level.
#[derive(Clone, Copy, Serialize, Debug)]
pub struct SheetStats {
    /// Their texels.
    pub texels: u64,
    /// Their bytes: images, and where triangles are in them.
    pub bytes: u64,
    /// Bits of an image for each texel.
    pub bits_per_texel: f64,
    /// Charts of a sheet.
    pub charts: Option<Spread>,
    /// Side of a sheet's texel.
    pub texel: Option<Spread>,
}

impl SheetStats {
    /// Of some clusters; none in a file without sheets.
    pub(super) fn of(file: &Chpm<MappedFile>, rows: &[&Row<'_>]) -> Option<Self> {
        if !file.header().has_sheets() {
            return None;
        }
        let sheets: Vec<&SheetRecord> = rows.iter().map(|row| &file.sheets()[row.id as usize]).collect();
        let texels = sheets.iter().map(|sheet| u64::from(sheet.size[0]) * u64::from(sheet.size[1])).sum();
        Some(SheetStats {
            texels,
            bytes: sheets.iter().map(|sheet| sheet.len()).sum(),
            bits_per_texel: by(sheets.iter().map(|sheet| 8 * u64::from(sheet.image_len)).sum(), texels),
            charts: Spread::of(sheets.iter().map(|sheet| sheet.chart_count.into())),
            texel: Spread::of(sheets.iter().map(|sheet| sheet.texel.into())),
        })
    }
}
