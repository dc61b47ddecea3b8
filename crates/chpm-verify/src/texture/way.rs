//! Ways of colours: from a sample through the charts of sheets to the source.

use super::cluster::Cluster;
use super::difference::Found;
use super::source::{Paint, Source, bilinear};
use crate::error::VerifyError;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_image::ImageRows;
use chpm_mesh::{ClusterId, Places, pm};
use chpm_refine::Member;
use nalgebra::{Point3, Vector3};
use std::collections::HashMap;
use std::io::Cursor;
use xxhash_rust::xxh3::xxh3_128;

/// Samples of a cluster, at least.
const LEAST: f64 = 4096.0;
/// Rounding of a place in a sheet, in parts of the largest coordinate.
const SLACK: f64 = 1e-5;

/// Where the corners of a triangle are.
pub(super) type Corners = [Point3<f64>; 3];

/// Hash of where a triangle's corners are, whichever it begins with.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(super) struct Key(u128);

impl Key {
    pub(super) fn of(corners: [[f32; 3]; 3]) -> Key {
        // Both zeros are one place.
        let bits = corners.map(|corner| corner.map(|x| (x + 0.0).to_bits()));
        let first = (0..3).min_by_key(|first| bits[*first]).unwrap_or(0);
        let turned: [_; 3] = std::array::from_fn(|i| bits[(first + i) % 3]);
        Key(xxh3_128(bytemuck::cast_slice(&turned)))
    }
}

/// All clusters of a file, and how triangles are found in those below.
pub(super) struct Ways {
    clusters: Vec<Cluster>,
    /// By group, where triangles of its coarse clusters are in the base meshes of its fine ones.
    below: Vec<HashMap<Key, (u32, u32)>>,
}

/// An image of a sheet, decoded.
struct Picture {
    pixels: Vec<[u8; 4]>,
    size: [usize; 2],
}

impl Picture {
    fn read(file: &Chpm<MappedFile>, id: ClusterId) -> Result<Self, VerifyError> {
        let failed =
            |reason: String| VerifyError::Image { image: format!("the sheet of cluster {}", id.0), reason };
        let image = file.sheet(id)?.map(|sheet| sheet.image.to_vec()).unwrap_or_default();
        let mut rows =
            ImageRows::open(Cursor::new(image), u64::MAX).map_err(|error| failed(error.to_string()))?;
        let size = rows.size();
        let mut pixels = Vec::new();
        rows.read_rows(size[1] as usize, &mut pixels).map_err(|error| failed(error.to_string()))?;
        Ok(Picture { pixels, size: size.map(|side| side as usize) })
    }

    fn at(&self, place: [f64; 2]) -> [f64; 3] {
        bilinear(place, |column, row| {
            let [x, y] =
                [(column, 0), (row, 1)].map(|(at, axis)| at.clamp(0, self.size[axis] as i64 - 1) as usize);
            self.pixels[y * self.size[0] + x]
        })
    }
}

impl Ways {
    pub(super) fn new(file: &Chpm<MappedFile>, clusters: Vec<Cluster>) -> Self {
        let groups = (0..file.groups().len() as u32).map(chpm_mesh::GroupId);
        let below = groups.map(|group| {
            let mut below = HashMap::new();
            for id in file.fine(group) {
                let cluster = &clusters[*id as usize];
                for triangle in 0..cluster.triangles.len() as u32 {
                    if let Some(corners) = cluster.in_base(triangle) {
                        let corners = corners.map(|corner| cluster.positions[usize::from(corner)]);
                        below.entry(Key::of(corners)).or_insert((*id, triangle));
                    }
                }
            }
            below
        });
        Ways { below: below.collect(), clusters }
    }

    /// Takes samples of a member of a cut.
    pub(super) fn sample(
        &self,
        file: &Chpm<MappedFile>,
        member: &Member,
        of_triangle: u32,
        source: &Source,
        paint: &mut Paint<'_>,
    ) -> Result<Found, VerifyError> {
        let id = member.cluster;
        let cluster = &self.clusters[id.index()];
        let picture = Picture::read(file, id)?;
        let error = file.page(id)?.view().error_at(member.vertices as usize);
        let mut places = Places::default();
        places.go_to(&cluster.mesh(), member.vertices as usize);
        let alive: Vec<(u32, [u16; 3], Vector3<f64>)> = (0..)
            .zip(&cluster.triangles)
            .map(|(triangle, corners)| (triangle, corners.map(|corner| places.of(corner))))
            .filter(|(_, corners)| pm::is_alive(corners))
            .map(|(triangle, corners)| (triangle, corners, normal_of(cluster.corners(corners))))
            .collect();

        let mut found = Found::of(alive.len());
        let all: f64 = alive.iter().map(|(.., normal)| normal.norm()).sum();
        let each = all / (f64::from(of_triangle) * alive.len() as f64).max(LEAST);
        let (mut due, mut number) = (0.5 * each, 0u64);
        for (triangle, corners, normal) in alive {
            due -= normal.norm();
            while due < 0.0 && each > 0.0 {
                due += each;
                number += 1;
                let parts = spread(number);
                let at = point(cluster.corners(corners), parts);
                let place = cluster.place(triangle, corners, parts);
                if let Some(color) = source.color_near(at, normal, paint)? {
                    found.add(picture.at(place), color);
                }
                let slack = SLACK * source.scale();
                found.add_way(self.follow(file, (id.0, triangle, place), error, at, slack), slack);
            }
        }
        Ok(found)
    }

