//! A cluster's meshes and charts, in memory.

use super::way::{Corners, Key, normal_of, point};
use crate::error::VerifyError;
use chpm_extmem::MappedFile;
use chpm_format::{Chpm, Page, SheetLayout};
use chpm_mesh::{ClusterId, Places, ProgressiveMesh, geom};
use nalgebra::{Point3, Vector3};

/// Texels of a side of the cells that triangles are found by.
const CELL: usize = 8;
/// Triangles of a cell, in the mean, beside those that only touch it.
const CROWD: usize = 4;
/// How far outside of a triangle a point may be by rounding, in parts of its height.
const OUTSIDE: f64 = 1e-5;

/// A cluster.
pub(super) struct Cluster {
    pub(super) positions: Vec<[f32; 3]>,
    pub(super) triangles: Vec<[u16; 3]>,
    base_vertex_count: usize,
    targets: Vec<u16>,
    /// By vertex, where it is in the base mesh.
    base: Places,
    pub(super) base_error: f32,
    pub(super) min_error: f32,
    pub(super) layout: SheetLayout,
    /// By chart, the least cosine between its direction and a triangle of the finest mesh.
    cosines: Vec<f64>,
    /// Triangles by cells of the sheet: where each cell's begin, and all of them.
    columns: usize,
    first: Vec<u32>,
    in_cells: Vec<u32>,
}

/// The parts of a triangle's corners in a point of its plane; none of a triangle without area.
fn parts(places: [[f64; 2]; 3], at: [f64; 2]) -> Option<[f64; 3]> {
    let turned =
        |p: [f64; 2], q: [f64; 2], r: [f64; 2]| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    let [a, b, c] = places;
    let area = turned(a, b, c);
    let parts = [turned(at, b, c) / area, turned(a, at, c) / area, turned(a, b, at) / area];
    parts.iter().all(|part| part.is_finite()).then_some(parts)
}

/// The first and the last of so many cells that have one of three places.
fn extent(places: [f64; 3], cells: usize) -> (usize, usize) {
    let low = places.iter().copied().fold(f64::INFINITY, f64::min);
    let high = places.iter().copied().fold(0.0, f64::max);
    ((low.max(0.0) as usize).min(cells - 1), (high as usize).min(cells - 1))
}

/// From where to where a triangle is between two lines.
fn across(places: &[[f64; 2]; 3], [top, bottom]: [f64; 2]) -> Option<[f64; 2]> {
    let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
    for i in 0..3 {
        let [mut from, mut to] = [places[i], places[(i + 1) % 3]];
        if from[1] > to[1] {
            (from, to) = (to, from);
        }
        if to[1] < top || from[1] > bottom {
            continue;
        }
        let at = |y: f64| match to[1] - from[1] {
            height if height > 0.0 => from[0] + (to[0] - from[0]) * ((y - from[1]) / height).clamp(0.0, 1.0),
            _ => from[0],
        };
        for x in [at(top), at(bottom)] {
            (left, right) = (left.min(x), right.max(x));
        }
        if from[1] == to[1] {
            (left, right) = (left.min(to[0]), right.max(to[0]));
        }
    }
    (left <= right).then_some([left, right])
}

