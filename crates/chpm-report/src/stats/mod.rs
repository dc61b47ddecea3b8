//! A file in numbers: of its levels, its groups and its bytes, and the clusters that stand out.

mod boxes;
mod measured;
mod page;
mod sheets;
mod spread;
pub mod worst;

use crate::digest::Sizes;
use crate::error::ReportError;
use crate::level::per_triangle;
use chpm_extmem::{Cancel, MappedFile};
use chpm_format::packed::PARTS;
use chpm_format::{Chpm, ClusterRecord};
pub use page::{Borders, CACHES, MEMORY, PageStats};
use serde::Serialize;
use serde_json::{Map, Value};
pub use sheets::SheetStats;
pub use spread::Spread;
use worst::Worst;

/// All of it, as `--json` has it.
#[derive(Serialize, Debug)]
pub struct Stats {
    schema: &'static str,
    file: String,
    /// One number each for the whole file, by name: what can be asserted.
    pub measures: Map<String, Value>,
    /// A level each, from the finest on.
    pub levels: Vec<LevelStats>,
    /// The groups.
    pub groups: GroupStats,
    /// The bytes.
    pub bytes: ByteStats,
    /// How many levels a vertex is shared for, over all shared vertices.
    border_levels: Option<Spread>,
    /// The clusters that stand out.
    pub worst: Vec<Worst>,
}

/// A level.
#[derive(Serialize, Debug)]
pub struct LevelStats {
    /// Its number; 0 is the finest.
    pub level: u32,
    /// Its clusters.
    pub clusters: u32,
    /// Of the finest mesh of a cluster, and of its base mesh.
    pub triangles: Option<Spread>,
    base_triangles: Option<Spread>,
    /// Triangles that have the vertices of another one of their cluster before them, all clusters at their finest.
    pub coincident: u64,
    /// Triangles of all clusters, as in `info`.
    #[serde(skip)]
    pub total_triangles: u64,
    /// Vertices that other clusters have, too, by vertices.
    pub shared: f64,
    /// For how many levels its shared vertices are shared.
    pub border_levels: Option<Spread>,
    min_error: Option<Spread>,
    /// Errors of base meshes.
    pub max_error: Option<Spread>,
    /// The longest side of a cluster's box by the second longest.
    pub aspect: Option<Spread>,
    /// The share of a cluster's box that a sibling's takes.
    pub overlap: Option<Spread>,
    /// Its groups.
    pub groups: u32,
    /// Clusters of a group.
    pub group_size: Option<Spread>,
    /// Collapses of a cluster.
    pub collapses: Option<Spread>,
    /// Bytes of its pages.
    pub page_bytes: u64,
    parts: Map<String, Value>,
    acmr16: f64,
    /// Misses for each triangle of a cache of 24 vertices.
    pub acmr24: f64,
    acmr32: f64,
    /// How far apart the ends of an edge are in the list of vertices, in the mean.
    pub edge_span: f64,
    /// Its clusters' sheets, in a file that has some.
    pub sheets: Option<SheetStats>,
    /// Stored by measured distance; with `--measured` alone.
    pub tightness: Option<Value>,
}

/// The groups.
#[derive(Serialize, Debug)]
pub struct GroupStats {
    count: u32,
    /// Coarse clusters of a group.
    size: Option<Spread>,
    /// The first of those that have the most.
    largest: u32,
    /// Groups one below the other, at most.
    pub longest_path: u32,
}

/// The bytes.
#[derive(Serialize, Debug)]
pub struct ByteStats {
    file: u64,
    tables: u64,
    pages: u64,
    padding: u64,
    sheets: u64,
    per_triangle: f64,
    parts: Map<String, Value>,
}

/// A cluster in numbers.
#[derive(Clone, Copy, Debug)]
pub struct Row<'a> {
    /// The cluster.
    pub id: u32,
    /// The file's table has this of it.
    pub record: &'a ClusterRecord,
    /// Its page has this.
    pub page: PageStats,
    /// The longest side of its box by the second longest.
    pub aspect: Option<f64>,
    /// The share of its box that a sibling's takes.
    pub overlap: Option<f64>,
}

