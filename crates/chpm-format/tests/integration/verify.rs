use crate::sample::{Cluster, Sample, sheet, two_level, with, write};
use chpm_format::verify::MAX_FAULTS;
use chpm_format::{
    BoundaryMode, Chpm, ClusterRecord, Fault, FilePart, Gaps, Header, HeaderFields, Invariant, LevelRecord,
    Tables, verify, verify_within,
};
use chpm_mesh::geom::distance;
use chpm_mesh::{Attributes, ClusterId, GroupId, Octahedral};
use std::ops::ControlFlow;

/// The invariants that a file breaks, each once.
fn broken(bytes: Vec<u8>) -> Vec<Invariant> {
    let file = Chpm::open(bytes).unwrap();
    let report = verify(&file, |_, _| ());
    // In as many parts as there are shared vertices, the same is found.
    let mut told = Vec::new();
    let parts = verify_within(&file, 0, |done, all| {
        told.push((done, all));
        ControlFlow::Continue(())
    });
    let parts = parts.unwrap();
    assert_eq!((parts.good_pages, parts.triangles), (report.good_pages, report.triangles));
    let sorted = |faults: &[Fault]| {
        let mut told: Vec<String> = faults.iter().map(ToString::to_string).collect();
        told.sort_unstable();
        told
    };
    assert_eq!(sorted(&parts.faults), sorted(&report.faults));
    assert!(
        report.good_pages < file.clusters().len() as u64
            || told.iter().all(|t| t.0 <= t.1) && told.last().is_some_and(|t| t.0 == t.1)
    );
    let mut invariants: Vec<_> = report.faults.iter().map(|f| f.invariant).collect();
    invariants.sort_unstable();
    invariants.dedup();
    invariants
}

fn changed(change: impl FnOnce(&mut Sample)) -> Vec<Invariant> {
    let mut sample = two_level();
    change(&mut sample);
    broken(sample.bytes())
}

fn retold(change: impl FnOnce(&mut Tables)) -> Vec<Invariant> {
    let (mut tables, pages) = two_level().tables();
    change(&mut tables);
    broken(write(&mut tables, &pages))
}

#[test]
fn a_good_file_breaks_none() {
    assert_eq!(changed(|_| ()), []);
    assert_eq!(retold(|_| ()), []);
}

#[test]
fn coverage() {
    assert_eq!(retold(|t| t.header.source_vertex_count -= 1), [Invariant::Coverage]);
    let bytes = two_level().bytes();
    assert_eq!(broken(with(&bytes, 56, &[99])), [Invariant::Coverage], "source_triangle_count");
    // An id that nobody lists; a leaf vertex that nothing uses; an id listed twice.
    assert_eq!(retold(|t| t.header.shared_vertex_count += 1), [Invariant::Coverage]);
    let unused = changed(|s| {
        s.clusters[1].positions.insert(0, [4.0, 2.0, 0.5]);
        s.clusters[1].triangles.iter_mut().flatten().for_each(|v| *v += 1);
        s.clusters[1].targets.iter_mut().for_each(|v| *v += 1);
        s.clusters[1].shared.iter_mut().for_each(|(local, _)| *local += 1);
        s.header.source_vertex_count += 1;
    });
    assert_eq!(unused, [Invariant::Coverage]);
    assert_eq!(changed(|s| s.clusters[1].shared[1].1 = 0), [Invariant::Coverage]);
    // Each id once in each leaf, but two of them at each other's place in one.
    let crossed = changed(|s| {
        let shared = &mut s.clusters[1].shared;
        (shared[0].1, shared[1].1) = (shared[1].1, shared[0].1);
    });
    assert_eq!(crossed, [Invariant::Coverage], "a shared vertex in two places");
    // An id that a single leaf lists.
    let alone = changed(|s| {
        let listed: Vec<u16> = s.clusters[1].shared.iter().map(|(local, _)| *local).collect();
        let own = (0..).find(|local| !listed.contains(local)).unwrap();
        s.clusters[1].shared.push((own, s.header.shared_vertex_count));
        s.clusters[1].shared.sort_unstable();
        s.header.shared_vertex_count += 1;
    });
    assert_eq!(alone, [Invariant::Coverage], "a shared vertex that nobody else has");
}

