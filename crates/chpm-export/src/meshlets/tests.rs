//! Meshlets of meshes of every kind: what is in them, and that nothing is culled that can be seen.

use super::cone::bounds;
use super::cut::cut;
use chpm_mesh::TriMesh;
use chpm_mesh::geom::area_vector;
use chpm_synth::{Shape, Synth};
use nalgebra::{Point3, Vector3};

/// Numbers from -1 to 1 that look random.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn point(&mut self, scale: f64) -> [f32; 3] {
        [0; 3].map(|_| (self.next() * scale) as f32)
    }
}

/// Surfaces, and triangles that have nothing to do with one another, some of them without area.
fn meshes() -> Vec<TriMesh> {
    let mut random = Random(7);
    let mut meshes: Vec<TriMesh> = [Shape::Torus, Shape::Isosurface, Shape::Terrain]
        .map(|shape| Synth::new(shape, 5000, 1).to_mesh())
        .into();
    for scale in [1.0, 1e-38, 1e38] {
        let mut soup = TriMesh::default();
        soup.positions.extend((0..900).map(|_| random.point(scale)));
        soup.triangles.extend((0..900).map(|i| [i, (i + 1) % 900, (i * i + 7) % 900]));
        soup.triangles.extend([[5, 5, 5], [3, 3, 9]]);
        meshes.push(soup);
    }
    meshes.push(TriMesh::default());
    meshes
}

#[test]
fn every_triangle_is_in_one_meshlet() {
    for mesh in meshes() {
        for limit in [8, 9, 64, 128, 255, 256] {
            let meshlets = cut(&mesh.positions, &mesh.triangles, limit).unwrap();
            let mut found = Vec::new();
            for meshlet in &meshlets {
                assert!(
                    meshlet.vertices.len() <= limit as usize && meshlet.triangles.len() <= limit as usize
                );
                let corners = |local: &[u8; 3]| local.map(|v| meshlet.vertices[usize::from(v)]);
                found.extend(meshlet.triangles.iter().map(corners));
            }
            let turned = |[a, b, c]: [u32; 3]| [a, b, c].min([b, c, a]).min([c, a, b]);
            let sorted = |triangles: &[[u32; 3]]| {
                let mut all: Vec<[u32; 3]> = triangles.iter().map(|corners| turned(*corners)).collect();
                all.sort_unstable();
                all
            };
            assert_eq!(sorted(&found), sorted(&mesh.triangles), "{limit}");
        }
    }
}

#[test]
fn nothing_that_can_be_seen_is_culled() {
    let mut random = Random(1);
    let (mut culled, mut asked) = (0, 0);
    for mesh in meshes().into_iter().take(4) {
        for meshlet in cut(&mesh.positions, &mesh.triangles, 64).unwrap() {
            let place = |local: u8| mesh.positions[meshlet.vertices[usize::from(local)] as usize];
            let triangles = meshlet.triangles.iter().map(|corners| corners.map(place));
            let (sphere, cone) = bounds(triangles.clone());
            for point in triangles.clone().flatten() {
                assert!(chpm_mesh::geom::distance(sphere.center, point) <= f64::from(sphere.radius));
            }
            for i in 0..200 {
                // From far away, and from close by.
                let away = random.point([1.0, 3.0, 30.0][i % 3] * f64::from(sphere.radius).max(1e-3));
                let eye: [f32; 3] = std::array::from_fn(|axis| sphere.center[axis] + away[axis]);
                let way = Vector3::from_fn(|axis, _| sphere.center[axis] - eye[axis]);
                let axis = Vector3::from(cone.axis);
                asked += 1;
                // In single precision, as a GPU does.
                if way.dot(&axis) < cone.sine * way.norm() + sphere.radius {
                    continue;
                }
                culled += 1;
                for [a, b, c] in triangles.clone() {
                    let wide = |point: [f32; 3]| Point3::from(point.map(f64::from));
                    let faces = area_vector(a, b, c).dot(&(wide(a) - wide(eye)));
                    assert!(faces >= 0.0, "{eye:?} sees {:?}", [a, b, c]);
                }
            }
        }
    }
    println!("{culled} of {asked} culled");
    assert!(culled * 20 > asked, "{culled} of {asked}");
}

#[test]
fn triangles_that_face_all_ways_are_never_culled() {
    let flat = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let [a, b, c] = flat;
    let both = bounds([flat, [a, c, b]].into_iter()).1;
    let none = bounds([[a, a, b]].into_iter()).1;
    assert!(both.sine > 1.5 && none.sine > 1.5);
    let one = bounds([flat].into_iter()).1;
    assert!(one.axis == [0.0, 0.0, 1.0] && one.sine < 1e-4, "{one:?}");
}
