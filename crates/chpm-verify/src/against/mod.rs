//! Whether the leaves of a file hold exactly the triangles of a source, as a multiset.
//!
//! A triangle is the bits of its corner positions, turned so that the smallest corner comes first: orientation counts, the
//! numbering of vertices does not. Both sides are streamed and every triangle's 128-bit hash is added to, or
//! taken from, one of 65,536 sums; equal multisets leave only zeros. A second pass then looks only at a few
//! sums that are not zero, and names the triangles that remain. Memory is the sums, besides the source's
//! positions and triangles, which the store keeps in memory or on disk. Where the file tells that copies were left out, hashes are
//! compared one by one instead (`copies.rs`).
//!
//! The source is read by the same readers that files are built by, and polygons are cut by the same code. All that comes after is done
//! anew: what a build lost between its readers and its leaves is missed here. The readers themselves are held against those of others
//! in their tests.

mod copies;
mod small;
mod source;

use crate::error::VerifyError;
use chpm_extmem::{Cancel, Progress, Silent, Store};
use chpm_format::Chpm;
use chpm_mesh::{ClusterId, Counted};
use copies::{Found, Multiset};
use small::{Size, Small, Window};
use source::{Marks, Source, mark};
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use xxhash_rust::xxh3::xxh3_128;

/// Bytes that [`compare`] takes besides its store: sums, suspects, what streams hold.
pub const OWN: u64 = 8 << 20;

const BUCKETS: usize = 1 << 16;
/// Buckets that the second pass looks into at most, and triangles that it holds, roughly.
const EXAMINED: u64 = 64;
const SUSPECTS: u64 = 1 << 15;
/// Triangles after which progress is told.
const TOLD: u64 = 1 << 14;
/// Triangles that are named.
const NAMED: usize = 20;

/// Result of the comparison.
#[derive(Debug)]
pub struct Comparison {
    /// Triangles of all leaves' finest meshes.
    pub leaf_triangles: u64,
    /// Triangles of the source, without those that have two corners in one vertex and those of small components.
    pub source_triangles: u64,
    /// Some of what differs, in words.
    pub faults: Vec<String>,
    /// How many triangles only one side has, at least, and how many other things differ.
    pub fault_count: u64,
    /// Copies of triangles that the leaves lack.
    pub copies: u64,
    /// Components of the source that are smaller than the file says it has: the leaves lack them.
    pub small_components: u64,
    /// The triangles of these components.
    pub small_component_triangles: u64,
}

impl Comparison {
    /// Whether both sides have the same triangles.
    pub fn is_equal(&self) -> bool {
        self.fault_count == 0
    }

    /// The small components that the leaves lack, in words.
    pub fn small_components_message(&self) -> String {
        let components = Counted(self.small_components, "component");
        let triangles = Counted(self.small_component_triangles, "triangle");
        format!("{components} of {triangles} that are smaller than --min-component")
    }
}

/// A triangle that only one side has, or that one side has more often.
#[derive(Debug, PartialEq)]
struct Fault {
    place: Occurrence,
    corners: Corners,
    /// How many more.
    copies: u64,
}

type Corners = [[f32; 3]; 3];

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum Occurrence {
    Leaf(u32, u32),
    Source(u64),
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.place {
            Occurrence::Leaf(cluster, index) => {
                write!(f, "{}: triangle {index} is not in the source", ClusterId(cluster))?;
            }
            Occurrence::Source(index) => write!(f, "triangle {index} of the source is in no leaf")?,
        }
        write!(f, ": {:?}", self.corners)?;
        if self.copies > 1 { write!(f, ", {} times", self.copies) } else { Ok(()) }
    }
}

/// Counts of a source.
#[derive(Default)]
struct Counts {
    triangles: u64,
    degenerate_faces: u64,
    polygons_triangulated: u64,
    dropped_faces: u64,
    dropped_vertices: u64,
    missing_faces: u64,
    small_components: u64,
    small_component_triangles: u64,
    /// The most that a coordinate of a triangle was moved by.
    rounding: f64,
}

