//! Images that sources name, and triangles with texture coordinates.

use chpm_extmem::{Cancel, MemoryBudget, Store};
use chpm_import::{Batch, BatchKind, Images, Input, Invalid, Options, SourceInfo, Textures, input};
use chpm_texture::{Alpha, Material, TexturedTriangle, Wrap};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// First bytes of an image: a reader of meshes looks at no more.
pub(crate) const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";
const GREY: f32 = 128.0 / 255.0;

/// A folder with files.
pub(crate) fn folder(files: &[(&str, &[u8])]) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        let path = dir.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }
    dir
}

/// Content of a source.
#[derive(Debug)]
pub(crate) struct Read {
    pub(crate) positions: usize,
    pub(crate) triangles: Vec<[u32; 3]>,
    pub(crate) textured: Vec<TexturedTriangle>,
    pub(crate) info: SourceInfo,
}

impl Read {
    fn textures(&self) -> &Textures {
        self.info.textures.as_ref().expect("textures")
    }

    /// Material of a textured triangle.
    fn material(&self, triangle: usize) -> Material {
        self.textures().materials[self.textured[triangle].material as usize]
    }

    /// The name of its image.
    pub(crate) fn image(&self, triangle: usize) -> Option<&str> {
        let image = self.material(triangle).image?;
        Path::new(&self.textures().images[image as usize].name).file_name()?.to_str()
    }
}

pub(crate) fn read_with(path: &Path, images: Images, memory: u64) -> Result<Read, String> {
    let work = tempfile::tempdir().unwrap();
    let budget = MemoryBudget::with_work_limit(memory, if memory == 0 { 1 << 20 } else { 64 << 20 });
    let store = Store::with_budget(work.path(), budget).unwrap();
    let options = Options { images, invalid: Invalid::Refuse, ..Options::default() };
    let told = |error: chpm_import::SourceError| error.to_string();
    let mut input = Input::open(path, options, &store, &Cancel::default()).map_err(told)?;
    let (mut batch, mut positions) = (Batch::default(), 0);
    let (mut triangles, mut textured) = (Vec::new(), Vec::new());
    while input.next_batch(&mut batch).map_err(told)? != BatchKind::End {
        positions += batch.vertices.positions.len() + batch.positions_f64.len();
        triangles.append(&mut batch.triangles);
        textured.append(&mut batch.textured);
    }
    let info = input.finish().map_err(told)?;

    // Whoever asks for the files before gets the same.
    let files = input::files(path, images, &Cancel::default()).map_err(told)?;
    let beside: Vec<_> = info.beside.iter().map(|file| file.path.clone()).collect();
    assert_eq!(files[1..], beside);
    let fingerprint = input::fingerprint(&files, &Cancel::default()).unwrap();
    assert_eq!(fingerprint, (info.byte_len, info.hash));
    Ok(Read { positions, triangles, textured, info })
}

pub(crate) fn read(dir: &TempDir, name: &str, images: Images) -> Result<Read, String> {
    let path = dir.path().join(name);
    let read = read_with(&path, images, 1 << 30)?;
    // No budget shows. Materials and images themselves have to fit it.
    let tight = read_with(&path, images, 1 << 14).unwrap();
    assert_eq!(format!("{:?}", read.textured), format!("{:?}", tight.textured));
    Ok(read)
}

pub(crate) const FACE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 0.25 0.75\nvt 1 1\n";

#[test]
fn libraries_are_found_by_names_of_any_kind() {
    let mtl = |name: &str, image: &str| format!("newmtl {name}\nmap_Kd {image}\n").into_bytes();
    let dir = folder(&[
        ("my lib.mtl", &mtl("a", "maps\\my image.png")),
        ("b.mtl", &mtl("b", "b.png")),
        ("c d.mtl", &[mtl("b", "c.png"), mtl("c d", "c.png")].concat()),
        ("maps/my image.png", PNG),
        ("b.png", PNG),
        ("c.png", PNG),
        (
            "a.obj",
            format!(
                "mtllib my lib.mtl\nmtllib b.mtl \\\n c d.mtl\n{FACE}usemtl a\nf 1/1 2/2 3/3\nusemtl c d\nf 1/1 2/2 3/3\nusemtl b\nf 1/1 2/2 3/3\nusemtl none\nf 1/1 2/2 3/3\n"
            )
            .as_bytes(),
        ),
    ]);
    let read = read(&dir, "a.obj", Images::IfAny).unwrap();
    let names: Vec<_> = (0..read.textured.len()).map(|at| read.image(at)).collect();
    assert_eq!(names, [Some("my image.png"), Some("c.png"), Some("b.png")], "the first library wins");
    assert_eq!(read.triangles.len(), 4);
    assert_eq!(read.textured[0].uv, [[0.0, 0.0], [1.0, 0.0], [0.25, 0.75]]);
    assert_eq!(
        read.info.warnings,
        ["material 'none' was in no library when faces named it, which have no image"]
    );
    assert_eq!(read.info.beside.len(), 6);
}

