//! The edges of a cut that an odd number of faces have, without making one mesh of it: cluster by cluster, and then where they meet.
//!
//! Each triangle of each cluster at its position is looked at. An edge's number of faces is the sum over the clusters that have it, so
//! what is even within a cluster can be left out, and the few edges that are odd somewhere are counted together. Clusters
//! are joined by shared ids alone.

use chpm_format::{Chpm, FormatError, Page};
use chpm_refine::Cut;

/// Counts the edges of one cut after the other, in the same memory.
#[derive(Default)]
pub(crate) struct Seams {
    cluster: Local,
    /// Edges that are odd in a cluster, by global numbers: shared ids first, then the inner vertices that were met.
    edges: Vec<[u32; 2]>,
    inner: Vec<[f32; 3]>,
    /// By shared id; only those of the current cut are right.
    shared: Vec<[f32; 3]>,
    triangles: u64,
}

impl Seams {
    /// Goes to a legal cut of a file whose pages are sound.
    pub(crate) fn enter<D: AsRef<[u8]>>(&mut self, file: &Chpm<D>, cut: &Cut) -> Result<(), FormatError> {
        let shared_count = file.header().shared_vertex_count;
        self.shared.resize(shared_count as usize, [0.0; 3]);
        self.edges.clear();
        self.inner.clear();
        self.triangles = 0;
        for member in cut.members() {
            let page = Page::view(file.page_bytes(member.cluster))?;
            self.triangles += self.cluster.enter(&page, member.vertices as usize);
            self.number(&page, shared_count);
        }
        self.edges.sort_unstable();
        Ok(())
    }

    /// Takes the odd edges of a cluster over into the numbers of the whole cut.
    fn number(&mut self, page: &Page<'_>, shared_count: u32) {
        let Local { odd, numbers, .. } = &mut self.cluster;
        numbers.clear();
        numbers.resize(page.vertex_count(), u32::MAX);
        for (vertex, id) in page.shared() {
            numbers[usize::from(vertex)] = id;
            self.shared[id as usize] = page.positions[usize::from(vertex)];
        }
        for edge in odd {
            let [a, b] = edge.map(|vertex| {
                let number = &mut numbers[usize::from(vertex)];
                if *number == u32::MAX {
                    *number = shared_count + self.inner.len() as u32;
                    self.inner.push(page.positions[usize::from(vertex)]);
                }
                *number
            });
            self.edges.push([a.min(b), a.max(b)]);
        }
    }

    /// Triangles of the cut.
    pub(crate) fn triangles(&self) -> u64 {
        self.triangles
    }

    /// Ends of the edges of an odd number of faces.
    pub(crate) fn odd_edges(&self) -> impl Iterator<Item = [[f32; 3]; 2]> {
        let inner = |v: u32| self.inner[v as usize - self.shared.len()];
        let position = move |v: u32| self.shared.get(v as usize).copied().unwrap_or_else(|| inner(v));
        let odd = self.edges.chunk_by(|a, b| a == b).filter(|same| same.len() % 2 == 1);
        odd.map(move |same| same[0].map(position))
    }
}

/// One cluster at a position, played as the format tells it.
#[derive(Default)]
struct Local {
    /// By vertex of the finest mesh: where it is.
    resolved: Vec<u16>,
    /// By vertex: where the edges start of which it is the smaller end; one more entry.
    first: Vec<u32>,
    /// The larger ends.
    ends: Vec<u16>,
    odd: Vec<[u16; 2]>,
    numbers: Vec<u32>,
}

impl Local {
    /// Finds the odd edges of the mesh of `n` vertices; answers its triangles.
    fn enter(&mut self, page: &Page<'_>, n: usize) -> u64 {
        let Local { resolved, first, ends, odd, .. } = self;
        resolved.clear();
        resolved.extend((0..n).map(|v| v as u16));
        for target in &page.targets[n - page.base_vertex_count..] {
            resolved.push(resolved[usize::from(*target)]);
        }
        let edges = |corners: &[u16; 3]| {
            let [a, b, c] = corners.map(|v| resolved[usize::from(v)]);
            let is_there = a != b && b != c && c != a;
            is_there.then(|| [[a, b], [b, c], [c, a]].map(|[u, v]| [u.min(v), u.max(v)]))
        };
        first.clear();
        first.resize(n + 1, 0);
        let mut triangles = 0;
        for all in page.triangles.iter().filter_map(edges) {
            triangles += 1;
            all.iter().for_each(|[low, _]| first[usize::from(*low)] += 1);
        }
        let mut sum = 0;
        for count in first.iter_mut() {
            sum += std::mem::replace(count, sum);
        }
        ends.clear();
        ends.resize(sum as usize, 0);
        for [low, high] in page.triangles.iter().filter_map(edges).flatten() {
            let place = &mut first[usize::from(low)];
            ends[*place as usize] = high;
            *place += 1;
        }
        // Starts have become ends.
        odd.clear();
        let mut start = 0;
        for (low, end) in first[..n].iter().enumerate() {
            let own = &mut ends[start..*end as usize];
            start = *end as usize;
            own.sort_unstable();
            let single = own.chunk_by(|a, b| a == b).filter(|same| same.len() % 2 == 1);
            odd.extend(single.map(|same| [low as u16, same[0]]));
        }
        triangles
    }
}