impl Counts {
    /// Those that a file stores, by the names that they have there.
    fn stored(&self) -> [(&'static str, u64); 5] {
        [
            ("degenerate-faces", self.degenerate_faces),
            ("polygons-triangulated", self.polygons_triangulated),
            ("dropped-faces", self.dropped_faces),
            ("dropped-vertices", self.dropped_vertices),
            ("missing-faces", self.missing_faces),
        ]
    }
}

/// Compares the leaves of `file` with the mesh at `path`, read with the settings that the file was built with.
///
/// # Errors
/// [`VerifyError::NotAFile`], [`VerifyError::Source`] or those of the store; what differs is a finding.
pub fn compare<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    path: &Path,
    store: &Store,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Comparison, VerifyError> {
    if path.metadata().is_ok_and(|found| !found.is_file()) {
        return Err(VerifyError::NotAFile { path: path.to_owned() });
    }
    let mut source = Source::of(file, path, store, progress, cancel)?;
    let small = match Size::of(file)? {
        Some(size) => Some(small::find(&mut source, size, store, progress, cancel)?),
        None => None,
    };
    let mut source = Stored { file, source, small };

    // Triangles of leaves add their hash to one of many sums, those of the source subtract it: what is in both leaves nothing
    // behind.
    progress.begin("compare", 2 * file.header().source_triangle_count);
    let mut sums = vec![0u128; BUCKETS];
    let mut leaf_triangles = 0;
    let copies_told = stored_count(file, "merged-copies").unwrap_or(0);
    let multiset = |what| (copies_told > 0).then(|| Multiset::new(store, what));
    let (mut leaf_set, mut source_set) =
        (multiset("triangles of leaves"), multiset("triangles of the source"));
    each_leaf_triangle(file, progress, cancel, &mut |_, corners, marks| {
        leaf_triangles += 1;
        let hash = hash(corners, marks);
        sums[bucket(hash)] = sums[bucket(hash)].wrapping_add(hash);
        leaf_set.iter_mut().for_each(|set| set.add(hash));
    })?;
    let counts = source.each_triangle(progress, cancel, &mut |_, corners, marks| {
        let hash = hash(corners, marks);
        sums[bucket(hash)] = sums[bucket(hash)].wrapping_sub(hash);
        source_set.iter_mut().for_each(|set| set.add(hash));
    })?;
    progress.end();

    let Found { different, missing: copies } = match (leaf_set, source_set) {
        (Some(leaves), Some(source)) => copies::compare(leaves, source)?,
        _ => Found { different: (0..BUCKETS).filter(|b| sums[*b] != 0).collect(), missing: 0 },
    };

    let (faults, fault_count, source_triangles) = (Vec::new(), 0, counts.triangles);
    let Counts { small_components, small_component_triangles, .. } = counts;
    let mut comparison = Comparison {
        leaf_triangles,
        source_triangles,
        faults,
        fault_count,
        copies,
        small_components,
        small_component_triangles,
    };

    // Where a sum is not zero, the triangles of that sum are read again, and told by name.
    if !different.is_empty() {
        let mut suspects = Suspects { examined: vec![false; BUCKETS], found: BTreeMap::new() };
        let all = leaf_triangles.max(counts.triangles);
        let some = (SUSPECTS * BUCKETS as u64 / all.max(1)).clamp(1, EXAMINED);
        different.iter().take(some as usize).for_each(|b| suspects.examined[*b] = true);
        let look = &mut |place, corners, marks| suspects.look(place, corners, marks);
        each_leaf_triangle(file, &Silent, cancel, &mut *look)?;
        source.each_triangle(&Silent, cancel, look)?;
        let faults = suspects.unmatched(copies_told > 0);
        let known: u64 = faults.iter().map(|fault| fault.copies).sum();
        comparison.fault_count = known.max(different.len() as u64);
        comparison.faults = faults.iter().take(NAMED).map(|fault| format!("I1 coverage: {fault}")).collect();
    }

    // Counts of the file that the source contradicts.
    let mut others = counts_that_differ(file, &counts);
    if copies != copies_told {
        others.push(format!(
            "I1 coverage: the file counts {copies_told} merged-copies, and the leaves lack {copies}"
        ));
    }
    comparison.fault_count += others.len() as u64;
    comparison.faults.extend(others);
    Ok(comparison)
}

/// Count in the file's metadata by a name. Metadata that does not decode is a fault of its own.
fn stored_count<D: AsRef<[u8]>>(file: &Chpm<D>, name: &str) -> Option<u64> {
    let repairs = file.metadata().ok()?.repairs;
    repairs.iter().find(|(told, _)| told == name).map(|(_, count)| *count)
}

/// Facts about the source that the file has wrong.
fn counts_that_differ<D: AsRef<[u8]>>(file: &Chpm<D>, counts: &Counts) -> Vec<String> {
    let mut faults = Vec::new();
    for (name, count) in counts.stored() {
        let told = stored_count(file, name).unwrap_or(count);
        if told != count {
            faults.push(format!("I1 coverage: the file counts {told} {name}, and the source has {count}"));
        }
    }
    for (name, count) in [
        ("small-components", counts.small_components),
        ("small-component-triangles", counts.small_component_triangles),
    ] {
        let told = stored_count(file, name).unwrap_or(0);
        if told != count {
            faults.push(format!(
                "I1 coverage: the file counts {told} {name}, and the source has {count} of that size"
            ));
        }
    }
    let leaves = file.clusters().iter().filter(|cluster| cluster.is_leaf());
    let error = leaves.map(|leaf| leaf.min_error).fold(0.0, f32::max);
    if counts.rounding > f64::from(error) {
        let rounding = counts.rounding;
        faults.push(format!(
            "I5 error: rounding moved a coordinate of the source by {rounding:e}, and the leaves have an error of {error:e}"
        ));
    }
    faults
}

/// Triangles of the buckets that differ: by hash, how many more the leaves have, and the last place of each side.
struct Suspects {
    examined: Vec<bool>,
    found: BTreeMap<u128, Suspect>,
}

struct Suspect {
    surplus: i64,
    leaf: Option<Occurrence>,
    source: Option<Occurrence>,
    corners: Corners,
}

impl Suspect {
    /// What one side has more of, if any.
    fn fault(self) -> Option<Fault> {
        let place = if self.surplus > 0 { self.leaf } else { self.source };
        let copies = self.surplus.unsigned_abs();
        place.filter(|_| copies > 0).map(|place| Fault { place, corners: self.corners, copies })
    }
}

impl Suspects {
    fn look(&mut self, place: Occurrence, corners: Corners, marks: Marks) {
        let hash = hash(corners, marks);
        if !self.examined[bucket(hash)] {
            return;
        }
        let suspect =
            self.found.entry(hash).or_insert(Suspect { surplus: 0, leaf: None, source: None, corners });
        match place {
            Occurrence::Leaf(..) => (suspect.surplus, suspect.leaf) = (suspect.surplus + 1, Some(place)),
            Occurrence::Source(_) => (suspect.surplus, suspect.source) = (suspect.surplus - 1, Some(place)),
        }
    }

