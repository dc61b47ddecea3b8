//! Boxes against depth: the pyramid in compute beside hardware occlusion queries of the same boxes, in turn. Depth and boxes are those
//! of the clusters of a cut, from cameras around the model and inside it.

use crate::film::{median, ms, processor_ms};
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::Bytes;
use chpm_refine::{Camera, CameraPath, Cut, Hierarchy, Member, View, is_visible, select};
use chpm_viewer::gpu::buffers::{self, Canvas, Growing, buffer, read};
use chpm_viewer::gpu::lens::shader;
use chpm_viewer::gpu::pipelines::{READ, UNIFORM, group, layout};
use chpm_viewer::gpu::{
    Arena, DrawBuffers, DrawList, Kind, Lens, Mark, Occlusion, Pipelines, TestBox, passes,
};
use chpm_viewer::scene::gpu_bytes;
use chpm_viewer::{Block, Gpu};
use std::error::Error;
use std::path::Path;
use std::time::Instant;
use wgpu::{BufferUsages, ShaderStages};

const ROUNDS: usize = 7;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

pub(crate) fn run(gpu: &Gpu, path: &Path) -> Result<()> {
    let file = Chpm::open(MappedFile::open(path)?)?;
    let bounds = file.header().aabb();
    let mut cameras: Vec<Camera> = CameraPath::orbit(&bounds, 4).cameras;
    cameras.extend(CameraPath::random(&bounds, 3, 120).cameras.into_iter().step_by(30));
    println!(
        "width,height,boxes,cameras,pyramid_ms,queries_ms,pyramid_processor_ms,queries_processor_ms,pyramid_visible,queries_visible,seen_by_queries_alone"
    );
    for viewport in [[512, 512], [1920, 1080]] {
        for boxes in [1, 100, 1000, 10_000] {
            println!("{},{},{}", viewport[0], viewport[1], compare(gpu, &file, &cameras, viewport, boxes)?);
        }
    }
    Ok(())
}

/// The coarsest cut of at least so many clusters, or all of the leaves.
fn cut(
    file: &Chpm<MappedFile>,
    hierarchy: &Hierarchy,
    camera: &Camera,
    viewport: [u32; 2],
    clusters: usize,
) -> Result<Cut> {
    let mut pixels = 64.0;
    loop {
        let cut = select(file, hierarchy, &View::new(camera, viewport, pixels)?)?;
        if cut.members().len() >= clusters || pixels == 0.0 {
            return Ok(cut);
        }
        pixels = if pixels < 1e-3 { 0.0 } else { pixels / 1.2 };
    }
}

