//! Only what a scene needs: the ends of the range of errors, and what of a model costs nothing.

use crate::groups::{any_config, any_mesh, first_leak};
use crate::site::{
    ChpmFile, Site, config, leaks, levels_of_detail, odd_vertices, triangle_bits, with_attributes,
    without_copies,
};
use chpm_build::config::{Length, Topology};
use chpm_build::{BuildConfig, BuildError, Cancel, Silent};
use chpm_format::{BoundaryMode, ClusterRecord, checksum};
use chpm_measure::deviation;
use chpm_mesh::{Bytes, GroupId, Level, TriMesh};
use chpm_refine::{Cut, extract, random_cut};
use chpm_synth::{Shape, Synth, hand};
use proptest::prelude::*;

/// Percents of the diagonal.
type Percents = (Option<f64>, Option<f64>);

fn of(shape: Shape, triangles: u64) -> TriMesh {
    Synth::new(shape, triangles, 5).to_mesh()
}

fn ranged(config: &BuildConfig, (finest, target): Percents) -> BuildConfig {
    let mut config = config.clone();
    config.settings.finest_error = finest.map(Length::OfDiagonal);
    config.settings.target_error = target.map(Length::OfDiagonal);
    config
}

/// The mesh of a cut at one error.
fn at_error(file: &ChpmFile, error: f32) -> TriMesh {
    extract(file, &Cut::at_error(file, error).unwrap()).unwrap()
}

/// An error as the builder rounds it.
fn asked(source: &ChpmFile, percent: f64) -> f32 {
    let exact = percent / 100.0 * source.header().aabb().diagonal();
    let near = exact as f32;
    if f64::from(near) > exact { near.next_down() } else { near }
}

fn page_sums(file: &ChpmFile) -> Vec<u64> {
    let mut sums: Vec<u64> = file.clusters().iter().map(|cluster| cluster.page_checksum).collect();
    sums.sort_unstable();
    sums
}

/// Bytes of all pages, without the padding between them.
fn page_bytes(file: &ChpmFile) -> u64 {
    file.clusters().iter().map(|cluster| u64::from(cluster.page_len)).sum()
}

/// Errors of a file and some between.
fn errors(file: &ChpmFile) -> Vec<f32> {
    let mut all: Vec<f32> = file.clusters().iter().flat_map(|c| [c.min_error, c.max_error]).collect();
    all.sort_unstable_by(f32::total_cmp);
    let step = (all.len() / 12).max(1);
    let some = all.iter().step_by(step).flat_map(|error| [*error, error * 1.3]);
    some.chain([0.0, f32::MAX]).collect()
}

/// Whatever the error, `trimmed` draws what `whole` draws, but never finer than `finest`.
fn draws_the_same(trimmed: &ChpmFile, whole: &ChpmFile, finest: f32) -> bool {
    errors(whole).into_iter().chain(errors(trimmed)).all(|error| {
        let [a, b] = [at_error(trimmed, error), at_error(whole, error.max(finest))];
        triangle_bits(&a) == triangle_bits(&b)
    })
}

#[test]
fn what_is_kept_is_drawn_as_before() {
    let modes = [BoundaryMode::Lock, BoundaryMode::Dependencies];
    for shape in [Shape::Torus, Shape::Terrain, Shape::Isosurface, Shape::Plates] {
        let mesh = with_attributes(of(shape, 8000));
        let site = Site::of(&mesh);
        for mode in modes {
            let mut config = config(128);
            config.settings.boundary = mode;
            let (_, whole) = site.build(&config);
            let mut before = page_bytes(&whole);
            for percent in [0.003, 0.1, 0.5, 3.0, 300.0] {
                let (report, file) = site.build(&ranged(&config, (Some(percent), None)));
                assert!(draws_the_same(&file, &whole, asked(&whole, percent)), "{shape} {mode} {percent} %");
                assert_eq!((report.triangles, report.roots), (mesh.triangles.len() as u64, 1));
                let len = page_bytes(&file);
                assert!(len <= before, "{shape} {mode} {percent} %: {len} bytes after {before}");
                before = len;
            }
            // Nothing but the base mesh is left of a model that is seen from afar.
            let (_, file) = site.build(&ranged(&config, (Some(300.0), None)));
            let [root] = file.clusters() else {
                panic!("{shape} {mode}: {} clusters", file.clusters().len())
            };
            assert_eq!(root.vertex_count, root.base_vertex_count);
        }
    }
}

