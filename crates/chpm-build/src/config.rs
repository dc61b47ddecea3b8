//! Configuration of a build: settings decide the bytes of the output, resources only how it gets there.

use crate::ids::Ids;
use crate::trace::Trace;
use chpm_extmem::FailPoints;
use chpm_format::BoundaryMode;
use chpm_import::Images;
pub use chpm_import::ply::Keep;
use chpm_mesh::Bytes;
pub use chpm_mesh::asked::{Length, LengthError};
use chpm_partition::Partitioner;
pub use chpm_qem::Topology;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

/// The program and its version.
pub(crate) const GENERATOR: &str = concat!("chpm ", env!("CARGO_PKG_VERSION"));

/// Everything a build is told.
#[derive(Clone, Debug, Default)]
pub struct BuildConfig {
    /// Settings, which decide the output.
    pub settings: Settings,
    /// Resources, which do not.
    pub resources: Resources,
    /// Whether an existing output may be replaced.
    pub overwrite: bool,
}

impl BuildConfig {
    /// Makes a later build able to take over what this one makes, and lets this one take over what is still true of an earlier model.
    pub fn make_updatable(&mut self, earlier: Option<PathBuf>) {
        self.settings.division = Division::Cubes;
        (self.resources.memo, self.resources.update) = (true, earlier);
    }
}

/// Settings that decide the output, byte for byte; stored in the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// How the source is divided into regions of some dozen leaves.
    pub division: Division,
    /// Triangles of a leaf cluster that the decomposition aims for (Quick-VDR 4.1: about 2K vertices, so 4K triangles).
    pub cluster_triangles: u32,
    /// Whether they are fewer where sheets would have more than a million texels each.
    pub fewer_for_texels: bool,
    /// Vertices above which a grid cell is subdivided. Smaller cells follow boundaries more closely and cost time.
    pub cell_vertices: u32,
    /// Neighbours of a cell in the cell graph (Quick-VDR 4.1: k = 6).
    pub cell_neighbors: u32,
    /// Who partitions the cell graph and the cluster graph.
    #[serde(with = "as_text")]
    pub partitioner: Partitioner,
    /// Seed of the partitioner.
    pub seed: u64,
    /// Share of a cluster's triangles that its base mesh keeps (Quick-VDR 4.3: half).
    pub keep: f64,
    /// Whether shared vertices stay until their clusters merge, or clusters form dependency groups that simplify the group borders
    /// between them.
    pub boundary: BoundaryMode,
    /// Least number of vertices that dependent clusters share (Quick-VDR 4.4: 5).
    pub dependency_shared: u32,
    /// Clusters that merge within so many levels do not depend on each other (Quick-VDR 4.4: 2).
    pub dependency_levels: u32,
    /// Most members of a dependency group. A group splits and collapses as a whole: small ones follow a view more closely,
    /// large ones leave fewer vertices locked.
    pub dependency_members: u32,
    /// Most that the finest errors of dependent clusters may differ by, as a factor ("similar error-range").
    pub dependency_error_ratio: f32,
    /// Whether the simplifier may change the topology where nothing else helps.
    pub topology: Topology,
    /// Detail below this error is left out, so that the leaves are coarser than the source; none keeps the source's own
    /// triangles. At 0 only what costs nothing goes.
    pub finest_error: Option<Length>,
    /// No mesh has a larger error than this: collapses end there, and what would need more has several roots.
    pub target_error: Option<Length>,
    /// Components whose box has a smaller diagonal are left out, as if the source did not have them.
    pub min_component: Option<Length>,
    /// How closely the errors of coarse meshes are looked at.
    pub bounds: Bounds,
    /// Which normals vertices have.
    pub normals: Normals,
    /// Whether vertex colours of the source are carried along.
    pub colors: bool,
    /// Use of the source's images.
    pub texture: Texture,
    /// Treatment of images that are not there.
    pub missing_images: MissingImages,
    /// Which named scalars of the source's vertices are carried along.
    pub scalars: Keep,
    /// Whether invalid vertices and faces are dropped and counted rather than refused.
    pub drop_invalid: bool,
    /// In which order clusters, vertices and triangles are.
    pub layout: Layout,
    /// Whether pages are packed: the same bits in fewer bytes, to be unpacked when they are read.
    pub packed: bool,
    /// Whether packed pages are chained, each told by one above, in fewer bytes again. Not with sheets, which know triangles by their order.
    pub chained: bool,
    /// Files that pages go to.
    pub volumes: Volumes,
    /// Whether positions keep all digits that singles hold, or lie on a lattice.
    pub positions: Positions,
    /// How the model is shown ([`chpm_format::shown`]), by name and value.
    pub shown: Vec<(String, String)>,
}

