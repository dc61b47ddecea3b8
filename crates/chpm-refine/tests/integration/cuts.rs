use crate::strips::{ALL, DEPENDENT, File, LOPSIDED, PAIRS, ROOTS, TWINS, UNEVEN, WOVEN, boundary, outline};
use chpm_format::Chpm;
use chpm_mesh::{ClusterId, Length, Level};
use chpm_refine::{Cut, Member, RefineError, Request, extract, random_cut};
use std::collections::BTreeSet;

fn ids(cut: &Cut) -> Vec<u32> {
    cut.members().iter().map(|member| member.cluster.0).collect()
}

/// These clusters at their finest meshes.
fn finest(file: &File, ids: &[u32]) -> Cut {
    let member = |id: &u32| Member {
        cluster: ClusterId(*id),
        vertices: file.clusters().get(*id as usize).map_or(1, |cluster| cluster.vertex_count),
    };
    Cut::new(ids.iter().map(member).collect())
}

/// Every error that the file stores, ascending.
fn stored_errors(file: &File) -> Vec<f32> {
    let mut bits = BTreeSet::from([0]);
    bits.extend(file.groups().iter().flat_map(|group| [group.min_error, group.max_error]).map(f32::to_bits));
    for id in (0..file.clusters().len() as u32).map(ClusterId) {
        let page = file.page(id).unwrap();
        let page = page.view();
        bits.extend((page.base_vertex_count..=page.vertex_count()).map(|n| page.error_at(n).to_bits()));
    }
    bits.into_iter().map(f32::from_bits).collect()
}

/// The rule, cluster by cluster and vertex by vertex.
fn naive_at_error(file: &File, bound: f32) -> Cut {
    let mut members = Vec::new();
    for (cluster, record) in (0..).map(ClusterId).zip(file.clusters()) {
        let split = |group: chpm_mesh::GroupId| file.groups()[group.index()].min_error > bound;
        if (record.is_root() || split(record.parent_group())) && !split(record.group()) {
            let page = file.page(cluster).unwrap();
            let page = page.view();
            let mut positions = page.base_vertex_count..=page.vertex_count();
            let n = positions.find(|n| page.error_at(*n) <= bound).unwrap();
            members.push(Member { cluster, vertices: n as u32 });
        }
    }
    Cut::new(members)
}

#[test]
fn levels_replace_what_is_below_them() {
    let file = UNEVEN.build();
    for (level, expected) in [(0, vec![0, 1, 2]), (1, vec![2, 3]), (2, vec![4]), (9, vec![4])] {
        let cut = Cut::at_level(&file, Level(level));
        assert_eq!(cut, finest(&file, &expected));
        cut.check(&file).unwrap();
        let triangles: u32 = expected.iter().map(|id| file.clusters()[*id as usize].triangle_count).sum();
        assert_eq!(cut.triangle_count(&file).unwrap(), u64::from(triangles));
        let errors = expected.iter().map(|id| file.clusters()[*id as usize].min_error);
        assert_eq!(cut.error(&file).unwrap(), errors.fold(0.0, f32::max));
    }
    let file = ROOTS.build();
    assert_eq!(Cut::at_level(&file, Level(u32::MAX)), finest(&file, &[0, 1]));
}

#[test]
fn a_cluster_whose_group_is_replaced_in_part_is_at_its_base_mesh() {
    let file = LOPSIDED.build();
    let at = |id: u32| &file.clusters()[id as usize];
    let expected = [(2, at(2).base_vertex_count), (3, at(3).vertex_count)];
    assert_ne!(at(2).base_vertex_count, at(2).vertex_count);
    let members = expected.map(|(id, vertices)| Member { cluster: ClusterId(id), vertices });
    let cut = Cut::at_level(&file, Level(1));
    assert_eq!(cut.members(), members);
    let mesh = extract(&file, &cut).unwrap();
    assert_eq!(boundary(&mesh.triangles).len(), outline(&LOPSIDED).len(), "the group border is open");
    assert_eq!(Cut::at_level(&file, Level(0)), finest(&file, &[0, 1, 2]));
}

#[test]
fn error_bounds_select_as_the_naive_rule_does() {
    for plan in ALL {
        let file = plan.build();
        let stored = stored_errors(&file);
        for bound in stored.iter().flat_map(|e| [*e, e.next_up(), e.next_down().max(0.0)]) {
            let cut = Cut::at_error(&file, bound).unwrap();
            assert_eq!(cut, naive_at_error(&file, bound), "{plan:?} at {bound}");
            cut.check(&file).unwrap();
            assert!(cut.error(&file).unwrap() <= bound);
        }
        let base = file
            .roots()
            .map(|cluster| Member { cluster, vertices: file.clusters()[cluster.index()].base_vertex_count });
        let coarsest = Cut::at_error(&file, f32::INFINITY).unwrap();
        assert_eq!(coarsest, Cut::new(base.collect()));
        assert_eq!(coarsest.error(&file).unwrap(), file.header().max_error);
    }
}

