//! Positions on one lattice, of meshes of any kind, size and place.

use crate::site::{Site, config};
use chpm_build::config::{Layout, Positions};
use chpm_build::{BuildConfig, BuildReport};
use chpm_format::Page;
use chpm_mesh::{Bytes, ClusterId, TriMesh};
use chpm_synth::{Shape, Synth, hand};
use std::collections::BTreeMap;

fn config_of(bits: u8) -> BuildConfig {
    let mut config = config(256);
    config.settings.positions = Positions::Lattice(bits);
    config
}

/// Builds, and checks that shared vertices have one position in all clusters, and that the packed file says the same; the rest is for `verify`.
fn builds(name: &str, site: &Site, bits: u8) -> BuildReport {
    let (report, file) = site.build(&config_of(bits));
    let step = file.metadata().unwrap().lattice_step().unwrap().unwrap();
    let mut shared = BTreeMap::new();
    for id in (0..file.clusters().len() as u32).map(ClusterId) {
        let page = file.page(id).unwrap();
        let page = page.view();
        for (vertex, shared_id) in page.shared() {
            let position = page.positions[usize::from(vertex)].map(f32::to_bits);
            assert_eq!(*shared.entry(shared_id).or_insert(position), position, "{name}");
        }
    }
    let bounds = file.header().aabb();
    let side =
        (0..3).map(|axis| f64::from(bounds.max[axis]) - f64::from(bounds.min[axis])).fold(0.0, f64::max);
    // The ends of the longest side may have gone outward by half a step each.
    assert!(side / step <= f64::from((1u32 << bits) + 1), "{name}: {side} {step}");

    let mut packed = config_of(bits);
    packed.settings.packed = true;
    let (_, packed) = site.build(&packed);
    let told = chpm_format::same::compare(&file, &packed, || ()).unwrap().told;
    assert_eq!(told, [""; 0], "{name}");
    report
}

#[test]
fn meshes_of_any_kind_lie_on_lattices() {
    let mut single = TriMesh { triangles: vec![[0, 1, 2]], ..TriMesh::default() };
    single.positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.3, 0.0]];
    for (name, mesh) in [
        ("one triangle", single),
        ("torus", Synth::new(Shape::Torus, 3_000, 0).to_mesh()),
        ("grid", hand::grid(30, 30)),
        ("soup", hand::soup(300)),
        ("moebius", hand::moebius(300)),
        ("fan", hand::fan(700)),
        ("copies", hand::duplicate_faces()),
    ] {
        for bits in [8, 13, 24] {
            builds(name, &Site::of(&mesh), bits);
        }
    }
}

#[test]
fn meshes_of_any_size_and_place_lie_on_lattices() {
    let torus = Synth::new(Shape::Torus, 1_500, 0).to_mesh();
    let changed = |scale: f32, to: [f32; 3], flat: [f32; 3]| {
        let mut mesh = torus.clone();
        for p in &mut mesh.positions {
            *p = [0, 1, 2].map(|axis| p[axis] * scale * flat[axis] + to[axis]);
        }
        mesh
    };
    let (zero, whole) = ([0.0; 3], [1.0; 3]);
    for (name, mesh) in [
        ("tiny", changed(1e-43, zero, whole)),
        ("small", changed(1e-30, zero, whole)),
        ("huge", changed(1e35, zero, whole)),
        ("far", changed(1.0, [3e5, -1e6, 0.0], whole)),
        ("flat", changed(1.0, [0.0, 0.0, 7.3], [1.0, 1.0, 0.0])),
        ("line", changed(1.0, zero, [0.0, 1.0, 0.0])),
        ("point", changed(0.0, [1.1, -2.3, 1e-3], whole)),
    ] {
        for bits in [8, 16, 24] {
            builds(name, &Site::of(&mesh), bits);
        }
    }
    for offset in [[4.5e6, -3.25e5, 117.125], [1e15, 0.0, 1e-7], [-0.1; 3]] {
        builds("doubles", &Site::of_doubles(&torus, offset), 12);
    }
}

/// Builds on a lattice by the model's detail; the step.
fn auto(site: &Site) -> Option<f64> {
    let mut config = config(256);
    config.settings.positions = Positions::Auto;
    let (report, file) = site.build(&config);
    let step = file.metadata().unwrap().lattice_step().unwrap();
    assert_eq!(report.lattice_step, step);
    assert!(report.notes.iter().any(|note| note.starts_with("coordinates are")), "{:?}", report.notes);
    step
}

