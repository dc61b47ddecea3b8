//! Named scalars: each vertex of every level has the bits that its source vertex has.

use crate::resume::eager;
use crate::site::{ChpmFile, Site, config};
use chpm_build::config::{Length, Normals};
use chpm_build::{BuildConfig, BuildError, Cancel, FailPoints, Keep, Silent};
use chpm_format::same;
use chpm_import::ply::{Encoding, PlyWriter};
use chpm_mesh::{Attributes, Bytes, Level, Scalar, ScalarKind, ScalarRange, TriMesh, VertexSlices};
use chpm_refine::{Cut, extract};
use chpm_synth::{Shape, Synth};
use std::collections::BTreeSet;
use std::fs::{self, File};

const KEPT: [(&str, ScalarKind); 4] = [
    ("quality", ScalarKind::Float32),
    ("time", ScalarKind::Float64),
    ("class", ScalarKind::Uint8),
    ("number", ScalarKind::Int32),
];

/// A mesh with a row of words for each vertex; some numbers are none, each with bits of its own.
fn source(triangles: u64) -> (TriMesh, Vec<Scalar>) {
    let mut mesh = Synth::new(Shape::Terrain, triangles, 3).to_mesh();
    let scalars = KEPT.map(|(name, kind)| Scalar::new(name, kind)).to_vec();
    for vertex in 0..mesh.positions.len() as u32 {
        let number = f64::from(vertex);
        let values = [number * 0.25 - 7.0, number.sqrt(), f64::from(vertex % 251), 7.0 - number];
        KEPT.iter().zip(values).for_each(|((_, kind), value)| kind.put(value, &mut mesh.vertices.scalars));
        if vertex % 10 == 3 {
            let row = mesh.scalars.len() - 6;
            mesh.scalars[row] = 0x7f80_0001 + vertex;
        }
    }
    (mesh, scalars)
}

fn site(mesh: &TriMesh, scalars: &[Scalar], encoding: Encoding) -> Site {
    let site = Site::empty();
    let (vertices, triangles) = (mesh.positions.len() as u64, mesh.triangles.len() as u64);
    let file = File::create(site.source()).unwrap();
    let (attributes, double) = (mesh.attributes(), encoding == Encoding::Ascii);
    let mut ply =
        PlyWriter::with_scalars(file, encoding, vertices, triangles, attributes, scalars, double, &[])
            .unwrap();
    ply.vertices(mesh.view()).unwrap();
    ply.triangles(&mesh.triangles).unwrap();
    ply.finish().unwrap();
    site
}

fn keeping(cluster_triangles: u32) -> BuildConfig {
    let mut config = config(cluster_triangles);
    config.settings.scalars = Keep { all: true, names: Vec::new() };
    config
}

type Bits = ([u32; 3], Vec<u32>);

fn bits(vertices: VertexSlices<'_>) -> Vec<Bits> {
    let of = |v: usize| (vertices.positions[v].map(f32::to_bits), vertices.scalars_of(v).to_vec());
    let mut all: Vec<Bits> = (0..vertices.positions.len()).map(of).collect();
    all.sort();
    all
}

/// Level 0 has the source's vertices, and every other level some of them.
fn holds(file: &ChpmFile, mesh: &TriMesh) {
    let expected = bits(mesh.view());
    let known: BTreeSet<&Bits> = expected.iter().collect();
    assert!(file.levels().len() > 3, "{} levels", file.levels().len());
    for level in 0..file.levels().len() as u32 {
        let cut = extract(file, &Cut::at_level(file, Level(level))).unwrap();
        assert_eq!(cut.attributes().scalar_words, 6);
        let found = bits(cut.view());
        assert!(found.iter().all(|vertex| known.contains(vertex)), "level {level}");
        assert!(level > 0 || found == expected, "every vertex has its own");
    }
    let coarsest = extract(file, &Cut::at_error(file, f32::MAX).unwrap()).unwrap();
    assert!(bits(coarsest.view()).iter().all(|vertex| known.contains(vertex)));
}

