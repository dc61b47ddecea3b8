//! Triangles a second against a plain draw of the same triangles from one buffer, in turn, and what culling makes of the same view.

use crate::film::{FORMAT, Film, median, ms};
use crate::plain::Plain;
use chpm_refine::{Hierarchy, View, select};
use chpm_viewer::internals::buffers::Canvas;
use chpm_viewer::internals::camera_uniform::CameraUniform;
use chpm_viewer::internals::passes;
use chpm_viewer::{Accuracy, Coloring, FrameRequest, Gpu, Look, Viewer};
use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;
use wgpu::BufferUsages;
use wgpu::util::DeviceExt;

const FRAMES: usize = 25;

pub(crate) fn run(gpu: &Arc<Gpu>, path: &Path) -> Result<(), Box<dyn Error>> {
    let mut film = Film::open(gpu, path)?;
    let look = Look { colors: Coloring::Plain, ..Look::default() };
    println!("width,height,poe,clusters,triangles,one_buffer_ms,clusters_ms,share,culled_clusters,culled_ms");
    for viewport in [[512, 512], [1920, 1080]] {
        for poe in [1.0, 4.0, 16.0, 48.0] {
            let request = FrameRequest {
                accuracy: Accuracy::PoE(poe),
                look,
                ..FrameRequest::new(film.viewer.framing(), viewport)
            };
            let open = request.without_culling();
            film.converge(&open)?;
            let flat = Flat::new(&film.viewer, &request, poe)?;
            let mut pairs = Vec::new();
            let mut last = Default::default();
            for _ in 0..FRAMES {
                let one = flat.draw(gpu)?;
                let shot = film.shoot(&open)?;
                pairs.push((one, shot.ms));
                last = shot.stats;
            }
            assert_eq!(flat.triangles as u64, last.triangles, "the same triangles");
            film.converge(&request)?;
            let culled = film.repeat(&request, FRAMES)?;
            println!(
                "{},{},{poe},{},{},{:.3},{:.3},{:.3},{},{:.3}",
                viewport[0],
                viewport[1],
                last.clusters_active,
                last.triangles,
                median(pairs.iter().map(|(one, _)| *one)),
                median(pairs.iter().map(|(_, clusters)| *clusters)),
                median(pairs.iter().map(|(one, clusters)| one / clusters)),
                culled[FRAMES - 1].stats.clusters_drawn,
                median(culled.iter().map(|shot| shot.ms)),
            );
        }
    }
    Ok(())
}

/// The cut of a view in one buffer of vertices and one of indices.
struct Flat {
    plain: Plain,
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    triangles: usize,
    canvas: Canvas,
    depth: Canvas,
}

impl Flat {
    fn new(viewer: &Viewer, request: &FrameRequest, poe: f64) -> Result<Self, Box<dyn Error>> {
        let (gpu, file) = (viewer.gpu(), viewer.file());
        let camera = request.camera.relative_to(viewer.origin());
        let view = View::new(&camera, request.viewport, poe)?;
        let (mut positions, mut indices) = (Vec::<[f32; 3]>::new(), Vec::<u32>::new());
        let mut triangles = Vec::new();
        for member in select(file, &Hierarchy::new(file), &view)?.members() {
            let (page, first) = (file.page(member.cluster)?, positions.len() as u32);
            let page = page.view();
            triangles.clear();
            page.progressive_mesh().triangles_at(member.vertices as usize, &mut triangles);
            positions.extend_from_slice(&page.positions[..member.vertices as usize]);
            indices.extend(triangles.as_flattened().iter().map(|v| first + u32::from(*v)));
        }
        let buffer = |contents: &[u8], usage| {
            let descriptor = wgpu::util::BufferInitDescriptor { label: None, contents, usage };
            gpu.device.create_buffer_init(&descriptor)
        };
        let plain = Plain::new(gpu);
        let camera_uniform = CameraUniform::new(&camera, request.viewport, &viewer.bounds());
        plain.look_through(gpu, &camera_uniform.uniform([0; 4]));
        Ok(Flat {
            plain,
            vertices: buffer(bytemuck::cast_slice(&positions), BufferUsages::VERTEX),
            indices: buffer(bytemuck::cast_slice(&indices), BufferUsages::INDEX),
            triangles: indices.len() / 3,
            canvas: Canvas::new(gpu, "flat", request.viewport, FORMAT),
            depth: Canvas::new(gpu, "depth", request.viewport, wgpu::TextureFormat::Depth32Float),
        })
    }

    /// Milliseconds until it is drawn.
    fn draw(&self, gpu: &Gpu) -> Result<f64, Box<dyn Error>> {
        let start = Instant::now();
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let (color, clears) = (Some(self.canvas.view()), Some(wgpu::Color::BLACK));
        let mut pass = passes::begin(&mut encoder, color, self.depth.view(), clears);
        self.plain.set(&mut pass, &self.vertices, (&self.indices, wgpu::IndexFormat::Uint32));
        pass.draw_indexed(0..3 * self.triangles as u32, 0, 0..1);
        drop(pass);
        gpu.queue.submit([encoder.finish()]);
        gpu.wait()?;
        Ok(ms(start.elapsed()))
    }
}
