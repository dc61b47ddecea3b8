//! Edges without stairs in frames that do not wait: the picture is drawn once more with several samples a pixel. What hides what, and
//! where something is, is read from depths of one sample a pixel, so that both are the same with smooth edges and without.

use super::Viewer;
use super::model::Model;
use super::paint::Colors;
use crate::error::ViewerError;
use crate::gpu::buffers::Sampled;
use crate::gpu::{Kind, passes};
use crate::request::FrameRequest;

/// A picture that is drawn into.
#[derive(Clone, Copy, Debug)]
pub(super) struct Picture<'a> {
    pub(super) view: &'a wgpu::TextureView,
    pub(super) size: [u32; 2],
    pub(super) background: wgpu::Color,
}

impl Viewer {
    /// Whether a frame is drawn with several samples a pixel. Ids have no mean.
    pub(super) fn is_sampled(&self, request: &FrameRequest, kind: Kind) -> bool {
        let has_mean = !matches!(kind, Kind::Depth | Kind::Identified);
        has_mean && !request.wait && request.samples > 1 && self.gpu.multisamples()
    }

    /// Makes ready what a frame is drawn with. Answers what its first passes make, by model: depth alone, where the picture is drawn later on.
    pub(super) fn prepare(&mut self, colors: &[Colors], sampled: bool) -> Result<Vec<Kind>, ViewerError> {
        let mut all = Vec::with_capacity(colors.len());
        for (model, kind) in self.models.iter_mut().zip(colors.iter().map(Colors::kind)) {
            // Only what has indices is drawn by the same arguments as depth.
            let first = if sampled && kind.is_indexed() { Kind::Depth } else { kind };
            model.pipelines.prepare(&self.gpu, first, 1)?;
            if sampled {
                model.pipelines.prepare(&self.gpu, kind, Sampled::SAMPLES)?;
            }
            all.push(first);
        }
        Ok(all)
    }

    /// Draws what is first in the lists, that were sent, with several samples a pixel; in the place of all that is in the picture.
    pub(super) fn smooth(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        picture: Picture<'_>,
        part: impl Fn(&Model) -> usize,
    ) -> Result<(), ViewerError> {
        let Some(format) = self.models.first().and_then(|model| model.list.kind().format()) else {
            return Ok(());
        };
        let samples = Sampled::fit(&mut self.sampled, &self.gpu, picture.size, format)?;
        let mut pass = passes::begin_sampled(encoder, picture.view, samples.views(), picture.background);
        for model in &self.models {
            model.draw(&self.gpu, &mut pass, (model.list.kind(), Sampled::SAMPLES), 0..part(model));
        }
        Ok(())
    }
}
