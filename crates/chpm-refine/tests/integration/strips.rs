//! A bumpy grid cut into strips, with a hierarchy of merged strips above. Collapses are chosen by a hash and only
//! among vertices inside a cluster, so borders and the outline stay; errors are made up, monotone and saturated.

use chpm_format::{
    BoundaryMode, Chpm, ChpmWriter, ClusterRecord, Gaps, GroupRecord, HeaderFields, LevelRecord, PageParts,
    Tables,
};
use chpm_mesh::{Aabb, Attributes, GroupId, Level, Sphere, VertexSlices};
use std::collections::{BTreeMap, BTreeSet};

/// Cells across a strip, and along it.
const WIDTH: u32 = 4;
const LENGTH: u32 = 8;

/// Hierarchy above the strips.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plan {
    pub(crate) strips: u32,
    /// The children of every cluster above the leaves; ids go on from those of the strips.
    merges: &'static [&'static [u32]],
    /// Coarse clusters of the groups that have several; all others have one.
    groups: &'static [&'static [u32]],
    mode: BoundaryMode,
}

/// A balanced tree.
pub(crate) const PAIRS: Plan =
    Plan { strips: 4, merges: &[&[0, 1], &[2, 3], &[4, 5]], groups: &[], mode: BoundaryMode::Lock };
/// The last strip is two levels below its parent.
pub(crate) const UNEVEN: Plan =
    Plan { strips: 3, merges: &[&[0, 1], &[2, 3]], groups: &[], mode: BoundaryMode::Lock };
/// No hierarchy at all: every leaf is a root.
pub(crate) const ROOTS: Plan = Plan { strips: 2, merges: &[], groups: &[], mode: BoundaryMode::Lock };
/// The two clusters in the middle of the tree split together.
pub(crate) const TWINS: Plan =
    Plan { strips: 4, merges: &[&[0, 1], &[2, 3], &[4, 5]], groups: &[&[4, 5]], mode: BoundaryMode::Lock };
/// The border between strips 1 and 2, which have different parents, is simplified on both sides alike.
pub(crate) const DEPENDENT: Plan = Plan {
    strips: 4,
    merges: &[&[0, 1], &[2, 3], &[4, 5]],
    groups: &[&[1, 2]],
    mode: BoundaryMode::Dependencies,
};
/// The same where the last strip is two levels below its parent: it outlasts the one that it depends on.
pub(crate) const LOPSIDED: Plan =
    Plan { strips: 3, merges: &[&[0, 1], &[2, 3]], groups: &[&[1, 2]], mode: BoundaryMode::Dependencies };
/// Both, on several levels: clusters below a group that splits together depend on clusters beside it.
pub(crate) const WOVEN: Plan = Plan {
    strips: 8,
    merges: &[&[0, 1], &[2, 3], &[4, 5], &[6, 7], &[8, 9], &[10, 11], &[12, 13]],
    groups: &[&[1, 2], &[5, 6], &[9, 10]],
    mode: BoundaryMode::Dependencies,
};
pub(crate) const ALL: [Plan; 5] = [PAIRS, UNEVEN, ROOTS, TWINS, DEPENDENT];
/// And the one with more cuts than can be counted by hand.
pub(crate) const MORE: [Plan; 6] = [PAIRS, UNEVEN, ROOTS, TWINS, DEPENDENT, WOVEN];

/// Triangles over the grid's own vertex numbers.
pub(crate) type Triangles = Vec<[u32; 3]>;
pub(crate) type File = Chpm<Vec<u8>>;

fn vertex(x: u32, y: u32) -> u32 {
    x * (LENGTH + 1) + y
}

pub(crate) fn position(vertex: u32) -> [f32; 3] {
    let (x, y) = (vertex / (LENGTH + 1), vertex % (LENGTH + 1));
    [x as f32, y as f32, (hash(vertex) % 100) as f32 / 128.0]
}

pub(crate) fn normal(vertex: u32) -> [f32; 3] {
    [0.0, vertex as f32, 1.0]
}

pub(crate) fn color(vertex: u32) -> [u8; 4] {
    [vertex as u8, (vertex >> 8) as u8, 7, 255]
}

fn hash(vertex: u32) -> u32 {
    let mixed = (vertex + 1).wrapping_mul(0x9e37_79b9);
    (mixed ^ (mixed >> 15)).wrapping_mul(0x85eb_ca6b) >> 8
}