/// Texels of a leaf's sheet to stay below, and triangles that it has all the same.
const SHEET_TEXELS: f64 = (1u32 << 20) as f64;
const FEWEST_TRIANGLES: f64 = 256.0;

impl Default for Settings {
    fn default() -> Self {
        Settings {
            division: Division::Graph,
            cluster_triangles: 4096,
            fewer_for_texels: true,
            cell_vertices: 48,
            cell_neighbors: 6,
            partitioner: Partitioner::Metis,
            seed: 17,
            keep: 0.5,
            boundary: BoundaryMode::Dependencies,
            dependency_shared: 5,
            dependency_levels: 2,
            dependency_members: 8,
            dependency_error_ratio: 2.0,
            topology: Topology::Change,
            finest_error: None,
            target_error: None,
            min_component: None,
            bounds: Bounds::Tight,
            normals: Normals::Source,
            colors: true,
            texture: Texture::Found,
            missing_images: MissingImages::Grey,
            scalars: Keep::default(),
            drop_invalid: false,
            layout: Layout::VertexCache,
            packed: false,
            chained: false,
            volumes: Volumes::One,
            positions: Positions::Exact,
            shown: Vec::new(),
        }
    }
}

/// How a large source is divided into regions of some dozen leaves.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub enum Division {
    /// A graph of coarse cells is cut into parts of equal size that share few vertices.
    #[default]
    Graph,
    /// Cubes of an octree, each by what lies in it: so most regions stay as they are where the source changes in some.
    Cubes,
}

/// How closely the errors of a root's meshes are looked at.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub enum Bounds {
    /// Those of the coarsest only: a quarter of a second less, at most.
    Quick,
    /// From several thousand triangles on.
    #[default]
    Tight,
}

/// Which normals vertices have.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub enum Normals {
    /// Those of the source, if it has any.
    #[default]
    Source,
    /// Those that the faces about a vertex have in the mean, by area and angle, whatever the source says.
    Computed,
    /// None.
    None,
}

impl fmt::Display for Normals {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // The first two are as files had them before normals could be computed.
        f.write_str(match self {
            Normals::Source => "true",
            Normals::None => "false",
            Normals::Computed => "computed",
        })
    }
}

/// Use of the source's images.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub enum Texture {
    /// As [`Texture::Sheets`] where an image is there, or as [`Texture::Vertices`] with a setting that does not go with sheets.
    #[default]
    Found,
    /// As [`Texture::Vertices`] where an image is there.
    FoundForVertices,
    /// Nothing.
    None,
    /// Their texels are averaged into the colours of vertices.
    Vertices,
    /// That, and each cluster has a sheet: an image of its surface.
    Sheets,
}

/// Treatment of images that are not there, or of no kind that is read.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub enum MissingImages {
    /// Triangles of theirs are grey, with a warning.
    #[default]
    Grey,
    /// They are an error.
    Refuse,
}

/// In which order a file has what is in it.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub enum Layout {
    /// Clusters that are read together side by side, by falling error; the triangles of each in an order for vertex caches.
    VertexCache,
    /// Clusters, and the vertices and triangles of each, in cache-oblivious order (Yoon 6 and 7).
    CacheOblivious,
    /// Clusters breadth-first, vertices and triangles as simplification leaves them.
    Simplification,
}

impl fmt::Display for Layout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Layout::VertexCache => "vertex-cache",
            Layout::CacheOblivious => "cache-oblivious",
            Layout::Simplification => "simplification",
        })
    }
}

