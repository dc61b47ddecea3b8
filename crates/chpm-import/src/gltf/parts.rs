//! Parts of a glTF that are to be read: vertices and triangles of its meshes, and where each mesh stands.

use super::accessor::Elements;
use super::coats::{Coat, Coats};
use super::document::{Document, Mesh, Primitive, Shape, entry, refused};
use super::scene::{Instance, Placement, instances};
use super::views::Views;
use crate::batch::MAX_VERTICES;
use crate::error::ImportError;
use crate::location::SourceLocation;
use crate::options::Options;
use crate::vertex_format::{Coordinates, VertexFormat};
use chpm_mesh::Attributes;
use std::collections::BTreeMap;

/// Everything that will be read.
pub(super) struct Parts {
    /// By number of the mesh; empty for those that are not drawn.
    meshes: Vec<Part>,
    pub(super) instances: Vec<Instance>,
    pub(super) format: VertexFormat,
    /// Vertices and faces of all instances, as the file says it.
    pub(super) vertices: u64,
    pub(super) faces: u64,
    pub(super) warnings: Vec<String>,
}

/// A mesh: primitives may have vertices in common.
#[derive(Default)]
struct Part {
    sets: Vec<VertexSet>,
    primitives: Vec<Triangles>,
    vertices: u64,
}

/// Vertices of one or more primitives.
pub(super) struct VertexSet {
    pub(super) positions: Elements,
    pub(super) normals: Option<Elements>,
    pub(super) colors: Option<Elements>,
    pub(super) coordinates: Option<Elements>,
    /// Whether the file calls these integers no shares.
    has_whole_colors: bool,
    /// Vertices of the mesh before these.
    first: u64,
}

/// Triangles of a primitive.
pub(super) struct Triangles {
    set: usize,
    /// None where vertices are taken in their order.
    pub(super) indices: Option<Elements>,
    pub(super) mode: Mode,
    /// Corners, by index or not.
    pub(super) corners: u64,
    pub(super) coat: Option<Coat>,
}

/// How corners make triangles.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Mode {
    Triangles,
    Strip,
    Fan,
}

/// Vertices at their place.
pub(super) struct Placed<'a> {
    pub(super) set: &'a VertexSet,
    pub(super) placement: &'a Placement,
    /// Vertices of the whole scene before these.
    pub(super) first: u64,
}

/// How much there is that does not reach the mesh.
#[derive(Default)]
struct LeftOut {
    lines_and_points: u64,
    morphs: u64,
    textures: u64,
    bare: u64,
    whole_colors: u64,
    bad_coordinates: u64,
    loose_corners: u64,
    primitives: u64,
    with_normals: u64,
    with_colors: u64,
}

impl Parts {
    /// Goes through the scene and finds the bytes of all that it draws.
    pub(super) fn new(
        document: &Document,
        views: &mut Views<'_>,
        options: &Options,
        coats: Option<&Coats>,
    ) -> Result<Parts, ImportError> {
        let (mut instances, mut warnings) = instances(document)?;
        let mut meshes = Vec::new();
        meshes.resize_with(document.meshes.len(), || None);
        let mut left_out = LeftOut::default();
        for Instance { mesh, .. } in &instances {
            let found = entry(&document.meshes, *mesh, "mesh")?;
            let part = &mut meshes[*mesh as usize];
            if part.is_none() {
                *part = Some(Part::new(found, document, views, (options, coats), &mut left_out)?);
            }
        }
        let mut meshes: Vec<Part> = meshes.into_iter().map(Option::unwrap_or_default).collect();
        // Where nothing is drawn, no number of nodes costs time.
        instances.retain(|instance| meshes[instance.mesh as usize].vertices > 0);

        if coats.is_some() {
            left_out.textures = 0;
        }
        let LeftOut { primitives, with_normals, with_colors, .. } = left_out;
        let has_normals = with_normals > 0 && with_normals == primitives;
        if with_normals > 0 && !has_normals {
            warnings.push("dropped normals, which not all of the primitives have".to_owned());
            meshes.iter_mut().flat_map(|part| &mut part.sets).for_each(|set| set.normals = None);
        }
        let attributes = Attributes { normals: has_normals, colors: with_colors > 0, ..Attributes::NONE };
        let coordinates = coordinates(&meshes, &instances);
        warnings.extend(left_out.messages());

        let (mut vertices, mut faces) = (0u64, 0u64);
        for instance in &instances {
            let part = &meshes[instance.mesh as usize];
            vertices = vertices.saturating_add(part.vertices);
            faces = part.primitives.iter().fold(faces, |sum, it| sum.saturating_add(it.count()));
        }
        if vertices > MAX_VERTICES {
            let place =
                SourceLocation { element: "vertex".to_owned(), index: MAX_VERTICES, offset: 0, line: None };
            return Err(ImportError::TooMany { place, what: "vertices", limit: MAX_VERTICES });
        }
        let format = VertexFormat { coordinates, attributes };
        Ok(Parts { meshes, instances, format, vertices, faces, warnings })
    }

