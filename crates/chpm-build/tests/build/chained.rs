//! Chained pages of real builds: the same clusters, groups and cuts as of raw ones, in fewer bytes, whatever the resources.

use crate::site::{Site, config, with_attributes};
use chpm_build::BuildConfig;
use chpm_format::{ClusterRecord, packed};
use chpm_mesh::{Bytes, ClusterId, TriMesh};
use chpm_synth::{Shape, Synth, hand};

fn stored(config: &BuildConfig, chained: bool) -> BuildConfig {
    let mut config = config.clone();
    (config.settings.packed, config.settings.chained) = (true, chained);
    config
}

/// Builds a mesh with packed and with chained pages, and compares the two files; how many pages of the latter are chained, and all but the roots.
fn compare(name: &str, mesh: &TriMesh, config: &BuildConfig) -> [usize; 2] {
    let site = Site::of(mesh);
    let (_, raw) = site.build(config);
    let (_, packed) = site.build(&stored(config, false));
    let (_, chained) = site.build(&stored(config, true));
    let told = chpm_format::same::compare(&raw, &chained, || ()).unwrap().told;
    assert_eq!(told, [""; 0], "{name}");
    assert!(chained.header().is_chained() && !packed.header().is_chained());
    assert!(chained.bytes().len() <= packed.bytes().len(), "{name}");
    let all = chained.clusters().iter().filter(|cluster| !ClusterRecord::is_root(cluster)).count();
    let ids = (0..chained.clusters().len() as u32).map(ClusterId);
    let are = ids.filter(|id| packed::parent_place(chained.page_bytes(*id)).is_some()).count();
    [are, all]
}

#[test]
fn meshes_of_any_kind_are_chained() {
    let surface = |shape| Synth::new(shape, 8_000, 3).to_mesh();
    for (name, mesh) in [
        ("torus", surface(Shape::Torus)),
        ("isosurface", surface(Shape::Isosurface)),
        ("terrain", with_attributes(surface(Shape::Terrain))),
        ("plates", surface(Shape::Plates)),
    ] {
        let [are, all] = compare(name, &mesh, &config(256));
        assert!(all > 10 && are == all, "{name}: {are} of {all}");
    }
    for (name, mesh) in [
        ("grid", hand::grid(40, 40)),
        ("soup", hand::soup(900)),
        ("moebius", hand::moebius(900)),
        ("fan", hand::fan(1_500)),
        ("copies", hand::duplicate_faces()),
    ] {
        compare(name, &mesh, &config(64));
    }
}

#[test]
fn threads_and_memory_do_not_show_in_chained_pages() {
    let site = Site::of(&with_attributes(Synth::new(Shape::Isosurface, 12_000, 4).to_mesh()));
    let mut first = None;
    for (threads, memory) in [(1, 1 << 30), (2, 1 << 16), (4, 1 << 22)] {
        let mut config = stored(&config(256), true);
        (config.resources.threads, config.resources.memory) = (threads, Bytes(memory));
        let (_, bytes) = site.bytes(&config);
        assert!(*first.get_or_insert_with(|| bytes.clone()) == bytes, "{threads} threads, {memory} bytes");
    }
}

/// What vanishes leaves remnants, which name vertices by their numbers.
#[test]
fn remnants_follow_their_vertices() {
    let mesh = Synth::new(Shape::Isosurface, 40_000, 3).to_mesh();
    let (_, file) = Site::of(&mesh).build(&stored(&config(64), true));
    assert!(!file.remnants().is_empty());
    compare("isosurface", &mesh, &config(64));
}
