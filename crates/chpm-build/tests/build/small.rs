//! What is built of a source whose small components are left out: what would be built of one that never had them.

use crate::site::{ChpmFile, Site, config, triangle_bits, with_attributes};
use chpm_build::config::Length;
use chpm_build::report::{Repairs, SmallComponents};
use chpm_build::{BuildConfig, BuildError, Cancel, Silent};
use chpm_format::verify;
use chpm_mesh::{Aabb, Bytes, ClusterId, Level, TriMesh};
use chpm_refine::{Cut, extract};
use chpm_synth::{Shape, Synth, hand};

fn config_of(min_component: Option<Length>) -> BuildConfig {
    let mut config = config(512);
    config.settings.min_component = min_component;
    config
}

/// Appends a copy of `part`, scaled and moved.
fn add(mesh: &mut TriMesh, part: &TriMesh, scale: f32, to: [f32; 3]) {
    let base = mesh.positions.len() as u32;
    mesh.positions.extend(part.positions.iter().map(|p| [0, 1, 2].map(|axis| scale * p[axis] + to[axis])));
    mesh.triangles.extend(part.triangles.iter().map(|t| t.map(|v| base + v)));
}

/// A torus; and one with specks of every size up to a tenth of it before, within and behind it in the file, and a vertex that nothing uses.
fn clean_and_dusty() -> (TriMesh, TriMesh, SmallComponents) {
    let mut torus = TriMesh::default();
    add(&mut torus, &Synth::new(Shape::Torus, 20_000, 0).to_mesh(), 1.0, [0.0; 3]);
    let first = torus.positions[0];
    torus.positions.push(first);
    let speck = hand::icosphere(1);
    let box_of = Aabb::of_points(&torus.positions);
    let mut dusty = TriMesh::default();
    let dust = |dusty: &mut TriMesh, count: u32| {
        for i in 0..count {
            let share = (i + 1) as f32 / count as f32;
            let scale =
                0.1 * share * box_of.diagonal() as f32 / Aabb::of_points(&speck.positions).diagonal() as f32;
            // Far outside of the torus, too.
            let to = [0, 1, 2]
                .map(|axis| 3.0 * share * box_of.max[axis] * [1.0, -1.0, 0.7][(i as usize + axis) % 3]);
            add(dusty, &speck, 0.99 * scale, to);
        }
    };
    dust(&mut dusty, 40);
    add(&mut dusty, &torus, 1.0, [0.0; 3]);
    dust(&mut dusty, 70);
    let components = 110;
    let small = SmallComponents { components, triangles: components * speck.triangles.len() as u64 };
    (with_attributes(torus), dusty, small)
}

/// Gives the vertices of `dusty` that are those of `clean` their attributes, and the others some.
fn dressed(mut dusty: TriMesh, clean: &TriMesh, first: usize) -> TriMesh {
    dusty = with_attributes(dusty);
    let range = first..first + clean.positions.len();
    dusty.normals[range.clone()].copy_from_slice(&clean.normals);
    dusty.colors[range].copy_from_slice(&clean.colors);
    dusty
}

fn pages(file: &ChpmFile) -> Vec<Vec<u8>> {
    (0..file.clusters().len() as u32).map(|id| file.page_bytes(ClusterId(id)).to_vec()).collect()
}

#[test]
fn what_is_kept_is_built_as_if_it_were_all() {
    let (clean, dusty, small) = clean_and_dusty();
    let first = 40 * hand::icosphere(1).positions.len();
    let dusty = dressed(dusty, &clean, first);
    let (expected, whole) = Site::of(&clean).build(&config_of(None));
    let tenth = Length::Units(0.1 * Aabb::of_points(&clean.positions).diagonal());
    let (report, file) = Site::of(&dusty).build(&config_of(Some(tenth)));
    assert_eq!(report.repairs, Repairs { small_components: Some(small), ..expected.repairs });
    assert_eq!(report.triangles, clean.triangles.len() as u64);
    assert_eq!(file.header().aabb(), whole.header().aabb());
    assert!(pages(&file) == pages(&whole), "other pages");
    let finest = extract(&file, &Cut::at_level(&file, Level(0))).unwrap();
    assert!(triangle_bits(&finest) == triangle_bits(&clean));
    let repairs = file.metadata().unwrap().repairs;
    let told = |name: &str| repairs.iter().find(|(told, _)| told == name).map(|(_, count)| *count);
    assert_eq!(told("small-components"), Some(small.components));
    assert_eq!(told("small-component-triangles"), Some(small.triangles));
}

