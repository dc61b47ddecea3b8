//! `chpm export --meshlets`: a reader that knows docs/MESHLETS.md alone draws by its rule, and what it draws is held against cuts of the file.

use super::harness::{Folder, shell, text};
use super::tiles::{View, bits, cut, models, open, views};
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_measure::crack::{cracks, edge_counts, weld};
use chpm_mesh::{Level, TriMesh};
use chpm_refine::{Cut, extract};
use chpm_synth::{Shape, Synth};
use nix::sys::signal::Signal;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

const TOP: [u8; 8] = *b"CHPMmlts";

/// From where each model is looked at.
const VIEWS: u32 = 13;

/// An error, and the group whose box it is seen in.
type Seen = (f32, usize);

struct Group {
    low: [f32; 3],
    error: f32,
    high: [f32; 3],
}

struct Meshlet {
    center: [f32; 3],
    radius: f32,
    axis: [f32; 3],
    sine: f32,
    own: Seen,
    above: Seen,
    mesh: usize,
    /// Numbers of vertices in its mesh.
    triangles: Vec<[u32; 3]>,
}

struct Mesh {
    own: Seen,
    above: Seen,
    level: u32,
    cluster: usize,
    low: [f32; 3],
    high: [f32; 3],
    vertices: TriMesh,
}

/// A file of meshlets.
struct File {
    bytes: Vec<u8>,
    flags: u32,
    limit: usize,
    groups: Vec<Group>,
    meshes: Vec<Mesh>,
    meshlets: Vec<Meshlet>,
}

impl File {
    fn u32(&self, at: usize) -> u32 {
        u32::from_le_bytes(self.bytes[at..at + 4].try_into().expect("four bytes"))
    }

    fn size(&self, at: usize) -> usize {
        self.u32(at) as usize
    }

    fn u64(&self, at: usize) -> usize {
        usize::try_from(u64::from_le_bytes(self.bytes[at..at + 8].try_into().expect("eight")))
            .expect("a size")
    }

    fn f32(&self, at: usize) -> f32 {
        f32::from_bits(self.u32(at))
    }

    fn f32s(&self, at: usize) -> [f32; 3] {
        [0, 4, 8].map(|offset| self.f32(at + offset))
    }

    fn read(bytes: Vec<u8>) -> Self {
        let (groups, meshes, meshlets) = (Vec::new(), Vec::new(), Vec::new());
        let mut file = File { bytes, flags: 0, limit: 0, groups, meshes, meshlets };
        assert_eq!((&file.bytes[..8], file.u32(8), file.u32(12)), (&TOP[..], 1, 144));
        (file.flags, file.limit) = (file.u32(16), file.size(20));
        let (groups, meshes) = (file.u64(40), file.u64(48));
        assert_eq!((groups, meshes), (144, 144 + 32 * file.size(28)));
        for at in (0..file.size(28)).map(|i| groups + 32 * i) {
            let group = Group { low: file.f32s(at), error: file.f32(at + 12), high: file.f32s(at + 16) };
            file.groups.push(group);
        }
        let mut end = file.u64(56);
        assert_eq!(end, meshes + 96 * file.size(32));
        for at in (0..file.size(32)).map(|i| meshes + 96 * i) {
            assert_eq!(file.u64(at), end, "blocks lie one behind the other");
            assert!(end.is_multiple_of(16));
            end += file.size(at + 8);
            file.mesh(at);
        }
        assert_eq!((end, file.u64(112)), (file.bytes.len(), file.bytes.len()));
        let vertices: usize = file.meshes.iter().map(|mesh| mesh.vertices.positions.len()).sum();
        let triangles: usize = file.meshlets.iter().map(|meshlet| meshlet.triangles.len()).sum();
        let told = [120, 128, 136].map(|at| file.u64(at));
        assert_eq!(told, [file.meshlets.len(), triangles, vertices]);
        file
    }