/// As above, by what has vanished, too.
fn naive_at_distance(file: &File, bound: f32) -> Cut {
    let mut members = Vec::new();
    for (cluster, record) in (0..).map(ClusterId).zip(file.clusters()) {
        let split = |group: chpm_mesh::GroupId| {
            let record = &file.groups()[group.index()];
            !record.is_leaf() && record.gaps.fine.max(record.gaps.distance(record.min_error)) > bound
        };
        if (record.is_root() || split(record.parent_group())) && !split(record.group()) {
            let page = file.page(cluster).unwrap();
            let page = page.view();
            let gaps = file.gaps(record.group());
            let mut positions = page.base_vertex_count..=page.vertex_count();
            let n = positions.find(|n| gaps.distance(page.error_at(*n)) <= bound);
            members.push(Member { cluster, vertices: n.unwrap_or(page.vertex_count()) as u32 });
        }
    }
    Cut::new(members)
}

#[test]
fn distances_select_as_the_naive_rule_does() {
    for plan in ALL {
        let file = plan.build_with_gaps();
        assert!(file.groups().iter().any(|group| group.gaps.base > 0.0));
        let gaps = file.groups().iter().flat_map(|group| [group.gaps.fine, group.gaps.base, group.gaps.from]);
        let mut differ = false;
        for bound in stored_errors(&file).into_iter().chain(gaps) {
            for bound in [bound, bound.next_up(), bound.next_down().max(0.0)] {
                let cut = Cut::at_distance(&file, bound).unwrap();
                assert_eq!(cut, naive_at_distance(&file, bound), "{plan:?} at {bound}");
                cut.check(&file).unwrap();
                assert!(cut.distance(&file).unwrap() <= bound);
                assert!(cut.error(&file).unwrap() <= bound);
                differ |= cut != Cut::at_error(&file, bound).unwrap();
            }
        }
        assert!(differ, "{plan:?}");
        // Without gaps both are one.
        let file = plan.build();
        let bound = file.header().max_error * 0.5;
        assert_eq!(Cut::at_distance(&file, bound).unwrap(), Cut::at_error(&file, bound).unwrap());
    }
}

/// Rounding of a written format is a part of the allowed error: taken off the bound, and no more than that.
#[test]
fn a_mesh_that_is_rounded_keeps_to_what_was_asked_with_that() {
    let file = WOVEN.build_with_gaps();
    let bounds = stored_errors(&file);
    let (largest, mut coarser) = (f64::from(bounds[bounds.len() - 1]), 0);
    let within = |bound: f64, rounding: f64| {
        let request = Request::Within(Length::Units(bound));
        request.cut(&file, rounding, 0, || Ok::<_, RefineError>(())).unwrap()
    };
    for bound in bounds.into_iter().map(f64::from) {
        for rounding in [0.0, 1e-9 * largest, 0.05 * largest, 0.5 * largest] {
            let cut = within(bound, rounding);
            let distance = f64::from(cut.distance(&file).unwrap());
            let kept = distance + rounding <= bound || cut == within(0.0, 0.0);
            assert!(kept, "{distance} and {rounding} are more than {bound}");
            // The same as for what is left, but for the last digit.
            let less = ((bound - rounding) as f32).max(0.0);
            let same = [less, less.next_down().max(0.0)].map(|less| Cut::at_distance(&file, less).unwrap());
            assert!(same.contains(&cut), "{bound} less {rounding}");
            coarser += u32::from(cut != within(bound, 0.0));
        }
    }
    assert!(coarser > 20, "{coarser}");
}

#[test]
fn bounds_that_are_none_are_refused() {
    let file = PAIRS.build();
    for bound in [f32::NAN, -1.0, f32::NEG_INFINITY] {
        assert!(matches!(Cut::at_distance(&file, bound), Err(RefineError::Bound { .. })), "{bound}");
        assert!(matches!(Cut::at_error(&file, bound), Err(RefineError::Bound { .. })), "{bound}");
    }
}

