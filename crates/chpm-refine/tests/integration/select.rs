use crate::extraction::extracted;
use crate::strips::{File, MORE, Plan};
use chpm_format::Chpm;
use chpm_mesh::{ClusterId, GroupId};
use chpm_refine::{Camera, Cut, Hierarchy, Member, View, is_visible, select, select_by};
use proptest::prelude::*;

/// Cameras in and around the grid, and accuracies from all of it to nothing.
pub(crate) fn any_view() -> impl Strategy<Value = View> {
    let position = (-20.0..60.0, -20.0..30.0, prop_oneof![-40.0..40.0, -1.0..1.0]);
    let target = (0.0..32.0, 0.0..8.0, 0.0..1.0);
    (position, target, -9.0..9.0, any::<bool>()).prop_map(|((px, py, pz), (tx, ty, tz), pixels, culling)| {
        let camera = Camera::looking([px, py, pz + 0.01], [tx, ty, tz]);
        View::new(&camera, [64, 64], f64::exp2(pixels)).unwrap().with_culling(culling)
    })
}

pub(crate) fn any_plan() -> impl Strategy<Value = Plan> {
    prop::sample::select(MORE.to_vec())
}

fn groups(file: &File) -> impl Iterator<Item = GroupId> + use<> {
    (0..file.groups().len() as u32).map(GroupId)
}

/// The rule as FORMAT.md tells it, cluster by cluster, from the file's own tables.
fn naive(file: &File, hierarchy: &Hierarchy, view: &View) -> Cut {
    let bound = |group: GroupId| hierarchy.bound(group, view);
    let split = |group: GroupId| {
        let record = &file.groups()[group.index()];
        !record.is_leaf() && record.min_error > bound(group)
    };
    let mut members = Vec::new();
    for (cluster, record) in (0..).map(ClusterId).zip(file.clusters()) {
        if (record.is_root() || split(record.parent_group())) && !split(record.group()) {
            let vertices = file.page(cluster).unwrap().view().vertices_for(bound(record.group())) as u32;
            members.push(Member { cluster, vertices });
        }
    }
    Cut::new(members)
}

/// The groups above a group.
fn above(file: &File, group: GroupId) -> impl Iterator<Item = GroupId> {
    let coarse = file.coarse(group).iter().map(|cluster| &file.clusters()[*cluster as usize]);
    coarse.filter(|cluster| !cluster.is_root()).map(|cluster| cluster.parent_group())
}

#[test]
fn the_hierarchy_of_a_sound_file_is_the_file() {
    for plan in MORE {
        let file = plan.build();
        let hierarchy = Hierarchy::new(&file);
        for (id, record) in groups(&file).zip(file.groups()) {
            let expected = (!record.is_leaf()).then_some(record.min_error);
            assert_eq!(hierarchy.split_error(id), expected, "{plan:?}");
            let radius = hierarchy.region(id).radius;
            assert!((radius - f64::from(record.radius)).abs() <= 1e-6 * radius, "{plan:?}");
            assert_eq!(hierarchy.top_down()[hierarchy.rank(id) as usize], id);
            assert!(above(&file, id).all(|above| hierarchy.rank(above) < hierarchy.rank(id)));
        }
    }
}

#[test]
fn far_away_is_coarse_and_near_is_fine() {
    for plan in MORE {
        let file = plan.build();
        let hierarchy = Hierarchy::new(&file);
        let at = |z: f64| {
            let view = View::new(&Camera::looking([8.0, 4.0, z], [8.0, 4.0, 0.0]), [64, 64], 1.0).unwrap();
            select(&file, &hierarchy, &view).unwrap()
        };
        assert_eq!(at(1e6), Cut::at_error(&file, f32::INFINITY).unwrap(), "{plan:?}");
        // No pixel is allowed any error: as at an error of 0.
        let exact = View::new(&Camera::framing(&file.header().aabb()), [64, 64], 0.0).unwrap();
        assert_eq!(select(&file, &hierarchy, &exact).unwrap(), Cut::at_error(&file, 0.0).unwrap());
    }
}

#[test]
fn pages_are_read_only_where_they_are_drawn() {
    let file = MORE[0].build();
    let hierarchy = Hierarchy::new(&file);
    let page = file.clusters()[0].page_offset as usize;
    let mut bytes = file.into_inner();
    bytes[page] ^= 1;
    let file = Chpm::open(bytes).unwrap();
    let view = |z| View::new(&Camera::looking([8.0, 4.0, z], [8.0, 4.0, 0.0]), [64, 64], 1.0).unwrap();
    assert!(select(&file, &hierarchy, &view(1e6)).is_ok());
    let error = select(&file, &hierarchy, &view(0.01)).unwrap_err();
    assert!(error.to_string().contains("cluster 0"), "{error}");
}

proptest! {
    #[test]
    fn any_camera_gives_the_rules_cut(plan in any_plan(), view in any_view()) {
        let file = plan.build();
        let hierarchy = Hierarchy::new(&file);
        let cut = select(&file, &hierarchy, &view).unwrap();
        prop_assert_eq!(&cut, &naive(&file, &hierarchy, &view));
        extracted(&file, &cut, &plan);
    }

    #[test]
    fn no_split_is_ever_forced(plan in any_plan(), view in any_view(), upside_down: bool) {
        let file = if upside_down { plan.build_upside_down() } else { plan.build() };
        let hierarchy = Hierarchy::new(&file);
        let wants = |group: GroupId| hierarchy.wants(group, hierarchy.bound(group, &view));
        for group in groups(&file).filter(|group| wants(*group)) {
            prop_assert!(above(&file, group).all(wants), "{group}");
        }
        extracted(&file, &select(&file, &hierarchy, &view).unwrap(), &plan);
    }

    #[test]
    fn any_bounds_give_a_cut_without_cracks(
        plan in any_plan(), bounds in prop::collection::vec(prop_oneof![Just(f32::INFINITY), 0.0..9.0_f32], 15),
    ) {
        let file = plan.build();
        let cut = select_by(&file, &Hierarchy::new(&file), |group| bounds[group.index()]).unwrap();
        extracted(&file, &cut, &plan);
    }

    #[test]
    fn culling_spares_only_what_is_not_seen(plan in any_plan(), view in any_view()) {
        let file = plan.build();
        let hierarchy = Hierarchy::new(&file);
        let all = select(&file, &hierarchy, &view.with_culling(false)).unwrap();
        let culled = select(&file, &hierarchy, &view.with_culling(true)).unwrap();
        prop_assert!(culled.triangle_count(&file).unwrap() <= all.triangle_count(&file).unwrap());
        for member in culled.members() {
            let record = &file.clusters()[member.cluster.index()];
            let seen = !view.misses(hierarchy.region(record.group()));
            prop_assert!(all.members().contains(member) || !seen || !is_visible(record, &view)
                || member.vertices == record.base_vertex_count);
        }
    }
}