fn compare(
    gpu: &Gpu,
    file: &Chpm<MappedFile>,
    cameras: &[Camera],
    viewport: [u32; 2],
    wanted: usize,
) -> Result<String> {
    let hierarchy = Hierarchy::new(file);
    let (mut pyramid, mut queries) = (Occlusion::new(gpu), Queries::new(gpu));
    let mut times: [Vec<(f64, f64)>; 2] = Default::default();
    let (mut tested, mut seen, mut alone) = (0, [0_usize; 2], 0_usize);
    for camera in cameras {
        let cut = cut(file, &hierarchy, camera, viewport, wanted)?;
        let lens = Lens::new(camera, viewport, &file.header().aabb());
        let scene = Depth::draw(gpu, file, &cut, &lens)?;
        // What lies outside the image is not asked: the viewer does not, and a rasteriser may err there.
        let view = View::new(camera, viewport, 1.0)?;
        let records = cut.members().iter().map(|member| &file.clusters()[member.cluster.index()]);
        let inside: Vec<_> = records.filter(|record| is_visible(record, &view)).collect();
        let count = wanted.min(inside.len());
        let boxes: Vec<TestBox> = (0..count)
            .map(|n| inside[n * inside.len() / count])
            .map(|record| TestBox::new(record.aabb_min, record.aabb_max, None))
            .collect();
        tested += boxes.len();
        let mut answers = [Vec::new(), Vec::new()];
        for round in 0..ROUNDS {
            for way in [round % 2, (round + 1) % 2] {
                let (start, busy) = (Instant::now(), processor_ms());
                answers[way] = match way {
                    0 => {
                        let mut encoder = gpu.device.create_command_encoder(&Default::default());
                        let arguments = (scene.buffers.arguments(), Kind::Depth.stride());
                        let uniform = scene.buffers.uniform();
                        let asked =
                            pyramid.record(gpu, &mut encoder, &scene.depth, uniform, &boxes, arguments);
                        gpu.queue.submit([encoder.finish()]);
                        pyramid.wait(gpu, asked)?
                    }
                    _ => queries.ask(gpu, &scene, &boxes)?,
                };
                if round > 0 {
                    times[way].push((ms(start.elapsed()), processor_ms() - busy));
                }
            }
        }
        for way in 0..2 {
            seen[way] += answers[way].iter().filter(|seen| **seen).count();
        }
        alone += answers[0].iter().zip(&answers[1]).filter(|(pyramid, query)| !**pyramid && **query).count();
    }
    let share = |seen: usize| seen as f64 / tested as f64;
    let [pyramid, queries] = times;
    Ok(format!(
        "{},{},{:.3},{:.3},{:.3},{:.3},{:.4},{:.4},{alone}",
        tested / cameras.len(),
        cameras.len(),
        median(pyramid.iter().map(|time| time.0)),
        median(queries.iter().map(|time| time.0)),
        median(pyramid.iter().map(|time| time.1)),
        median(queries.iter().map(|time| time.1)),
        share(seen[0]),
        share(seen[1]),
    ))
}

/// The depth of a cut.
struct Depth {
    buffers: DrawBuffers,
    depth: Canvas,
}

impl Depth {
    fn draw(gpu: &Gpu, file: &Chpm<MappedFile>, cut: &Cut, lens: &Lens) -> Result<Self> {
        let mut pipelines = Pipelines::new(gpu, false);
        pipelines.prepare(gpu, Kind::Depth);
        let clusters = file.clusters();
        let largest = clusters.iter().map(|cluster| gpu_bytes(cluster, false)).max().unwrap_or(0);
        let mut arena = Arena::new(gpu, &pipelines, clusters.len(), Bytes::mib(1024), largest);
        let mut list = DrawList::new(Kind::Depth);
        for member in cut.members() {
            let Member { cluster, vertices } = *member;
            let page = file.page(cluster)?;
            arena.insert(gpu, cluster, &Block::of_page(&page), 0)?;
            arena.move_to(gpu, cluster, &page.progressive_mesh(), vertices);
            list.push(cluster, arena.get(cluster).ok_or("no room")?, Mark::default(), true);
        }
        let mut buffers = DrawBuffers::new(gpu, &pipelines);
        buffers.write(gpu, &pipelines, &list, &lens.uniform([0; 4]));
        let depth = Canvas::new(gpu, "depth", lens.viewport(), wgpu::TextureFormat::Depth32Float);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut pass = passes::begin(&mut encoder, None, depth.view(), Some(wgpu::Color::BLACK));
        buffers.draw(gpu, &mut pass, &pipelines, &arena, &list, 0..list.len());
        drop(pass);
        gpu.queue.submit([encoder.finish()]);
        buffers::wait(gpu)?;
        Ok(Depth { buffers, depth })
    }
}

/// Boxes as triangles, each in a query of its own. A box that the near plane cuts is drawn without it, which is as good for times;
/// its answer is visible in any case.
const SHADER: &str = "
struct Box { low: vec3<f32>, draw: u32, high: vec3<f32>, unused: u32 }
@group(0) @binding(1) var<storage, read> boxes: array<Box>;
// Two triangles a side, by the bits of their corners.
const CORNERS = array<u32, 36>(
    0u, 1u, 2u, 1u, 2u, 3u, 4u, 5u, 6u, 5u, 6u, 7u, 0u, 1u, 4u, 1u, 4u, 5u,
    2u, 3u, 6u, 3u, 6u, 7u, 0u, 2u, 4u, 2u, 4u, 6u, 1u, 3u, 5u, 3u, 5u, 7u);
