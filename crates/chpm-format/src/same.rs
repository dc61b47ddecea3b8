//! Whether two files hold the same, in whatever order and however packed.

use crate::error::FormatError;
use crate::page::Page;
use crate::reader::Chpm;
use crate::records::{ClusterRecord, GroupRecord, LevelRecord};
use crate::remnant::Remnant;
use crate::sheet::Sheet;
use crate::tables::known_gaps;
use chpm_mesh::{ClusterId, GroupId};
use std::collections::BTreeMap;
use std::fmt::Debug;
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

/// Differences that are told in full.
const TOLD: usize = 20;

/// Differences of two files' content; none if both have the same clusters, errors and groups, and with them the same cuts. The
/// order of clusters, groups, triangles and base vertices, how pages are stored, and provenance do not count.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Differences {
    /// The first of them, one a line.
    pub told: Vec<String>,
    /// How many there are.
    pub count: u64,
}

impl Differences {
    fn tell(&mut self, message: impl FnOnce() -> String) {
        self.count += 1;
        if self.told.len() < TOLD {
            self.told.push(message());
        }
    }

    fn compare<T: PartialEq + Debug>(&mut self, what: &str, [a, b]: [T; 2]) {
        if a != b {
            self.tell(|| format!("{what}: {a:?} here, {b:?} there"));
        }
    }
}

/// How much of two files is compared.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum Extent {
    /// All that they hold.
    #[default]
    All,
    /// Positions, triangles, collapses, errors and groups, whatever vertices have besides and whatever images show.
    Geometry,
}

/// Compares all content of two files. `progress` is told each cluster.
///
/// # Errors
/// The first page or sheet that is damaged.
pub fn compare<A: AsRef<[u8]>, B: AsRef<[u8]>>(
    here: &Chpm<A>,
    there: &Chpm<B>,
    progress: impl FnMut(),
) -> Result<Differences, FormatError> {
    compare_to(Extent::All, here, there, progress)
}

/// Compares so much of the content of two files.
///
/// # Errors
/// As [`compare`].
pub fn compare_to<A: AsRef<[u8]>, B: AsRef<[u8]>>(
    extent: Extent,
    here: &Chpm<A>,
    there: &Chpm<B>,
    mut progress: impl FnMut(),
) -> Result<Differences, FormatError> {
    let mut differences = Differences::default();
    let (a, b) = (here.header(), there.header());
    if extent == Extent::All {
        differences.compare("attributes", [a.attributes, b.attributes]);
        differences.compare("scalars", [here.scalars(), there.scalars()]);
        differences.compare("sheets", [a.has_sheets(), b.has_sheets()]);
    }
    differences.compare("vertices of the source", [a.source_vertex_count, b.source_vertex_count]);
    differences.compare("treatment of boundaries", [a.boundary_mode, b.boundary_mode]);
    differences.compare("meaning of errors", [a.error_kind, b.error_kind]);
    differences.compare("shared vertices", [a.shared_vertex_count, b.shared_vertex_count]);
    differences.compare("origin", [a.origin.map(f64::to_bits), b.origin.map(f64::to_bits)]);
    let levels = |records: &[LevelRecord]| -> Vec<LevelRecord> {
        // How many collapses were refused on the way depends on what vertices have besides.
        let bare = |level: &LevelRecord| LevelRecord { refusals: Default::default(), ..*level };
        records.iter().map(|level| if extent == Extent::All { *level } else { bare(level) }).collect()
    };
    differences.compare("levels", [levels(here.levels()), levels(there.levels())]);
    let (clusters_here, corners_here) = clusters(here, extent, &mut progress)?;
    let (clusters_there, corners_there) = clusters(there, extent, &mut progress)?;
    let groups = [groups(here, &clusters_here), groups(there, &clusters_there)];
    let remnants =
        [remnants(here, &clusters_here, &corners_here), remnants(there, &clusters_there, &corners_there)];
    compare_sets("cluster", [clusters_here, clusters_there], &mut differences);
    let [here, there] = groups;
    compare_sets("group", [here, there], &mut differences);
    compare_sets("remnant", remnants, &mut differences);
    Ok(differences)
}

