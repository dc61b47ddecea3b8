use crate::extraction::extracted;
use crate::select::{any_plan, any_view};
use crate::strips::{File, LOPSIDED, MORE};
use chpm_format::Chpm;
use chpm_mesh::{ClusterId, GroupId, Length, Triangles};
use chpm_refine::{Camera, Cut, Hierarchy, RefineError, Request, View, select, select_triangles};
use proptest::prelude::*;
use std::collections::BTreeSet;

/// The most triangles that one vertex of a strip brings, on both sides of a group border.
const FEWEST: u64 = 8;

/// Every error that the file stores, ascending.
fn stored_errors(file: &File) -> Vec<f32> {
    let ids = (0..file.clusters().len() as u32).map(ClusterId);
    let pages = ids.map(|id| file.page(id).unwrap());
    let errors = pages.flat_map(|page| {
        let page = page.view();
        let positions = page.base_vertex_count..=page.vertex_count();
        positions.map(|n| page.error_at(n).to_bits()).collect::<Vec<_>>()
    });
    errors.collect::<BTreeSet<_>>().into_iter().map(f32::from_bits).collect()
}

#[test]
fn all_triangles_are_used_up_at_no_larger_error_than_one_everywhere() {
    for plan in MORE.into_iter().chain([LOPSIDED]) {
        let file = plan.build();
        let uniform: Vec<_> =
            stored_errors(&file).into_iter().map(|error| Cut::at_error(&file, error).unwrap()).collect();
        let counts: Vec<_> = uniform.iter().map(|cut| cut.triangle_count(&file).unwrap()).collect();
        let coarsest = *counts.last().unwrap();
        let source = file.header().source_triangle_count;
        for limit in 0..=source + 1 {
            let cut = Cut::at_triangles(&file, limit).unwrap();
            let got = cut.triangle_count(&file).unwrap();
            assert!(got <= limit.max(coarsest), "{plan:?}: {got} of {limit}");
            assert!(got + FEWEST > limit.min(source), "{plan:?}: {got} of {limit}");
            let place = counts.iter().position(|count| *count <= limit);
            let best = uniform[place.unwrap_or(counts.len() - 1)].error(&file).unwrap();
            assert!(cut.error(&file).unwrap() <= best, "{plan:?}: {limit}");
            extracted(&file, &cut, &plan);
        }
        let finest = extracted(&file, &Cut::at_triangles(&file, u64::MAX).unwrap(), &plan);
        assert_eq!(finest.triangles.len() as u64, source);
    }
}

proptest! {
    #[test]
    fn a_view_is_served_as_well_as_by_the_same_pixels_everywhere(
        plan in any_plan(), view in any_view(), limit in 0..600_u64,
    ) {
        let file = plan.build();
        let hierarchy = Hierarchy::new(&file);
        let cut = select_triangles(&file, &hierarchy, &view, limit).unwrap();
        let got = cut.triangle_count(&file).unwrap();
        let coarsest = Cut::at_error(&file, f32::INFINITY).unwrap().triangle_count(&file).unwrap();
        prop_assert!(got <= limit.max(coarsest));
        extracted(&file, &cut, &plan);
        // What the view itself asks for is one of the cuts by pixels.
        let uniform = select(&file, &hierarchy, &view).unwrap();
        if uniform.triangle_count(&file).unwrap() <= limit {
            let pixels = |cut: &Cut| {
                let members = cut.members().iter().map(|member| {
                    let group = file.clusters()[member.cluster.index()].group();
                    let error = file.page(member.cluster).unwrap().view().error_at(member.vertices as usize);
                    view.pixels_of(error, hierarchy.region(group))
                });
                members.fold(0.0, f64::max)
            };
            prop_assert!(pixels(&cut) <= pixels(&uniform));
        }
        // What is seen takes all there is.
        let seen = |group: u32| hierarchy.bound(GroupId(group), &view) < f32::INFINITY;
        if (0..file.groups().len() as u32).all(seen) {
            prop_assert!(got + FEWEST > limit.min(file.header().source_triangle_count), "{} of {}", got, limit);
        }
    }
}

#[test]
fn what_is_culled_stays_coarse() {
    let file = MORE[0].build();
    let hierarchy = Hierarchy::new(&file);
    let away = Camera::looking([8.0, 4.0, 50.0], [8.0, 4.0, 99.0]);
    let view = View::new(&away, [64, 64], 1.0).unwrap().with_culling(true);
    let cut = select_triangles(&file, &hierarchy, &view, 500).unwrap();
    assert_eq!(cut, Cut::at_error(&file, f32::INFINITY).unwrap());
}

#[test]
fn a_damaged_page_is_an_error() {
    let file = MORE[0].build();
    let page = file.clusters()[0].page_offset as usize;
    let mut bytes = file.into_inner();
    bytes[page] ^= 1;
    let file = Chpm::open(bytes).unwrap();
    let hierarchy = Hierarchy::new(&file);
    let view = View::new(&Camera::looking([8.0, 4.0, 0.01], [8.0, 4.0, 0.0]), [64, 64], 0.0).unwrap();
    assert!(select_triangles(&file, &hierarchy, &view, u64::MAX).is_err());
    assert!(Cut::at_triangles(&file, u64::MAX).is_err());
    assert!(Cut::at_triangles(&file, 40).is_ok(), "pages that are not needed are not read");
}

/// Every request that reads pages, of a file of [`MORE`].
fn requests() -> [Request; 4] {
    let view = View::new(&Camera::looking([8.0, 4.0, 9.0], [8.0, 4.0, 0.0]), [64, 64], 0.5).unwrap();
    [
        Request::Within(Length::Units(0.01)),
        Request::Triangles(Triangles::Count(300), None),
        Request::Triangles(Triangles::Count(300), Some(view)),
        Request::View(view),
    ]
}

#[test]
fn choosing_can_be_stopped_before_any_page_is_read() {
    let file = MORE[0].build();
    for request in requests() {
        let mut asked = 0;
        let mut count = || {
            asked += 1;
            Ok::<(), RefineError>(())
        };
        request.cut(&file, 0.0, 0, &mut count).unwrap();
        assert!(asked > 2, "{request:?}");
        for last in 0..asked {
            let mut left = last;
            let stop = || match left {
                0 => Err(RefineError::Coarsest { least: 0 }),
                _ => {
                    left -= 1;
                    Ok(())
                }
            };
            let stopped = request.cut(&file, 0.0, 0, stop);
            assert!(matches!(stopped, Err(RefineError::Coarsest { .. })), "{request:?} {last}");
        }
    }
}

#[test]
fn what_is_kept_of_clusters_saves_reading_and_changes_nothing() {
    for plan in MORE {
        let file = plan.build();
        for request in requests() {
            let of = |bytes| {
                let mut read = 0_usize;
                let go_on = || {
                    read += 1;
                    Ok::<(), RefineError>(())
                };
                (request.cut(&file, 0.0, bytes, go_on).unwrap(), read)
            };
            let (plain, most) = of(0);
            for bytes in [100, 1000, 10_000] {
                assert_eq!(of(bytes).0, plain, "{request:?} {bytes}");
            }
            let (kept, reads) = of(u64::MAX);
            assert_eq!(kept, plain, "{request:?}");
            // Once for what is kept, and once more for the borders inside a group.
            assert!(reads <= most && reads <= 2 * file.clusters().len(), "{request:?}: {reads} of {most}");
        }
    }
}
