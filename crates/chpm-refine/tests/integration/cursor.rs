use crate::strips::{ALL, File};
use chpm_mesh::{ClusterId, ProgressiveMesh};
use chpm_refine::PmCursor;
use proptest::prelude::*;

/// Compares the cursor with playing from scratch, in both orders.
fn agrees(cursor: &PmCursor, mesh: &ProgressiveMesh<'_>, is_prepared: bool) {
    let n = cursor.position();
    let mut expected = Vec::new();
    mesh.triangles_at(n, &mut expected);
    assert_eq!(cursor.triangles_in_file_order().collect::<Vec<_>>(), expected, "at {n} vertices");
    if is_prepared {
        let mut by_birth: Vec<_> = mesh.triangles.iter().filter(|t| mesh.birth(**t) <= n).collect();
        by_birth.sort_by_key(|t| mesh.birth(**t));
        expected = by_birth.iter().map(|t| t.map(|v| mesh.resolve(v, n))).collect();
    }
    assert_eq!(cursor.triangles(), expected, "at {n} vertices, prepared: {is_prepared}");
}

/// A cursor whose steps are prepared.
fn prepared(mesh: &ProgressiveMesh<'_>) -> PmCursor {
    let mut cursor = PmCursor::new(mesh);
    cursor.prepare_steps();
    cursor
}

#[test]
fn a_fan_collapses_and_comes_back() {
    let fan = ProgressiveMesh {
        vertex_count: 5,
        base_vertex_count: 3,
        triangles: &[[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]],
        targets: &[0, 0],
    };
    for mut cursor in [PmCursor::new(&fan), prepared(&fan)] {
        assert_eq!((cursor.position(), cursor.base_vertex_count(), cursor.vertex_count()), (5, 3, 5));
        cursor.move_to(4);
        assert_eq!(cursor.triangles(), [[1, 2, 0], [2, 3, 0]]);
        cursor.move_to(3);
        assert_eq!(cursor.triangles(), [[1, 2, 0]]);
        cursor.move_to(0);
        assert_eq!((cursor.position(), cursor.triangles().len()), (3, 1));
        cursor.move_to(9);
        assert_eq!(cursor.position(), 5);
        assert_eq!(cursor.triangles_in_file_order().collect::<Vec<_>>(), fan.triangles);
    }
}

#[test]
fn an_empty_cursor_has_no_triangles() {
    let mut cursor = PmCursor::default();
    cursor.move_to(7);
    assert_eq!((cursor.position(), cursor.triangles().len()), (0, 0));
}

#[test]
fn one_cursor_serves_every_cluster() {
    let mut cursor = PmCursor::default();
    for file in ALL.iter().map(|plan| plan.build()) {
        for id in (0..file.clusters().len() as u32).map(ClusterId) {
            let page = File::page(&file, id).unwrap();
            let mesh = page.view().progressive_mesh();
            cursor.load(&mesh);
            for n in (mesh.base_vertex_count..=mesh.vertex_count).rev() {
                cursor.move_to(n);
                let (mut scratch, mut stepped) = (PmCursor::new(&mesh), cursor.clone());
                scratch.move_to(n);
                agrees(&scratch, &mesh, false);
                stepped.prepare_steps();
                agrees(&stepped, &mesh, true);
            }
            let record = &file.clusters()[id.index()];
            assert_eq!(cursor.triangles().len(), record.base_triangle_count as usize);
        }
    }
}

/// Any triangles with any collapses: nothing that looks like a surface is needed.
fn any_mesh() -> impl Strategy<Value = (usize, Vec<[u16; 3]>, Vec<u16>)> {
    (1..12usize, 0..30usize).prop_flat_map(|(base, collapses)| {
        let v = (base + collapses) as u16;
        let legal = |[a, b, c]: &[u16; 3]| a != b && b != c && c != a;
        let triangle = prop::array::uniform3(0..v).prop_filter("three corners", legal);
        let triangles = prop::collection::vec(triangle, 0..if v < 3 { 1 } else { 60 });
        let targets: Vec<_> = (base..base + collapses).map(|v| 0..v as u16).collect();
        (Just(base), triangles, targets)
    })
}

proptest! {
    #[test]
    fn random_walks_end_where_playing_from_scratch_does(
        (base_vertex_count, triangles, targets) in any_mesh(),
        walk in prop::collection::vec(0..45usize, 0..20),
    ) {
        let vertex_count = base_vertex_count + targets.len();
        let (triangles, targets) = (&triangles[..], &targets[..]);
        let mesh = ProgressiveMesh { vertex_count, base_vertex_count, triangles, targets };
        let (mut cursor, mut stepped) = (PmCursor::new(&mesh), prepared(&mesh));
        agrees(&cursor, &mesh, false);
        agrees(&stepped, &mesh, true);
        // The first move is played from scratch, the last of many is a step; what is between shows in the order alone.
        let mut moves = 0_u32;
        for n in walk {
            moves += u32::from(n.clamp(base_vertex_count, vertex_count) != cursor.position());
            for cursor in [&mut cursor, &mut stepped] {
                cursor.move_to(n);
                prop_assert_eq!(cursor.position(), n.clamp(base_vertex_count, vertex_count));
            }
            agrees(&cursor, &mesh, moves > PmCursor::REPLAYS);
            agrees(&stepped, &mesh, true);
        }
        // Another load starts anew, in used memory.
        cursor.load(&mesh);
        agrees(&cursor, &mesh, false);
        cursor.move_to(base_vertex_count);
        agrees(&cursor, &mesh, false);
    }
}
