use crate::extraction::extracted;
use crate::select::{any_plan, any_view};
use crate::strips::{File, MORE};
use chpm_format::Chpm;
use chpm_mesh::{ClusterId, GroupId};
use chpm_refine::{ActiveList, Camera, Changes, Cut, Front, Hierarchy, View, select, select_by};
use proptest::prelude::*;
use std::collections::BTreeSet;

fn split_groups(front: &Front) -> BTreeSet<u32> {
    let groups: BTreeSet<u32> = front.split_groups().iter().map(|group| group.0).collect();
    assert_eq!(groups.len(), front.split_groups().len());
    groups
}

/// PM steps from one cut to the next: what stays moves; what comes starts where it looks like what it replaces.
fn steps(file: &File, before: &Cut, splits_before: &BTreeSet<u32>, after: &Cut) -> u64 {
    let step = |member: &chpm_refine::Member| {
        let record = &file.clusters()[member.cluster.index()];
        let stayed = before.members().iter().find(|other| other.cluster == member.cluster);
        let from = match stayed {
            Some(other) => other.vertices,
            None if splits_before.contains(&record.group) => record.vertex_count,
            None => record.base_vertex_count,
        };
        u64::from(from.abs_diff(member.vertices))
    };
    after.members().iter().map(step).sum()
}

/// Every group that `spared` keeps from being split keeps all below from it.
fn closed(file: &File, hierarchy: &Hierarchy, spared: &[bool]) -> Vec<bool> {
    let mut allowed = vec![true; file.groups().len()];
    for group in hierarchy.top_down() {
        let coarse = file.coarse(*group).iter().map(|cluster| &file.clusters()[*cluster as usize]);
        let above = coarse.filter(|cluster| !cluster.is_root()).all(|c| allowed[c.parent_group().index()]);
        allowed[group.index()] = above && !spared[group.index()];
    }
    allowed
}

proptest! {
    #[test]
    fn a_path_ends_where_the_stateless_selection_is(
        plan in any_plan(), views in prop::collection::vec(any_view(), 1..20), upside_down: bool,
    ) {
        let file = if upside_down { plan.build_upside_down() } else { plan.build() };
        let hierarchy = Hierarchy::new(&file);
        let mut list = ActiveList::new(&file);
        let (mut before, mut splits) = (Cut::default(), BTreeSet::new());
        for view in &views {
            let changes = list.update(&file, &hierarchy, view, |_| true).unwrap();
            let cut = list.cut();
            prop_assert_eq!(&cut, &select(&file, &hierarchy, view).unwrap());
            prop_assert_eq!(list.len(), cut.members().len());
            let now = split_groups(list.front());
            let counted = Changes {
                splits: now.difference(&splits).count() as u64,
                collapses: splits.difference(&now).count() as u64,
                pm_steps: steps(&file, &before, &splits, &cut),
            };
            prop_assert_eq!(changes, counted);
            let gone = before.members().iter().map(|member| member.cluster);
            let gone = gone.filter(|id| cut.members().iter().all(|member| member.cluster != *id));
            prop_assert_eq!(list.left().iter().copied().collect::<BTreeSet<_>>(), gone.collect());
            // The same view again changes nothing.
            prop_assert_eq!(list.update(&file, &hierarchy, view, |_| true).unwrap(), Changes::default());
            (before, splits) = (cut, now);
        }
    }

    #[test]
    fn groups_that_may_not_be_split_are_not(
        plan in any_plan(),
        frames in prop::collection::vec((any_view(), prop::collection::vec(prop::bool::weighted(0.2), 15)), 1..12),
    ) {
        let file = plan.build();
        let hierarchy = Hierarchy::new(&file);
        let mut list = ActiveList::new(&file);
        for (view, spared) in &frames {
            let allowed = closed(&file, &hierarchy, spared);
            list.update(&file, &hierarchy, view, |group| allowed[group.index()]).unwrap();
            let cut = list.cut();
            let wanted = |group: GroupId| {
                allowed[group.index()] && hierarchy.wants(group, hierarchy.bound(group, view))
            };
            let expected: BTreeSet<u32> =
                hierarchy.top_down().iter().filter(|group| wanted(**group)).map(|group| group.0).collect();
            prop_assert_eq!(split_groups(list.front()), expected);
            extracted(&file, &cut, &plan);
        }
    }
}

#[test]
fn after_a_damaged_page_the_list_starts_anew() {
    let sound = MORE[0].build();
    let hierarchy = Hierarchy::new(&sound);
    let page = sound.clusters()[0].page_offset as usize;
    let mut bytes = sound.into_inner();
    bytes[page] ^= 1;
    let file = Chpm::open(bytes).unwrap();
    let view = |z| View::new(&Camera::looking([8.0, 4.0, z], [8.0, 4.0, 0.0]), [64, 64], 1.0).unwrap();
    let mut list = ActiveList::new(&file);
    list.update(&file, &hierarchy, &view(1e6), |_| true).unwrap();
    assert!(list.update(&file, &hierarchy, &view(0.01), |_| true).is_err());
    assert!(list.is_empty());
    list.update(&file, &hierarchy, &view(1e6), |_| true).unwrap();
    assert_eq!(list.cut(), select_by(&file, &hierarchy, |_| f32::INFINITY).unwrap());
}

/// With everything nearer than the near plane one bound holds everywhere, and it can be any stored error exactly.
#[test]
fn bounds_that_are_stored_errors_are_kept_to_exactly() {
    const NEAR: f64 = 1e3;
    let camera = Camera { near: NEAR, ..Camera::looking([8.0, 4.0, 1.0], [8.0, 4.0, 0.0]) };
    let pixel = 2.0 * (0.5 * camera.fov.to_radians()).tan() / 64.0;
    for file in MORE.iter().map(|plan| plan.build()) {
        let hierarchy = Hierarchy::new(&file);
        let pages = || (0..file.clusters().len() as u32).map(|id| file.page(ClusterId(id)).unwrap());
        let errors = pages().flat_map(|page| {
            let page = page.view();
            let positions = page.base_vertex_count..=page.vertex_count();
            positions.map(|n| page.error_at(n).to_bits()).collect::<Vec<_>>()
        });
        let errors: Vec<u32> = errors.collect::<BTreeSet<_>>().into_iter().collect();
        let mut list = ActiveList::new(&file);
        for error in errors.iter().chain(errors.iter().rev()).map(|bits| f32::from_bits(*bits)) {
            for error in [error, error.next_up()] {
                // A little more than the error, which rounding down to single precision takes away again.
                let view =
                    View::new(&camera, [64, 64], f64::from(error) * (1.0 + 1e-10) / (pixel * NEAR)).unwrap();
                list.update(&file, &hierarchy, &view, |_| true).unwrap();
                assert_eq!(list.cut(), Cut::at_error(&file, error).unwrap(), "{error}");
            }
        }
    }
}
