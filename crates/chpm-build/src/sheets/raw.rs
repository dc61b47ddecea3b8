//! Sheets of a level before they are encoded, for the level above.

use crate::error::BuildError;
use chpm_extmem::{Spool, Store};
use chpm_mesh::Chart;
use chpm_texture::linear_texel;
use chpm_texture::sheet::{Plan, Sampled, Texel};

/// Bytes of a texel as it lies there, and how many are read at once.
const PIXEL: u64 = 4;
const AT_ONCE: usize = 1 << 14;

/// The sheets of a level.
#[derive(Debug)]
pub(super) struct Raw(Spool);

/// Where a sheet is: its charts, and its texels.
#[derive(Clone, Copy, Debug)]
pub(super) struct RawRef {
    layout: u64,
    texels: u64,
    charts: u32,
    triangles: u32,
    size: [u32; 2],
}

impl RawRef {
    /// Bytes that it takes when it is read.
    pub(super) fn memory(&self) -> u64 {
        let texels = size_of::<Texel>() as u64 * self.texel_count() as u64;
        texels + 64 * u64::from(self.charts) + 2 * u64::from(self.triangles)
    }

    fn texel_count(&self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }
}

impl Raw {
    pub(super) fn new(store: &Store) -> Self {
        Raw(Spool::new(store, "sheets of a level"))
    }

    pub(super) fn append(&self, plan: &Plan, texels: &[[u8; 4]]) -> Result<RawRef, BuildError> {
        let mut bytes = bytemuck::cast_slice(&plan.origin).to_vec();
        bytes.extend_from_slice(bytemuck::cast_slice(&plan.charts));
        bytes.extend_from_slice(bytemuck::cast_slice(&plan.chart_of));
        let layout = self.0.append(&bytes)?;
        let texels = self.0.append(texels.as_flattened())?;
        let [charts, triangles] = [plan.charts.len(), plan.chart_of.len()].map(|count| count as u32);
        Ok(RawRef { layout, texels, charts, triangles, size: plan.size })
    }

    pub(super) fn read(&self, at: &RawRef, out: &mut Sampled) -> Result<(), BuildError> {
        let (charts, triangles) = (at.charts as usize, at.triangles as usize);
        let lens = [12, size_of::<Chart>() * charts, 2 * triangles];
        let mut bytes = Vec::new();
        self.0.read(at.layout, lens.iter().sum(), &mut bytes)?;
        let mut rest = &bytes[..];
        let [origin, charts, chart_of] = lens.map(|len| {
            let (part, after) = rest.split_at(len);
            rest = after;
            part
        });
        out.origin = bytemuck::pod_read_unaligned(origin);
        out.charts.clear();
        out.charts.extend(charts.chunks_exact(size_of::<Chart>()).map(bytemuck::pod_read_unaligned::<Chart>));
        out.chart_of.clear();
        out.chart_of.extend(chart_of.as_chunks().0.iter().map(|two| u16::from_le_bytes(*two)));
        out.width = at.size[0] as usize;
        out.texels.clear();
        out.texels.reserve(at.texel_count());
        for begin in (0..at.texel_count()).step_by(AT_ONCE) {
            let count = AT_ONCE.min(at.texel_count() - begin);
            self.0.read(at.texels + PIXEL * begin as u64, PIXEL as usize * count, &mut bytes)?;
            out.texels.extend(bytes.as_chunks().0.iter().map(linear_texel));
        }
        Ok(())
    }
}
