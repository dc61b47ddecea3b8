//! From clusters to draws: what is sent to the GPU, what colour it has, and the final picture of a frame that waits.

use super::model::Model;
use super::shade::Fit;
use super::{Canvas, Instant, Viewer, Watch, passes};
use crate::error::ViewerError;
use crate::frame::samples::{Mean, shifts};
use crate::frame::smooth::Picture;
use crate::gpu::arena::Resident;
use crate::gpu::lighting::Lighting;
use crate::gpu::{CameraUniform, Gpu, Kind, Mark};
use crate::headless::{IdImage, Image, TriangleId};
use crate::request::{Coloring, FrameRequest, Look, Shading, Target};
use crate::scene::visibility::Sight;
use crate::stats::Stats;
use chpm_mesh::{ClusterId, viridis};
use chpm_refine::Member;
use wgpu::TextureFormat;

/// How draws look.
#[derive(Clone, Copy, Debug)]
pub(super) struct Colors {
    look: Look,
    kind: Kind,
    has_colors: bool,
    /// It is not the first of its picture.
    is_other: bool,
}

/// Colour of a model that is not the first.
const OTHER: [u8; 3] = [150, 180, 208];

impl Colors {
    /// For a look, a file that may have colours and sheets, and the format of what is drawn into.
    pub(super) fn new(look: &Look, (has_colors, has_sheets): (bool, bool), format: TextureFormat) -> Self {
        let painted = look.colors == Coloring::Vertex && has_sheets;
        let by_vertex = look.shading == Shading::Smooth || look.colors == Coloring::Vertex && has_colors;
        let kind = match (look.wireframe || look.colors == Coloring::Ids, by_vertex) {
            (true, _) => Kind::Wired(format),
            (false, _) if painted => Kind::Painted(format),
            (false, true) => Kind::Colored(format),
            (false, false) => Kind::Bare(format),
        };
        Colors { look: *look, kind, has_colors, is_other: false }
    }

    /// The same for a model that is not the first, which is to be told from it.
    pub(super) fn of_other(self, is_other: bool) -> Self {
        Colors { is_other, ..self }
    }

    /// Depth alone.
    pub(super) fn depth() -> Self {
        Colors { look: Look::default(), kind: Kind::Depth, has_colors: false, is_other: false }
    }

    fn ids() -> Self {
        Colors { kind: Kind::Identified, ..Colors::depth() }
    }

    pub(super) fn has_shadows(&self) -> bool {
        self.look.shadows && self.kind.is_lit()
    }

    pub(super) fn kind(&self) -> Kind {
        self.kind
    }

    /// As the shader has it.
    pub(super) fn uniform(&self) -> [u32; 4] {
        let colors = match self.look.colors {
            Coloring::Vertex if self.has_colors => 1,
            Coloring::Plain | Coloring::Vertex if self.is_other => 2,
            Coloring::Plain | Coloring::Vertex => 0,
            Coloring::Ids => 3,
            _ => 2,
        };
        let smooth = self.look.shading == Shading::Smooth;
        [u32::from(smooth), colors, u32::from(self.look.wireframe), u32::from(self.look.studio)]
    }

    pub(super) fn background(&self) -> wgpu::Color {
        if self.kind == Kind::Identified || self.look.transparent {
            return wgpu::Color::TRANSPARENT;
        }
        let [r, g, b] = self.look.background.map(|c| {
            let c = f64::from(c.clamp(0.0, 1.0));
            let linear = if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) };
            if self.kind.is_linear() { linear } else { c }
        });
        wgpu::Color { r, g, b, a: 1.0 }
    }
}

/// Which clusters of the cut are in a draw list, and in what order.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Plan {
    /// Those that are visible, by slab.
    Visible,
    /// The same, and behind them the hidden ones, which a test may show.
    HiddenToo,
    /// Those that are visible, by id: which one of two equal depths wins must not depend on what was before.
    VisibleById,
    /// All, shown in any case.
    Everything,
}

impl Plan {
    pub(super) fn includes(self, sight: Sight) -> bool {
        match self {
            Plan::Visible | Plan::VisibleById => sight == Sight::Visible,
            Plan::HiddenToo => sight != Sight::Outside,
            Plan::Everything => true,
        }
    }