    /// Follows a sample of a triangle of a cluster, which is at a place in its sheet: how far it is from where its colour is in the source, and how far that may be.
    fn follow(
        &self,
        file: &Chpm<MappedFile>,
        (mut id, mut triangle, mut place): (u32, u32, [f64; 2]),
        mut error: f32,
        sample: Point3<f64>,
        slack: f64,
    ) -> Option<(f64, f64)> {
        let mut bound = 0.0;
        loop {
            let cluster = &self.clusters[id as usize];
            let (finest, point) = cluster.at(triangle, place, slack)?;
            bound += (1.0 + cluster.factor(triangle)?) * (f64::from(error) + f64::from(cluster.min_error));
            let record = &file.clusters()[id as usize];
            if record.is_leaf() {
                return Some(((point - sample).norm(), bound));
            }
            // Triangles of a finest mesh are those of the base meshes below (I4), which may begin with another corner.
            let (child, of_child) = *self.below[record.group().index()].get(&cluster.key(finest))?;
            let below = &self.clusters[child as usize];
            let corners = below.in_base(of_child)?;
            place = below.place(of_child, corners, parts_of(below.corners(corners), point)?);
            (id, triangle, error) = (child, of_child, below.base_error);
        }
    }
}

/// Twice as long as the triangle has area.
pub(super) fn normal_of([a, b, c]: Corners) -> Vector3<f64> {
    (b - a).cross(&(c - a))
}

pub(super) fn point([a, b, c]: Corners, [first, second, third]: [f64; 3]) -> Point3<f64> {
    (a.coords * first + b.coords * second + c.coords * third).into()
}

/// The parts of a triangle's corners in a point of it; none of a triangle without area.
pub(super) fn parts_of([a, b, c]: Corners, at: Point3<f64>) -> Option<[f64; 3]> {
    let (u, v, w) = (b - a, c - a, at - a);
    let (uu, uv, vv, wu, wv) = (u.dot(&u), u.dot(&v), v.dot(&v), w.dot(&u), w.dot(&v));
    let area = uu * vv - uv * uv;
    let [second, third] = [(vv * wu - uv * wv) / area, (uu * wv - uv * wu) / area];
    (second.is_finite() && third.is_finite()).then_some([1.0 - second - third, second, third])
}

/// Points of a triangle that fill it evenly, one after the other (Roberts' sequence for two numbers, folded).
fn spread(number: u64) -> [f64; 3] {
    let [x, y] =
        [0.754_877_666_246_692_7, 0.569_840_290_998_053_2].map(|step| (0.5 + number as f64 * step).fract());
    let [x, y] = if x + y > 1.0 { [1.0 - x, 1.0 - y] } else { [x, y] };
    [1.0 - x - y, x, y]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_do_not_depend_on_the_first_corner() {
        let [a, b, c] = [[0.5, -0.0, 2.0], [0.5, 0.0, 3.0], [-1.0, 7.0, 3.0]];
        assert_eq!(Key::of([a, b, c]), Key::of([c, a, b]));
        assert_eq!(Key::of([a, b, c]), Key::of([b, c, [0.5, 0.0, 2.0]]));
        assert_ne!(Key::of([a, b, c]), Key::of([a, c, b]));
    }

    #[test]
    fn parts_come_back_and_fill_the_triangle() {
        let corners = [[1.0, 2.0, 3.0], [4.0, 0.0, 3.0], [1.0, 5.0, -2.0]].map(Point3::from);
        let mut sums = [0.0; 3];
        for number in 0..3000 {
            let parts = spread(number);
            assert!(parts.iter().all(|part| (-1e-12..=1.0).contains(part)));
            let back = parts_of(corners, point(corners, parts)).unwrap();
            assert!(parts.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-12));
            sums = std::array::from_fn(|i| sums[i] + parts[i]);
        }
        assert!(sums.iter().all(|sum| (sum / 3000.0 - 1.0 / 3.0).abs() < 0.002), "{sums:?}");
        assert_eq!(parts_of([Point3::origin(); 3], [1.0; 3].into()), None);
    }
}