#[test]
fn trimmed_leaves() {
    let trimmed = |s: &mut Tables, cluster: usize| s.clusters[cluster].flags = ClusterRecord::TRIMMED;
    assert_eq!(retold(|t| trimmed(t, 1)), []);
    assert_eq!(retold(|t| trimmed(t, 0)), [Invariant::Coverage], "no leaf");
    assert_eq!(retold(|t| t.clusters[1].flags = 2), [Invariant::Bytes], "an unknown flag");
    let (mut tables, pages) = two_level().tables();
    assert!(!Chpm::open(write(&mut tables, &pages)).unwrap().is_trimmed());
    trimmed(&mut tables, 2);
    assert!(Chpm::open(write(&mut tables, &pages)).unwrap().is_trimmed());
    // A leaf with an error, with a vertex that is not used, with an id that is nowhere else: only where it is trimmed.
    let mut sample = two_level();
    sample.clusters[1].min_error = sample.clusters[1].errors[0] / 4.0;
    sample.clusters[1].errors.iter_mut().for_each(|error| *error = error.max(0.01));
    sample.clusters[1].positions.insert(0, [4.0, 2.0, 0.5]);
    sample.clusters[1].triangles.iter_mut().flatten().for_each(|v| *v += 1);
    sample.clusters[1].targets.iter_mut().for_each(|v| *v += 1);
    sample.clusters[1].shared.iter_mut().for_each(|(local, _)| *local += 1);
    sample.clusters[1].shared.insert(0, (0, sample.header.shared_vertex_count));
    sample.header.source_vertex_count += 1;
    sample.header.shared_vertex_count += 1;
    let (mut tables, pages) = sample.tables();
    assert_eq!(broken(write(&mut tables, &pages)), [Invariant::Coverage]);
    trimmed(&mut tables, 1);
    assert_eq!(broken(write(&mut tables, &pages)), []);
}

#[test]
fn balance() {
    // The parent claims to be two above its children.
    let skipped = retold(|t| {
        t.clusters[0].level = 2;
        t.groups[2].level = 2;
        t.levels.push(LevelRecord { level: 2, ..LevelRecord::default() });
    });
    assert_eq!(skipped, [Invariant::Balance]);
}

#[test]
fn progressive_meshes() {
    // In page and record alike, so that only playing it shows: leaf 2 at 12288.
    let mut bytes = two_level().bytes();
    let count = bytes[12288 + 20];
    for offset in [12288 + 20, 512 + 2 * 128 + 28] {
        bytes[offset] = count - 1;
    }
    let level = 1152 + 32;
    bytes = with(&bytes, level, &[bytes[level] - 1]);
    assert_eq!(broken(bytes), [Invariant::ProgressiveMesh]);
}

#[test]
fn unions() {
    assert_eq!(changed(|s| s.clusters[0].triangles[3].rotate_left(1)), [], "a rotation is the same triangle");
    assert_eq!(changed(|s| s.clusters[0].triangles.reverse()), [], "order does not matter");
    assert_eq!(changed(|s| s.clusters[0].triangles[3].reverse()), [Invariant::Union], "another orientation");
    let twice = |s: &mut Sample| s.clusters[0].triangles[3] = s.clusters[0].triangles[4];
    assert!(changed(twice).contains(&Invariant::Union), "a multiset");
    let dropped = |s: &mut Sample| s.clusters[0].triangles.truncate(4);
    assert!(changed(dropped).contains(&Invariant::Union));
}

