//! Images of meshes that are taken out of a file.

use super::sheets::{BUILD, SQUARES, board, png, points_of, textured};

#[test]
fn a_small_mesh_has_all_texels_that_its_image_has_room_for() {
    let folder = textured();
    // Squares that are smaller than texels of the coarsest sheets.
    let fine = |u: f64, v: f64| board(4.0 * u, 4.0 * v).to_vec();
    folder.write("a.png", png(1024, fine, png::ColorType::Rgb));
    folder.stdout(&format!("build a.obj -o a.chpm {BUILD}"));
    let report: serde_json::Value =
        serde_json::from_str(&folder.stdout("stats a.chpm --json")).expect("a report");
    let levels = report["levels"].as_array().expect("a list");
    let texels = |level: &serde_json::Value| level["sheets"]["texels"].as_f64().expect("a number");
    let [first, last] = [levels.first(), levels.last()].map(|level| texels(level.expect("a level")));
    assert!(last < first / 3.0, "{last} of {first}");

    let shares: Vec<[f64; 3]> = (1..12)
        .flat_map(|i| (1..12 - i).map(move |j| [i, j, 12 - i - j].map(|part| f64::from(part) / 12.0)))
        .collect();
    let right = |name: &str| {
        let in_middle = |x: f64| ((4.0 * x * f64::from(SQUARES)).fract() - 0.5).abs() < 0.12;
        let all = points_of(&folder, "a.chpm", name, &shares);
        let some: Vec<_> = all.into_iter().filter(|([x, y], _)| in_middle(*x) && in_middle(*y)).collect();
        assert!(some.len() > 100, "{name}: {}", some.len());
        let is_right = |([x, y], color): &([f64; 2], [u8; 3])| {
            let expected = board(4.0 * x, 4.0 * y);
            color.iter().zip(expected).all(|(a, b)| a.abs_diff(b) <= 40)
        };
        some.iter().filter(|point| is_right(point)).count() as f64 / some.len() as f64
    };
    for (name, ask, least) in [
        ("few", "--triangles 200 --texture-size 2048", 0.9),
        ("many", "--triangles 1500 --texture-size 2048", 0.97),
        ("tight", "--triangles 200 --texture-size 1024", 0.8),
    ] {
        folder.stdout(&format!("extract a.chpm {ask} -o {name}.glb -q"));
        let share = right(&format!("{name}.glb"));
        assert!(share >= least, "{ask}: {share}");
    }
    // Where there is no room for more, there are hardly more than the file has.
    folder.stdout("extract a.chpm --triangles 200 --texture-size 256 -o small.glb -q");
    let [few, small] = ["few.glb", "small.glb"].map(|name| folder.read(name).len());
    assert!(few > 4 * small, "{few} {small}");
    // The same bytes whatever the memory; refused where there is none.
    folder.stdout("extract a.chpm --triangles 200 --texture-size 2048 -o again.glb -q --memory 256M");
    assert!(folder.read("again.glb") == folder.read("few.glb"));
    let told =
        folder.stderr("extract a.chpm --triangles 200 --texture-size 2048 -o no.glb -q --memory 64M", 2);
    assert!(told.contains("--memory"), "{told}");
}
