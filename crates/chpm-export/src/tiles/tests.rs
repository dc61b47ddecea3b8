//! Tilesets of small models, read as a viewer reads them.

use super::content::content;
use super::{Mesh, Options, SharedNormals, Tree, tile, tile_path, tilesets};
use crate::gltf::Facts;
use crate::{ExportError, Level, Turn};
use chpm_build::config::Length;
use chpm_build::{BuildConfig, Cancel, Resources, Settings, Silent, build};
use chpm_format::Chpm;
use chpm_import::ply::{Encoding, write_mesh};
use chpm_mesh::{Attributes, Bytes, ClusterId, TriMesh};
use chpm_synth::{Shape, Synth, hand};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};

/// A file of many small clusters; of several roots where all errors are to stay below a share of the model.
fn built(shape: Shape, triangles: u64, target: Option<f64>) -> Chpm<Vec<u8>> {
    built_of(&Synth::new(shape, triangles, 1).to_mesh(), target)
}

fn built_of(mesh: &TriMesh, target: Option<f64>) -> Chpm<Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let [source, output] = ["mesh.ply", "mesh.chpm"].map(|name| folder.path().join(name));
    write_mesh(File::create(&source).unwrap(), mesh, Encoding::BinaryLittleEndian).unwrap();
    let target_error = target.map(Length::OfDiagonal);
    let config = BuildConfig {
        settings: Settings { cluster_triangles: 32, cell_vertices: 4, target_error, ..Settings::default() },
        resources: Resources { threads: 1, memory: Bytes::mib(256), ..Resources::default() },
        overwrite: false,
    };
    build(&source, &output, &config, &Silent, &Cancel::default()).unwrap();
    Chpm::open(fs::read(output).unwrap()).unwrap()
}

fn options(y_up: bool, span: u32) -> Options {
    let turn = if y_up { Turn::NONE } else { Turn::to_y(2, false) };
    Options {
        generator: "test".to_owned(),
        turn,
        normals: false,
        packed: false,
        transform: None,
        reprojection: None,
        span,
    }
}

fn tree(file: &Chpm<Vec<u8>>) -> Tree {
    Tree::find(file, |_| Ok::<_, ExportError>(())).unwrap()
}

/// All tilesets of a file, by where they lie.
fn written(
    file: &Chpm<Vec<u8>>,
    tree: &Tree,
    options: &Options,
) -> Result<BTreeMap<String, Value>, ExportError> {
    let mut all = BTreeMap::new();
    tilesets(file, tree, options, |tileset| {
        let json = serde_json::from_str(&tileset.json).expect("JSON");
        assert!(all.insert(tileset.path, json).is_none(), "each once");
        Ok::<_, ExportError>(())
    })?;
    Ok(all)
}

/// The root tile; tiles that refer to another tileset are replaced by its root, which says the same.
fn root(file: &Chpm<Vec<u8>>, options: &Options) -> Value {
    let all = written(file, &tree(file), options).unwrap();
    let mut root = all["tileset.json"]["root"].clone();
    let mut outside = 0;
    each(&mut root, &mut |tile| {
        let uri = tile["content"]["uri"].as_str().unwrap_or_default().trim_start_matches("../").to_owned();
        if uri.ends_with(".json") {
            let other = &all[&uri]["root"];
            for name in ["boundingVolume", "geometricError"] {
                assert_eq!(other[name], tile[name], "{uri}");
            }
            *tile = other.clone();
            outside += 1;
        }
    });
    assert_eq!(outside + 1, all.len(), "all are referred to once");
    root
}

/// Every tile, before what is below it.
fn each(tile: &mut Value, visit: &mut impl FnMut(&mut Value)) {
    visit(tile);
    tile["children"].as_array_mut().into_iter().flatten().for_each(|child| each(child, visit));
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("numbers").iter().map(|x| x.as_f64().expect("a number")).collect()
}

/// Which mesh a tile shows: none for the one above several roots.
fn shown(file: &Chpm<Vec<u8>>, tile: &Value) -> Option<(ClusterId, Mesh)> {
    let uri = tile["content"]["uri"].as_str()?.trim_start_matches("../");
    let all = (0..file.clusters().len() as u32).map(ClusterId);
    let meshes = all.flat_map(|cluster| Mesh::of(file, cluster).iter().map(move |mesh| (cluster, *mesh)));
    Some(meshes.into_iter().find(|(cluster, mesh)| tile_path(*cluster, *mesh) == uri).expect("a mesh"))
}