/// Tells what only one of two has, by what it holds.
fn compare_sets(what: &str, [here, there]: [Vec<u128>; 2], differences: &mut Differences) {
    let mut counts: BTreeMap<u128, (i64, usize)> = BTreeMap::new();
    for (id, held) in here.iter().enumerate() {
        counts.entry(*held).or_insert((0, id)).0 += 1;
    }
    let mut only_there = Vec::new();
    for (id, held) in there.iter().enumerate() {
        match counts.get_mut(held) {
            Some((count, _)) if *count > 0 => *count -= 1,
            _ => only_there.push(id),
        }
    }
    let mut only_here: Vec<usize> = counts.values().filter(|left| left.0 > 0).map(|left| left.1).collect();
    only_here.sort_unstable();
    for id in only_here {
        differences.tell(|| format!("{what} {id} here has no equal there"));
    }
    for id in only_there {
        differences.tell(|| format!("{what} {id} there has no equal here"));
    }
}

/// Hash of each cluster's content, and names of each remnant's corners.
fn clusters<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    extent: Extent,
    progress: &mut impl FnMut(),
) -> Result<(Vec<u128>, Vec<[u64; 3]>), FormatError> {
    let (mut names, mut corners) = (Names::default(), Vec::new());
    let clusters = (0..)
        .map(ClusterId)
        .zip(file.clusters())
        .map(|(id, record)| {
            let page = file.page_checked(id)?;
            let mut hash = Xxh3::new();

            let mut alike = ClusterRecord {
                page_offset: 0,
                page_len: 0,
                page_checksum: 0,
                group: 0,
                parent_group: 0,
                flags: record.flags & ClusterRecord::TRIMMED,
                ..*record
            };
            if extent == Extent::Geometry {
                (alike.normal_deviation, alike.color_deviation) = (0.0, 0.0);
            }

            hash.update(bytemuck::bytes_of(&alike));
            names.give(&page.view(), extent);
            add_mesh(&page.view(), &mut names, &mut hash);
            if extent == Extent::All {
                add_attributes(&page.view(), &mut hash);
                if let Some(sheet) = file.sheet(id)? {
                    add_sheet(&page.view(), &names, &sheet, &mut hash);
                }
            }
            // They come by cluster.
            let left = file.remnants().get(corners.len()..).unwrap_or_default();
            let own = left.iter().take_while(|remnant| remnant.cluster() == id);
            corners.extend(own.map(|remnant| remnant.corners.map(|corner| names.of(corner))));
            progress();
            Ok(hash.digest128())
        })
        .collect::<Result<_, FormatError>>()?;
    Ok((clusters, corners))
}

/// Names of a page's vertices, whatever the order of those of the base mesh, which a hierarchy does not fix. Those of others are their numbers.
#[derive(Default)]
struct Names {
    all: Vec<u64>,
    /// The sum of what triangles say of each.
    around: Vec<u64>,
    triangles: Vec<[u64; 3]>,
}

impl Names {
    fn give(&mut self, page: &Page<'_>, extent: Extent) {
        let (base, words) = (page.base_vertex_count, usize::from(page.attributes().scalar_words));
        let mut ids = vec![u32::MAX; page.vertex_count()];
        page.shared().for_each(|(vertex, id)| ids[usize::from(vertex)] = id);
        self.all.clear();
        self.all.extend((0..base).map(|v| {
            let mut hash = Xxh3::new();
            hash.update(bytemuck::bytes_of(&page.positions[v]));
            hash.update(&ids[v].to_le_bytes());
            if extent == Extent::All {
                page.normals.get(v).into_iter().for_each(|n| hash.update(bytemuck::bytes_of(n)));
                page.octahedral.get(v).into_iter().for_each(|n| hash.update(bytemuck::bytes_of(n)));
                page.colors.get(v).into_iter().for_each(|color| hash.update(color));
                hash.update(bytemuck::cast_slice(&page.scalars[v * words..][..words]));
            }
            hash.digest()
        }));
        self.all.extend((base..page.vertex_count()).map(|v| v as u64));
        // Vertices of the same bits are told apart by the triangles that they are in.
        self.around.clear();
        self.around.resize(base, 0);
        for triangle in page.triangles {
            for i in 0..3 {
                let [own, next, last] = [0, 1, 2].map(|k| triangle[(i + k) % 3]);
                if let Some(around) = self.around.get_mut(usize::from(own)) {
                    let both = [self.all[usize::from(next)], self.all[usize::from(last)]];
                    *around = around.wrapping_add(xxh3_64(bytemuck::cast_slice(&both)));
                }
            }
        }
        for (name, around) in self.all.iter_mut().zip(&self.around) {
            *name = xxh3_64(bytemuck::cast_slice(&[*name, *around]));
        }
    }

    fn of(&self, vertex: u16) -> u64 {
        self.all[usize::from(vertex)]
    }