#[test]
fn a_file_of_version_1_0_is_sound_and_tells_no_gaps() {
    let minor = |bytes: &[u8], minor: u8| with(bytes, std::mem::offset_of!(Header, version_minor), &[minor]);
    let old = minor(&two_level().bytes(), 0);
    let file = Chpm::open(old.clone()).unwrap();
    assert!(!file.has_gaps() && Chpm::open(two_level().bytes()).unwrap().has_gaps());
    assert_eq!(broken(old), []);
    // What has a meaning now had none then.
    let (mut tables, pages) = two_level().tables();
    tables.groups[2].gaps = Gaps { fine: 1.0, base: 2.0, from: 0.5 };
    let told = write(&mut tables, &pages);
    assert_eq!(Chpm::open(told.clone()).unwrap().gaps(GroupId(2)), tables.groups[2].gaps);
    assert_eq!(broken(told.clone()), []);
    let told = minor(&told, 0);
    assert_eq!(Chpm::open(told.clone()).unwrap().gaps(GroupId(2)), Gaps::default());
    assert_eq!(broken(told), [Invariant::Bytes]);
}

#[test]
fn nesting() {
    assert_eq!(retold(|t| t.groups[2].min_error *= 0.5), [Invariant::Nesting]);
    assert_eq!(retold(|t| t.groups[2].max_error *= 2.0), [Invariant::Nesting]);
    assert_eq!(retold(|t| t.groups[2].radius *= 0.5), [Invariant::Nesting]);
    // What has vanished stays so.
    let gaps = |fine, base| Gaps { fine, base, from: 0.0 };
    assert_eq!(retold(|t| t.groups[1].gaps = gaps(0.0, 1.0)), [Invariant::Nesting]);
    assert_eq!(retold(|t| (t.groups[1].gaps, t.groups[2].gaps) = (gaps(0.0, 1.0), gaps(1.0, 2.0))), []);
    // The sphere below just fits in, or sticks out by one step.
    let touching = |t: &Tables| {
        let [above, below] = [t.groups[2].sphere(), t.groups[0].sphere()];
        let room = f64::from(above.radius) - distance(above.center, below.center);
        let nearest = room as f32;
        if f64::from(nearest) > room { nearest.next_down() } else { nearest }
    };
    assert_eq!(retold(|t| t.groups[0].radius = touching(t)), []);
    assert_eq!(retold(|t| t.groups[0].radius = touching(t).next_up()), [Invariant::Nesting]);
    assert_eq!(
        retold(|t| t.clusters[1].radius = t.clusters[1].radius.next_down().next_down()),
        [Invariant::Nesting]
    );
    assert_eq!(
        retold(|t| t.groups[0].radius *= 4.0),
        [Invariant::Nesting],
        "the parent's no longer holds it"
    );
    assert_eq!(retold(|t| t.clusters[1].radius *= 0.5), [Invariant::Nesting]);
    assert_eq!(retold(|t| t.clusters[1].aabb_max[2] *= 0.5), [Invariant::Nesting]);
    let lower = |s: &mut Sample| {
        s.clusters[0].min_error = 0.0;
        s.clusters[0].errors.fill(0.001);
    };
    assert_eq!(changed(lower), [Invariant::Nesting], "a parent better than its children");
    let bytes = two_level().bytes();
    assert_eq!(broken(with(&bytes, 144, &[1])), [Invariant::Nesting], "the header's max_error");
    assert_eq!(broken(with(&bytes, 120, &[1])), [Invariant::Nesting], "the header's box");
}