impl ByteStats {
    /// Bytes of the file's parts, by name.
    pub fn all(&self) -> impl Iterator<Item = (String, f64)> {
        let parts =
            self.parts.iter().map(|(part, bytes)| (part.replace('_', " "), bytes.as_f64().unwrap_or(0.0)));
        let [tables, padding, sheets] = [self.tables, self.padding, self.sheets].map(|bytes| bytes as f64);
        let names = ["tables", "padding", "sheets"].map(str::to_owned);
        parts.chain(names.into_iter().zip([tables, padding, sheets]))
    }
}

impl Row<'_> {
    /// Misses for each triangle, by [`CACHES`].
    pub fn acmr(&self) -> [f64; CACHES.len()] {
        self.page.misses.map(|misses| by(misses, self.record.triangle_count.into()))
    }

    /// The mean over the edges of all triangles.
    pub fn edge_span(&self) -> f64 {
        by(self.page.span, 3 * u64::from(self.record.triangle_count))
    }

    /// Collapses from its finest mesh to its base mesh.
    pub fn collapses(&self) -> u32 {
        self.record.vertex_count - self.record.base_vertex_count
    }
}

fn by(part: u64, whole: u64) -> f64 {
    if whole == 0 { 0.0 } else { part as f64 / whole as f64 }
}

/// Reads every page of a file.
///
/// # Errors
/// Damage of the file, and [`ReportError::Cancelled`].
pub fn rows<'a>(file: &'a Chpm<MappedFile>, cancel: &Cancel) -> Result<(Vec<Row<'a>>, Borders), ReportError> {
    let (pages, borders) = page::read(file, cancel)?;
    let clusters = (0..).zip(file.clusters()).zip(pages).zip(boxes::overlaps(file));
    let rows = clusters.map(|(((id, record), page), overlap)| {
        let aspect = boxes::aspect(&record.aabb());
        Row { id, record, page, aspect, overlap }
    });
    Ok((rows.collect(), borders))
}