    /// Sets of vertices in the order of the scene; those of instance number `instance`, before which so many vertices come.
    pub(super) fn sets(&self, instance: usize, before: u64) -> impl Iterator<Item = Placed<'_>> {
        let Instance { mesh, placement } = &self.instances[instance];
        let sets = &self.meshes[*mesh as usize].sets;
        sets.iter().map(move |set| Placed { set, placement, first: before + set.first })
    }

    /// Vertices of an instance.
    pub(super) fn len(&self, instance: usize) -> u64 {
        self.meshes[self.instances[instance].mesh as usize].vertices
    }

    /// Primitives of an instance, and the vertices that each takes its corners from.
    pub(super) fn triangles(
        &self,
        instance: usize,
        before: u64,
    ) -> impl Iterator<Item = (&Triangles, Placed<'_>)> {
        let Instance { mesh, placement } = &self.instances[instance];
        let part = &self.meshes[*mesh as usize];
        part.primitives.iter().map(move |primitive| {
            let set = &part.sets[primitive.set];
            (primitive, Placed { set, placement, first: before + set.first })
        })
    }
}

/// Singles if nothing moves what single precision holds.
fn coordinates(meshes: &[Part], instances: &[Instance]) -> Coordinates {
    let is_still = |it: &Instance| it.placement == Placement::IDENTITY;
    let are_singles = |part: &Part| part.sets.iter().all(|set| set.positions.are_singles());
    match instances.iter().all(|it| is_still(it) && are_singles(&meshes[it.mesh as usize])) {
        true => Coordinates::Single,
        false => Coordinates::Double,
    }
}

impl Part {
    fn new(
        mesh: &Mesh,
        document: &Document,
        views: &mut Views<'_>,
        (options, coats): (&Options, Option<&Coats>),
        left_out: &mut LeftOut,
    ) -> Result<Part, ImportError> {
        let (mut part, mut sets) = (Part::default(), BTreeMap::new());
        for primitive in &mesh.primitives {
            let Some((mode, position)) = drawn(primitive, left_out)? else { continue };
            let is_draco = primitive.extensions.draco.is_some();
            if is_draco && entry(&document.accessors, position, "accessor")?.buffer_view.is_none() {
                let name = "KHR_draco_mesh_compression";
                return Err(refused(format!(
                    "it is compressed by {name}, which is not read: save it without"
                )));
            }
            let attributes = &primitive.attributes;
            let normal = attributes.normal.filter(|_| options.normals);
            let color = attributes.color_0.filter(|_| options.colors);
            let coat = coats.and_then(|coats| coats.get(primitive.material));
            let painted = coat.and_then(|coat| coat.painted);
            let coordinates = painted.and_then(|painted| attributes.texcoord(painted.set));
            let key = (position, normal, color, coordinates);
            let set = match sets.get(&key) {
                Some(set) => *set,
                None => {
                    let set = VertexSet::open(key, part.vertices, document, views)?;
                    left_out.bad_coordinates += u64::from(coordinates.is_some() && set.coordinates.is_none());
                    // Nothing of it is to be walked over, however often it is placed.
                    if set.positions.count == 0 {
                        continue;
                    }
                    part.vertices = part.vertices.saturating_add(set.positions.count);
                    part.sets.push(set);
                    sets.insert(key, part.sets.len() - 1);
                    part.sets.len() - 1
                }
            };
            let open = |number| Elements::open(number, &[Shape::Scalar], document, views);
            let indices = primitive.indices.map(open).transpose()?;
            if indices.as_ref().is_some_and(|indices| !indices.are_indices()) {
                return Err(refused("its indices are neither bytes, nor words, nor integers, without sign"));
            }
            let corners = indices.as_ref().map_or(part.sets[set].positions.count, |indices| indices.count);
            if let Mode::Triangles = mode {
                left_out.loose_corners += corners % 3;
            }
            if corners < 3 {
                continue;
            }
            left_out.primitives += 1;
            left_out.with_normals += u64::from(normal.is_some());
            left_out.with_colors += u64::from(color.is_some());
            left_out.whole_colors += u64::from(part.sets[set].has_whole_colors);
            part.primitives.push(Triangles { set, indices, mode, corners, coat });
        }
        Ok(part)
    }
}

