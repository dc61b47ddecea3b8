//! Range grids, as the Stanford scans are kept.

use chpm_import::ply::{Options, PlyError, Warning, read_mesh};

/// Two columns and three rows more than this: rows and columns, and which samples there are.
fn ply(columns: &str, samples: &[Option<u32>]) -> String {
    let mut text = format!(
        "ply\nformat ascii 1.0\nobj_info is_mesh 0\nobj_info num_cols {columns}\nelement vertex 6\nproperty float x\n\
         property float y\nproperty float z\nelement range_grid {}\nproperty list uchar int vertex_indices\nend_header\n",
        samples.len()
    );
    (0..6).for_each(|v| text += &format!("{} {} 0\n", v % 3, v / 3));
    for sample in samples {
        text += &sample.map_or("0\n".to_owned(), |v| format!("1 {v}\n"));
    }
    text
}

fn triangles(columns: &str, samples: &[Option<u32>]) -> Vec<[u32; 3]> {
    read_mesh(ply(columns, samples).as_bytes(), Options::default()).unwrap().0.triangles
}

#[test]
fn neighbours_become_triangles_that_look_one_way() {
    let all = [0, 1, 2, 3, 4, 5].map(Some);
    assert_eq!(triangles("3", &all), [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]]);
    assert_eq!(triangles("2", &all), [[0, 1, 3], [0, 3, 2], [2, 3, 5], [2, 5, 4]]);
    assert_eq!(triangles("1", &all), [[0u32; 3]; 0]);
}

#[test]
fn three_of_four_make_one_triangle_and_fewer_none() {
    let without = |missing: usize| {
        let mut all = [0, 1, 3, 4].map(Some);
        all[missing] = None;
        triangles("2", &all)
    };
    // Row by row: 0 1 below 3 4.
    assert_eq!(without(0), [[1, 4, 3]]);
    assert_eq!(without(1), [[0, 4, 3]]);
    assert_eq!(without(2), [[0, 1, 4]]);
    assert_eq!(without(3), [[0, 1, 3]]);
    assert_eq!(triangles("2", &[None, Some(1), Some(3), None]), [[0u32; 3]; 0]);
}

#[test]
fn a_grid_without_rows_is_a_point_cloud_and_bad_samples_are_refused() {
    for columns in ["4", "0", "x"] {
        let error = read_mesh(ply(columns, &[Some(0); 6]).as_bytes(), Options::default()).unwrap_err();
        assert!(matches!(error, PlyError::PointCloud { vertices: 6 }), "{error}");
    }
    let error = read_mesh(ply("2", &[Some(0), Some(6)]).as_bytes(), Options::default()).unwrap_err();
    assert!(matches!(error, PlyError::IndexOutOfRange { index: 6, .. }), "{error}");
    let cut = ply("2", &[Some(0); 4]);
    let error = read_mesh(&cut.as_bytes()[..cut.len() - 4], Options::default()).unwrap_err();
    assert!(matches!(error, PlyError::Truncated { read: 3, count: 4, .. }), "{error}");
}

#[test]
fn faces_come_before_a_grid() {
    let text = ply("3", &[0, 1, 2, 3, 4, 5].map(Some))
        .replace("end_header\n", "element face 1\nproperty list uchar int vertex_indices\nend_header\n")
        + "3 0 1 2\n";
    let (mesh, _, warnings) = read_mesh(text.as_bytes(), Options::default()).unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    assert_eq!(warnings, [Warning::ElementSkipped { element: "range_grid".to_owned(), count: 6 }]);
}
