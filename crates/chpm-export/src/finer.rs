//! Sheets with finer texels than a file has for a cluster: baked from those of the clusters below, whose base meshes together are its finest mesh (I4).
//!
//! Texels of a file grow from level to level, since coarse clusters are seen from afar. A mesh that is taken out of it is looked at from anywhere.

use crate::error::ExportError;
use chpm_format::{Chpm, Page, SheetLayout};
use chpm_image::ImageRows;
use chpm_mesh::{ClusterId, GroupId, Places, pm};
use chpm_texture::linear_texel;
use chpm_texture::sheet::{Below, Paint, Plan, Sampled, Surface};
use std::io::Cursor;

/// Bytes that it takes for each texel of a sheet: itself while it is baked, and what it is baked from; and for each of the largest sheet that is read.
const BAKED: u64 = 16;
const READ: u64 = 16;
/// Most texels of a sheet.
const MOST: u64 = 1 << 24;
/// Colour of what shows nothing.
const GREY: [u8; 4] = [128, 128, 128, 255];

/// A sheet, decoded.
pub(crate) struct FineSheet {
    pub(crate) layout: SheetLayout,
    pub(crate) size: [u32; 2],
    pub(crate) texels: Vec<[u8; 4]>,
}

impl FineSheet {
    /// The sheet that a file has.
    pub(crate) fn stored<D: AsRef<[u8]>>(file: &Chpm<D>, cluster: ClusterId) -> Result<Self, ExportError> {
        let failed = |reason: String| ExportError::Sheet { cluster, reason };
        let sheet = file.sheet(cluster)?.ok_or_else(|| failed("there is none".to_owned()))?;
        let size = sheet.record.size.map(u32::from);
        let bytes = Cursor::new(sheet.image.to_vec());
        let mut rows = ImageRows::open(bytes, u64::MAX).map_err(|error| failed(error.to_string()))?;
        if rows.size() != size {
            return Err(failed(format!("an image of {:?}, not of {size:?}", rows.size())));
        }
        let mut texels = Vec::with_capacity(size[0] as usize * size[1] as usize);
        rows.read_rows(size[1] as usize, &mut texels).map_err(|error| failed(error.to_string()))?;
        Ok(FineSheet { layout: sheet.layout, size, texels })
    }

    fn sampled(self) -> Sampled {
        let SheetLayout { origin, charts, chart_of } = self.layout;
        let texels = self.texels.iter().map(linear_texel).collect();
        Sampled { origin, charts, chart_of, width: self.size[0] as usize, texels }
    }
}

/// Bytes that it takes at most to make sheets of so many texels together, besides themselves.
pub(crate) fn memory<D: AsRef<[u8]>>(file: &Chpm<D>, texels: u64) -> u64 {
    let area = |[width, height]: [u16; 2]| u64::from(width) * u64::from(height);
    let largest = file.sheets().iter().map(|sheet| area(sheet.size)).max().unwrap_or(0);
    BAKED * texels.min(MOST) + READ * largest
}

/// How much coarser texels are than those of the finest clusters below.
pub(crate) struct Coarseness<'a, D> {
    file: &'a Chpm<D>,
    /// By group, how many times more texels the leaves below have than its coarse clusters; no number where it is not known yet.
    shares: Vec<f64>,
}

impl<'a, D: AsRef<[u8]>> Coarseness<'a, D> {
    pub(crate) fn new(file: &'a Chpm<D>) -> Self {
        let mut found = Coarseness { file, shares: vec![f64::NAN; file.groups().len()] };
        for group in 0..file.groups().len() as u32 {
            found.share(GroupId(group));
        }
        found
    }

    fn texels(&self, cluster: u32) -> f64 {
        let [width, height] = self.file.sheets()[cluster as usize].size.map(f64::from);
        width * height
    }

    fn share(&mut self, group: GroupId) -> f64 {
        let file = self.file;
        if self.shares[group.index()].is_nan() {
            let below = file.fine(group).iter();
            let below: f64 =
                below.map(|id| self.texels(*id) * self.share(file.clusters()[*id as usize].group())).sum();
            let own: f64 = file.coarse(group).iter().map(|id| self.texels(*id)).sum();
            self.shares[group.index()] = if below > own { below / own } else { 1.0 };
        }
        self.shares[group.index()]
    }