    pub(super) fn shows(self, sight: Sight) -> bool {
        sight == Sight::Visible || self == Plan::Everything
    }

    fn is_by_id(self) -> bool {
        matches!(self, Plan::VisibleById | Plan::Everything)
    }
}

/// A cluster on its way into a draw list.
#[derive(Clone, Copy, Debug)]
pub(super) struct Item {
    /// In the list.
    place: u64,
    member: Member,
    sight: Sight,
}

/// A colour for a number, different from those of its neighbours.
fn distinct(number: u32) -> [u8; 3] {
    // The golden section of the circle of hues.
    let hue = (f64::from(number) * 0.618_033_988_749_895).fract();
    let value = 0.75 + 0.25 * f64::from(number.wrapping_mul(0x9e37_79b9) >> 24) / 255.0;
    hsv(hue, 0.55, value)
}

fn hsv(hue: f64, saturation: f64, value: f64) -> [u8; 3] {
    [5.0, 3.0, 1.0].map(|shift| {
        let k = (shift + 6.0 * hue) % 6.0;
        let share = k.min(4.0 - k).clamp(0.0, 1.0);
        (255.0 * value * (1.0 - saturation * share)).round() as u8
    })
}

/// The least and the most of some numbers.
fn span(values: impl Iterator<Item = f32>) -> Option<[f32; 2]> {
    values.fold(None, |span, value| match span {
        None => Some([value; 2]),
        Some([least, most]) => Some([f32::min(least, value), f32::max(most, value)]),
    })
}

/// Where between the ends of a scale a number is.
fn share(value: f32, [least, most]: [f32; 2]) -> f64 {
    let width = f64::from(most) - f64::from(least);
    if width > 0.0 { (f64::from(value) - f64::from(least)) / width } else { 0.0 }
}

impl Model {
    /// Value of a cluster on a scale of colours.
    fn measure(&self, coloring: Coloring, member: Member) -> Option<f32> {
        match coloring {
            Coloring::Level => Some(self.scene.file().clusters()[member.cluster.index()].level as f32),
            Coloring::Error => {
                let page = self.scene.page(member.cluster)?;
                Some(page.page().error_at(member.vertices as usize))
            }
            _ => None,
        }
    }

    fn tint(&self, colors: &Colors, item: &Item, scale: [f32; 2], now: u64) -> [u8; 3] {
        let (Item { member, sight, .. }, coloring) = (*item, colors.look.colors);
        // Those that no cluster gives its colour to need no record.
        let record = match coloring {
            Coloring::Plain | Coloring::Vertex if colors.is_other => return OTHER,
            Coloring::Plain | Coloring::Vertex | Coloring::Ids => return [255; 3],
            _ => &self.scene.file().clusters()[member.cluster.index()],
        };

        match coloring {
            Coloring::Plain | Coloring::Vertex | Coloring::Ids => [255; 3],
            Coloring::Cluster => distinct(member.cluster.0),
            Coloring::Group => distinct(record.group),
            Coloring::Level | Coloring::Error => {
                let value = self.measure(coloring, member).unwrap_or(scale[0]);
                viridis(share(value, scale))
            }
            Coloring::Residency => {
                let since = self.arena.get(member.cluster).map_or(0, |resident| resident.since());
                viridis(1.0 - (now - since) as f64 / 120.0).map(|c| c / 2 + 100)
            }
            Coloring::Visibility => match sight {
                Sight::Visible => [90, 200, 110],
                Sight::Hidden => [230, 80, 60],
                Sight::Outside => [80, 120, 230],
            },
        }
    }

    /// Chooses the part of a plan that is drawn. All of it is kept from here on, whatever has to make room.
    fn choose(&mut self, plan: Plan, now: u64) {
        let items = self.scene.members().filter(|(_, sight)| plan.includes(*sight));
        self.items.clear();
        self.items.extend(items.map(|(member, sight)| Item { place: 0, member, sight }));
        for item in &self.items {
            self.arena.touch(item.member.cluster, now);
            if let Some(sheets) = &mut self.sheets {
                sheets.touch(item.member.cluster, now);
            }
        }
    }