    /// Those that one side has more of; ordered by place. With `copies`, the source may have more of what the leaves have.
    fn unmatched(self, copies: bool) -> Vec<Fault> {
        let suspects = self.found.into_values();
        let suspects = suspects.filter(|suspect| !(copies && suspect.surplus < 0 && suspect.leaf.is_some()));
        let mut faults: Vec<Fault> = suspects.filter_map(Suspect::fault).collect();
        faults.sort_unstable_by_key(|fault| fault.place);
        faults
    }
}

fn each_leaf_triangle<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    progress: &dyn Progress,
    cancel: &Cancel,
    look: &mut dyn FnMut(Occurrence, Corners, Marks),
) -> Result<(), VerifyError> {
    for (id, record) in (0..).map(ClusterId).zip(file.clusters()) {
        if !record.is_leaf() {
            continue;
        }
        cancel.check()?;
        let page = file.page(id)?;
        let page = page.view();
        for (index, triangle) in (0..).zip(page.triangles) {
            let marks = triangle.map(|v| mark(page.scalars_of(usize::from(v))));
            look(Occurrence::Leaf(id.0, index), triangle.map(|v| page.positions[usize::from(v)]), marks);
        }
        progress.advance(page.triangles.len() as u64);
    }
    Ok(())
}

/// A source, as a file stores it.
struct Stored<'a, D> {
    file: &'a Chpm<D>,
    source: Source,
    /// The triangles that the file is to lack, if it was built so.
    small: Option<Small>,
}