#[test]
fn every_level_has_the_bits_of_the_source() {
    let (mesh, scalars) = source(20_000);
    for encoding in [Encoding::BinaryLittleEndian, Encoding::BinaryBigEndian] {
        let site = site(&mesh, &scalars, encoding);
        // So small that there are several regions.
        let (_, raw) = site.build(&keeping(64));
        holds(&raw, &mesh);
        let count = mesh.positions.len() as u64;
        let range = ScalarRange { low: 8.0 - count as f64, high: 7.0, count };
        assert_eq!(raw.scalars()[3], Scalar { range, ..scalars[3].clone() });
        let numbers = (0..count).filter(|vertex| vertex % 10 != 3).count() as u64;
        assert_eq!(raw.scalars()[0].range.count, numbers);

        let mut config = keeping(64);
        (config.settings.packed, config.settings.normals) = (true, Normals::Computed);
        let (_, packed) = site.build(&config);
        holds(&packed, &mesh);
        config.settings.normals = Normals::None;
        let (_, packed) = site.build(&config);
        config.settings.packed = false;
        let differences = same::compare(&site.build(&config).1, &packed, || ()).unwrap();
        assert_eq!(differences.told, [""; 0]);
    }
}

#[test]
fn resources_do_not_show_in_scalars() {
    let (mesh, scalars) = source(12_000);
    // As text, so that positions are doubles on the way.
    for encoding in [Encoding::BinaryLittleEndian, Encoding::Ascii] {
        let mut mesh = mesh.clone();
        if encoding == Encoding::Ascii {
            // Text knows one number that is none.
            let quality = mesh.vertices.scalars.iter_mut().step_by(6);
            quality.filter(|word| f32::from_bits(**word).is_nan()).for_each(|word| *word = 0x7fc0_0000);
        }
        let site = site(&mesh, &scalars, encoding);
        let (_, first) = site.bytes(&keeping(64));
        for (threads, memory) in [(1, 0), (4, 1 << 16), (3, 1 << 30)] {
            let mut config = keeping(64);
            (config.resources.threads, config.resources.memory) = (threads, Bytes(memory));
            assert!(site.bytes(&config).1 == first, "{encoding}, {threads} threads, {memory} bytes");
        }
    }
}

#[test]
fn a_killed_build_goes_on_with_its_scalars() {
    let (mesh, scalars) = source(4_000);
    let site = site(&mesh, &scalars, Encoding::BinaryLittleEndian);
    let mut config = eager(1);
    config.settings = keeping(64).settings;
    config.settings.min_component = Some(Length::OfDiagonal(0.1));
    let (_, whole) = site.bytes(&config);
    let mut resumed = 0;
    for at in (5..).step_by(97) {
        let mut faulty = config.clone();
        faulty.resources.fail_points = FailPoints::fail_at(at, false);
        if site.try_build(&faulty, &Silent, &Cancel::default()).is_ok() {
            break;
        }
        let (report, bytes) = site.bytes(&config);
        assert!(bytes == whole, "after access {at}");
        resumed += u32::from(report.resumed.is_some());
    }
    assert!(resumed > 5, "{resumed}");
}

#[test]
fn without_them_the_file_is_as_it_was_and_names_are_looked_for() {
    let (mesh, scalars) = source(2_000);
    let with = site(&mesh, &scalars, Encoding::BinaryLittleEndian);
    let bare = TriMesh::new(mesh.positions.clone(), mesh.triangles.clone());
    let (_, plain) = with.build(&config(256));
    assert_eq!((plain.header().version_minor, plain.scalars().len()), (3, 0));
    let (_, other) = Site::of(&bare).build(&config(256));
    assert_eq!(same::compare(&plain, &other, || ()).unwrap().told, [""; 0]);

    let named = |name: &str| {
        let mut config = config(256);
        config.settings.scalars.names = vec![name.to_owned()];
        config
    };
    let (_, one) = with.build(&named("time"));
    assert_eq!((one.header().version_minor, one.header().required_flags), (4, 4));
    assert_eq!((one.scalars().len(), &*one.scalars()[0].name), (1, "time"));
    assert_eq!(one.header().attributes(), Attributes { scalar_words: 2, ..Attributes::NONE });
    let error = with.try_build(&named("rainbow"), &Silent, &Cancel::default()).unwrap_err().to_string();
    assert!(
        error.contains("mesh.ply: no scalar 'rainbow' to keep; vertices of this file have quality, time"),
        "{error}"
    );
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    fs::write(with.source(), text).unwrap();
    let refused = with.try_build(&named("time"), &Silent, &Cancel::default()).unwrap_err();
    assert!(matches!(&refused, BuildError::NoScalar { name, .. } if name == "time"), "{refused}");
    with.build(&keeping(256));
}
