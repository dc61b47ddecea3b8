//! The numbers of a vertex that are kept by their names.

use super::{
    binary,
    error::PlyError,
    header::{Element, PropertyType, ScalarType},
    schema::{Field, Slot, field},
};
use crate::options::Keep;
use chpm_mesh::{MOST_SCALAR_WORDS, Scalar, ScalarKind, scalar_words};

/// A property that is kept, and where its words are among those of a vertex.
#[derive(Clone, Copy, Debug)]
pub(super) struct Kept {
    pub(super) field: Field,
    pub(super) kind: ScalarKind,
    pub(super) word: usize,
}

impl Kept {
    /// Puts a value among the words of a vertex: its `bits`, where they are known.
    pub(super) fn fill(&self, row: &mut [u32], value: f64, bits: Option<u32>) {
        match bits {
            Some(bits) => row[self.word] = bits,
            None => self.kind.fill(value, &mut row[self.word..self.word + self.kind.words()]),
        }
    }
}

/// The scalars to keep, in their order.
#[derive(Debug, Default)]
pub(super) struct ScalarPlan {
    pub(super) scalars: Vec<Scalar>,
    pub(super) kept: Vec<Kept>,
}

impl ScalarPlan {
    /// Chooses among the properties of which `slots` say what else they are.
    pub(super) fn new(element: &Element, slots: &[Slot], keep: &Keep) -> Result<Self, PlyError> {
        let scalars = || (0..slots.len()).filter(|at| is_scalar(element, slots, *at));
        let name = |at: usize| element.properties[at].name.clone();
        let mut chosen = Vec::new();
        for wanted in &keep.names {
            let Some(at) = scalars().find(|at| element.properties[*at].name == *wanted) else {
                let lies = lies(element, slots, wanted);
                return Err(PlyError::NoScalar {
                    name: wanted.clone(),
                    lies,
                    known: scalars().map(name).collect(),
                });
            };
            if !chosen.contains(&at) {
                chosen.push(at);
            }
        }
        let rest: Vec<usize> = scalars().filter(|at| keep.all && !chosen.contains(at)).collect();
        chosen.extend(rest);

        let mut plan = ScalarPlan::default();
        for field in chosen.into_iter().filter_map(|at| field(element, at)) {
            let (kind, word) = (kind_of(field.ty), scalar_words(&plan.scalars));
            plan.scalars.push(Scalar::new(name(field.property), kind));
            plan.kept.push(Kept { field, kind, word });
        }
        match plan.words() {
            words if words > MOST_SCALAR_WORDS => Err(PlyError::TooManyScalars { words }),
            _ => Ok(plan),
        }
    }

    /// The scalar that a property is kept as.
    pub(super) fn find(&self, property: usize) -> Option<&Kept> {
        self.kept.iter().find(|kept| kept.field.property == property)
    }

    /// Words of a vertex.
    pub(super) fn words(&self) -> usize {
        scalar_words(&self.scalars)
    }

    /// Appends the words of each record.
    pub(super) fn read_records<const BIG: bool>(&self, records: &[u8], stride: usize, out: &mut Vec<u32>) {
        if self.kept.is_empty() {
            return;
        }
        for record in records.chunks_exact(stride) {
            for Kept { field, kind, .. } in &self.kept {
                let record = &record[field.offset..];
                match field.ty {
                    // The bits themselves, whatever they are.
                    ScalarType::Float => out.push(binary::word::<BIG>(record)),
                    ty => kind.put(binary::load::<BIG>(record, ty), out),
                }
            }
        }
    }
}

/// A number that vertices do not have otherwise, or of which their colours keep eight bits only.
fn is_scalar(element: &Element, slots: &[Slot], at: usize) -> bool {
    match (slots[at], &element.properties[at].ty) {
        (_, PropertyType::List { .. }) => false,
        (Slot::Skip, PropertyType::Scalar(_)) => true,
        (Slot::Color(_), PropertyType::Scalar(ty)) => *ty != ScalarType::UChar,
        _ => false,
    }
}

/// Kind of a property that is no scalar.
fn lies(element: &Element, slots: &[Slot], name: &str) -> Option<&'static str> {
    let at = element.properties.iter().position(|property| property.name == name)?;
    Some(match (slots[at], &element.properties[at].ty) {
        (_, PropertyType::List { .. }) => "a list",
        (Slot::Position(_), _) => "a coordinate",
        (Slot::Normal(_), _) => "part of the normal",
        _ => "part of the colour",
    })
}

fn kind_of(ty: ScalarType) -> ScalarKind {
    match ty {
        ScalarType::Char => ScalarKind::Int8,
        ScalarType::UChar => ScalarKind::Uint8,
        ScalarType::Short => ScalarKind::Int16,
        ScalarType::UShort => ScalarKind::Uint16,
        ScalarType::Int => ScalarKind::Int32,
        ScalarType::UInt => ScalarKind::Uint32,
        ScalarType::Float => ScalarKind::Float32,
        ScalarType::Double => ScalarKind::Float64,
    }
}

/// The type by which a writer names a kind.
pub(super) fn type_of(kind: ScalarKind) -> ScalarType {
    match kind {
        ScalarKind::Int8 => ScalarType::Char,
        ScalarKind::Uint8 => ScalarType::UChar,
        ScalarKind::Int16 => ScalarType::Short,
        ScalarKind::Uint16 => ScalarType::UShort,
        ScalarKind::Int32 => ScalarType::Int,
        ScalarKind::Uint32 => ScalarType::UInt,
        ScalarKind::Float32 => ScalarType::Float,
        ScalarKind::Float64 => ScalarType::Double,
    }
}
