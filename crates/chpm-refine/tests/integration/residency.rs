use crate::extraction::extracted;
use crate::select::{any_plan, any_view};
use crate::strips::{File, PAIRS, WOVEN};
use chpm_mesh::{Bytes, ClusterId, GroupId};
use chpm_refine::{
    ActiveList, Camera, Front, Hierarchy, Residency, Traffic, View, Wanted, select, select_by,
};
use proptest::prelude::*;
use std::collections::BTreeSet;

/// A viewer: what it has in memory, and what it has asked for.
struct Viewer {
    file: File,
    hierarchy: Hierarchy,
    wanted: Front,
    residency: Residency,
    list: ActiveList,
    resident: BTreeSet<u32>,
    requested: Vec<u32>,
}

fn bytes(file: &File, clusters: impl IntoIterator<Item = u32>) -> u64 {
    clusters.into_iter().map(|id| u64::from(file.clusters()[id as usize].page_len)).sum()
}

impl Viewer {
    fn new(file: File, budget: u64) -> Self {
        Viewer {
            hierarchy: Hierarchy::new(&file),
            wanted: Front::new(&file),
            residency: Residency::new(&file, Bytes(budget)),
            list: ActiveList::new(&file),
            resident: BTreeSet::new(),
            requested: Vec::new(),
            file,
        }
    }

    fn look(&mut self, view: &View) -> Traffic {
        self.wanted.update(&self.file, &self.hierarchy, view, |_| true);
        let wanted = self.wanted.split_groups().iter().map(|group| Wanted {
            group: *group,
            priority: self
                .hierarchy
                .split_error(*group)
                .map_or(0.0, |error| view.pixels_of(error, self.hierarchy.region(*group))),
        });
        let traffic = self.residency.update(&self.file, &self.hierarchy, wanted.collect());
        self.note(&traffic);
        traffic
    }

    /// Reads ahead for another view.
    fn foresee(&mut self, view: &View, limit: u64) {
        let mut front = Front::new(&self.file);
        front.update(&self.file, &self.hierarchy, view, |_| true);
        let groups = front.split_groups().iter().chain(front.open_groups());
        let ahead = groups.map(|group| Wanted {
            group: *group,
            priority: view
                .pixels_of(self.hierarchy.split_error(*group).unwrap_or(0.0), self.hierarchy.region(*group)),
        });
        let traffic = self.residency.prefetch(&self.file, &self.hierarchy, ahead.collect(), Bytes(limit));
        assert!(bytes(&self.file, traffic.requests.iter().map(|id| id.0)) <= limit);
        self.note(&traffic);
    }

    fn note(&mut self, traffic: &Traffic) {
        for ClusterId(id) in &traffic.evictions {
            assert!(self.resident.remove(id), "evicted, but not there");
        }
        for ClusterId(id) in &traffic.requests {
            assert!(!self.resident.contains(id) && !self.requested.contains(id), "asked for twice");
            self.requested.push(*id);
        }
    }

    fn arrive(&mut self, place: usize) {
        let id = self.requested.swap_remove(place % self.requested.len());
        assert!(self.residency.arrive(&self.file, ClusterId(id)));
        assert!(!self.residency.arrive(&self.file, ClusterId(id)), "only once");
        self.resident.insert(id);
    }

    fn draw(&mut self, view: &View) {
        let ready = |group| self.residency.is_ready(group);
        self.list.update(&self.file, &self.hierarchy, view, ready).unwrap();
    }
}

