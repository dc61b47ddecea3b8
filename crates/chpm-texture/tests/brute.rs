//! Averages against sums over single texels, in any budget and order, and the cases that are hard.

use chpm_extmem::{Cancel, Store};
use chpm_texture::{
    Alpha, Averager, Images, Material, OpenImage, OpenedImage, TextureError, TexturedTriangle, Wrap,
};
use std::io::{self, Cursor};

/// Pixels of an image.
struct Picture {
    size: [u32; 2],
    pixels: Vec<[u8; 4]>,
}

impl Picture {
    fn new(size: [u32; 2], mut pixel: impl FnMut(u32, u32) -> [u8; 4]) -> Self {
        let all = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y)));
        Picture { size, pixels: all.map(|(x, y)| pixel(x, y)).collect() }
    }

    fn noise(size: [u32; 2], seed: u32) -> Self {
        let mut random = Random(seed);
        Picture::new(size, |x, y| {
            let [r, g, b, a] = random.next().to_le_bytes();
            [r / 2 + (x * 127 / size[0]) as u8, g / 2 + (y * 127 / size[1]) as u8, b, a | 15]
        })
    }

    fn smooth(size: [u32; 2]) -> Self {
        Picture::new(size, |x, y| [(x * 255 / size[0]) as u8, (y * 255 / size[1]) as u8, 90, 255])
    }

    fn png(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.size[0], self.size[1]);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_compression(png::Compression::Fastest);
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(self.pixels.as_flattened()).unwrap();
        writer.finish().unwrap();
        bytes
    }

    /// A pixel of the grid that the image covers as it is wrapped.
    fn at(&self, place: [i64; 2], wrap: [Wrap; 2]) -> [u8; 4] {
        let inside = |axis: usize| {
            let side = i64::from(self.size[axis]);
            match wrap[axis] {
                Wrap::Clamp => place[axis].max(0).min(side - 1),
                Wrap::Repeat => (place[axis] % side + side) % side,
                Wrap::Mirror => {
                    let turned = (place[axis] % (2 * side) + 2 * side) % (2 * side);
                    if turned < side { turned } else { 2 * side - 1 - turned }
                }
            }
        };
        self.pixels[(inside(1) * i64::from(self.size[0]) + inside(0)) as usize]
    }
}

struct Random(u32);

impl Random {
    fn next(&mut self) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        self.0
    }

    fn below(&mut self, limit: u32) -> u32 {
        self.next() % limit
    }
}

fn material(image: Option<u32>, wrap: Wrap) -> Material {
    Material { image, factor: [1.0; 4], wrap: [wrap; 2] }
}

/// Colours by the crate, with a budget of so many bytes.
fn averaged(
    memory: u64,
    images: &[Vec<u8>],
    materials: &[Material],
    triangles: &[TexturedTriangle],
    count: usize,
) -> Result<Vec<[u8; 4]>, TextureError> {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::create(folder.path(), memory).unwrap();
    let mut averager = Averager::new(&store)?;
    triangles.iter().try_for_each(|triangle| averager.push(triangle))?;
    let mut open = |image: u32| -> io::Result<OpenedImage> {
        let bytes = images.get(image as usize).ok_or(io::ErrorKind::NotFound)?.clone();
        Ok(OpenedImage { bytes: Box::new(Cursor::new(bytes)), alpha: Alpha::Kept })
    };
    let open: &mut OpenImage<'_> = &mut open;
    let colors = averager.finish(materials, &mut Images::Files(open), count, &Cancel::default())?;
    assert_eq!(colors.len(), count);
    Ok(colors.read(0..count, &mut Vec::new())?.to_vec())
}