#[test]
fn a_material_multiplies_moves_and_clamps() {
    let mtl = b"newmtl a\nKd 0.5 1 0\nmap_Kd -clamp on -s 2 3 -o 0.5 -1 a.png\nnewmtl b\nKd 0 0 0\nmap_Kd a.png\nnewmtl c\nKd 0 0 1\n";
    let obj =
        format!("mtllib a.mtl\n{FACE}usemtl a\nf 1/1 2/2 3/4\nusemtl b\nf 1/1 2/2 3/4\nusemtl c\nf 1 2 3\n");
    let dir = folder(&[("a.mtl", mtl), ("a.png", PNG), ("a.obj", obj.as_bytes())]);
    let read = read(&dir, "a.obj", Images::IfAny).unwrap();
    let [a, b, c] = [0, 1, 2].map(|at| read.material(at));
    assert_eq!(a, Material { image: Some(0), factor: [0.5, 1.0, 0.0, 1.0], wrap: [Wrap::Clamp; 2] });
    assert_eq!(b, Material { image: Some(0), factor: [1.0; 4], wrap: [Wrap::Repeat; 2] });
    assert_eq!(c, Material { image: None, factor: [0.0, 0.0, 1.0, 1.0], wrap: [Wrap::Repeat; 2] });
    assert_eq!(read.textured[0].uv, [[0.5, -1.0], [2.5, -1.0], [2.5, 2.0]]);
    assert!(!read.textures().tints);
}

#[test]
fn corners_name_coordinates_in_every_way_and_at_any_time() {
    let obj = "mtllib a.mtl\nusemtl a\nf 1/2/1 2/-1 3/3\nvt 0 0\nvt 1 0\nvt 0.5 0.5\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf -3/-3 -2/-2 -1/-1\nf 1 2/2 3\nf 1/9 2/2 3/3\nvt nan 0\nvt 1 x\nf 1/4 2/2 3/3\nf 1/5 2/2 3/3\n";
    let dir = folder(&[
        ("a.mtl", b"newmtl a\nKd 1 0 0\nmap_Kd a.png\n"),
        ("a.png", PNG),
        ("a.obj", obj.as_bytes()),
    ]);
    let read = read(&dir, "a.obj", Images::IfAny).unwrap();
    let uv: Vec<_> = read.textured.iter().map(|it| it.uv).collect();
    let (a, b, c, none) = ([0.0; 2], [1.0, 0.0], [0.5; 2], [[0.0; 2]; 3]);
    // The first face names a coordinate before there is any.
    assert_eq!(uv, [none, [a, b, c], none, none, none, none]);
    assert_eq!(read.image(1), Some("a.png"));
    for bare in [0, 2, 3, 4, 5] {
        assert_eq!(
            read.material(bare),
            Material { image: None, factor: [1.0, 0.0, 0.0, 1.0], wrap: [Wrap::Repeat; 2] }
        );
    }
}

#[test]
fn coordinates_before_the_library_are_read_again() {
    let obj = format!("{FACE}mtllib a.mtl\nvt 0.5 0\nusemtl a\nf 1/1 2/2 3/3\nf 1/5 2/2 3/3\n");
    let packed = zstd::encode_all(obj.as_bytes(), 1).unwrap();
    let dir = folder(&[
        ("a.mtl", b"newmtl a\nmap_Kd a.png\n"),
        ("a.png", PNG),
        ("a.obj", obj.as_bytes()),
        ("b.obj.zst", &packed),
    ]);
    for name in ["a.obj", "b.obj.zst"] {
        let read = read(&dir, name, Images::IfAny).unwrap();
        assert_eq!(read.textured[0].uv, [[0.0, 0.0], [1.0, 0.0], [0.25, 0.75]]);
        assert_eq!(read.textured[1].uv[0], [0.5, 0.0]);
        assert_eq!(read.info.warnings, Vec::<String>::new());
    }
}