#[test]
fn neither_end_cracks_and_both_hold() {
    for shape in [Shape::Sphere, Shape::Torus, Shape::Terrain, Shape::Plates] {
        let mesh = of(shape, 8000);
        let (site, border) = (Site::of(&mesh), odd_vertices(&mesh));
        // Where nothing vanishes, samples of the source have something to be near to.
        let mut config = config(128);
        config.settings.topology = Topology::Keep;
        let (_, whole) = site.build(&config);
        for range in [(Some(0.2), None), (None, Some(0.5)), (Some(0.2), Some(0.5)), (Some(0.3), Some(0.3))] {
            let (_, file) = site.build(&ranged(&config, range));
            let found = first_leak(&file, &mesh, 60);
            assert_eq!(found, None, "{shape} {range:?}");
            for (index, lod) in levels_of_detail(&file).iter().enumerate() {
                let found = leaks(lod, &border);
                assert!(found.is_empty(), "{shape} {range:?}, cut {index}: {found:?}");
            }
            assert_eq!(file.is_trimmed(), range.0.is_some(), "{shape} {range:?}");
            assert!(page_bytes(&file) < page_bytes(&whole), "{shape} {range:?}");
            let slack = 1e-6 * whole.header().aabb().diagonal();
            if let (Some(percent), _) = range {
                let finest = asked(&whole, percent);
                let measured = deviation(&at_error(&file, 0.0), &mesh, 10).max();
                assert!(measured <= f64::from(finest) + slack, "{shape} {range:?}: {measured} of {finest}");
            }
            if let (_, Some(percent)) = range {
                let target = asked(&whole, percent);
                assert!(file.header().max_error <= target, "{shape} {range:?}");
                assert!(file.roots().count() > 1, "{shape} {range:?}");
                let measured = deviation(&at_error(&file, f32::MAX), &mesh, 10).max();
                assert!(measured <= f64::from(target) + slack, "{shape} {range:?}: {measured} of {target}");
            }
        }
    }
}

#[test]
fn the_ends_are_independent() {
    let site = Site::of(&of(Shape::Isosurface, 8000));
    let (_, whole) = site.build(&config(128));
    let (_, coarse) = site.build(&ranged(&config(128), (None, Some(2.0))));
    let (_, both) = site.build(&ranged(&config(128), (Some(0.2), Some(2.0))));
    assert!(draws_the_same(&both, &coarse, asked(&whole, 0.2)));
    // What is below the target is built as if there were none.
    let below = asked(&whole, 0.2);
    assert!(triangle_bits(&at_error(&coarse, below)) == triangle_bits(&at_error(&whole, below)));
    assert_eq!(coarse.header().source_triangle_count, whole.header().source_triangle_count);
}

#[test]
fn a_cluster_that_cannot_go_with_its_siblings_keeps_one_position() {
    let site = Site::of(&of(Shape::Plates, 12_000));
    let (_, file) = site.build(&ranged(&config(64), (Some(0.1), None)));
    let finest = asked(&file, 0.1);
    let single = |c: &&ClusterRecord| c.is_trimmed() && c.vertex_count == c.base_vertex_count;
    assert!(file.clusters().iter().filter(single).count() > 0);
    // And nothing is kept that could go.
    let above = |id: &u32| file.groups()[file.clusters()[*id as usize].group as usize].max_error > finest;
    let split = (0..file.groups().len() as u32).map(GroupId).filter(|id| !file.fine(*id).is_empty());
    assert!(split.into_iter().all(|id| file.fine(id).iter().any(above)));
    // The levels of what is left follow from what is left.
    let levels: Vec<u32> = file.levels().iter().map(|level| level.cluster_count).collect();
    assert!(levels.iter().all(|clusters| *clusters > 0), "{levels:?}");
}

