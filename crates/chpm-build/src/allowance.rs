//! How the memory that a build may have is divided, so that the process stays below it.

use crate::config::Resources;
use chpm_extmem::MemoryBudget;
use chpm_mesh::Bytes;
use std::sync::Arc;

/// The least memory with which a build of any threads promises to stay below what it was given.
pub const MIN_MEMORY: u64 = 128 << 20;

/// The program, its tables of small things, and what the allocator has not given back.
const PROGRAM: u64 = 20 << 20;
/// Stack and scratch of a thread: one group of clusters with all that simplifying and ordering it takes.
pub(crate) const THREAD: u64 = 10 << 20;
/// Memory for a region of usual size, which arrays may not take: one for each thread, up to so many. Further threads help with these.
const REGION: u64 = 20 << 20;
const REGIONS: u64 = 16;

/// Bytes of a source for each byte of what grows with it and has to be in memory: border vertices, and a row of the tables for
/// each cluster. Binary triangles take some 19 bytes, and leave 0.8 (measured with isosurfaces and terrains).
const SOURCE_PER_TABLE: u64 = 20;
/// Bytes of the tables for each node of the tree, and of what is made of them at the end.
const NODE: u64 = 760;

/// The threads that `resources` has memory for, `available` at most, and the budget that is left for a source of so many bytes.
pub(crate) fn divide(resources: &Resources, available: usize, source_len: u64) -> (usize, Arc<MemoryBudget>) {
    let wanted = if resources.threads == 0 { available } else { resources.threads };
    let memory = resources.memory.0;
    // Below the least memory nothing is promised: arrays get what they would, and work what it needs.
    let total = memory.max(MIN_MEMORY) - PROGRAM;
    let threads = (wanted as u64).clamp(1, most_threads(total));
    let beside_arrays = PROGRAM + threads * THREAD + threads.min(REGIONS) * REGION;
    // Arrays come first and stay: what work reserves after them has to be kept free from the start.
    let arrays = memory.saturating_sub(beside_arrays);
    let arrays = arrays - (source_len / SOURCE_PER_TABLE).min(arrays);
    // And no more than half, so that with more memory there is more for work, whatever arrays there are.
    let arrays = arrays.min(total / 2);
    (threads as usize, MemoryBudget::with_work_limit(arrays, total - threads * THREAD))
}

/// Threads for which `total` bytes suffice.
fn most_threads(total: u64) -> u64 {
    match total / (THREAD + REGION) {
        few if few <= REGIONS => few,
        _ => (total - REGIONS * REGION) / THREAD,
    }
}

/// The least memory above what was given, in whole MiB, with which `work` bytes can be reserved. Arrays make room, but for some where `arrays`
/// bytes have not: of those there may be as many as arrays may have.
pub(crate) fn enough(
    resources: &Resources,
    available: usize,
    source_len: u64,
    work: u64,
    arrays: u64,
) -> u64 {
    let first = resources.memory.0.max(MIN_MEMORY).next_multiple_of(1 << 20);
    let mut sizes = (first..).step_by(1 << 20).skip(1);
    let enough = sizes.find(|memory| {
        let resources = Resources { memory: Bytes(*memory), ..resources.clone() };
        let (_, budget) = divide(&resources, available, source_len);
        let kept = if arrays > 0 { budget.limit() } else { 0 };
        budget.available_for_work() - kept >= work
    });
    enough.unwrap_or(u64::MAX)
}

/// Bytes of the tables of a tree.
pub(crate) fn tables(nodes: usize) -> u64 {
    NODE * nodes as u64
}