    fn mesh(&mut self, at: usize) {
        let (block, len) = (self.u64(at), self.size(at + 8));
        let [vertices, meshlets, triangles] = [12, 16, 20].map(|field| self.size(at + field));
        let tables: Vec<usize> = (0..5).map(|i| self.size(at + 72 + 4 * i)).collect();
        let seen = |error, group| (self.f32(at + error), self.size(at + group));
        let (own, above) = (seen(32, 24), seen(36, 28));
        let [normals, colors] = [1, 2].map(|flag| if self.flags & flag > 0 { vertices } else { 0 });
        let mut locals = 0;
        let mut read = Vec::new();
        let mut next = 0;
        for record in (0..meshlets).map(|i| block + 64 * i) {
            let [first, first_triangle, count, triangles] =
                [32, 36, 40, 44].map(|field| self.size(record + field));
            assert_eq!((first, first_triangle), (locals, next), "meshlets lie one behind the other");
            assert!((1..=self.limit).contains(&triangles) && count <= self.limit);
            let local = |i: usize| self.u32(block + tables[3] + 4 * (first + i));
            let corners = |i: usize| -> [u32; 3] {
                let at = block + tables[4] + 4 * (first_triangle + i);
                let [a, b, c, zero] = self.bytes[at..at + 4] else { unreachable!() };
                assert_eq!(zero, 0);
                [a, b, c].map(|corner| {
                    assert!(usize::from(corner) < count);
                    local(corner.into())
                })
            };
            let distinct: BTreeSet<u32> = (0..count).map(local).collect();
            assert!(
                distinct.len() == count && distinct.last().is_some_and(|last| (*last as usize) < vertices)
            );
            read.push(Meshlet {
                center: self.f32s(record),
                radius: self.f32(record + 12),
                axis: self.f32s(record + 16),
                sine: self.f32(record + 28),
                own: (self.f32(record + 48), self.size(record + 56)),
                above: (self.f32(record + 52), self.size(record + 60)),
                mesh: self.meshes.len(),
                triangles: (0..triangles).map(corners).collect(),
            });
            locals += count;
            next += triangles;
        }
        assert_eq!(next, triangles, "every triangle once");
        let ends = [64 * meshlets, 12 * vertices, 12 * normals, 4 * colors, 4 * locals, 4 * triangles];
        let begins = [0].into_iter().chain(tables.iter().copied()).chain([len]).collect::<Vec<_>>();
        for (i, size) in ends.into_iter().enumerate() {
            assert_eq!((begins[i] + size).next_multiple_of(16), begins[i + 1], "table {i}");
        }
        let mut mesh = TriMesh::default();
        mesh.positions.extend((0..vertices).map(|v| self.f32s(block + tables[0] + 12 * v)));
        mesh.normals.extend((0..normals).map(|v| self.f32s(block + tables[1] + 12 * v)));
        mesh.colors
            .extend((0..colors).map(|v| std::array::from_fn(|i| self.bytes[block + tables[2] + 4 * v + i])));
        self.meshlets.extend(read);
        let (low, high) = (self.f32s(at + 48), self.f32s(at + 60));
        let (level, cluster) = (self.u32(at + 40), self.size(at + 44));
        self.meshes.push(Mesh { own, above, level, cluster, low, high, vertices: mesh });
    }

    /// Meshlets that are drawn where `refines` says so.
    fn drawn(&self, refines: impl Fn(Seen) -> bool) -> Vec<&Meshlet> {
        self.meshlets.iter().filter(|meshlet| !refines(meshlet.own) && refines(meshlet.above)).collect()
    }

    fn mesh_of(&self, drawn: &[&Meshlet]) -> TriMesh {
        let mut all = TriMesh::default();
        for meshlet in drawn {
            let (mesh, first) = (&self.meshes[meshlet.mesh].vertices, all.positions.len() as u32);
            all.positions
                .extend(meshlet.triangles.as_flattened().iter().map(|v| mesh.positions[*v as usize]));
            let corners = first..all.positions.len() as u32;
            all.triangles.extend(corners.step_by(3).map(|corner| [corner, corner + 1, corner + 2]));
        }
        all
    }

    /// The rule as a view has it, in double precision.
    fn seen_by(&self, view: &View, (error, group): Seen) -> bool {
        let Group { low, high, .. } = &self.groups[group];
        let half = [0, 1, 2].map(|axis| (f64::from(high[axis]) - f64::from(low[axis])) / 2.0);
        let center = [0, 1, 2].map(|axis| (f64::from(high[axis]) + f64::from(low[axis])) / 2.0);
        view.refines(center, half, error.into())
    }

