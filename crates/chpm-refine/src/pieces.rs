//! A mesh in pieces of few vertices.

use chpm_mesh::{TriMesh, VertexSlices, Vertices};

/// Hands a mesh to `sink` in runs of triangles, each with the vertices that it has, by first use; at most `limit` and two more.
///
/// # Errors
/// What `sink` answers.
pub fn pieces<E>(
    mesh: &TriMesh,
    limit: usize,
    mut sink: impl FnMut(VertexSlices<'_>, &[[u32; 3]]) -> Result<(), E>,
) -> Result<(), E> {
    const NONE: u32 = u32::MAX;
    let mut local = vec![NONE; mesh.positions.len()];
    let (mut used, mut triangles) = (Vec::<usize>::new(), Vec::<[u32; 3]>::new());
    let mut vertices = Vertices::default();
    let last = mesh.triangles.len().saturating_sub(1);
    for (at, corners) in mesh.triangles.iter().enumerate() {
        triangles.push(corners.map(|vertex| {
            let place = &mut local[vertex as usize];
            if *place == NONE {
                *place = used.len() as u32;
                used.push(vertex as usize);
            }
            *place
        }));
        if used.len() + 3 > limit || at == last {
            vertices.clear_vertices();
            vertices.gather(mesh.view(), used.iter().copied());
            sink(vertices.view(), &triangles)?;
            triangles.clear();
            used.drain(..).for_each(|vertex| local[vertex] = NONE);
        }
    }
    Ok(())
}
