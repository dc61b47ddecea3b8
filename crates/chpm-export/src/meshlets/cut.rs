//! A mesh cut into meshlets.

use crate::error::ExportError;
use chpm_mesh::Aabb;
use meshopt::VertexDataAdapter;

/// How much directions of triangles count beside nearness when a meshlet grows: some, so that cones can cull.
const CONE_WEIGHT: f32 = 0.25;

/// One meshlet.
pub(super) struct Meshlet {
    /// Its vertices, by their numbers in the mesh.
    pub(super) vertices: Vec<u32>,
    /// Corners of its triangles, by their numbers among these.
    pub(super) triangles: Vec<[u8; 3]>,
}

/// Cuts a mesh into meshlets of up to `limit` triangles and as many vertices; every triangle is in one.
pub(super) fn cut(
    positions: &[[f32; 3]],
    triangles: &[[u32; 3]],
    limit: u32,
) -> Result<Vec<Meshlet>, ExportError> {
    if triangles.is_empty() {
        return Ok(Vec::new());
    }
    let failed = |reason| ExportError::Meshlets { triangles: triangles.len(), reason };
    let positions = of_unit_size(positions);
    let adapter = VertexDataAdapter::new(bytemuck::cast_slice(&positions), 12, 0);
    let adapter = adapter.map_err(|error| failed(error.to_string()))?;
    let limit = limit as usize;
    let made = meshopt::build_meshlets(triangles.as_flattened(), &adapter, limit, limit, CONE_WEIGHT);
    let meshlets: Vec<Meshlet> = made
        .iter()
        .map(|meshlet| Meshlet {
            vertices: meshlet.vertices.to_vec(),
            triangles: meshlet.triangles.as_chunks().0.to_vec(),
        })
        .collect();

    // Of a library whose work nobody sees again.
    let count: usize = meshlets.iter().map(|meshlet| meshlet.triangles.len()).sum();
    let fits = meshlets.iter().all(|m| m.triangles.len() <= limit && m.vertices.len() <= limit);
    if count != triangles.len() || !fits {
        return Err(failed(format!("{count} came back")));
    }
    Ok(meshlets)
}

/// Positions from 0 to 1, whose distances are neither too large nor too small for single precision.
fn of_unit_size(positions: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let bounds = Aabb::of_points(positions);
    let [low, high] = [bounds.min, bounds.max].map(|corner| corner.map(f64::from));
    let size = [0, 1, 2].map(|axis| high[axis] - low[axis]).into_iter().fold(f64::MIN_POSITIVE, f64::max);
    let place =
        |position: &[f32; 3]| [0, 1, 2].map(|axis| ((f64::from(position[axis]) - low[axis]) / size) as f32);
    positions.iter().map(place).collect()
}
