//! The same source and settings give the same bytes, whatever the resources; a layout changes order only.

use crate::site::{ChpmFile, Site, config, triangle_bits, with_attributes};
use chpm_build::BuildConfig;
use chpm_build::config::Layout;
use chpm_format::checksum;
use chpm_measure::cache::{VertexCache, vertex_cache};
use chpm_mesh::{Bytes, ClusterId, GroupId, Level};
use chpm_partition::Partitioner;
use chpm_refine::{Cut, extract, random_cut};
use chpm_synth::{Shape, Synth};

fn with_resources(config: &BuildConfig, threads: usize, memory: u64) -> BuildConfig {
    let mut config = config.clone();
    (config.resources.threads, config.resources.memory) = (threads, Bytes(memory));
    config
}

#[test]
fn threads_and_memory_do_not_show() {
    for shape in [Shape::Isosurface, Shape::Terrain] {
        let site = Site::of(&with_attributes(Synth::new(shape, 20_000, 4).to_mesh()));
        for partitioner in [Partitioner::Metis, Partitioner::Greedy] {
            let mut config = config(512);
            config.settings.partitioner = partitioner;
            let (_, first) = site.bytes(&with_resources(&config, 1, 1 << 30));
            for (threads, memory) in [(1, 1 << 16), (2, 1 << 30), (2, 1 << 18), (4, 1 << 16), (4, 1 << 22)] {
                let (report, again) = site.bytes(&with_resources(&config, threads, memory));
                assert_eq!(
                    (checksum(&again), again.len()),
                    (checksum(&first), first.len()),
                    "{shape} by {partitioner} with {threads} threads and {memory} bytes"
                );
                let most = memory.max(chpm_build::MIN_MEMORY);
                assert!(report.budget_peak <= most, "{} of {most} bytes", report.budget_peak);
            }
        }
    }
}

#[test]
fn a_seed_shows_and_a_work_directory_does_not() {
    let site = Site::of(&Synth::new(Shape::Torus, 8_000, 0).to_mesh());
    let (_, first) = site.bytes(&config(256));
    let elsewhere = tempfile::tempdir().unwrap();
    let mut other = config(256);
    other.resources.work_dir = Some(elsewhere.path().to_owned());
    assert!(site.bytes(&other).1 == first);
    assert_eq!(std::fs::read_dir(elsewhere.path()).unwrap().count(), 0, "the work directory was left behind");
    other.settings.seed += 1;
    assert!(site.bytes(&other).1 != first);
}

/// What a cluster is, whatever its number and the order inside.
fn clusters(file: &ChpmFile) -> Vec<[u32; 8]> {
    let facts = file.clusters().iter().map(|c| {
        let (min, max) = (c.min_error.to_bits(), c.max_error.to_bits());
        let counts = [c.vertex_count, c.base_vertex_count, c.triangle_count, c.base_triangle_count];
        [c.level, min, max, counts[0], counts[1], counts[2], counts[3], c.shared_count]
    });
    let mut facts: Vec<_> = facts.collect();
    facts.sort_unstable();
    facts
}

/// Misses for each triangle when all pages are drawn through a cache, at their finest, middle and base positions.
fn misses(file: &ChpmFile) -> [f64; 3] {
    let mut drawn = [VertexCache::default(); 3];
    for index in 0..file.clusters().len() as u32 {
        let page = file.page(ClusterId(index)).unwrap();
        let mesh = page.view().progressive_mesh();
        let (base, finest) = (mesh.base_vertex_count, mesh.vertex_count);
        for (n, sum) in [finest, base.midpoint(finest), base].into_iter().zip(&mut drawn) {
            let mut triangles = Vec::new();
            mesh.triangles_at(n, &mut triangles);
            *sum += vertex_cache(triangles.iter().map(|corners| corners.map(u32::from)), 16);
        }
    }
    drawn.map(|cache| cache.acmr())
}

#[test]
fn pages_serve_vertex_caches_at_every_position() {
    let site = Site::of(&Synth::new(Shape::Isosurface, 40_000, 2).to_mesh());
    let mut config = config(4096);
    let (_, file) = site.build(&config);
    let [finest, middle, base] = misses(&file);
    assert!(finest < 0.73 && middle < 0.69 && base < 0.74, "{finest}, {middle}, {base}");
    config.settings.layout = Layout::CacheOblivious;
    let (_, other) = site.build(&config);
    let better = misses(&file).into_iter().zip(misses(&other)).all(|(ours, other)| ours < 0.95 * other);
    assert!(better, "{:?}", misses(&other));
}

#[test]
fn a_layout_changes_order_only() {
    for shape in [Shape::Isosurface, Shape::Plates] {
        let site = Site::of(&with_attributes(Synth::new(shape, 20_000, 6).to_mesh()));
        let mut config = config(512);
        config.settings.layout = Layout::Simplification;
        let (_, plain) = site.build(&config);
        let mesh = |file: &ChpmFile, cut: Cut| triangle_bits(&extract(file, &cut).unwrap());
        for layout in [Layout::VertexCache, Layout::CacheOblivious] {
            config.settings.layout = layout;
            let (_, laid_out) = site.build(&config);
            assert!(laid_out.bytes() != plain.bytes());
            assert_eq!(clusters(&laid_out), clusters(&plain), "{shape}, {layout}");
            for level in 0..plain.levels().len() as u32 {
                let [a, b] = [&laid_out, &plain].map(|f| mesh(f, Cut::at_level(f, Level(level))));
                assert!(a == b, "{shape}, {layout}, level {level}");
            }
            let largest = plain.clusters().iter().map(|c| c.max_error).fold(0.0, f32::max);
            for part in [0.0, 1e-3, 0.03, 0.2, 1.0] {
                let [a, b] = [&laid_out, &plain].map(|f| mesh(f, Cut::at_error(f, part * largest).unwrap()));
                assert!(a == b, "{shape}, {layout}, {part} of the largest error");
            }
            assert!(random_cut(&laid_out, 3).unwrap().check(&laid_out).is_ok());
        }
    }
}

/// What a split brings is one run of pages, and what costs more comes first.
#[test]
fn a_split_is_one_read() {
    let site = Site::of(&Synth::new(Shape::Isosurface, 20_000, 6).to_mesh());
    let (_, file) = site.build(&config(512));
    let mut runs: Vec<(u32, f32)> = Vec::new();
    for group in (0..file.groups().len() as u32).map(GroupId) {
        let mut fine = file.fine(group).to_vec();
        fine.sort_unstable();
        assert!(fine.windows(2).all(|pair| pair[1] == pair[0] + 1), "{group:?}: {fine:?}");
        let base = |id: &u32| file.groups()[file.clusters()[*id as usize].group().index()].max_error;
        runs.extend(fine.first().map(|first| (*first, fine.iter().map(base).fold(0.0, f32::max))));
    }
    runs.sort_by_key(|(first, _)| *first);
    assert!(runs.len() > 10 && runs.windows(2).all(|pair| pair[1].1 <= pair[0].1), "{runs:?}");
}