/// The triangles of one strip.
pub(crate) fn strip(s: u32) -> Triangles {
    let cells = (s * WIDTH..(s + 1) * WIDTH).flat_map(|x| (0..LENGTH).map(move |y| (x, y)));
    cells
        .flat_map(|(x, y)| {
            let [a, b, c, d] = [(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)].map(|(x, y)| vertex(x, y));
            [[a, b, c], [a, c, d]]
        })
        .collect()
}

/// Directed edges of the grid's outline.
pub(crate) fn outline(plan: &Plan) -> BTreeSet<[u32; 2]> {
    boundary(&(0..plan.strips).flat_map(strip).collect::<Vec<_>>())
}

/// Directed edges whose reverse no triangle has.
pub(crate) fn boundary(triangles: &[[u32; 3]]) -> BTreeSet<[u32; 2]> {
    let edges: BTreeSet<_> = triangles.iter().flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]]).collect();
    edges.iter().filter(|[a, b]| !edges.contains(&[*b, *a])).copied().collect()
}

/// The border between strips `s - 1` and `s`.
fn border(s: u32) -> impl Iterator<Item = u32> {
    (0..=LENGTH).map(move |y| vertex(s * WIDTH, y))
}

/// A cluster while it is simplified.
struct Cluster {
    triangles: Triangles,
    base: Triangles,
    /// Who collapsed where, in order, with the error after it.
    collapses: Vec<(u32, u32, f32)>,
    min_error: f32,
    level: u32,
}

impl Cluster {
    fn new(triangles: Triangles, level: u32, min_error: f32) -> Self {
        Cluster { base: triangles.clone(), triangles, collapses: Vec::new(), min_error, level }
    }

    fn collapse(&mut self, from: u32, to: u32, unevenness: f32) {
        // Two and two collapses have the same error.
        let error = self.min_error + 0.25 * (self.collapses.len() / 2) as f32 + unevenness;
        self.collapses.push((from, to, error));
        self.base.iter_mut().flatten().filter(|v| **v == from).for_each(|v| *v = to);
        self.base.retain(|[a, b, c]| a != b && b != c && c != a);
    }

    /// Halves the triangles, by collapses of inner vertices to inner vertices that leave the mesh a manifold.
    fn simplify(&mut self, unevenness: f32) {
        let locked: BTreeSet<u32> = boundary(&self.base).into_iter().flatten().collect();
        let half = self.triangles.len() / 2;
        let mut inner: Vec<u32> =
            self.base.iter().flatten().copied().filter(|v| !locked.contains(v)).collect();
        inner.sort_unstable_by_key(|v| (hash(*v), *v));
        inner.dedup();
        while self.base.len() > half {
            let around = |v: u32| -> BTreeSet<u32> {
                self.base.iter().filter(|t| t.contains(&v)).flatten().copied().filter(|w| *w != v).collect()
            };
            let legal = |from: u32| {
                let ring = around(from);
                let inside = ring.iter().filter(|to| !locked.contains(to));
                let to = inside.copied().find(|to| ring.intersection(&around(*to)).count() == 2);
                to.map(|to| (from, to))
            };
            let Some((from, to)) = inner.iter().copied().find_map(legal) else { break };
            self.collapse(from, to, unevenness);
            inner.retain(|v| *v != from);
        }
    }

    /// Vertices in the order of the file: survivors, then collapsed ones, the first to go last.
    fn vertices(&self) -> Vec<u32> {
        let all: BTreeSet<u32> = self.triangles.iter().flatten().copied().collect();
        let gone: Vec<u32> = self.collapses.iter().rev().map(|(from, ..)| *from).collect();
        all.into_iter().filter(|v| !gone.contains(v)).chain(gone.iter().copied()).collect()
    }

