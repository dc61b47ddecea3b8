//! Emit: the file, in one forward pass, published by rename.

use crate::config::Settings;
use crate::context::Context;
use crate::decompose::Decomposition;
use crate::error::BuildError;
use crate::hierarchy::Tree;
use crate::ingest::Source;
use crate::layout::Placed;
use crate::report::{LevelReport, Repairs};
use crate::simplify::Hierarchy;
use chpm_extmem::AtomicFile;
use chpm_format::{
    BoundaryMode, ChpmWriter, ClusterRecord, ErrorKind, GroupRecord, HeaderFields, LevelRecord, Metadata,
    Source as Provenance, Tables,
};
use chpm_mesh::{Attributes, GroupId, Sphere};

/// What the file says about its source, kept while the source's arrays are gone.
pub(crate) struct Facts {
    attributes: Attributes,
    origin: [f64; 3],
    used_vertices: u64,
    shared_vertices: u32,
    pub(crate) warnings: Vec<String>,
    pub(crate) provenance: Provenance,
}

impl Facts {
    pub(crate) fn of(source: &Source) -> Self {
        Facts {
            attributes: source.attributes(),
            origin: source.origin,
            used_vertices: 0,
            shared_vertices: 0,
            warnings: source.warnings.clone(),
            provenance: source.provenance.clone(),
        }
    }

    pub(crate) fn with_leaves(self, leaves: &Decomposition) -> Self {
        let shared = &leaves.shared;
        Facts { used_vertices: shared.used_vertices, shared_vertices: shared.len() as u32, ..self }
    }
}

/// What was written.
pub(crate) struct Written {
    pub(crate) len: u64,
    pub(crate) clusters: u32,
    pub(crate) roots: u32,
}

/// Writes the clusters in their order and publishes the file.
#[expect(clippy::too_many_arguments, reason = "the end of the pipeline: everything meets here once")]
pub(crate) fn run(
    out: AtomicFile,
    order: &[Placed],
    tree: &Tree,
    clusters: &Hierarchy,
    facts: &Facts,
    repairs: &Repairs,
    settings: &Settings,
    context: &Context<'_>,
) -> Result<Written, BuildError> {
    let (records, groups, members) = link(order, tree);
    let roots = records.iter().filter(|c| c.is_root()).count() as u32;
    let mut tables = Tables {
        header: HeaderFields {
            attributes: facts.attributes,
            source_vertex_count: facts.used_vertices,
            boundary_mode: BoundaryMode::Lock,
            error_kind: ErrorKind::Quadric,
            shared_vertex_count: facts.shared_vertices,
            origin: facts.origin,
        },
        clusters: records,
        groups,
        members,
        levels: clusters.levels.iter().map(level_record).collect(),
        metadata: Metadata {
            generator: concat!("chpm ", env!("CARGO_PKG_VERSION")).to_owned(),
            source: facts.provenance.clone(),
            settings: settings.describe(),
            repairs: repairs.describe(),
            warnings: facts.warnings.clone(),
        },
    };
    let mut writer = ChpmWriter::begin(out, &mut tables)?;
    let mut page = Vec::new();
    for cluster in order {
        context.check()?;
        let Some(place) = clusters.refs[cluster.node as usize] else { unreachable!("only built nodes are placed") };
        clusters.pages.read(place.offset, place.len as usize, &mut page)?;
        writer.page(&page)?;
        context.progress.advance(1);
    }
    let len = tables.file_len()?;
    writer.finish()?.publish()?;
    Ok(Written { len, clusters: order.len() as u32, roots })
}

/// Links clusters by groups. With locked boundaries every cluster is a group of its own, of the same number; boxes and
/// spheres are nested from the leaves up.
fn link(order: &[Placed], tree: &Tree) -> (Vec<ClusterRecord>, Vec<GroupRecord>, Vec<u32>) {
    let mut place = vec![u32::MAX; tree.nodes.len()];
    for (index, cluster) in order.iter().enumerate() {
        place[cluster.node as usize] = index as u32;
    }
    let placed = |node: Option<u32>| node.map(|n| place[n as usize]).filter(|p| *p != u32::MAX);
    let mut records: Vec<ClusterRecord> = order.iter().map(|c| c.record).collect();
    let mut bottom_up: Vec<u32> = (0..order.len() as u32).collect();
    bottom_up.sort_unstable_by_key(|c| order[*c as usize].node);
    for cluster in bottom_up {
        let node = &tree.nodes[order[cluster as usize].node as usize];
        let mut record = records[cluster as usize];
        record.group = cluster;
        record.parent_group = placed(node.parent).unwrap_or(GroupId::NONE.0);
        if let Some(children) = node.children {
            let children = children.map(|c| records[place[c as usize] as usize]);
            let mut bounds = record.aabb();
            children.iter().for_each(|c| bounds.merge(&c.aabb()));
            let sphere = Sphere::around(&bounds, children.iter().map(|c| c.sphere()));
            (record.aabb_min, record.aabb_max) = (bounds.min, bounds.max);
            (record.center, record.radius) = (sphere.center, sphere.radius);
        }
        records[cluster as usize] = record;
    }
    let mut members = Vec::new();
    let groups = (records.iter().enumerate())
        .map(|(cluster, record)| {
            let coarse_first = members.len() as u32;
            members.push(cluster as u32);
            let children = tree.nodes[order[cluster].node as usize].children;
            let fine_first = members.len() as u32;
            members.extend(children.into_iter().flatten().map(|c| place[c as usize]));
            GroupRecord {
                coarse_first,
                coarse_count: 1,
                fine_first,
                fine_count: members.len() as u32 - fine_first,
                level: record.level,
                flags: 0,
                min_error: record.min_error,
                max_error: record.max_error,
                center: record.center,
                radius: record.radius,
                reserved: [0; 16],
            }
        })
        .collect();
    (records, groups, members)
}

fn level_record(level: &LevelReport) -> LevelRecord {
    LevelRecord {
        level: level.level,
        stalled_cluster_count: level.stalled,
        refusals: level.refusals.0,
        ..LevelRecord::default()
    }
}
