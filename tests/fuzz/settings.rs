//! What a build is told, as the library and as the command take it.

use crate::draw::Draw;
use chpm_build::config::{Layout, Length, Normals, Positions, Topology};
use chpm_build::{BuildConfig, Resources, Settings};
use chpm_format::BoundaryMode;
use chpm_mesh::Bytes;

/// The least memory that a build takes, which is what all of them get.
pub(crate) const MEMORY: u64 = 128 << 20;

/// Settings, and the words that say the same to the command.
pub(crate) struct Told {
    pub(crate) config: BuildConfig,
    pub(crate) words: Vec<String>,
}

impl Told {
    pub(crate) fn draw(draw: &mut Draw<'_>) -> Self {
        let mut words = Vec::new();
        let cluster_triangles = draw.pick(&[64, 16, 24, 300, 4096]);
        words.push(format!("--cluster-triangles={cluster_triangles}"));
        let mut settings = Settings { cluster_triangles, ..Settings::default() };
        let mut flag = |is: bool, word: &str| {
            if is {
                words.push(word.to_owned());
            }
            is
        };
        if flag(draw.once_in(3), "--boundary=lock") {
            settings.boundary = BoundaryMode::Lock;
        }
        if flag(draw.once_in(3), "--topology=keep") {
            settings.topology = Topology::Keep;
        }
        if flag(draw.once_in(4), "--partitioner=greedy") {
            settings.partitioner = "greedy".parse().expect("a partitioner");
        }
        settings.normals = match draw.between(0, 7) {
            0 if flag(true, "--no-normals") => Normals::None,
            1 | 2 if flag(true, "--normals=computed") => Normals::Computed,
            _ => Normals::Source,
        };
        settings.colors = !flag(draw.once_in(8), "--no-colors");
        settings.drop_invalid = flag(draw.once_in(2), "--drop-invalid");
        settings.layout = match draw.once_in(4) {
            true => draw.pick(&[Layout::CacheOblivious, Layout::Simplification]),
            false => Layout::VertexCache,
        };
        words.push(format!("--order={}", settings.layout));
        if draw.once_in(6) {
            let percent = draw.pick(&[0.0, 0.1, 2.0]);
            words.push(format!("--finest-error={percent}%"));
            settings.finest_error = Some(Length::OfDiagonal(percent));
        }
        if draw.once_in(6) {
            let percent = draw.pick(&[1.0, 0.0, 30.0]);
            words.push(format!("--target-error={percent}%"));
            settings.target_error = Some(Length::OfDiagonal(percent));
        }
        if draw.once_in(4) {
            let percent = draw.pick(&[20.0, 0.0, 1.0, 60.0]);
            words.push(format!("--min-component={percent}%"));
            settings.min_component = Some(Length::OfDiagonal(percent));
        }
        if draw.once_in(3) {
            words.push("--keep=all".to_owned());
            settings.scalars.all = true;
        }
        if draw.once_in(4) {
            settings.positions = draw.pick(&[Positions::Auto, Positions::Lattice(9)]);
            words.push(format!("--positions={}", settings.positions));
        }
        let threads = draw.between(1, 2);
        let resources =
            Resources { threads, memory: Bytes(MEMORY), checkpoint: None, ..Resources::default() };
        Told { config: BuildConfig { settings, resources, overwrite: false }, words }
    }
}
