//! What frames cost, part by part, on the adapter that is there: `cargo bench -p chpm-viewer --bench frames [-- FILE.chpm]`.
//!
//! 1. Refinement and occlusion of some 10,000 active clusters, of a made-up file. 2. For a file: frames with and without occlusion
//!    culling, and triangles a second against a plain draw of the same triangles from one buffer. Medians of whole frames, with a wait
//!    for the device after each.

#[path = "../../chpm-refine/examples/front_pass/plane.rs"]
mod plane;

use chpm_mesh::Bytes;
use chpm_refine::{Camera, Hierarchy, View, select};
use chpm_viewer::gpu::Lens;
use chpm_viewer::gpu::buffers::{self, Canvas};
use chpm_viewer::{
    Accuracy, AdapterChoice, Budgets, Coloring, FrameRequest, Gpu, Look, Stats, Target, Viewer, ViewerError,
};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};
use wgpu::util::DeviceExt;

const FRAMES: usize = 15;
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn ms(time: Duration) -> f64 {
    1e3 * time.as_secs_f64()
}

/// Frames of a path, each waited for: their statistics, and whole times in milliseconds.
fn frames(
    viewer: &mut Viewer,
    requests: impl Iterator<Item = FrameRequest>,
) -> Result<(Vec<Stats>, Vec<f64>), ViewerError> {
    let mut canvas = None;
    let (mut all, mut times) = (Vec::new(), Vec::new());
    for request in requests {
        let canvas =
            canvas.get_or_insert_with(|| Canvas::new(viewer.gpu(), "bench", request.viewport, FORMAT));
        let start = Instant::now();
        all.push(viewer.frame(&request, &Target { color: canvas.view(), format: FORMAT })?);
        buffers::wait(viewer.gpu())?;
        times.push(ms(start.elapsed()));
    }
    Ok((all, times))
}

/// Levels come one by one, and answers a frame later: until nothing changes any more.
fn settle(viewer: &mut Viewer, request: &FrameRequest) -> Result<(), ViewerError> {
    let mut calm = 0;
    while calm < 3 {
        let (stats, _) = frames(viewer, std::iter::once(*request))?;
        let moves = stats[0].splits + stats[0].collapses + stats[0].newly_visible + stats[0].withheld;
        calm = if moves == 0 { calm + 1 } else { 0 };
    }
    Ok(())
}

fn many_clusters(gpu: &Arc<Gpu>) -> Result<(), Box<dyn std::error::Error>> {
    let file = plane::file()?;
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("plane.chpm");
    std::fs::write(&path, file.bytes())?;
    let mut viewer = Viewer::open(Arc::clone(gpu), &path, Budgets::default())?;
    // All of the plane is in the image, and nothing hides it.
    let camera = Camera { fov: 90.0, ..Camera::looking([64.0, 0.0, 80.0], [64.0, 60.0, 0.0]) };
    let hierarchy = Hierarchy::new(&file);
    let mut pixels = 1.0;
    let count = |pixels| {
        let view = View::new(&camera, [256, 256], pixels)?;
        select(&file, &hierarchy, &view).map(|cut| cut.members().len())
    };
    while count(pixels)? < 10_000 {
        pixels /= 1.01;
    }
    let request = FrameRequest { accuracy: Accuracy::PoE(pixels), ..FrameRequest::new(camera, [256, 256]) };
    for occlusion_culling in [true, false] {
        let request = FrameRequest { occlusion_culling, ..request };
        settle(&mut viewer, &request)?;
        for moving in [false, true] {
            let step = |frame: usize| {
                let [x, y, z] = camera.position;
                let along = if moving { 0.01 * frame as f64 } else { 0.0 };
                FrameRequest { camera: Camera { position: [x + along, y, z], ..camera }, ..request }
            };
            let (stats, times) = frames(&mut viewer, (0..FRAMES).map(step))?;
            let part = |of: fn(&Stats) -> Duration| median(stats.iter().map(|s| ms(of(s))).collect());
            println!(
                "{} active clusters, {} drawn, occlusion culling {occlusion_culling}, moving {moving}: refine {:.3} ms, occlusion {:.3} ms, draw list {:.3} ms, frame {:.1} ms",
                stats[FRAMES - 1].clusters_active,
                stats[FRAMES - 1].clusters_drawn,
                part(|s| s.times.refine),
                part(|s| s.times.occlusion),
                part(|s| s.times.pm),
                median(times)
            );
        }
    }
    Ok(())
}

const FLAT: &str = "
struct Frame { eye_high: vec4<f32>, eye_low: vec4<f32>, right: vec4<f32>, up: vec4<f32>, forward: vec4<f32>, light: vec4<f32>, size: vec4<f32>, look: vec4<u32> }
@group(0) @binding(0) var<uniform> frame: Frame;
struct Seen { @builtin(position) position: vec4<f32>, @location(0) at: vec3<f32> }
@vertex fn vertex(@location(0) position: vec3<f32>) -> Seen {
    let at = (position - frame.eye_high.xyz) - frame.eye_low.xyz;
    return Seen(vec4(dot(frame.right.xyz, at), dot(frame.up.xyz, at), frame.forward.w, dot(frame.forward.xyz, at)), at);
}
@fragment fn fragment(seen: Seen) -> @location(0) vec4<f32> {
    var normal = normalize(cross(dpdx(seen.at), dpdy(seen.at)));
    normal = select(normal, -normal, dot(normal, seen.at) > 0.0);
    let key = max(dot(normal, frame.light.xyz), 0.0);
    let head = max(-dot(normal, normalize(seen.at)), 0.0);
    return vec4(vec3(0.78, 0.76, 0.72) * (0.16 + 0.54 * key + 0.34 * head), 1.0);
}";

