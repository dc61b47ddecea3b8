//! Meaning of each element and property of a header for the mesh.

use super::{
    error::PlyError,
    header::{Element, Encoding, Header, PropertyType, ScalarType},
    scalars::ScalarPlan,
    warning::Warning,
};
use crate::options::{Invalid, Options};
use crate::vertex_format::{Coordinates, VertexFormat};
use chpm_mesh::{Attributes, Scalar};

/// Role of an element for the reader.
#[derive(Debug)]
pub(super) enum Role {
    Skip,
    Vertices(Box<VertexPlan>),
    Faces(ListPlan),
    Strips(ListPlan),
    /// With the samples of a row.
    Grid(ListPlan, u64),
}

/// Where a number of a vertex is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Field {
    /// Its place among the properties.
    pub(super) property: usize,
    pub(super) ty: ScalarType,
    /// Bytes before it in a record; of use only if the record has a fixed length.
    pub(super) offset: usize,
}

#[derive(Debug)]
pub(super) struct VertexPlan {
    pub(super) position: [Field; 3],
    pub(super) normal: Option<[Field; 3]>,
    pub(super) color: Option<[Field; 3]>,
    pub(super) alpha: Option<Field>,
    /// Bytes of a record, unless there are lists.
    pub(super) stride: Option<usize>,
    /// Meaning of each property, for records that are read number by number.
    pub(super) slots: Vec<Slot>,
    pub(super) scalars: ScalarPlan,
    /// Texture coordinates, where these are asked for.
    pub(super) texture: Option<[Field; 2]>,
}

/// Meaning of a vertex's property; the number is the axis or the channel.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Slot {
    Skip,
    Position(usize),
    Normal(usize),
    Color(usize),
    Texture(usize),
}

/// The list of corners among the properties of a face or of strips.
#[derive(Clone, Copy, Debug)]
pub(super) struct ListPlan {
    pub(super) property: usize,
    pub(super) count: ScalarType,
    pub(super) item: ScalarType,
    /// Bytes of the properties before and after, unless there are other lists.
    pub(super) around: Option<(usize, usize)>,
}

/// One role for each element of the header, what vertices are delivered, and what is lost.
pub(super) struct Schema {
    pub(super) roles: Vec<Role>,
    pub(super) format: VertexFormat,
    pub(super) warnings: Vec<Warning>,
}

impl Schema {
    /// The named scalars that are delivered.
    pub(super) fn scalars(&self) -> &[Scalar] {
        let mut plans = self.roles.iter().filter_map(|role| match role {
            Role::Vertices(plan) => Some(&plan.scalars.scalars[..]),
            _ => None,
        });
        plans.next_back().unwrap_or_default()
    }

    pub(super) fn new(header: &Header, options: &Options) -> Result<Self, PlyError> {
        let mut warnings = Vec::new();
        let mut roles = Vec::with_capacity(header.elements.len());
        let mut format = None;
        for element in &header.elements {
            let role = match element.name.as_str() {
                "vertex" => {
                    let plan = vertex_plan(element, options, &mut warnings)?;
                    format = Some(plan.format(header.format));
                    Role::Vertices(Box::new(plan))
                }
                "face" | "tristrips" => {
                    if format.is_none() && options.invalid == Invalid::Drop && element.count > 0 {
                        return Err(PlyError::FacesFirst { element: element.name.clone() });
                    }
                    let plan = list_plan(element, &mut warnings)?;
                    if element.name == "face" { Role::Faces(plan) } else { Role::Strips(plan) }
                }
                // Files that have faces, too, have made a mesh of their grid.
                "range_grid" if element.count > 0 && header.face_count == 0 && format.is_some() => {
                    match super::grid::columns(header, element.count) {
                        Some(columns) => Role::Grid(list_plan(element, &mut warnings)?, columns),
                        None => skip(element, &mut warnings),
                    }
                }
                _ => skip(element, &mut warnings),
            };
            roles.push(role);
        }
        let format = format.ok_or(PlyError::NoVertexElement)?;
        let has_grid = roles.iter().any(|role| matches!(role, Role::Grid(..)));
        if header.vertex_count > 0 && header.face_count == 0 && header.strip_count == 0 && !has_grid {
            let vertices = header.vertex_count;
            return Err(
                match header.elements.iter().find(|element| element.name == "edge" && element.count > 0) {
                    None => PlyError::PointCloud { vertices },
                    Some(edge) => PlyError::Lines { vertices, edges: edge.count },
                },
            );
        }
        Ok(Schema { roles, format, warnings })
    }
}