    /// The rule as the document has it, in single precision.
    fn seen_single(&self, view: &View, (error, group): Seen) -> bool {
        let Group { low, high, .. } = &self.groups[group];
        let eye = view.eye.map(|x| x as f32);
        let d = [0, 1, 2].map(|axis| (low[axis] - eye[axis]).max(eye[axis] - high[axis]).max(0.0));
        error > view.allowed as f32 * (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
    }
}

fn exported(folder: &Folder, name: &str, more: &str) -> File {
    folder.stdout(&format!("export {name}.chpm --meshlets {name}.meshlets -qf {more}"));
    File::read(folder.read(&format!("{name}.meshlets")))
}

/// How many edges have one side.
fn open_edges(mesh: &TriMesh) -> usize {
    edge_counts(&weld(mesh)).boundary
}

fn source(file: &Chpm<MappedFile>) -> TriMesh {
    extract(file, &Cut::at_level(file, Level(0))).expect("the source")
}

#[test]
fn meshlets_draw_the_cuts_of_the_file_and_they_have_no_cracks() {
    let folder = models();
    for (name, more) in
        [("closed", ""), ("open", "--meshlet-triangles 64"), ("roots", "--meshlet-triangles 256")]
    {
        let meshlets = exported(&folder, name, more);
        let file = open(&folder, &format!("{name}.chpm"));
        let source = source(&file);
        let welded = weld(&source);
        let mut mixed = 0;
        for view in views(&file, VIEWS) {
            let drawn = meshlets.drawn(|seen| meshlets.seen_by(&view, seen));
            let (mesh, cut) = (meshlets.mesh_of(&drawn), cut(&file, &view));
            cut.check(&file).expect("a legal cut");
            let expected = extract(&file, &cut).expect("a mesh");
            assert_eq!(bits(&mesh), bits(&expected), "{name} {view:?}");
            assert_eq!(open_edges(&mesh), open_edges(&expected), "{name} {view:?}");
            assert!(cracks(&weld(&mesh), &welded).is_empty(), "{name} {view:?}");
            let levels: BTreeSet<u32> = drawn.iter().map(|m| meshlets.meshes[m.mesh].level).collect();
            mixed += u32::from(levels.len() > 1);
            // Whatever is rounded.
            let single = meshlets.mesh_of(&meshlets.drawn(|seen| meshlets.seen_single(&view, seen)));
            assert!(cracks(&weld(&single), &welded).is_empty(), "{name} {view:?}");
        }
        assert!(3 * mixed > VIEWS || name == "roots", "{name}: {mixed} views of several levels");
        let all = View { eye: [0.0; 3], allowed: 0.0 };
        let nearest = meshlets.mesh_of(&meshlets.drawn(|seen| meshlets.seen_single(&all, seen)));
        assert_eq!(bits(&nearest), bits(&source), "{name}");
    }
}

/// The test above can fail: a mesh that decides by its own box leaves a crack.
#[test]
fn a_falsified_box_cracks() {
    let folder = models();
    let meshlets = exported(&folder, "closed", "");
    let file = open(&folder, "closed.chpm");
    let source = weld(&source(&file));
    let alone = |view: &View, mesh: &Mesh, error: f32| {
        let d = [0, 1, 2].map(|axis| {
            (f64::from(mesh.low[axis]) - view.eye[axis])
                .max(view.eye[axis] - f64::from(mesh.high[axis]))
                .max(0.0)
        });
        f64::from(error) > view.allowed * d.iter().map(|x| x * x).sum::<f64>().sqrt()
    };
    let cracked = views(&file, 34).into_iter().filter(|view| {
        let drawn = meshlets.meshlets.iter().filter(|meshlet| {
            let mesh = &meshlets.meshes[meshlet.mesh];
            !alone(view, mesh, meshlet.own.0) && alone(view, mesh, meshlet.above.0)
        });
        !cracks(&weld(&meshlets.mesh_of(&drawn.collect::<Vec<_>>())), &source).is_empty()
    });
    assert!(cracked.count() > 5);
}

#[test]
fn errors_fall_and_boxes_are_nested() {
    let folder = models();
    for name in ["closed", "open", "roots"] {
        let meshlets = exported(&folder, name, "");
        let file = open(&folder, &format!("{name}.chpm"));
        let within = |inner: ([f32; 3], [f32; 3]), outer: &Group| {
            (0..3).all(|axis| outer.low[axis] <= inner.0[axis] && inner.1[axis] <= outer.high[axis])
        };
        let mut roots = 0;
        for mesh in &meshlets.meshes {
            let [own, above] = [mesh.own, mesh.above].map(|(_, group)| &meshlets.groups[group]);
            assert!(mesh.own.0 < mesh.above.0, "{:?} {:?}", mesh.own, mesh.above);
            assert!(within((mesh.low, mesh.high), own) && within((own.low, own.high), above));
            assert!(mesh.own.0 == 0.0 || mesh.own.0 == own.error);
            assert!(mesh.above.0 == above.error || mesh.above == (f32::INFINITY, mesh.own.1));
            assert_eq!(mesh.level == 0, mesh.own.0 == 0.0);
            roots += usize::from(mesh.above.0.is_infinite());
            // The bound is that of the file, but for a last bit.
            let group = file.clusters()[mesh.cluster].group();
            let error = file.groups()[group.index()].max_error;
            assert!(mesh.own.0 == 0.0 || (error..=error * 1.000_001).contains(&mesh.own.0));
        }
        assert_eq!(roots, file.roots().count());
        for meshlet in &meshlets.meshlets {
            let mesh = &meshlets.meshes[meshlet.mesh];
            assert_eq!((meshlet.own, meshlet.above), (mesh.own, mesh.above));
        }

        // Without a camera: thresholds that fall refine, group by group, from the roots to the source.
        let mut errors: Vec<f32> = meshlets.groups.iter().map(|group| group.error).collect();
        errors.sort_by(f32::total_cmp);
        let (source, mut last) = (weld(&source(&file)), (0, BTreeSet::new()));
        for threshold in errors.iter().rev().step_by(errors.len() / 12 + 1).copied().chain([0.0]) {
            let drawn = meshlets.drawn(|(error, _)| error > threshold);
            let mesh = meshlets.mesh_of(&drawn);
            assert!(cracks(&weld(&mesh), &source).is_empty(), "{name} {threshold}");
            let refined: BTreeSet<usize> = drawn.iter().map(|m| m.above.1).collect();
            let left: BTreeSet<usize> =
                meshlets.meshlets.iter().filter(|m| m.own.0 > threshold).map(|m| m.mesh).collect();
            assert!(mesh.triangles.len() >= last.0 && left.is_superset(&last.1), "{name} {threshold}");
            assert!(!refined.is_empty());
            last = (mesh.triangles.len(), left);
        }
        assert_eq!(last.0, source.triangles.len());
    }
}

#[test]
fn culling_hides_only_what_faces_away() {
    let folder = Folder::new();
    folder.stdout("synth torus --triangles 40000 -o torus.ply -q");
    folder.stdout("build torus.ply --cluster-triangles 1024 -q");
    let meshlets = exported(&folder, "torus", "");
    let file = open(&folder, "torus.chpm");
    let (mut culled, mut all) = (0, 0);
    for view in views(&file, 12) {
        let eye = view.eye.map(|x| x as f32);
        for meshlet in meshlets.drawn(|seen| meshlets.seen_single(&view, seen)) {
            let Meshlet { center, radius, axis, sine, .. } = meshlet;
            let vertices = &meshlets.meshes[meshlet.mesh].vertices.positions;
            let way = [0, 1, 2].map(|k| center[k] - eye[k]);
            let dot = (0..3).map(|k| way[k] * axis[k]).sum::<f32>();
            let length = way.iter().map(|x| x * x).sum::<f32>().sqrt();
            all += 1;
            for corners in &meshlet.triangles {
                let [a, b, c] = corners.map(|v| vertices[v as usize].map(f64::from));
                for corner in [a, b, c] {
                    let off: f64 = (0..3).map(|k| (corner[k] - f64::from(center[k])).powi(2)).sum();
                    assert!(off.sqrt() <= f64::from(*radius), "outside of the sphere");
                }
                if dot >= sine * length + radius {
                    let [u, v, w] =
                        [(b, a), (c, a), (a, view.eye)].map(|(p, q)| [0, 1, 2].map(|k| p[k] - q[k]));
                    let normal =
                        [0, 1, 2].map(|k| u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3]);
                    assert!((0..3).map(|k| normal[k] * w[k]).sum::<f64>() >= 0.0, "a front face was culled");
                }
            }
            culled += u32::from(dot >= sine * length + radius);
        }
    }
    println!("{culled} of {all} meshlets face away");
    assert!(culled * 20 > all, "{culled} of {all}");
}