#[test]
fn what_is_missing_is_replaced_by_what_is_above() {
    let mut viewer = Viewer::new(PAIRS.build(), u64::MAX);
    let view = View::new(&Camera::looking([8.0, 4.0, 0.1], [8.0, 4.0, 0.0]), [64, 64], 0.0).unwrap();
    let ids = |clusters: &[ClusterId]| clusters.iter().map(|id| id.0).collect::<Vec<_>>();
    let traffic = viewer.look(&view);
    assert_eq!(ids(&traffic.requests)[..3], [6, 4, 5], "from the top");
    assert!(!viewer.residency.has_roots() && traffic.evictions.is_empty());
    let drawn = |viewer: &Viewer| viewer.list.cut().members().iter().map(|m| m.cluster.0).collect::<Vec<_>>();
    for (arrives, drawn_then) in
        [(6, &[6][..]), (0, &[6]), (1, &[6]), (4, &[6]), (5, &[0, 1, 5]), (3, &[0, 1, 5]), (2, &[0, 1, 2, 3])]
    {
        let place = viewer.requested.iter().position(|id| *id == arrives).unwrap();
        viewer.arrive(place);
        assert!(viewer.residency.has_roots());
        viewer.draw(&view);
        assert_eq!(drawn(&viewer), drawn_then, "{arrives} came");
    }
    assert_eq!(viewer.look(&view), Traffic::default());
}

#[test]
fn the_longest_unused_goes_first() {
    let file = PAIRS.build();
    let hierarchy = Hierarchy::new(&file);
    let page = |id| bytes(&file, [id]);
    // Room for the top, the middle and one pair of leaves.
    let budget = bytes(&file, 4..7) + (page(0) + page(1)).max(page(2) + page(3));
    let mut residency = Residency::new(&file, Bytes(budget));
    let [top, left, right] = [6, 4, 5].map(|id: usize| file.clusters()[id].group());
    let mut look = |groups: &[GroupId]| {
        let wanted = groups.iter().map(|group| Wanted { group: *group, priority: 1.0 }).collect();
        let traffic = residency.update(&file, &hierarchy, wanted);
        for id in &traffic.requests {
            residency.arrive(&file, *id);
        }
        let ids = |clusters: Vec<ClusterId>| clusters.into_iter().map(|id| id.0).collect::<Vec<_>>();
        (ids(traffic.requests), ids(traffic.evictions))
    };
    assert_eq!(look(&[top, left]), (vec![6, 4, 5, 0, 1], vec![]));
    assert_eq!(look(&[top]), (vec![], vec![]), "what is not used stays while there is room");
    assert!(look(&[top, left]).0.is_empty(), "and need not be read again");
    assert_eq!(look(&[top, right]), (vec![2, 3], vec![0, 1]));
    // Both do not fit: the first by rank gets its place, the other is not drawn though it is there.
    let (requests, evictions) = look(&[top, left, right]);
    assert_eq!(
        (requests.len(), evictions.len()),
        if hierarchy.rank(left) < hierarchy.rank(right) { (2, 2) } else { (0, 0) }
    );
}

#[test]
fn what_is_still_on_its_way_is_waited_for() {
    let file = WOVEN.build();
    let hierarchy = Hierarchy::new(&file);
    let [top, left, right, first, last] = [14, 12, 13, 8, 11].map(|id: usize| file.clusters()[id].group());
    let pair = |ids: [u32; 2]| bytes(&file, ids);
    let budget = bytes(&file, 8..15) + pair([0, 1]).max(pair([6, 7]));
    let ids = |clusters: &[ClusterId]| clusters.iter().map(|id| id.0).collect::<Vec<_>>();
    for then in [vec![top, right, left, last], vec![top, right, last]] {
        let mut residency = Residency::new(&file, Bytes(budget));
        let look = |residency: &mut Residency, groups: &[GroupId]| {
            let wanted = groups.iter().map(|group| Wanted { group: *group, priority: 1.0 }).collect();
            residency.update(&file, &hierarchy, wanted)
        };
        let traffic = look(&mut residency, &[top, left, right, first]);
        let all_but_one = traffic.requests.iter().filter(|id| id.0 != 0);
        all_but_one.for_each(|id| assert!(residency.arrive(&file, *id)));
        assert!(residency.is_ready(left) && !residency.is_ready(first));
        // What could make room is on its way, what is above it must stay, and all else is wanted.
        assert_eq!(look(&mut residency, &then), Traffic::default());
        assert_eq!(residency.is_ready(left), then.contains(&left), "only what is wanted is ready");
        assert!(residency.arrive(&file, ClusterId(0)));
        let traffic = look(&mut residency, &then);
        assert_eq!((ids(&traffic.evictions), ids(&traffic.requests)), (vec![0, 1], vec![6, 7]));
    }
}

