//! The sheet of one cluster.

use super::found::{Found, Shown};
use super::raw::{Raw, RawRef};
use super::seams::Seams;
use super::too_many;
use crate::context::Context;
use crate::error::BuildError;
use crate::ingest::{Painted, place_of};
use crate::trim::Built;
use chpm_extmem::TaskReservation;
use chpm_format::Page;
use chpm_mesh::Places;
use chpm_texture::sheet::{Below, Paint, Pixels, Plan, Sampled, Surface, texel_side};
use chpm_texture::{TextureError, TileReader};

/// How much larger a parent's texels are than its children's: half as many texels, as there are half as many triangles.
const COARSER: f64 = std::f64::consts::SQRT_2;
/// Colour of what shows nothing.
const GREY: [u8; 4] = [128, 128, 128, 255];

/// A cluster, and all that its sheet comes from.
pub(super) struct Cluster<'a> {
    pub(super) node: u32,
    pub(super) built: &'a Built,
    pub(super) painted: &'a Painted,
    pub(super) found: &'a Found,
    /// Sheets by level, and by node where each is.
    pub(super) levels: &'a [(Raw, u32)],
    pub(super) raws: &'a [Option<RawRef>],
}

/// Buffers of one thread.
#[derive(Default)]
pub(super) struct Scratch {
    page: Vec<u8>,
    child: Vec<u8>,
    places: Places,
    shown: Vec<Shown>,
    paints: Vec<Paint>,
    texels: Vec<f64>,
    below: Vec<([u64; 2], u32, u32)>,
    here: Vec<([u64; 2], u32)>,
    seams: Seams,
}

