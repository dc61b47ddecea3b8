//! Normals of tiles of a file that has none. A vertex that several clusters share gets the source's normal there, the same in all tiles of all levels that
//! have it as a shared one, so that light has no seam between tiles of any cut; another gets that of its own tile's triangles.

use crate::error::ExportError;
use chpm_format::{Chpm, Page};
use chpm_mesh::{ClusterId, TriMesh, geom};
use rayon::prelude::*;

/// Normals of shared vertices, by shared id; not of length 1.
pub struct SharedNormals(Vec<[f32; 3]>);

/// Leaves that are read side by side, for each thread.
const BATCH: usize = 4;

impl SharedNormals {
    /// Bytes that they take.
    pub fn memory<D>(file: &Chpm<D>) -> u64
    where
        D: AsRef<[u8]>,
    {
        12 * u64::from(file.header().shared_vertex_count)
    }

    /// Reads all leaves, on all threads; `begun` is told each and may end it.
    ///
    /// # Errors
    /// [`ExportError::Format`] for a damaged page; what `begun` answers.
    pub fn find<D: AsRef<[u8]> + Sync, E: From<ExportError> + Send>(
        file: &Chpm<D>,
        begun: impl Fn(ClusterId) -> Result<(), E> + Sync,
    ) -> Result<Self, E> {
        let mut sums = vec![[0.0; 3]; file.header().shared_vertex_count as usize];
        let all = (0..file.clusters().len() as u32).map(ClusterId);
        let leaves: Vec<ClusterId> = all.filter(|id| file.clusters()[id.index()].is_leaf()).collect();
        // Relative to the model, so that no area is too small for single precision.
        let scale = file.header().aabb().diagonal().max(f64::from(f32::MIN_POSITIVE)).powi(-2);
        for some in leaves.chunks(BATCH * rayon::current_num_threads()) {
            let shares: Vec<Vec<(u32, [f32; 3])>> = some
                .par_iter()
                .map(|leaf| {
                    begun(*leaf)?;
                    Ok(of_leaf(file, *leaf, scale)?)
                })
                .collect::<Result<_, E>>()?;
            // In the order of the file, for any number of threads.
            for (id, share) in shares.into_iter().flatten() {
                let sum: &mut [f32; 3] = &mut sums[id as usize];
                *sum = [0, 1, 2].map(|axis| sum[axis] + share[axis]);
            }
        }
        Ok(SharedNormals(sums))
    }

    /// The normals of a leaf's vertices, none of length 1; zero where there is none.
    pub fn of_leaf(&self, page: &Page<'_>) -> Vec<[f64; 3]> {
        let corners: Vec<[u32; 3]> = page.triangles.iter().map(|corners| corners.map(u32::from)).collect();
        let mut normals = sums(page.vertices.positions, &corners);
        for (local, id) in shared(page) {
            normals[local] = self.0[id as usize].map(f64::from);
        }
        normals
    }

    /// Gives a tile's mesh its normals; `used` has the page's index of each of its vertices.
    pub(super) fn give(&self, page: &Page<'_>, used: &[usize], mesh: &mut TriMesh) {
        let mut normals = sums(&mesh.positions, &mesh.triangles);
        let mut shared = shared(page).peekable();
        for (normal, vertex) in normals.iter_mut().zip(used) {
            while shared.next_if(|(local, _)| local < vertex).is_some() {}
            if let Some((_, id)) = shared.next_if(|(local, _)| local == vertex) {
                *normal = self.0[id as usize].map(f64::from);
            }
        }
        let unit = |normal: [f64; 3]| {
            let length = normal.iter().map(|x| x * x).sum::<f64>().sqrt();
            if length > 0.0 { normal.map(|x| (x / length) as f32) } else { [0.0, 0.0, 1.0] }
        };
        mesh.normals = normals.into_iter().map(unit).collect();
    }
}

/// Shared vertices of a page: index in it and shared id.
fn shared<'a>(page: &Page<'a>) -> impl Iterator<Item = (usize, u32)> + 'a {
    let (bits, count) = (page.shared_bits, page.vertex_count());
    let locals = (0..count).filter(move |local| bits[local / 8] >> (local % 8) & 1 == 1);
    locals.zip(page.shared_ids.iter().copied())
}

/// Shares of a leaf's triangles in the normals of its shared vertices.
fn of_leaf<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    leaf: ClusterId,
    scale: f64,
) -> Result<Vec<(u32, [f32; 3])>, ExportError> {
    let page = file.page(leaf)?;
    let page = page.view();
    let corners: Vec<[u32; 3]> = page.triangles.iter().map(|corners| corners.map(u32::from)).collect();
    let sums = sums(page.vertices.positions, &corners);
    let share = |(local, id): (usize, u32)| (id, sums[local].map(|x| (x * scale) as f32));
    Ok(shared(&page).map(share).collect())
}

/// By vertex: the sum of its triangles' normals, by area.
fn sums(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<[f64; 3]> {
    let mut sums = vec![[0.0; 3]; positions.len()];
    for corners in triangles {
        let [a, b, c] = corners.map(|v| positions[v as usize]);
        let area = geom::area_vector(a, b, c);
        for corner in corners {
            let sum: &mut [f64; 3] = &mut sums[*corner as usize];
            *sum = [0, 1, 2].map(|axis| sum[axis] + area[axis]);
        }
    }
    sums
}