/// Files that pages go to. It is no setting that a file tells of: its volumes show it, and splitting or joining them changes nothing else.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub enum Volumes {
    /// The model's own file.
    #[default]
    One,
    /// Files beside it, of at most so many bytes each.
    Of(Size),
}

/// Bytes of a volume's file: at least a page of memory, at most 2^50.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Size(u64);

impl Volumes {
    /// Most bytes of a volume's file, if there are to be any.
    pub fn size(self) -> Option<u64> {
        match self {
            Volumes::One => None,
            Volumes::Of(Size(size)) => Some(size),
        }
    }
}

impl fmt::Display for Volumes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Volumes::One => write!(f, "one"),
            Volumes::Of(Size(size)) => write!(f, "{size}"),
        }
    }
}

impl FromStr for Volumes {
    type Err = VolumesError;

    fn from_str(text: &str) -> Result<Self, VolumesError> {
        let error = || VolumesError { got: text.to_owned() };
        if text == "one" {
            return Ok(Volumes::One);
        }
        match text.parse::<Bytes>().map_err(|_| error())?.0 {
            0 => Ok(Volumes::One),
            size if (1 << 12..=1 << 50).contains(&size) => Ok(Volumes::Of(Size(size))),
            _ => Err(error()),
        }
    }
}

/// A text that is no [`Volumes`].
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error(
    "'{got}' is no size of a volume: write bytes, as in 4000M, from 4K to 1024T, or one for a single file"
)]
pub struct VolumesError {
    /// The text.
    pub got: String,
}

/// Treatment of the source's coordinates.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub enum Positions {
    /// Singles keep their bits, what has more digits is rounded to singles.
    Exact,
    /// All go to the nearest point of one lattice, whose step is the least power of two of which the longest side of the model's box has
    /// at most 2 to this power. By how much they move is part of all errors.
    Lattice(u8),
    /// The same, with as many bits as the model's detail is worth: the step is at most half of what a sample of the model errs by when it is
    /// halved, as leaves are. Where singles are no finer than that, as on flat models, positions are exact.
    Auto,
}

impl Positions {
    /// Fewer bits would leave no shape; more are not singles.
    pub const BITS: RangeInclusive<u8> = 8..=24;
}

impl fmt::Display for Positions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Positions::Exact => write!(f, "exact"),
            Positions::Lattice(bits) => write!(f, "lattice:{bits}"),
            Positions::Auto => write!(f, "lattice:auto"),
        }
    }
}

impl FromStr for Positions {
    type Err = PositionsError;

    fn from_str(text: &str) -> Result<Self, PositionsError> {
        fn bits(text: &str) -> Option<u8> {
            text.parse().ok().filter(|bits| Positions::BITS.contains(bits))
        }
        match text.strip_prefix("lattice:").or_else(|| text.strip_prefix("quantized:")) {
            None if text == "exact" => Some(Positions::Exact),
            None => None,
            Some("auto") => Some(Positions::Auto),
            Some(text) => bits(text).map(Positions::Lattice),
        }
        .ok_or_else(|| PositionsError { got: text.to_owned() })
    }
}

/// A text that is no [`Positions`].
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error(
    "'{got}' says nothing of positions: write exact, lattice:auto, or lattice:BITS with BITS from 8 to 24, as in lattice:16"
)]
pub struct PositionsError {
    /// The text.
    pub got: String,
}

/// A partitioner in a record: by its name, since its crate knows of no records.
mod as_text {
    use chpm_partition::Partitioner;
    use serde::{Deserialize, Deserializer, Serializer, de};

    pub(super) fn serialize<S: Serializer>(value: &Partitioner, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(value)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Partitioner, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(de::Error::custom)
    }
}

fn length_text(length: Option<Length>) -> String {
    length.map_or("none".to_owned(), |length| length.to_string())
}

impl Settings {
    /// Whether pages are to be chained.
    pub fn is_chained(&self) -> bool {
        self.packed && self.chained
    }