    /// Sees to it that the GPU has all that was chosen.
    fn bring(&mut self, gpu: &Gpu, now: u64) -> Result<(), ViewerError> {
        if !self.upload(gpu, now)? {
            // The free places are too scattered: all anew, without gaps.
            self.arena.clear();
            self.upload(gpu, now)?;
        }
        Ok(())
    }

    /// Sends what the GPU lacks; `false` if it does not fit.
    fn upload(&mut self, gpu: &Gpu, now: u64) -> Result<bool, ViewerError> {
        let mut all = true;
        for Item { member: Member { cluster, .. }, .. } in &self.items {
            let cluster = *cluster;
            if self.arena.get(cluster).is_some() {
                continue;
            }
            let Some((block, turned)) = self.scene.block(cluster) else { continue };
            all &= self.arena.insert(gpu, cluster, (&block, turned), now)?;
        }
        Ok(all)
    }

    /// Sends the sheets that are to be drawn and that the GPU lacks, as far as there is room.
    fn send_sheets(&mut self, gpu: &Gpu, now: u64) -> Result<(), ViewerError> {
        let Some(sheets) = &mut self.sheets else { return Ok(()) };
        let file = self.scene.file();
        for Item { member: Member { cluster, .. }, sight, .. } in &self.items {
            let record = &file.sheets()[cluster.index()];
            let Some(is_painted) = self.arena.get(*cluster).map(Resident::is_painted) else { continue };
            let mut placed = sheets.get(*cluster);
            let Some(page) = self.scene.page(*cluster) else { continue };
            let is_new = placed.is_none() && *sight == Sight::Visible && page.may_have_texels();
            if is_new && sheets.place(gpu, *cluster, record, now)? {
                match page.texels() {
                    Some(texels) => sheets.write(gpu, *cluster, &texels),
                    None => sheets.give_up(*cluster),
                }
                placed = sheets.get(*cluster);
            }
            // The sheet has another place, or the block is new.
            if let (Some(placed), Some(layout)) = (placed, page.layout_of_sheet())
                && (is_new || !is_painted)
            {
                self.arena.paint(gpu, *cluster, &placed.words(layout, record, sheets.side()));
            }
        }
        Ok(())
    }

    /// Sends the triangles of positions that have moved, and puts what was chosen in order.
    fn arrange(&mut self, gpu: &Gpu, plan: Plan) {
        let listed = self.items.iter().map(|item| item.member);
        for Member { cluster, vertices } in listed.chain(self.unlisted.iter().copied()) {
            // A border inside a group comes with the whole group, and only then is all of what is about them there.
            if self.arena.get(cluster).is_some_and(|resident| vertices > resident.turned())
                && let Some((block, turned)) = self.scene.block(cluster)
            {
                self.arena.turn(gpu, cluster, (&block, turned));
            }
            if self.arena.get(cluster).is_none_or(|resident| resident.position().vertices != vertices)
                && let Some(page) = self.scene.page(cluster)
            {
                let chart_of = page.layout_of_sheet().map(|layout| &*layout.chart_of);
                self.arena.move_to(gpu, cluster, (&page.page().progressive_mesh(), chart_of), vertices);
            }
        }

        // Those that are shown in any case first; then by slab, or by id where the order decides what is seen.
        for item in &mut self.items {
            let cluster = item.member.cluster;
            let place = match plan.is_by_id() {
                true => u64::from(cluster.0),
                false => self.arena.get(cluster).map_or(0, |resident| resident.slab as u64),
            };
            item.place = u64::from(!plan.shows(item.sight)) << 32 | place;
        }
        self.items.sort_unstable_by_key(|item| item.place);
    }

    /// The least and the most of what a scale of colours shows.
    fn span(&self, coloring: Coloring) -> Option<[f32; 2]> {
        let seen = self.items.iter().filter(|item| item.sight == Sight::Visible);
        span(seen.filter_map(|item| self.measure(coloring, item.member)))
    }

