//! meshopt's cluster hierarchy: its clusters, a file of them, and a cut of it.

use anyhow::Result;
use chpm_mesh::TriMesh;
use meshopt::VertexDataAdapter;
use meshopt::clusterlod::{ClodMesh, clod_build, clod_default_config};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Triangles of a cluster; its documentation's choice for rasterisation.
const CLUSTER: usize = 128;

/// A cluster with the error above which it is not there yet, and the one below which it is no longer.
struct Cluster {
    appears: f32,
    vanishes: f32,
    triangles: Vec<[u32; 3]>,
}

/// Positions, then for every cluster its bounds, its vertices' numbers and its triangles in bytes.
pub(super) fn write(mesh: &TriMesh, output: &Path) -> Result<()> {
    let positions = meshopt::typed_to_bytes(&mesh.positions);
    let vertices = VertexDataAdapter::new(positions, 12, 0)?;
    let mut out = BufWriter::with_capacity(1 << 20, File::create(output)?);
    out.write_all(positions)?;
    let mut written = Ok(());
    let mut groups = 0;
    let mut local = vec![u32::MAX; mesh.positions.len()];
    let source = ClodMesh::new(mesh.triangles.as_flattened(), &vertices);

    clod_build(clod_default_config(CLUSTER), &source, |_, clusters| {
        for cluster in clusters {
            let bounds = cluster.bounds;
            let mut bytes: Vec<u8> = Vec::with_capacity(cluster.indices.len() * 4);
            let [x, y, z] = bounds.center;
            for number in [x, y, z, bounds.radius, bounds.error] {
                bytes.extend(number.to_le_bytes());
            }
            let mut corners = Vec::with_capacity(cluster.indices.len());
            let mut count = 0;
            for v in cluster.indices {
                if local[*v as usize] == u32::MAX {
                    local[*v as usize] = count;
                    count += 1;
                    bytes.extend(v.to_le_bytes());
                }
                corners.push(local[*v as usize] as u8);
            }
            cluster.indices.iter().for_each(|v| local[*v as usize] = u32::MAX);
            bytes.extend(cluster.refined.to_le_bytes());
            bytes.extend(corners);
            if written.is_ok() {
                written = out.write_all(&bytes);
            }
        }
        groups += 1;
        groups - 1
    });

    written?;
    Ok(out.flush()?)
}

/// Meshes of the least error that have at most so many triangles, or of the fewest there are.
pub(super) fn meshes(mesh: &TriMesh, limits: &[u64]) -> Result<Vec<TriMesh>> {
    let vertices = VertexDataAdapter::new(meshopt::typed_to_bytes(&mesh.positions), 12, 0)?;
    let source = ClodMesh::new(mesh.triangles.as_flattened(), &vertices);
    let mut clusters = Vec::new();
    let mut errors: Vec<f32> = Vec::new();
    clod_build(clod_default_config(CLUSTER), &source, |group, of_group| {
        for cluster in of_group {
            let appears = usize::try_from(cluster.refined).map_or(0.0, |refined| errors[refined]);
            let triangles = cluster.indices.as_chunks().0.to_vec();
            clusters.push(Cluster { appears, vanishes: group.simplified.error, triangles });
        }
        errors.push(group.simplified.error);
        errors.len() as i32 - 1
    });
    let drawn = |bound: f32| clusters.iter().filter(move |c| c.appears <= bound && bound < c.vanishes);
    let count = |bound: f32| drawn(bound).map(|c| c.triangles.len() as u64).sum::<u64>();
    errors.push(0.0);
    errors.retain(|error| *error < f32::MAX);
    errors.sort_unstable_by(f32::total_cmp);
    Ok(limits
        .iter()
        .map(|limit| {
            let place = errors.partition_point(|error| count(*error) > *limit).min(errors.len() - 1);
            let triangles = drawn(errors[place]).flat_map(|c| &c.triangles).copied().collect();
            TriMesh::new(mesh.positions.clone(), triangles)
        })
        .collect())
}