/// The JSON of a GLB, and the places of its vertices where a viewer that has z upward puts them.
fn placed(glb: &[u8]) -> (Value, Vec<[f64; 3]>) {
    let len = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let json: Value = serde_json::from_slice(&glb[20..20 + len]).unwrap();
    let body = &glb[28 + len..];
    let number = |value: &Value| value.as_u64().unwrap_or(0) as usize;
    let accessor = &json["accessors"][number(&json["meshes"][0]["primitives"][0]["attributes"]["POSITION"])];
    let view = &json["bufferViews"][number(&accessor["bufferView"])];
    let (start, stride) = (number(&view["byteOffset"]), number(&view["byteStride"]));
    let matrix = json["nodes"][0].get("matrix").map(numbers);
    let place = |vertex: usize| {
        let at = |axis: usize| {
            let bytes = &body[start + vertex * stride + 4 * axis..][..4];
            f64::from(f32::from_le_bytes(bytes.try_into().unwrap()))
        };
        let own = [at(0), at(1), at(2)];
        let [x, y, z] = match &matrix {
            None => own,
            Some(m) => [0, 1, 2]
                .map(|row| (0..3).map(|column| m[4 * column + row] * own[column]).sum::<f64>() + m[12 + row]),
        };
        // What glTF has upward is y.
        [x, -z, y]
    };
    let places = (0..number(&accessor["count"])).map(place).collect();
    (json, places)
}

/// How far a place is from a box's middle along each of its axes, in halves of them.
fn shares(place: &[f64; 3], volume: &[f64]) -> [f64; 3] {
    [0, 1, 2].map(|side| {
        let way = &volume[3 + 3 * side..][..3];
        let along = |v: &[f64]| v.iter().zip(way).map(|(x, y)| x * y).sum::<f64>();
        let offset: Vec<f64> = place.iter().zip(volume).map(|(x, middle)| x - middle).collect();
        (along(&offset) / along(way)).abs()
    })
}

fn corners(volume: &[f64]) -> [[f64; 3]; 8] {
    std::array::from_fn(|corner| {
        std::array::from_fn(|axis| {
            let sign = |side: usize| if corner >> side & 1 == 0 { -1.0 } else { 1.0 };
            volume[axis] + (0..3).map(|side| sign(side) * volume[3 + 3 * side + axis]).sum::<f64>()
        })
    })
}

fn glb(file: &Chpm<Vec<u8>>, (cluster, mesh): (ClusterId, Mesh), options: &Options) -> (Vec<u8>, u64) {
    tile(file, cluster, mesh, options, None).unwrap()
}

#[test]
fn boxes_hold_what_is_drawn_and_those_below_whatever_is_upward() {
    let whole = built(Shape::Terrain, 1500, None);
    let parts = built(Shape::Terrain, 1500, Some(0.5));
    assert!(whole.roots().count() == 1 && parts.roots().count() > 1);
    for (file, y_up) in [(&whole, false), (&whole, true), (&parts, false), (&parts, true)] {
        let options = options(y_up, 2);
        let mut root = root(file, &options);
        let mut tiles = 0;
        // The boxes of all tiles above.
        fn check(tile: &Value, above: &[Vec<f64>], visit: &mut impl FnMut(&Value, &[Vec<f64>])) {
            let mut boxes = above.to_vec();
            boxes.push(numbers(&tile["boundingVolume"]["box"]));
            visit(tile, &boxes);
            tile["children"].as_array().into_iter().flatten().for_each(|child| check(child, &boxes, visit));
        }
        check(&root.take(), &[], &mut |tile, above| {
            let own = corners(above.last().expect("its own"));
            for volume in above {
                for place in &own {
                    assert!(shares(place, volume).iter().all(|share| *share <= 1.0 + 1e-9), "{volume:?}");
                }
            }
            let Some(which) = shown(file, tile) else { return };
            let (json, places) = placed(&glb(file, which, &options).0);
            assert!(json["meshes"][0].is_object() && !places.is_empty());
            let volume = numbers(&tile["content"]["boundingVolume"]["box"]);
            let mut reached = [0.0_f64; 3];
            for place in &places {
                for volume in above.iter().chain([&volume]) {
                    let shares = shares(place, volume);
                    assert!(
                        shares.iter().all(|share| *share <= 1.0 + 1e-6),
                        "{y_up}, {which:?}: {place:?} and {volume:?}"
                    );
                }
                let shares = shares(place, &volume);
                reached = [0, 1, 2].map(|side| reached[side].max(shares[side]));
            }
            // Nothing less would do for the finest mesh of a leaf.
            if which.1 == Mesh::Finest {
                assert!(reached.iter().all(|share| *share > 1.0 - 1e-6), "{y_up}, {which:?}: {reached:?}");
            }
            tiles += 1;
        });
        let all = (0..file.clusters().len() as u32).map(|id| Mesh::of(file, ClusterId(id)).len());
        assert_eq!(tiles, all.sum::<usize>(), "each mesh is a tile");
    }
}

