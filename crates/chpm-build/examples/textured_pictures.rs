//! `textured_pictures SIDE FOLDER MESH...`: pictures of meshes from six sides, `SIDE` pixels, and how near those of all others are to those of the first.
//! `FILE.chpm@LEVEL` is a level of a file at its finest, `FILE.chpm@LEVEL-base` at its coarsest, with sheets; `colors:` in front takes colours of vertices.
//! `FILE.chpm@LEVEL-half` is the level at its coarsest on one side of the middle and two levels below on the other, as far as groups allow: then how far pixels within
//! three of borders of clusters that are two levels apart are from the first mesh, beside all others.
//! A rasteriser of its own: it shares the readers with what it judges, and no more.

use chpm_extmem::{Cancel, FailPoints, MappedFile, MemoryBudget, Store};
use chpm_format::Chpm;
use chpm_image::{ImageRows, encode};
use chpm_import::ply::{BatchKind, Options};
use chpm_import::{Images, Input, Supply};
use chpm_mesh::{ClusterId, GroupId, Places};
use chpm_texture::{Material, TexturedTriangle, Wrap};
use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::io::Cursor;
use std::path::Path;

/// Samples of a pixel, each way.
const FINE: usize = 3;

#[derive(Default)]
struct Mesh {
    positions: Vec<[f64; 3]>,
    colors: Vec<[u8; 4]>,
    triangles: Vec<[u32; 3]>,
    textured: Vec<TexturedTriangle>,
    materials: Vec<Material>,
    images: Vec<(Vec<[u8; 4]>, [usize; 2])>,
    /// By textured triangle, its cluster and that one's level.
    clusters: Vec<(u32, u32)>,
}

/// Colours, what is seen, and which triangle.
type Picture = (Vec<[f64; 3]>, Vec<bool>, Vec<u32>);

fn read(path: &Path) -> Result<Mesh, Box<dyn Error>> {
    let folder = std::env::temp_dir();
    let cancel = Cancel::default();
    let store = Store::with_budget(&folder, MemoryBudget::new(4 << 30))?;
    let supply = Supply::take(path, &folder, &FailPoints::default(), &cancel)?;
    let options = Options { colors: true, images: Images::Grey, ..Options::default() };
    let mut input = Input::of(&supply, options, &store, &cancel)?;
    let mut mesh = Mesh::default();
    let mut batch = Default::default();
    while input.next_batch(&mut batch)? != BatchKind::End {
        mesh.positions.extend(batch.vertices.positions.iter().map(|p| p.map(f64::from)));
        mesh.positions.extend(&batch.positions_f64);
        mesh.colors.extend(&batch.vertices.colors);
        mesh.triangles.extend(&batch.triangles);
        mesh.textured.extend(&batch.textured);
    }
    mesh.textured.extend(&batch.textured);
    if let Some(textures) = input.finish()?.textures {
        for image in &textures.images {
            let opened = image.open()?;
            let mut rows = ImageRows::open(opened.bytes, u64::MAX)?.with_alpha(opened.alpha);
            let mut pixels = Vec::new();
            let size = rows.size().map(|side| side as usize);
            rows.read_rows(size[1], &mut pixels)?;
            mesh.images.push((pixels, size));
        }
        mesh.materials = textures.materials;
    }
    Ok(mesh)
}

/// Clusters of a legal cut: a level on one side of the middle, two levels below on the other.
fn halves(file: &Chpm<MappedFile>, level: u32) -> Vec<ClusterId> {
    let header = file.header();
    let middle = (header.aabb().min[0] + header.aabb().max[0]) / 2.0;
    let mut is_there = vec![false; file.clusters().len()];
    file.roots().for_each(|root| is_there[root.index()] = true);
    loop {
        let split = (0..file.groups().len() as u32).map(GroupId).find(|group| {
            let coarse = file.coarse(*group);
            let of_group = || coarse.iter().map(|id| &file.clusters()[*id as usize]);
            let goal = if of_group().any(|record| record.center[0] < middle) {
                level.saturating_sub(2)
            } else {
                level
            };
            coarse.iter().all(|id| is_there[*id as usize])
                && !file.fine(*group).is_empty()
                && of_group().all(|record| record.level > goal)
        });
        let Some(split) = split else { break };
        file.coarse(split).iter().for_each(|id| is_there[*id as usize] = false);
        file.fine(split).iter().for_each(|id| is_there[*id as usize] = true);
    }
    (0..).map(ClusterId).zip(is_there).filter(|(_, is_there)| *is_there).map(|(id, _)| id).collect()
}