#[test]
fn vertices_have_what_the_file_has() {
    let folder = Folder::new();
    let mut colored = Synth::new(Shape::Torus, 6000, 1).to_mesh();
    colored.colors =
        (0..colored.positions.len()).map(|i| [(i % 256) as u8, (i / 256) as u8, 7, 255]).collect();
    folder.write_mesh("colored.ply", &colored);
    folder.stdout("build colored.ply -q --cluster-triangles 256");
    let [with, without] = ["", "--normals none"].map(|more| exported(&folder, "colored", more));
    assert_eq!((with.flags, without.flags, with.limit), (3, 2, 128));
    let key = |position: &[f32; 3]| position.map(f32::to_bits);
    let colors: BTreeMap<_, _> = colored.positions.iter().map(key).zip(&colored.colors).collect();
    for mesh in &with.meshes {
        for (v, position) in mesh.vertices.positions.iter().enumerate() {
            assert_eq!(Some(&&mesh.vertices.colors[v]), colors.get(&key(position)));
            let length: f32 = mesh.vertices.normals[v].iter().map(|x| x * x).sum();
            assert!((length - 1.0).abs() < 1e-5, "{length}");
        }
    }
    // Where meshes of a cut meet, they have one normal.
    for view in views(&open(&folder, "colored.chpm"), 4) {
        let meshes: BTreeSet<usize> =
            with.drawn(|seen| with.seen_single(&view, seen)).iter().map(|m| m.mesh).collect();
        let mut normals = BTreeMap::new();
        for vertices in meshes.iter().map(|mesh| &with.meshes[*mesh].vertices) {
            for (position, normal) in vertices.positions.iter().zip(&vertices.normals) {
                assert_eq!(normals.entry(key(position)).or_insert(normal), &normal);
            }
        }
    }

    // Images become colours.
    super::sheets::add_textured(&folder);
    folder.stdout("build a.obj -q --texture sheets");
    let told = folder.stderr("export a.chpm --meshlets a.meshlets -q", 0);
    assert!(told.contains("images have become colours"), "{told}");
    assert_eq!(File::read(folder.read("a.meshlets")).flags, 3);
}

