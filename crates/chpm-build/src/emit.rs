//! Emit: the file, published by rename when it is whole. Establishes I10 and I11.

use crate::chain::{chain, close_up};
use crate::config::{GENERATOR, Settings};
use crate::context::Context;
use crate::decompose::Decomposition;
use crate::error::BuildError;
use crate::hierarchy::Tree;
use crate::ingest::{self, Source, SourceFacts};
use crate::output::OutputFiles;
use crate::report::{LevelReport, Repairs};
use crate::sheets::Sheets;
use crate::simplify::Clusters;
use crate::trim::Built;
use chpm_format::{
    ClusterRecord, ErrorKind, GroupRecord, HeaderFields, LATTICE_STEP, LevelRecord, Metadata, Remnant,
    Source as Provenance, Tables,
};
use chpm_mesh::{Aabb, Attributes, GroupId, Scalar, Sphere};
use serde::{Deserialize, Serialize};

/// Facts of a source once it was read.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(crate) struct Known {
    pub(crate) facts: Facts,
    pub(crate) repairs: Repairs,
}

/// Facts that the file stores about its source, kept while the source's arrays are gone.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(crate) struct Facts {
    pub(crate) triangles: u64,
    attributes: Attributes,
    origin: [f64; 3],
    pub(crate) lattice_step: Option<f64>,
    used_vertices: u64,
    shared_vertices: u32,
    scalars: Vec<Scalar>,
    /// Images whose texels became colours, if that is where these come from.
    pub(crate) images: Option<u64>,
    /// Triangles of a leaf, where texels made them fewer than was asked for.
    leaf_triangles: Option<u32>,
    pub(crate) warnings: Vec<String>,
    pub(crate) provenance: Provenance,
}

impl Facts {
    pub(crate) fn of(source: &Source) -> Self {
        let SourceFacts {
            origin, lattice_step, scalars, images, leaf_triangles, warnings, provenance, ..
        } = &source.facts;
        Facts {
            triangles: source.triangles.len() as u64,
            attributes: source.vertices.attributes(),
            origin: *origin,
            lattice_step: *lattice_step,
            used_vertices: 0,
            shared_vertices: 0,
            scalars: scalars.clone(),
            images: *images,
            leaf_triangles: *leaf_triangles,
            warnings: warnings.clone(),
            provenance: provenance.clone(),
        }
    }

    /// The settings, with the triangles of a leaf that there are to be.
    pub(crate) fn settled(&self, settings: &Settings) -> Settings {
        let mut settled = settings.clone();
        settled.cluster_triangles = self.leaf_triangles.unwrap_or(settled.cluster_triangles);
        settled
    }

    pub(crate) fn add_leaves(&mut self, leaves: &Decomposition) {
        // Copies of triangles have been left out.
        self.triangles = leaves.triangle_count();
        let shared = &leaves.shared;
        (self.used_vertices, self.shared_vertices) = (shared.used_vertices, shared.len() as u32);
    }
}

/// Output of the last stage.
pub(crate) struct Written {
    pub(crate) len: u64,
    pub(crate) clusters: u32,
    pub(crate) roots: u32,
}

/// The file while it is written. The lengths of the pages are known from the start and decide where each goes, so that
/// pages are written as they come, from many threads; the tables follow, and then the file gets its name.
pub(crate) struct Output<'a> {
    out: OutputFiles,
    tables: Tables,
    /// Of each page, by the length that it has before it is packed with others.
    places: Vec<u64>,
    order: &'a [u32],
    tree: &'a Tree,
    end: u64,
}