impl Cluster {
    pub(super) fn read(file: &Chpm<MappedFile>, id: u32) -> Result<Self, VerifyError> {
        let buffer = file.page(ClusterId(id))?;
        let page: Page<'_> = buffer.view();
        let Some(sheet) = file.sheet(ClusterId(id))? else {
            return Err(VerifyError::NoSheets { path: file.get_ref().path().to_owned() });
        };
        let mut base = Places::default();
        base.go_to(&page.progressive_mesh(), page.base_vertex_count);
        let mut cluster = Cluster {
            positions: page.positions.to_vec(),
            triangles: page.triangles.to_vec(),
            base_vertex_count: page.base_vertex_count,
            targets: page.targets.to_vec(),
            base,
            base_error: page.error_at(page.base_vertex_count),
            min_error: page.min_error,
            cosines: vec![1.0; sheet.layout.charts.len()],
            layout: sheet.layout,
            columns: usize::from(sheet.record.size[0]).div_ceil(CELL),
            first: Vec::new(),
            in_cells: Vec::new(),
        };
        cluster.find_cosines();
        match cluster.fill_cells(usize::from(sheet.record.size[1]).div_ceil(CELL)) {
            true => Ok(cluster),
            false => {
                let (image, reason) =
                    (format!("the sheet of cluster {id}"), "its triangles lie over each other");
                Err(VerifyError::Image { image, reason: reason.to_owned() })
            }
        }
    }

    fn find_cosines(&mut self) {
        let charts = self.layout.charts.len();
        let (mut normals, mut sums) =
            (Vec::with_capacity(self.triangles.len()), vec![Vector3::zeros(); charts]);
        for (corners, chart) in self.triangles.iter().zip(&self.layout.chart_of) {
            let normal = normal_of(self.corners(*corners));
            sums[usize::from(*chart)] += normal;
            normals.push(normal);
        }
        for (normal, chart) in normals.into_iter().zip(&self.layout.chart_of) {
            let chart = usize::from(*chart);
            let [x, y] = self.layout.charts[chart].axes.map(|axis| Vector3::from(axis.map(f64::from)));
            let direction = x.cross(&y);
            // Of the two sides of its plane, a chart is of the one that most of it faces.
            let side = direction.dot(&sums[chart]).signum();
            let cosine = side * normal.dot(&direction) / (normal.norm() * direction.norm());
            // What has no area faces nowhere.
            if cosine.is_finite() {
                self.cosines[chart] = self.cosines[chart].min(cosine);
            }
        }
    }

    /// Whether triangles are few enough in each cell, as those of charts are that do not lie over themselves.
    fn fill_cells(&mut self, rows: usize) -> bool {
        let columns = self.columns;
        let mut pairs = Vec::new();
        let most = CROWD * (rows * columns + rows.max(columns) * self.triangles.len());
        for (triangle, corners) in (0..).zip(&self.triangles) {
            let places = self.places(triangle, *corners).map(|place| place.map(|x| x / CELL as f64));
            let (top, bottom) = extent(places.map(|[_, y]| y), rows);
            for row in top..=bottom {
                let Some([left, right]) = across(&places, [row as f64, row as f64 + 1.0]) else { continue };
                let (left, right) = extent([left, right, right], columns);
                pairs.extend((left..=right).map(|column| (row * columns + column, triangle)));
            }
            if pairs.len() > most {
                return false;
            }
        }
        pairs.sort_unstable();
        self.first = vec![0; rows * columns + 1];
        pairs.iter().for_each(|(cell, _)| self.first[cell + 1] += 1);
        (1..self.first.len()).for_each(|at| self.first[at] += self.first[at - 1]);
        self.in_cells = pairs.into_iter().map(|(_, triangle)| triangle).collect();
        true
    }

