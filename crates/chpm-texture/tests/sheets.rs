//! Plans of sheets and what is baked, on generated surfaces: by what they have to keep, whatever charts there are.

use chpm_mesh::{Chart, ProgressiveMesh};
use chpm_texture::sheet::{Paint, Pixels, Plan, Region, Surface, Texel};
use chpm_texture::{TextureError, linear_texel};

/// No image is ever read.
struct Nothing;

impl Pixels for Nothing {
    fn region<'a>(
        &'a mut self,
        _: u32,
        _: i64,
        _: i64,
        _: &'a mut Region,
    ) -> Result<[&'a [Texel; 4]; 4], TextureError> {
        panic!("there is no image");
    }
}

#[derive(Default)]
struct Mesh {
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u16; 3]>,
    targets: Vec<u16>,
    texel: f64,
}

impl Mesh {
    /// A grid of squares, of which a place in space is known by its parameters.
    fn grid(columns: usize, rows: usize, texel: f64, place: impl Fn(f64, f64) -> [f64; 3]) -> Mesh {
        let mut mesh = Mesh { texel, ..Mesh::default() };
        for (row, column) in (0..=rows).flat_map(|row| (0..=columns).map(move |column| (row, column))) {
            let at = place(column as f64 / columns as f64, row as f64 / rows as f64);
            mesh.positions.push(at.map(|x| x as f32));
        }
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
            let [a, b] = [row, row + 1].map(|row| (row * (columns + 1) + column) as u16);
            mesh.triangles.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
        }
        mesh
    }

    fn plan(&self) -> Plan {
        let texels = vec![self.texel; self.triangles.len()];
        Plan::new(&self.surface(&texels)).expect("a plan")
    }

    fn surface<'a>(&'a self, texels: &'a [f64]) -> Surface<'a> {
        Surface {
            positions: &self.positions,
            triangles: &self.triangles,
            base_vertex_count: self.positions.len() - self.targets.len(),
            targets: &self.targets,
            texels,
            least_texel: 0.0,
        }
    }

    fn progressive(&self) -> ProgressiveMesh<'_> {
        ProgressiveMesh {
            vertex_count: self.positions.len(),
            base_vertex_count: self.positions.len() - self.targets.len(),
            triangles: &self.triangles,
            targets: &self.targets,
        }
    }

    fn places(&self, plan: &Plan, chart: &Chart, corners: [u16; 3]) -> [[f64; 2]; 3] {
        corners.map(|corner| chart.place(plan.origin, self.positions[usize::from(corner)]))
    }

    /// Every state of every triangle is in its chart, rectangles are apart, and middles of texels are in one triangle of a chart at most.
    fn check(&self, plan: &Plan) {
        assert_eq!(plan.chart_of.len(), self.triangles.len());
        for (corners, chart) in self.triangles.iter().zip(&plan.chart_of) {
            let chart = &plan.charts[usize::from(*chart)];
            for state in self.progressive().states(*corners) {
                assert!(
                    self.places(plan, chart, state).into_iter().all(|place| chart.holds(place)),
                    "{corners:?}"
                );
            }
        }
        let [width, height] = plan.size.map(|side| side as usize);
        assert!(width.is_multiple_of(16) && height.is_multiple_of(16) && width.max(height) <= 8192);
        let mut taken = vec![false; width * height];
        for chart in &plan.charts {
            let [x, y, w, h] = chart.rect.map(usize::from);
            for at in (y..y + h).flat_map(|row| (x..x + w).map(move |column| row * width + column)) {
                assert!(!std::mem::replace(&mut taken[at], true), "rectangles meet");
            }
        }
        let mut covered = vec![0u8; width * height];
        for (corners, chart) in self.triangles.iter().zip(&plan.chart_of) {
            let places = self.places(plan, &plan.charts[usize::from(*chart)], *corners);
            for (row, column) in inside(places) {
                covered[row * width + column] += 1;
            }
        }
        assert!(covered.iter().all(|count| *count <= 1), "a texel of two triangles");
    }

    /// Bakes colours that follow positions, and compares them with where middles of texels are on triangles.
    fn check_colors(&self, plan: &Plan) {
        let color = |p: [f32; 3]| {
            let part = |x: f32| (40.0 + 160.0 * x.clamp(0.0, 1.0)).round() as u8;
            [part(p[0]), part(p[1]), part(p[2]), 255]
        };
        let paint =
            |corners: &[u16; 3]| Paint::Colors(corners.map(|c| color(self.positions[usize::from(c)])));
        let paints: Vec<Paint> = self.triangles.iter().map(paint).collect();
        let texels = vec![self.texel; self.triangles.len()];
        let baked = plan.bake(&self.surface(&texels), &paints, &mut Nothing).expect("texels");
        let width = plan.size[0] as usize;
        let mut seen = 0;
        for (corners, chart) in self.triangles.iter().zip(&plan.chart_of) {
            let places = self.places(plan, &plan.charts[usize::from(*chart)], *corners);
            for (row, column) in inside(places) {
                let parts = parts(places, [column as f64 + 0.5, row as f64 + 0.5]);
                let colors = corners.map(|c| color(self.positions[usize::from(c)]));
                let found = baked[row * width + column];
                for i in 0..4 {
                    let expected: f64 = (0..3).map(|c| parts[c] * f64::from(colors[c][i])).sum();
                    assert!((f64::from(found[i]) - expected).abs() < 1.5, "{found:?}, not {expected} at {i}");
                }
                seen += 1;
            }
        }
        assert!(seen > 100, "{seen} texels");
        // The gutter goes on with the colours beside it: none is what an empty sheet had.
        assert!(baked.iter().all(|texel| texel[3] == 255 && texel[0] >= 38));
    }
}