impl<'a> Output<'a> {
    /// Places the pages of the nodes in `order`, and writes their sheets.
    pub(crate) fn begin(
        mut out: OutputFiles,
        order: &'a [u32],
        built: &'a Built,
        known: &Known,
        sheets: Option<&Sheets>,
        settings: &Settings,
    ) -> Result<Self, BuildError> {
        let Built { tree, clusters, trimmed } = built;
        let facts = &known.facts;
        let remnants = clusters.remnant_count();
        let (groups, members) = link_groups(order, tree, clusters, remnants > 0);
        let placed =
            |node: &u32| ClusterRecord { page_len: clusters.page(*node).len, ..ClusterRecord::default() };
        let (vertices, shared) = match trimmed {
            Some(trimmed) => (trimmed.vertex_count, trimmed.shared_count),
            None => (facts.used_vertices, facts.shared_vertices),
        };

        // Records of clusters are empty but for the lengths of their pages, which is what offsets take.
        let mut tables = Tables {
            header: HeaderFields {
                attributes: ingest::kept(facts.attributes, settings),
                source_vertex_count: vertices,
                boundary_mode: settings.boundary,
                error_kind: ErrorKind::Certified,
                shared_vertex_count: shared,
                origin: facts.origin,
                packed: settings.packed,
                chained: settings.is_chained(),
                chunked: true,
                volume_size: settings.volumes.size(),
            },
            clusters: order.iter().map(placed).collect(),
            groups,
            members,
            levels: clusters.levels.iter().map(level_record).collect(),
            metadata: metadata(known, settings),
            scalars: facts.scalars.clone(),
            // Their number alone is known.
            remnants: vec![Remnant::default(); remnants],
            sheets: sheets
                .map_or_else(Vec::new, |sheets| order.iter().map(|node| sheets.record(*node)).collect()),
        };

        let len = tables.assign_offsets()?;
        let place_of = out.places(&tables)?;
        let places = tables.clusters.iter().map(|record| place_of(record.page_offset)).collect();
        // The last byte is there, and whatever is behind it begins there.
        let end = place_of(len - 1) + 1;
        out.make_room(end)?;
        if let Some(sheets) = sheets {
            let (first, mut bytes) = (tables.first_sheet_offset()?, Vec::new());
            for (node, record) in order.iter().zip(&tables.sheets) {
                sheets.read(*node, &mut bytes)?;
                out.write_all_at(&bytes, place_of(first + record.offset))?;
            }
        }
        Ok(Output { out, tables, places, order, tree, end })
    }

    /// Writes the page of the cluster at `place` in the order.
    pub(crate) fn write_page(&self, place: usize, payload: &[u8]) -> Result<(), BuildError> {
        self.out.write_all_at(payload, self.places[place])
    }

    /// Writes the tables and publishes the file.
    pub(crate) fn finish(
        mut self,
        records: Vec<(ClusterRecord, Vec<Remnant>)>,
        context: &Context<'_>,
    ) -> Result<Written, BuildError> {
        self.tables.remnants.clear();
        for (cluster, (_, remnants)) in (0..).zip(&records) {
            self.tables.remnants.extend(remnants.iter().map(|remnant| Remnant { cluster, ..*remnant }));
        }
        self.tables.clusters = records.into_iter().map(|(record, _)| record).collect();
        let check = || context.check();
        if self.tables.header.chained {
            self.places = chain(&mut self.out, &mut self.tables, &self.places, self.end, check)?;
        }
        if self.tables.header.packed {
            close_up(&self.out, &mut self.tables, &self.places, check)?;
        }
        nest(&mut self.tables, self.order, self.tree);
        let roots = self.tables.clusters.iter().filter(|c| c.is_root()).count() as u32;
        let len = self.out.publish(&mut self.tables)?;
        Ok(Written { len, clusters: self.order.len() as u32, roots })
    }
}

/// The provenance section.
fn metadata(known: &Known, asked: &Settings) -> Metadata {
    let Known { facts, repairs } = known;
    let mut settings = asked.describe();
    settings.extend(facts.lattice_step.map(|step| (LATTICE_STEP.to_owned(), step.to_string())));
    settings
        .extend(facts.leaf_triangles.map(|count| (Settings::LEAF_TRIANGLES.to_owned(), count.to_string())));
    let texture = asked.of_images();
    settings.extend(facts.images.map(|_| texture.map(str::to_owned).into()));
    Metadata {
        generator: GENERATOR.to_owned(),
        source: facts.provenance.clone(),
        settings,
        repairs: repairs.describe(),
        warnings: facts.warnings.clone(),
    }
}

