//! Halving of leaf-size patches, beside `meshopt`'s simplifier on the same patches with the same vertices locked.

use chpm_mesh::TriMesh;
use chpm_qem::{Decimator, Patch};
use chpm_synth::{Shape, Synth};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use meshopt::{SimplifyOptions, VertexDataAdapter};
use std::hint::black_box;

/// Triangles of a leaf at most, as a build aims for.
const LEAF: usize = 4096;

/// A piece of a mesh; vertices that other pieces have too are locked.
struct Piece {
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u16; 3]>,
    locked: Vec<bool>,
    indices: Vec<u32>,
}

/// Cuts at medians of the triangles' first corners until every piece is at most a leaf.
fn pieces(mesh: &TriMesh) -> Vec<Piece> {
    let mut parts = Vec::new();
    split(mesh, mesh.triangles.clone(), 0, &mut parts);
    let mut users = vec![0u32; mesh.positions.len()];
    let vertices = |part: &[[u32; 3]]| {
        let mut used = part.concat();
        used.sort_unstable();
        used.dedup();
        used
    };
    for part in &parts {
        vertices(part).iter().for_each(|v| users[*v as usize] += 1);
    }
    let piece = |part: &Vec<[u32; 3]>| {
        let used = vertices(part);
        let local = |v: u32| used.partition_point(|u| *u < v) as u16;
        let triangles: Vec<[u16; 3]> = part.iter().map(|t| t.map(local)).collect();
        Piece {
            positions: used.iter().map(|v| mesh.positions[*v as usize]).collect(),
            locked: used.iter().map(|v| users[*v as usize] > 1).collect(),
            indices: triangles.as_flattened().iter().map(|v| u32::from(*v)).collect(),
            triangles,
        }
    };
    parts.iter().map(piece).collect()
}

fn split(mesh: &TriMesh, mut triangles: Vec<[u32; 3]>, depth: usize, parts: &mut Vec<Vec<[u32; 3]>>) {
    if triangles.len() <= LEAF {
        parts.push(triangles);
        return;
    }
    let at = |t: &[u32; 3]| mesh.positions[t[0] as usize][depth % 3];
    triangles.sort_by(|a, b| at(a).total_cmp(&at(b)));
    let high = triangles.split_off(triangles.len() / 2);
    split(mesh, triangles, depth + 1, parts);
    split(mesh, high, depth + 1, parts);
}

fn halving(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("halving");
    group.sample_size(10);
    for shape in [Shape::Isosurface, Shape::Terrain] {
        let pieces = pieces(&Synth::new(shape, 200_000, 1).to_mesh());
        let triangles: usize = pieces.iter().map(|p| p.triangles.len()).sum();
        group.throughput(Throughput::Elements(triangles as u64));
        let mut decimator = Decimator::default();
        group.bench_function(format!("{shape}/chpm"), |bencher| {
            bencher.iter(|| {
                for p in &pieces {
                    let patch = Patch {
                        positions: &p.positions,
                        triangles: &p.triangles,
                        displacements: &[],
                        locked: &p.locked,
                        ..Patch::default()
                    };
                    black_box(decimator.decimate(&patch, p.triangles.len() / 2, 0.0).triangle_count);
                }
            });
        });
        group.bench_function(format!("{shape}/meshopt"), |bencher| {
            bencher.iter(|| {
                for p in &pieces {
                    let target = p.indices.len() / 6 * 3;
                    black_box(peer(p, target).len());
                }
            });
        });
    }
    group.finish();
}

fn peer(piece: &Piece, target: usize) -> Vec<u32> {
    let bytes = meshopt::typed_to_bytes(&piece.positions);
    let vertices = VertexDataAdapter::new(bytes, 12, 0).expect("positions of 12 bytes");
    let options = SimplifyOptions::empty();
    meshopt::simplify_with_locks(&piece.indices, &vertices, &piece.locked, target, f32::MAX, options, None)
}

criterion_group!(benches, halving);
criterion_main!(benches);
