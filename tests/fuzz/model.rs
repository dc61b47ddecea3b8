//! Odd meshes: every way in which a source has been strange, one on top of the other.

use crate::draw::{Draw, noise};
use chpm_mesh::TriMesh;
use chpm_synth::{Shape, Synth, hand};
use std::f64::consts::TAU;

/// A mesh before it is written: coordinates as doubles, faces of any number of corners, indices that may be out of range.
#[derive(Clone, Default)]
pub(crate) struct Model {
    pub(crate) positions: Vec<[f64; 3]>,
    /// One for each vertex, or none.
    pub(crate) normals: Vec<[f32; 3]>,
    /// One for each vertex, or none.
    pub(crate) colors: Vec<[u8; 4]>,
    pub(crate) faces: Vec<Vec<i64>>,
}

impl Model {
    pub(crate) fn draw(draw: &mut Draw<'_>) -> Self {
        let mut model = shape(draw);
        for _ in 0..draw.below(4) {
            change(&mut model, draw);
        }
        place(&mut model, draw);
        if draw.once_in(3) {
            let seed = draw.word();
            let around = |i: usize| [0, 1, 2].map(|axis| noise(seed, 3 * i + axis) as f32 * 2.0 - 1.0);
            model.normals = (0..model.positions.len()).map(around).collect();
        }
        if draw.once_in(3) {
            let alike = draw.once_in(2);
            model.colors = (0..model.positions.len() as u32)
                .map(|i| if alike { [9; 4] } else { (i / 7).to_le_bytes() })
                .collect();
        }
        model
    }

    pub(crate) fn of(mesh: &TriMesh) -> Self {
        Model {
            positions: mesh.positions.iter().map(|p| p.map(f64::from)).collect(),
            faces: mesh.triangles.iter().map(|t| t.map(i64::from).to_vec()).collect(),
            ..Model::default()
        }
    }
}

fn shape(draw: &mut Draw<'_>) -> Model {
    let size = draw.pick(&[2, 3, 8, 20, 40]) + draw.below(5) as u32;
    let mesh = match draw.below(20) {
        0 => hand::grid(size, size),
        1 => hand::tetrahedron(),
        2 => hand::fan(size * 9),
        3 => hand::strip(size * 9),
        4 => hand::icosphere(size.min(3)),
        5 => hand::bow_tie(),
        6 => hand::moebius(size),
        7 => hand::klein_bottle(size.clamp(3, 20)),
        8 => hand::two_cubes_sharing_an_edge(),
        9 => hand::duplicate_faces(),
        10 => hand::mixed_winding(),
        11 => hand::soup(size * size),
        12 => hand::edge_fan(size * 9),
        13 => {
            let shape = draw.pick(&Shape::ALL);
            Synth::new(shape, u64::from(size * size), draw.word()).to_mesh()
        }
        14 => return at_random(size as usize, draw),
        15 => return overlapping_sheets(size as usize, draw),
        16 => return polygons(size as usize, draw),
        17 => return blocks(size.min(9) as usize, draw),
        _ => return specks(size as usize, draw),
    };
    Model::of(&mesh)
}

/// Any triangles over few vertices, some of which coincide.
fn at_random(size: usize, draw: &mut Draw<'_>) -> Model {
    let (seed, steps) = (draw.word(), draw.pick(&[1000.0, 3.0, 1.0]));
    let vertices = draw.between(3, 3 + 2 * size);
    let position = |i: usize| [0, 1, 2].map(|axis| (noise(seed, 3 * i + axis) * steps).round());
    let corner = |i: usize| (noise(!seed, i) * vertices as f64) as i64;
    Model {
        positions: (0..vertices).map(position).collect(),
        faces: (0..size * size).map(|i| (3 * i..3 * i + 3).map(corner).collect()).collect(),
        ..Model::default()
    }
}

/// Grids that lie on one another, or almost, with vertices of their own.
fn overlapping_sheets(size: usize, draw: &mut Draw<'_>) -> Model {
    let sheet = Model::of(&hand::grid(size as u32, 2));
    let apart = draw.pick(&[0.0, 1e-30, 1e-3]);
    let mut model = Model::default();
    for layer in 0..draw.between(2, 20) {
        append(&mut model, &sheet, [0.0, 0.0, layer as f64 * apart]);
    }
    model
}

/// Polygons of many corners: stars, which are concave, and some that fold over themselves.
fn polygons(size: usize, draw: &mut Draw<'_>) -> Model {
    let (corners, folds) = (draw.between(3, 24), draw.pick(&[1.0, 2.0, 5.0]));
    let mut model = Model::default();
    for i in 0..size {
        let first = model.positions.len() as i64;
        for corner in 0..corners {
            let (turn, reach) =
                (corner as f64 * folds / corners as f64 * TAU, 1.0 - 0.7 * (corner % 2) as f64);
            model.positions.push([reach * turn.cos() + 2.0 * i as f64, reach * turn.sin(), 0.0]);
        }
        model.faces.push((first..first + corners as i64).collect());
    }
    model
}