/// Clusters of a level, with their sheets or with colours of vertices.
fn read_level(path: &str, level: &str, with_sheets: bool) -> Result<Mesh, Box<dyn Error>> {
    let file = Chpm::open(MappedFile::open(path.as_ref())?)?;
    let (level, kind) = level.split_once('-').unwrap_or((level, ""));
    let (level, is_base): (u32, bool) = (level.parse()?, !kind.is_empty());
    let mut mesh = Mesh::default();
    let origin = file.header().origin;
    let ids = match kind {
        "half" => halves(&file, level),
        _ => (0..)
            .map(ClusterId)
            .zip(file.clusters())
            .filter(|(_, record)| record.level == level)
            .map(|(id, _)| id)
            .collect(),
    };
    for id in ids {
        let record = &file.clusters()[id.index()];
        let page = file.page(id)?;
        let page = page.view();
        let first = mesh.positions.len() as u32;
        let wide = |p: &[f32; 3]| std::array::from_fn(|i| f64::from(p[i]) + origin[i]);
        mesh.positions.extend(page.positions.iter().map(wide));
        mesh.colors.extend(page.colors);
        let mut places = Places::default();
        let at = if is_base { record.base_vertex_count } else { record.vertex_count };
        places.go_to(&page.progressive_mesh(), at as usize);
        let sheet = file.sheet(id)?.filter(|_| with_sheets);
        for (number, corners) in page.triangles.iter().enumerate() {
            let corners = corners.map(|corner| places.of(corner));
            if !chpm_mesh::pm::is_alive(&corners) {
                continue;
            }
            let vertices = corners.map(|corner| first + u32::from(corner));
            mesh.triangles.push(vertices);
            if let Some(sheet) = &sheet {
                let chart = &sheet.layout.charts[usize::from(sheet.layout.chart_of[number])];
                let uv = corners.map(|corner| {
                    let [x, y] = chart.place(sheet.layout.origin, page.positions[usize::from(corner)]);
                    let [width, height] = sheet.record.size.map(f64::from);
                    [(x / width) as f32, (1.0 - y / height) as f32]
                });
                mesh.textured.push(TexturedTriangle { vertices, uv, material: mesh.materials.len() as u32 });
                mesh.clusters.push((id.0, record.level));
            }
        }
        if let Some(sheet) = &sheet {
            let image = Some(mesh.images.len() as u32);
            mesh.materials.push(Material { image, factor: [1.0; 4], wrap: [Wrap::Clamp; 2] });
            let mut rows = ImageRows::open(Cursor::new(sheet.image.to_vec()), u64::MAX)?;
            let (size, mut pixels) = (rows.size().map(|side| side as usize), Vec::new());
            rows.read_rows(size[1], &mut pixels)?;
            mesh.images.push((pixels, size));
        }
    }
    Ok(mesh)
}

fn read_any(name: &str) -> Result<Mesh, Box<dyn Error>> {
    let (with_sheets, name) = name.strip_prefix("colors:").map_or((true, name), |name| (false, name));
    match name.split_once(".chpm@") {
        Some((path, level)) => read_level(&format!("{path}.chpm"), level, with_sheets),
        None => read(name.as_ref()),
    }
}

fn light(value: f64) -> f64 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

fn srgb(light: f64) -> f64 {
    if light <= 0.003_130_8 { light * 12.92 } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}