#[test]
fn a_file_of_meshlets_is_the_same_for_any_threads_and_whole_or_not_there() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 40000 -o in.ply -q");
    folder.stdout("build in.ply --cluster-triangles 64 -q");
    let told = folder.stdout("export in.chpm --meshlets all.meshlets -q --json");
    let told: Value = serde_json::from_str(&told).expect("JSON");
    let bytes = folder.read("all.meshlets");
    let file = File::read(bytes.clone());
    let sum = |name: &str| told[name].as_u64().expect("a number") as usize;
    assert_eq!(
        [sum("meshes"), sum("meshlets"), sum("bytes")],
        [file.meshes.len(), file.meshlets.len(), bytes.len()]
    );
    let said = folder.stdout("export in.chpm --meshlets one.meshlets -q --memory 200M --threads 1");
    assert!(said.contains(" meshlets of "), "{said}");
    assert!(bytes == folder.read("one.meshlets"));

    let before = folder.names();
    for (words, told) in [
        ("--meshlets one.meshlets", "--force"),
        ("--meshlets in.chpm -f", "CHPM"),
        ("--meshlets x.glb", "meshlets"),
        ("--meshlets -", "name a file"),
        ("--meshlets x --3dtiles y", "cannot be used"),
        ("--meshlets x --meshopt", "cannot be used"),
        ("--meshlets x --up z", "cannot be used"),
        ("--meshlets x --meshlet-triangles 257", "at most 256"),
        ("--meshlets x --meshlet-triangles 7", "at least 8"),
        ("--3dtiles y --meshlet-triangles 64", "cannot be used"),
        ("--meshlets no/such", "no/such"),
        ("--meshlets x --memory 1M", "--memory"),
        ("", "--3dtiles"),
    ] {
        let error = folder.stderr(&format!("export in.chpm -q {words}"), 2);
        assert!(error.contains(told), "{words}: {error}");
    }
    let out = shell(&folder, "ulimit -f 120; chpm export in.chpm --meshlets out -q");
    assert!(out.status.code() == Some(2) && text(&out.stderr).contains("'out'"), "{}", text(&out.stderr));
    assert_eq!(folder.names(), before);
    let (status, told) = folder.signalled("export in.chpm --meshlets out", "meshlets", Signal::SIGINT);
    assert!(status.success() || folder.names() == before, "{told:?}");
}