#[test]
fn units_and_percents_agree() {
    let site = Site::of(&of(Shape::Torus, 6000));
    let (_, whole) = site.build(&config(128));
    let (_, percents) = site.build(&ranged(&config(128), (Some(0.1), Some(1.0))));
    let mut config = config(128);
    let units = |percent: f64| Some(Length::Units(percent / 100.0 * whole.header().aabb().diagonal()));
    (config.settings.finest_error, config.settings.target_error) = (units(0.1), units(1.0));
    let (_, units) = site.build(&config);
    assert_eq!(page_sums(&percents), page_sums(&units));
}

#[test]
fn an_empty_range_is_refused_and_a_single_error_is_not() {
    let site = Site::of(&of(Shape::Torus, 2000));
    let crossed = ranged(&config(128), (Some(2.0), Some(1.0)));
    let error = site.try_build(&crossed, &Silent, &Cancel::default()).unwrap_err();
    assert!(matches!(error, BuildError::ErrorRange { finest, coarsest } if finest > coarsest), "{error}");
    assert_eq!(site.files(), ["mesh.ply"]);
    let (_, file) = site.build(&ranged(&config(128), (Some(1.0), Some(1.0))));
    assert!(file.clusters().iter().all(|c| c.vertex_count == c.base_vertex_count || !c.is_leaf()));
}

#[test]
fn what_costs_something_stays() {
    // No vertex of a ball can go for nothing.
    let site = Site::of(&hand::icosphere(4));
    let (_, whole) = site.build(&config(128));
    let (_, pruned) = site.build(&ranged(&config(128), (Some(0.0), None)));
    assert!(!pruned.is_trimmed());
    assert_eq!(page_sums(&pruned), page_sums(&whole));
}

#[test]
fn a_plate_costs_what_is_not_flat() {
    let side = 128;
    let flat = hand::grid(side, side);
    let (_, file) = Site::of(&flat).build(&ranged(&config(1024), (Some(0.0), None)));
    assert_eq!((file.clusters().len(), file.header().max_error), (1, 0.0));
    assert!(file.header().source_triangle_count <= 100 && file.is_trimmed());
    assert_eq!(deviation(&at_error(&file, 0.0), &flat, 10).max(), 0.0);

    let mut bumped = flat.clone();
    let [low, high] = [flat.positions[0], flat.positions[flat.positions.len() - 1]];
    for p in &mut bumped.positions {
        let [x, y] = [0, 1].map(|axis| (p[axis] - low[axis]) / (high[axis] - low[axis]));
        p[2] = (0.02 - (x - 0.7).powi(2) - (y - 0.4).powi(2)).max(0.0);
    }
    let site = Site::of(&bumped);
    let (_, whole) = site.build(&config(512));
    let (_, file) = site.build(&ranged(&config(512), (Some(0.0), None)));
    assert!(draws_the_same(&file, &whole, 0.0));
    let (left, all) = (file.header().source_triangle_count, bumped.triangles.len() as u64);
    let [small, large] = [&file, &whole].map(page_bytes);
    assert!(3 * left < all && 2 * small < large, "{left} of {all} triangles, {small} of {large} bytes");
    assert_eq!(first_leak(&file, &bumped, 60), None);
    let measured = deviation(&at_error(&file, 0.0), &bumped, 10).max();
    assert!(measured < 1e-6 * whole.header().aabb().diagonal(), "{measured}");
}

#[test]
fn threads_and_memory_do_not_show_at_either_end() {
    for shape in [Shape::Isosurface, Shape::Plates] {
        let site = Site::of(&with_attributes(of(shape, 12_000)));
        for range in [(Some(0.2), None), (Some(0.05), Some(1.0))] {
            let mut config = ranged(&config(128), range);
            let mut sums = Vec::new();
            for (threads, memory) in [(1, 1 << 28), (4, 1 << 28), (2, 1 << 16)] {
                (config.resources.threads, config.resources.memory) = (threads, Bytes(memory));
                sums.push(checksum(&site.bytes(&config).1));
            }
            assert!(sums.iter().all(|sum| *sum == sums[0]), "{shape} {range:?}: {sums:x?}");
        }
    }
}