#[test]
fn nothing_is_kept_for_the_sake_of_what_has_no_place() {
    let file = WOVEN.build();
    let hierarchy = Hierarchy::new(&file);
    let [top, left, right, first] = [14, 12, 13, 8].map(|id: usize| file.clusters()[id].group());
    let of = |group| bytes(&file, file.fine(group).to_vec());
    let budget = bytes(&file, [14]) + of(top) + of(left).max(of(right)) + of(first);
    assert!(
        of(left) > of(first) && of(right) >= of(left),
        "the left side has no place, what is below it has"
    );
    let mut residency = Residency::new(&file, Bytes(budget));
    let mut look = |groups: &[(GroupId, f64)]| {
        let wanted = groups.iter().map(|(group, priority)| Wanted { group: *group, priority: *priority });
        let traffic = residency.update(&file, &hierarchy, wanted.collect());
        traffic.requests.iter().for_each(|id| assert!(residency.arrive(&file, *id)));
        let mut evicted: Vec<_> = traffic.evictions.iter().map(|id| id.0).collect();
        evicted.sort_unstable();
        (traffic.requests.len(), evicted)
    };
    assert_eq!(look(&[(top, 9.0), (left, 2.0), (first, 1.0)]), (1 + 3 * 2, vec![]));
    assert_eq!(look(&[(top, 9.0), (left, 2.0), (first, 1.0), (right, 3.0)]), (2, vec![0, 1, 8, 9]));
}

#[test]
fn what_is_read_ahead_has_no_claim_and_is_not_ready_before_it_is_wanted() {
    let file = PAIRS.build();
    let hierarchy = Hierarchy::new(&file);
    let page = |id| bytes(&file, [id]);
    let ids = |clusters: Vec<ClusterId>| clusters.into_iter().map(|id| id.0).collect::<Vec<_>>();
    let [top, left, right] = [6, 4, 5].map(|id: usize| file.clusters()[id].group());
    let of = |groups: &[(GroupId, f64)]| -> Vec<Wanted> {
        groups.iter().map(|(group, priority)| Wanted { group: *group, priority: *priority }).collect()
    };
    // Room for the top, the middle and one pair of leaves.
    let budget = bytes(&file, 4..7) + (page(0) + page(1)).max(page(2) + page(3));
    let mut residency = Residency::new(&file, Bytes(budget));
    let arrive = |residency: &mut Residency, traffic: &Traffic| {
        traffic.requests.iter().for_each(|id| assert!(residency.arrive(&file, *id)));
    };
    let traffic = residency.update(&file, &hierarchy, of(&[]));
    arrive(&mut residency, &traffic);
    // Nothing is read below what is not there, or beyond the limit.
    assert_eq!(
        residency.prefetch(&file, &hierarchy, of(&[(left, 9.0)]), Bytes(u64::MAX)),
        Traffic::default()
    );
    let least = page(4) + page(5);
    let all = [(top, 9.0), (left, 3.0), (right, 2.0)];
    assert_eq!(residency.prefetch(&file, &hierarchy, of(&all), Bytes(least - 1)), Traffic::default());
    // The more urgent of the two that do not both fit, after what is above it.
    let traffic = residency.prefetch(&file, &hierarchy, of(&all), Bytes(u64::MAX));
    assert_eq!(ids(traffic.requests.clone()), [4, 5, 0, 1]);
    arrive(&mut residency, &traffic);
    assert!(![top, left, right].iter().any(|group| residency.is_ready(*group)), "nobody wants them yet");
    // What is wanted is ready at once; what is foreseen stays for now, though something else is foreseen too.
    assert_eq!(residency.update(&file, &hierarchy, of(&[(top, 9.0)])), Traffic::default());
    assert!(residency.is_ready(top) && !residency.is_ready(left));
    let other = residency.prefetch(&file, &hierarchy, of(&all), Bytes(u64::MAX));
    assert_eq!(other, Traffic::default());
    // What a view wants takes its place.
    let traffic = residency.update(&file, &hierarchy, of(&[(top, 9.0), (right, 1.0)]));
    assert_eq!((ids(traffic.requests.clone()), ids(traffic.evictions)), (vec![2, 3], vec![0, 1]));
    residency.arrive(&file, ClusterId(2));
    residency.arrive(&file, ClusterId(3));
    assert!(residency.is_ready(right));
    // And what is foreseen takes the place of what no view wants, but never of what one does.
    let ahead = residency.prefetch(&file, &hierarchy, of(&[(top, 9.0), (left, 8.0)]), Bytes(u64::MAX));
    assert_eq!(ahead, Traffic::default());
    residency.update(&file, &hierarchy, of(&[(top, 9.0)]));
    let ahead = residency.prefetch(&file, &hierarchy, of(&[(top, 9.0), (left, 8.0)]), Bytes(u64::MAX));
    assert_eq!((ids(ahead.requests), ids(ahead.evictions)), (vec![0, 1], vec![2, 3]));
}

