//! glTF, written front to back each level as one mesh that is welded throughout.

use crate::container::Container;
use crate::error::{ExportError, expect};
use crate::gltf::{Facts, Part, document, padded};
use crate::vertex::Interleave;
use chpm_mesh::{Aabb, Attributes, VertexSlices};
use std::io::Write;

/// How large a mesh is, and where.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Extent {
    /// Its vertices.
    pub vertices: u64,
    /// Its triangles.
    pub triangles: u64,
    /// The box around the vertices, exactly; the format asks for it.
    pub bounds: Aabb,
}

/// Writes the vertices and then the triangles of each level.
pub struct GlbWriter<W: Write> {
    container: Container<W>,
    buffer: Vec<u8>,
    interleave: Interleave,
    levels: Vec<Part>,
    /// The level that is written, and how much of it is.
    level: usize,
    vertices: u64,
    triangles: u64,
}

impl<W: Write> GlbWriter<W> {
    /// Writes all that is in front of the vertices, for a mesh of such an extent at each level.
    ///
    /// # Errors
    /// [`ExportError::Count`] for other levels than the facts are of; [`ExportError::TooLarge`] beyond the 4 GiB that a GLB may have;
    /// [`ExportError::Write`].
    pub fn new(
        mut container: Container<W>,
        facts: &Facts,
        attributes: Attributes,
        extents: &[Extent],
    ) -> Result<Self, ExportError> {
        expect("levels", facts.levels.len() as u64, extents.len() as u64)?;
        let part = |extent: &Extent| Part {
            vertices: extent.vertices,
            triangles: extent.triangles,
            low: extent.bounds.min,
            high: extent.bounds.max,
            packed: None,
        };
        let levels: Vec<Part> = extents.iter().map(part).collect();
        let shown = |part: &Part| if part.triangles > 0 { vec![*part] } else { Vec::new() };
        let (root, body) = document(facts, attributes, &levels.iter().map(shown).collect::<Vec<_>>());
        container.begin(root, body)?;
        let interleave = Interleave::new(attributes, &facts.scalars, facts.grid);
        let (buffer, level, vertices, triangles) = (Vec::new(), 0, 0, 0);
        Ok(GlbWriter { container, buffer, interleave, levels, level, vertices, triangles })
    }

    /// The level that is written; behind the last one nothing is expected.
    fn part(&self) -> Part {
        let nothing = Part { vertices: 0, triangles: 0, low: [0.0; 3], high: [0.0; 3], packed: None };
        self.levels.get(self.level).copied().unwrap_or(nothing)
    }

    /// Writes vertices.
    ///
    /// # Errors
    /// [`ExportError::Count`] for more than were announced; [`ExportError::Write`].
    pub fn vertices(&mut self, vertices: VertexSlices<'_>) -> Result<(), ExportError> {
        self.vertices += vertices.positions.len() as u64;
        let announced = self.part().vertices;
        if self.vertices > announced {
            return expect("vertices", announced, self.vertices);
        }
        self.interleave.append(vertices, &mut self.buffer);
        self.flush()
    }

    /// Writes triangles, after all vertices of the level.
    ///
    /// # Errors
    /// As [`GlbWriter::vertices`].
    pub fn triangles(&mut self, triangles: &[[u32; 3]]) -> Result<(), ExportError> {
        let part = self.part();
        expect("vertices", part.vertices, self.vertices)?;
        self.triangles += triangles.len() as u64;
        if self.triangles > part.triangles {
            return expect("triangles", part.triangles, self.triangles);
        }
        let corners = triangles.as_flattened();
        match part.index_len() {
            2 => self.buffer.extend(corners.iter().flat_map(|v| (*v as u16).to_le_bytes())),
            _ => self.buffer.extend(corners.iter().flat_map(|v| v.to_le_bytes())),
        }
        self.flush()
    }

    /// Goes on to the next level.
    ///
    /// # Errors
    /// [`ExportError::Count`] if something is missing; [`ExportError::Write`].
    pub fn next_level(&mut self) -> Result<(), ExportError> {
        let part = self.part();
        expect("vertices", part.vertices, self.vertices)?;
        expect("triangles", part.triangles, self.triangles)?;
        let len = 3 * self.triangles * part.index_len();
        self.buffer.resize((padded(len) - len) as usize, 0);
        (self.level, self.vertices, self.triangles) = (self.level + 1, 0, 0);
        self.flush()
    }