#[test]
fn resources_do_not_show() {
    let (_, dusty, small) = clean_and_dusty();
    let site = Site::of(&dusty);
    let mut config = config_of(Some(Length::OfDiagonal(3.0)));
    let (report, whole) = site.bytes(&config);
    let found = report.repairs.small_components.unwrap();
    assert!((10..small.components).contains(&found.components), "{found:?}");
    for (threads, memory) in [(1, 0), (3, 1 << 20), (2, 1 << 30)] {
        (config.resources.threads, config.resources.memory) = (threads, Bytes(memory));
        let (report, bytes) = site.bytes(&config);
        assert!(bytes == whole, "{threads} threads, {memory} bytes");
        assert_eq!(report.repairs.small_components, Some(found));
    }
}

/// Three cubes of 1, 2 and 3 units, so that their diagonals are known, and a strip that hangs together at single vertices.
fn cubes() -> TriMesh {
    let mut mesh = TriMesh::default();
    for (size, at) in [(2.0, 10.0), (1.0, 0.0), (3.0, 20.0)] {
        add(&mut mesh, &hand::cube(), size, [at, 0.0, 0.0]);
    }
    add(&mut mesh, &hand::bow_tie(), 0.5, [0.0, 50.0, 0.0]);
    mesh
}

#[test]
fn a_component_of_just_the_size_stays() {
    let site = Site::of(&cubes());
    let kept = |size| site.build(&config_of(size)).0;
    let whole = kept(None);
    assert_eq!((whole.repairs.components, whole.repairs.small_components), (4, None));
    let root = |n: f64| n.sqrt();
    let tie = Aabb::of_points(&hand::bow_tie().positions).diagonal() * 0.5;
    for size in [0.0, root(3.0).min(tie)] {
        let report = kept(Some(Length::Units(size)));
        assert_eq!(report.repairs, Repairs { small_components: Some(Default::default()), ..whole.repairs });
    }
    for (size, left, triangles) in [(root(12.0), 2, 24), (root(27.0), 1, 12)] {
        let report = kept(Some(Length::Units(size)));
        assert_eq!((report.repairs.components, report.triangles), (left, triangles));
        let small = report.repairs.small_components.unwrap();
        assert_eq!(small.components, 4 - left);
        assert_eq!(small.triangles, whole.triangles - triangles);
    }
}

#[test]
fn what_leaves_nothing_is_an_error_that_names_a_size_that_leaves_something() {
    let site = Site::of(&cubes());
    let failed = |size| {
        let error = site.try_build(&config_of(Some(size)), &Silent, &Cancel::default()).unwrap_err();
        assert_eq!(site.files(), ["mesh.ply"]);
        error
    };
    let error = failed(Length::Units(5.2));
    let told = error.to_string();
    let BuildError::AllSmall { components: 4, least: 5.2, largest, .. } = error else { panic!("{told}") };
    assert!(told.contains("mesh.ply: all 4 components are smaller than 5.2"), "{told}");
    assert!(told.ends_with(&format!("give --min-component {largest:?} or less")), "{told}");
    assert_eq!(site.build(&config_of(Some(Length::Units(largest)))).0.triangles, 12);
    assert!(matches!(failed(Length::OfDiagonal(100.0)), BuildError::AllSmall { .. }));
    let one = Site::of(&hand::cube());
    let config = |percent| config_of(Some(Length::OfDiagonal(percent)));
    assert_eq!(one.build(&config(100.0)).0.triangles, 12);
    let error = one.try_build(&config(100.1), &Silent, &Cancel::default()).unwrap_err().to_string();
    assert!(error.contains("its only component measures 1.73"), "{error}");
}

#[test]
fn origin_rounding_and_errors_are_those_of_what_is_kept() {
    let (clean, mut dusty, small) = clean_and_dusty();
    let far = [435_112.25, 5_411_907.5, 311.0];
    let expected = Site::of_doubles(&clean, far).build(&config_of(None)).1;
    // A speck in the zero point would cost all others their digits.
    add(&mut dusty, &hand::tetrahedron(), 1e-3, far.map(|x| -x as f32));
    let site = Site::of_doubles(&dressed(dusty, &clean, 40 * hand::icosphere(1).positions.len()), far);
    let tenth = Length::Units(0.1 * Aabb::of_points(&clean.positions).diagonal());
    let (report, file) = site.build(&config_of(Some(tenth)));
    assert_eq!(file.header().origin, expected.header().origin);
    assert_eq!(file.header().aabb(), expected.header().aabb());
    assert_eq!(file.metadata().unwrap().warnings, expected.metadata().unwrap().warnings);
    assert!(pages(&file) == pages(&expected), "other pages");
    assert_eq!(report.repairs.small_components.unwrap().components, small.components + 1);
    assert!(verify(&file, |_, _| ()).is_ok());
}

#[test]
fn nothing_is_told_where_nothing_was_asked() {
    let (_, file) = Site::of(&cubes()).build(&config_of(None));
    let metadata = file.metadata().unwrap();
    assert!(metadata.repairs.iter().all(|(name, _)| !name.starts_with("small")));
    assert!(metadata.settings.iter().all(|(name, _)| name != "min-component"));
}