impl<D: AsRef<[u8]>> Stored<'_, D> {
    /// Shows the triangles without those that are small.
    fn each_triangle(
        &mut self,
        progress: &dyn Progress,
        cancel: &Cancel,
        look: &mut dyn FnMut(Occurrence, Corners, Marks),
    ) -> Result<Counts, VerifyError> {
        let Stored { file, source, small } = self;
        let (tally, is_told_single) = (source.tally, source.is_told_single);
        let origin = file.header().origin;
        let step = file.metadata().unwrap_or_default().lattice_step()?;
        // Text of declared singles that has no more digits than these is what they are: the file was left without an origin.
        let is_exact = step.is_none() && is_told_single && origin == [0.0; 3];
        let (mut index, mut left_out, mut rounding) = (0, 0, 0.0f64);
        let mut at = Window::default();
        source.each_marked(cancel, |corners, marks| {
            let place = Occurrence::Source(index);
            index += 1;
            if index % TOLD == 0 {
                progress.advance(TOLD);
            }
            if let Some(small) = small
                && small.next(&mut at)?
            {
                left_out += 1;
                return Ok(());
            }
            let exact =
                corners.map(|corner| std::array::from_fn::<f64, 3, _>(|axis| corner[axis] - origin[axis]));
            let stored = exact.map(|corner| corner.map(|x| stored(x, step)));
            let pairs = exact.as_flattened().iter().zip(stored.as_flattened());
            for (exact, stored) in pairs.filter(|_| !is_exact) {
                rounding = rounding.max((f64::from(*stored) - exact).abs());
            }
            look(place, stored, marks);
            Ok(())
        })?;
        Ok(Counts {
            triangles: index - left_out,
            degenerate_faces: tally.degenerate_faces,
            polygons_triangulated: tally.polygons_triangulated,
            dropped_faces: tally.dropped_faces,
            dropped_vertices: tally.dropped_vertices,
            missing_faces: tally.missing_faces,
            small_components: small.as_ref().map_or(0, |small| small.components),
            small_component_triangles: left_out,
            rounding,
        })
    }
}

/// A coordinate as a file has it, on a lattice of this step if there is one.
pub(crate) fn stored(x: f64, step: Option<f64>) -> f32 {
    match step {
        // There is one zero on a lattice.
        Some(step) => ((x / step).round_ties_even() * step) as f32 + 0.0,
        None => x as f32,
    }
}

/// Shows the corners of all triangles of a source, with the bytes of it that are behind us, in no more memory than the store has. What is
/// invalid is left out.
///
/// # Errors
/// [`VerifyError::Source`], or those of the store.
pub fn each_corners(
    path: &Path,
    store: &Store,
    cancel: &Cancel,
    tell: impl FnMut(u64),
    mut look: impl FnMut([[f64; 3]; 3]),
) -> Result<(), VerifyError> {
    let mut source = Source::read(path, true, Vec::new(), store, cancel, tell)?;
    source.each_corners(cancel, |corners| {
        look(corners);
        Ok(())
    })
}

fn hash(corners: Corners, marks: Marks) -> u128 {
    let [a, b, c] = [0, 1, 2].map(|at| (corners[at].map(f32::to_bits), marks[at]));
    let turned = [[a, b, c], [b, c, a], [c, a, b]];
    let first = turned.iter().min().unwrap_or(&turned[0]);
    let mut bytes = [0u8; 60];
    for (chunk, (corner, mark)) in bytes.chunks_exact_mut(20).zip(first) {
        chunk[..12].copy_from_slice(bytemuck::cast_slice(corner));
        chunk[12..].copy_from_slice(&mark.to_le_bytes());
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
        let bare = |corners| hash(corners, [0; 3]);
        assert_eq!(bare([A, B, C]), bare([B, C, A]));
        assert_eq!(bare([A, B, C]), bare([C, A, B]));
        assert_ne!(bare([A, B, C]), bare([A, C, B]));
        assert_ne!(bare([A, B, C]), bare([[-0.0, 0.0, 0.0], B, C]));
        assert_eq!(hash([A, B, C], [7, 8, 9]), hash([B, C, A], [8, 9, 7]));
        assert_ne!(hash([A, B, C], [7, 8, 9]), hash([B, C, A], [7, 8, 9]));
    }

    #[test]
    fn copies_are_counted_and_only_the_surplus_is_a_fault() {
        let mut suspects = Suspects { examined: vec![true; BUCKETS], found: BTreeMap::new() };
        suspects.look(Occurrence::Leaf(3, 0), [A, B, C], [0; 3]);
        suspects.look(Occurrence::Leaf(3, 1), [B, C, A], [0; 3]);
        suspects.look(Occurrence::Source(7), [C, A, B], [0; 3]);
        suspects.look(Occurrence::Source(8), [A, C, B], [0; 3]);
        let places: Vec<Occurrence> = suspects.unmatched(false).iter().map(|fault| fault.place).collect();
        assert_eq!(places, [Occurrence::Leaf(3, 1), Occurrence::Source(8)]);
    }

    #[test]
    fn faults_name_the_cluster_or_the_source_triangle() {
        let text = |place| Fault { place, corners: [A, B, C], copies: 1 }.to_string();
        assert!(text(Occurrence::Leaf(3, 1)).starts_with("cluster 3: triangle 1 is not in the source"));
        assert!(text(Occurrence::Source(8)).starts_with("triangle 8 of the source is in no leaf"));
    }
}