#[test]
fn random_cuts_are_legal_and_differ() {
    for plan in ALL {
        let file = plan.build();
        let cuts: Vec<_> = (0..200).map(|seed| random_cut(&file, seed).unwrap()).collect();
        for (seed, cut) in (0..).zip(&cuts) {
            cut.check(&file).unwrap();
            assert_eq!(cut, &random_cut(&file, seed).unwrap());
        }
        let mut drawn: Vec<_> = cuts.iter().map(ids).collect();
        drawn.sort();
        drawn.dedup();
        // All legal sets of clusters: a binary tree of 4 leaves has 5, and so on.
        let expected = match plan.merges_and_groups() {
            (0, _) => 1,
            (2, _) => 3,
            (_, true) => 3,
            _ => 5,
        };
        assert_eq!(drawn.len(), expected, "{plan:?}: {drawn:?}");
    }
}

#[test]
fn random_cuts_reach_all_depths() {
    // Every level is in a tenth of the cuts at least, and a sixth of them have several.
    let file = WOVEN.build();
    let levels = |seed| -> BTreeSet<u32> {
        let cut = random_cut(&file, seed).unwrap();
        cut.members().iter().map(|member| file.clusters()[member.cluster.index()].level).collect()
    };
    let cuts: Vec<_> = (0..600).map(levels).collect();
    for level in 0..4 {
        let count = cuts.iter().filter(|levels| levels.contains(&level)).count();
        assert!(count >= 60, "level {level} is in {count} of 600 cuts");
    }
    let mixed = cuts.iter().filter(|levels| levels.len() > 1).count();
    assert!(mixed >= 100, "{mixed} of 600 cuts are mixed");
    // Positions within a cluster are at both ends and between.
    let positions = |seed| -> Vec<u32> {
        let cut = random_cut(&file, seed).unwrap();
        let leaves = cut.members().iter().filter(|member| member.cluster.0 < 8);
        leaves.map(|m| m.vertices - file.clusters()[m.cluster.index()].base_vertex_count).collect()
    };
    let reached: BTreeSet<u32> = (0..600).flat_map(positions).collect();
    let record = &file.clusters()[0];
    let most = record.vertex_count - record.base_vertex_count;
    assert!(reached.contains(&0) && reached.contains(&most), "{reached:?}");
    assert!(reached.len() as u32 > most / 2, "{reached:?}");
}

#[test]
fn what_is_no_cut_is_refused() {
    let file = PAIRS.build();
    for legal in [&[0, 1, 2, 3][..], &[4, 5], &[0, 1, 5], &[6]] {
        finest(&file, legal).check(&file).unwrap();
    }
    for (members, wrong, counts) in [
        (&[][..], 6, (1, 0)),
        (&[6, 6], 6, (1, 2)),
        (&[4], 5, (1, 0)),
        (&[0, 2, 3], 1, (1, 0)),
        (&[4, 5, 6], 6, (0, 1)),
        (&[0, 4, 5], 1, (1, 0)),
        (&[0, 1, 4, 5], 4, (0, 1)),
    ] {
        match finest(&file, members).check(&file) {
            Err(RefineError::Illegal { cluster, expected, got }) => {
                assert_eq!((cluster.0, (expected, got)), (wrong, counts), "{members:?}");
            }
            other => panic!("{members:?}: {other:?}"),
        }
    }
    let unknown = finest(&file, &[4, 7]).check(&file);
    assert!(matches!(unknown, Err(RefineError::Cluster { cluster: ClusterId(7), count: 7 })));
    let record = &file.clusters()[6];
    for vertices in [0, record.base_vertex_count - 1, record.vertex_count + 1, u32::MAX] {
        let cut = Cut::new(vec![Member { cluster: ClusterId(6), vertices }]);
        for result in [cut.check(&file), cut.triangle_count(&file).map(drop), cut.error(&file).map(drop)] {
            let position = matches!(result, Err(RefineError::Position { got, .. }) if got == vertices);
            assert!(position, "{vertices}: {result:?}");
        }
    }
}

#[test]
fn a_group_is_split_whole() {
    let file = TWINS.build();
    finest(&file, &[0, 1, 2, 3]).check(&file).unwrap();
    let half = finest(&file, &[0, 1, 5]).check(&file);
    assert!(matches!(half, Err(RefineError::Illegal { cluster: ClusterId(2), .. })), "{half:?}");
    // The members of a group of leaves never split, so their parents may do so one by one.
    finest(&DEPENDENT.build(), &[0, 1, 5]).check(&DEPENDENT.build()).unwrap();
}

#[test]
fn a_damaged_page_is_named() {
    let file = PAIRS.build();
    let page = file.clusters()[6].page_offset as usize;
    let mut bytes = file.into_inner();
    bytes[page] ^= 1;
    let file = Chpm::open(bytes).unwrap();
    for result in [Cut::at_error(&file, 1e9), Cut::at_triangles(&file, 1)] {
        let error = result.unwrap_err();
        assert!(
            matches!(error, RefineError::Format(_)) && error.to_string().contains("cluster 6"),
            "{error}"
        );
    }
}