#[test]
fn errors_fall_and_are_the_same_for_all_of_a_group() {
    let file = built(Shape::Isosurface, 2000, None);
    assert!(file.groups().iter().any(|group| group.coarse_count > 1 && !group.is_leaf()));
    let mut root = root(&file, &options(false, 3));
    let mut by_group = BTreeMap::new();
    each(&mut root, &mut |tile| {
        let (cluster, mesh) = shown(&file, tile).expect("one root");
        let error = tile["geometricError"].as_f64().expect("an error");
        if mesh == Mesh::Finest {
            assert!(error == 0.0 && tile["children"].is_null(), "{cluster:?}");
            return;
        }
        let group = file.clusters()[cluster.index()].group();
        let told = (error, tile["boundingVolume"].clone());
        assert_eq!(by_group.entry(group).or_insert(told.clone()), &told, "{cluster:?}");
        // What is stored, but for a last bit.
        let stored = file.groups()[group.index()].max_error;
        assert!(error as f32 >= stored && error as f32 <= stored * 1.001 + 1e-6, "{error} {stored}");
        for child in tile["children"].as_array().into_iter().flatten() {
            assert!(child["geometricError"].as_f64().expect("an error") < error, "{cluster:?}");
        }
    });
    assert_eq!(by_group.len(), file.groups().len());
}

/// Triangles of a cluster's mesh, by the bits of their corners from the least on.
fn triangles(file: &Chpm<Vec<u8>>, cluster: ClusterId, mesh: Mesh) -> Vec<[[u32; 3]; 3]> {
    let page = file.page(cluster).unwrap();
    let page = page.view();
    let mut local = Vec::new();
    page.progressive_mesh().triangles_at(mesh.position(&page), &mut local);
    let corner = |v: u16| page.positions[usize::from(v)].map(f32::to_bits);
    let turned = |[a, b, c]: [[u32; 3]; 3]| [a, b, c].min([b, c, a]).min([c, a, b]);
    local.iter().map(|corners| turned(corners.map(corner))).collect()
}

#[test]
fn every_cluster_is_a_part_of_one_that_it_covers_with_the_others() {
    let file = built(Shape::Isosurface, 2000, None);
    let tree = tree(&file);
    let mut seen = BTreeSet::new();
    let mut several = 0;

    for parent in (0..file.clusters().len() as u32).map(ClusterId) {
        let record = &file.clusters()[parent.index()];
        let children: Vec<ClusterId> = tree.children(&file, parent).collect();
        several += u32::from(file.groups()[record.group().index()].coarse_count > 1 && !children.is_empty());
        assert_eq!(children.is_empty(), record.is_leaf(), "{parent:?}");

        for child in &children {
            assert_eq!(file.clusters()[child.index()].parent_group(), record.group());
            assert!(seen.insert(child.0), "{child:?} is a part of one alone");
        }

        if !children.is_empty() {
            let mut below: Vec<_> =
                children.iter().flat_map(|child| triangles(&file, *child, Mesh::Base)).collect();
            let mut finest = triangles(&file, parent, Mesh::Finest);
            below.sort_unstable();
            finest.sort_unstable();
            assert_eq!(below, finest, "{parent:?}");
        }
    }
    assert_eq!(seen.len() + file.roots().count(), file.clusters().len());
    assert!(several > 3, "{several} of groups with several members");
}

