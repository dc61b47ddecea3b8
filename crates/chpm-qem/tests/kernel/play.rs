//! Decimates a plain mesh, and carries collapses out again without any of the kernel's structures.

use chpm_mesh::TriMesh;
use chpm_qem::{Collapse, Decimator, DroppedComponent, LastFace, Patch, Record, Refusal, Refusals, Topology};

/// A decimation's result and mesh.
#[derive(Debug)]
pub(crate) struct Run {
    pub(crate) collapses: Vec<Collapse>,
    pub(crate) triangle_count: usize,
    pub(crate) stalled: bool,
    pub(crate) refusals: Refusals,
    pub(crate) dropped: Vec<DroppedComponent>,
    pub(crate) last_faces: Vec<LastFace>,
    pub(crate) vanishing: f32,
    pub(crate) record: Record,
    pub(crate) mesh: TriMesh,
}

impl Run {
    pub(crate) fn refused(&self, refusal: Refusal) -> u64 {
        self.refusals.of(refusal)
    }

    pub(crate) fn max_error(&self) -> f32 {
        self.error_after(self.collapses.len())
    }

    /// The error after so many collapses.
    pub(crate) fn error_after(&self, steps: usize) -> f32 {
        self.collapses[..steps].last().map_or(0.0, |c| c.error)
    }

    /// How far the source is from the mesh after so many collapses, and the other way round: what vanished is as far as the nearest
    /// vertex of the last mesh.
    pub(crate) fn distance_after(&self, steps: usize) -> f32 {
        let error = self.error_after(steps);
        let drawn = self.mesh.triangles.as_flattened().iter().map(|v| *v as u16);
        let gap = || chpm_qem::gap(&self.dropped, &self.mesh.positions, drawn);
        if error < self.vanishing { error } else { error.max(gap()) }
    }
}

/// The triangles of a mesh in the kernel's indices.
pub(crate) fn local(mesh: &TriMesh) -> Vec<[u16; 3]> {
    mesh.triangles.iter().map(|t| t.map(|v| u16::try_from(v).expect("a small mesh"))).collect()
}

/// Any triangles over a few vertices, without those that have two corners in one; none if nothing is left.
pub(crate) fn any_mesh(corners: Vec<[u32; 3]>, positions: &[[i8; 3]]) -> Option<TriMesh> {
    let triangles: Vec<_> = corners.into_iter().filter(|[a, b, c]| a != b && b != c && c != a).collect();
    let positions = positions.iter().map(|p| p.map(f32::from)).collect();
    (!triangles.is_empty()).then(|| TriMesh::new(positions, triangles))
}

/// Decimates with a kernel that may have been used before.
pub(crate) fn run_with(
    decimator: &mut Decimator,
    mesh: &TriMesh,
    locked: &[bool],
    target: usize,
    min_error: f32,
) -> Run {
    let triangles = local(mesh);
    let patch = Patch {
        positions: &mesh.positions,
        triangles: &triangles,
        displacements: &[],
        locked,
        ..Patch::default()
    };
    let outcome = decimator.decimate(&patch, target, min_error);
    let mut record = Record::default();
    record.renumber(&patch, &outcome);
    Run {
        collapses: outcome.collapses.to_vec(),
        triangle_count: outcome.triangle_count,
        stalled: outcome.stalled,
        refusals: outcome.refusals,
        dropped: outcome.dropped.to_vec(),
        last_faces: outcome.last_faces.to_vec(),
        vanishing: outcome.vanishing,
        record,
        mesh: played(mesh, outcome.collapses),
    }
}

pub(crate) fn run(mesh: &TriMesh, locked: &[bool], target: usize) -> Run {
    run_with(&mut Decimator::default(), mesh, locked, target, 0.0)
}

/// Nothing locked, with or without changes of the topology.
pub(crate) fn run_in(topology: Topology, mesh: &TriMesh, target: usize) -> Run {
    let mut decimator = Decimator::default();
    decimator.topology = topology;
    run_with(&mut decimator, mesh, &vec![false; mesh.positions.len()], target, 0.0)
}

/// Nothing locked.
pub(crate) fn free(mesh: &TriMesh, target: usize) -> Run {
    run(mesh, &vec![false; mesh.positions.len()], target)
}

/// Where every vertex is after the collapses.
pub(crate) fn went(vertex_count: usize, collapses: &[Collapse]) -> Vec<u32> {
    let mut went: Vec<u32> = (0..vertex_count as u32).collect();
    for collapse in collapses.iter().rev() {
        // Later collapses come first, so the target already says where it ends.
        went[usize::from(collapse.from)] = went[usize::from(collapse.to)];
    }
    went
}

/// The mesh after the collapses, over the same vertices: every corner goes where its vertex went.
pub(crate) fn played(mesh: &TriMesh, collapses: &[Collapse]) -> TriMesh {
    let went = went(mesh.positions.len(), collapses);
    let moved = mesh.triangles.iter().map(|t| t.map(|v| went[v as usize]));
    let alive = moved.filter(|[a, b, c]| a != b && b != c && c != a).collect();
    TriMesh::new(mesh.positions.clone(), alive)
}

/// Corners of every triangle, sorted, in order.
pub(crate) fn corner_sets(mesh: &TriMesh) -> Vec<[u32; 3]> {
    let mut sets = mesh.triangles.clone();
    sets.iter_mut().for_each(|t| t.sort_unstable());
    sets.sort_unstable();
    sets
}