/// From a ten-thousandth of a percent up.
fn percent() -> impl Strategy<Value = Option<f64>> {
    prop::option::of((-4.0..1.7f64).prop_map(|exponent| 10.0_f64.powf(exponent)))
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 128, ..ProptestConfig::default() })]

    #[test]
    fn whatever_is_left_out_nothing_cracks(
        mesh in any_mesh(),
        config in any_config(),
        (a, b, exact) in (percent(), percent(), any::<bool>()),
    ) {
        let proper = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
        prop_assume!(mesh.triangles.iter().any(proper));
        let finest = if exact { Some(0.0) } else { a };
        let range = (finest, b.map(|b| b.max(finest.unwrap_or(0.0))));
        let site = Site::of(&mesh);
        let (_, file) = site.build(&ranged(&config, range));
        let mesh = without_copies(&mesh);
        let leak = first_leak(&file, &mesh, 15);
        prop_assert!(leak.is_none(), "{range:?}: {leak:?}");
        let border = odd_vertices(&mesh);
        for lod in levels_of_detail(&file) {
            prop_assert!(leaks(&lod, &border).is_empty(), "{range:?}: {} triangles", lod.triangles.len());
        }
        let (_, whole) = site.build(&ranged(&config, (None, range.1)));
        let finest = range.0.map_or(0.0, |percent| asked(&whole, percent));
        // What is left out goes by distances. Where something has vanished farther away than that, errors alone choose less of the whole.
        let vanished = whole.groups().iter().any(|group| group.gaps.base > finest);
        prop_assert!(vanished || draws_the_same(&file, &whole, finest), "{range:?}");
        prop_assert!(range.1.is_none_or(|percent| file.header().max_error <= asked(&whole, percent)));
    }
}

/// A terrain, and specks above it that lie apart from it and from each other.
fn dusty() -> TriMesh {
    let mut mesh = of(Shape::Terrain, 8000);
    let size = chpm_mesh::Aabb::of_points(&mesh.positions).diagonal() as f32;
    let (speck, low) = (hand::tetrahedron(), mesh.positions[0]);
    for i in 0..300_u32 {
        let first = mesh.positions.len() as u32;
        // Places without a pattern: parts of multiples of irrational numbers.
        let place = [0.754_877_7, 0.569_840_3, 0.430_159_7].map(|step| (step * i as f32).fract() * size);
        let at = |p: &[f32; 3]| std::array::from_fn(|axis| low[axis] + place[axis] + 2e-3 * size * p[axis]);
        mesh.positions.extend(speck.positions.iter().map(at));
        mesh.triangles.extend(speck.triangles.iter().map(|t| t.map(|v| v + first)));
    }
    mesh
}

#[test]
fn what_vanished_is_no_farther_than_is_stored() {
    let mesh = dusty();
    let all = config(256);
    for config in [all.clone(), ranged(&all, (Some(0.5), None)), ranged(&all, (Some(3.0), Some(8.0)))] {
        let (_, file) = Site::of(&mesh).build(&config);
        let gaps = |of: fn(&chpm_format::Gaps) -> f32| {
            file.groups().iter().map(|group| of(&group.gaps)).fold(0.0, f32::max)
        };
        assert!(gaps(|gaps| gaps.base) > 0.0 && gaps(|gaps| gaps.base) < 1e3, "something vanishes");
        let levels = (0..file.levels().len() as u32).map(|level| Cut::at_level(&file, Level(level)));
        let random = (0..12).map(|seed| random_cut(&file, seed).unwrap());
        let steps = [0.002, 0.01, 0.05, 0.2, 0.5];
        let size = file.header().aabb().diagonal() as f32;
        let asked = steps.map(|step| Cut::at_distance(&file, step * size).unwrap());
        let finest = config.settings.finest_error.map_or(0.0, |length| length.of(size.into()) as f32);
        for (cut, step) in asked.iter().zip(steps) {
            let distance = cut.distance(&file).unwrap();
            assert!(distance <= (step * size).max(finest), "{distance} of {step}");
        }
        let mut far = false;
        for cut in levels.chain(random).chain(asked.clone()) {
            let measured = deviation(&extract(&file, &cut).unwrap(), &mesh, 10).max();
            let (error, distance) = (cut.error(&file).unwrap(), cut.distance(&file).unwrap());
            assert!(measured <= f64::from(distance) * (1.0 + 1e-6), "{measured} {distance}");
            far |= measured > f64::from(error);
        }
        assert!(far, "errors alone would not have told");
    }
}