#[test]
fn a_tile_has_the_mesh_and_the_bounds_of_its_cluster() {
    let file = built(Shape::Isosurface, 1500, None);
    let mut gaps = 0;

    for cluster in (0..file.clusters().len() as u32).map(ClusterId) {
        for mesh in Mesh::of(&file, cluster) {
            let (bytes, count) = glb(&file, (cluster, *mesh), &options(true, 8));
            let (json, places) = placed(&bytes);
            let own = triangles(&file, cluster, *mesh);
            assert_eq!(count as usize, own.len(), "{cluster:?}");
            let indices = &json["accessors"]
                [json["meshes"][0]["primitives"][0]["indices"].as_u64().unwrap_or(0) as usize];
            assert_eq!(indices["count"], 3 * own.len());
            // Vertices that no triangle uses are left out.
            let used: BTreeSet<_> = own
                .as_flattened()
                .iter()
                .map(|corner| corner.map(f32::from_bits))
                .map(|[x, y, z]| [x, -z, y])
                .map(|p| p.map(|x| (x + 0.0).to_bits()))
                .collect();
            let there: BTreeSet<_> = places.iter().map(|p| p.map(|x| (x as f32 + 0.0).to_bits())).collect();
            assert_eq!(there, used, "{cluster:?}");

            let page = file.page(cluster).unwrap();
            let page = page.view();
            let error = page.error_at(mesh.position(&page));
            let distance = file.gaps(file.clusters()[cluster.index()].group()).distance(error);
            let extras = &json["meshes"][0]["extras"];
            assert_eq!(extras["cluster"], cluster.0);
            // To the last bit of a single: a reader of JSON may be wrong by that of a double.
            let told = ["error", "distance"].map(|name| extras[name].as_f64().map(|x| x as f32));
            assert_eq!(told, [Some(error), Some(distance)]);
            assert_eq!(extras["certified"], true);
            gaps += u32::from(distance > error);
            // Packed, it is the same mesh in other bytes.
            let (packed, again) = glb(&file, (cluster, *mesh), &Options { packed: true, ..options(true, 8) });
            assert_eq!(again, count);
            assert!(packed.windows(7).any(|word| word == b"meshopt") || count == 0);
        }
    }
    assert!(gaps > 0, "something has vanished");
}

#[test]
fn the_origin_comes_before_what_was_asked_for() {
    let mesh = TriMesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]);
    let folder = tempfile::tempdir().unwrap();
    let [source, output] = ["far.obj", "far.chpm"].map(|name| folder.path().join(name));
    let text: String = mesh
        .positions
        .iter()
        .map(|p| format!("v {} {} {}\n", p[0] + 1000.1, p[1] + 2000.0, p[2] - 300.0))
        .collect();
    fs::write(&source, text + "f 1 2 3\n").unwrap();
    build(&source, &output, &BuildConfig::default(), &Silent, &Cancel::default()).unwrap();
    let file = Chpm::open(fs::read(output).unwrap()).unwrap();
    let [x, y, z] = file.header().origin;
    assert!(x != 0.0, "an origin");
    let tree = tree(&file);
    let transform = |options: &Options| {
        numbers(&written(&file, &tree, options).unwrap()["tileset.json"]["root"]["transform"])
    };
    let moved = |to: [f64; 3]| {
        vec![1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, to[0], to[1], to[2], 1.0]
    };
    let near = |got: &[f64], expected: &[f64]| {
        assert!(got.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{got:?} {expected:?}");
    };
    near(&transform(&options(false, 8)), &moved([x, y, z]));
    near(&transform(&options(true, 8)), &moved([x, -z, y]));
    // Turned by a quarter about z, and moved.
    let mut world = [0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 5.0, 6.0, 7.0, 1.0];
    let turned = |world| Options { transform: Some(world), ..options(false, 8) };
    near(&transform(&turned(world))[..12], &world[..12]);
    near(&transform(&turned(world))[12..], &[5.0 - y, 6.0 + x, 7.0 + z, 1.0]);
    world[12] = f64::MAX;
    world[4] = -f64::MAX;
    let refused = written(&file, &tree, &turned(world));
    assert!(matches!(refused, Err(ExportError::Transform { .. })), "no numbers for that");
}

#[test]
fn a_file_ends_where_its_span_of_levels_does() {
    let file = built(Shape::Terrain, 1500, None);
    let tree = tree(&file);
    let level = |id: ClusterId| file.clusters()[id.index()].level;
    for span in [1, 2, 3, 32] {
        let is_apart = |above: ClusterId, below: ClusterId| level(above) / span != level(below) / span;
        let all = (0..file.clusters().len() as u32).map(ClusterId);
        let apart: usize =
            all.map(|id| tree.children(&file, id).filter(|child| is_apart(id, *child)).count()).sum();
        assert_eq!(written(&file, &tree, &options(false, span)).unwrap().len(), 1 + apart, "{span}");
    }
}

#[test]
fn boxes_of_flat_models_have_three_axes_in_single_precision() {
    let file = built_of(&hand::grid(12, 12), None);
    let mut root = root(&file, &options(false, 32));
    each(&mut root, &mut |tile| {
        for way in numbers(&tile["content"]["boundingVolume"]["box"])[3..].chunks(3) {
            assert!(way.iter().any(|x| (*x as f32).abs() > 1e-9), "{way:?}");
        }
    });
}