#[test]
fn deviations() {
    let all = Attributes::ALL;
    let told = |attributes, deviations: &[[f32; 2]]| {
        let (mut tables, pages) = sheet(4, 2, 2, attributes).tables();
        // Two leaves and what is above them.
        let levels: Vec<u32> = tables.clusters.iter().rev().map(|c| c.level).collect();
        assert_eq!(levels, [0, 0, 1]);
        for (cluster, [normal, color]) in tables.clusters.iter_mut().rev().zip(deviations) {
            (cluster.normal_deviation, cluster.color_deviation) = (*normal, *color);
        }
        broken(write(&mut tables, &pages))
    };
    assert_eq!(told(all, &[[3.0, 0.0], [20.0, 250.0], [20.0, 255.0]]), []);
    assert_eq!(told(all, &[[3.0, 0.0], [20.0, 250.0], [19.0, 255.0]]), [Invariant::Nesting]);
    assert_eq!(told(all, &[[3.0, 7.0], [0.0, 0.0], [3.0, 6.5]]), [Invariant::Nesting]);
    let colors = Attributes { colors: true, ..Attributes::NONE };
    assert_eq!(told(colors, &[[0.0, 7.0], [0.0, 1.0], [0.0, 7.0]]), []);
    assert_eq!(told(colors, &[[0.0; 2], [0.0; 2], [1.0, 0.0]]), [Invariant::Bytes], "of what is not there");
    let coded = Attributes { octahedral: true, ..Attributes::NONE };
    assert_eq!(told(coded, &[[0.0; 2], [0.0; 2], [1.0, 0.0]]), []);
    assert_eq!(told(Attributes::NONE, &[[0.0; 2], [0.0; 2], [0.0, 1.0]]), [Invariant::Bytes]);
}

#[test]
fn vertices() {
    let moved = changed(|s| s.clusters[0].positions[0][1] = 0.25);
    assert!(moved.contains(&Invariant::Vertices) && moved.contains(&Invariant::Union), "{moved:?}");
    let minus_zero = changed(|s| s.clusters[0].positions[0][0] = -0.0);
    assert!(minus_zero.contains(&Invariant::Vertices), "bits, not values");
    let mut sample = sheet(4, 2, 2, Attributes::ALL);
    assert_eq!(broken(sample.bytes()), []);
    sample.clusters[0].colors[2][3] ^= 1;
    assert_eq!(broken(sample.bytes()), [Invariant::Vertices]);
    let mut sample = sheet(4, 2, 2, Attributes { octahedral: true, ..Attributes::NONE });
    assert_eq!(broken(sample.bytes()), []);
    sample.clusters[0].octahedral[2] = Octahedral::NONE;
    assert_eq!(broken(sample.bytes()), [Invariant::Vertices]);
    let mut sample = sheet(4, 2, 2, Attributes { scalar_words: 4, ..Attributes::NONE });
    assert_eq!(broken(sample.bytes()), []);
    sample.clusters[0].scalars[7] ^= 1;
    assert_eq!(broken(sample.bytes()), [Invariant::Vertices]);
}

#[test]
fn bytes() {
    let good = two_level().bytes();
    let sealed = |offset| broken(with(&good, offset, &[1]));
    assert_eq!(sealed(150), [Invariant::Bytes], "reserved in the header");
    assert_eq!(sealed(512 + 45), [Invariant::Bytes], "cluster flags");
    assert_eq!(sealed(896 + 60), [Invariant::Bytes], "reserved in a group");
    assert_eq!(sealed(4096 + 60), [Invariant::Bytes], "reserved in a page");
    assert_eq!(sealed(8191), [Invariant::Bytes], "padding of a page");
    assert_eq!(sealed(1152 + 8), [Invariant::Bytes], "statistics of a level");
    let not_finite = changed(|s| s.clusters[1].positions[0][0] = f32::NAN);
    assert!(not_finite.contains(&Invariant::Bytes));
    let scalars = sheet(4, 2, 2, Attributes { scalar_words: 1, ..Attributes::NONE });
    let (mut tables, pages) = scalars.tables();
    tables.scalars[0].range = chpm_mesh::ScalarRange { low: 0.0, high: 13.0, count: 15 };
    assert_eq!(broken(write(&mut tables, &pages)), [Invariant::Bytes], "a value outside its range");
    tables.scalars[0].range.high = 14.0;
    tables.header.attributes.scalar_words = 2;
    assert!(chpm_format::ChpmWriter::begin(Vec::new(), &mut tables).is_err(), "words without a scalar");
    let mut damaged = good;
    damaged[8192 + 100] ^= 1;
    let report = verify(&Chpm::open(damaged).unwrap(), |_, _| ());
    assert_eq!((report.good_pages, report.fault_count), (2, 1));
    assert_eq!(report.faults[0].place, FilePart::Page(ClusterId(1)));
}