/// Bytes that a build may have on disk at one time, beside the output, were no array in memory: at the end of simplify, when
/// the leaves, all pages and the base triangles of a level with their displacements are there. `vertex_len` is what a vertex has in the file.
pub(crate) fn disk(vertices: u64, triangles: u64, vertex_len: u64) -> u64 {
    vertices.saturating_mul(4 * vertex_len).saturating_add(triangles.saturating_mul(41))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BuildConfig, Cancel, Keep, Settings, Silent, build};
    use chpm_import::ply::{Encoding, PlyWriter};
    use chpm_mesh::{Bytes, Scalar, ScalarKind, TriMesh};
    use chpm_synth::odd::Odd;
    use chpm_synth::{Shape, Synth};
    use std::fs::File;
    use std::process::Command;

    /// Tells a test below to be the build that it measures.
    const CHILD: &str = "CHPM_TEST_BUILD";

    /// Clusters of a build in a process of its own, which the test `name` is there, the most that its budget held, and the most that
    /// was resident in it.
    fn measured(name: &str) -> (usize, u64, u64) {
        let program = std::env::current_exe().unwrap();
        let name = format!("allowance::tests::{name}");
        let run = Command::new(program).args([&name, "--exact", "--nocapture"]).env(CHILD, "1").output();
        let told = String::from_utf8(run.unwrap().stdout).unwrap();
        let figures = told.split("measured: ").nth(1).unwrap_or_else(|| panic!("{told}"));
        let figures: Vec<u64> =
            figures.lines().next().unwrap().split(' ').map(|n| n.parse().unwrap()).collect();
        (figures[0] as usize, figures[1], figures[2])
    }

    fn odd(name: &str, triangles: u32) -> TriMesh {
        let plan = Odd::find(name).unwrap().plan(triangles);
        let positions = (0..plan.vertices).map(|v| plan.place(v).map(|x| x as f32)).collect();
        TriMesh::new(positions, (0..plan.triangles).map(|t| plan.corners(t)).collect())
    }

    fn is_child() -> bool {
        std::env::var_os(CHILD).is_some()
    }

    /// Nothing for arrays, and one thread.
    const NONE: (usize, Bytes) = (1, Bytes(0));

    /// A PLY in which each word of a vertex's scalars has a name.
    fn write(file: File, mesh: &TriMesh) {
        let words = mesh.attributes().scalar_words;
        let scalars: Vec<Scalar> =
            (0..words).map(|word| Scalar::new(format!("s{word}"), ScalarKind::Float32)).collect();
        let [vertices, triangles] = [mesh.positions.len(), mesh.triangles.len()].map(|count| count as u64);
        let encoding = Encoding::BinaryLittleEndian;
        let ply = PlyWriter::with_scalars(
            file,
            encoding,
            vertices,
            triangles,
            mesh.attributes(),
            &scalars,
            false,
            &[],
        );
        let mut ply = ply.unwrap();
        ply.vertices(mesh.view()).unwrap();
        ply.triangles(&mesh.triangles).unwrap();
        ply.finish().unwrap();
    }

    /// Builds with so many threads and so much memory, and tells what `measured` wants to know.
    fn tell_build_of(mesh: TriMesh, settings: Settings, (threads, memory): (usize, Bytes)) {
        let dir = tempfile::tempdir().unwrap();
        let (source, output) = (dir.path().join("s.ply"), dir.path().join("s.chpm"));
        write(File::create(&source).unwrap(), &mesh);
        drop(mesh);
        let config = BuildConfig {
            settings,
            resources: Resources { threads, memory, checkpoint: None, ..Resources::default() },
            ..BuildConfig::default()
        };
        let report = build(&source, &output, &config, &Silent, &Cancel::default()).unwrap();
        println!("measured: {} {} {}", report.clusters, report.budget_peak, report.peak_resident.unwrap());
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_build_of_many_nodes_takes_no_more_than_is_accounted_for() {
        if is_child() {
            // Leaves of some four triangles, so that their tables are more than all else.
            let settings = Settings { cluster_triangles: 4, cell_vertices: 2, ..Settings::default() };
            return tell_build_of(Synth::new(Shape::Torus, 128_000, 0).to_mesh(), settings, NONE);
        }
        let (nodes, held, resident) = measured("a_build_of_many_nodes_takes_no_more_than_is_accounted_for");
        assert!(nodes > 50_000, "{nodes} nodes");
        let promised = PROGRAM + THREAD + held;
        assert!(resident <= promised, "{nodes} nodes: {resident} bytes resident, {promised} accounted for");
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn so_does_one_of_triangles_that_join_anything_to_anything() {
        if is_child() {
            return tell_build_of(odd("random", 240_000), Settings::default(), NONE);
        }
        let (_, held, resident) = measured("so_does_one_of_triangles_that_join_anything_to_anything");
        let promised = PROGRAM + THREAD + held;
        assert!(resident <= promised, "{resident} bytes resident, {promised} accounted for");
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn so_does_one_of_vertices_with_many_scalars() {
        if is_child() {
            let mut mesh = odd("random", 240_000);
            mesh.vertices.scalars =
                (0..16 * mesh.positions.len() as u32).map(|n| (n as f32).to_bits()).collect();
            let scalars = Keep { all: true, names: Vec::new() };
            return tell_build_of(mesh, Settings { scalars, ..Settings::default() }, NONE);
        }
        let (_, held, resident) = measured("so_does_one_of_vertices_with_many_scalars");
        let promised = PROGRAM + THREAD + held;
        assert!(resident <= promised, "{resident} bytes resident, {promised} accounted for");
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn regions_just_too_small_to_be_cut_are_built_with_the_least_memory() {
        if is_child() {
            return tell_build_of(odd("hubs", 700_000), Settings::default(), (2, Bytes(MIN_MEMORY)));
        }
        let (_, _, resident) = measured("regions_just_too_small_to_be_cut_are_built_with_the_least_memory");
        assert!(resident <= MIN_MEMORY, "{resident} bytes resident");
    }

    #[test]
    fn threads_and_arrays_share_the_memory() {
        let of = |threads, mib, source: u64| {
            let resources = Resources { threads, memory: Bytes::mib(mib), ..Resources::default() };
            let (threads, budget) = divide(&resources, 8, source << 20);
            (threads, budget.limit() >> 20, budget.available_for_work() >> 20)
        };
        assert_eq!(of(2, 128, 0), (2, 48, 88));
        assert_eq!(of(0, 1024, 0), (8, 502, 924));
        assert_eq!(of(64, 128, 0), (3, 18, 78));
        assert_eq!(of(64, 508, 0), (16, 8, 328));
        assert_eq!(of(64, 1024, 0), (64, 44, 364));
        assert_eq!(of(256, 4096, 0), (256, 1196, 1516));
        assert_eq!(of(2, 1, 0), (2, 0, 88));
        // Arrays leave room for the tables of what there is to read, and no more than they have.
        assert_eq!(of(2, 128, 200), (2, 38, 88));
        assert_eq!(of(2, 128, 20_000), (2, 0, 88));
    }

    #[test]
    fn what_is_said_to_be_enough_is_and_one_less_is_not() {
        for (threads, mib, source, work) in
            [(1, 128, 0, 99), (2, 128, 40, 110), (0, 128, 9000, 600), (3, 1024, 0, 1000)]
        {
            let resources = Resources { threads, memory: Bytes::mib(mib), ..Resources::default() };
            for stay in [false, true] {
                let enough = enough(&resources, 8, source << 20, work << 20, u64::from(stay));
                let left = |memory| {
                    let resources = Resources { memory: Bytes(memory), ..resources.clone() };
                    let (_, budget) = divide(&resources, 8, source << 20);
                    // Arrays take all that they are granted.
                    let arrays = budget.reserve("arrays", budget.limit()).unwrap();
                    let _arrays = stay.then_some(arrays);
                    budget.reserve_work("work", work << 20).is_ok()
                };
                assert!(
                    left(enough) && left(enough + (64 << 20)) && !left(enough - (1 << 20)),
                    "{threads} {mib} {work} {stay}"
                );
            }
        }
    }
}
