//! Options of builds, which several verbs share, and how they become a build's configuration.

use crate::number;
use anyhow::{Context, Result, ensure};
use chpm_build::config::{
    Bounds, Layout, Length, MissingImages, Normals, Positions, Texture, Topology, Volumes,
};
use chpm_build::{BuildConfig, FailPoints, MIN_MEMORY, Resources, Settings};
use chpm_format::BoundaryMode;
use chpm_mesh::Bytes;
pub(crate) use chpm_mesh::MemorySize;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use std::time::Duration;

/// Settings, which decide the bytes of the output.
#[derive(Args, Debug)]
#[command(next_help_heading = "Settings (they decide the bytes of the output)")]
pub(crate) struct SettingsArgs {
    /// Triangles of a leaf cluster to aim for: 4096 if not given, or so many, down to 256, that a sheet has at most a million texels
    #[arg(long, value_name = "N", hide_short_help = true, value_parser = number::count(16_u32..=16384))]
    cluster_triangles: Option<u32>,
    /// Who partitions the mesh
    #[arg(long, value_name = "NAME", hide_short_help = true, default_value = "metis", value_parser = ["metis", "greedy"])]
    partitioner: String,
    /// What becomes of the vertices that clusters share
    #[arg(long, value_name = "MODE", hide_short_help = true, value_enum, default_value_t = BoundaryArg::Dependencies)]
    boundary: BoundaryArg,
    /// What becomes of holes, handles and small pieces
    #[arg(long, value_name = "MODE", value_enum, default_value_t = TopologyArg::Change)]
    topology: TopologyArg,
    /// Leave out detail below this error
    ///
    /// In object units or, as in 0.01%, of the model's diagonal: the leaves are then coarser than the source.
    #[arg(long, value_name = "E")]
    finest_error: Option<Length>,
    /// Leave out what costs nothing: the same as --finest-error 0
    #[arg(long, hide_short_help = true, conflicts_with = "finest_error")]
    prune_exact: bool,
    /// Simplify no further than this error
    ///
    /// In object units or, as in 1%, of the model's diagonal: the file may then have several roots.
    #[arg(long, value_name = "E", hide_short_help = true)]
    target_error: Option<Length>,
    /// Leave out components smaller than this: dust
    ///
    /// Connected components whose box has a diagonal below SIZE, in object units or, as in 1%, of the whole model's diagonal.
    /// Errors are then those of what is kept.
    #[arg(long, value_name = "SIZE")]
    min_component: Option<Length>,
    /// Seed of the partitioner
    #[arg(long, value_name = "N", hide_short_help = true, default_value_t = Settings::default().seed)]
    seed: u64,
    /// Which normals vertices have
    #[arg(long, value_name = "WHICH", value_enum, default_value_t = NormalsArg::Source)]
    normals: NormalsArg,
    /// Leave vertex normals out: the same as --normals none
    #[arg(long, hide_short_help = true, conflicts_with = "normals")]
    no_normals: bool,
    /// Leave vertex colours out
    #[arg(long)]
    no_colors: bool,
    /// Use of the source's images; sheets, where one is there, if not given
    ///
    /// With --finest-error, --order cache-oblivious, --pages chained or chpm stage, which do not go with sheets: vertices.
    #[arg(long, value_name = "WHAT", value_enum)]
    texture: Option<TextureArg>,
    /// Treatment of images that are not there
    #[arg(long, value_name = "WHAT", hide_short_help = true, value_enum, default_value_t = MissingArg::Grey)]
    missing_images: MissingArg,
    /// Keep a number that vertices have, by its name
    ///
    /// Such as quality or intensity: every level has it, bit for bit. Can be given several times; all keeps all that the source has. Properties
    /// of PLY alone.
    #[arg(long, value_name = "NAME")]
    keep: Vec<String>,
    /// Drop and count what is invalid
    ///
    /// Vertices and faces that are invalid are left out and counted; without it, the file is refused.
    #[arg(long)]
    drop_invalid: bool,
    /// In which order clusters, vertices and triangles are
    #[arg(long, value_name = "NAME", hide_short_help = true, value_enum, default_value_t = OrderArg::VertexCache)]
    order: OrderArg,
    /// Leave the order as it is: the same as --order simplification
    #[arg(long, hide_short_help = true, conflicts_with = "order")]
    no_layout: bool,
    /// How closely errors of coarse meshes are looked at
    #[arg(long, value_name = "HOW", hide_short_help = true, value_enum, default_value_t = BoundsArg::Tight)]
    bounds: BoundsArg,
    /// How pages are stored
    #[arg(long, value_name = "HOW", value_enum, default_value_t = Pages::Raw)]
    pages: Pages,
    /// Pages in files of their own beside the output, of at most SIZE each
    ///
    /// SCAN.0001.pages and so on for SCAN.chpm, for places that have no larger files, such as FAT32 (4000M) or a store of objects. They belong
    /// together by name: rename all, or none. one, or 0, is a single file, and so is that of chpm relayout --volume-size one.
    #[arg(long, value_name = "SIZE", hide_short_help = true, default_value_t = Settings::default().volumes)]
    volume_size: Volumes,
    /// exact, lattice:auto or lattice:BITS: position quantization
    ///
    /// How many digits coordinates keep: exact (all that singles hold) or lattice:BITS (also written quantized:BITS), BITS from 8 to
    /// 24: whole steps of one lattice, of which the longest side of the model has 2^BITS at most; each coordinate moves by half a
    /// step at most, which is part of all errors. lattice:auto finds BITS: a step is at most half of what a sample of the model errs
    /// by when it is halved, as level 0 is; flat models stay exact.
    #[arg(long, value_name = "HOW", default_value_t = Settings::default().positions)]
    positions: Positions,
}

