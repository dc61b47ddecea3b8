//! What a camera needs: extracted without cracks, and less where it is far away.

use super::harness::Folder;
use chpm_measure::crack::cracks;
use chpm_mesh::TriMesh;

/// A built model: `in.ply` and `in.chpm`.
fn built(shape: &str) -> (Folder, TriMesh) {
    let folder = Folder::new();
    folder.stdout(&format!("synth {shape} --triangles 20000 -o in.ply -q"));
    folder.stdout("build in.ply -q --cluster-triangles 512");
    let source = folder.read_mesh("in.ply");
    (folder, source)
}

/// A camera beside a corner of the model that looks at the opposite one.
fn corner(source: &TriMesh, away: f32) -> String {
    let end = |axis: usize, pick: fn(f32, f32) -> f32, start: f32| {
        source.positions.iter().map(|p| p[axis]).fold(start, pick)
    };
    let least = [0, 1, 2].map(|axis| end(axis, f32::min, f32::INFINITY));
    let most = [0, 1, 2].map(|axis| end(axis, f32::max, f32::NEG_INFINITY));
    let position = [0, 1, 2].map(|axis| most[axis] + away * (most[axis] - least[axis]));
    format!("{position:?},{least:?}").replace(['[', ']', ' '], "")
}

#[test]
fn what_a_camera_needs_has_no_cracks() {
    for shape in ["terrain", "isosurface", "torus"] {
        let (folder, source) = built(shape);
        let (near, far) = (corner(&source, 0.02), corner(&source, 3.0));
        for wanted in [
            "--poe 1".to_owned(),
            "--poe 8".to_owned(),
            "--triangles 3000".to_owned(),
            "--triangles 15000".to_owned(),
            format!("--poe 4 --camera {near}"),
            format!("--poe 4 --cull --camera {near},20"),
            format!("--poe 1 --viewport 1920x1080 --camera {far}"),
            format!("--triangles 12000 --camera {near}"),
        ] {
            folder.stdout(&format!("extract in.chpm {wanted} -o out.ply -qf"));
            let lod = folder.read_mesh("out.ply");
            assert!(lod.triangles.len() < source.triangles.len(), "{shape} {wanted}");
            assert_eq!(cracks(&lod, &source), [], "{shape} {wanted}");
        }
    }
}

#[test]
fn more_pixels_and_more_distance_need_less() {
    let (folder, source) = built("terrain");
    let triangles = |wanted: &str| {
        folder.stdout(&format!("extract in.chpm {wanted} -o out.ply -qf"));
        folder.read_mesh("out.ply").triangles.len()
    };
    let (near, far) = (corner(&source, 0.02), corner(&source, 3.0));
    assert!(triangles("--poe 0.5") > triangles("--poe 4"));
    assert!(triangles(&format!("--poe 1 --camera {near}")) > triangles(&format!("--poe 1 --camera {far}")));
    let image = |viewport| triangles(&format!("--poe 1 --camera {near} --viewport {viewport}"));
    assert!(image("2000x2000") > image("200x200"));
    let away = near.split(',').map(|x| x.parse::<f32>().expect("a number")).collect::<Vec<_>>();
    let away = format!("{},{},{},{},{},{}", away[0], away[1], away[2], away[0] + 1.0, away[1] + 1.0, away[2]);
    let [seen, unseen] = ["", "--cull"].map(|cull| triangles(&format!("--poe 1 --camera {away} {cull}")));
    assert!(unseen < seen, "{unseen} {seen}");
    let limit = 9000;
    for camera in [String::new(), format!("--camera {near}")] {
        let within = triangles(&format!("--triangles {limit} {camera}"));
        assert!(within <= limit && within >= limit * 97 / 100, "{within}");
    }
}

#[test]
fn wrong_views_are_refused() {
    let folder = Folder::new();
    for words in [
        "--poe 1 --camera 1,2,3",
        "--poe 1 --camera 1,2,3,4,5,x",
        "--poe -1",
        "--poe 1 --viewport 0x5",
        "--camera 1,2,3,4,5,6",
        "--error 1 --camera 1,2,3,4,5,6",
        "--poe 1 --triangles 5",
    ] {
        folder.chpm(&format!("extract x.chpm {words} -o y.ply")).code(2);
    }
    folder.stdout("synth sphere --triangles 500 -o in.ply -q");
    folder.stdout("build in.ply -q");
    let error = folder.stderr("extract in.chpm --poe 1 --camera 1,2,3,1,2,3 -o y.ply", 2);
    assert!(error.contains("target"), "{error}");
    assert_eq!(folder.names(), ["in.chpm", "in.ply"]);
}
