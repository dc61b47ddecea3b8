//! The window's surface, and the panel painted over the model.

use crate::error::ViewerError;
use crate::gpu::buffers;
use crate::gpu::{AdapterChoice, Gpu, context};
use crate::request::Target;
use crate::window::style;
use egui_wgpu::{Renderer, RendererOptions, ScreenDescriptor};
use std::sync::Arc;
use wgpu::CurrentSurfaceTexture::{Lost, Occluded, Outdated, Suboptimal, Success, Timeout, Validation};
use wgpu::util::TextureBlitter;
use wgpu::wgt::WgpuHasDisplayHandle;
use winit::event::WindowEvent;
use winit::window::Window;

/// A window that can be drawn into.
pub(super) struct Canvas {
    pub(super) window: Arc<Window>,
    pub(super) gpu: Arc<Gpu>,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    painter: Renderer,
    /// Picture of the model, if it has one.
    picture: Option<buffers::Canvas>,
    blitter: TextureBlitter,
    input: egui_winit::State,
    /// How much larger what is painted over the model is than the system says, by the size of the window.
    zoom: f32,
    /// Something painted over the model wants the next frame after so long.
    pub(super) repaint: std::time::Duration,
}

impl Canvas {
    /// Finds an adapter, of those that can show pictures in this window.
    pub(super) fn new(
        window: Arc<Window>,
        display: Box<dyn WgpuHasDisplayHandle>,
        adapter: &AdapterChoice,
    ) -> Result<Self, ViewerError> {
        let instance = Gpu::instance(Some(display));
        let refused = |error: &dyn std::fmt::Display| ViewerError::Window(format!("no surface: {error}"));
        // Where no interface has a driver, not even a surface can be made.
        let surface = instance.create_surface(Arc::clone(&window));
        let surface = surface.map_err(|error| context::none(&error.to_string()))?;
        let gpu = Gpu::for_surface(&instance, &surface, adapter)?;

        let size = window.inner_size();
        let mut config = surface
            .get_default_config(&gpu.adapter, size.width.max(1), size.height.max(1))
            .ok_or_else(|| refused(&"the adapter cannot draw into it"))?;
        // What is written is displayed as it is: the panel mixes its colours that way.
        let formats = surface.get_capabilities(&gpu.adapter).formats;
        let plain = [wgpu::TextureFormat::Bgra8Unorm, wgpu::TextureFormat::Rgba8Unorm];
        config.format = plain.into_iter().find(|f| formats.contains(f)).unwrap_or(config.format);
        config.present_mode = wgpu::PresentMode::AutoVsync;
        // The picture gets there by a copy, where the window takes one.
        config.usage |= surface.get_capabilities(&gpu.adapter).usages & wgpu::TextureUsages::COPY_DST;
        // What a hand does is to be seen in the next frame, not in the one after it.
        config.desired_maximum_frame_latency = 1;
        let (painter, blitter) = gpu.attempt("preparing a window", || {
            surface.configure(&gpu.device, &config);
            // Nothing in the panel is shaded.
            let options = RendererOptions { dithering: false, ..RendererOptions::default() };
            let painter = Renderer::new(&gpu.device, config.format, options);
            (painter, TextureBlitter::new(&gpu.device, config.format))
        })?;

        let longest = gpu.device.limits().max_texture_dimension_2d as usize;
        let context = egui::Context::default();
        style::apply(&context);
        let input = egui_winit::State::new(
            context,
            egui::ViewportId::ROOT,
            &*window,
            Some(window.scale_factor() as f32),
            window.theme(),
            Some(longest),
        );
        let gpu = Arc::new(gpu);
        let repaint = std::time::Duration::MAX;
        Ok(Canvas {
            window,
            gpu,
            surface,
            config,
            painter,
            picture: None,
            blitter,
            input,
            zoom: 1.0,
            repaint,
        })
    }

    /// Width and height of the picture, pixels.
    pub(super) fn size(&self) -> [u32; 2] {
        [self.config.width, self.config.height]
    }

    /// Pixels of a point of what is painted over the model.
    pub(super) fn scale(&self) -> f64 {
        self.window.scale_factor() * f64::from(self.input.egui_ctx().zoom_factor())
    }

    /// Another model is to be drawn, or none: the picture is nobody's.
    pub(super) fn forget(&mut self) {
        self.picture = None;
    }

    /// The window has another size.
    pub(super) fn resize(&mut self, width: u32, height: u32) {
        let longest = self.gpu.device.limits().max_texture_dimension_2d;
        // A window that is hidden has no size; its picture keeps one.
        if width > 0 && height > 0 {
            (self.config.width, self.config.height) = (width.min(longest), height.min(longest));
            self.surface.configure(&self.gpu.device, &self.config);
        }
    }

    /// Hands an event to the layer over the model; returns whether the event is for it alone, and whether it looks different now.
    pub(super) fn hear(&mut self, event: &WindowEvent) -> (bool, bool) {
        let response = self.input.on_window_event(&self.window, event);
        (response.consumed, response.repaint)
    }