proptest! {
    #[test]
    fn whatever_comes_when_the_cut_is_legal_and_in_memory(
        plan in any_plan(), share in 0.0..1.3, seed_views in prop::collection::vec(any_view(), 1..12),
        arrivals in prop::collection::vec(prop::collection::vec(any::<usize>(), 0..5), 12),
        ahead in prop::collection::vec((any_view(), 0.0..1.0), 0..12),
    ) {
        let file = plan.build();
        let all = bytes(&file, 0..file.clusters().len() as u32);
        let roots = bytes(&file, file.roots().map(|root| root.0));
        let budget = (all as f64 * share) as u64;
        let mut viewer = Viewer::new(file, budget);
        for (frame, (view, arrivals)) in seed_views.iter().zip(&arrivals).enumerate() {
            viewer.look(view);
            let ready: Vec<GroupId> = viewer.wanted.split_groups().iter().copied()
                .filter(|group| viewer.residency.is_ready(*group)).collect();
            if let Some((view, share)) = ahead.get(frame) {
                viewer.foresee(view, (all as f64 * share) as u64);
            }
            prop_assert!(ready.iter().all(|group| viewer.residency.is_ready(*group)), "nothing wanted goes");
            let reserved = viewer.residency.reserved().0;
            let known = viewer.resident.iter().chain(&viewer.requested).copied();
            prop_assert_eq!(reserved, bytes(&viewer.file, known));
            prop_assert!(reserved <= budget.max(roots));
            for place in arrivals {
                if !viewer.requested.is_empty() {
                    viewer.arrive(*place);
                }
            }
            if viewer.residency.has_roots() {
                viewer.draw(view);
                let cut = viewer.list.cut();
                prop_assert!(cut.members().iter().all(|member| viewer.resident.contains(&member.cluster.0)));
                extracted(&viewer.file, &cut, &plan);
                // All ancestors of what is drawn are there too, so that any coarser view can be drawn at once.
                let coarsest = select_by(&viewer.file, &viewer.hierarchy, |_| f32::INFINITY).unwrap();
                prop_assert!(coarsest.members().iter().all(|m| viewer.resident.contains(&m.cluster.0)));
                for group in viewer.list.front().split_groups() {
                    prop_assert!(viewer.residency.is_ready(*group));
                    prop_assert!(viewer.file.coarse(*group).iter().all(|id| viewer.resident.contains(id)));
                }
            }
        }
        // In the end everything comes, and if there is room for it, it is drawn.
        let view = seed_views[seed_views.len() - 1];
        for _ in 0..2 {
            viewer.look(&view);
            while !viewer.requested.is_empty() {
                viewer.arrive(0);
            }
        }
        viewer.look(&view);
        viewer.draw(&view);
        let wanted = select(&viewer.file, &viewer.hierarchy, &view).unwrap();
        let fits = viewer.wanted.split_groups().iter().map(|g| bytes(&viewer.file, viewer.file.fine(*g).to_vec()));
        if roots + fits.sum::<u64>() <= budget {
            prop_assert_eq!(viewer.list.cut(), wanted);
        }
    }
}
