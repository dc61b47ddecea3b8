use crate::extraction::extracted;
use crate::select::{any_plan, any_view};
use crate::strips::File;
use chpm_mesh::{ClusterId, GroupId};
use chpm_refine::{ActiveList, Cut, Hierarchy, Member, extract};
use proptest::prelude::*;
use std::collections::BTreeSet;

/// The triangles of a cut, each by the bits of its corners from the least one on.
fn triangles(file: &File, cut: &Cut) -> Vec<[[u32; 3]; 3]> {
    let mesh = extract(file, cut).unwrap();
    let corner = |v: u32| mesh.positions[v as usize].map(f32::to_bits);
    let rotated = |[a, b, c]: [[u32; 3]; 3]| [a, b, c].min([b, c, a]).min([c, a, b]);
    let mut all: Vec<_> = mesh.triangles.iter().map(|t| rotated(t.map(corner))).collect();
    all.sort_unstable();
    all
}

/// The cut with all of `coarse` at their finest meshes, and the one with all of `fine` at their base meshes instead.
fn moment(file: &File, cut: &Cut, coarse: &[u32], fine: &[u32]) -> [Cut; 2] {
    let others = cut.members().iter().copied();
    let others: Vec<_> =
        others.filter(|m| !coarse.contains(&m.cluster.0) && !fine.contains(&m.cluster.0)).collect();
    let record = |id: u32| &file.clusters()[id as usize];
    let finest =
        coarse.iter().map(|id| Member { cluster: ClusterId(*id), vertices: record(*id).vertex_count });
    let base =
        fine.iter().map(|id| Member { cluster: ClusterId(*id), vertices: record(*id).base_vertex_count });
    [finest.chain(others.iter().copied()).collect(), base.chain(others.iter().copied()).collect()]
        .map(Cut::new)
}

proptest! {
    /// Along any path: what a group that splits or collapses looks like just before is what it looks like just after, in the
    /// midst of a cut. All changes of a frame are taken one after the other, splits from above and collapses from below.
    #[test]
    fn a_split_changes_no_triangle_when_it_happens(
        plan in any_plan(), views in prop::collection::vec(any_view(), 1..12),
    ) {
        let file = plan.build();
        let hierarchy = Hierarchy::new(&file);
        let mut list = ActiveList::new(&file);
        let mut split = BTreeSet::new();
        let mut cut = Cut::at_error(&file, f32::INFINITY).unwrap();
        for view in &views {
            list.update(&file, &hierarchy, view, |_| true).unwrap();
            let now: BTreeSet<GroupId> = list.front().split_groups().iter().copied().collect();
            let order = hierarchy.top_down();
            let collapses = order.iter().rev().filter(|group| split.contains(*group) && !now.contains(*group));
            let splits = order.iter().filter(|group| !split.contains(*group) && now.contains(*group));
            for group in collapses.chain(splits) {
                let [before, after] = moment(&file, &cut, file.coarse(*group), file.fine(*group));
                prop_assert_eq!(triangles(&file, &before), triangles(&file, &after));
                cut = if split.contains(group) { before } else { after };
            }
            let ids = |cut: &Cut| cut.members().iter().map(|member| member.cluster).collect::<Vec<_>>();
            prop_assert_eq!(ids(&cut), ids(&list.cut()), "all changes were looked at");
            (cut, split) = (list.cut(), now);
            extracted(&file, &cut, &plan);
        }
    }
}