/// Place in the file by node of the tree.
fn places(order: &[u32], tree: &Tree) -> Vec<Option<u32>> {
    let mut places = vec![None; tree.nodes.len()];
    for (place, node) in order.iter().enumerate() {
        places[*node as usize] = Some(place as u32);
    }
    places
}

/// The dependency groups with the places of their coarse and fine clusters: the fine ones are the members' children. All members have the
/// group's gaps.
fn link_groups(
    order: &[u32],
    tree: &Tree,
    clusters: &Clusters,
    has_remnants: bool,
) -> (Vec<GroupRecord>, Vec<u32>) {
    let places = places(order, tree);
    let mut members = Vec::new();

    let groups = (clusters.groups.iter())
        .map(|group| {
            let coarse_first = members.len() as u32;
            members.extend(group.iter().filter_map(|n| places[*n as usize]));
            let fine_first = members.len() as u32;
            let children = group.iter().flat_map(|n| tree.children(*n));
            members.extend(children.filter_map(|c| places[*c as usize]));
            GroupRecord {
                coarse_first,
                coarse_count: fine_first - coarse_first,
                fine_first,
                fine_count: members.len() as u32 - fine_first,
                gaps: clusters.page(group[0]).gaps,
                rest: if has_remnants { clusters.page(group[0]).rest } else { 0.0 },
                ..GroupRecord::default()
            }
        })
        .collect();

    (groups, members)
}

/// Completes records and groups from the leaves up: boxes and spheres hold all that lies below, errors never fall.
fn nest(tables: &mut Tables, order: &[u32], tree: &Tree) {
    let places = places(order, tree);
    let Tables { clusters, groups, members, .. } = tables;
    for index in 0..groups.len() {
        let mut group = groups[index];
        fn range(first: u32, count: u32) -> std::ops::Range<usize> {
            first as usize..(first + count) as usize
        }

        // Groups go up the tree, so that those of the fine clusters are complete.
        let mut bounds = Aabb::EMPTY;
        let mut spheres = Vec::new();
        for fine in &members[range(group.fine_first, group.fine_count)] {
            let record = &mut clusters[*fine as usize];
            record.parent_group = index as u32;
            let below = &groups[record.group as usize];
            bounds.merge(&record.aabb());
            spheres.push(below.sphere());
        }

        for coarse in &members[range(group.coarse_first, group.coarse_count)] {
            let children = tree.children(order[*coarse as usize]).iter();
            let children = children.filter_map(|c| places[*c as usize]);
            let mut record = clusters[*coarse as usize];
            enclose(&mut record, children.map(|c| clusters[c as usize]));
            record.group = index as u32;
            record.parent_group = GroupId::NONE.0;
            clusters[*coarse as usize] = record;
            bounds.merge(&record.aabb());
            spheres.push(record.sphere());
            group.level = record.level;
            group.min_error = group.min_error.max(record.min_error);
            group.max_error = group.max_error.max(record.max_error);
        }

        let sphere = Sphere::around(&bounds, spheres);
        (group.center, group.radius) = (sphere.center, sphere.radius);
        groups[index] = group;
    }
}

/// Lets a cluster's box and sphere hold its children's.
fn enclose(record: &mut ClusterRecord, children: impl Iterator<Item = ClusterRecord> + Clone) {
    if children.clone().next().is_none() {
        return;
    }
    let mut bounds = record.aabb();
    children.clone().for_each(|c| bounds.merge(&c.aabb()));
    let sphere = Sphere::around(&bounds, children.map(|c| c.sphere()));
    (record.aabb_min, record.aabb_max) = (bounds.min, bounds.max);
    (record.center, record.radius) = (sphere.center, sphere.radius);
}

fn level_record(level: &LevelReport) -> LevelRecord {
    LevelRecord {
        level: level.level,
        stalled_cluster_count: level.stalled,
        forced_collapse_count: level.forced.min(u64::from(u32::MAX)) as u32,
        refusals: level.refusals.0,
        ..LevelRecord::default()
    }
}