impl Cluster<'_> {
    /// Plans and bakes.
    pub(super) fn bake(&self, scratch: &mut Scratch, context: &Context<'_>) -> Result<Baked, BuildError> {
        let mut bytes = std::mem::take(&mut scratch.page);
        let at = self.built.clusters.page(self.node);
        self.built.clusters.pages.read(at.offset, at.len as usize, &mut bytes)?;
        let page = Page::view(&bytes)?;
        scratch.paints.clear();
        scratch.paints.extend(page.triangles.iter().map(|corners| {
            Paint::Colors(corners.map(|corner| page.colors.get(usize::from(corner)).copied().unwrap_or(GREY)))
        }));
        scratch.texels.clear();
        scratch.texels.resize(page.triangles.len(), f64::NAN);
        let baked = match self.built.tree.children(self.node) {
            [] => self.leaf(&page, scratch, context),
            children => self.parent(&page, children, scratch, context),
        };
        scratch.page = bytes;
        baked
    }

    /// The sheet of a leaf, from the source's images.
    fn leaf(
        &self,
        page: &Page<'_>,
        scratch: &mut Scratch,
        context: &Context<'_>,
    ) -> Result<Baked, BuildError> {
        let Painted { materials, tiles, .. } = self.painted;
        for shown in self.found.of(self.node, &mut scratch.shown)? {
            let triangle = shown.triangle as usize;
            let corners = page.triangles[triangle].map(|corner| page.positions[usize::from(corner)]);
            let Some(material) = materials.get(shown.wedge.material as usize) else { continue };
            let factor = material.factor.map(|part| (part.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
            let (_, first) = place_of(corners);
            let uv = shown.wedge.uv(first);
            let is_known = uv.as_flattened().iter().all(|value| value.is_finite());
            let Some(image) = material.image.filter(|_| is_known) else {
                scratch.paints[triangle] = Paint::Colors([factor; 3]);
                continue;
            };
            let [width, height] = tiles.size(image).map(f64::from);
            let places = uv.map(|[u, v]| [f64::from(u) * width, (1.0 - f64::from(v)) * height]);
            scratch.texels[triangle] = self.painted.coarser(image) * texel_side(corners, places);
            scratch.paints[triangle] = Paint::Image { image: shown.wedge.material, corners: places, factor };
        }
        scratch.seams.limit(page, &scratch.paints, &mut scratch.texels);
        let mut pixels = TileReader::new(tiles, materials);
        finish(page, 0.0, TileReader::BYTES, scratch, context, &mut pixels)
    }

    /// The sheet of a parent, from those of its children.
    fn parent(
        &self,
        page: &Page<'_>,
        children: &[u32],
        scratch: &mut Scratch,
        context: &Context<'_>,
    ) -> Result<Baked, BuildError> {
        let Built { tree, clusters, .. } = self.built;
        let refs: Vec<_> = children.iter().map(|child| self.raws[*child as usize]).collect();
        let memory: u64 = refs.iter().flatten().map(RawRef::memory).sum();
        let reading = context.store.budget.reserve_task("sheets of children", memory)?;
        let mut sheets = Below(vec![Sampled::default(); children.len()]);
        scratch.below.clear();
        for (number, &child) in (0..).zip(children) {
            let Some(raw) = refs[number as usize] else { continue };
            let level = tree.nodes[child as usize].level as usize;
            self.levels[level].0.read(&raw, &mut sheets.0[number as usize])?;
            let at = clusters.page(child);
            clusters.pages.read(at.offset, at.len as usize, &mut scratch.child)?;
            let page = Page::view(&scratch.child)?;
            scratch.places.go_to(&page.progressive_mesh(), page.base_vertex_count);
            for (triangle, corners) in (0..).zip(page.triangles) {
                let corners = corners.map(|corner| scratch.places.of(corner));
                if chpm_mesh::pm::is_alive(&corners) {
                    let (place, _) = place_of(corners.map(|corner| page.positions[usize::from(corner)]));
                    scratch.below.push((place, number, triangle));
                }
            }
        }
        scratch.below.sort_unstable();
        let corners_of = |triangle: u32| {
            page.triangles[triangle as usize].map(|corner| page.positions[usize::from(corner)])
        };
        scratch.here.clear();
        scratch.here.extend((0..page.triangles.len() as u32).map(|at| (place_of(corners_of(at)).0, at)));
        scratch.here.sort_unstable();
        let mut below = scratch.below.iter().peekable();
        for (place, triangle) in &scratch.here {
            while below.next_if(|(other, ..)| other < place).is_some() {}
            let Some((_, child, of_child)) = below.next_if(|(other, ..)| other == place) else { continue };
            let (paint, texel) = sheets.paint(*child, *of_child, corners_of(*triangle));
            (scratch.paints[*triangle as usize], scratch.texels[*triangle as usize]) =
                (paint, COARSER * texel);
        }
        let least = f64::from(page.min_error) / 2.0;
        // What is reserved up to here is given back before more is: tasks that wait for each other would wait for ever.
        drop(reading);
        finish(page, least, memory, scratch, context, &mut sheets)
    }
}

/// A plan, its texels, and the memory that they were baked in.
type Baked = (Plan, Vec<[u8; 4]>, TaskReservation);

/// Plans the sheet of a page and bakes it, with so much memory beside.
fn finish<P: Pixels>(
    page: &Page<'_>,
    least_texel: f64,
    beside: u64,
    scratch: &Scratch,
    context: &Context<'_>,
    pixels: &mut P,
) -> Result<Baked, BuildError> {
    let surface = Surface {
        positions: page.positions,
        triangles: page.triangles,
        base_vertex_count: page.base_vertex_count,
        targets: page.targets,
        texels: &scratch.texels,
        least_texel,
    };
    let plan = Plan::new(&surface).ok_or_else(|| too_many(page.triangles.len()))?;
    let memory = context
        .store
        .budget
        .reserve_task("a sheet, which --texture vertices does without", plan.memory() + beside)?;
    let texels = plan.bake(&surface, &scratch.paints, pixels).map_err(failed)?;
    Ok((plan, texels, memory))
}

fn failed(error: TextureError) -> BuildError {
    match error {
        TextureError::Extmem(error) => error.into(),
        TextureError::Cancelled(stop) => stop.into(),
        error => BuildError::Record(error.to_string()),
    }
}