    fn page(&self, shared: &BTreeMap<u32, u32>) -> Vec<u8> {
        let vertices = self.vertices();
        let local = |v: &u32| vertices.iter().position(|w| w == v).unwrap() as u16;
        let shared_id = |(v, id): (&u32, &u32)| vertices.contains(v).then(|| (local(v), *id));
        let mut shared: Vec<(u16, u32)> = shared.iter().filter_map(shared_id).collect();
        shared.sort_unstable();
        let parts = PageParts {
            vertices: VertexSlices {
                scalars: &[],
                positions: &vertices.iter().copied().map(position).collect::<Vec<_>>(),
                normals: &vertices.iter().copied().map(normal).collect::<Vec<_>>(),
                octahedral: &[],
                colors: &vertices.iter().copied().map(color).collect::<Vec<_>>(),
            },
            triangles: &self.triangles.iter().map(|t| t.each_ref().map(local)).collect::<Vec<_>>(),
            targets: &self.collapses.iter().rev().map(|(_, to, _)| local(to)).collect::<Vec<_>>(),
            errors: &self.collapses.iter().rev().map(|(.., error)| *error).collect::<Vec<_>>(),
            shared: &shared,
            min_error: self.min_error,
            scale_error: 0.0,
        };
        let mut page = Vec::new();
        parts.encode(&mut page).unwrap();
        page
    }
}

impl Plan {
    /// How many clusters are above the leaves, and whether some of them split together.
    pub(crate) fn merges_and_groups(&self) -> (usize, bool) {
        (self.merges.len(), self.groups.iter().any(|group| group[0] >= self.strips))
    }

