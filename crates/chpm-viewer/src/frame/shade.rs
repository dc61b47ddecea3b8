//! Shadows of the key light: what of the picture takes them, what throws them, and the map that has them.
//!
//! Receivers are the clusters that are visible. Casters are those clusters of the camera's cut, seen or not and in the image or beside it,
//! whose box comes before the receivers' as the light sees both. What throws a shadow into the picture is refined as the camera wants it
//! there, so both are of one cut. The map has up to four parts, for less and less of the image's depth, and it is kept until a caster, the
//! light, or what is seen changes.

use super::Viewer;
use super::model::Model;
use super::paint::Plan;
use crate::error::ViewerError;
use crate::gpu::camera_uniform::FrameUniform;
use crate::gpu::shadows::{PARTS, PartUniform, ShadowUniform, place};
use crate::gpu::{CameraUniform, Casters, Gpu, Kind, ShadowMap};
use crate::scene::visibility::Sight;
use crate::scene::{Reach, Span};
use crate::stats::Stats;
use chpm_mesh::ClusterId;
use chpm_refine::Member;
use nalgebra::Vector3;

/// The map, and what is in it.
#[derive(Debug, Default)]
pub(super) struct Shade {
    map: Option<ShadowMap>,
    drawn: Option<Drawn>,
}

/// Key of a map: how each part of each model is looked at, and its clusters and their positions.
#[derive(Clone, Debug, Default, PartialEq)]
struct Drawn {
    uniforms: Vec<ShadowUniform>,
    eyes: Vec<FrameUniform>,
    clusters: Vec<(u32, ClusterId, u32)>,
}

/// A cluster that throws a shadow, and onto which parts of the map, by bits.
#[derive(Clone, Copy, Debug)]
pub(super) struct Caster {
    pub(super) member: Member,
    pub(super) sight: Sight,
    parts: u8,
}

/// Receivers and casters, as the light sees them.
#[derive(Clone, Debug)]
pub(super) struct Fit {
    /// Of the map.
    side: u32,
    /// The boxes of the parts across the light, the finest first.
    parts: Vec<[Span; 2]>,
    /// The depth of the map toward the light, from what is farthest from it.
    depth: Span,
    /// By model.
    pub(super) casters: Vec<Vec<Caster>>,
}

/// Shares of depth at which a part ends, of that of the next one.
const NEARER: f64 = 0.5;
/// Texels that a part has around what it shows.
const RIM: f64 = 3.0;
/// Sizes of a part, each so much larger than the one before: a camera that moves a little keeps its texels.
const STEPS: f64 = 8.0;
/// Texels by which what is looked up is before what is in the map: over the texels that are mixed, and for surfaces that meet in a crease.
const SLOPE: f64 = 1.5;
const ALWAYS: f64 = 0.75;
/// The rounding of depths, as a share of the map's.
const ROUNDING: f64 = 1e-6;

/// The camera of a model and the light as its boxes are looked at.
struct Sighted<'a> {
    uniform: &'a CameraUniform,
    light: [Vector3<f64>; 3],
}

impl<'a> Sighted<'a> {
    fn new(uniform: &'a CameraUniform) -> Self {
        Sighted { uniform, light: uniform.light_axes() }
    }

    /// A box of the file as seen along an axis, relative to the eye.
    fn along(&self, axis: &Vector3<f64>, low: [f32; 3], high: [f32; 3]) -> Span {
        let scaled = axis.component_mul(&self.uniform.stretch());
        Reach::along(
            &scaled.into(),
            axis.dot(&self.uniform.eye().coords),
            low.map(f64::from),
            high.map(f64::from),
        )
    }

    /// Whether a box is outside the image, beyond one of its sides.
    fn is_beside(&self, low: [f32; 3], high: [f32; 3]) -> bool {
        let ([right, up, forward], [run, rise]) = (self.uniform.axes(), self.uniform.slopes());
        [(right, run), (up, rise)].iter().any(|(side, slope)| {
            let beyond = |axis: Vector3<f64>| self.along(&axis, low, high).low > 0.0;
            beyond(**side - forward * *slope) || beyond(-**side - forward * *slope)
        })
    }

    /// A box across the light and toward it.
    fn across(&self, low: [f32; 3], high: [f32; 3]) -> [Span; 3] {
        self.light.each_ref().map(|axis| self.along(axis, low, high))
    }