impl Mesh {
    /// Texels that triangles show, and bytes of their images as JPEG when blocks that show nothing are grey.
    fn used(&self) -> Result<(u64, usize), Box<dyn Error>> {
        let (mut texels, mut bytes) = (0, 0);
        for (number, (pixels, [width, height])) in (0..).zip(&self.images) {
            let (width, height) = (*width, *height);
            let mut is_shown = vec![false; width * height];
            for triangle in &self.textured {
                if self.materials[triangle.material as usize].image != Some(number) {
                    continue;
                }
                let side = [width as f64, height as f64];
                let [a, b, c] =
                    triangle.uv.map(|[u, v]| [f64::from(u) * side[0], (1.0 - f64::from(v)) * side[1]]);
                let cross = |p: [f64; 2], q: [f64; 2], r: [f64; 2]| {
                    (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
                };
                let turn = cross(a, b, c).signum();
                let range = |axis: usize| {
                    let all = [a, b, c].map(|p| p[axis].clamp(0.0, side[axis]));
                    all[0].min(all[1]).min(all[2]) as usize..all[0].max(all[1]).max(all[2]).ceil() as usize
                };
                for (y, x) in range(1).flat_map(|y| range(0).map(move |x| (y, x))) {
                    let p = [x as f64 + 0.5, y as f64 + 0.5];
                    is_shown[y * width + x] |=
                        [(a, b), (b, c), (c, a)].iter().all(|(q, r)| turn * cross(*q, *r, p) >= 0.0);
                }
            }
            texels += is_shown.iter().filter(|shown| **shown).count() as u64;
            let mut kept: Vec<[u8; 4]> = pixels.iter().map(|[r, g, b, _]| [*r, *g, *b, 255]).collect();
            for (y, x) in (0..height).step_by(16).flat_map(|y| (0..width).step_by(16).map(move |x| (y, x))) {
                let rows =
                    || (y..height.min(y + 16)).map(|row| row * width + x..row * width + width.min(x + 16));
                if !rows().any(|row| is_shown[row].contains(&true)) {
                    rows().for_each(|row| kept[row].fill([128, 128, 128, 255]));
                }
            }
            bytes += encode(&kept, [width as u16, height as u16])?.bytes.len();
        }
        Ok((texels, bytes))
    }

    /// Light of a texture at a place, bilinear.
    fn texel(&self, material: &Material, [u, v]: [f64; 2], table: &[f64; 256]) -> [f64; 3] {
        let Some(image) = material.image else {
            return [0, 1, 2].map(|i| light(f64::from(material.factor[i])));
        };
        let (pixels, size) = &self.images[image as usize];
        let at = [u * size[0] as f64 - 0.5, (1.0 - v) * size[1] as f64 - 0.5];
        let low = at.map(f64::floor);
        let mut sum = [0.0; 3];
        for (dy, dx) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let inside = |axis: usize, d: i64| {
                let (place, side) = (low[axis] as i64 + d, size[axis] as i64);
                match material.wrap[axis] {
                    Wrap::Clamp => place.clamp(0, side - 1),
                    _ => place.rem_euclid(side),
                }
            };
            let part = |axis: usize, d: i64| {
                if d == 0 { 1.0 - (at[axis] - low[axis]) } else { at[axis] - low[axis] }
            };
            let pixel = pixels[inside(1, dy) as usize * size[0] + inside(0, dx) as usize];
            (0..3).for_each(|i| sum[i] += part(0, dx) * part(1, dy) * table[usize::from(pixel[i])]);
        }
        let tint = [0, 1, 2].map(|i| light(f64::from(material.factor[i].clamp(0.0, 1.0))));
        [0, 1, 2].map(|i| sum[i] * tint[i])
    }

