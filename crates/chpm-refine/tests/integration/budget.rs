use crate::extraction::extracted;
use crate::select::{any_plan, any_view};
use crate::strips::{File, MORE};
use chpm_format::Chpm;
use chpm_refine::{Budgeted, Camera, Cut, Hierarchy, View, select};
use proptest::prelude::*;

/// The largest error of the cut that could be refined, in pixels of its group's nearest point.
fn worst(file: &File, hierarchy: &Hierarchy, view: &View, cut: &Cut) -> f64 {
    let pixels = cut.members().iter().map(|member| {
        let record = &file.clusters()[member.cluster.index()];
        let group = record.group();
        let page = file.page(member.cluster).unwrap();
        let own =
            if member.vertices < record.vertex_count { page.error_at(member.vertices as usize) } else { 0.0 };
        let error = own.max(hierarchy.split_error(group).unwrap_or(0.0));
        let partial = !file.coarse(group).iter().all(|id| cut.members().iter().any(|m| m.cluster.0 == *id));
        if partial || error <= hierarchy.bound(group, view) {
            0.0
        } else {
            view.pixels_of(error, hierarchy.region(group))
        }
    });
    pixels.fold(0.0, f64::max)
}

proptest! {
    #[test]
    fn every_step_is_a_cut_within_the_limit_and_takes_the_worst_error(
        plan in any_plan(), view in any_view(), limit in 0..600_u64,
    ) {
        let file = plan.build();
        let hierarchy = Hierarchy::new(&file);
        let mut budgeted = Budgeted::new(&file, &hierarchy, &view).unwrap();
        let coarsest = Cut::at_error(&file, f32::INFINITY).unwrap();
        prop_assert_eq!(&budgeted.cut(), &coarsest);
        let mut last = f64::INFINITY;
        loop {
            let cut = budgeted.cut();
            prop_assert_eq!(budgeted.triangles(), cut.triangle_count(&file).unwrap());
            prop_assert!(budgeted.triangles() <= limit || cut == coarsest);
            extracted(&file, &cut, &plan);
            let pixels = budgeted.pixels().unwrap_or(0.0);
            prop_assert_eq!(pixels, worst(&file, &hierarchy, &view, &cut));
            prop_assert!(pixels <= last);
            last = pixels;
            if !budgeted.step(limit).unwrap() {
                break;
            }
        }
        // What does not fit now does not fit later.
        prop_assert!(!budgeted.step(limit).unwrap());
    }

    #[test]
    fn without_a_limit_it_is_what_the_view_asks_for(plan in any_plan(), view in any_view()) {
        let file = plan.build();
        let hierarchy = Hierarchy::new(&file);
        let mut budgeted = Budgeted::new(&file, &hierarchy, &view).unwrap();
        budgeted.run(u64::MAX).unwrap();
        prop_assert_eq!(budgeted.cut(), select(&file, &hierarchy, &view).unwrap());
        prop_assert_eq!(budgeted.pixels(), None);
    }
}

#[test]
fn a_damaged_page_stops_its_group_and_nothing_else() {
    let file = MORE[0].build();
    let hierarchy = Hierarchy::new(&file);
    let page = file.clusters()[0].page_offset as usize;
    let mut bytes = file.into_inner();
    bytes[page] ^= 1;
    let file = Chpm::open(bytes).unwrap();
    let view = View::new(&Camera::looking([8.0, 4.0, 0.01], [8.0, 4.0, 0.0]), [64, 64], 0.0).unwrap();
    let mut budgeted = Budgeted::new(&file, &hierarchy, &view).unwrap();
    assert!(budgeted.run(u64::MAX).is_err());
    budgeted.run(u64::MAX).unwrap();
    let cut = budgeted.cut();
    cut.check(&file).unwrap();
    assert_eq!(cut.members().iter().map(|m| m.cluster.0).collect::<Vec<_>>(), [2, 3, 4]);
}