    /// The setting by which a file says that its colours are those of images.
    pub const TEXTURE: [&str; 2] = ["texture", "vertices"];
    /// The same, where clusters have sheets, too.
    pub const SHEETS: [&str; 2] = ["texture", "sheets"];
    /// The name under which a file says how many triangles a leaf was to have, where that was fewer than asked for.
    pub const LEAF_TRIANGLES: &str = "leaf-triangles";

    /// The setting by which a file with colours of images says so.
    pub fn of_images(&self) -> [&'static str; 2] {
        if self.makes_sheets() { Self::SHEETS } else { Self::TEXTURE }
    }

    /// Which images of a source are read.
    pub fn images(&self) -> Images {
        match (self.texture, self.missing_images) {
            _ if !self.colors => Images::Ignored,
            (Texture::None, _) => Images::Ignored,
            (_, MissingImages::Refuse) => Images::Required,
            (Texture::Found | Texture::FoundForVertices, _) => Images::IfAny,
            (Texture::Vertices | Texture::Sheets, _) => Images::Grey,
        }
    }

    /// A setting, as the command has it, that clusters can have no sheets with; none if they can.
    pub(crate) fn without_sheets(&self) -> Option<&'static str> {
        [
            (self.finest_error.is_some(), "--finest-error"),
            (self.layout == Layout::CacheOblivious, "--order cache-oblivious"),
            (self.is_chained(), "--pages chained"),
        ]
        .into_iter()
        .find_map(|(is_set, name)| is_set.then_some(name))
    }

    /// Whether clusters have sheets, where there is an image.
    pub fn makes_sheets(&self) -> bool {
        match self.texture {
            Texture::Sheets => true,
            Texture::Found => self.without_sheets().is_none(),
            Texture::FoundForVertices | Texture::None | Texture::Vertices => false,
        }
    }

    /// Triangles of a leaf, if texels make them fewer than is set; `texels` is what so many textured triangles have together.
    pub(crate) fn triangles_for(&self, texels: f64, triangles: u64) -> Option<u32> {
        let most = SHEET_TEXELS * triangles as f64 / texels;
        let fewer = most.clamp(FEWEST_TRIANGLES, f64::from(u32::MAX)) as u32;
        (self.fewer_for_texels && texels > 0.0 && fewer < self.cluster_triangles).then_some(fewer)
    }

    /// Names and values as they are stored in the file and printed by `chpm info`. That colours are those of images depends on the source, and
    /// comes behind them.
    pub fn describe(&self) -> Vec<(String, String)> {
        let entry = |name: &str, value: &dyn ToString| (name.to_owned(), value.to_string());
        let mut entries = vec![
            entry("cluster-triangles", &self.cluster_triangles),
            entry("cell-vertices", &self.cell_vertices),
            entry("cell-neighbors", &self.cell_neighbors),
            entry("partitioner", &self.partitioner),
            entry("seed", &self.seed),
            entry("keep", &self.keep),
            entry("boundary", &self.boundary),
            entry("dependency-shared", &self.dependency_shared),
            entry("dependency-levels", &self.dependency_levels),
            entry("dependency-members", &self.dependency_members),
            entry("dependency-error-ratio", &self.dependency_error_ratio),
            entry("topology", &if self.topology == Topology::Keep { "keep" } else { "change" }),
            entry("error", &"certified"),
            entry("finest-error", &length_text(self.finest_error)),
            entry("target-error", &length_text(self.target_error)),
            entry("normals", &self.normals),
            entry("colors", &self.colors),
            entry("drop-invalid", &self.drop_invalid),
            entry("layout", &self.layout),
        ];
        // Files of all that is there are as they were before this could be asked for.
        entries.extend((self.division == Division::Cubes).then(|| entry("division", &"cubes")));
        entries.extend((self.bounds == Bounds::Quick).then(|| entry("bounds", &"quick")));
        entries.extend(self.min_component.map(|size| entry("min-component", &size)));
        entries.extend(self.scalars.all.then(|| entry("scalars", &"all")));
        entries.extend(self.scalars.names.iter().map(|name| entry("scalar", name)));
        let pages = if self.is_chained() { "chained" } else { "packed" };
        entries.extend(self.packed.then(|| entry("pages", &pages)));
        entries.extend((self.positions != Positions::Exact).then(|| entry("positions", &self.positions)));
        entries.extend(self.shown.iter().cloned());
        entries
    }
}