    fn children(&self, cluster: u32) -> &'static [u32] {
        cluster.checked_sub(self.strips).map_or(&[], |merge| self.merges[merge as usize])
    }

    fn cluster_count(&self) -> u32 {
        self.strips + self.merges.len() as u32
    }

    /// Coarse clusters of every group, by their first one: children come before parents.
    fn coarse(&self) -> Vec<Vec<u32>> {
        let several = |cluster: u32| self.groups.iter().find(|group| group.contains(&cluster));
        let first = (0..self.cluster_count()).filter(|c| several(*c).is_none_or(|group| group[0] == *c));
        first.map(|c| several(c).map_or(vec![c], |group| group.to_vec())).collect()
    }

    /// Vertices that two clusters of one level have, with the shared id.
    fn shared(&self, cluster: u32) -> BTreeMap<u32, u32> {
        let strips = self.strips_of(cluster);
        let (first, last) = (strips[0], strips[strips.len() - 1] + 1);
        let outer = [first, last].into_iter().filter(|s| (1..self.strips).contains(s));
        let ids = |s: u32| border(s).zip((s - 1) * (LENGTH + 1)..);
        outer.flat_map(ids).collect()
    }

    fn strips_of(&self, cluster: u32) -> Vec<u32> {
        if cluster < self.strips {
            return vec![cluster];
        }
        let mut strips: Vec<u32> = self.children(cluster).iter().flat_map(|c| self.strips_of(*c)).collect();
        strips.sort_unstable();
        strips
    }

    pub(crate) fn build(&self) -> File {
        Chpm::open(self.bytes([0.0; 3])).unwrap()
    }

    /// A file whose errors grow towards the leaves and whose spheres do not nest.
    pub(crate) fn build_upside_down(&self) -> File {
        let tamper = |groups: &mut [GroupRecord]| {
            for group in groups {
                (group.min_error, group.radius) = (group.max_error / (1.0 + group.level as f32).powi(4), 0.5);
            }
        };
        Chpm::open(self.written([0.0; 3], tamper)).unwrap()
    }

    /// A file in which something vanishes in the middle of the collapses of every second group.
    pub(crate) fn build_with_gaps(&self) -> File {
        let file = self.build();
        let tamper = |groups: &mut [GroupRecord]| {
            for index in 0..groups.len() {
                let below = file.fine(GroupId(index as u32)).iter();
                let fine = below.map(|fine| groups[file.clusters()[*fine as usize].group as usize].gaps.base);
                let fine = fine.fold(0.0, f32::max);
                let group = &mut groups[index];
                // At the finest already, or half way; gaps below and above the error at which they begin.
                let at_once = index % 3 == 0 && !group.is_leaf();
                let from = if at_once { group.min_error } else { 0.5 * (group.min_error + group.max_error) };
                let more = [3.0, 0.0, 0.75, 0.0][index % 4] * group.max_error;
                group.gaps = Gaps { fine, base: fine + more, from };
            }
        };
        Chpm::open(self.written([0.0; 3], tamper)).unwrap()
    }

    /// The bytes of the file.
    pub(crate) fn bytes(&self, origin: [f64; 3]) -> Vec<u8> {
        self.written(origin, |_| ())
    }

    fn written(&self, origin: [f64; 3], tamper: impl Fn(&mut [GroupRecord])) -> Vec<u8> {
        let coarse = self.coarse();
        let group_of = |cluster: &u32| coarse.iter().position(|group| group.contains(cluster)).unwrap();
        let fine =
            |group: &[u32]| -> Vec<u32> { group.iter().flat_map(|c| self.children(*c)).copied().collect() };
        let parent = |cluster: &u32| coarse.iter().position(|group| fine(group).contains(cluster));

        let mut clusters: Vec<Cluster> = Vec::new();
        let mut pages: Vec<Vec<u8>> = Vec::new();
        let mut records: Vec<ClusterRecord> = Vec::new();
        for id in 0..self.cluster_count() {
            // All that the split of the group replaces is below its error.
            let below = fine(&coarse[group_of(&id)]);
            let siblings = below.iter().flat_map(|c| &coarse[group_of(c)]);
            let min_error = siblings.map(|c| records[*c as usize].max_error).fold(0.0, f32::max);
            let mut cluster = if id < self.strips {
                Cluster::new(strip(id), 0, 0.0)
            } else {
                let children = || self.children(id).iter().map(|c| &clusters[*c as usize]);
                let level = 1 + children().map(|c| c.level).max().unwrap();
                Cluster::new(children().flat_map(|c| c.base.clone()).collect(), level, min_error)
            };
            if self.mode == BoundaryMode::Dependencies && id < self.strips && coarse[group_of(&id)].len() == 2
            {
                // The border between the two, every second vertex along it: first in both, at equal errors.
                let middle = coarse[group_of(&id)][1] * WIDTH;
                (1..LENGTH)
                    .step_by(2)
                    .for_each(|y| cluster.collapse(vertex(middle, y), vertex(middle, y - 1), 0.0));
            }
            cluster.simplify(0.01 * id as f32);
            let page = cluster.page(&self.shared(id));
            let parent = parent(&id).map_or(GroupId::NONE, |group| GroupId(group as u32));
            let group = GroupId(group_of(&id) as u32);
            records.push(ClusterRecord::of_page(&page, Level(cluster.level), group, parent).unwrap());
            pages.push(page);
            clusters.push(cluster);
        }

        let (mut groups, mut members) = (Vec::<GroupRecord>::new(), Vec::new());
        for group in &coarse {
            let of = |field: fn(&ClusterRecord) -> f32| {
                group.iter().map(|c| field(&records[*c as usize])).fold(0.0, f32::max)
            };
            let mut bounds = Aabb::EMPTY;
            group.iter().for_each(|c| bounds.merge(&records[*c as usize].aabb()));
            let own = group.iter().map(|c| records[*c as usize].sphere());
            let fine = fine(group);
            let sphere =
                Sphere::around(&bounds, own.chain(fine.iter().map(|c| groups[group_of(c)].sphere())));
            groups.push(GroupRecord {
                coarse_first: members.len() as u32,
                coarse_count: group.len() as u32,
                fine_first: (members.len() + group.len()) as u32,
                fine_count: fine.len() as u32,
                level: records[group[0] as usize].level,
                flags: 0,
                min_error: of(|c| c.min_error),
                max_error: of(|c| c.max_error),
                center: sphere.center,
                radius: sphere.radius,
                gaps: Gaps::default(),
                rest: 0.0,
            });
            members.extend(group);
            members.extend(fine);
        }
        tamper(&mut groups);
        let levels = records.iter().map(|c| c.level).max().unwrap() + 1;
        let mut tables = Tables {
            header: HeaderFields {
                attributes: Attributes::ALL,
                source_vertex_count: u64::from((self.strips * WIDTH + 1) * (LENGTH + 1)),
                boundary_mode: self.mode,
                shared_vertex_count: (self.strips - 1) * (LENGTH + 1),
                origin,
                ..HeaderFields::default()
            },
            clusters: records,
            groups,
            members,
            levels: (0..levels).map(|level| LevelRecord { level, ..LevelRecord::default() }).collect(),
            ..Tables::default()
        };
        let mut writer = ChpmWriter::begin(Vec::new(), &mut tables).unwrap();
        pages.iter().for_each(|page| writer.page(page).unwrap());
        writer.finish().unwrap()
    }
}

/// The files are what a builder may write.
#[test]
fn the_files_are_right() {
    for plan in MORE {
        let report = chpm_format::verify(&plan.build(), |_, _| ());
        assert!(report.is_ok(), "{plan:?}: {:#?}", report.faults);
    }
}