impl Stats {
    /// From what was read.
    pub fn new(path: String, file: &Chpm<MappedFile>, rows: &[Row<'_>], borders: &Borders) -> Self {
        let (lives, all) = borders.lives(file.levels().len());
        let levels: Vec<LevelStats> =
            (0..).zip(&lives).map(|(level, lives)| LevelStats::new(file, rows, level, lives)).collect();
        let sizes = Sizes::of(file);
        let bytes = ByteStats {
            file: sizes.file,
            tables: sizes.tables,
            pages: sizes.pages,
            padding: sizes.padding,
            sheets: sizes.sheets,
            per_triangle: per_triangle(sizes.file, file.header().source_triangle_count),
            parts: parts(rows.iter()),
        };

        let mut sizes = file.groups().iter().map(|group| group.coarse_count);
        let most = sizes.clone().max().unwrap_or(0);
        let groups = GroupStats {
            count: file.header().group_count,
            size: Spread::of(sizes.clone().map(f64::from)),
            largest: sizes.position(|size| size == most).unwrap_or(0) as u32,
            longest_path: boxes::longest_path(file),
        };

        let mut stats = Stats {
            schema: "chpm-stats/1",
            file: path,
            measures: Map::new(),
            levels,
            groups,
            bytes,
            border_levels: Spread::of_counts(&all),
            worst: worst::of(rows, file.levels().len()),
        };
        stats.measures = stats.measured(file, rows);
        stats
    }

    fn measured(&self, file: &Chpm<MappedFile>, rows: &[Row<'_>]) -> Map<String, Value> {
        let h = file.header();
        let height = h.level_count - 1;
        let least = h.leaf_count.max(1).next_power_of_two().ilog2();
        let diagonal = h.aabb().diagonal();
        let roots = rows.iter().filter(|row| row.record.is_root());
        let levels = file.levels();
        let ratios = levels.array_windows().map(|[below, own]| by(own.triangle_count, below.triangle_count));
        let all: u64 = levels.iter().map(|level| level.triangle_count).sum();

        let plain = [
            ("triangles", Some(h.source_triangle_count as f64)),
            ("clusters", Some(h.cluster_count.into())),
            ("levels", Some(h.level_count.into())),
            ("height", Some(height.into())),
            ("least_height", Some(least.into())),
            ("roots", Some(h.root_count.into())),
            ("top_triangles", Some(roots.map(|row| f64::from(row.record.base_triangle_count)).sum())),
            ("worst_ratio", ratios.reduce(f64::max)),
            ("stalled", Some(levels.iter().map(|level| f64::from(level.stalled_cluster_count)).sum())),
            ("coincident", Some(self.levels.iter().map(|level| level.coincident as f64).sum())),
            ("forced", Some(levels.iter().map(|level| f64::from(level.forced_collapse_count)).sum())),
            ("max_error", Some(h.max_error.into())),
            ("max_error_percent", (diagonal > 0.0).then(|| 100.0 * f64::from(h.max_error) / diagonal)),
            ("shared", self.levels.iter().map(|level| level.shared).reduce(f64::max)),
            ("border_levels", self.border_levels.map(|spread| spread.median)),
            ("groups", Some(h.group_count.into())),
            ("largest_group", self.groups.size.map(|spread| spread.max)),
            ("longest_path", Some(self.groups.longest_path.into())),
            ("aspect", median(rows.iter().filter_map(|row| row.aspect))),
            ("overlap", median(rows.iter().filter_map(|row| row.overlap))),
            ("bytes", Some(file.stored_len() as f64)),
            ("bytes_per_triangle", Some(self.bytes.per_triangle)),
        ];

        let plain = plain.into_iter().map(|(name, value)| (name.to_owned(), value));
        let acmrs = CACHES.into_iter().enumerate().map(|(cache, size)| {
            let misses = rows.iter().map(|row| row.page.misses[cache]).sum();
            (format!("acmr{size}"), Some(by(misses, all)))
        });
        let span = Some(by(rows.iter().map(|row| row.page.span).sum(), 3 * all));
        let texels = self.levels.iter().map(|level| level.sheets.map(|sheets| sheets.texels as f64)).sum();
        let measures =
            plain.chain(acmrs).chain([("edge_span".to_owned(), span), ("texels".to_owned(), texels)]);
        measures.filter_map(|(name, value)| Some((name, value?.into()))).collect()
    }
}

fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    Spread::of(values).map(|spread| spread.median)
}

impl LevelStats {
    fn new(file: &Chpm<MappedFile>, rows: &[Row<'_>], level: u32, lives: &[u64]) -> Self {
        fn spread(rows: &[&Row<'_>], of: fn(&Row<'_>) -> f64) -> Option<Spread> {
            Spread::of(rows.iter().map(|row| of(row)))
        }
        let own: Vec<&Row<'_>> = rows.iter().filter(|row| row.record.level == level).collect();
        let groups: Vec<_> = file.groups().iter().filter(|group| group.level == level).collect();
        let record = &file.levels()[level as usize];
        let [acmr16, acmr24, acmr32] = std::array::from_fn(|cache| {
            by(own.iter().map(|row| row.page.misses[cache]).sum(), record.triangle_count)
        });

        LevelStats {
            level,
            clusters: record.cluster_count,
            triangles: spread(&own, |row| row.record.triangle_count.into()),
            total_triangles: record.triangle_count,
            base_triangles: spread(&own, |row| row.record.base_triangle_count.into()),
            coincident: own.iter().map(|row| row.page.coincident).sum(),
            shared: by(record.shared_vertex_count, record.vertex_count),
            border_levels: Spread::of_counts(lives),
            min_error: spread(&own, |row| row.record.min_error.into()),
            max_error: spread(&own, |row| row.record.max_error.into()),
            aspect: Spread::of(own.iter().filter_map(|row| row.aspect)),
            overlap: Spread::of(own.iter().filter_map(|row| row.overlap)),
            groups: groups.len() as u32,
            group_size: Spread::of(groups.iter().map(|group| group.coarse_count.into())),
            collapses: spread(&own, |row| row.collapses().into()),
            page_bytes: own.iter().map(|row| u64::from(row.record.page_len)).sum(),
            parts: parts(own.iter().copied()),
            acmr16,
            acmr24,
            acmr32,
            edge_span: by(own.iter().map(|row| row.page.span).sum(), 3 * record.triangle_count),
            sheets: SheetStats::of(file, &own),
            tightness: None,
        }
    }
}

/// Bytes by what they are for.
fn parts<'a>(rows: impl Iterator<Item = &'a Row<'a>>) -> Map<String, Value> {
    let mut sums = [0; PARTS.len()];
    rows.for_each(|row| sums.iter_mut().zip(row.page.parts).for_each(|(sum, bits)| *sum += bits));
    PARTS.iter().zip(sums).map(|(part, bits)| (part.replace(' ', "_"), (bits as f64 / 8.0).into())).collect()
}