/// [`BoundaryMode`], as far as it can be built.
#[derive(ValueEnum, Clone, Copy, Debug)]
enum BoundaryArg {
    /// They stay until their clusters merge. Borders keep their detail, so coarse meshes have more triangles
    Lock,
    /// Neighbours that merge late form groups and simplify the borders between them together. Coarse meshes are smaller; a
    /// group is refined as a whole
    Dependencies,
}

impl BoundaryArg {
    fn mode(self) -> BoundaryMode {
        match self {
            BoundaryArg::Lock => BoundaryMode::Lock,
            BoundaryArg::Dependencies => BoundaryMode::Dependencies,
        }
    }
}

/// [`Topology`].
#[derive(ValueEnum, Clone, Copy, Debug)]
enum TopologyArg {
    /// They stay, so that no part vanishes and nothing grows together; what cannot be simplified so stalls and stays large
    Keep,
    /// Where nothing else is left, holes close and pieces vanish, at the price of their displacement. Surfaces may touch
    /// themselves; the open boundary of the source stays one
    Change,
}

impl TopologyArg {
    fn topology(self) -> Topology {
        match self {
            TopologyArg::Keep => Topology::Keep,
            TopologyArg::Change => Topology::Change,
        }
    }
}

/// [`Bounds`].
#[derive(ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
enum BoundsArg {
    /// Those of the coarsest meshes only, half a second sooner
    Quick,
    /// Of all that is within about 0.3% of the diagonal, so that it often has half of the triangles, in all verbs and viewers
    Tight,
}

/// [`Layout`].
#[derive(ValueEnum, Clone, Copy, Debug)]
enum OrderArg {
    /// Triangles of a cluster for the vertex caches of graphics processors, clusters as they are read: those of a split side by side, the largest errors first
    VertexCache,
    /// All of it for caches of any size
    CacheOblivious,
    /// Clusters from the coarsest to the finest, vertices and triangles as simplification leaves them
    Simplification,
}

impl OrderArg {
    fn layout(self) -> Layout {
        match self {
            OrderArg::VertexCache => Layout::VertexCache,
            OrderArg::CacheOblivious => Layout::CacheOblivious,
            OrderArg::Simplification => Layout::Simplification,
        }
    }
}

/// [`Normals`].
#[derive(ValueEnum, Clone, Copy, Debug)]
pub(crate) enum NormalsArg {
    /// Those of the source, if it has any
    Source,
    /// Those of all faces about a vertex in the mean, by area and angle, in 3 bytes: coarse levels then look like the fine one in other programs, too
    Computed,
    /// None
    None,
}

impl NormalsArg {
    pub(crate) fn normals(self) -> Normals {
        match self {
            NormalsArg::Source => Normals::Source,
            NormalsArg::Computed => Normals::Computed,
            NormalsArg::None => Normals::None,
        }
    }
}

/// [`Texture`], as far as it can be asked for.
#[derive(ValueEnum, Clone, Copy, Debug)]
enum TextureArg {
    /// Nothing: texture coordinates and colours of materials are left out
    None,
    /// Their texels are averaged into the colours of vertices
    Vertices,
    /// That, and each cluster has a sheet, an image of its surface: for view, render, pages, 3D Tiles and extract --texture-size
    Sheets,
}

/// [`MissingImages`].
#[derive(ValueEnum, Clone, Copy, Debug)]
enum MissingArg {
    /// Their triangles are grey, with a warning; so are those of images that are neither PNG nor JPEG
    Grey,
    /// They are an error, and so are names of materials and images that there are not
    Refuse,
}

/// How pages are stored.
#[derive(ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Pages {
    /// Uncompressed, as they are used: read in place, at multiples of 4096 bytes
    #[value(alias = "uncompressed")]
    Raw,
    /// Compressed: every bit of them in fewer bytes, on scans less than half, to be unpacked when they are read
    #[value(alias = "compressed")]
    Packed,
    /// Packed, and each told by one above that it refines: half as long, but reading one takes those above it
    Chained,
}