    /// Ends the file and gives the output back.
    ///
    /// # Errors
    /// As [`GlbWriter::next_level`].
    pub fn finish(mut self) -> Result<Container<W>, ExportError> {
        self.next_level()?;
        expect("levels", self.levels.len() as u64, self.level as u64)?;
        self.container.finish()
    }

    fn flush(&mut self) -> Result<(), ExportError> {
        self.container.write(&self.buffer)?;
        self.buffer.clear();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Level, PackedGlb, Placement};
    use chpm_mesh::{Scalar, ScalarKind};
    use serde_json::{Map, Value};

    fn facts(placement: Placement) -> Facts {
        let extras = Map::from_iter([("error".to_owned(), 0.5.into())]);
        let levels = vec![Level { extras, coverage: 0.0 }];
        Facts { generator: "test".to_owned(), placement, levels, scalars: Vec::new(), grid: None }
    }

    fn extent(vertices: u64, triangles: u64, bounds: Aabb) -> Extent {
        Extent { vertices, triangles, bounds }
    }

    fn json(glb: &[u8]) -> Value {
        let len = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
        assert_eq!((&glb[..4], &glb[16..20], len % 4), (&b"glTF"[..], &b"JSON"[..], 0));
        serde_json::from_slice(&glb[20..20 + len]).unwrap()
    }

    #[test]
    fn nothing_is_a_node_without_a_mesh() {
        let empty = GlbWriter::new(
            Container::Glb(Vec::new()),
            &facts(Placement::HERE),
            Attributes::ALL,
            &[extent(0, 0, Aabb::EMPTY)],
        );
        let bytes = empty.unwrap().finish().unwrap().into_main();
        let text = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        assert_eq!(bytes.len(), 20 + text, "no chunk of nothing");
        let empty = json(&bytes);
        let packed =
            PackedGlb::new(facts(Placement::HERE), Attributes::ALL).begin(Container::Glb(Vec::new()));
        assert_eq!(json(&packed.unwrap().finish().unwrap().into_main()), empty);
        assert_eq!((&empty["nodes"][0]["extras"]["error"], empty.get("meshes")), (&0.5.into(), None));
    }

    #[test]
    fn scalars_are_attributes_of_their_own() {
        let kinds = [("my quality", ScalarKind::Float32), ("My_Quality", ScalarKind::Float64)];
        let scalars = kinds.map(|(name, kind)| Scalar::new(name, kind)).to_vec();
        let mut words = Vec::new();
        for values in [[0.5, 1e300], [f64::NAN, -0.1], [-2.0, f64::NEG_INFINITY]] {
            scalars.iter().zip(values).for_each(|(scalar, value)| scalar.kind.put(value, &mut words));
        }
        let facts = Facts { scalars, ..facts(Placement::HERE) };
        let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let attributes = Attributes { scalar_words: 3, ..Attributes::NONE };
        let bounds = Aabb::of_points(&positions);
        let mut glb =
            GlbWriter::new(Container::Glb(Vec::new()), &facts, attributes, &[extent(3, 1, bounds)]).unwrap();
        glb.vertices(VertexSlices { scalars: &words, ..VertexSlices::new(&positions) }).unwrap();
        glb.triangles(&[[0, 1, 2]]).unwrap();
        let bytes = glb.finish().unwrap().into_main();
        let json = json(&bytes);
        let attributes = &json["meshes"][0]["primitives"][0]["attributes"];
        let accessor = |name: &str| &json["accessors"][attributes[name].as_u64().unwrap() as usize];
        let position = accessor("POSITION");
        let box_of = serde_json::json!([[0.0, 0.0, 0.0], [1.0, 1.0, 0.0]]);
        assert_eq!((&position["min"], &position["max"]), (&box_of[0], &box_of[1]));
        let [first, second] = ["_MY_QUALITY", "_MY_QUALITY_2"].map(accessor);
        assert_eq!((&first["byteOffset"], &second["byteOffset"]), (&12.into(), &16.into()));
        assert_eq!((&first["type"], &json["bufferViews"][0]["byteStride"]), (&"SCALAR".into(), &20.into()));
        let start = bytes.len() - 8 - 60;
        let value = |vertex: usize, at| {
            f32::from_le_bytes(bytes[start + 20 * vertex + at..][..4].try_into().unwrap())
        };
        assert_eq!([0, 1, 2].map(|vertex| value(vertex, 12)), [0.5, 0.0, -2.0]);
        assert_eq!([0, 1, 2].map(|vertex| value(vertex, 16)), [f32::MAX, -0.1, -f32::MAX]);
    }