fn parts([a, b, c]: [[f64; 2]; 3], p: [f64; 2]) -> [f64; 3] {
    let cross =
        |p: [f64; 2], q: [f64; 2], r: [f64; 2]| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    let area = cross(a, b, c);
    [cross(p, b, c) / area, cross(p, c, a) / area, cross(p, a, b) / area]
}

/// Texels whose middles are well inside a triangle.
fn inside(places: [[f64; 2]; 3]) -> Vec<(usize, usize)> {
    let range = |axis: usize| {
        let all = places.map(|place| place[axis]);
        let low = all.iter().copied().fold(f64::INFINITY, f64::min).floor() as usize;
        low..all.iter().copied().fold(0.0, f64::max).ceil() as usize + 1
    };
    let middles = range(1).flat_map(|row| range(0).map(move |column| (row, column)));
    middles
        .filter(|(row, column)| {
            parts(places, [*column as f64 + 0.5, *row as f64 + 0.5]).iter().all(|part| *part > 0.02)
        })
        .collect()
}

fn sphere(columns: usize, rows: usize) -> Mesh {
    Mesh::grid(columns, rows, 0.02, |u, v| {
        let (longitude, latitude) = (u * std::f64::consts::TAU, v * std::f64::consts::PI);
        let around = 0.5 * latitude.sin();
        [0.5 + around * longitude.cos(), 0.5 + around * longitude.sin(), 0.5 - 0.5 * latitude.cos()]
    })
}

#[test]
fn closed_spheres_have_charts_all_around() {
    let mesh = sphere(40, 24);
    let plan = mesh.plan();
    assert!((4..60).contains(&plan.charts.len()), "{} charts", plan.charts.len());
    mesh.check(&plan);
    mesh.check_colors(&plan);
}

#[test]
fn spiral_stairs_do_not_lie_over_themselves() {
    let mesh = Mesh::grid(90, 3, 0.01, |u, v| {
        let (angle, radius) = (u * 3.0 * std::f64::consts::TAU, 0.2 + 0.25 * v);
        [0.5 + radius * angle.cos(), 0.5 + radius * angle.sin(), u]
    });
    let plan = mesh.plan();
    assert!(plan.charts.len() >= 3, "three turns");
    mesh.check(&plan);
    mesh.check_colors(&plan);
}

#[test]
fn collapses_stay_in_charts() {
    // A wavy sheet whose later vertices go to ones before them, as far as triangles stay what they are.
    let mut mesh = Mesh::grid(20, 20, 0.01, |u, v| [u, v, 0.1 * (9.0 * u).sin() * (7.0 * v).cos() + 0.3]);
    mesh.targets = (200..441u16).map(|vertex| vertex - 22).collect();
    let plan = mesh.plan();
    mesh.check(&plan);
    mesh.check_colors(&plan);
}

/// A dark step, small and steep, takes the place of the ground about it when the mesh is coarse: it has the ground's colour there, and its own where it is.
#[test]
fn what_grows_shows_what_it_covers() {
    let mesh = Mesh {
        positions: vec![[0.0; 3], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [5.0, 0.1, 1.0]],
        triangles: vec![[0, 1, 3], [0, 3, 2], [1, 2, 3]],
        targets: vec![2],
        texel: 0.05,
    };
    let plan = mesh.plan();
    mesh.check(&plan);
    let [dark, light] = [[20, 20, 20, 255], [220, 220, 220, 255]].map(|color| Paint::Colors([color; 3]));
    let texels = [mesh.texel; 3];
    let baked = plan.bake(&mesh.surface(&texels), &[dark, light, light], &mut Nothing).expect("texels");
    let chart = &plan.charts[usize::from(plan.chart_of[0])];
    let color = |point: [f32; 3]| {
        let [x, y] = chart.place(plan.origin, point);
        baked[y as usize * plan.size[0] as usize + x as usize][0]
    };
    for (place, expected) in
        [([5.0, 0.05, 0.5], 20), ([3.0, 4.0, 0.0], 220), ([1.0, 7.0, 0.0], 220), ([6.0, 2.0, 0.0], 220)]
    {
        assert_eq!(color(place), expected, "{place:?}");
    }
}