    /// Makes the draw list.
    fn enlist(&mut self, colors: &Colors, plan: Plan, scale: [f32; 2], now: u64) {
        let (mut list, items) = (std::mem::take(&mut self.list), std::mem::take(&mut self.items));
        let coloring = colors.look.colors;
        list.restart(colors.kind);
        self.unpainted = 0;
        let mut count = 0;
        for item in &items {
            // What is not there for want of room, in spite of all, is not drawn.
            let cluster = item.member.cluster;
            let Some(resident) = self.arena.get(cluster) else { continue };
            let key = self.keys.get(cluster.index()).copied().unwrap_or(0);
            let shown = plan.shows(item.sight);
            let mut tint = self.tint(colors, item, scale, now);
            if !shown && coloring == Coloring::Visibility {
                // It is drawn only if it comes into sight.
                tint = [240, 210, 70];
            }
            let mut mark = Mark::tinted(key, tint);
            if let Kind::Painted(_) = colors.kind {
                let sheet = self.sheets.as_ref().and_then(|sheets| sheets.get(cluster)).zip(resident.sheet());
                let painted = sheet.map(|(placed, words)| Mark::painted(placed.texture, words));
                mark = painted.unwrap_or_default();
                self.unpainted += u64::from(shown && painted.is_none());
            }
            list.push(cluster, resident, mark, shown);
            count += usize::from(shown);
        }
        (self.list, self.items, self.shown) = (list, items, count);
    }
}

impl Viewer {
    /// Makes the draw lists of a plan and those of the shadows that are thrown on it, and sees to it that the GPU has all of them, of what throws
    /// shadows beside the list at most so many bytes more.
    pub(super) fn gather(
        &mut self,
        colors: &[Colors],
        plan: Plan,
        (fit, most): (Option<&Fit>, Option<u64>),
        stats: &mut Stats,
    ) -> Result<(), ViewerError> {
        let mut watch = Watch::start();
        self.now += 1;
        let now = self.now;
        for (place, model) in self.models.iter_mut().enumerate() {
            model.choose(plan, now);
            model.choose_casters(plan, fit.map_or(&[], |fit| &fit.casters[place]), now);
        }
        stats.times.pm += watch.lap();

        for (model, colors) in self.models.iter_mut().zip(colors) {
            model.bring(&self.gpu, now)?;
            if let Kind::Painted(_) = colors.kind {
                model.send_sheets(&self.gpu, now)?;
            }
            stats.shadows_withheld |= !model.bring_casters(&self.gpu, most, now)?;
        }
        stats.times.upload += watch.lap();

        // One scale for all models.
        self.models.iter_mut().for_each(|model| model.arrange(&self.gpu, plan));
        let spans = self.models.iter().zip(colors).map(|(model, colors)| model.span(colors.look.colors));
        stats.scale = span(spans.flatten().flatten());
        for (model, colors) in self.models.iter_mut().zip(colors) {
            model.enlist(colors, plan, stats.scale.unwrap_or_default(), now);
        }
        if let Some(fit) = fit {
            self.make_casters(fit)?;
            self.models.iter_mut().zip(&fit.casters).for_each(|(model, casters)| model.cast(casters));
        }
        stats.times.pm += watch.lap();
        Ok(())
    }

