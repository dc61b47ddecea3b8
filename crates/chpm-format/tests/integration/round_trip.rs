use crate::sample::{metadata, sheet, tetrahedron, two_level};
use chpm_format::{Chpm, ChpmWriter, FormatError, LevelRecord, Page, PageParts, verify};
use chpm_mesh::{Attributes, ClusterId, GroupId, VertexSlices};
use proptest::prelude::*;

#[test]
fn a_tetrahedron_comes_back() {
    let file = Chpm::open(tetrahedron().bytes()).unwrap();
    assert_eq!(file.bytes().len(), 8192);
    let header = file.header();
    assert_eq!((header.cluster_count, header.group_count, header.level_count), (1, 1, 1));
    assert_eq!((header.root_count, header.leaf_count, header.source_triangle_count), (1, 1, 4));
    assert_eq!((header.aabb_max, header.max_error), ([1.0; 3], 0.75));
    assert_eq!(file.metadata().unwrap(), metadata());
    assert_eq!(file.roots().collect::<Vec<_>>(), [ClusterId(0)]);
    let page = file.page_checked(ClusterId(0)).unwrap();
    let page = page.view();
    assert_eq!(page.triangles, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]);
    assert_eq!((page.vertex_count(), page.base_vertex_count, page.base_triangle_count), (4, 3, 2));
    let report = verify(&file, |_, _| ());
    assert_eq!((report.faults, report.triangles), (vec![], 4));
}

#[test]
fn two_levels_come_back() {
    let file = Chpm::open(two_level().bytes()).unwrap();
    assert_eq!(file.clusters().len(), 3);
    let parent = GroupId(2);
    assert_eq!((file.coarse(parent), file.fine(parent)), (&[0][..], &[1, 2][..]));
    assert_eq!((file.coarse(GroupId(0)), file.fine(GroupId(0))), (&[2][..], &[][..]));
    let level = file.levels()[0];
    assert_eq!((level.cluster_count, level.vertex_count, level.triangle_count), (2, 18, 16));
    assert_eq!((level.shared_vertex_count, level.refusals), (6, [7; 8]));
    let left = file.page(ClusterId(2)).unwrap();
    let left = left.view();
    let right = file.page(ClusterId(1)).unwrap();
    let right = right.view();
    let ids = |page: &Page<'_>| page.shared().map(|(_, id)| id).collect::<Vec<_>>();
    assert_eq!((ids(&left), ids(&right)), (vec![0, 1, 2], vec![0, 1, 2]));
    for ((a, _), (b, _)) in left.shared().zip(right.shared()) {
        assert!(left.is_shared(a));
        assert_eq!(left.positions[usize::from(a)], right.positions[usize::from(b)]);
    }
    assert_eq!((0..9).filter(|v| left.is_shared(*v)).count(), 3);
    let mut told = vec![];
    assert_eq!(verify(&file, |done, all| told.push((done, all))).faults, []);
    assert_eq!(told, [(1, 3), (2, 3), (3, 3)]);
}

#[test]
fn attributes_and_many_levels_come_back() {
    let scalars = Attributes { scalar_words: 4, ..Attributes::ALL };
    for attributes in
        [Attributes::ALL, Attributes { normals: false, octahedral: true, ..Attributes::ALL }, scalars]
    {
        come_back(attributes);
    }
}

fn come_back(attributes: Attributes) {
    let sample = sheet(32, 5, 8, attributes);
    let file = Chpm::open(sample.bytes()).unwrap();
    assert_eq!((file.header().attributes(), file.levels().len()), (attributes, 4));
    assert_eq!(verify(&file, |_, _| ()).faults, []);
    for (id, cluster) in sample.clusters.iter().enumerate() {
        let page = file.page(ClusterId(id as u32)).unwrap();
        let page = page.view();
        assert_eq!(page.positions, cluster.positions);
        assert_eq!(page.normals, cluster.normals);
        assert_eq!(page.octahedral, cluster.octahedral);
        assert_eq!(page.colors, cluster.colors);
        assert_eq!(page.triangles, cluster.triangles);
        assert_eq!(page.targets, cluster.targets);
        assert_eq!(page.shared().collect::<Vec<_>>(), cluster.shared);
    }
}