    /// The image from the eye to a depth, across the light.
    fn image(&self, depth: f64) -> [Span; 2] {
        let ([right, up, forward], [run, rise]) = (self.uniform.axes(), self.uniform.slopes());
        [0, 1].map(|axis| {
            let across = |way: Vector3<f64>| self.light[axis].dot(&way);
            let mut span = Span { low: 0.0, high: 0.0 };
            for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
                span.add(across((forward + right * (x * run) + up * (y * rise)) * depth));
            }
            span
        })
    }
}

impl Viewer {
    /// Receivers and casters of a frame with these cameras; none where nothing is visible.
    pub(super) fn fit(&self, eyes: &[&CameraUniform], plan: Plan) -> Option<Fit> {
        let sighted: Vec<Sighted<'_>> = eyes.iter().map(|eye| Sighted::new(eye)).collect();
        let first = sighted.first()?.uniform;

        // How deep the picture is, and all that is seen of it.
        let (mut near, mut far) = (f64::INFINITY, 0.0_f64);
        let mut seen: Vec<(f64, [Span; 3])> = Vec::new();
        for (model, sighted) in self.models.iter().zip(&sighted) {
            let clusters = model.scene.file().clusters();
            for (member, _) in model.scene.members().filter(|(_, sight)| plan.shows(*sight)) {
                let record = &clusters[member.cluster.index()];
                let (low, high) = (record.aabb_min, record.aabb_max);
                let depth = sighted.along(&sighted.uniform.axes()[2], low, high);
                // Without culling they are shown as well.
                if depth.high < first.near() || sighted.is_beside(low, high) {
                    continue;
                }
                let begins = depth.low.max(first.near());
                (near, far) = (near.min(begins), far.max(depth.high));
                seen.push((begins, sighted.across(low, high)));
            }
        }
        if seen.is_empty() {
            return None;
        }

        // Where the picture is deep, what is near has parts of its own.
        let parts = ((far / near).log2().ceil() as usize).clamp(1, PARTS);
        let side = ShadowMap::side(&self.gpu, first.viewport());
        let whole = &sighted[0];
        let mut all = Vec::with_capacity(parts);
        let mut depth = Span::NONE;
        for part in 0..parts {
            let until = far * NEARER.powi((parts - 1 - part) as i32);
            let image = whole.image(until);
            let mut spans = [Span::NONE; 2];
            for (_, across) in seen.iter().filter(|(begins, _)| *begins <= until) {
                (0..2).for_each(|axis| spans[axis].join(&across[axis].cut(&image[axis])));
                if part == parts - 1 {
                    depth.join(&across[2]);
                }
            }
            if spans.iter().any(|span| span.low > span.high) {
                continue;
            }
            let [.., texels] = place(side, part, parts);
            let eye = [0, 1].map(|axis| whole.light[axis].dot(&first.eye().coords));
            all.push([0, 1].map(|axis| snapped(&spans[axis], eye[axis], texels)));
        }
        if all.is_empty() {
            return None;
        }
        let mut fit = Fit { side, parts: all, depth, casters: Vec::new() };
        let from = depth.low;
        for (model, sighted) in self.models.iter().zip(&sighted) {
            let clusters = model.scene.file().clusters();
            let mut casters = Vec::new();
            for (member, sight) in model.scene.members() {
                let record = &clusters[member.cluster.index()];
                let across = sighted.across(record.aabb_min, record.aabb_max);
                let bits = fit.parts.iter().enumerate().map(|(place, part)| {
                    let meets = (0..2).all(|axis| across[axis].meets(&part[axis])) && across[2].high >= from;
                    u8::from(meets) << place
                });
                let parts = bits.sum();
                if parts != 0 {
                    fit.depth.join(&across[2]);
                    casters.push(Caster { member, sight, parts });
                }
            }
            fit.casters.push(casters);
        }
        // What is farther from the light than all that is seen is cut off.
        fit.depth.low = from;
        Some(fit)
    }

    /// Notes what is to be refined for its shadow from the next round on; whether that is something else than before.
    pub(super) fn reach(&mut self, eyes: &[&CameraUniform], fit: Option<&Fit>) -> bool {
        let mut changed = false;
        for (model, eye) in self.models.iter_mut().zip(eyes) {
            let reach = fit.map(|fit| {
                let sighted = Sighted::new(eye);
                let axes = sighted.light.map(|axis| axis.component_mul(&eye.stretch()).into());
                let shifts = sighted.light.map(|axis| axis.dot(&eye.eye().coords));
                Reach { axes, shifts, parts: fit.parts.clone(), from: fit.depth.low }
            });
            changed |= model.reach != reach;
            model.reach = reach;
        }
        changed
    }