#[test]
fn detail_decides_the_step_wherever_and_however_large_the_model_is() {
    let torus = Synth::new(Shape::Isosurface, 20_000, 3).to_mesh();
    let scaled = |scale: f32| {
        let mut mesh = torus.clone();
        mesh.positions.iter_mut().flatten().for_each(|x| *x *= scale);
        mesh
    };
    let step = auto(&Site::of(&torus)).unwrap();
    for power in [-100, -20, 3, 100] {
        let scale = 2f32.powi(power);
        assert_eq!(auto(&Site::of(&scaled(scale))), Some(step * f64::from(scale)), "2^{power}");
    }
    assert_eq!(auto(&Site::of_doubles(&torus, [4.5e6, -3.25e5, 117.125])), Some(step));

    // It is a share of what level 0 then errs in the median, within the factor of two between powers of two and that of a sample.
    let (_, exact) = Site::of(&torus).build(&config(256));
    let mut errors: Vec<f64> =
        exact.clusters().iter().filter(|c| c.is_leaf()).map(|c| c.max_error.into()).collect();
    errors.sort_unstable_by(f64::total_cmp);
    let share = step / errors[errors.len() / 2];
    assert!((0.0625..=0.5).contains(&share), "{share}");

    // More of the same is as fine, and detail below what is asked for is none.
    let mut coarse = config(256);
    (coarse.settings.positions, coarse.settings.finest_error) =
        (Positions::Auto, Some(chpm_build::config::Length::OfDiagonal(2.0)));
    let coarse = Site::of(&torus).build(&coarse).1.metadata().unwrap().lattice_step().unwrap();
    assert!(coarse > Some(2.0 * step), "{coarse:?} {step}");
}

#[test]
fn arrays_on_disk_have_the_same_detail() {
    let mesh = Synth::new(Shape::Isosurface, 60_000, 3).to_mesh();
    for site in [Site::of(&mesh), Site::of_doubles(&mesh, [4.5e6, -3.25e5, 117.125])] {
        let mut config = config(256);
        config.settings.positions = Positions::Auto;
        let (_, file) = site.build(&config);
        (config.resources.memory, config.resources.threads) = (Bytes(0), 1);
        let (_, on_disk) = site.build(&config);
        assert!(file.bytes() == on_disk.bytes());
    }
}

#[test]
fn models_without_detail_stay_exact() {
    let mut single = TriMesh { triangles: vec![[0, 1, 2]], ..TriMesh::default() };
    single.positions = vec![[0.1; 3], [1.0, 0.0, 0.0], [0.0, 0.3, 0.0]];
    let mut point = Synth::new(Shape::Torus, 1_500, 0).to_mesh();
    point.positions.fill([1.1, -2.3, 1e-3]);
    for (name, mesh) in [("one triangle", single), ("grid", hand::grid(60, 60)), ("point", point)] {
        assert_eq!(auto(&Site::of(&mesh)), None, "{name}");
    }
    let torus = Synth::new(Shape::Torus, 1_500, 0).to_mesh();
    for (name, mesh) in [
        ("torus", torus),
        ("soup", hand::soup(300)),
        ("moebius", hand::moebius(300)),
        ("fan", hand::fan(700)),
        ("copies", hand::duplicate_faces()),
    ] {
        let step = auto(&Site::of(&mesh));
        assert!(step.is_none_or(|step| step > 0.0), "{name}");
    }
}

#[test]
fn what_falls_together_stays_and_is_counted() {
    let mesh = Synth::new(Shape::Isosurface, 60_000, 1).to_mesh();
    let (exact, coarse) = (Site::of(&mesh).build(&config(256)).0, builds("coarse", &Site::of(&mesh), 8));
    assert_eq!((coarse.triangles, exact.repairs.zero_area_faces), (exact.triangles, 0));
    assert!(coarse.repairs.zero_area_faces > 10, "{:?}", coarse.repairs);
    assert_eq!(coarse.repairs.components, exact.repairs.components);
}

#[test]
fn vertices_of_the_base_come_as_triangles_use_them_and_triangles_from_the_least_corner() {
    let site = Site::of(&Synth::new(Shape::Torus, 5_000, 0).to_mesh());
    let in_order = |page: &Page<'_>| {
        let base = page.base_vertex_count as u16;
        let mut next = 0;
        let mut comes_next = |vertex: u16| {
            let known = vertex <= next;
            next = next.max(vertex + 1);
            known
        };
        page.triangles.iter().all(|triangle| {
            triangle[0] < triangle[1].min(triangle[2])
                && triangle.iter().all(|vertex| *vertex >= base || comes_next(*vertex))
        })
    };
    let (_, ordered) = site.build(&config(256));
    let mut as_is = config(256);
    as_is.settings.layout = Layout::Simplification;
    let (_, plain) = site.build(&as_is);
    let ids = || (0..ordered.clusters().len() as u32).map(ClusterId);
    assert!(ids().all(|id| in_order(&ordered.page(id).unwrap().view())));
    assert!(!ids().all(|id| in_order(&plain.page(id).unwrap().view())));
}