    #[test]
    fn what_no_glb_can_hold_is_refused_before_a_byte() {
        let mut out = Vec::new();
        let bounds = Aabb { min: [0.0; 3], max: [1.0; 3] };
        let new = |out: &mut Vec<u8>, vertices, triangles| {
            GlbWriter::new(
                Container::Glb(out),
                &facts(Placement::HERE),
                Attributes::NONE,
                &[extent(vertices, triangles, bounds)],
            )
            .map(drop)
        };
        // 12 bytes a vertex and 12 a triangle.
        new(&mut out, 119_000_000, 238_000_000).unwrap();
        out.clear();
        let error = new(&mut out, 120_000_000, 240_000_000).unwrap_err().to_string();
        assert!(error.contains("4294967295 bytes") && error.contains("PLY") && out.is_empty(), "{error}");
    }

    #[test]
    fn indices_are_as_short_as_they_can_be_and_lengths_even_out() {
        let bounds = Aabb { min: [0.0; 3], max: [0.0; 3] };
        for (vertices, component, len) in [(65_535_u64, 5123, 8), (65_536, 5125, 12)] {
            let placement = Placement { origin: [1e7, 0.1, -3.0], ..Placement::HERE };
            let mut glb = GlbWriter::new(
                Container::Glb(Vec::new()),
                &facts(placement),
                Attributes::NONE,
                &[extent(vertices, 1, bounds)],
            )
            .unwrap();
            assert!(matches!(glb.triangles(&[[0; 3]]), Err(ExportError::Count { what: "vertices", .. })));
            glb.vertices(VertexSlices::new(&vec![[0.0; 3]; vertices as usize])).unwrap();
            glb.triangles(&[[0; 3]]).unwrap();
            let bytes = glb.finish().unwrap().into_main();
            let json = json(&bytes);
            assert_eq!(u32::from_le_bytes(bytes[8..12].try_into().unwrap()) as usize, bytes.len());
            assert_eq!(json["accessors"][1]["componentType"], component);
            assert_eq!(json["buffers"][0]["byteLength"], 12 * vertices + len);
            assert_eq!(json["nodes"][0]["translation"], serde_json::json!([1e7, 0.1, -3.0]));
        }
    }

    #[test]
    fn levels_lie_one_after_the_other_in_one_buffer() {
        let mut facts = facts(Placement::HERE);
        facts.levels = vec![Level::default(); 3];
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]];
        let of = |vertices: usize, triangles| {
            extent(vertices as u64, triangles, Aabb::of_points(&corners[..vertices]))
        };
        let extents = [of(4, 3), of(4, 1), of(3, 1)];
        let mut glb = GlbWriter::new(Container::Glb(Vec::new()), &facts, Attributes::NONE, &extents).unwrap();
        let all = [[0, 1, 2], [0, 2, 3], [0, 3, 1]];
        for (number, Extent { vertices, triangles, .. }) in extents.iter().enumerate() {
            if number > 0 {
                glb.next_level().unwrap();
            }
            glb.vertices(VertexSlices::new(&corners[..*vertices as usize])).unwrap();
            glb.triangles(&all[..*triangles as usize]).unwrap();
        }
        assert!(matches!(glb.triangles(&all), Err(ExportError::Count { what: "triangles", .. })));

        let bytes = {
            let (root, body) = document(
                &facts,
                Attributes::NONE,
                &extents.map(|Extent { vertices, triangles, bounds }| {
                    vec![Part { vertices, triangles, low: bounds.min, high: bounds.max, packed: None }]
                }),
            );
            // Indices of one triangle are padded.
            assert_eq!(body, (48 + 20) + (48 + 8) + (36 + 8));
            root
        };
        let views = bytes["bufferViews"].as_array().unwrap();
        let offsets: Vec<_> = views.iter().map(|view| view["byteOffset"].as_u64().unwrap()).collect();
        assert_eq!(offsets, [0, 48, 68, 116, 124, 160]);
        let accessor = |level: usize| {
            let position = &bytes["meshes"][level]["primitives"][0]["attributes"]["POSITION"];
            &bytes["accessors"][position.as_u64().unwrap() as usize]
        };
        assert_eq!((&accessor(0)["max"][2], &accessor(2)["max"][2]), (&3.0.into(), &0.0.into()));
        assert!(matches!(
            GlbWriter::new(Container::Glb(Vec::new()), &facts, Attributes::NONE, &extents[..2]),
            Err(ExportError::Count { what: "levels", .. })
        ));
    }
}
