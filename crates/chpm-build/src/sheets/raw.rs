//! Sheets of a level before they are encoded, for the level above.

use crate::error::BuildError;
use chpm_extmem::{Spool, Store};
use chpm_mesh::Chart;
use chpm_texture::sheet::Plan;

/// The sheets of a level.
#[derive(Debug)]
pub(super) struct Raw(Spool);

/// Where a sheet is.
#[derive(Clone, Copy, Debug)]
pub(super) struct RawRef {
    offset: u64,
    charts: u32,
    triangles: u32,
    size: [u32; 2],
}

/// A sheet that was read.
#[derive(Default, Debug)]
pub(super) struct RawSheet {
    pub(super) origin: [f32; 3],
    pub(super) charts: Vec<Chart>,
    pub(super) texel_of: Vec<f64>,
    pub(super) chart_of: Vec<u16>,
    pub(super) width: usize,
    pub(super) texels: Vec<[u8; 4]>,
}

impl RawRef {
    /// Bytes that it takes when it is read.
    pub(super) fn memory(&self) -> u64 {
        2 * self.texels_len() + 64 * u64::from(self.charts) + 2 * u64::from(self.triangles)
    }

    fn texels_len(&self) -> u64 {
        4 * u64::from(self.size[0]) * u64::from(self.size[1])
    }
}

impl Raw {
    pub(super) fn new(store: &Store) -> Self {
        Raw(Spool::new(store, "sheets of a level"))
    }

    pub(super) fn append(&self, plan: &Plan, texels: &[[u8; 4]]) -> Result<RawRef, BuildError> {
        let mut bytes = bytemuck::cast_slice(&plan.origin).to_vec();
        bytes.extend_from_slice(bytemuck::cast_slice(&plan.charts));
        bytes.extend_from_slice(bytemuck::cast_slice(&plan.texel_of));
        bytes.extend_from_slice(bytemuck::cast_slice(&plan.chart_of));
        bytes.extend_from_slice(texels.as_flattened());
        let offset = self.0.append(&bytes)?;
        let [charts, triangles] = [plan.charts.len(), plan.chart_of.len()].map(|count| count as u32);
        Ok(RawRef { offset, charts, triangles, size: plan.size })
    }

    pub(super) fn read(&self, at: &RawRef, out: &mut RawSheet) -> Result<(), BuildError> {
        let (charts, triangles) = (at.charts as usize, at.triangles as usize);
        let lens = [12, size_of::<Chart>() * charts, 8 * charts, 2 * triangles];
        let (len, texels) = (lens.iter().sum::<usize>(), at.texels_len() as usize);
        let mut bytes = Vec::new();
        self.0.read(at.offset, len, &mut bytes)?;
        let mut rest = &bytes[..];
        let [origin, charts, texel_of, chart_of] = lens.map(|len| {
            let (part, after) = rest.split_at(len);
            rest = after;
            part
        });
        out.origin = bytemuck::pod_read_unaligned(origin);
        out.charts.clear();
        out.charts.extend(charts.chunks_exact(size_of::<Chart>()).map(bytemuck::pod_read_unaligned::<Chart>));
        out.texel_of.clear();
        out.texel_of.extend(texel_of.as_chunks().0.iter().map(|eight| f64::from_le_bytes(*eight)));
        out.chart_of.clear();
        out.chart_of.extend(chart_of.as_chunks().0.iter().map(|two| u16::from_le_bytes(*two)));
        out.width = at.size[0] as usize;
        out.texels.clear();
        out.texels.resize(texels / 4, [0; 4]);
        self.0.read_exact(at.offset + len as u64, out.texels.as_flattened_mut())?;
        Ok(())
    }
}