#[cfg(test)]
mod tests {
    use super::super::odd_edges;
    use super::*;
    use chpm_build::{BuildConfig, Cancel, Silent, build};
    use chpm_mesh::TriMesh;
    use chpm_mesh::ply::{self, Encoding};
    use chpm_mesh::synth::{Shape, Synth, hand};
    use chpm_refine::{Member, extract, random_cut};
    use std::fs::{self, File};

    fn built(mesh: &TriMesh) -> Chpm<Vec<u8>> {
        let folder = tempfile::tempdir().unwrap();
        let [source, output] = ["in.ply", "out.chpm"].map(|name| folder.path().join(name));
        ply::write_mesh(File::create(&source).unwrap(), mesh, Encoding::BinaryLittleEndian).unwrap();
        let mut config = BuildConfig::default();
        config.settings.cluster_triangles = 64;
        build(&source, &output, &config, &Silent, &Cancel::default()).unwrap();
        Chpm::open(fs::read(&output).unwrap()).unwrap()
    }

    /// Each edge by the bits of its ends, the least first.
    fn sorted(edges: impl Iterator<Item = [[f32; 3]; 2]>) -> Vec<[[u32; 3]; 2]> {
        let bits = |[a, b]: [[u32; 3]; 2]| [a.min(b), a.max(b)];
        let mut edges: Vec<_> = edges.map(|edge| bits(edge.map(|p| p.map(f32::to_bits)))).collect();
        edges.sort_unstable();
        edges
    }

    #[test]
    fn odd_edges_are_those_of_the_extracted_mesh() {
        let (mut seams, mut found) = (Seams::default(), 0);
        let synth = |shape| Synth::new(shape, 3000, 5).to_mesh();
        let [iso, terrain, plates] = [Shape::Isosurface, Shape::Terrain, Shape::Plates].map(synth);
        for mesh in [iso, terrain, plates, hand::moebius(300), hand::edge_fan(301), hand::soup(90)] {
            let file = built(&mesh);
            for seed in 0..60 {
                let legal = random_cut(&file, seed).unwrap();
                // Half of them at positions that no rule gives: where groups come apart, seams open.
                let shifted = legal.members().iter().map(|member| {
                    let record = &file.clusters()[member.cluster.index()];
                    let step = 3 * (seed as u32 % 2) * (member.cluster.0 % 3);
                    let vertices = member.vertices.saturating_sub(step).max(record.base_vertex_count);
                    Member { vertices, ..*member }
                });
                let cut = Cut::new(shifted.collect());
                let whole = extract(&file, &cut).unwrap();
                let at = |v: u32| whole.positions[v as usize];
                let expected = sorted(odd_edges(&whole).map(|(edge, _)| edge.map(at)));
                seams.enter(&file, &cut).unwrap();
                assert_eq!(sorted(seams.odd_edges()), expected, "seed {seed}");
                assert_eq!(seams.triangles(), whole.triangles.len() as u64);
                found += expected.len();
            }
        }
        assert!(found > 1000, "{found}");
    }

    #[test]
    fn a_seam_that_came_apart_is_odd() {
        let file = built(&Synth::new(Shape::Torus, 3000, 5).to_mesh());
        let group = file.groups().iter().find(|group| group.coarse_count > 1 && group.is_leaf()).unwrap();
        let first = file.members()[group.coarse_first as usize];
        let mut members = Cut::at_level(&file, chpm_mesh::Level(0)).members().to_vec();
        let mut seams = Seams::default();
        seams.enter(&file, &Cut::new(members.clone())).unwrap();
        assert_eq!(seams.odd_edges().count(), 0, "a torus is closed");
        let member = members.iter_mut().find(|member| member.cluster.0 == first).unwrap();
        member.vertices = file.clusters()[first as usize].base_vertex_count;
        seams.enter(&file, &Cut::new(members)).unwrap();
        assert!(seams.odd_edges().count() > 2);
    }
}