fn skip(element: &Element, warnings: &mut Vec<Warning>) -> Role {
    if element.count > 0 {
        warnings.push(Warning::ElementSkipped { element: element.name.clone(), count: element.count });
    }
    Role::Skip
}

impl VertexPlan {
    fn format(&self, encoding: Encoding) -> VertexFormat {
        let exceeds_single = self.position.iter().any(|field| field.ty.exceeds_single());
        let has_reals = self.position.iter().any(|field| !field.ty.is_integer());
        VertexFormat {
            coordinates: match (encoding, exceeds_single) {
                // Whole numbers as text say what they say as bytes.
                (Encoding::Ascii, true) if has_reals => Coordinates::Text,
                (Encoding::Ascii, false) if has_reals => Coordinates::TextOfSingles,
                (_, true) => Coordinates::Double,
                (_, false) => Coordinates::Single,
            },
            attributes: Attributes {
                normals: self.normal.is_some(),
                colors: self.color.is_some(),
                scalar_words: self.scalars.words() as u8,
                ..Attributes::NONE
            },
        }
    }
}

fn vertex_plan(
    element: &Element,
    options: &Options,
    warnings: &mut Vec<Warning>,
) -> Result<VertexPlan, PlyError> {
    let mut position = Vec::with_capacity(3);
    for axis in ["x", "y", "z"] {
        let at = find(element, axis).ok_or(PlyError::NoCoordinate { axis })?;
        let not_scalar = || PlyError::NotScalar { element: element.name.clone(), property: axis.to_owned() };
        position.push(field(element, at).ok_or_else(not_scalar)?);
    }
    let position = [position[0], position[1], position[2]];
    let normal = group(element, ["nx", "ny", "nz"]);
    let plain = group(element, ["red", "green", "blue"]).map(|color| (color, "alpha"));
    let diffuse = || {
        group(element, ["diffuse_red", "diffuse_green", "diffuse_blue"]).map(|color| (color, "diffuse_alpha"))
    };
    let (color, alpha) = match plain.or_else(diffuse) {
        Some((color, alpha)) => (Some(color), find(element, alpha).and_then(|at| field(element, at))),
        None => (None, None),
    };

    let mut slots = vec![Slot::Skip; element.properties.len()];
    let mut assign = |fields: &[Field], slot: fn(usize) -> Slot| {
        fields.iter().enumerate().for_each(|(i, field)| slots[field.property] = slot(i));
    };
    assign(&position, Slot::Position);
    assign(normal.as_ref().map_or(&[], |fields| fields.as_slice()), Slot::Normal);
    assign(color.as_ref().map_or(&[], |fields| fields.as_slice()), Slot::Color);
    assign(alpha.as_slice(), |_| Slot::Color(3));
    let scalars = ScalarPlan::new(element, &slots, &options.keep)?;
    let is_kept = |at: usize| scalars.kept.iter().any(|kept| kept.field.property == at);
    let rest = (0..slots.len()).filter(|&at| slots[at] == Slot::Skip && !is_kept(at));
    warn_of_dropped(element, rest, warnings);

    // What the caller does not ask for is no loss, and is skipped without a word.
    let (normal, color) = (normal.filter(|_| options.normals), color.filter(|_| options.colors));
    let alpha = alpha.filter(|_| options.colors);
    for slot in &mut slots {
        let unwanted = matches!(slot, Slot::Normal(_)) && normal.is_none()
            || matches!(slot, Slot::Color(_)) && color.is_none();
        if unwanted {
            *slot = Slot::Skip;
        }
    }
    if let Some(field) = normal.iter().flatten().find(|field| field.ty.exceeds_single()) {
        warnings.push(Warning::NormalsRounded { from: field.ty });
    }
    let lost = |field: &&Field| field.ty != ScalarType::UChar && !is_kept(field.property);
    if let Some(field) = color.iter().flatten().chain(&alpha).find(lost) {
        warnings.push(Warning::ColorsQuantised { from: field.ty });
    }
    let stride = fixed_size(element, 0..element.properties.len());
    Ok(VertexPlan { position, normal, color, alpha, stride, slots, scalars, texture: None })
}