/// Resources of a build; none of them shows in the output.
#[derive(Clone, Debug, PartialEq)]
pub struct Resources {
    /// Worker threads; 0 takes one per processor.
    pub threads: usize,
    /// Memory of the process; what does not fit is kept in files of the work directory. Kept from [`crate::MIN_MEMORY`] on:
    /// with less, all arrays that can be are on disk, and no more is promised.
    pub memory: Bytes,
    /// Where the work directory is made; the output's directory if not given.
    pub work_dir: Option<PathBuf>,
    /// Least time between checkpoints, from which a build that was killed goes on. Without it none is made, and none that is there is
    /// used.
    pub checkpoint: Option<Duration>,
    /// Whether what becomes of groups of clusters is kept beside the output, for later builds to take over. No checkpoints are made then.
    pub memo: bool,
    /// An earlier model, built with such a memo, of which this build takes over what it would make alike.
    pub update: Option<PathBuf>,
    /// Whether the work directory stays when the build is done, with all that layout and emit start from.
    pub keep_work: bool,
    /// Where stages and tasks are recorded, if anywhere.
    pub trace: Trace,
    /// The least kind of ids for a source's vertices; wider ones are taken where there are too many.
    pub ids: Ids,
    /// Planned failures, for tests.
    pub fail_points: FailPoints,
}

impl Default for Resources {
    fn default() -> Self {
        Resources {
            threads: 0,
            memory: Bytes::mib(1024),
            work_dir: None,
            checkpoint: Some(Duration::from_secs(15)),
            memo: false,
            update: None,
            keep_work: false,
            trace: Trace::default(),
            ids: Ids::default(),
            fail_points: FailPoints::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dense_images_make_leaves_smaller() {
        let settings = Settings::default();
        assert_eq!(settings.triangles_for(0.0, 0), None, "no triangle has an image");
        assert_eq!(settings.triangles_for(0.0, 7), None);
        assert_eq!(settings.triangles_for(20_000.0, 1000), None);
        assert_eq!(settings.triangles_for(1_024_000.0, 1000), Some(1024));
        assert_eq!(settings.triangles_for(6.7e7, 12), Some(256));
        assert_eq!(settings.triangles_for(f64::INFINITY, 12), Some(256));
        let asked = Settings { fewer_for_texels: false, ..settings };
        assert_eq!(asked.triangles_for(6.7e7, 12), None);
    }

    #[test]
    fn sizes_of_volumes_are_read_as_bytes() {
        let size = |text: &str| text.parse().map(Volumes::size);
        assert_eq!((size("one"), size("0")), (Ok(None), Ok(None)));
        assert_eq!((size("4000M"), size("64 KiB")), (Ok(Some(4000 << 20)), Ok(Some(65_536))));
        assert_eq!(size("1024T").map(|size| size.map(u64::ilog2)), Ok(Some(50)));
        for bad in ["", "4095", "1025T", "two", "-1", "1,5G"] {
            assert_eq!(size(bad), Err(VolumesError { got: bad.to_owned() }));
        }
        assert_eq!("70000".parse::<Volumes>().unwrap().to_string().parse(), "70000".parse::<Volumes>());
    }

    #[test]
    fn positions_are_read_as_they_are_told() {
        for text in ["exact", "lattice:8", "lattice:24", "lattice:auto"] {
            assert_eq!(text.parse::<Positions>().map(|positions| positions.to_string()), Ok(text.to_owned()));
        }
        assert_eq!("quantized:16".parse(), Ok(Positions::Lattice(16)));
        assert_eq!("quantized:auto".parse(), Ok(Positions::Auto));
        for bad in ["", "lattice", "lattice:", "lattice:7", "lattice:25", "lattice:-8", "lattice:16 ", "16"] {
            assert_eq!(bad.parse::<Positions>(), Err(PositionsError { got: bad.to_owned() }));
        }
    }
}
