//! Whether the leaves of a file hold exactly the triangles of a source, as a multiset.
//!
//! A triangle is the bits of its corner positions, turned so that the smallest corner comes first: orientation counts, the
//! numbering of vertices does not. Both sides are streamed and every triangle's 128-bit hash is added to, or
//! taken from, one of 65,536 sums; equal multisets leave only zeros. A second pass then looks only at a few
//! sums that are not zero, and names the triangles that remain. Memory is the sums, besides the source's
//! positions, which the store keeps in memory or on disk. Where the file tells that copies were left out, hashes are compared one by one
//! instead ([`copies`]).

mod copies;

use crate::progress::Meter;
use crate::stop;
use anyhow::Result;
use chpm_build::Cancel;
use chpm_build::input::Input;
use chpm_extmem::{Buffer, BufferWriter, Store};
use chpm_format::Chpm;
use chpm_mesh::ClusterId;
use chpm_mesh::ply::{Batch, BatchKind, Invalid, Options};
use copies::{Found, Multiset};
use std::fmt;
use std::path::Path;
use xxhash_rust::xxh3::xxh3_128;

const BUCKETS: usize = 1 << 16;
/// Buckets that the second pass looks into: a thousandth of the triangles at most.
const EXAMINED: usize = 64;
/// Triangles that are named.
const NAMED: usize = 20;

/// What the comparison found.
#[derive(Debug)]
pub(crate) struct Comparison {
    /// Triangles of all leaves' finest meshes.
    pub(crate) leaf_triangles: u64,
    /// Triangles of the source, without those that have two corners in one vertex.
    pub(crate) source_triangles: u64,
    /// Some of the triangles that only one side has.
    pub(crate) faults: Vec<Fault>,
    /// How many such triangles there are at least.
    pub(crate) fault_count: u64,
    /// Copies of triangles that the leaves lack, and as how many the file tells of.
    pub(crate) copies: u64,
    pub(crate) copies_told: u64,
}

impl Comparison {
    /// Whether both sides have the same triangles.
    pub(crate) fn is_equal(&self) -> bool {
        self.fault_count == 0 && self.copies == self.copies_told
    }
}

/// A triangle that only one side has.
#[derive(Debug, PartialEq)]
pub(crate) struct Fault {
    place: Place,
    corners: Corners,
}

type Corners = [[f32; 3]; 3];

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum Place {
    Leaf(u32, u32),
    Source(u64),
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.place {
            Place::Leaf(cluster, index) => {
                write!(f, "{}: triangle {index} is not in the source", ClusterId(cluster))?;
            }
            Place::Source(index) => write!(f, "triangle {index} of the source is in no leaf")?,
        }
        write!(f, ": {:?}", self.corners)
    }
}

