//! Triangles of a position: followed along the collapses by the vertex shader, as the viewer does it, beside an index range for each
//! cluster that is made on the processor and sent when the position changes. A moving path, all clusters of the cut drawn, each frame
//! both ways in turn; the vertices of the second way are on the GPU beforehand, all of them.

use crate::film::{FORMAT, mean, median, ms};
use crate::plain::Plain;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_refine::{ActiveList, Camera, CameraPath, Hierarchy, Member, PmCursor, View};
use chpm_viewer::gpu::buffers::{self, Canvas, Growing, buffer};
use chpm_viewer::gpu::{Arena, DrawBuffers, DrawList, Kind, Lens, Mark, Pipelines, passes};
use chpm_viewer::scene::gpu_bytes;
use chpm_viewer::{Block, Gpu};
use std::error::Error;
use std::path::Path;
use std::time::Instant;
use wgpu::BufferUsages;

const FRAMES: usize = 100;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// What one way took for a frame.
#[derive(Clone, Copy, Debug, Default)]
struct Cost {
    /// Until draws and data are handed to the queue.
    make_ms: f64,
    whole_ms: f64,
    bytes: u64,
}

pub(crate) fn run(gpu: &Gpu, path: &Path) -> Result<()> {
    let file = Chpm::open(MappedFile::open(path)?)?;
    println!(
        "path,width,height,poe,frames,clusters,triangles,moved,following_bytes,ranges_bytes,following_make_ms,ranges_make_ms,following_ms,ranges_ms,ratio,following_longest_ms,ranges_longest_ms"
    );
    let bounds = file.header().aabb();
    let root = file.page(file.roots().next().ok_or("no root")?)?;
    let point = root.positions[0].map(f64::from);
    let paths = [
        ("orbit", CameraPath::orbit(&bounds, 4 * FRAMES)),
        ("dive", CameraPath::dive(&bounds, point, FRAMES)),
    ];
    for (name, path) in paths {
        for (viewport, poe) in [([512, 512], 1.0), ([512, 512], 4.0), ([1920, 1080], 4.0)] {
            let row = compare(gpu, &file, &path.cameras[..FRAMES], viewport, poe)?;
            println!("{name},{},{},{poe},{FRAMES},{row}", viewport[0], viewport[1]);
        }
    }
    Ok(())
}

fn compare(
    gpu: &Gpu,
    file: &Chpm<MappedFile>,
    cameras: &[Camera],
    viewport: [u32; 2],
    poe: f64,
) -> Result<String> {
    let hierarchy = Hierarchy::new(file);
    let mut list = ActiveList::new(file);
    let (mut following, mut ranges) = (Following::new(gpu, file), Ranges::new(gpu, file)?);
    let canvas = Canvas::new(gpu, "ranges", viewport, FORMAT);
    let depth = Canvas::new(gpu, "depth", viewport, wgpu::TextureFormat::Depth32Float);
    let (mut costs, mut counts) = ([Vec::new(), Vec::new()], Vec::new());
    for (frame, camera) in cameras.iter().enumerate() {
        let view = View::new(camera, viewport, poe)?;
        list.update(file, &hierarchy, &view, |_| true)?;
        let members: Vec<Member> = list.members().collect();
        let lens = Lens::new(camera, viewport, &file.header().aabb());
        for way in [frame % 2, (frame + 1) % 2] {
            let start = Instant::now();
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            let (color, clears) = (Some(canvas.view()), Some(wgpu::Color::BLACK));
            let pass = passes::begin(&mut encoder, color, depth.view(), clears);
            let bytes = match way {
                0 => following.draw(gpu, file, &members, &lens, pass)?,
                _ => ranges.draw(gpu, file, &members, &lens, pass)?,
            };
            let make_ms = ms(start.elapsed());
            gpu.queue.submit([encoder.finish()]);
            buffers::wait(gpu)?;
            costs[way].push(Cost { make_ms, whole_ms: ms(start.elapsed()), bytes });
        }
        counts.push((members.len(), ranges.triangles, ranges.moved));
    }
    // The first frame has everything to send.
    let [following, ranges] = costs.map(|mut costs| costs.split_off(1));
    let counts = &counts[1..];
    let means = |of: fn(&Cost) -> f64| [&following, &ranges].map(|costs| mean(costs.iter().map(of)));
    let [bytes, make, whole] =
        [means(|cost| cost.bytes as f64), means(|cost| cost.make_ms), means(|cost| cost.whole_ms)];
    let pairs = ranges.iter().zip(&following).map(|(ranges, following)| ranges.whole_ms / following.whole_ms);
    let longest = |costs: &[Cost]| costs.iter().map(|cost| cost.whole_ms).fold(0.0, f64::max);
    Ok(format!(
        "{:.0},{:.0},{:.1},{:.0},{:.0},{:.3},{:.3},{:.3},{:.3},{:.3},{:.2},{:.2}",
        mean(counts.iter().map(|count| count.0 as f64)),
        mean(counts.iter().map(|count| count.1 as f64)),
        mean(counts.iter().map(|count| count.2 as f64)),
        bytes[0],
        bytes[1],
        make[0],
        make[1],
        whole[0],
        whole[1],
        median(pairs),
        longest(&following),
        longest(&ranges),
    ))
}

/// The viewer's way.
struct Following {
    pipelines: Pipelines,
    arena: Arena,
    buffers: DrawBuffers,
    list: DrawList,
    frame: u64,
}