/// Two leaves of one group, whose shared vertex 1 collapses to shared vertex 0 in both; the parent is above.
fn dependent() -> Sample {
    let leaf = |x: f32| Cluster {
        positions: vec![[0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [x, 1.0, 0.0], [0.0, 1.0, 0.0]],
        triangles: if x < 0.0 { vec![[2, 0, 3], [2, 3, 1]] } else { vec![[2, 3, 0], [2, 1, 3]] },
        targets: vec![0],
        errors: vec![0.5],
        shared: vec![(0, 0), (1, 2), (3, 1)],
        parent: Some(1),
        ..Cluster::default()
    };
    let parent = Cluster {
        positions: vec![[0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [-1.0, 1.0, 0.0], [1.0, 1.0, 0.0]],
        triangles: vec![[2, 0, 1], [3, 1, 0]],
        min_error: 0.5,
        level: 1,
        group: 1,
        ..Cluster::default()
    };
    Sample {
        header: HeaderFields {
            boundary_mode: BoundaryMode::Dependencies,
            source_vertex_count: 5,
            shared_vertex_count: 3,
            ..HeaderFields::default()
        },
        clusters: vec![parent, leaf(-1.0), leaf(1.0)],
        groups: vec![(vec![1, 2], vec![]), (vec![0], vec![1, 2])],
    }
}

#[test]
fn boundaries() {
    let broken_by = |change: &dyn Fn(&mut Sample)| {
        let mut sample = dependent();
        change(&mut sample);
        broken(sample.bytes())
    };
    assert_eq!(broken_by(&|_| ()), []);
    assert_eq!(broken_by(&|s| s.header.boundary_mode = BoundaryMode::Lock), [Invariant::Boundary]);
    assert_eq!(broken_by(&|s| s.clusters[1].errors[0] = 0.25), [Invariant::Boundary], "at another error");
    assert!(broken_by(&|s| s.clusters[1].targets[0] = 1).contains(&Invariant::Boundary), "to another place");
    let apart = |s: &mut Sample| {
        s.groups = vec![(vec![1], vec![]), (vec![2], vec![]), (vec![0], vec![1, 2])];
        (s.clusters[0].group, s.clusters[2].group) = (2, 1);
        (s.clusters[1].parent, s.clusters[2].parent) = (Some(2), Some(2));
    };
    assert_eq!(broken_by(&apart), [Invariant::Boundary], "its neighbour is in another group");
}

#[test]
fn faults_are_counted_when_they_are_too_many_to_keep() {
    let mut sample = sheet(64, 40, 16, Attributes::NONE);
    for cluster in &mut sample.clusters {
        for (_, id) in &mut cluster.shared {
            *id = 0;
        }
    }
    let report = verify(&Chpm::open(sample.bytes()).unwrap(), |_, _| ());
    assert!(report.faults.len() == MAX_FAULTS && report.fault_count > 1000);
}

#[test]
fn verification_ends_after_the_group_where_it_is_enough() {
    let file = Chpm::open(two_level().bytes()).unwrap();
    for memory in [0, u64::MAX] {
        let mut groups = 0;
        let report = verify_within(&file, memory, |_, _| {
            groups += 1;
            ControlFlow::Break(())
        });
        assert_eq!((report, groups), (None, 1));
    }
}
