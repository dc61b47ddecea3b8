//! Simplifiers of the whole mesh in core.

use anyhow::{Result, ensure};
use chpm_measure::naive;
use chpm_mesh::TriMesh;
use chpm_qem::{Collapse, Decimator, Patch, Topology};
use meshopt::{SimplifyOptions, VertexDataAdapter};

/// meshopt, from the source to each number of triangles.
pub(super) fn by_meshopt(mesh: &TriMesh, limits: &[u64]) -> Result<Vec<TriMesh>> {
    let bytes = meshopt::typed_to_bytes(&mesh.positions);
    let vertices = VertexDataAdapter::new(bytes, 12, 0)?;
    let indices = mesh.triangles.as_flattened();
    Ok(limits
        .iter()
        .map(|limit| {
            let target = 3 * *limit as usize;
            let left = meshopt::simplify(indices, &vertices, target, f32::MAX, SimplifyOptions::None, None);
            TriMesh::new(mesh.positions.clone(), left.as_chunks().0.to_vec())
        })
        .collect())
}

/// The plain simplifier, on from each mesh to the next; `limits` fall.
pub(super) fn by_plain(mesh: &TriMesh, limits: &[u64]) -> Vec<TriMesh> {
    let mut last = TriMesh::new(mesh.positions.clone(), mesh.triangles.clone());
    let meshes = limits.iter().map(|limit| {
        last = naive::simplify(&last, *limit as usize, &[]);
        last.clone()
    });
    meshes.collect()
}

/// This project's kernel, in one run, with the whole mesh for a cluster.
pub(super) fn by_kernel(mesh: &TriMesh, limits: &[u64]) -> Result<Vec<TriMesh>> {
    let count = mesh.positions.len();
    ensure!(count <= super::KERNEL_VERTICES, "the kernel takes at most 65,535 vertices, not {count}");
    let triangles: Vec<[u16; 3]> = mesh.triangles.iter().map(|t| t.map(|v| v as u16)).collect();
    let locked = vec![false; count];
    let patch = Patch {
        positions: &mesh.positions,
        triangles: &triangles,
        locked: &locked,
        displacements: &[],
        ..Patch::default()
    };
    let mut kernel = Decimator::default();
    kernel.topology = Topology::Change;
    let target = limits.iter().copied().min().unwrap_or(0) as usize;
    let outcome = kernel.decimate(&patch, target, 0.0);
    let collapses = &outcome.collapses;
    let meshes = limits.iter().map(|limit| {
        let (mut low, mut high) = (0, collapses.len());
        while low < high {
            let middle = low + (high - low) / 2;
            let left = triangles_after(&collapses[..middle], &triangles, count).len();
            if left as u64 <= *limit { high = middle } else { low = middle + 1 }
        }
        TriMesh::new(mesh.positions.clone(), triangles_after(&collapses[..high], &triangles, count))
    });
    Ok(meshes.collect())
}

/// Triangles of a mesh of so many vertices after collapses.
fn triangles_after(collapses: &[Collapse], triangles: &[[u16; 3]], vertex_count: usize) -> Vec<[u32; 3]> {
    let mut ends: Vec<u16> = (0..vertex_count as u16).collect();
    // The last collapse first, so that where a vertex goes is known already.
    for collapse in collapses.iter().rev() {
        ends[usize::from(collapse.from)] = ends[usize::from(collapse.to)];
    }
    let moved = triangles.iter().map(|t| t.map(|v| ends[usize::from(v)]));
    let alive = moved.filter(|[a, b, c]| a != b && b != c && c != a);
    alive.map(|t| t.map(u32::from)).collect()
}