impl Following {
    fn new(gpu: &Gpu, file: &Chpm<MappedFile>) -> Self {
        let mut pipelines = Pipelines::new(gpu);
        let kind = Kind::Bare(FORMAT);
        pipelines.prepare(gpu, kind);
        let clusters = file.clusters();
        let largest = clusters.iter().map(|cluster| gpu_bytes(cluster, false)).max().unwrap_or(0);
        let room = chpm_mesh::Bytes::mib(1024);
        Following {
            arena: Arena::new(gpu, pipelines.slab.clone(), clusters.len(), room, largest),
            buffers: DrawBuffers::new(gpu, &pipelines),
            pipelines,
            list: DrawList::new(kind),
            frame: 0,
        }
    }

    fn draw(
        &mut self,
        gpu: &Gpu,
        file: &Chpm<MappedFile>,
        members: &[Member],
        lens: &Lens,
        mut pass: wgpu::RenderPass<'_>,
    ) -> Result<u64> {
        self.frame += 1;
        self.list.restart(self.list.kind());
        for member in members {
            if self.arena.get(member.cluster).is_none() {
                let block = Block::of_page(&file.page(member.cluster)?);
                self.arena.insert(gpu, member.cluster, &block, self.frame)?;
            }
            let resident = self.arena.get(member.cluster).ok_or("no room")?;
            self.list.push(resident, *member, Mark::default(), true);
        }
        self.buffers.write(gpu, &self.pipelines, &self.list, &lens.uniform([0; 4]));
        self.buffers.draw(gpu, &mut pass, &self.pipelines, &self.arena, &self.list, 0..members.len());
        Ok(self.arena.take_uploaded())
    }
}

/// The other way. Every cluster has a place for all that it could need, so that nothing has to be found.
struct Ranges {
    plain: Plain,
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    arguments: Growing,
    /// By cluster: where its vertices and its indices start.
    places: Vec<(u32, u32)>,
    /// By cluster, those that were drawn.
    cursors: Vec<Option<PmCursor>>,
    /// Of the last frame.
    triangles: u64,
    moved: u64,
}

impl Ranges {
    fn new(gpu: &Gpu, file: &Chpm<MappedFile>) -> Result<Self> {
        let (mut vertices, mut indices) = (0_u32, 0_u32);
        let mut places = Vec::new();
        for cluster in file.clusters() {
            places.push((vertices, indices));
            vertices += cluster.vertex_count;
            // Copies are of whole words.
            indices += (3 * cluster.triangle_count).next_multiple_of(2);
        }
        let ranges = Ranges {
            plain: Plain::new(gpu),
            vertices: buffer(
                gpu,
                "vertices",
                12 * u64::from(vertices),
                BufferUsages::VERTEX | BufferUsages::COPY_DST,
            ),
            indices: buffer(
                gpu,
                "indices",
                2 * u64::from(indices),
                BufferUsages::INDEX | BufferUsages::COPY_DST,
            ),
            arguments: Growing::new(gpu, "arguments", BufferUsages::INDIRECT),
            cursors: places.iter().map(|_| None).collect(),
            places,
            triangles: 0,
            moved: 0,
        };
        for (id, (first, _)) in (0..).zip(&ranges.places) {
            let page = file.page(chpm_mesh::ClusterId(id))?;
            gpu.queue.write_buffer(
                &ranges.vertices,
                12 * u64::from(*first),
                bytemuck::cast_slice(page.positions),
            );
            if id % 64 == 0 {
                gpu.queue.submit([]);
            }
        }
        gpu.queue.submit([]);
        buffers::wait(gpu)?;
        Ok(ranges)
    }

    fn draw(
        &mut self,
        gpu: &Gpu,
        file: &Chpm<MappedFile>,
        members: &[Member],
        lens: &Lens,
        mut pass: wgpu::RenderPass<'_>,
    ) -> Result<u64> {
        let mut arguments = Vec::with_capacity(members.len());
        let mut bytes = 0;
        (self.triangles, self.moved) = (0, 0);
        for member in members {
            let (first_vertex, first_index) = self.places[member.cluster.index()];
            let slot = &mut self.cursors[member.cluster.index()];
            let is_new = slot.is_none();
            if is_new {
                let page = file.page(member.cluster)?;
                // Its vertices would come along.
                bytes += 12 * page.positions.len() as u64;
                *slot = Some(PmCursor::new(&page.progressive_mesh()));
            }
            let cursor = slot.as_mut().ok_or("no cursor")?;
            if is_new || cursor.position() != member.vertices as usize {
                cursor.move_to(member.vertices as usize);
                let corners = cursor.triangles().as_flattened();
                let place = 2 * u64::from(first_index);
                let (even, odd) = corners.split_at(corners.len() / 2 * 2);
                gpu.queue.write_buffer(&self.indices, place, bytemuck::cast_slice(even));
                if let [last] = odd {
                    gpu.queue.write_buffer(
                        &self.indices,
                        place + 2 * even.len() as u64,
                        bytemuck::cast_slice(&[*last, 0]),
                    );
                }
                bytes += 2 * corners.len() as u64;
                self.moved += 1;
            }
            let count = cursor.triangles().len() as u32;
            self.triangles += u64::from(count);
            arguments.push([3 * count, 1, first_index, first_vertex, 0]);
        }
        // Those that left would be let go.
        self.arguments.write(gpu, bytemuck::cast_slice(&arguments));
        self.plain.look_through(gpu, &lens.uniform([0; 4]));
        self.plain.set(&mut pass, &self.vertices, (&self.indices, wgpu::IndexFormat::Uint16));
        pass.multi_draw_indexed_indirect(self.arguments.get(), 0, members.len() as u32);
        Ok(bytes)
    }
}