    /// A triangle, turned so that its least corner is the first.
    fn turned(&self, triangle: &[u16; 3]) -> [u64; 3] {
        let [a, b, c] = triangle.map(|corner| self.of(corner));
        [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap_or_default()
    }
}

/// Adds what vertices have that are not of the base mesh; those of that are named by it.
fn add_attributes(page: &Page<'_>, hash: &mut Xxh3) {
    let base = page.base_vertex_count;
    fn behind<T>(of: &[T], base: usize) -> &[T] {
        of.get(base..).unwrap_or_default()
    }
    hash.update(bytemuck::cast_slice(behind(page.normals, base)));
    hash.update(bytemuck::cast_slice(behind(page.octahedral, base)));
    hash.update(bytemuck::cast_slice(behind(page.colors, base)));
    hash.update(bytemuck::cast_slice(behind(
        page.scalars,
        base * usize::from(page.attributes().scalar_words),
    )));
}

/// Adds a sheet, whatever the order of triangles.
fn add_sheet(page: &Page<'_>, names: &Names, sheet: &Sheet<'_>, hash: &mut Xxh3) {
    let layout = &sheet.layout;
    let triangles = page.triangles.iter().map(|triangle| names.turned(triangle));
    let mut charted: Vec<([u64; 3], u16)> = triangles.zip(layout.chart_of.iter().copied()).collect();
    charted.sort_unstable();
    charted.iter().for_each(|(_, chart)| hash.update(&chart.to_le_bytes()));
    hash.update(bytemuck::bytes_of(&layout.origin));
    hash.update(bytemuck::cast_slice(&layout.charts));
    hash.update(bytemuck::bytes_of(&[sheet.record.codec, sheet.record.texel.to_bits()]));
    hash.update(sheet.image);
}

fn add_mesh(page: &Page<'_>, names: &mut Names, hash: &mut Xxh3) {
    let mut triangles = std::mem::take(&mut names.triangles);
    triangles.clear();
    triangles.extend(page.triangles.iter().map(|triangle| names.turned(triangle)));
    triangles.sort_unstable();
    hash.update(bytemuck::cast_slice(&triangles));
    names.triangles = triangles;
    let base = page.base_vertex_count;
    let mut of_base = names.all[..base].to_vec();
    of_base.sort_unstable();
    hash.update(bytemuck::cast_slice(&of_base));
    hash.update(bytemuck::cast_slice(&page.positions[base..]));
    let others = page.shared().filter(|(vertex, _)| usize::from(*vertex) >= base);
    others.for_each(|(vertex, id)| hash.update(bytemuck::cast_slice(&[u32::from(vertex), id])));
    page.targets.iter().for_each(|target| hash.update(&names.of(*target).to_le_bytes()));
    hash.update(bytemuck::cast_slice(page.error_codes));
    hash.update(bytemuck::bytes_of(&page.error_scale));
}

/// Hash of each remnant, with its cluster's content.
fn remnants<D: AsRef<[u8]>>(file: &Chpm<D>, clusters: &[u128], corners: &[[u64; 3]]) -> Vec<u128> {
    let hash = |(remnant, corners): (&Remnant, &[u64; 3])| {
        let mut hash = Xxh3::new();
        hash.update(bytemuck::bytes_of(&Remnant { cluster: 0, corners: [0; 3], ..*remnant }));
        hash.update(bytemuck::cast_slice(corners));
        hash.update(&clusters[remnant.cluster().index()].to_le_bytes());
        hash.digest128()
    };
    file.remnants().iter().zip(corners).map(hash).collect()
}

/// Hash of each group: of its clusters' content, and its own errors, gaps and sphere.
fn groups<D: AsRef<[u8]>>(file: &Chpm<D>, clusters: &[u128]) -> Vec<u128> {
    let mut held = Vec::new();
    (0..)
        .map(GroupId)
        .zip(file.groups())
        .map(|(id, record)| {
            let mut hash = Xxh3::new();
            let gaps = known_gaps(file, id);
            let alike = GroupRecord { coarse_first: 0, fine_first: 0, flags: 0, gaps, ..*record };
            hash.update(bytemuck::bytes_of(&alike));
            for members in [file.coarse(id), file.fine(id)] {
                held.clear();
                held.extend(members.iter().map(|cluster| clusters[*cluster as usize]));
                held.sort_unstable();
                hash.update(bytemuck::cast_slice(&held));
            }
            hash.digest128()
        })
        .collect()
}