    /// A picture along an axis: colours, and whether anything is seen.
    fn picture(&self, view: usize, (low, high): ([f64; 3], [f64; 3]), side: usize) -> Picture {
        let table: [f64; 256] = std::array::from_fn(|value| light(value as f64 / 255.0));
        let (axis, sign) = (view / 2, if view.is_multiple_of(2) { 1.0 } else { -1.0 });
        let (right, down) = ((axis + 1) % 3, (axis + 2) % 3);
        let extent = (high[right] - low[right]).max(high[down] - low[down]);
        let fine = side * FINE;
        let scale = fine as f64 / extent;
        let flat = |p: [f64; 3]| {
            let x = (p[right] - low[right]) * scale;
            [if sign > 0.0 { x } else { fine as f64 - x }, (high[down] - p[down]) * scale, sign * p[axis]]
        };
        let mut depth = vec![f64::NEG_INFINITY; fine * fine];
        let mut lights = vec![[0.0; 3]; fine * fine];
        let mut which = vec![u32::MAX; fine * fine];
        let mut draw = |number: u32, corners: [u32; 3], shade: &dyn Fn([f64; 3]) -> [f64; 3]| {
            let [a, b, c] = corners.map(|v| flat(self.positions[v as usize]));
            let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            if area == 0.0 {
                return;
            }
            let range = |i: usize| {
                let (low, high) = (a[i].min(b[i]).min(c[i]), a[i].max(b[i]).max(c[i]));
                (low.max(0.0) as usize, (high.ceil().max(0.0) as usize).min(fine))
            };
            let ((x0, x1), (y0, y1)) = (range(0), range(1));
            for (y, x) in (y0..y1).flat_map(|y| (x0..x1).map(move |x| (y, x))) {
                let p = [x as f64 + 0.5, y as f64 + 0.5];
                let part = |p: [f64; 2], q: [f64; 3], r: [f64; 3]| {
                    ((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])) / area
                };
                let parts = [part(p, b, c), part(p, c, a), part(p, a, b)];
                if parts.iter().any(|part| *part < 0.0) {
                    continue;
                }
                let z = parts[0] * a[2] + parts[1] * b[2] + parts[2] * c[2];
                if z > depth[y * fine + x] {
                    depth[y * fine + x] = z;
                    lights[y * fine + x] = shade(parts);
                    which[y * fine + x] = number;
                }
            }
        };
        for (number, triangle) in (0..).zip(&self.textured) {
            let Some(material) = self.materials.get(triangle.material as usize) else { continue };
            draw(number, triangle.vertices, &|parts| {
                let uv = [0, 1].map(|i| (0..3).map(|c| parts[c] * f64::from(triangle.uv[c][i])).sum());
                self.texel(material, uv, &table)
            });
        }
        if self.textured.is_empty() {
            for triangle in &self.triangles {
                let colors = triangle.map(|v| self.colors.get(v as usize).copied().unwrap_or([128; 4]));
                draw(u32::MAX, *triangle, &|parts| {
                    [0, 1, 2].map(|i| (0..3).map(|c| parts[c] * table[usize::from(colors[c][i])]).sum())
                });
            }
        }
        let (mut picture, mut seen, mut middle) = (Vec::new(), Vec::new(), Vec::new());
        for (y, x) in (0..side).flat_map(|y| (0..side).map(move |x| (y, x))) {
            let all: Vec<usize> =
                (0..FINE * FINE).map(|i| (y * FINE + i / FINE) * fine + x * FINE + i % FINE).collect();
            seen.push(all.iter().all(|at| depth[*at] > f64::NEG_INFINITY));
            middle.push(which[all[all.len() / 2]]);
            let sum = [0, 1, 2].map(|i| all.iter().map(|at| lights[*at][i]).sum::<f64>());
            picture.push(sum.map(|sum| srgb(sum / (FINE * FINE) as f64) * 255.0));
        }
        (picture, seen, middle)
    }

    /// Pixels within three of a border of clusters that are two levels apart or more.
    fn near_borders(&self, picture: &Picture, side: usize) -> Vec<bool> {
        let level = |x: usize, y: usize| self.clusters.get(picture.2[y * side + x] as usize).map(|of| of.1);
        let mut near = vec![false; side * side];
        for (y, x) in (0..side - 1).flat_map(|y| (0..side - 1).map(move |x| (y, x))) {
            let Some(own) = level(x, y) else { continue };
            let apart = [(x + 1, y), (x, y + 1)]
                .iter()
                .any(|(x, y)| level(*x, *y).is_some_and(|l| l.abs_diff(own) > 1));
            if apart {
                for (y, x) in (y.saturating_sub(3)..side.min(y + 4))
                    .flat_map(|y| (x.saturating_sub(3)..side.min(x + 4)).map(move |x| (y, x)))
                {
                    near[y * side + x] = true;
                }
            }
        }
        near
    }
}

/// Squares of differences elsewhere and near borders: sums, and of how many pixels.
#[derive(Clone, Copy, Default)]
struct Borders {
    sums: [f64; 2],
    counts: [usize; 2],
}

impl Borders {
    fn add(&mut self, a: &Picture, b: &Picture, near: &[bool]) {
        for at in (0..near.len()).filter(|at| a.1[*at] && b.1[*at]) {
            let square = (0..3).map(|i| (a.0[at][i] - b.0[at][i]).powi(2)).sum::<f64>() / 3.0;
            self.sums[usize::from(near[at])] += square;
            self.counts[usize::from(near[at])] += 1;
        }
    }

    fn print(&self, what: &str) {
        let rms = |i: usize| (self.sums[i] / self.counts[i].max(1) as f64).sqrt();
        let (near, elsewhere, count) = (rms(1), rms(0), self.counts[1]);
        println!(
            "{what}: {near:.2} of 255 in {count} pixels near borders, {elsewhere:.2} elsewhere: {:.2}",
            near / elsewhere
        );
    }
}