@vertex fn vertex(@builtin(vertex_index) index: u32, @builtin(instance_index) which: u32) -> @builtin(position) vec4<f32> {
    var corners = CORNERS;
    let corner = corners[index];
    let bounds = boxes[which];
    let upper = vec3((corner & 1u) != 0u, (corner & 2u) != 0u, (corner & 4u) != 0u);
    return project(relative(select(bounds.low, bounds.high, upper)));
}";

struct Queries {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::RenderPipeline,
    boxes: Growing,
    /// Each of as many as a set may have.
    sets: Vec<wgpu::QuerySet>,
    counts: Growing,
}

impl Queries {
    const SET: usize = wgpu::QUERY_SET_MAX_QUERIES as usize;

    fn new(gpu: &Gpu) -> Self {
        let device = &gpu.device;
        let stages = ShaderStages::VERTEX;
        let layout = layout(gpu, "boxes", &[(stages, UNIFORM), (stages, READ)]);
        let shader = shader(gpu, SHADER);
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: None,
            layout: Some(&pipeline_layout),
            vertex: wgpu::VertexState {
                module: &shader,
                entry_point: Some("vertex"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: Default::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: wgpu::TextureFormat::Depth32Float,
                depth_write_enabled: Some(false),
                depth_compare: Some(wgpu::CompareFunction::GreaterEqual),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: Default::default(),
            fragment: None,
            multiview_mask: None,
            cache: None,
        });
        Queries {
            layout,
            pipeline,
            boxes: Growing::new(gpu, "boxes", BufferUsages::STORAGE),
            sets: Vec::new(),
            counts: Growing::new(gpu, "counts", BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC),
        }
    }

    fn ask(&mut self, gpu: &Gpu, scene: &Depth, boxes: &[TestBox]) -> Result<Vec<bool>> {
        while self.sets.len() * Self::SET < boxes.len() {
            self.sets.push(gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: None,
                ty: wgpu::QueryType::Occlusion,
                count: Self::SET as u32,
            }));
        }
        let bytes = 8 * boxes.len() as u64;
        self.boxes.write(gpu, bytemuck::cast_slice(boxes));
        self.counts.reserve(gpu, bytes);
        let bound = [scene.buffers.uniform().as_entire_binding(), self.boxes.get().as_entire_binding()];
        let bound = group(gpu, &self.layout, &bound);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        for ((part, boxes), set) in boxes.chunks(Self::SET).enumerate().zip(&self.sets) {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                    view: scene.depth.view(),
                    depth_ops: Some(wgpu::Operations {
                        load: wgpu::LoadOp::Load,
                        store: wgpu::StoreOp::Store,
                    }),
                    stencil_ops: None,
                }),
                occlusion_query_set: Some(set),
                ..Default::default()
            });
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &bound, &[]);
            for query in 0..boxes.len() as u32 {
                let which = (part * Self::SET) as u32 + query;
                pass.begin_occlusion_query(query);
                pass.draw(0..36, which..which + 1);
                pass.end_occlusion_query();
            }
            drop(pass);
            let place = 8 * (part * Self::SET) as u64;
            encoder.resolve_query_set(set, 0..boxes.len() as u32, self.counts.get(), place);
        }
        let staging = buffer(gpu, "answers", bytes, BufferUsages::COPY_DST | BufferUsages::MAP_READ);
        encoder.copy_buffer_to_buffer(self.counts.get(), 0, &staging, 0, bytes);
        gpu.queue.submit([encoder.finish()]);
        let counts = read(gpu, &staging, bytes)?;
        Ok(bytemuck::cast_slice::<u8, u64>(&counts).iter().map(|count| *count != 0).collect())
    }
}
