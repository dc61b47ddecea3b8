//! Buffers that grow, images, and the way back to main memory.

use super::context::Gpu;
use crate::error::ViewerError;
use wgpu::{BufferUsages, TextureFormat, TextureUsages};

/// A buffer that is replaced by a larger one when its contents need it.
#[derive(Debug)]
pub struct Growing {
    label: &'static str,
    usage: BufferUsages,
    buffer: wgpu::Buffer,
}

impl Growing {
    /// A small buffer.
    pub fn new(gpu: &Gpu, label: &'static str, usage: BufferUsages) -> Self {
        let usage = usage | BufferUsages::COPY_DST;
        Growing { label, usage, buffer: buffer(gpu, label, 256, usage) }
    }

    /// Makes room for so many bytes; what was inside is lost where it grows. Answers whether it did.
    pub fn reserve(&mut self, gpu: &Gpu, bytes: u64) -> bool {
        let grows = bytes > self.buffer.size();
        if grows {
            self.buffer = buffer(gpu, self.label, bytes.next_power_of_two(), self.usage);
        }
        grows
    }

    /// Replaces the contents from the start on; answers whether it grew.
    pub fn write(&mut self, gpu: &Gpu, bytes: &[u8]) -> bool {
        let grows = self.reserve(gpu, bytes.len() as u64);
        if !bytes.is_empty() {
            gpu.queue.write_buffer(&self.buffer, 0, bytes);
        }
        grows
    }

    /// The buffer as it is now.
    pub fn get(&self) -> &wgpu::Buffer {
        &self.buffer
    }
}

/// A buffer.
pub fn buffer(gpu: &Gpu, label: &str, size: u64, usage: BufferUsages) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size,
        usage,
        mapped_at_creation: false,
    })
}

/// An image to draw into, and to copy from.
#[derive(Debug)]
pub struct Canvas {
    texture: wgpu::Texture,
    view: wgpu::TextureView,
}

impl Canvas {
    /// An image of some format.
    pub fn new(gpu: &Gpu, label: &str, [width, height]: [u32; 2], format: TextureFormat) -> Self {
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: TextureUsages::RENDER_ATTACHMENT
                | TextureUsages::COPY_SRC
                | TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        Canvas { texture, view }
    }

    /// The depth in a place, of this size: made anew where it is not.
    pub fn fit<'a>(place: &'a mut Option<Canvas>, gpu: &Gpu, size: [u32; 2]) -> &'a Canvas {
        if place.as_ref().is_none_or(|depth| depth.size() != size) {
            *place = None;
        }
        place.get_or_insert_with(|| Canvas::new(gpu, "depth", size, super::pipelines::DEPTH))
    }

    /// View to draw into.
    pub fn view(&self) -> &wgpu::TextureView {
        &self.view
    }

    /// Width and height.
    pub fn size(&self) -> [u32; 2] {
        [self.texture.width(), self.texture.height()]
    }

    /// Copies it into a texture of the same size and format.
    pub fn copy(&self, encoder: &mut wgpu::CommandEncoder, to: &wgpu::Texture) {
        encoder.copy_texture_to_texture(
            self.texture.as_image_copy(),
            to.as_image_copy(),
            self.texture.size(),
        );
    }

    /// Waits for all that was drawn and brings the pixels back, four bytes each, rows from the top.
    ///
    /// # Errors
    /// [`ViewerError::Device`].
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<u8>, ViewerError> {
        let [width, height] = self.size();
        let row = 4 * width;
        let pitch = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let bytes = u64::from(pitch) * u64::from(height);

        let staging = buffer(gpu, "image", bytes, BufferUsages::COPY_DST | BufferUsages::MAP_READ);
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_texture_to_buffer(
            self.texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &staging,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(pitch),
                    rows_per_image: None,
                },
            },
            self.texture.size(),
        );

        gpu.queue.submit([encoder.finish()]);
        let padded = read(gpu, &staging, bytes)?;
        Ok(padded.chunks_exact(pitch as usize).flat_map(|line| &line[..row as usize]).copied().collect())
    }
}

/// Multisampled target: colours and depths that only the resolve reads.
#[derive(Debug)]
pub struct Sampled {
    size: [u32; 2],
    format: TextureFormat,
    color: wgpu::TextureView,
    depth: wgpu::TextureView,
}

impl Sampled {
    /// Samples of a pixel: what every adapter has that has more than one.
    pub const SAMPLES: u32 = 4;

    /// The one in a place, of this size and format: made anew where it is not.
    ///
    /// # Errors
    /// [`ViewerError::Device`] where there is no room.
    pub fn fit<'a>(
        place: &'a mut Option<Sampled>,
        gpu: &Gpu,
        size: [u32; 2],
        format: TextureFormat,
    ) -> Result<&'a Sampled, ViewerError> {
        let made = match place.take().filter(|sampled| (sampled.size, sampled.format) == (size, format)) {
            Some(sampled) => sampled,
            None => gpu.attempt("making an image of several samples", || Sampled::new(gpu, size, format))?,
        };
        Ok(place.insert(made))
    }

    fn new(gpu: &Gpu, size: [u32; 2], format: TextureFormat) -> Self {
        let color = Self::view("samples", gpu, size, format);
        let depth = Self::view("depths of samples", gpu, size, super::pipelines::DEPTH);
        Sampled { size, format, color, depth }
    }

    fn view(label: &str, gpu: &Gpu, size: [u32; 2], format: TextureFormat) -> wgpu::TextureView {
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: Self::SAMPLES,
            dimension: wgpu::TextureDimension::D2,
            format,
            // Not every interface can do more with samples.
            usage: TextureUsages::RENDER_ATTACHMENT,
            view_formats: &[],
        });
        texture.create_view(&wgpu::TextureViewDescriptor::default())
    }

    /// Colour and depth.
    pub fn views(&self) -> (&wgpu::TextureView, &wgpu::TextureView) {
        (&self.color, &self.depth)
    }
}

/// Waits for all that was submitted and brings the first bytes of a buffer back.
///
/// # Errors
/// [`ViewerError::Device`].
pub fn read(gpu: &Gpu, staging: &wgpu::Buffer, bytes: u64) -> Result<Vec<u8>, ViewerError> {
    fn failed(reason: &str, gpu: &Gpu) -> ViewerError {
        gpu.failed("reading back", reason)
    }
    let (sender, receiver) = std::sync::mpsc::channel();
    let slice = staging.slice(..bytes);
    slice.map_async(wgpu::MapMode::Read, move |result| {
        // Nobody listens any more only where reading failed already.
        let _ = sender.send(result);
    });
    gpu.wait()?;
    // It is done, but who else waits for the same device may be the one that is about to say so.
    receiver
        .recv()
        .map_err(|error| failed(&error.to_string(), gpu))?
        .map_err(|error| failed(&error.to_string(), gpu))?;
    let view = slice.get_mapped_range().map_err(|error| failed(&error.to_string(), gpu))?;
    let copy = view.to_vec();
    drop(view);
    staging.unmap();
    Ok(copy)
}