fn light(value: f64) -> f64 {
    let value = value / 255.0;
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

fn value(light: f64) -> f64 {
    255.0 * if light <= 0.0031308 { light * 12.92 } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}

/// Colours by going over all texels of a triangle's box; no numbers for a vertex that has hardly a texel.
fn brute(
    pictures: &[Picture],
    materials: &[Material],
    triangles: &[TexturedTriangle],
    count: usize,
) -> Vec<[f64; 4]> {
    let (mut near, mut third) = (vec![[0.0; 5]; count], vec![[0.0; 5]; count]);
    for triangle in triangles {
        let material = materials[triangle.material as usize];
        let picture = &pictures[material.image.unwrap() as usize];
        let [width, height] = picture.size.map(f64::from);
        // Corners are rounded to parts of a texel.
        let place = |value: f64, side: f64| (value * side * 256.0).round() / 256.0;
        let p = triangle.uv.map(|[u, v]| [place(u.into(), width), place(1.0 - f64::from(v), height)]);
        let cross = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| {
            (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        };
        let area = cross(p[0], p[1], p[2]);
        let range = |axis: usize| {
            let [a, b, c] = p.map(|corner| corner[axis]);
            a.min(b).min(c).floor() as i64..a.max(b).max(c).ceil() as i64 + 1
        };
        for y in range(1) {
            for x in range(0) {
                let at = [x as f64 + 0.5, y as f64 + 0.5];
                let parts = [0, 1, 2].map(|i| cross(at, p[(i + 1) % 3], p[(i + 2) % 3]) / area);
                if parts.iter().any(|part| *part < 0.0) {
                    continue;
                }
                let [r, g, b, a] = picture.at([x, y], material.wrap).map(f64::from);
                for (vertex, part) in triangle.vertices.into_iter().zip(parts) {
                    for (sums, part) in [(&mut near, part), (&mut third, 1.0 / 3.0)] {
                        let shown = part * (a + 1.0);
                        let add = [light(r) * shown, light(g) * shown, light(b) * shown, shown, part];
                        sums[vertex as usize].iter_mut().zip(add).for_each(|(sum, add)| *sum += add);
                    }
                }
            }
        }
    }
    let color = |(near, third): ([f64; 5], [f64; 5])| {
        let sharp = [0, 1, 2, 3, 4].map(|i| 2.0 * near[i] - third[i]);
        let is_left = sharp[3] >= near[3] / 4.0 && sharp[4] >= near[4] / 4.0;
        let [r, g, b, shown, weight] = if is_left { sharp } else { near };
        let is_close = (sharp[4] - near[4] / 4.0).abs() < 0.01 * near[4];
        if near[4] < 0.1 || is_close {
            return [f64::NAN; 4];
        }
        let [r, g, b] = [r, g, b].map(|part| value((part / shown).clamp(0.0, 1.0)));
        [r, g, b, (shown / weight - 1.0).clamp(0.0, 255.0)]
    };
    near.into_iter().zip(third).map(color).collect()
}

/// Triangles with corners that the grid of an image has exactly.
fn random_triangles(
    random: &mut Random,
    count: usize,
    side: u32,
    from: f32,
    to: f32,
) -> Vec<TexturedTriangle> {
    let mut corner = || {
        let mut place = || from + (to - from) * random.below(side * 16 + 1) as f32 / (side * 16) as f32;
        [place(), place()]
    };
    (0..count as u32)
        .map(|i| TexturedTriangle {
            vertices: [3 * i, 3 * i + 1, 3 * i + 2],
            uv: [corner(), corner(), corner()],
            material: 0,
        })
        .collect()
}

/// Both agree, but for the little that is added for corners without texels.
fn check(found: &[[u8; 4]], expected: &[[f64; 4]], most: f64) {
    for (vertex, (found, expected)) in found.iter().zip(expected).enumerate() {
        if expected.iter().all(|part| part.is_finite()) {
            let off = (0..4).map(|i| (f64::from(found[i]) - expected[i]).abs()).fold(0.0, f64::max);
            assert!(off <= most, "{vertex}: {found:?} {expected:?}");
        }
    }
}

#[test]
fn averages_are_sums_over_texels_in_any_budget_and_order() {
    let mut random = Random(7);
    for (side, from, to, wrap) in [
        (64, 0.0, 1.0, Wrap::Clamp),
        (64, 0.0, 1.0, Wrap::Repeat),
        (256, 0.0, 1.0, Wrap::Repeat),
        (32, -3.0, 5.0, Wrap::Repeat),
        (32, -3.0, 5.0, Wrap::Mirror),
        (32, 1.0, 2.0, Wrap::Mirror),
    ] {
        let pictures = [Picture::noise([side, side], side)];
        let images = [pictures[0].png()];
        let materials = [material(Some(0), wrap)];
        let mut triangles = random_triangles(&mut random, 60, side, from, to);
        let count = 3 * triangles.len();
        let expected = brute(&pictures, &materials, &triangles, count);

        let found = averaged(1 << 30, &images, &materials, &triangles, count).unwrap();
        check(&found, &expected, 1.0);
        for memory in [0, 1 << 20] {
            triangles.reverse();
            assert!(averaged(memory, &images, &materials, &triangles, count).unwrap() == found);
        }
    }
}

#[test]
fn shared_vertices_are_averaged_over_all_triangles() {
    let mut random = Random(3);
    let pictures = [Picture::noise([128, 128], 9), Picture::noise([64, 64], 5)];
    let images = [pictures[0].png(), pictures[1].png()];
    let materials = [material(Some(0), Wrap::Repeat), material(Some(1), Wrap::Repeat)];
    let mut triangles = random_triangles(&mut random, 400, 64, 0.0, 1.0);
    for triangle in &mut triangles {
        triangle.vertices = triangle.vertices.map(|_| random.below(50));
        triangle.material = random.below(2);
    }
    let expected = brute(&pictures, &materials, &triangles, 50);
    let found = averaged(0, &images, &materials, &triangles, 50).unwrap();
    check(&found, &expected, 1.0);
}

#[test]
fn any_size_of_image_is_read() {
    let mut random = Random(5);
    for size in [[1, 300], [300, 1], [37, 91], [5000, 3]] {
        let pictures = [Picture::smooth(size)];
        let materials = [material(Some(0), Wrap::Repeat)];
        let triangles = random_triangles(&mut random, 20, 64, 0.0, 1.0);
        let expected = brute(&pictures, &materials, &triangles, 60);
        let found = averaged(1 << 30, &[pictures[0].png()], &materials, &triangles, 60).unwrap();
        check(&found, &expected, 1.0);
    }
    let one = [Picture::new([1, 1], |_, _| [10, 20, 30, 255])];
    let triangles = random_triangles(&mut random, 20, 64, -1.0, 1.0);
    let found = averaged(0, &[one[0].png()], &[material(Some(0), Wrap::Repeat)], &triangles, 60).unwrap();
    assert!(found.iter().all(|color| *color == [10, 20, 30, 255]), "{found:?}");
}

#[test]
fn a_thousand_repeats_are_the_mean() {
    let picture =
        Picture::new([64, 64], |x, y| if (x / 8 + y / 8) % 2 == 0 { [255; 4] } else { [0, 0, 0, 255] });
    let uv = [[0.0, 0.0], [1000.0, 0.0], [0.0, 1000.0]];
    let triangle = TexturedTriangle { vertices: [0, 1, 2], uv, material: 0 };
    let images = [picture.png()];
    for wrap in [Wrap::Repeat, Wrap::Mirror] {
        let found = averaged(0, &images, &[material(Some(0), wrap)], &[triangle], 3).unwrap();
        assert!(found.iter().all(|[r, _, _, a]| r.abs_diff(188) <= 3 && *a == 255), "{found:?}");
    }
}

#[test]
fn coordinates_that_say_nothing_leave_the_factor() {
    let images = [Picture::new([8, 8], |_, _| [0, 255, 0, 255]).png()];
    let red = Material { factor: [1.0, 0.0, 0.0, 1.0], ..material(Some(0), Wrap::Repeat) };
    let plain = Material { factor: [0.502, 0.25, 1.0, 0.502], ..material(None, Wrap::Repeat) };
    let uv = |bad: f32| [[0.0, 0.0], [bad, 0.0], [0.0, 1.0]];
    let flat = [[0.5, 0.5]; 3];
    let line = [[0.0, 0.0], [0.5, 0.5], [1.0, 1.0]];
    let triangle = |at: u32, uv, material| TexturedTriangle { vertices: [at, at + 1, at + 2], uv, material };
    let triangles = [
        triangle(0, uv(f32::NAN), 0),
        triangle(3, uv(f32::INFINITY), 0),
        triangle(6, uv(0.0), 1),
        triangle(9, flat, 2),
        triangle(12, line, 2),
        triangle(15, uv(1.0), TexturedTriangle::NO_MATERIAL),
        triangle(18, uv(f32::MAX), 2),
    ];
    let materials = [red, plain, material(Some(0), Wrap::Repeat)];
    let found = averaged(0, &images, &materials, &triangles, 22).unwrap();
    let (red, green, white) = ([255, 0, 0, 255], [0, 255, 0, 255], [255; 4]);
    let colors = [red, red, [128, 64, 255, 128], green, green, white, green];
    let expected: Vec<[u8; 4]> = colors.iter().flat_map(|color| [*color; 3]).chain([white]).collect();
    assert_eq!(found, expected);
}

#[test]
fn a_factor_dims_texels() {
    let images = [Picture::new([8, 8], |_, _| [255, 188, 255, 255]).png()];
    let dim = Material { factor: [0.502, 1.0, 0.0, 0.25], ..material(Some(0), Wrap::Repeat) };
    let triangle =
        TexturedTriangle { vertices: [0, 1, 2], uv: [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], material: 0 };
    let found = averaged(0, &images, &[dim], &[triangle], 3).unwrap();
    assert_eq!(found, [[128, 188, 0, 64]; 3]);
}

#[test]
fn the_background_of_an_atlas_does_not_bleed() {
    // Of the image 90 % are magenta; charts of grey begin and end in the middles of texels' borders.
    let chart = |x: u32, y: u32| x % 64 < 20 && y % 64 < 20;
    let picture =
        Picture::new([512, 512], |x, y| if chart(x, y) { [90, 90, 90, 255] } else { [255, 0, 255, 255] });
    let mut triangles = Vec::new();
    for i in 0..64u32 {
        let (x, y) = ((i % 8) as f32 / 8.0, 1.0 - (i / 8) as f32 / 8.0);
        let side = 20.0 / 512.0;
        let uv = [[x, y], [x + side, y], [x + side, y - side], [x, y - side]];
        let corners = [4 * i, 4 * i + 1, 4 * i + 2, 4 * i + 3];
        for [a, b, c] in [[0, 1, 2], [2, 3, 0]] {
            let vertices = [corners[a], corners[b], corners[c]];
            triangles.push(TexturedTriangle { vertices, uv: [uv[a], uv[b], uv[c]], material: 0 });
        }
    }
    let found = averaged(0, &[picture.png()], &[material(Some(0), Wrap::Repeat)], &triangles, 256).unwrap();
    assert!(found.iter().all(|color| *color == [90, 90, 90, 255]));
}

#[test]
fn few_triangles_may_cover_a_large_image() {
    let pictures = [Picture::noise([1024, 1024], 1)];
    let materials = [material(Some(0), Wrap::Repeat)];
    let triangles = random_triangles(&mut Random(2), 12, 64, 0.0, 1.0);
    let expected = brute(&pictures, &materials, &triangles, 36);
    let found = averaged(0, &[pictures[0].png()], &materials, &triangles, 36).unwrap();
    check(&found, &expected, 1.0);
}

#[test]
fn each_texel_may_have_many_triangles() {
    // Triangles smaller than a texel take the one that they are in.
    let picture = Picture::noise([16, 16], 4);
    let mut triangles = Vec::new();
    for i in 0..16 * 16u32 {
        let (x, y) = ((i % 16) as f32 + 0.25, (i / 16) as f32 + 0.25);
        let uv = [[x, y], [x + 0.1, y], [x, y + 0.1]].map(|[x, y]| [x / 16.0, 1.0 - y / 16.0]);
        triangles.push(TexturedTriangle { vertices: [i; 3], uv, material: 0 });
    }
    let found = averaged(0, &[picture.png()], &[material(Some(0), Wrap::Repeat)], &triangles, 256).unwrap();
    assert!(found == picture.pixels);
}

#[test]
fn what_cannot_be_read_is_told() {
    let whole = Picture::noise([64, 64], 8).png();
    let uv = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
    let triangle = TexturedTriangle { vertices: [0, 1, 2], uv, material: 0 };
    let materials = [material(Some(1), Wrap::Repeat)];
    let failed = |images: &[Vec<u8>], count| averaged(0, images, &materials, &[triangle], count).unwrap_err();
    let images = [Vec::new(), whole.clone()];
    assert!(matches!(failed(&images[..1], 3), TextureError::Open { image: 1, .. }));
    assert!(matches!(failed(&images, 2), TextureError::VertexOutOfRange { vertex: 2, count: 2 }));
    for len in [0, 20, whole.len() / 2] {
        let error = failed(&[Vec::new(), whole[..len].to_vec()], 3);
        assert!(matches!(error, TextureError::Image { image: 1, .. }), "{len}: {error}");
    }
}

#[test]
fn a_request_to_stop_is_heard() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::create(folder.path(), 0).unwrap();
    let mut averager = Averager::new(&store).unwrap();
    let triangle = TexturedTriangle { vertices: [0; 3], uv: [[0.0; 2]; 3], material: 0 };
    averager.push(&triangle).unwrap();
    let cancel = Cancel::default();
    cancel.cancel();
    let mut open = |_: u32| -> io::Result<OpenedImage> { Err(io::ErrorKind::NotFound.into()) };
    let ended =
        averager.finish(&[material(Some(0), Wrap::Repeat)], &mut Images::Files(&mut open), 1, &cancel);
    assert!(matches!(ended, Err(TextureError::Cancelled(_))));
}