    /// Draws all that is visible, at once, moved by a part of a pixel.
    pub(super) fn paint(
        &mut self,
        request: &FrameRequest,
        color: Option<&wgpu::TextureView>,
        colors: &[Colors],
        shift: [f64; 2],
        stats: &mut Stats,
    ) -> Result<(), ViewerError> {
        let look = colors[0];
        let sampled = self.is_sampled(request, look.kind);
        let first = self.prepare(colors, sampled)?;

        // A frozen selection is shown with all that it leaves out.
        let all = request.select_from.is_some() && look.look.colors == Coloring::Visibility;
        let plan = if all { Plan::Everything } else { Plan::VisibleById };
        let camera_uniform = self.camera_uniform(&request.camera, request);
        let eyes = self.eyes(&request.camera, request, stats.poe)?;
        let seen: Vec<_> = eyes.iter().map(|eye| &eye.camera_uniform).collect();
        let fit = if look.has_shadows() { self.fit(&seen, plan) } else { None };
        self.gather(colors, plan, (fit.as_ref(), None), stats)?;

        let start = Instant::now();
        for ((model, eye), colors) in self.models.iter_mut().zip(&eyes).zip(colors) {
            model.write(&self.gpu, &eye.camera_uniform.shifted(shift).uniform(colors.uniform()));
        }
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        if look.has_shadows() {
            self.shade(&mut encoder, &seen, fit.as_ref(), stats)?;
        }
        let depth = Canvas::fit(&mut self.depth, &self.gpu, request.viewport);
        let once = color.filter(|_| first[0] != Kind::Depth);
        let mut pass = passes::begin(&mut encoder, once, depth.view(), Some(look.background()));
        for (model, first) in self.models.iter().zip(&first) {
            model.draw(&self.gpu, &mut pass, (*first, 1), 0..model.shown);
        }
        drop(pass);
        if let (Some(view), true) = (color, sampled) {
            let picture = Picture { view, size: request.viewport, background: look.background() };
            self.smooth(&mut encoder, picture, |model| model.shown)?;
        }
        if let Some(color) = color {
            self.darken(&mut encoder, color, &look, &camera_uniform.shifted(shift))?;
        }
        self.gpu.queue.submit([encoder.finish()]);
        if request.wait {
            self.gpu.wait()?;
        }
        stats.times.draw += start.elapsed();

        stats.triangles = self.models.iter().map(|model| model.list.triangles()).sum();
        stats.clusters_drawn = self.models.iter().map(|model| model.shown as u64).sum();
        self.count(stats);
        self.camera_uniform = Some(camera_uniform);
        Ok(())
    }

    /// Takes light from corners, where the look wants that.
    pub(super) fn darken(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        color: &wgpu::TextureView,
        look: &Colors,
        camera_uniform: &CameraUniform,
    ) -> Result<(), ViewerError> {
        let is_darker = look.kind.is_lit() && (look.look.studio || look.look.occlusion);
        let Some(format) = look.kind.format().filter(|_| is_darker) else { return Ok(()) };
        if self.lighting.as_ref().is_none_or(|lighting| lighting.format() != format) {
            let lighting = self.gpu.attempt("preparing the lighting", || Lighting::new(&self.gpu, format))?;
            self.lighting = Some(lighting);
        }
        if let (Some(lighting), Some(depth)) = (&self.lighting, &self.depth) {
            lighting.record(&self.gpu, encoder, color, depth, &camera_uniform.uniform(look.uniform()));
        }
        Ok(())
    }

    pub(crate) fn image(&mut self, request: &FrameRequest) -> Result<(Image, Stats), ViewerError> {
        self.check_size(request.viewport)?;
        let format = TextureFormat::Rgba8Unorm;
        let canvas = match self.canvas.take() {
            Some(canvas) if canvas.size() == request.viewport => canvas,
            _ => self.canvas_of(request, "image", format)?,
        };
        let target = Target { color: canvas.view(), format };
        let mut stats = self.frame(request, &target)?;
        let mut mean = Mean::default();
        mean.add(&canvas.read(&self.gpu)?);

        // The selection is settled; only the place of the image within a pixel changes.
        let start = Instant::now();
        let samples = if request.wait { request.samples.max(1) } else { 1 };
        for shift in shifts(samples).skip(1) {
            let colors = self.colors(request, &target);
            let mut again = Stats { poe: stats.poe, ..Stats::default() };
            self.paint(request, Some(target.color), &colors, shift, &mut again)?;
            mean.add(&canvas.read(&self.gpu)?);
        }
        self.gpu.check("drawing")?;
        stats.times.total += start.elapsed();
        self.canvas = Some(canvas);
        let pixels = mean.pixels(request.look.transparent);
        Ok((Image { size: request.viewport, pixels }, stats))
    }

    fn canvas_of(
        &self,
        request: &FrameRequest,
        label: &str,
        format: TextureFormat,
    ) -> Result<Canvas, ViewerError> {
        self.gpu.attempt("making an image", || Canvas::new(&self.gpu, label, request.viewport, format))
    }