/// Compares the leaves of `file` with the mesh at `source`, read with the settings that the file was built with.
pub(crate) fn compare<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    source: &Path,
    store: &Store,
    meter: &Meter,
    cancel: &Cancel,
) -> Result<Comparison> {
    meter.start("compare", 2 * file.header().source_triangle_count);
    let mut sums = vec![0u128; BUCKETS];
    let mut leaf_triangles = 0;
    let mut source_triangles = 0;
    let told = |name: &str| {
        Ok::<_, anyhow::Error>(file.metadata()?.repairs.iter().find(|r| r.0 == name).map_or(0, |r| r.1))
    };
    let copies_told = told("merged-copies")?;
    let multiset = |what| (copies_told > 0).then(|| Multiset::new(store, what));
    let (mut leaf_set, mut source_set) =
        (multiset("triangles of leaves"), multiset("triangles of the source"));
    each_leaf_triangle(file, meter, cancel, &mut |_, corners| {
        leaf_triangles += 1;
        let hash = hash(corners);
        sums[bucket(hash)] = sums[bucket(hash)].wrapping_add(hash);
        leaf_set.iter_mut().for_each(|set| set.add(hash));
    })?;
    each_source_triangle(file, source, store, meter, cancel, &mut |_, corners| {
        source_triangles += 1;
        let hash = hash(corners);
        sums[bucket(hash)] = sums[bucket(hash)].wrapping_sub(hash);
        source_set.iter_mut().for_each(|set| set.add(hash));
    })?;
    meter.finish();

    let Found { different, missing: copies } = match (leaf_set, source_set) {
        (Some(leaves), Some(source)) => copies::compare(leaves, source)?,
        _ => Found { different: (0..BUCKETS).filter(|b| sums[*b] != 0).collect(), missing: 0 },
    };
    let (faults, fault_count) = (Vec::new(), 0);
    let mut comparison =
        Comparison { leaf_triangles, source_triangles, faults, fault_count, copies, copies_told };
    if !different.is_empty() {
        let mut examined = vec![false; BUCKETS];
        different.iter().take(EXAMINED).for_each(|b| examined[*b] = true);
        let mut suspects = Suspects { examined, found: Vec::new() };
        each_leaf_triangle(file, meter, cancel, &mut |place, corners| suspects.look(place, corners))?;
        each_source_triangle(file, source, store, meter, cancel, &mut |place, corners| {
            suspects.look(place, corners);
        })?;
        let mut faults = suspects.unmatched(copies_told > 0);
        comparison.fault_count = faults.len().max(different.len()) as u64;
        faults.truncate(NAMED);
        comparison.faults = faults;
    }
    Ok(comparison)
}

/// Triangles of the buckets that differ.
struct Suspects {
    examined: Vec<bool>,
    found: Vec<(u128, Place, Corners)>,
}

impl Suspects {
    fn look(&mut self, place: Place, corners: Corners) {
        let hash = hash(corners);
        if self.examined[bucket(hash)] {
            self.found.push((hash, place, corners));
        }
    }

    /// Those that are left when each of one side has taken away an equal one of the other; ordered by place.
    /// With `copies`, the source may have more of what the leaves have.
    fn unmatched(mut self, copies: bool) -> Vec<Fault> {
        self.found.sort_unstable_by_key(|(hash, place, _)| (*hash, *place));
        let mut faults = Vec::new();
        for equal in self.found.chunk_by(|a, b| a.0 == b.0) {
            let (leaf, source) =
                equal.split_at(equal.partition_point(|(_, place, _)| matches!(place, Place::Leaf(..))));
            let matched = leaf.len().min(source.len());
            let source = if copies && matched > 0 { &source[..matched] } else { source };
            let left = leaf[matched..].iter().chain(&source[matched..]);
            faults.extend(left.map(|(_, place, corners)| Fault { place: *place, corners: *corners }));
        }
        faults.sort_unstable_by_key(|fault| fault.place);
        faults
    }
}

fn each_leaf_triangle<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    meter: &Meter,
    cancel: &Cancel,
    look: &mut dyn FnMut(Place, Corners),
) -> Result<()> {
    for (id, record) in (0..).map(ClusterId).zip(file.clusters()) {
        if !record.is_leaf() {
            continue;
        }
        stop::check(cancel)?;
        let page = file.page(id)?;
        for (index, triangle) in (0..).zip(page.triangles) {
            look(Place::Leaf(id.0, index), triangle.map(|v| page.positions[usize::from(v)]));
        }
        meter.add(page.triangles.len() as u64);
    }
    Ok(())
}