#[test]
fn the_writer_completes_tables_and_knows_the_length() {
    let (mut tables, pages) = two_level().tables();
    // The order of members is the writer's, and statistics are its own.
    let first = tables.groups[2].fine_first as usize;
    tables.members.swap(first, first + 1);
    tables.levels[1] = LevelRecord { level: 1, vertex_count: 99, refusals: [7; 8], ..Default::default() };
    let bytes = crate::sample::write(&mut tables, &pages);
    assert_eq!(bytes, two_level().bytes());
    assert_eq!(tables.file_len().unwrap(), bytes.len() as u64);
    let offsets: Vec<u64> = tables.clusters.iter().map(|c| c.page_offset).collect();
    assert_eq!(offsets, [4096, 8192, 12288]);
}

#[test]
fn the_writer_refuses_what_no_reader_would_take() {
    let (tables, pages) = two_level().tables();
    let refused = |change: &dyn Fn(&mut chpm_format::Tables)| {
        let mut tables = tables.clone();
        change(&mut tables);
        ChpmWriter::begin(Vec::new(), &mut tables).is_err()
    };
    assert!(!refused(&|_| ()));
    assert!(refused(&|t| t.clusters[1].group = 9));
    assert!(refused(&|t| t.clusters[1].page_len += 1));
    assert!(refused(&|t| t.clusters[0].min_error = f32::NAN));
    assert!(refused(&|t| t.groups[2].fine_count = u32::MAX));
    assert!(refused(&|t| t.levels.truncate(1)));
    assert!(refused(&|t| t.header.origin[2] = f64::INFINITY));
    assert!(refused(&|t| t.metadata.warnings.push("w".repeat(17 << 20))));
    assert!(refused(&|t| *t = Default::default()));

    let begin = || ChpmWriter::begin(Vec::new(), &mut tables.clone()).unwrap();
    let mut writer = begin();
    assert!(matches!(writer.page(&pages[1][..60]), Err(FormatError::Value { .. })));
    let mut damaged = pages[0].clone();
    damaged[70] ^= 1;
    assert!(matches!(writer.page(&damaged), Err(FormatError::Checksum { .. })));
    assert!(writer.finish().is_err(), "pages are missing");
    let mut writer = begin();
    pages.iter().for_each(|page| writer.page(page).unwrap());
    assert!(writer.page(&pages[0]).is_err(), "a page too many");
}

#[test]
fn positions_are_chosen_by_error() {
    let positions = [[0.0; 3]; 5];
    let parts = PageParts {
        vertices: VertexSlices::new(&positions),
        triangles: &[[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]],
        targets: &[0, 0, 1],
        errors: &[3.0, 1.0, 1.0],
        min_error: 0.5,
        ..PageParts::default()
    };
    let mut bytes = Vec::new();
    assert_eq!(parts.encode(&mut bytes).unwrap(), 3.0);
    let page = Page::parse(&bytes).unwrap();
    let errors: Vec<f32> = (2..=5).map(|n| page.error_at(n)).collect();
    assert_eq!((errors, page.error_scale), (vec![3.0, 1.0, 1.0, 0.5], 4.0));
    for (bound, n) in [(9.0, 2), (3.0, 2), (2.9, 3), (1.0, 3), (0.9, 5), (0.1, 5), (f32::NAN, 5)] {
        assert_eq!(page.vertices_for(bound), n, "within {bound}");
    }
    // A common scale changes no error that both can hold.
    let mut bytes = Vec::new();
    PageParts { scale_error: 100.0, ..parts }.encode(&mut bytes).unwrap();
    let page = Page::parse(&bytes).unwrap();
    assert_eq!((page.error_scale, page.error_at(2), page.error_at(4)), (128.0, 3.0, 1.0));
}