#[test]
fn odd_surfaces_have_plans() {
    let lonely = Mesh {
        positions: vec![[5.0, 5.0, 5.0]; 3],
        triangles: vec![[0, 1, 2]],
        texel: f64::NAN,
        ..Mesh::default()
    };
    let needles = Mesh::grid(60, 1, 0.5, |u, v| [u * 1e-6, v * 1e3, 0.0]);
    let far = Mesh::grid(8, 8, 1.0, |u, v| [1e7 + u * 60.0, -1e7 + v * 60.0, 3e6]);
    let sides = {
        // Two sheets at one place, facing either way.
        let mut mesh = Mesh::grid(6, 6, 0.02, |u, v| [u, v, 0.5]);
        let back: Vec<[u16; 3]> = mesh.triangles.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
        mesh.triangles.extend(back);
        mesh
    };
    let plain = Mesh { texel: f64::NAN, ..sphere(9, 7) };
    for (name, mesh) in
        [("lonely", &lonely), ("needles", &needles), ("far", &far), ("sides", &sides), ("plain", &plain)]
    {
        let plan = mesh.plan();
        println!("{name}: {} charts, {:?}", plan.charts.len(), plan.size);
        mesh.check(&plan);
        let (paints, texels) = (
            vec![Paint::Colors([[200; 4]; 3]); mesh.triangles.len()],
            vec![mesh.texel; mesh.triangles.len()],
        );
        let baked = plan.bake(&mesh.surface(&texels), &paints, &mut Nothing).expect("texels");
        assert!(baked.iter().all(|texel| *texel == [200; 4]), "{name}: a texel that nothing painted");
    }
    sides.check_colors(&sides.plan());
}

/// Images of one colour each.
struct Plain;

impl Pixels for Plain {
    fn region<'a>(
        &'a mut self,
        image: u32,
        _: i64,
        _: i64,
        room: &'a mut Region,
    ) -> Result<[&'a [Texel; 4]; 4], TextureError> {
        *room = [[linear_texel(&[10 * image as u8, 200, 90, 255]); 4]; 4];
        Ok(room.each_ref())
    }
}

/// Specks far smaller than a texel, each a chart of its own: none has the middle of one, and all have their colours.
#[test]
fn what_is_smaller_than_a_texel_has_its_colour() {
    let mut mesh = Mesh { texel: 1.0, ..Mesh::default() };
    for speck in 0..20_u16 {
        let x = f32::from(speck) * 9.0;
        mesh.positions.extend([[x, 0.0, 0.0], [x + 0.004, 0.0, 0.0], [x, 0.004, 0.001]]);
        mesh.triangles.push([0, 1, 2].map(|corner| 3 * speck + corner));
    }
    let plan = mesh.plan();
    mesh.check(&plan);
    for is_image in [true, false] {
        let paint = |speck: u32| match is_image {
            true => Paint::Image {
                image: speck + 1,
                corners: [[3.0; 2], [9.0, 3.0], [3.0, 7.0]],
                factor: [255; 4],
            },
            false => Paint::Colors([[10 * (speck as u8 + 1), 200, 90, 255]; 3]),
        };
        let paints: Vec<Paint> = (0..20).map(paint).collect();
        let texels = vec![mesh.texel; 20];
        let baked = plan.bake(&mesh.surface(&texels), &paints, &mut Plain).expect("texels");
        for (speck, corners) in (1..).zip(&mesh.triangles) {
            let chart = &plan.charts[usize::from(plan.chart_of[speck - 1])];
            for [x, y] in mesh.places(&plan, chart, *corners) {
                let found = baked[y as usize * plan.size[0] as usize + x as usize];
                assert_eq!(found, [10 * speck as u8, 200, 90, 255], "{speck}");
            }
        }
    }
}

/// A needle that asks for texels a millionth as large, as at the pole of a sphere: what is beside it keeps its own.
#[test]
fn needles_leave_others_their_texels() {
    for height in [1e-17_f32, 1e-9, 1e-4, 1e-2] {
        let mut mesh = Mesh::grid(20, 20, 0.01, |u, v| [u, v, 0.0]);
        let first = mesh.positions.len() as u16;
        mesh.positions.extend([[2.0, 0.0, 0.0], [2.0, 0.05, 0.0], [2.0 + height, 0.02, 0.0]]);
        mesh.triangles.push([first, first + 1, first + 2]);
        // As small as a hundred texels in its area ask for.
        let mut texels = vec![mesh.texel; mesh.triangles.len()];
        *texels.last_mut().expect("the needle") = (f64::from(height) * 0.025 / 100.0).sqrt();
        let plan = Plan::new(&mesh.surface(&texels)).expect("a plan");
        mesh.check(&plan);
        let chart = &plan.charts[usize::from(plan.chart_of[0])];
        let across = chart.axes[0].iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt();
        assert!((across - 100.0).abs() < 1.0, "{height}: {across} texels a unit, not 100");
        assert!(plan.size.iter().all(|side| *side < 4000), "{height}: {:?}", plan.size);
    }
}

#[test]
fn sheets_are_never_too_large() {
    let mesh = Mesh { texel: 1e-7, ..sphere(12, 8) };
    let plan = mesh.plan();
    let area = u64::from(plan.size[0]) * u64::from(plan.size[1]);
    assert!((1 << 22..=1 << 24).contains(&area), "{:?}", plan.size);
    assert!(plan.texel() > 1e-5);
    assert_eq!(mesh.plan(), plan, "twice the same");
}