    /// Whether somebody types into a field.
    pub(super) fn is_typing(&self) -> bool {
        self.input.egui_ctx().egui_wants_keyboard_input()
    }

    /// Lays out what is painted over the model.
    pub(super) fn lay_out(&mut self, paint: impl FnMut(&egui::Context)) -> egui::FullOutput {
        // Once for each size: who has zoomed by hand keeps that.
        let zoom = style::zoom(self.size().map(|side| f64::from(side) / self.window.scale_factor()));
        if zoom != self.zoom {
            self.zoom = zoom;
            self.input.egui_ctx().set_zoom_factor(zoom);
        }
        let raw = self.input.take_egui_input(&self.window);
        let context = self.input.egui_ctx().clone();
        let mut output = context.run_pass(raw, paint);
        self.input.handle_platform_output(&self.window, std::mem::take(&mut output.platform_output));
        let root = output.viewport_output.get(&egui::ViewportId::ROOT);
        self.repaint = root.map_or(std::time::Duration::MAX, |root| root.repaint_delay);
        output
    }

    /// Draws the model into a picture of its own, shows that, and what is over it. `model` is told whether the picture is still the one that
    /// it drew last. Answers what it did; `None` if the window cannot be drawn into now.
    pub(super) fn show<T>(
        &mut self,
        mut over: egui::FullOutput,
        model: impl FnOnce(&Target<'_>, bool) -> Result<T, ViewerError>,
    ) -> Result<Option<T>, ViewerError> {
        let Gpu { device, queue, .. } = &*self.gpu;
        // They have to be taken in whether the frame is shown or not.
        for (id, deltas) in over.textures_delta.set.drain() {
            for delta in deltas {
                self.painter.update_texture(device, queue, id, &delta);
            }
        }
        let gone: Vec<egui::TextureId> = over.textures_delta.free.drain().collect();

        let done = match self.acquire()? {
            None => None,
            Some(texture) => {
                let view = texture.texture.create_view(&wgpu::TextureViewDescriptor::default());
                let (size, format) = (self.size(), self.config.format);
                let kept = self.picture.take().filter(|picture| picture.size() == size);
                let is_kept = kept.is_some();
                let picture =
                    kept.unwrap_or_else(|| buffers::Canvas::new(&self.gpu, "picture", size, format));
                let done = model(&Target { color: picture.view(), format }, is_kept)?;
                self.paint(&over, &picture, &texture.texture, &view);
                self.picture = Some(picture);
                self.window.pre_present_notify();
                self.gpu.queue.present(texture);
                Some(done)
            }
        };

        gone.iter().for_each(|id| self.painter.free_texture(id));
        self.gpu.check("showing a frame")?;
        Ok(done)
    }

    fn acquire(&self) -> Result<Option<wgpu::SurfaceTexture>, ViewerError> {
        match self.surface.get_current_texture() {
            Success(texture) | Suboptimal(texture) => return Ok(Some(texture)),
            Timeout | Occluded => return Ok(None),
            Outdated | Lost => self.surface.configure(&self.gpu.device, &self.config),
            Validation => {}
        }
        match self.surface.get_current_texture() {
            Success(texture) | Suboptimal(texture) => Ok(Some(texture)),
            Timeout | Occluded | Outdated => Ok(None),
            refused @ (Lost | Validation) => {
                Err(ViewerError::Window(format!("its surface is lost: {refused:?}; open it anew")))
            }
        }
    }

    fn paint(
        &mut self,
        over: &egui::FullOutput,
        picture: &buffers::Canvas,
        texture: &wgpu::Texture,
        view: &wgpu::TextureView,
    ) {
        let Gpu { device, queue, .. } = &*self.gpu;
        let scale = over.pixels_per_point;
        let screen = ScreenDescriptor {
            size_in_pixels: [self.config.width, self.config.height],
            pixels_per_point: scale,
        };
        let jobs = self.input.egui_ctx().tessellate(over.shapes.clone(), scale);
        let mut encoder =
            device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("over the model") });
        match texture.usage().contains(wgpu::TextureUsages::COPY_DST) {
            true => picture.copy(&mut encoder, texture),
            false => self.blitter.copy(device, &mut encoder, picture.view(), view),
        }

        let mut orders = self.painter.update_buffers(device, queue, &mut encoder, &jobs, &screen);
        let pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("over the model"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store },
            })],
            ..Default::default()
        });
        // The painter wants one that outlives its encoder's borrow.
        let mut pass = pass.forget_lifetime();
        self.painter.render(&mut pass, &jobs, &screen);
        drop(pass);
        orders.push(encoder.finish());
        queue.submit(orders);
    }
}

/// A picture of nothing.
pub(super) fn clear(gpu: &Gpu, view: &wgpu::TextureView) {
    let [r, g, b] = crate::request::Look::default().background.map(f64::from);
    let load = wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a: 1.0 });
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    drop(encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("no model"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
        })],
        ..Default::default()
    }));
    gpu.queue.submit([encoder.finish()]);
}