#[test]
fn parts_that_make_no_page_are_refused_and_leave_nothing() {
    let good = PageParts {
        vertices: VertexSlices::new(&[[0.0; 3]; 4]),
        triangles: &[[0, 1, 3]],
        targets: &[0, 2],
        errors: &[2.0, 1.0],
        shared: &[(0, 5), (3, 1)],
        ..PageParts::default()
    };
    let refused = |parts: PageParts<'_>| {
        let mut out = vec![1, 2, 3];
        parts.encode(&mut out).is_err() && out == [1, 2, 3]
    };
    assert!(!refused(good));
    assert!(refused(PageParts::default()));
    assert!(refused(PageParts { vertices: VertexSlices::new(&vec![[0.0; 3]; 65_536]), ..good }));
    assert!(refused(PageParts {
        vertices: VertexSlices { normals: &[[0.0; 3]; 3], ..good.vertices },
        ..good
    }));
    assert!(refused(PageParts { triangles: &[[0, 1, 1]], ..good }));
    assert!(refused(PageParts { triangles: &[[0, 1, 4]], ..good }));
    assert!(refused(PageParts { targets: &[0, 3], ..good }));
    assert!(refused(PageParts { errors: &[1.0], ..good }));
    assert!(refused(PageParts { errors: &[1.0, 2.0], ..good }));
    assert!(refused(PageParts { errors: &[f32::INFINITY, 2.0], ..good }));
    assert!(refused(PageParts { errors: &[2.0, f32::NAN], ..good }));
    assert!(refused(PageParts { min_error: 1.5, ..good }));
    assert!(refused(PageParts { shared: &[(3, 1), (0, 5)], ..good }));
    assert!(refused(PageParts { shared: &[(4, 1)], ..good }));
}

proptest! {
    #[test]
    fn pages_hold_any_parts(
        v in 1usize..40,
        collapses in 0usize..39,
        seed in prop::collection::vec(any::<u16>(), 200),
        errors in prop::collection::vec(0f32..1e6, 40),
    ) {
        let collapses = collapses.min(v - 1);
        let base = v - collapses;
        let pick = |i: usize, below: usize| seed[i % 200] % below as u16;
        let targets: Vec<u16> = (0..collapses).map(|j| pick(j, base + j)).collect();
        let triangles: Vec<[u16; 3]> = (0..60)
            .map(|i| [pick(3 * i, v), pick(3 * i + 1, v), pick(3 * i + 2, v)])
            .filter(|[a, b, c]| a != b && b != c && c != a)
            .collect();
        let mut errors = errors[..collapses].to_vec();
        errors.sort_by(|a, b| b.total_cmp(a));
        let shared: Vec<(u16, u32)> = (0..v as u16).filter(|i| seed[100 + usize::from(*i)] % 3 == 0).map(|i| (i, 7 * u32::from(i))).collect();
        let positions: Vec<[f32; 3]> = (0..v).map(|i| [f32::from(seed[i]), 0.5, -1.0]).collect();
        let parts = PageParts { vertices: VertexSlices::new(&positions), triangles: &triangles, targets: &targets, errors: &errors, shared: &shared, ..PageParts::default() };
        let mut bytes = Vec::new();
        let max_error = parts.encode(&mut bytes).unwrap();
        let page = Page::parse(&bytes).unwrap();
        prop_assert_eq!(page.max_error(), max_error);
        prop_assert_eq!((page.positions, page.triangles, page.targets), (&positions[..], &triangles[..], &targets[..]));
        prop_assert_eq!(page.shared().collect::<Vec<_>>(), shared);
        for (j, error) in errors.iter().enumerate() {
            prop_assert!(page.error_at(base + j) >= *error);
            // The oracle of the search: try every position.
            let bound = page.error_at(base + j);
            let fewest = (base..=v).find(|n| page.error_at(*n) <= bound).unwrap();
            prop_assert_eq!(page.vertices_for(bound), fewest);
        }
        let mut base_mesh = Vec::new();
        page.progressive_mesh().triangles_at(base, &mut base_mesh);
        prop_assert_eq!(page.base_triangle_count, base_mesh.len());
    }
}
