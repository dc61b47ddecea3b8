//! `verify --cuts` and `measure` on surfaces that touch, coincide or overlap: nothing that the source itself has is a fault, and nothing
//! takes long.

use super::harness::Folder;
use chpm_mesh::TriMesh;
use chpm_synth::hand;

/// Copies of a mesh that share no vertex, each moved.
fn copies(mesh: &TriMesh, count: u32, moved: impl Fn(u32) -> [f32; 3]) -> TriMesh {
    let mut all = TriMesh::default();
    for i in 0..count {
        let (first, by) = (all.positions.len() as u32, moved(i));
        all.positions.extend(mesh.positions.iter().map(|p| [0, 1, 2].map(|axis| p[axis] + by[axis])));
        all.triangles.extend(mesh.triangles.iter().map(|t| t.map(|v| v + first)));
    }
    all
}

fn waves(side: u32) -> TriMesh {
    let mut mesh = hand::grid(side, side);
    mesh.positions.iter_mut().for_each(|p| p[2] = (0.7 * p[0]).sin() * (0.9 * p[1]).cos());
    mesh
}

/// Cubes at every other place of a block, so that they share edges and corners.
fn checkerboard(side: usize) -> TriMesh {
    let cube = hand::cube();
    let number = |p: [usize; 3]| ((p[0] * (side + 1) + p[1]) * (side + 1) + p[2]) as u32;
    let mut mesh = TriMesh::default();
    for i in 0..(side + 1).pow(3) {
        let p = [i / (side + 1) / (side + 1), i / (side + 1) % (side + 1), i % (side + 1)];
        mesh.positions.push(p.map(|x| x as f32));
    }
    for at in (0..side.pow(3)).map(|i| [i / side / side, i / side % side, i % side]) {
        if at.iter().sum::<usize>() % 2 == 0 {
            let corner = |v: u32| {
                let p = cube.positions[v as usize];
                number([0, 1, 2].map(|axis| at[axis] + usize::from(p[axis] > 0.5)))
            };
            mesh.triangles.extend(cube.triangles.iter().map(|t| t.map(corner)));
        }
    }
    mesh
}

/// Tiny triangles all over, and one around them all.
fn giant_among_tiny(count: u32) -> TriMesh {
    let tiny = TriMesh::new(vec![[0.0; 3], [1e-3, 0.0, 0.0], [0.0, 1e-3, 1e-3]], vec![[0, 1, 2]]);
    let spread = |i: u32, step: f32| (i as f32 * step).fract();
    let mut mesh =
        copies(&tiny, count, |i| [spread(i, 0.618_034), spread(i, 0.754_877), spread(i, 0.569_84)]);
    mesh.positions.extend([[-1e6, -1e6, -1.0], [1e6, 0.0, -1.0], [0.0, 1e6, -1.0]]);
    mesh.triangles.push([3 * count, 3 * count + 1, 3 * count + 2]);
    mesh
}

/// Every triangle more than once, by the same vertices.
fn repeated(mesh: &TriMesh, times: u32) -> TriMesh {
    let triangles = mesh.triangles.iter().flat_map(|t| (0..times).map(|_| *t)).collect();
    TriMesh::new(mesh.positions.clone(), triangles)
}

fn odd_meshes() -> Vec<(&'static str, TriMesh)> {
    vec![
        ("coincident", copies(&waves(8), 20, |_| [0.0; 3])),
        ("overlapping", copies(&waves(8), 20, |i| [1e-3, 7e-4, 3e-4].map(|x| x * i as f32))),
        ("collinear", copies(&hand::grid(12, 12), 4, |i| [0.5 * i as f32, 0.0, 0.0])),
        ("edge fan", hand::edge_fan(300)),
        ("moebius", hand::moebius(300)),
        ("cubes that touch", checkerboard(5)),
        ("cubes that share an edge", hand::two_cubes_sharing_an_edge()),
        ("a giant", giant_among_tiny(500)),
        ("twice", repeated(&waves(12), 2)),
        ("three times", repeated(&waves(12), 3)),
    ]
}

#[test]
fn what_the_source_has_itself_is_no_crack() {
    for (name, mesh) in odd_meshes() {
        let folder = Folder::new();
        folder.write_mesh("in.ply", &mesh);
        // In one cluster, where there is no border, and in many.
        for size in [16_384, 32] {
            folder.stdout(&format!("build in.ply -qf --cluster-triangles {size}"));
            let out = folder.stdout("verify in.chpm --cuts 40 -q");
            assert!(out.contains("no crack in 40 random cuts"), "{name} in clusters of {size}: {out}");
        }
    }
}

#[test]
fn memory_does_not_change_what_is_found() {
    let folder = Folder::new();
    folder.write_mesh("in.ply", &checkerboard(8));
    folder.stdout("build in.ply -q --cluster-triangles 32");
    let found = ["40M", "1G"]
        .map(|memory| folder.stdout(&format!("verify in.chpm --cuts 6 -q --json --memory {memory}")));
    assert_eq!(found[0], found[1]);
}