/// How a primitive is drawn, and its positions; none if it is left out.
fn drawn(primitive: &Primitive, left_out: &mut LeftOut) -> Result<Option<(Mode, u32)>, ImportError> {
    let mode = match primitive.mode {
        4 => Mode::Triangles,
        5 => Mode::Strip,
        6 => Mode::Fan,
        0..=3 => {
            left_out.lines_and_points += 1;
            return Ok(None);
        }
        mode => return Err(refused(format!("a primitive has mode {mode}; expected 0 to 6"))),
    };
    let Some(position) = primitive.attributes.position else {
        left_out.bare += 1;
        return Ok(None);
    };
    left_out.morphs += u64::from(!primitive.targets.is_empty());
    left_out.textures += u64::from(primitive.attributes.texcoord_0.is_some());
    Ok(Some((mode, position)))
}

impl VertexSet {
    fn open(
        (position, normal, color, coordinates): (u32, Option<u32>, Option<u32>, Option<u32>),
        first: u64,
        document: &Document,
        views: &mut Views<'_>,
    ) -> Result<VertexSet, ImportError> {
        let mut open = |number, shapes: &[Shape]| Elements::open(number, shapes, document, views);
        let positions = open(position, &[Shape::Vec3])?;
        let normals = normal.map(|number| open(number, &[Shape::Vec3])).transpose()?;
        let mut colors = color.map(|number| open(number, &[Shape::Vec3, Shape::Vec4])).transpose()?;
        // Nobody means colours of which one of 255 is full.
        let has_whole_colors = colors.as_mut().is_some_and(Elements::make_shares);
        for other in normals.iter().chain(&colors) {
            if other.count != positions.count {
                let (has, is) = (other.count, positions.count);
                return Err(refused(format!("an attribute has {has} elements, and its positions are {is}")));
            }
        }
        // They are not worth a mesh.
        let coordinates = coordinates.and_then(|number| open(number, &[Shape::Vec2]).ok());
        let coordinates = coordinates.filter(|coordinates| coordinates.count == positions.count);
        Ok(VertexSet { positions, normals, colors, coordinates, has_whole_colors, first })
    }
}

impl Triangles {
    fn count(&self) -> u64 {
        match self.mode {
            Mode::Triangles => self.corners / 3,
            Mode::Strip | Mode::Fan => self.corners.saturating_sub(2),
        }
    }
}

impl LeftOut {
    fn messages(&self) -> Vec<String> {
        let LeftOut {
            lines_and_points,
            morphs,
            textures,
            bare,
            whole_colors,
            bad_coordinates,
            loose_corners,
            ..
        } = *self;
        let mut warnings = Vec::new();
        let mut warn = |count: u64, text: String| warnings.extend((count > 0).then_some(text));
        warn(lines_and_points, format!("skipped {lines_and_points} primitives of points or lines"));
        warn(bare, format!("skipped {bare} primitives without positions"));
        warn(
            loose_corners,
            format!("left out {loose_corners} corners behind the last whole triangle of their primitive"),
        );
        warn(
            morphs,
            format!("read {morphs} primitives with morph targets as they are before any is applied"),
        );
        warn(
            whole_colors,
            format!("took the integers of {whole_colors} primitives' colours for normalized ones"),
        );
        warn(
            bad_coordinates,
            format!(
                "read {bad_coordinates} sets of vertices without their texture coordinates, which are damaged"
            ),
        );
        warn(textures, format!("dropped the texture coordinates of {textures} primitives"));
        warnings
    }
}