fn each_source_triangle<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    path: &Path,
    store: &Store,
    meter: &Meter,
    cancel: &Cancel,
    look: &mut dyn FnMut(Place, Corners),
) -> Result<()> {
    let settings = file.metadata()?.settings;
    let dropped = settings.iter().any(|(name, value)| name == "drop-invalid" && value == "true");
    let invalid = if dropped { Invalid::Drop } else { Invalid::Refuse };
    let options = Options { invalid, normals: false, colors: false };
    let mut input = Input::open(path, options, store)?;
    let vertex_count = input.declared().map(|(vertices, _)| vertices);
    let origin = file.header().origin;

    let mut coming = BufferWriter::new(store, "source positions", 0)?;
    let mut positions: Option<Buffer<[f32; 3]>> = None;
    // Faces may come before the vertices that they are made of.
    let mut early = BufferWriter::new(store, "source triangles", 0)?;
    let mut index = 0;
    let mut hand_over = |positions: &[[f32; 3]], triangles: &[[u32; 3]]| {
        for triangle in triangles {
            look(Place::Source(index), triangle.map(|v| positions[v as usize]));
            index += 1;
        }
        meter.add(triangles.len() as u64);
    };
    let mut batch = Batch::default();
    loop {
        stop::check(cancel)?;
        match input.next_batch(&mut batch)? {
            BatchKind::Vertices => {
                let local = batch.positions_f64.iter().map(|p| relative(*p, origin));
                let local = local.chain(batch.positions.iter().map(|p| relative(p.map(f64::from), origin)));
                coming.extend_from_slice(&local.collect::<Vec<_>>())?;
                if Some(coming.len() as u64) == vertex_count {
                    let all = std::mem::replace(&mut coming, BufferWriter::new(store, "nothing", 0)?);
                    positions = Some(all.finish()?);
                }
            }
            BatchKind::Triangles => match &positions {
                Some(positions) => hand_over(positions, &batch.triangles),
                None => early.extend_from_slice(&batch.triangles)?,
            },
            BatchKind::End => break,
        }
    }
    // Only now is it known that there are no more vertices, where no header told.
    let positions = match positions {
        Some(positions) => positions,
        None => coming.finish()?,
    };
    hand_over(&positions, &early.finish()?);
    Ok(())
}

/// A position as the file stores it. Exact for single precision, whose origin is zero: also the sign of a zero stays.
fn relative(position: [f64; 3], origin: [f64; 3]) -> [f32; 3] {
    std::array::from_fn(|axis| (position[axis] - origin[axis]) as f32)
}

fn hash(corners: Corners) -> u128 {
    let [a, b, c] = corners.map(|corner| corner.map(f32::to_bits));
    let turned = [[a, b, c], [b, c, a], [c, a, b]];
    let first = turned.iter().min().unwrap_or(&turned[0]);
    let mut bytes = [0u8; 36];
    for (chunk, bits) in bytes.chunks_exact_mut(4).zip(first.as_flattened()) {
        chunk.copy_from_slice(&bits.to_le_bytes());
    }
    xxh3_128(&bytes)
}

fn bucket(hash: u128) -> usize {
    (hash >> 112) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: [f32; 3] = [0.0, 0.0, 0.0];
    const B: [f32; 3] = [1.0, 0.0, 0.0];
    const C: [f32; 3] = [0.0, 1.0, 0.0];

    #[test]
    fn turning_a_triangle_keeps_its_hash_and_flipping_does_not() {
        assert_eq!(hash([A, B, C]), hash([B, C, A]));
        assert_eq!(hash([A, B, C]), hash([C, A, B]));
        assert_ne!(hash([A, B, C]), hash([A, C, B]));
        assert_ne!(hash([A, B, C]), hash([[-0.0, 0.0, 0.0], B, C]));
    }

    #[test]
    fn copies_are_counted_and_only_the_surplus_is_a_fault() {
        let mut suspects = Suspects { examined: vec![true; BUCKETS], found: Vec::new() };
        suspects.look(Place::Leaf(3, 0), [A, B, C]);
        suspects.look(Place::Leaf(3, 1), [B, C, A]);
        suspects.look(Place::Source(7), [C, A, B]);
        suspects.look(Place::Source(8), [A, C, B]);
        let places: Vec<Place> = suspects.unmatched(false).iter().map(|fault| fault.place).collect();
        assert_eq!(places, [Place::Leaf(3, 1), Place::Source(8)]);
    }

    #[test]
    fn faults_name_the_cluster_or_the_source_triangle() {
        let text = |place| Fault { place, corners: [A, B, C] }.to_string();
        assert!(text(Place::Leaf(3, 1)).starts_with("cluster 3: triangle 1 is not in the source"));
        assert!(text(Place::Source(8)).starts_with("triangle 8 of the source is in no leaf"));
    }
}
