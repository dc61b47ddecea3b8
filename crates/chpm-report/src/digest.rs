//! A file in a few facts and remarks: how big, how good, and where to look further. All of it from the tables.

use crate::{LevelRow, Short};
use chpm_format::{Chpm, Metadata, SectionKind};
use chpm_mesh::{ClusterId, Counted, GroupId, Level};
use chpm_refine::{Cut, Member};

/// Largest share of the triangles of the level below that still counts as halved.
const HALVED: f64 = 0.6;
/// Shared vertices among those of a level, from which on borders are a burden.
const SHARED: f64 = 0.4;
/// Components, from which on many of them may be dust.
const DUST: u64 = 100;
/// Triangles of a coarsest mesh that anything can draw.
const TOP: u64 = 1000;

/// Where the bytes of a file are.
#[derive(Clone, Copy, Debug)]
pub struct Sizes {
    /// The whole file, with its volumes if it has any.
    pub file: u64,
    /// Everything but pages and sheets.
    pub tables: u64,
    /// Sheets, with what lies between them.
    pub sheets: u64,
    /// Of the tables: what tells chunks of them.
    pub chunks: u64,
    /// Pages without what lies between them.
    pub pages: u64,
    /// Zeros between pages.
    pub padding: u64,
}

impl Sizes {
    /// Those of a file.
    pub fn of<D: AsRef<[u8]>>(file: &Chpm<D>) -> Self {
        let pages: u64 = file.clusters().iter().map(|cluster| u64::from(cluster.page_len)).sum();
        let (mut padded, mut chunks, mut sheets) = (pages, 0, 0);
        for (kind, range) in file.sections() {
            match kind {
                SectionKind::Pages => padded = range.len() as u64,
                SectionKind::Chunks => chunks = range.len() as u64,
                SectionKind::Texels => sheets = range.len() as u64,
                _ => {}
            }
        }
        let whole = file.stored_len();
        let tables = whole - padded - sheets;
        Sizes { file: whole, tables, sheets, chunks, pages, padding: padded - pages }
    }
}

/// A mesh that a file can draw as it is: all clusters of a level at their finest, or the roots at their coarsest.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Drawable {
    /// None for the coarsest.
    pub level: Option<u32>,
    /// Its clusters.
    pub clusters: u64,
    /// Its triangles.
    pub triangles: u64,
    /// The largest distance from the source.
    pub distance: f64,
}

/// The meshes of a file from the finest to the coarsest, as `extract --level` has them.
pub fn drawables<D: AsRef<[u8]>>(file: &Chpm<D>) -> Vec<Drawable> {
    let levels = 0..file.header().level_count;
    let mut meshes: Vec<Drawable> =
        levels.map(|level| drawable(file, Some(level), &Cut::at_level(file, Level(level)))).collect();
    let roots = file.roots().map(|cluster| {
        let vertices = file.clusters()[cluster.index()].base_vertex_count;
        Member { cluster, vertices }
    });
    meshes.push(drawable(file, None, &Cut::new(roots.collect())));
    meshes
}

fn drawable<D: AsRef<[u8]>>(file: &Chpm<D>, level: Option<u32>, cut: &Cut) -> Drawable {
    let mut mesh = Drawable { level, clusters: cut.members().len() as u64, triangles: 0, distance: 0.0 };
    for member in cut.members() {
        let record = &file.clusters()[member.cluster.index()];
        let is_base = member.vertices == record.base_vertex_count;
        let error = if is_base { record.max_error } else { record.min_error };
        mesh.triangles += u64::from(if is_base { record.base_triangle_count } else { record.triangle_count });
        mesh.distance = mesh.distance.max(file.gaps(record.group()).distance(error).into());
    }
    mesh
}

/// Where the normals are from, if there are any: the source or the build.
pub fn normals_from<D: AsRef<[u8]>>(file: &Chpm<D>, metadata: Option<&Metadata>) -> Option<&'static str> {
    let computed = ("normals".to_owned(), "computed".to_owned());
    let is_computed = metadata.is_some_and(|metadata| metadata.settings.contains(&computed));
    file.header().attributes().has_normals().then_some(if is_computed { "computed" } else { "source" })
}