/// Resources; none of them shows in the output.
#[derive(Args, Debug)]
#[command(next_help_heading = "Resources (none of them shows in the output)")]
pub(crate) struct ResourceArgs {
    /// Worker threads; one per processor if not given
    #[arg(long, value_name = "N", value_parser = number::count(1_u32..=1024))]
    threads: Option<u32>,
    /// Keep what is done at least so many seconds after the last time, so that a build that was killed goes on there
    #[arg(long, value_name = "SECONDS", hide_short_help = true, default_value_t = 15.0, value_parser = seconds)]
    checkpoint: f64,
    /// Neither keep what is done nor go on from it
    #[arg(long, hide_short_help = true)]
    no_resume: bool,
    /// Keep the work folder: the next build starts from its simplified clusters
    #[arg(long, hide_short_help = true, conflicts_with = "no_resume")]
    keep_work: bool,
    /// End without warning at the access to a file of this number: for tests of what is left then
    #[arg(long, value_name = "N", hide = true)]
    kill_at: Option<u64>,
    /// Take less memory than a build can promise to stay below: for tests of what does not fit
    #[arg(long, hide = true)]
    pub(crate) any_memory: bool,
    #[command(flatten)]
    storage: StorageArgs,
}

/// Memory, and disk for what does not fit.
#[derive(Args, Debug)]
pub(crate) struct StorageArgs {
    /// Memory that the whole process stays below
    ///
    /// As in 512M or 4G, from 128M on for builds; what does not fit goes to the work directory.
    #[arg(long, value_name = "SIZE", default_value_t = MemorySize(Resources::default().memory))]
    memory: MemorySize,
    /// Where the work directory is made
    ///
    /// Beside the output (build) or in the temporary folder (verify) if not given.
    #[arg(long, value_name = "DIR")]
    pub(crate) work_dir: Option<PathBuf>,
}

impl StorageArgs {
    /// The memory budget.
    pub(crate) fn memory(&self) -> Bytes {
        self.memory.0
    }
}

/// A number of seconds, as in 0.5.
fn seconds(text: &str) -> Result<f64, String> {
    match number::decimal(text)? {
        seconds if seconds <= 1e9 => Ok(seconds),
        _ => Err("at most 1e9 seconds".to_owned()),
    }
}

impl SettingsArgs {
    /// The settings that were asked for.
    pub(crate) fn settings(&self) -> Result<Settings> {
        let settings = self;
        let partitioner = settings.partitioner.parse().context("--partitioner")?;
        Ok(Settings {
            cluster_triangles: settings.cluster_triangles.unwrap_or(Settings::default().cluster_triangles),
            fewer_for_texels: settings.cluster_triangles.is_none(),
            partitioner,
            boundary: settings.boundary.mode(),
            topology: settings.topology.topology(),
            finest_error: settings.finest_error.or(settings.prune_exact.then_some(Length::Units(0.0))),
            target_error: settings.target_error,
            min_component: settings.min_component,
            seed: settings.seed,
            normals: if settings.no_normals { Normals::None } else { settings.normals.normals() },
            colors: !settings.no_colors,
            texture: match settings.texture {
                None => Texture::Found,
                Some(TextureArg::None) => Texture::None,
                Some(TextureArg::Vertices) => Texture::Vertices,
                Some(TextureArg::Sheets) => Texture::Sheets,
            },
            missing_images: match settings.missing_images {
                MissingArg::Grey => MissingImages::Grey,
                MissingArg::Refuse => MissingImages::Refuse,
            },
            scalars: settings.keep.clone().into(),
            drop_invalid: settings.drop_invalid,
            bounds: match settings.bounds {
                BoundsArg::Quick => Bounds::Quick,
                BoundsArg::Tight => Bounds::Tight,
            },
            layout: if settings.no_layout { Layout::Simplification } else { settings.order.layout() },
            packed: settings.pages != Pages::Raw,
            chained: settings.pages == Pages::Chained,
            volumes: settings.volume_size,
            positions: settings.positions,
            ..Settings::default()
        })
    }
}

/// Memory that a build is given, if it can stay below that.
pub(crate) fn build_memory(memory: Bytes) -> Result<Bytes> {
    let (told, least) = (MemorySize(memory), MemorySize(Bytes(MIN_MEMORY)));
    ensure!(
        told.0 >= least.0,
        "--memory {told} is less than a build can stay below: give it {least} or more"
    );
    Ok(memory)
}