    /// Draws the map, unless the one that is there is the right one, and tells the models how it is looked up. Their casters are in lists.
    pub(super) fn shade(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        eyes: &[&CameraUniform],
        fit: Option<&Fit>,
        stats: &mut Stats,
    ) -> Result<(), ViewerError> {
        let side = fit.map_or_else(|| ShadowMap::side(&self.gpu, [1; 2]), |fit| fit.side);
        self.room(side)?;
        let mut now = Drawn::default();
        for (place, (model, eye)) in self.models.iter().zip(eyes).enumerate() {
            let uniform = fit.map_or_else(ShadowUniform::default, |fit| fit.uniform(eye));
            let parts = uniform.parts.iter().take(uniform.count[0] as usize);
            now.eyes.extend(parts.map(|part| eye.cast(part.rows)));
            now.uniforms.push(uniform);
            now.clusters
                .extend(model.thrown.iter().map(|it| (place as u32, it.member.cluster, it.member.vertices)));
            if let Some(casters) = &model.casters {
                casters.look_up(&self.gpu, &uniform);
                stats.shadow_triangles += casters.triangles();
                stats.shadow_casters += model.thrown.len() as u64;
            }
        }
        if self.shade.drawn.as_ref() == Some(&now) {
            return Ok(());
        }
        let parts = fit.map_or(0, |fit| fit.parts.len());
        let mut eyes = now.eyes.iter();
        for model in &mut self.models {
            model.pipelines.prepare(&self.gpu, Kind::Cast, 1)?;
            let Model { casters: Some(casters), pipelines, .. } = model else { continue };
            for part in 0..parts {
                eyes.next().inspect(|eye| casters.write(&self.gpu, pipelines, part, eye));
            }
        }
        let Some(map) = &self.shade.map else { return Ok(()) };
        let mut pass = map.begin(encoder);
        for part in 0..parts {
            let [x, y, texels] = place(map.size(), part, parts).map(|x| x as f32);
            pass.set_viewport(x, y, texels, texels, 0.0, 1.0);
            for model in &self.models {
                if let Some(casters) = &model.casters {
                    casters.draw(&self.gpu, &mut pass, (&model.pipelines, &model.arena), part);
                }
            }
        }
        drop(pass);
        stats.shadow_maps += 1;
        self.shade.drawn = Some(now);
        Ok(())
    }

    /// A map of this size, and what models have of it.
    fn room(&mut self, side: u32) -> Result<(), ViewerError> {
        if self.shade.map.as_ref().is_none_or(|map| map.size() != side) {
            let map = self.gpu.attempt("making a map of shadows", || ShadowMap::new(&self.gpu, side))?;
            self.models.iter_mut().for_each(|model| model.casters = None);
            self.shade = Shade { map: Some(map), drawn: None };
        }
        let Some(map) = &self.shade.map else { return Ok(()) };
        for model in &mut self.models {
            if model.casters.is_none() {
                model.casters = Some(Casters::new(&self.gpu, &model.pipelines, map));
            }
        }
        Ok(())
    }

    /// Makes room for the casters of a fit.
    pub(super) fn make_casters(&mut self, fit: &Fit) -> Result<(), ViewerError> {
        self.room(fit.side)
    }
}

impl Model {
    /// Adds what throws shadows and is not in the list.
    pub(super) fn choose_casters(&mut self, plan: Plan, casters: &[Caster], now: u64) {
        self.unlisted.clear();
        let unlisted = casters.iter().filter(|caster| !plan.includes(caster.sight));
        self.unlisted.extend(unlisted.map(|caster| caster.member));
        self.unlisted.iter().for_each(|member| self.arena.touch(member.cluster, now));
    }

    /// Sends the blocks of what throws shadows and is not in the list, as many bytes as a frame may, or one more. Nothing that is drawn goes for
    /// them. Whether all are there that find room.
    pub(super) fn bring_casters(
        &mut self,
        gpu: &Gpu,
        most: Option<u64>,
        now: u64,
    ) -> Result<bool, ViewerError> {
        let mut sent = 0;
        for member in &self.unlisted {
            if self.arena.get(member.cluster).is_some() {
                continue;
            }
            if most.is_some_and(|most| sent > most) {
                return Ok(false);
            }
            let Some((block, turned)) = self.scene.block(member.cluster) else { continue };
            sent += block.bytes().len() as u64;
            if !self.arena.insert(gpu, member.cluster, (&block, turned), now)? {
                // Nor will there be for another one.
                break;
            }
        }
        Ok(true)
    }

