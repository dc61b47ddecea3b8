//! Neither threads nor memory nor the size of batches show in answers.

use super::scene::{ROOM, built, cast_in, mesh_within, rays_at};
use chpm_mesh::Bytes;
use chpm_rays::{Bound, Memory, Seek};
use chpm_synth::{Shape, Synth};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

#[test]
fn neither_threads_nor_memory_show() {
    let file = built(&Synth::new(Shape::Isosurface, 8000, 3).to_mesh());
    let triangles = mesh_within(&file, -1.0);
    let rays = rays_at(&triangles, 4000, 5);
    let largest = file.groups().iter().map(|group| f64::from(group.max_error)).fold(0.0, f64::max);
    for bound in [Bound::LEAVES, Bound::within(0.1 * largest), Bound::from_eye([0.0; 3], 0.2 * largest)] {
        for seek in [Seek::Nearest, Seek::Any, Seek::Within(0.01 * largest)] {
            let (expected, reads) = cast_in(&file, &rays, &bound, seek, ROOM);
            assert_eq!(reads.pages, reads.different);
            for (threads, meshes, count) in [(1, 0, 1 << 20), (3, 100_000, 1 << 20), (2, 1 << 30, 100)] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let memory = Memory::new(Bytes(meshes), count);
                let (got, again) = pool.install(|| cast_in(&file, &rays, &bound, seek, memory));
                assert!(got == expected, "{bound:?} {seek:?} {threads} {meshes} {count}");
                assert_eq!(again.different, reads.different);
                // A page is read again where it does not fit, but not for each ray.
                assert!(again.pages < rays.len() as u64, "{again:?} {reads:?}");
            }
        }
    }
}

#[test]
fn a_damaged_page_is_an_error() {
    let file = built(&Synth::new(Shape::Sphere, 3000, 3).to_mesh());
    let rays = rays_at(&mesh_within(&file, -1.0), 500, 5);
    let leaf = file.clusters().iter().find(|record| record.is_leaf()).unwrap();
    let place = leaf.page_offset + u64::from(leaf.page_len) / 2;
    let mut bytes = file.into_inner();
    bytes[place as usize] ^= 0xff;
    let file = chpm_format::Chpm::open(bytes).unwrap();
    let mut caster = chpm_rays::Caster::new(&file, ROOM);
    let end = caster.cast(&rays, &Bound::LEAVES, Seek::Nearest, &|| true, |_, _| {});
    assert!(matches!(end, Err(chpm_rays::RayError::Format(_))), "{end:?}");
    let stopped =
        chpm_rays::Caster::new(&file, ROOM).cast(&rays, &Bound::LEAVES, Seek::Any, &|| false, |_, _| {});
    assert!(matches!(stopped, Err(chpm_rays::RayError::Stopped)));
}

/// Also where all rays are in one page, or in none.
#[test]
fn many_rays_in_few_pages_are_stopped() {
    let file = built(&Synth::new(Shape::Sphere, 3000, 3).to_mesh());
    let rays = rays_at(&mesh_within(&file, -1.0), 40_000, 5);
    let cast = |asks: u64| {
        let asked = AtomicU64::new(0);
        let mut caster = chpm_rays::Caster::new(&file, ROOM);
        let go_on = || asked.fetch_add(1, Relaxed) < asks;
        let end = caster.cast(&rays, &Bound::LEAVES, Seek::Nearest, &go_on, |_, _| {});
        (end, caster.reads().pages)
    };
    let (end, pages) = cast(u64::MAX);
    assert!(end.is_ok());
    let (end, _) = cast(2 * pages);
    assert!(matches!(end, Err(chpm_rays::RayError::Stopped)), "{end:?}");
}
