//! Shadows of the GPU's map beside those that rays find.

use super::harness::{Folder, skipped};
use super::render::picture;

const SIZE: [usize; 2] = [480, 360];

/// By pixel, how much light shadows take, of 255; and whether it shows the model.
fn losses(folder: &Folder, free: &str, shadowed: &str) -> (Vec<i32>, Vec<bool>) {
    let [free, shadowed] = [free, shadowed].map(|words| {
        folder.stdout(&format!("render {words} --viewport 480x360 --samples 1 -qf -o out.png"));
        picture(folder, "out.png").2
    });
    // In a corner there is nothing.
    let shown = free.iter().map(|pixel| pixel != &free[0]).collect();
    (free.iter().zip(shadowed).map(|(a, b)| i32::from(a[1]) - i32::from(b[1])).collect(), shown)
}

/// Whether shadow and light meet within some pixels.
fn is_near_edge(losses: &[i32], n: usize, pixels: usize) -> bool {
    let [width, height] = SIZE;
    let (x, y) = (n % width, n / width);
    let is_dark = |n: usize| losses[n] > SEEN;
    let columns = x.saturating_sub(pixels)..(x + pixels + 1).min(width);
    let all =
        columns.flat_map(|x| (y.saturating_sub(pixels)..(y + pixels + 1).min(height)).map(move |y| (x, y)));
    all.into_iter().any(|(x, y)| is_dark(y * width + x) != is_dark(n))
}

/// A loss that is seen, of 255.
const SEEN: i32 = 8;

/// Blocks on a plate; a landscape; a surface with many holes: farther than two pixels from an edge of a shadow, 99.5 % of what takes
/// light has the same of it. At more than a pixel of error, meshes of rays and of the GPU differ by more than that.
#[test]
fn maps_have_the_shadows_of_rays() {
    let folder = Folder::new();
    for (shape, triangles) in [("isosurface", 60_000), ("terrain", 60_000), ("sphere", 20_000)] {
        folder.stdout(&format!("synth {shape} --triangles {triangles} -o {shape}.ply -q"));
        folder.stdout(&format!("build {shape}.ply -q --cluster-triangles 512"));
    }
    folder.write("blocks.ply", blocks());
    folder.stdout("build blocks.ply -q --cluster-triangles 128");
    let drawn = folder.chpm("render blocks.chpm --viewport 20x20 -o probe.png").get_output().clone();
    if !drawn.status.success() {
        skipped("shadows beside rays: there is no adapter");
        return;
    }
    for words in [
        "blocks.chpm --up z --view iso --light -80,20 --shading flat",
        "blocks.chpm --camera 3,-9,1.5,5,0,0.5,50 --up z --light 70,30",
        "blocks.chpm --up z --view iso --light 60,30 --clip z:0.8",
        "isosurface.chpm --light 40,40",
        "isosurface.chpm --camera 0.17,0.17,0.95,0.15,0.12,0.3,60 --light 50,30",
        "terrain.chpm --up z --view iso --light 80,10",
        "terrain.chpm --up z --camera 0.5,0.05,0.25,0.5,0.6,0,45 --light 75,5",
        "sphere.chpm --light 60,20",
    ] {
        let (map, shown) = losses(&folder, words, &format!("{words} --shadows"));
        let rays = format!("{words} --rays --occlusion 0");
        let (rays, _) = losses(&folder, &format!("{rays} --no-shadows"), &format!("{rays} --light-width 0"));
        let (mut judged, mut dark, mut unlike) = (0, 0, 0);
        for n in 0..rays.len() {
            if shown[n] && !is_near_edge(&rays, n, 2) {
                judged += 1;
                dark += usize::from(rays[n] > SEEN);
                unlike += usize::from(rays[n].abs_diff(map[n]) > SEEN as u32);
            }
        }
        println!("{words}: {unlike} of {judged} are unlike, {dark} dark");
        assert!(1000 * unlike <= 5 * judged && judged > 12_000, "{words}: {unlike} of {judged}");
        assert!(words.starts_with("sphere") == (dark == 0), "{words}: {dark}");
    }
}

/// A plate with boxes of several heights on it.
fn blocks() -> String {
    let mut corners = Vec::new();
    let mut faces = Vec::new();
    let mut add = |low: [f64; 3], high: [f64; 3]| {
        let first = corners.len();
        corners.extend((0..8).map(|n| {
            let at = [0, 1, 2].map(|axis| if n >> axis & 1 == 1 { high[axis] } else { low[axis] });
            format!("{} {} {}", at[0], at[1], at[2])
        }));
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        faces.extend(quads.map(|quad| format!("4 {}", quad.map(|n| (first + n).to_string()).join(" "))));
    };
    add([-1.0, -5.0, -0.5], [11.0, 5.0, 0.0]);
    for n in 0..24_u32 {
        let (x, y) = (f64::from(n % 6) * 1.7 + 0.3, f64::from(n / 6) * 2.2 - 4.0);
        let height = 0.4 + 0.35 * f64::from(n * 7 % 5);
        add([x, y, 0.1], [x + 0.8, y + 0.6 + 0.05 * f64::from(n % 3), 0.1 + height]);
    }
    let head = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        corners.len(),
        faces.len()
    );
    format!("{head}{}\n{}\n", corners.join("\n"), faces.join("\n"))
}

#[test]
fn shadows_go_with_what_is_drawn() {
    let folder = Folder::new();
    folder.stdout("synth sphere --triangles 2000 -o ball.ply -q");
    folder.stdout("build ball.ply -q");
    for other in ["--rays", "--ids"] {
        let error = folder.stderr(&format!("render ball.chpm -q -o out.png --shadows {other}"), 2);
        assert!(error.contains(other), "{error}");
    }
    assert!(!folder.names().iter().any(|name| name == "out.png"));
}