#[test]
fn a_tile_of_nothing_is_never_packed() {
    let placement = options(false, 1).placement();
    let facts = Facts {
        generator: "test".to_owned(),
        placement,
        levels: vec![Level::default()],
        scalars: Vec::new(),
        grid: None,
    };
    let of = |packed| content(&facts, Attributes::default(), &TriMesh::default(), packed).unwrap();
    assert_eq!(of(true), of(false));
}

/// Normals of a tile's vertices, by place.
fn normals(glb: &[u8]) -> BTreeMap<[u32; 3], BTreeSet<[u32; 3]>> {
    let len = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let json: Value = serde_json::from_slice(&glb[20..20 + len]).unwrap();
    let count = json["accessors"][0]["count"].as_u64().unwrap() as usize;
    assert_eq!(json["bufferViews"][0]["byteStride"], 24, "a place and a normal");
    let vertices = bytemuck::pod_collect_to_vec::<u8, [[u32; 3]; 2]>(&glb[28 + len..][..24 * count]);
    let mut all = BTreeMap::new();
    for [place, normal] in vertices {
        let length = normal.map(f32::from_bits).iter().map(|x| x * x).sum::<f32>();
        assert!((length - 1.0).abs() < 1e-5, "{length}");
        all.entry(place).or_insert_with(BTreeSet::new).insert(normal);
    }
    all
}

/// Places of a cluster's shared vertices.
fn shared_places(file: &Chpm<Vec<u8>>, cluster: ClusterId) -> BTreeSet<[u32; 3]> {
    let page = file.page(cluster).unwrap();
    let page = page.view();
    let is_shared = |v: &usize| page.shared_bits[v / 8] >> (v % 8) & 1 == 1;
    (0..page.vertex_count()).filter(is_shared).map(|v| page.positions[v].map(f32::to_bits)).collect()
}

#[test]
fn tiles_of_any_cut_have_the_same_normal_where_they_meet() {
    let file = built(Shape::Isosurface, 3000, None);
    let options = Options { normals: true, ..options(false, 8) };
    let shared = SharedNormals::find(&file, |_| Ok::<_, ExportError>(())).unwrap();
    let of = |cluster, mesh| normals(&tile(&file, cluster, mesh, &options, Some(&shared)).unwrap().0);
    let (mut met, mut levels) =
        (BTreeMap::<[u32; 3], BTreeSet<[u32; 3]>>::new(), BTreeMap::<_, BTreeSet<_>>::new());
    for cluster in (0..file.clusters().len() as u32).map(ClusterId) {
        let border = shared_places(&file, cluster);
        for mesh in Mesh::of(&file, cluster) {
            for (place, normals) in of(cluster, *mesh).into_iter().filter(|(place, _)| border.contains(place))
            {
                met.entry(place).or_default().extend(normals);
                levels.entry(place).or_default().insert(file.clusters()[cluster.index()].level);
            }
        }
    }
    assert!(met.len() > 100 && met.values().all(|normals| normals.len() == 1), "one normal at each place");
    assert!(levels.values().filter(|levels| levels.len() > 1).count() > 50, "on several levels");
}

/// At every vertex of the finest meshes, and of coarser ones where tiles meet: these keep the source's normals.
#[test]
fn normals_point_as_the_surface_does() {
    let file = built(Shape::Sphere, 3000, None);
    let options = Options { normals: true, ..options(false, 8) };
    let shared = SharedNormals::find(&file, |_| Ok::<_, ExportError>(())).unwrap();
    let middle: [f64; 3] = file.header().aabb().center().into();
    let mut coarse = 0;

    for cluster in (0..file.clusters().len() as u32).map(ClusterId) {
        let border = shared_places(&file, cluster);
        for mesh in Mesh::of(&file, cluster) {
            let all = normals(&tile(&file, cluster, *mesh, &options, Some(&shared)).unwrap().0);
            for (place, normals) in all {
                if *mesh == Mesh::Base && !border.contains(&place) {
                    continue;
                }
                coarse += u32::from(*mesh == Mesh::Base);
                let away = [0, 1, 2].map(|axis| f64::from(f32::from_bits(place[axis])) - middle[axis]);
                let length = away.iter().map(|x| x * x).sum::<f64>().sqrt();
                for normal in normals.iter().map(|normal| normal.map(|x| f64::from(f32::from_bits(x)))) {
                    let along = (0..3).map(|axis| normal[axis] * away[axis]).sum::<f64>() / length;
                    assert!(along > 0.97, "{cluster:?} {mesh:?}: {along}");
                }
            }
        }
    }
    assert!(coarse > 1000, "{coarse}");
}