/// Remarks on what is not as it should be, and where to look further.
pub fn remarks<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    metadata: Option<&Metadata>,
    levels: &[LevelRow],
) -> Vec<String> {
    let mut remarks = Vec::new();
    for [below, level] in levels.array_windows() {
        let ratio = level.triangles as f64 / below.triangles.max(1) as f64;
        // Where nearly nothing is left there is nothing to halve.
        if ratio > HALVED && level.triangles > TOP {
            let share = 100.0 * ratio;
            remarks.push(format!(
                "level {} keeps {share:.0} % of the triangles below it: --refusals tells why",
                level.level
            ));
        }
    }
    remarks.truncate(3);
    let shared = levels.iter().find(|level| level.shared_vertices as f64 > SHARED * level.vertices as f64);
    if let Some(level) = shared {
        let share = 100.0 * level.shared_vertices as f64 / level.vertices as f64;
        remarks.push(format!(
            "{share:.0} % of the vertices of level {} are shared: larger --cluster-triangles have fewer",
            level.level
        ));
    }
    let top: u64 = file
        .roots()
        .map(|root: ClusterId| u64::from(file.clusters()[root.index()].base_triangle_count))
        .sum();
    if top > TOP {
        remarks.push(format!(
            "the coarsest mesh has {}, of {}",
            Short(top).of("triangle"),
            Counted(file.header().root_count.into(), "root")
        ));
    }
    let stalled: u64 = levels.iter().map(|level| u64::from(level.stalled_clusters)).sum();
    if 50 * stalled > u64::from(file.header().cluster_count) {
        remarks.push(format!("{} kept more triangles than half: --levels", Short(stalled).of("cluster")));
    }
    let mut repairs = metadata.iter().flat_map(|metadata| &metadata.repairs);
    if let Some((_, pieces)) = repairs.find(|(name, pieces)| name == "components" && *pieces > DUST) {
        let pieces = Short(*pieces).of("piece");
        remarks.push(format!("{pieces} that lie apart: if it is dust, --min-component leaves it out"));
    }
    if file.is_trimmed() {
        remarks.push("detail of the source was left out when it was built: --settings".to_owned());
    }
    remarks
}

/// A sentence on what is as it should be.
pub fn praise<D: AsRef<[u8]>>(file: &Chpm<D>, levels: &[LevelRow]) -> String {
    let ratios = levels
        .array_windows()
        .map(|[below, level]| 100.0 * level.triangles as f64 / below.triangles.max(1) as f64);
    let (least, most) =
        ratios.fold((f64::INFINITY, 0.0_f64), |(least, most), ratio| (least.min(ratio), most.max(ratio)));
    let shared =
        levels.iter().map(|level| 100.0 * level.shared_vertices as f64 / level.vertices.max(1) as f64);
    let shared = shared.fold(0.0, f64::max);
    let top: u64 =
        file.roots().map(|root| u64::from(file.clusters()[root.index()].base_triangle_count)).sum();
    let top = Short(top).of("triangle");
    if levels.len() < 2 {
        return format!("one level down to {top}");
    }
    let ratio = match (format!("{least:.0}"), format!("{most:.0}")) {
        (least, most) if least == most => least,
        (least, most) => format!("{least} to {most}"),
    };
    format!(
        "each level has {ratio} % of the triangles below it, down to {top}; at most {shared:.0} % of the vertices are shared"
    )
}

/// The largest distance of any mesh of the file to the source; unknown where it does not tell what has vanished.
pub fn max_distance<D: AsRef<[u8]>>(file: &Chpm<D>) -> Option<f32> {
    let gaps = (0..file.groups().len() as u32).map(|id| file.gaps(GroupId(id)).base);
    // The largest number is written where a file of before has told nothing.
    let distance = gaps.fold(file.header().max_error, f32::max);
    (file.has_gaps() && distance < f32::MAX).then_some(distance)
}

/// Kind of the file's errors, in a word.
pub fn error_kind<D: AsRef<[u8]>>(file: &Chpm<D>) -> String {
    file.header().error_kind().map_or_else(|| "unknown".to_owned(), |kind| kind.to_string())
}

/// How borders between clusters were simplified, in a word.
pub fn boundary<D: AsRef<[u8]>>(file: &Chpm<D>) -> String {
    file.header().boundary_mode().map_or_else(|| "unknown".to_owned(), |mode| mode.to_string())
}