fn list_plan(element: &Element, warnings: &mut Vec<Warning>) -> Result<ListPlan, PlyError> {
    let (property, count, item) = corners("vertex_indices", element)
        .or_else(|| corners("vertex_index", element))
        .ok_or_else(|| PlyError::NoIndices { element: element.name.clone() })?;
    let properties = element.properties.len();
    warn_of_dropped(element, (0..properties).filter(|&at| at != property), warnings);
    let before = fixed_size(element, 0..property);
    let around = before.zip(fixed_size(element, property + 1..properties));
    Ok(ListPlan { property, count, item, around })
}

fn corners(name: &str, element: &Element) -> Option<(usize, ScalarType, ScalarType)> {
    let property = find(element, name)?;
    match element.properties[property].ty {
        PropertyType::List { count, item } if item.is_integer() => Some((property, count, item)),
        _ => None,
    }
}

pub(super) fn find(element: &Element, name: &str) -> Option<usize> {
    element.properties.iter().position(|property| property.name == name)
}

/// The property as a number, which a list is not.
pub(super) fn field(element: &Element, property: usize) -> Option<Field> {
    match element.properties[property].ty {
        PropertyType::Scalar(ty) => {
            Some(Field { property, ty, offset: fixed_size(element, 0..property).unwrap_or(0) })
        }
        PropertyType::List { .. } => None,
    }
}

/// Three numbers that make sense only together.
fn group(element: &Element, names: [&str; 3]) -> Option<[Field; 3]> {
    let [a, b, c] = names.map(|name| find(element, name).and_then(|at| field(element, at)));
    Some([a?, b?, c?])
}

/// Texture coordinates of a vertex, by the names that programs give them.
pub(super) fn texture_of_vertex(element: &Element) -> Option<[Field; 2]> {
    const NAMES: [[&str; 2]; 4] =
        [["s", "t"], ["u", "v"], ["texture_u", "texture_v"], ["texture_s", "texture_t"]];
    NAMES.iter().find_map(|names| {
        let [u, v] = names.map(|name| find(element, name).and_then(|at| field(element, at)));
        Some([u?, v?])
    })
}

/// Bytes of some properties, if none of them is a list.
fn fixed_size(element: &Element, properties: std::ops::Range<usize>) -> Option<usize> {
    element.properties[properties].iter().try_fold(0, |sum, property| match property.ty {
        PropertyType::Scalar(ty) => Some(sum + ty.size()),
        PropertyType::List { .. } => None,
    })
}

fn warn_of_dropped(element: &Element, properties: impl Iterator<Item = usize>, warnings: &mut Vec<Warning>) {
    let (texture, other): (Vec<String>, Vec<String>) =
        properties.map(|at| element.properties[at].name.clone()).partition(|name| is_texture(name));
    if !texture.is_empty() {
        warnings.push(Warning::TextureDropped { element: element.name.clone(), properties: texture });
    }
    if !other.is_empty() {
        let (element, properties) = (element.name.clone(), other);
        warnings.push(match element.as_str() {
            "vertex" => Warning::VertexPropertiesDropped { element, properties },
            _ => Warning::FaceAttributesDropped { element, properties },
        });
    }
}

fn is_texture(name: &str) -> bool {
    matches!(name, "s" | "t" | "u" | "v") || name.starts_with("tex")
}