#[test]
fn polygons_are_cut_where_their_coordinates_are() {
    // An arrow, whose second corner is within.
    let obj = "mtllib a.mtl\nusemtl a\nv 0 0 0\nv 1 1 0\nv 2 0 0\nv 1 3 0\nvt 0 0\nvt 0.5 0.25\nvt 1 0\nvt 0.5 1\nf 1/1 2/2 3/3 4/4\n";
    let dir = folder(&[("a.mtl", b"newmtl a\nmap_Kd a.png\n"), ("a.png", PNG), ("a.obj", obj.as_bytes())]);
    let read = read(&dir, "a.obj", Images::IfAny).unwrap();
    let area = |[a, b, c]: [[f32; 2]; 3]| (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
    assert_eq!(read.textured.len(), 2);
    assert!(
        read.textured.iter().all(|it| area(it.uv) > 0.0 && it.vertices.contains(&1)),
        "{:?}",
        read.textured
    );
}

#[test]
fn tiles_are_told_by_coordinates() {
    let faces: String = [(0.25, 0.5), (1.5, 0.5), (2.5, 3.5), (-0.5, 0.5), (3.5, 0.5)]
        .iter()
        .enumerate()
        .map(|(at, (u, v))| format!("vt {u} {v}\nf 1/{0} 2/{0} 3/{0}\n", at + 1))
        .collect();
    let obj = format!("mtllib a.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\n{faces}");
    let dir = folder(&[
        ("a.mtl", b"newmtl a\nmap_Kd maps\\wall.<UDIM>.png\n"),
        ("maps/wall.1001.png", PNG),
        ("maps/wall.1002.png", PNG),
        ("maps/wall.1033.png", PNG),
        ("maps/wall.x.png", PNG),
        ("a.obj", obj.as_bytes()),
    ]);
    let read = read(&dir, "a.obj", Images::IfAny).unwrap();
    let names: Vec<_> = (0..5).map(|at| read.image(at)).collect();
    assert_eq!(names, [Some("wall.1001.png"), Some("wall.1002.png"), Some("wall.1033.png"), None, None]);
    assert_eq!(read.textured[2].uv[0], [0.5; 2]);
    assert_eq!(read.material(4).factor, [GREY, GREY, GREY, 1.0]);
}

#[test]
fn images_that_are_not_there_are_grey_or_refused() {
    let obj = format!("mtllib a.mtl\nmtllib c.mtl\n{FACE}usemtl a\nf 1/1 2/2 3/3\nusemtl b\nf 1/1 2/2 3/3\n");
    let mtl = b"newmtl a\nmap_Kd a.png\nnewmtl b\nKd 1 0 1\nmap_Kd ../b.tga\n";
    let dir = folder(&[("a.mtl", mtl), ("a.obj", obj.as_bytes()), ("b.tga", b"TRUEVISION")]);
    fs::create_dir(dir.path().join("a.png")).unwrap();

    // None is there: as if they were not asked for, but for the warning.
    let without = read(&dir, "a.obj", Images::IfAny).unwrap();
    assert!(without.info.textures.is_none() && without.textured.is_empty() && without.info.beside.is_empty());
    let told = without.info.warnings.join("\n");
    for part in [
        "image 'a.png' is a folder: textures are left out",
        "image '../b.tga' is neither PNG nor JPEG",
        "material library 'c.mtl' is not there",
        "dropped 4 texture coordinates",
        "dropped 4 references to materials",
    ] {
        assert!(told.contains(part), "{told}");
    }

    let refused = read(&dir, "a.obj", Images::Required).unwrap_err();
    assert!(refused.contains("image 'a.png' is a folder: put it there"), "{refused}");
    let grey = read(&dir, "a.obj", Images::Grey).unwrap();
    assert_eq!([0, 1].map(|at| grey.material(at).factor), [[GREY, GREY, GREY, 1.0], [GREY, 0.0, GREY, 1.0]]);
    assert!(grey.info.warnings.join("\n").contains("image 'a.png' is a folder: grey instead"));

    fs::remove_dir(dir.path().join("a.png")).unwrap();
    fs::write(dir.path().join("a.png"), PNG).unwrap();
    let some = read(&dir, "a.obj", Images::IfAny).unwrap();
    assert_eq!((some.image(0), some.image(1)), (Some("a.png"), None));
}

#[test]
fn libraries_that_are_none_are_passed_over() {
    let obj = format!(
        "mtllib a.obj\nmtllib noise.mtl\nmtllib\nmtllib folder.mtl\n{FACE}usemtl a\nf 1/1 2/2 3/3\nnewmtl a\nmap_Kd a.png\n"
    );
    let noise: Vec<u8> = (0..100_000u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    let noise: Vec<u8> = noise.into_iter().flat_map(|byte| [byte, b'\n']).collect();
    let dir = folder(&[("a.obj", obj.as_bytes()), ("noise.mtl", &noise), ("a.png", PNG)]);
    fs::create_dir(dir.path().join("folder.mtl")).unwrap();
    let read = read(&dir, "a.obj", Images::IfAny).unwrap();
    assert!(read.info.textures.is_none());
    assert_eq!(read.triangles.len(), 1);
}

#[test]
fn a_thousand_materials_take_memory_that_is_asked_for() {
    let mtl: String = (0..1000).map(|at| format!("newmtl material number {at}\nmap_Kd {at}.png\n")).collect();
    let faces: String = (0..1000).map(|at| format!("usemtl material number {at}\nf 1/1 2/2 3/3\n")).collect();
    let obj = format!("mtllib a.mtl\n{FACE}{faces}");
    let dir = folder(&[("a.mtl", mtl.as_bytes()), ("a.obj", obj.as_bytes()), ("7.png", PNG)]);
    let path = dir.path().join("a.obj");
    let read = read_with(&path, Images::IfAny, 8 << 20).unwrap();
    assert_eq!((read.textured.len(), read.image(7), read.image(8)), (1000, Some("7.png"), None));
    assert!(read.info.warnings.iter().any(|told| told.contains("991 more images are not there")));
    let refused = read_with(&path, Images::IfAny, 0).err().unwrap();
    assert!(refused.contains("no memory for materials"), "{refused}");
}

pub(crate) fn ply(comments: &str, vertex: &str, vertices: &str, face: &str, faces: &str) -> Vec<u8> {
    let (v, f) = (vertices.lines().count(), faces.lines().count());
    format!(
        "ply\nformat ascii 1.0\n{comments}element vertex {v}\nproperty float x\nproperty float y\nproperty float z\n{vertex}element face {f}\n{face}end_header\n{vertices}{faces}"
    )
    .into_bytes()
}

pub(crate) const INDICES: &str = "property list uchar int vertex_indices\n";

#[test]
fn faces_of_a_ply_have_coordinates_and_numbers() {
    let comments = "comment TextureFile my wall.png\ncomment by someone\ncomment TextureFile b.png\n";
    let face = format!("property list uchar float texcoord\nproperty int texnumber\n{INDICES}");
    let faces = "6 0 0 1 0 0 1 1 3 0 1 2\n6 0 0 1 0 0.5 1 0 3 0 1 2\n8 0 0 1 0 1 1 0 1 0 4 0 1 2 3\n6 0 0 1 0 0 1 -1 3 0 1 2\n0 0 3 0 1 2\n6 0 0 1 0 0 1 2 3 0 1 2\n6 0 0 1 0 0 1 0 3 0 1 1\n";
    let text = ply(comments, "", "0 0 0\n1 0 0\n1 1 0\n0 1 0\n", &face, faces);
    let dir = folder(&[("a.ply", &text), ("my wall.png", PNG), ("b.png", PNG)]);
    let read = read(&dir, "a.ply", Images::IfAny).unwrap();
    let names: Vec<_> = (0..read.textured.len()).map(|at| read.image(at)).collect();
    assert_eq!(names, [Some("b.png"), Some("my wall.png"), Some("my wall.png"), Some("my wall.png")]);
    assert_eq!(read.textured[1].uv, [[0.0, 0.0], [1.0, 0.0], [0.5, 1.0]]);
    assert_eq!((read.triangles.len(), read.info.tally.degenerate_faces), (5, 1));
    assert!(matches!(&read.info.warnings[..], [one] if one.starts_with("1 face without an image")));

    let without = read_with(&dir.path().join("a.ply"), Images::Ignored, 1 << 20).unwrap();
    assert_eq!(without.triangles, read.triangles);
    assert_eq!(without.info.warnings, ["dropped texture coordinates of 'face': texcoord, texnumber"]);
}

#[test]
fn vertices_of_a_ply_have_coordinates_and_are_joined() {
    // A seam along x = 0, whose vertices are there twice.
    let vertices = "0 0 0 0 0\n1 0 0 0.5 0\n0 1 0 0 0.5\n0 0 0 1 0\n-0 1 0 1 0.5\n-1 0 0 0.75 0\n";
    let faces = "3 0 1 2\n3 3 4 5\n4 0 1 2 5\n3 0 3 1\n";
    for names in ["s t", "u v", "texture_u texture_v"] {
        for ty in ["float", "double"] {
            let vertex: String = names.split(' ').map(|name| format!("property {ty} {name}\n")).collect();
            let text = ply("comment TextureFile a.png\n", &vertex, vertices, INDICES, faces);
            let dir = folder(&[("a.ply", &text), ("a.png", PNG)]);
            let read = read(&dir, "a.ply", Images::IfAny).unwrap();
            assert_eq!((read.positions, &read.triangles[..]), (6, &[[0, 1, 2], [0, 2, 5]][..]));
            assert_eq!(read.textured[1].vertices, [0, 2, 5]);
            assert_eq!(read.textured[1].uv, [[1.0, 0.0], [1.0, 0.5], [0.75, 0.0]]);
            assert_eq!((read.textured.len(), read.info.tally.degenerate_faces), (5, 1));
            assert!(read.info.warnings[0].starts_with("joined 2 vertices"), "{:?}", read.info.warnings);

            // Without images nothing is joined.
            fs::remove_file(dir.path().join("a.png")).unwrap();
            let bare = read_with(&dir.path().join("a.ply"), Images::IfAny, 1 << 20).unwrap();
            assert_eq!(bare.triangles, [[0, 1, 2], [3, 4, 5], [0, 3, 1]]);
        }
    }
}

#[test]
fn binary_plys_and_strips_have_coordinates_by_vertex() {
    let head = "ply\nformat binary_big_endian 1.0\ncomment TextureFile a.png\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty short u\nproperty float v\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n";
    let mut bytes = head.as_bytes().to_vec();
    for (at, [x, y]) in [[0.0f32, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]].into_iter().enumerate() {
        [x, y, 0.0].iter().for_each(|x| bytes.extend(x.to_be_bytes()));
        bytes.extend((at as i16).to_be_bytes());
        bytes.extend((y / 2.0).to_be_bytes());
    }
    [4, 0, 1, 2, 3].iter().for_each(|x: &i32| bytes.extend(x.to_be_bytes()));
    let dir = folder(&[("a.ply", &bytes), ("a.png", PNG)]);
    let read = read(&dir, "a.ply", Images::IfAny).unwrap();
    assert_eq!(read.textured[0].uv, [[0.0, 0.0], [1.0, 0.0], [2.0, 0.5]]);
    assert_eq!(read.textured[1].vertices, read.triangles[1]);
}

#[test]
fn images_by_vertex_may_go_by_the_number_of_a_face() {
    let face = format!("{INDICES}property uchar texnumber\n");
    let vertex = "property float s\nproperty float t\n";
    let comments = "comment TextureFile a.png\ncomment TextureFile b.png\n";
    let text =
        ply(comments, vertex, "0 0 0 0 0\n1 0 0 0.5 0\n0 1 0 0 0.5\n", &face, "3 0 1 2 1\n3 2 1 0 0\n");
    let dir = folder(&[("a.ply", &text), ("a.png", PNG), ("b.png", PNG)]);
    let read = read(&dir, "a.ply", Images::IfAny).unwrap();
    assert_eq!((read.image(0), read.image(1)), (Some("b.png"), Some("a.png")));
    assert_eq!(read.textured[1].uv, [[0.0, 0.5], [0.5, 0.0], [0.0, 0.0]]);
}

/// Two triangles that meet in an edge whose vertices are there twice, as glTF of parts that are put in.
fn gltf(parts: Value) -> (Value, Vec<u8>) {
    let positions: [[f32; 3]; 6] =
        [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    let uv: [[f32; 2]; 6] = [[0.0, 1.0], [0.5, 1.0], [0.0, 0.25], [1.0, 1.0], [1.0, 0.0], [0.75, 0.0]];
    let mut data: Vec<u8> = positions.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
    data.extend(uv.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
    data.extend(PNG);
    let mut file = json!({
        "asset": { "version": "2.0" },
        "buffers": [{ "byteLength": data.len() }],
        "bufferViews": [
            { "buffer": 0, "byteLength": 72 }, { "buffer": 0, "byteOffset": 72, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 120, "byteLength": 8 }
        ],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 6, "type": "VEC3" },
            { "bufferView": 1, "componentType": 5126, "count": 6, "type": "VEC2" }
        ],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_1": 1 }, "material": 0 }] }],
        "nodes": [{ "mesh": 0 }], "scenes": [{ "nodes": [0] }],
    });
    for (name, value) in parts.as_object().unwrap() {
        file[name] = value.clone();
    }
    (file, data)
}

pub(crate) fn glb(parts: Value) -> Vec<u8> {
    let (file, data) = gltf(parts);
    let mut text = file.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF".to_vec();
    for word in [2, 28 + text.len() + data.len(), text.len()] {
        bytes.extend((word as u32).to_le_bytes());
    }
    bytes.extend(b"JSON");
    bytes.extend(&text);
    bytes.extend((data.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(data);
    bytes
}

pub(crate) fn base(texture: Value) -> Value {
    json!([{ "pbrMetallicRoughness": { "baseColorFactor": [1.0, 0.5, 0.0, 0.5], "baseColorTexture": texture } }])
}

#[test]
fn a_glb_has_its_images_inside() {
    let mut data_uri = "data:image/png;base64,".to_owned();
    data_uri += "iVBORw0KGgo=";
    for image in [json!({ "bufferView": 2, "mimeType": "image/png" }), json!({ "uri": data_uri })] {
        let bytes = glb(json!({
            "materials": base(json!({ "index": 0, "texCoord": 1 })), "textures": [{ "source": 0, "sampler": 0 }],
            "samplers": [{ "wrapS": 33071, "wrapT": 33648 }], "images": [image],
        }));
        let dir = folder(&[("a.glb", &bytes)]);
        let read = read(&dir, "a.glb", Images::IfAny).unwrap();
        assert_eq!(read.triangles, [[0, 1, 2], [1, 3, 2]], "doubled vertices are joined");
        assert_eq!(read.textured[0].vertices, [0, 1, 2]);
        // It counts downwards.
        assert_eq!(read.textured[0].uv, [[0.0, 0.0], [0.5, 0.0], [0.0, 0.75]]);
        assert_eq!(read.textured[1].uv, [[1.0, 0.0], [1.0, 1.0], [0.75, 1.0]]);
        let material = read.material(0);
        assert_eq!(material.wrap, [Wrap::Clamp, Wrap::Mirror]);
        let [r, g, b, a] = material.factor;
        assert_eq!([r, b, a], [1.0, 0.0, 1.0], "opaque");
        assert!((g - 0.735_36).abs() < 1e-4, "half the light: {g}");
        assert!(read.textures().tints && read.info.beside.is_empty());
        let mut found = Vec::new();
        let mut opened = read.textures().images[0].open().unwrap();
        assert_eq!(opened.alpha, Alpha::Ignored);
        std::io::Read::read_to_end(&mut opened.bytes, &mut found).unwrap();
        assert_eq!(found, PNG);
    }
}

#[test]
fn alpha_of_a_gltf_means_what_its_mode_says() {
    for (facts, alpha, factor) in [
        (json!({}), Alpha::Ignored, 1.0),
        (json!({ "alphaMode": "OPAQUE", "alphaCutoff": 0.1 }), Alpha::Ignored, 1.0),
        (json!({ "alphaMode": "BLEND" }), Alpha::Kept, 0.5),
        // The factor halves what is compared.
        (json!({ "alphaMode": "MASK" }), Alpha::Cut(255), 1.0),
        (json!({ "alphaMode": "MASK", "alphaCutoff": 0.1 }), Alpha::Cut(51), 1.0),
        (json!({ "alphaMode": "MASK", "alphaCutoff": 0.0 }), Alpha::Cut(0), 1.0),
        (json!({ "alphaMode": "new" }), Alpha::Ignored, 1.0),
    ] {
        let mut materials = base(json!({ "index": 0 }));
        materials[0].as_object_mut().unwrap().extend(facts.as_object().unwrap().clone());
        let bytes = glb(json!({
            "materials": materials, "textures": [{ "source": 0 }], "images": [{ "bufferView": 2 }],
        }));
        let folder = folder(&[("a.glb", &bytes)]);
        let read = read(&folder, "a.glb", Images::IfAny).unwrap();
        assert_eq!(read.textures().images[0].open().unwrap().alpha, alpha, "{facts}");
        assert_eq!(read.material(0).factor[3], factor, "{facts}");
    }
}

#[test]
fn one_image_may_be_opaque_here_and_cut_there() {
    let obj = b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\nusemtl b\nf 2/2 1/1 3/3\n";
    let mtl = b"newmtl a\nmap_Kd a.png\nnewmtl b\nmap_Kd a.png\nmap_d a.png\n";
    let dir = folder(&[("a.obj", obj), ("a.mtl", mtl), ("a.png", PNG)]);
    let read = read(&dir, "a.obj", Images::IfAny).unwrap();
    let alphas = [0, 1].map(|triangle| {
        let image = read.material(triangle).image.unwrap();
        read.textures().images[image as usize].open().unwrap().alpha
    });
    assert_eq!(alphas, [Alpha::Ignored, Alpha::Kept]);
    assert_eq!(read.info.beside.len(), 2, "the file is one: {:?}", read.info.beside);
}

#[test]
fn coordinates_of_a_gltf_are_scaled_turned_and_moved() {
    let transform = json!({ "offset": [0.5, 0.25], "rotation": std::f64::consts::FRAC_PI_2, "scale": [2.0, 3.0], "texCoord": 1 });
    let bytes = glb(json!({
        "materials": base(json!({ "index": 0, "extensions": { "KHR_texture_transform": transform } })),
        "textures": [{ "source": 0 }], "images": [{ "bufferView": 2 }],
    }));
    let dir = folder(&[("a.glb", &bytes)]);
    let read = read(&dir, "a.glb", Images::IfAny).unwrap();
    // (0.5, 1) becomes (1, 3), a quarter turn (3, -1), and then (3.5, -0.75).
    let [u, v] = read.textured[0].uv[1];
    assert!((u - 3.5).abs() < 1e-6 && (v - 1.75).abs() < 1e-6, "{u} {v}");
}

#[test]
fn images_beside_a_gltf_are_files_of_it() {
    let (mut file, data) = gltf(json!({
        "materials": base(json!({ "index": 0, "texCoord": 1 })), "textures": [{ "source": 0 }],
        "images": [{ "uri": "maps/my%20wall.png" }],
    }));
    file["buffers"][0]["uri"] = "a.bin".into();
    let text = file.to_string();
    let dir = folder(&[("a.gltf", text.as_bytes()), ("a.bin", &data), ("maps/my wall.png", PNG)]);
    let found = read(&dir, "a.gltf", Images::IfAny).unwrap();
    assert_eq!((found.image(0), found.info.beside.len()), (Some("my wall.png"), 2));

    fs::remove_file(dir.path().join("maps/my wall.png")).unwrap();
    let lost = read(&dir, "a.gltf", Images::IfAny).unwrap();
    assert!(lost.info.textures.is_none());
    let told = lost.info.warnings.join("\n");
    assert!(told.contains("'maps/my wall.png' is not there"), "{told}");
    let refused = read(&dir, "a.gltf", Images::Required).unwrap_err();
    assert!(refused.contains("maps/my wall.png"), "{refused}");
}

#[test]
fn lies_of_a_gltf_about_images_cost_no_mesh() {
    let good = json!({ "bufferView": 2 });
    let lies = [
        json!({ "materials": base(json!({ "index": 9 })), "textures": [], "images": [good] }),
        json!({ "materials": base(json!({ "index": 0 })), "textures": [{}], "images": [good] }),
        json!({ "materials": base(json!({ "index": 0 })), "textures": [{ "source": 9 }], "images": [good] }),
        json!({ "materials": base(json!({ "index": 0 })), "textures": [{ "source": 0 }], "images": [{ "bufferView": 9 }] }),
        json!({ "materials": base(json!({ "index": 0 })), "textures": [{ "source": 0 }], "images": [{ "bufferView": 0 }] }),
        json!({ "materials": base(json!({ "index": 0 })), "textures": [{ "source": 0 }], "images": [{}] }),
        json!({ "materials": base(json!({ "index": 0 })), "textures": [{ "source": 0 }], "images": [{ "uri": "data:;base64,@" }] }),
        json!({ "materials": base(json!({ "index": 0 })), "textures": [{ "source": 0 }], "images": [{ "uri": "https://a.example/a.png" }] }),
        json!({ "materials": base(json!({ "index": 0 })), "textures": [{ "source": 0 }], "images": [{ "uri": "../../a.png" }] }),
        json!({ "materials": "none", "images": [good] }),
    ];
    for lie in lies {
        let dir = folder(&[("a.glb", &glb(lie.clone()))]);
        let found = read(&dir, "a.glb", Images::IfAny).unwrap();
        assert!(found.info.textures.is_none() && found.triangles.len() == 2, "{lie}");
        assert!(!found.info.warnings.is_empty(), "{lie}");
        read(&dir, "a.glb", Images::Grey).unwrap();
    }

    // Coordinates that are not there, or too few.
    for attributes in [
        json!({ "POSITION": 0, "TEXCOORD_0": 9 }),
        json!({ "POSITION": 0, "TEXCOORD_0": 0 }),
        json!({ "POSITION": 0 }),
    ] {
        let dir = folder(&[(
            "a.glb",
            &glb(json!({
                "materials": base(json!({ "index": 0 })), "textures": [{ "source": 0 }], "images": [good],
                "meshes": [{ "primitives": [{ "attributes": attributes, "material": 0 }] }],
            })),
        )]);
        let found = read(&dir, "a.glb", Images::IfAny).unwrap();
        assert!(
            found.textured.iter().all(|it| it.uv.as_flattened().iter().all(|x| x.is_nan())),
            "{attributes}"
        );
        assert_eq!(found.textured.len(), 2);
    }
}

/// Colours of materials come without any image where they tell something.
#[test]
fn colours_of_materials_count_without_images() {
    let face = "usemtl a\nf 1/1 2/2 3/3\nusemtl b\nf 1 2 4\nf 1/1 2/2 3/3\n";
    let obj = format!("mtllib a.mtl\n{FACE}{face}");
    let early = format!("{FACE}mtllib a.mtl\n{face}");
    for (mtl, tells) in [
        ("newmtl a\nKd 0 0.5 1\nnewmtl b\n", true),
        ("newmtl a\nKd 0.2\nnewmtl b\nKd 0.4\n", true),
        ("newmtl a\nKd 0.4\nnewmtl b\nKd 0.4\n", false),
        ("newmtl a\nnewmtl b\nmap_Ks a.png\n", false),
    ] {
        for text in [&obj, &early] {
            let dir = folder(&[("a.mtl", mtl.as_bytes()), ("a.obj", text.as_bytes()), ("a.png", PNG)]);
            for images in [Images::IfAny, Images::Grey, Images::Required] {
                let read = read(&dir, "a.obj", images).unwrap();
                assert_eq!(read.info.textures.is_some(), tells, "{mtl}");
                let Some(textures) = &read.info.textures else { continue };
                assert!(textures.are_plain && textures.images.is_empty() && read.info.warnings.is_empty());
                assert_eq!((read.textured.len(), read.info.beside.len()), (3, 1));
                assert_ne!(read.material(0).factor, read.material(1).factor);
                assert_eq!(read.material(1), read.material(2));
            }
            assert!(read(&dir, "a.obj", Images::Ignored).unwrap().info.textures.is_none());
        }
    }

    for (factor, tells) in [(json!([1.0, 0.0, 0.0, 1.0]), true), (json!([0.5, 0.5, 0.5, 1.0]), false)] {
        let bytes = glb(json!({ "materials": [{ "pbrMetallicRoughness": { "baseColorFactor": factor } }] }));
        let dir = folder(&[("a.glb", &bytes)]);
        let read = read(&dir, "a.glb", Images::IfAny).unwrap();
        assert_eq!(read.info.textures.is_some(), tells, "{factor}");
        if tells {
            assert!(read.textures().are_plain && read.textures().tints);
            let red = Material { image: None, factor: [1.0, 0.0, 0.0, 1.0], wrap: [Wrap::Repeat; 2] };
            assert_eq!(read.material(0), red);
        }
    }
}