/// PSNR over what both see, and the mean SSIM of squares of 8 pixels.
fn nearness(a: &Picture, b: &Picture, side: usize) -> Option<(f64, f64, f64)> {
    let both: Vec<bool> = a.1.iter().zip(&b.1).map(|(a, b)| *a && *b).collect();
    let count = both.iter().filter(|both| **both).count();
    let either = a.1.iter().zip(&b.1).filter(|(a, b)| **a || **b).count();
    let squares = (0..both.len())
        .filter(|at| both[*at])
        .map(|at| (0..3).map(|i| (a.0[at][i] - b.0[at][i]).powi(2)).sum::<f64>() / 3.0);
    let error = squares.sum::<f64>() / count.max(1) as f64;
    let gray = |picture: &[[f64; 3]], at: usize| {
        0.299 * picture[at][0] + 0.587 * picture[at][1] + 0.114 * picture[at][2]
    };
    let (mut sum, mut windows) = (0.0, 0);
    for (y, x) in (0..side - 7).step_by(4).flat_map(|y| (0..side - 7).step_by(4).map(move |x| (y, x))) {
        let all: Vec<usize> = (0..64).map(|i| (y + i / 8) * side + x + i % 8).collect();
        if !all.iter().all(|at| both[*at]) {
            continue;
        }
        let mean = |f: &dyn Fn(usize) -> f64| all.iter().map(|at| f(*at)).sum::<f64>() / 64.0;
        let (p, q) = (mean(&|at| gray(&a.0, at)), mean(&|at| gray(&b.0, at)));
        let (pp, qq) = (mean(&|at| (gray(&a.0, at) - p).powi(2)), mean(&|at| (gray(&b.0, at) - q).powi(2)));
        let pq = mean(&|at| (gray(&a.0, at) - p) * (gray(&b.0, at) - q));
        let (c1, c2) = ((0.01 * 255.0f64).powi(2), (0.03 * 255.0f64).powi(2));
        sum += (2.0 * p * q + c1) * (2.0 * pq + c2) / ((p * p + q * q + c1) * (pp + qq + c2));
        windows += 1;
    }
    (count > 0).then(|| {
        (
            10.0 * (255.0f64.powi(2) / error).log10(),
            sum / f64::from(windows.max(1)),
            count as f64 / either as f64,
        )
    })
}

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().collect();
    let [_, side, folder, first, others @ ..] = &words[..] else {
        return Err("textured_pictures SIDE FOLDER MESH...".into());
    };
    let (side, folder): (usize, &Path) = (side.parse()?, folder.as_ref());
    fs::create_dir_all(folder)?;
    let source = read_any(first)?;
    let mut bounds = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for corner in source.triangles.as_flattened() {
        let p = source.positions[*corner as usize];
        bounds =
            (std::array::from_fn(|i| bounds.0[i].min(p[i])), std::array::from_fn(|i| bounds.1[i].max(p[i])));
    }
    let mut meshes = vec![source];
    for other in others {
        meshes.push(read_any(other)?);
    }
    for (name, mesh) in words[3..].iter().zip(&meshes) {
        let (texels, bytes) = mesh.used()?;
        println!("{name}: {texels} texels shown, {bytes} bytes as JPEG");
    }
    let mut borders: BTreeMap<&String, Borders> = BTreeMap::new();
    for view in 0..6 {
        let mut pictures = Vec::new();
        for (number, mesh) in meshes.iter().enumerate() {
            let picture = mesh.picture(view, bounds, side);
            let pixels: Vec<[u8; 4]> =
                (picture.0.iter().zip(&picture.1))
                    .map(|([r, g, b], seen)| {
                        if *seen {
                            [*r, *g, *b, 255.0].map(|x| (x + 0.5) as u8)
                        } else {
                            [255, 255, 255, 254]
                        }
                    })
                    .collect();
            let image = encode(&pixels, [side as u16; 2])?;
            fs::write(folder.join(format!("view{view}-{number}.png")), image.bytes)?;
            pictures.push(picture);
        }
        for ((other, picture), mesh) in others.iter().zip(&pictures[1..]).zip(&meshes[1..]) {
            if other.ends_with("-half") {
                let (mut own, near) = (Borders::default(), mesh.near_borders(picture, side));
                own.add(&pictures[0], picture, &near);
                own.print(&format!("view {view} {other}"));
                let all = borders.entry(other).or_default();
                all.add(&pictures[0], picture, &near);
            }
            if let Some((psnr, ssim, share)) = nearness(&pictures[0], picture, side) {
                println!(
                    "view {view} {other}: PSNR {psnr:.2} dB, SSIM {ssim:.4}, {:.2} % in both",
                    100.0 * share
                );
            }
        }
    }
    borders.iter().for_each(|(other, borders)| borders.print(&format!("all views {other}")));
    Ok(())
}