/// Cubes of a lattice that are there by chance: they touch in faces, edges and corners, with vertices in common or only in one place, or almost.
fn blocks(size: usize, draw: &mut Draw<'_>) -> Model {
    let cube = Model::of(&hand::cube());
    let (seed, share) = (draw.word(), draw.pick(&[0.5, 0.2, 0.9]));
    let step = draw.pick(&[1.0, 1.0, 1.0 + 1e-7, 1.001, 0.9]);
    let mut model = Model::default();
    for place in 0..size * size * size {
        if noise(seed, place) < share {
            let at = [place % size, place / size % size, place / size / size];
            append(&mut model, &cube, at.map(|i| i as f64 * step));
        }
    }
    if draw.once_in(2) {
        weld(&mut model);
    }
    model
}

/// Makes one vertex of all in one place.
fn weld(model: &mut Model) {
    let mut known = std::collections::BTreeMap::new();
    let key = |p: &[f64; 3]| p.map(f64::to_bits);
    let first: Vec<i64> =
        (0..).zip(&model.positions).map(|(i, p)| *known.entry(key(p)).or_insert(i)).collect();
    for v in model.faces.iter_mut().flatten() {
        *v = usize::try_from(*v).ok().and_then(|v| first.get(v).copied()).unwrap_or(*v);
    }
}

/// Many small components far from one another.
fn specks(size: usize, draw: &mut Draw<'_>) -> Model {
    let (speck, seed) = (Model::of(&hand::tetrahedron()), draw.word());
    let mut model = Model::default();
    for i in 0..size * 4 {
        append(&mut model, &speck, [0, 1, 2].map(|axis| noise(seed, 3 * i + axis) * 1000.0));
    }
    model
}

fn append(model: &mut Model, part: &Model, by: [f64; 3]) {
    let first = model.positions.len() as i64;
    model.positions.extend(part.positions.iter().map(|p| [0, 1, 2].map(|axis| p[axis] + by[axis])));
    model.faces.extend(part.faces.iter().map(|face| face.iter().map(|v| v.wrapping_add(first)).collect()));
}

/// One oddity more.
fn change(model: &mut Model, draw: &mut Draw<'_>) {
    let (vertices, faces) = (model.positions.len(), model.faces.len());
    if vertices == 0 || faces == 0 {
        return;
    }
    let some = draw.between(1, 1 + faces / 2);
    match draw.below(14) {
        0 => (0..some).for_each(|i| model.faces.push(model.faces[i].clone())),
        1 => model.faces.iter_mut().step_by(3).for_each(|face| face.reverse()),
        2 => {
            let turned = model.faces.iter_mut().step_by(5).filter(|face| !face.is_empty());
            turned.for_each(|face| face.rotate_left(1));
        }
        3 => {
            // Nobody uses it.
            let stray = [0, 1, 2].map(|_| draw.pick(&[0.0, 1e6, -1e9, 1e-9]));
            model.positions.insert(draw.below(vertices + 1), stray);
            model.faces.iter_mut().flatten().for_each(|v| *v = (*v).min(vertices as i64 - 1));
        }
        4 => {
            // The same place under another number.
            let first = model.positions.len() as i64;
            model.positions.extend_from_within(..);
            model.faces.iter_mut().step_by(2).flatten().for_each(|v| *v = v.wrapping_add(first));
        }
        5 => {
            let face = draw.below(faces);
            model.faces[face] = vec![0; draw.below(5)];
        }
        6 => model.positions.iter_mut().for_each(|p| p[2] = 0.0),
        7 => model.positions.iter_mut().for_each(|p| (p[1], p[2]) = (0.0, 0.0)),
        8 => {
            let seed = draw.word();
            let rough = |(i, p): (usize, &mut [f64; 3])| p[2] += noise(seed, i);
            model.positions.iter_mut().enumerate().for_each(rough);
        }
        9 => {
            let (vertex, axis, value) = (draw.below(vertices), draw.below(3), draw.odd_float());
            model.positions[vertex][axis] = value;
        }
        10 => {
            let (face, index) = (draw.below(faces), draw.odd_integer() as i64);
            if let Some(corner) = model.faces[face].first_mut() {
                *corner = index;
            }
        }
        11 => {
            // One face across everything.
            let n = vertices as i64;
            model.faces.push(vec![0, n / 2, n - 1]);
        }
        12 => {
            // Hubs: half of all corners are one vertex.
            model.faces.iter_mut().step_by(2).for_each(|face| face.iter_mut().take(1).for_each(|v| *v = 0));
        }
        _ => {
            let place = model.positions[draw.below(vertices)];
            model.positions.iter_mut().step_by(4).for_each(|p| *p = place);
        }
    }
}

/// Where it is and how large.
fn place(model: &mut Model, draw: &mut Draw<'_>) {
    let scale = draw.pick(&[1.0, 1.0, 1.0, 1.0, 1e-3, 1e-20, 1e-42, 1e15, 1e30, 1e37]);
    let far = draw.pick(&[0.0, 0.0, 0.0, 1e3, 5e6, 1e12, -4e5]);
    let squeeze = draw.pick(&[1.0, 1.0, 1.0, 1e-6, 0.0]);
    for p in &mut model.positions {
        *p = [p[0] * scale + far, p[1] * scale - far / 3.0, p[2] * scale * squeeze];
    }
}