/// Draws the cut of a view from one buffer of vertices and one of indices; answers triangles and median milliseconds.
fn flat(
    viewer: &Viewer,
    request: &FrameRequest,
    poe: f64,
) -> Result<(usize, f64), Box<dyn std::error::Error>> {
    let (gpu, file) = (viewer.gpu(), viewer.file());
    let camera = request.camera.relative_to(viewer.origin());
    let view = View::new(&camera, request.viewport, poe)?;
    let (mut positions, mut indices) = (Vec::<[f32; 3]>::new(), Vec::<u32>::new());
    let mut triangles = Vec::new();
    for member in select(file, &Hierarchy::new(file), &view)?.members() {
        let (page, first) = (file.page(member.cluster)?, positions.len() as u32);
        triangles.clear();
        page.progressive_mesh().triangles_at(member.vertices as usize, &mut triangles);
        positions.extend_from_slice(&page.positions[..member.vertices as usize]);
        indices.extend(triangles.as_flattened().iter().map(|v| first + u32::from(*v)));
    }
    let device = &gpu.device;
    let buffer = |contents: &[u8], usage| {
        device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: None, contents, usage })
    };
    let vertices = buffer(bytemuck::cast_slice(&positions), wgpu::BufferUsages::VERTEX);
    let corners = buffer(bytemuck::cast_slice(&indices), wgpu::BufferUsages::INDEX);
    let lens = Lens::new(&camera, request.viewport, &viewer.bounds()).uniform([0; 4]);
    let uniform = buffer(bytemuck::bytes_of(&lens), wgpu::BufferUsages::UNIFORM);
    let shader = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(FLAT.into()),
    });
    let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: None,
        vertex: wgpu::VertexState {
            module: &shader,
            entry_point: Some("vertex"),
            compilation_options: Default::default(),
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: 12,
                step_mode: wgpu::VertexStepMode::Vertex,
                attributes: &wgpu::vertex_attr_array![0 => Float32x3],
            })],
        },
        primitive: Default::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: wgpu::TextureFormat::Depth32Float,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &shader,
            entry_point: Some("fragment"),
            compilation_options: Default::default(),
            targets: &[Some(FORMAT.into())],
        }),
        multiview_mask: None,
        cache: None,
    });
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[wgpu::BindGroupEntry { binding: 0, resource: uniform.as_entire_binding() }],
    });
    let canvas = Canvas::new(gpu, "flat", request.viewport, FORMAT);
    let mut depth = None;
    let depth = Canvas::fit(&mut depth, gpu, request.viewport);
    let mut times = Vec::new();
    for _ in 0..FRAMES {
        let start = Instant::now();
        let mut encoder = device.create_command_encoder(&Default::default());
        let mut pass = chpm_viewer::gpu::passes::begin(
            &mut encoder,
            Some(canvas.view()),
            depth.view(),
            Some(wgpu::Color::BLACK),
        );
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.set_vertex_buffer(0, vertices.slice(..));
        pass.set_index_buffer(corners.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..indices.len() as u32, 0, 0..1);
        drop(pass);
        gpu.queue.submit([encoder.finish()]);
        buffers::wait(gpu)?;
        times.push(ms(start.elapsed()));
    }
    Ok((indices.len() / 3, median(times)))
}

fn of_file(gpu: &Arc<Gpu>, path: &Path) -> Result<(), Box<dyn std::error::Error>> {
    let budgets = Budgets { memory: Bytes::mib(4096), gpu_memory: Bytes::mib(2048) };
    let mut viewer = Viewer::open(Arc::clone(gpu), path, budgets)?;
    let look = Look { colors: Coloring::Plain, ..Look::default() };
    for (viewport, poe) in [([512, 512], 1.0), ([1920, 1080], 1.0)] {
        let request = FrameRequest {
            accuracy: Accuracy::PoE(poe),
            look,
            ..FrameRequest::new(viewer.framing(), viewport)
        };
        let open = FrameRequest { frustum_culling: false, occlusion_culling: false, ..request };
        settle(&mut viewer, &open)?;
        let (stats, times) = frames(&mut viewer, (0..FRAMES).map(|_| open))?;
        let (triangles, drawn) = flat(&viewer, &request, poe)?;
        assert_eq!(triangles as u64, stats[FRAMES - 1].triangles, "the same triangles");
        let clusters = median(times);
        settle(&mut viewer, &request)?;
        let (stats, times) = frames(&mut viewer, (0..FRAMES).map(|_| request))?;
        let culled = median(times);
        let last = stats[FRAMES - 1];
        println!(
            "{viewport:?}, {poe} pixels of error: {triangles} triangles of {} clusters",
            last.clusters_active
        );
        println!("  one buffer {drawn:.2} ms, clusters {clusters:.2} ms: {:.0} %", 100.0 * drawn / clusters);
        println!(
            "  with culling {culled:.2} ms: {} clusters and {} triangles drawn",
            last.clusters_drawn, last.triangles
        );
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let gpu = Arc::new(Gpu::headless(&AdapterChoice::Best)?);
    println!("{}", gpu.describe());
    many_clusters(&gpu)?;
    // Cargo's own arguments start with dashes.
    for path in std::env::args().skip(1).filter(|arg| !arg.starts_with("--")) {
        of_file(&gpu, path.as_ref())?;
    }
    Ok(())
}