/// The configuration that was asked for.
pub(crate) fn build_config(
    settings: &SettingsArgs,
    resources: &ResourceArgs,
    overwrite: bool,
) -> Result<BuildConfig> {
    let settings = settings.settings()?;
    let memory = resources.storage.memory();
    let memory = if resources.any_memory { memory } else { build_memory(memory)? };
    Ok(BuildConfig {
        settings,
        resources: Resources {
            // Zero is the library's word for one per processor.
            threads: resources.threads.unwrap_or(0) as usize,
            memory,
            work_dir: resources.storage.work_dir.clone(),
            checkpoint: (!resources.no_resume).then(|| Duration::from_secs_f64(resources.checkpoint)),
            keep_work: resources.keep_work,
            fail_points: resources.kill_at.map_or_else(FailPoints::default, FailPoints::kill_at),
            ..Resources::default()
        },
        overwrite,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Build {
        #[command(flatten)]
        settings: SettingsArgs,
        #[command(flatten)]
        resources: ResourceArgs,
    }

    fn config(arguments: &[&str]) -> BuildConfig {
        let build = Build::try_parse_from([&["build"], arguments].concat()).unwrap();
        build_config(&build.settings, &build.resources, false).unwrap()
    }

    #[test]
    fn nothing_typed_is_the_library_default() {
        let (typed, default) = (config(&[]), BuildConfig::default());
        assert_eq!((typed.settings, typed.resources), (default.settings, default.resources));
    }

    #[test]
    fn every_flag_arrives() {
        let typed = config(&[
            "--cluster-triangles=512",
            "--partitioner=greedy",
            "--boundary=lock",
            "--topology=keep",
            "--finest-error=0.01%",
            "--target-error=2.5",
            "--min-component=3%",
            "--seed=3",
            "--no-normals",
            "--no-colors",
            "--texture=none",
            "--missing-images=refuse",
            "--drop-invalid",
            "--bounds=quick",
            "--order=cache-oblivious",
            "--pages=packed",
            "--positions=lattice:14",
            "--threads=5",
            "--memory=640M",
            "--work-dir=scratch",
            "--checkpoint=2.5",
            "--keep-work",
        ]);
        let s = typed.settings;
        assert_eq!((s.cluster_triangles, s.partitioner.to_string(), s.seed), (512, "greedy".to_owned(), 3));
        assert_eq!((s.boundary, s.topology), (BoundaryMode::Lock, Topology::Keep));
        assert_eq!(
            (s.finest_error, s.target_error),
            (Some(Length::OfDiagonal(0.01)), Some(Length::Units(2.5)))
        );
        assert_eq!(s.min_component, Some(Length::OfDiagonal(3.0)));
        assert_eq!(config(&["--prune-exact"]).settings.finest_error, Some(Length::Units(0.0)));
        assert_eq!((s.normals, s.colors, s.drop_invalid), (Normals::None, false, true));
        assert_eq!((s.texture, s.missing_images), (Texture::None, MissingImages::Refuse));
        assert_eq!(config(&["--texture=vertices"]).settings.texture, Texture::Vertices);
        let normals = |which: &str| config(&[&format!("--normals={which}")]).settings.normals;
        let named = ["source", "computed", "none"].map(normals);
        assert_eq!(named, [Normals::Source, Normals::Computed, Normals::None]);
        assert_eq!((s.layout, s.packed, s.bounds), (Layout::CacheOblivious, true, Bounds::Quick));
        assert_eq!(s.positions, Positions::Lattice(14));
        let layout = |argument: &str| config(&[argument]).settings.layout;
        assert_eq!(layout("--no-layout"), Layout::Simplification);
        for (name, told) in [
            ("vertex-cache", Layout::VertexCache),
            ("cache-oblivious", Layout::CacheOblivious),
            ("simplification", Layout::Simplification),
        ] {
            assert_eq!((layout(&format!("--order={name}")), told.to_string()), (told, name.to_owned()));
        }
        let expected = Resources {
            threads: 5,
            memory: Bytes::mib(640),
            work_dir: Some(PathBuf::from("scratch")),
            checkpoint: Some(Duration::from_millis(2500)),
            keep_work: true,
            fail_points: FailPoints::default(),
            ..Resources::default()
        };
        assert_eq!(typed.resources, expected);
        assert_eq!(config(&["--no-resume"]).resources.checkpoint, None);
    }

    #[test]
    fn values_out_of_range_are_refused() {
        for bad in [
            ["--threads=0"],
            ["--cluster-triangles=15"],
            ["--memory=1,5G"],
            ["--partitioner=scotch"],
            ["--boundary=v-partition"],
            ["--topology=free"],
            ["--finest-error=-1"],
            ["--target-error=nan%"],
            ["--min-component=-1%"],
            ["--min-component=inf"],
            ["--min-component=nan"],
            ["--checkpoint=-1"],
            ["--order=fastest"],
            ["--texture=paper"],
            ["--positions=lattice:25"],
        ] {
            assert!(Build::try_parse_from(["build"].iter().chain(&bad)).is_err(), "{bad:?}");
        }
    }
}
