//! OFF as text, beside `off-rs`.

use super::{Face, Fixture, assert_same, fixtures, ours, single};
use off_rs::geometry::mesh::Mesh;
use off_rs::parser::color_format::ColorFormat;
use off_rs::parser::options::{Limits, Options};
use std::fmt::Write;

/// How an OFF is written.
#[derive(Clone, Copy, Debug)]
struct Style {
    has_edges: bool,
    has_comments: bool,
    has_face_colors: bool,
    end: &'static str,
}

const STYLES: [Style; 3] = [
    Style { has_edges: true, has_comments: false, has_face_colors: false, end: "\n" },
    Style { has_edges: false, has_comments: true, has_face_colors: false, end: "\n" },
    Style { has_edges: true, has_comments: true, has_face_colors: true, end: "\r\n" },
];

fn write(fixture: &Fixture, style: &Style) -> String {
    let Style { has_edges, has_comments, has_face_colors, end } = *style;
    let comment = if has_comments { format!("# by hand{end}{end}") } else { String::new() };
    let edges = if has_edges { " 0" } else { "" };
    let color = if has_face_colors { " 255 0 128" } else { "" };
    let (points, faces) = (fixture.points.len(), fixture.faces.len());
    let mut text = format!("OFF{end}{comment}{points} {faces}{edges}{end}");
    for [x, y, z] in &fixture.points {
        write!(text, "{x} {y:e}   {z}{end}").unwrap();
    }
    text += &comment;
    for face in &fixture.faces {
        let corners: Vec<String> = face.iter().map(u32::to_string).collect();
        write!(text, "{}  {}{color}{end}", face.len(), corners.join(" ")).unwrap();
    }
    text
}

fn faces_of(mesh: &Mesh) -> Vec<Face> {
    let place = |vertex: &usize| {
        let place = mesh.vertices[*vertex].position;
        [place.x, place.y, place.z].map(f64::from)
    };
    mesh.faces.iter().map(|face| face.vertices.iter().map(place).collect()).collect()
}

#[test]
fn off_rs_reads_the_same_off() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.off");
    for fixture in fixtures() {
        for style in STYLES {
            let text = write(&fixture, &style);
            std::fs::write(&path, &text).unwrap();
            let options = Options { limits: Limits::MAX, color_format: ColorFormat::RGBInteger };
            let theirs = off_rs::parse(&text, options).unwrap();
            // It has single precision.
            let [ours, theirs, written] = [ours(&path), faces_of(&theirs), fixture.corners()].map(single);
            assert_same(&format!("{style:?}"), fixture.name, ours, theirs, written);
        }
    }
}