    /// Its triangles and collapses.
    pub(super) fn mesh(&self) -> ProgressiveMesh<'_> {
        ProgressiveMesh {
            vertex_count: self.positions.len(),
            base_vertex_count: self.base_vertex_count,
            triangles: &self.triangles,
            targets: &self.targets,
        }
    }

    pub(super) fn corners(&self, corners: [u16; 3]) -> Corners {
        corners.map(|corner| geom::to_f64(self.positions[usize::from(corner)]))
    }

    /// Key of a triangle of the finest mesh.
    pub(super) fn key(&self, triangle: u32) -> Key {
        Key::of(self.triangles[triangle as usize].map(|corner| self.positions[usize::from(corner)]))
    }

    /// Corners of a triangle in the base mesh; none if it is not there.
    pub(super) fn in_base(&self, triangle: u32) -> Option<[u16; 3]> {
        let corners = self.triangles[triangle as usize].map(|corner| self.base.of(corner));
        chpm_mesh::pm::is_alive(&corners).then_some(corners)
    }

    /// Where corners of a triangle are in its sheet.
    fn places(&self, triangle: u32, corners: [u16; 3]) -> [[f64; 2]; 3] {
        let chart = &self.layout.charts[usize::from(self.layout.chart_of[triangle as usize])];
        corners.map(|corner| chart.place(self.layout.origin, self.positions[usize::from(corner)]))
    }

    /// Where a point of a triangle is in the sheet, which has these corners of the triangle now.
    pub(super) fn place(&self, triangle: u32, corners: [u16; 3], parts: [f64; 3]) -> [f64; 2] {
        let places = self.places(triangle, corners);
        [0, 1].map(|axis| (0..3).map(|i| parts[i] * places[i][axis]).sum())
    }

    /// The factor by which errors may be longer in the chart of a triangle, from 1 on; none if part of the chart is not seen.
    pub(super) fn factor(&self, triangle: u32) -> Option<f64> {
        let cosine = self.cosines[usize::from(self.layout.chart_of[triangle as usize])];
        (cosine > 0.0).then(|| 1.0 / cosine)
    }

    /// The triangle of the finest mesh that has a place in the chart of a triangle, and the point that is there; none if there is none, or if there are
    /// several whose points are farther apart than `slack`.
    pub(super) fn at(&self, of_chart: u32, at: [f64; 2], slack: f64) -> Option<(u32, Point3<f64>)> {
        let chart = self.layout.chart_of[of_chart as usize];
        let [column, row] = at.map(|x| (x.max(0.0) as usize) / CELL);
        let rows = (self.first.len() - 1) / self.columns;
        let cell = row.min(rows - 1) * self.columns + column.min(self.columns - 1);
        let in_cell = &self.in_cells[self.first[cell] as usize..self.first[cell + 1] as usize];
        let mut found: Option<(u32, Point3<f64>)> = None;
        for triangle in in_cell.iter().copied() {
            if self.layout.chart_of[triangle as usize] != chart {
                continue;
            }
            let corners = self.triangles[triangle as usize];
            let parts = parts(self.places(triangle, corners), at);
            let Some(parts) = parts.filter(|parts| parts.iter().all(|part| *part >= -OUTSIDE)) else {
                continue;
            };
            let point = point(self.corners(corners), parts);
            match found {
                Some((_, known)) if (known - point).norm() > slack => return None,
                Some(_) => {}
                None => found = Some((triangle, point)),
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_corners_are_where_a_point_is() {
        let places = [[0.0, 0.0], [4.0, 0.0], [0.0, 2.0]];
        assert_eq!(parts(places, [1.0, 0.5]), Some([0.5, 0.25, 0.25]));
        assert_eq!(parts(places, [0.0, 4.0]), Some([-1.0, 0.0, 2.0]));
        assert_eq!(parts([[0.0; 2], [1.0; 2], [2.0; 2]], [1.0, 0.5]), None);
    }

    #[test]
    fn triangles_are_found_between_lines() {
        let places = [[0.0, 0.0], [10.0, 5.0], [0.0, 10.0]];
        assert_eq!(across(&places, [0.0, 1.0]), Some([0.0, 2.0]));
        assert_eq!(across(&places, [4.0, 6.0]), Some([0.0, 10.0]));
        assert_eq!(across(&places, [11.0, 12.0]), None);
        assert_eq!(across(&[[3.0, 2.0], [7.0, 2.0], [5.0, 2.0]], [2.0, 3.0]), Some([3.0, 7.0]));
        assert_eq!(extent([-3.0, 2.5, 1.0], 9), (0, 2));
        assert_eq!(extent([f64::NAN, 200.0, 8.5], 9), (8, 8));
    }
}