    /// The position of a cluster of a model's cut, and its error.
    pub(crate) fn drawn(&self, model: usize, cluster: ClusterId) -> Option<(Member, f32)> {
        let model = self.models.get(model)?;
        let (member, _) = model.scene.members().find(|(member, _)| member.cluster == cluster)?;
        Some((member, model.measure(Coloring::Error, member)?))
    }

    pub(crate) fn ids(&mut self, request: &FrameRequest) -> Result<(IdImage, Stats), ViewerError> {
        let start = Instant::now();
        // Nothing of light is seen.
        let request = &FrameRequest { look: Look { shadows: false, ..request.look }, ..*request };
        self.check_size(request.viewport)?;
        self.number_triangles()?;
        self.set_ways(&request.look, request.clip.is_some());
        self.models.iter_mut().for_each(|model| model.pipelines.one_sided = false);
        let canvas = self.canvas_of(request, "ids", crate::gpu::pipelines::IDS)?;
        self.drawn = None;
        let mut stats = self.converge(request)?;
        let colors = vec![Colors::ids(); self.models.len()];
        self.paint(request, Some(canvas.view()), &colors, [0.0; 2], &mut stats)?;
        let bytes = canvas.read(&self.gpu)?;
        let mut places: Vec<Vec<Option<Vec<u32>>>> =
            self.models.iter().map(|model| vec![None; model.keys.len()]).collect();
        let mut pixels = Vec::with_capacity(bytes.len() / 4);
        for key in bytemuck::cast_slice::<u8, u32>(&bytes) {
            pixels.push((*key > 0).then(|| self.triangle(*key, &mut places)));
        }
        stats.times.total = start.elapsed();
        Ok((IdImage { size: request.viewport, pixels }, stats))
    }

    /// Gives every triangle of every cluster of every model a number from 1.
    fn number_triangles(&mut self) -> Result<(), ViewerError> {
        let mut next = 1_u64;
        for model in &mut self.models {
            let clusters = model.scene.file().clusters();
            let mut keys = Vec::with_capacity(clusters.len());
            for cluster in clusters {
                keys.push(next as u32);
                next += u64::from(cluster.triangle_count);
            }
            model.keys = keys;
        }
        if next > u64::from(u32::MAX) {
            self.models.iter_mut().for_each(|model| model.keys.clear());
            return Err(ViewerError::TooManyIds { got: next - 1 });
        }
        Ok(())
    }

    /// The triangle of a key: keys count the triangles of a position, ids all of the page.
    fn triangle(&self, key: u32, places: &mut [Vec<Option<Vec<u32>>>]) -> TriangleId {
        fn first(model: &Model) -> u32 {
            model.keys.first().copied().unwrap_or(u32::MAX)
        }
        let place = self.models.partition_point(|model| first(model) <= key) - 1;
        let model = &self.models[place];
        let index = model.keys.partition_point(|first| *first <= key) - 1;
        let cluster = ClusterId(index as u32);
        let drawn = places[place][index].get_or_insert_with(|| model.places(cluster));
        let count = key - model.keys[index];
        let triangle = drawn.get(count as usize).copied().unwrap_or(count);
        TriangleId { model: place as u32, cluster, triangle }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_go_from_the_least_to_the_most_that_is_shown() {
        assert_eq!(span([].into_iter()), None);
        let scale = span([3.0, 1.0, 2.0].into_iter()).unwrap();
        assert_eq!((scale, [1.0, 2.0, 3.0].map(|value| share(value, scale))), ([1.0, 3.0], [0.0, 0.5, 1.0]));
        assert_eq!(share(5.0, [5.0, 5.0]), 0.0);
    }

    #[test]
    fn hues_go_round() {
        assert_eq!(hsv(0.0, 1.0, 1.0), [255, 0, 0]);
        assert_eq!(hsv(1.0 / 3.0, 1.0, 1.0), [0, 255, 0]);
        assert_eq!(hsv(2.0 / 3.0, 1.0, 1.0), [0, 0, 255]);
    }
}