    /// How many times longer the sides of a cluster's texels are than those of the finest clusters below.
    pub(crate) fn of(&self, cluster: ClusterId) -> f64 {
        self.shares[self.file.clusters()[cluster.index()].group().index()].sqrt()
    }

    /// The sheet of a cluster with texels that are so many times coarser than those of the finest clusters below; and how many times they are. `check` is called often, and
    /// may end it.
    ///
    /// # Errors
    /// Those of pages and sheets that are damaged; what `check` answers.
    pub(crate) fn sheet<E: From<ExportError>>(
        &self,
        cluster: ClusterId,
        coarser: f64,
        check: &mut impl FnMut() -> Result<(), E>,
    ) -> Result<(FineSheet, f64), E> {
        check()?;
        let Coarseness { file, .. } = self;
        let below = file.fine(file.clusters()[cluster.index()].group());
        let own = self.of(cluster);
        if own <= coarser || below.is_empty() {
            return Ok((FineSheet::stored(file, cluster)?, own));
        }
        let buffer = file.page(cluster).map_err(ExportError::from)?;
        let page = buffer.view();
        let corners_of = |triangle: u32| {
            page.triangles[triangle as usize].map(|corner| page.positions[usize::from(corner)])
        };
        let mut found = found(file, &page, below)?;
        found.sort_unstable();

        let count = page.triangles.len();
        let (mut sheets, mut paints) = (Below::default(), vec![Paint::Colors([GREY; 3]); count]);
        let mut texels = vec![f64::NAN; count];
        for some in found.chunk_by(|(a, ..), (b, ..)| a == b) {
            let number = sheets.0.len() as u32;
            let (sheet, is) = self.sheet(ClusterId(some[0].0), coarser, check)?;
            sheets.0.push(sheet.sampled());
            for (_, here, there) in some {
                let (paint, texel) = sheets.paint(number, *there, corners_of(*here));
                (paints[*here as usize], texels[*here as usize]) = (paint, texel * (coarser / is).max(1.0));
            }
        }
        let surface = Surface {
            positions: page.positions,
            triangles: page.triangles,
            base_vertex_count: page.base_vertex_count,
            targets: page.targets,
            texels: &texels,
            least_texel: 0.0,
        };
        let failed = |reason: String| ExportError::Sheet { cluster, reason };
        let plan = Plan::new(&surface).ok_or_else(|| failed("it takes too many charts".to_owned()))?;
        check()?;
        let texels = plan.bake(&surface, &paints, &mut sheets).map_err(|error| failed(error.to_string()))?;
        let layout = SheetLayout { origin: plan.origin, charts: plan.charts, chart_of: plan.chart_of };
        Ok((FineSheet { layout, size: plan.size, texels }, coarser))
    }
}

/// By triangle of a page, which it is of the base meshes of the clusters below: cluster, triangle here, and triangle there.
fn found<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    page: &Page<'_>,
    below: &[u32],
) -> Result<Vec<(u32, u32, u32)>, ExportError> {
    let mut all = Vec::new();
    for id in below {
        let buffer = file.page(ClusterId(*id))?;
        let page = buffer.view();
        let mut places = Places::default();
        places.go_to(&page.progressive_mesh(), page.base_vertex_count);
        for (triangle, corners) in (0..).zip(page.triangles) {
            let corners = corners.map(|corner| places.of(corner));
            if pm::is_alive(&corners) {
                all.push((place_of(&page, corners), *id, triangle));
            }
        }
    }
    all.sort_unstable();
    let here = (0..).zip(page.triangles).map(|(at, corners)| (place_of(page, *corners), at));
    let mut here: Vec<(_, u32)> = here.collect();
    here.sort_unstable();
    let mut found = Vec::with_capacity(here.len());
    let mut all = all.into_iter().peekable();
    for (place, triangle) in here {
        while all.next_if(|(other, ..)| *other < place).is_some() {}
        found.extend(all.next_if(|(other, ..)| *other == place).map(|(_, id, of)| (id, triangle, of)));
    }
    Ok(found)
}

/// The key of a triangle, whichever corner it begins with.
fn place_of(page: &Page<'_>, corners: [u16; 3]) -> [[u32; 3]; 3] {
    let bits = corners.map(|corner| page.positions[usize::from(corner)].map(f32::to_bits));
    let turned = |first: usize| std::array::from_fn(|at| bits[(first + at) % 3]);
    (1..3).map(turned).fold(bits, std::cmp::min)
}