    /// Makes the lists of what throws shadows. What the GPU has no room for throws none.
    pub(super) fn cast(&mut self, casters: &[Caster]) {
        let Some(lists) = &mut self.casters else { return };
        self.thrown.clear();
        self.thrown.extend(casters.iter().filter(|it| self.arena.get(it.member.cluster).is_some()));
        // Those of one slab together.
        let slab = |it: &Caster| self.arena.get(it.member.cluster).map_or(0, |resident| resident.slab);
        self.thrown.sort_by_key(slab);
        for part in 0..PARTS {
            let list = lists.list(part);
            list.restart(Kind::Cast);
            for it in self.thrown.iter().filter(|it| it.parts & 1 << part != 0) {
                if let Some(resident) = self.arena.get(it.member.cluster) {
                    list.push(it.member.cluster, resident, Default::default(), true);
                }
            }
        }
    }
}

impl Fit {
    /// As a model has it.
    fn uniform(&self, eye: &CameraUniform) -> ShadowUniform {
        let axes = eye.light_axes();
        let range = (self.depth.high - self.depth.low).max(f64::MIN_POSITIVE);
        let mut uniform = ShadowUniform { count: [self.parts.len() as u32, 0, 0, 0], ..Default::default() };
        for (place_of, part) in self.parts.iter().enumerate() {
            fn row(axis: &Vector3<f64>, scale: f64, shift: f64) -> [f32; 4] {
                let [x, y, z]: [f64; 3] = (axis * scale).into();
                [x, y, z, shift].map(|x| x as f32)
            }
            let [x, y, side] = place(self.side, place_of, self.parts.len()).map(f64::from);
            let half = [0, 1].map(|axis| 0.5 * (part[axis].high - part[axis].low));
            let middle = [0, 1].map(|axis| 0.5 * (part[axis].high + part[axis].low));
            let texel = half.map(|half| 2.0 * half / side);
            uniform.parts[place_of] = PartUniform {
                rows: [
                    row(&axes[0], 1.0 / half[0], -middle[0] / half[0]),
                    row(&axes[1], 1.0 / half[1], -middle[1] / half[1]),
                    row(&axes[2], 1.0 / range, -self.depth.low / range),
                ],
                place: [x + 0.5 * side, y + 0.5 * side, 0.5 * side, 0.5 * side]
                    .map(|x| (x / f64::from(self.side)) as f32),
                texel: [
                    SLOPE * half[0] * texel[0] / range,
                    SLOPE * half[1] * texel[1] / range,
                    ALWAYS * texel[0].max(texel[1]) / range + ROUNDING,
                    1.0 - 2.0 / side,
                ]
                .map(|x| x as f32),
            };
        }
        uniform
    }
}

/// A part of the map across one axis: as large as one of some steps, and on whole texels of the picture's own coordinates, in which the eye
/// is at `eye`.
fn snapped(span: &Span, eye: f64, texels: u32) -> Span {
    let inner = f64::from(texels) - 2.0 * RIM - 1.0;
    let needed =
        (span.high - span.low).max(1e-9 * span.high.abs().max(span.low.abs())).max(f64::MIN_POSITIVE);
    let size = f64::exp2((STEPS * (needed * f64::from(texels) / inner).log2()).ceil() / STEPS);
    let texel = size / f64::from(texels);
    let middle = 0.5 * (span.low + span.high) - 0.5 * size;
    let low = ((middle + eye) / texel).floor() * texel - eye;
    Span { low, high: low + size }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_holds_what_it_shows_and_stays_on_its_texels() {
        let span = Span { low: -1.3, high: 2.1 };
        for eye in [0.0, 0.37, 1e4 + 0.001] {
            let part = snapped(&span, eye, 512);
            let texel = (part.high - part.low) / 512.0;
            assert!(part.low <= span.low - 2.0 * texel && part.high >= span.high + 2.0 * texel, "{part:?}");
            assert!(part.high - part.low < 1.12 * 3.4 * 512.0 / 505.0);
            let place = (part.low + eye) / texel;
            assert!((place - place.round()).abs() < 1e-4, "{place}");
        }
        // A point has a part, too.
        let part = snapped(&Span { low: 3.0, high: 3.0 }, 0.0, 512);
        assert!(part.low < 3.0 && part.high > 3.0);
    }
}
