//! Ingest: a source becomes arrays of positions, attributes and triangles in which every number is finite and every index is
//! in range, with bounds and counts. One pass over the file; memory is the arrays, a few batches, and a bit for each vertex.

mod components;
mod detail;
mod intake;
mod lattice;
mod local;
mod painted;
mod small;
mod texels;
mod triangles;
mod used;

use crate::config::{Normals, Positions, Settings};
use crate::context::Context;
use crate::error::BuildError;
use crate::ids::{Id, Triangles, with_ids};
use crate::report::SmallComponents;
use crate::vertex_columns::VertexColumns;
use bytemuck::Pod;
use chpm_extmem::{Cached, Column};
use chpm_format::Source as Provenance;
use chpm_import::ply::{Coordinates, Invalid, Options, SourceLocation, Tally};
use chpm_import::{Beside, CornerNormals, Input, SourceError, SourceInfo, Supply};
use chpm_mesh::{Aabb, Attributes, Counted, Scalar, scalar_places};
use intake::{Arrays, Far, Marks};
use local::Local;
pub(crate) use painted::{Painted, Wedge, place_of};
use serde::{Deserialize, Serialize};
use texels::Texels;
use used::Used;

/// The validated source.
#[derive(Serialize, Deserialize)]
pub(crate) struct Source {
    /// Positions are relative to the origin.
    pub(crate) vertices: VertexColumns,
    pub(crate) triangles: Triangles,
    /// Of the vertices that faces use, as all that follows.
    pub(crate) bounds: Aabb,
    /// By how much a coordinate was changed at most: what errors start from. Zero for f32 sources that are on no lattice.
    pub(crate) rounding: f64,
    /// Taken down when the source has been read, and not part of a record.
    #[serde(skip)]
    pub(crate) facts: SourceFacts,
    /// Paint of its triangles, where clusters are to have sheets; taken from it, too.
    #[serde(skip)]
    pub(crate) painted: Option<Painted>,
}

/// Facts about a source that no later stage works with.
#[derive(Default)]
pub(crate) struct SourceFacts {
    /// Zero for f32 sources, which keep their bits, but on a lattice far from zero.
    pub(crate) origin: [f64; 3],
    /// Step that all coordinates are multiples of, if they lie on a lattice.
    pub(crate) lattice_step: Option<f64>,
    pub(crate) tally: Tally,
    /// Components that were left out, if that was asked for.
    pub(crate) small: Option<SmallComponents>,
    pub(crate) warnings: Vec<String>,
    pub(crate) provenance: Provenance,
    /// Named scalars, with the ranges of the vertices that faces use.
    pub(crate) scalars: Vec<Scalar>,
    /// Images whose texels became colours, if that is where these come from.
    pub(crate) images: Option<u64>,
    /// Triangles of a leaf, where texels make them fewer.
    pub(crate) leaf_triangles: Option<u32>,
}

const TRIANGLES: &str = "triangles";

/// Reads the whole of `supply`.
pub(crate) fn run(supply: &Supply, settings: &Settings, context: &Context<'_>) -> Result<Source, BuildError> {
    let options = Options {
        invalid: if settings.drop_invalid { Invalid::Drop } else { Invalid::Refuse },
        normals: settings.normals == Normals::Source,
        colors: settings.colors,
        keep: settings.scalars.clone(),
        images: settings.images(),
        wide: true,
    };
    let mut input = Input::of(supply, options, &context.store, &context.cancel)?;
    let format = input.vertex_format();
    let is_double = format.coordinates.are_double();
    let scalars = input.scalars().to_vec();
    let is_missing = |name: &&String| scalars.iter().all(|scalar| scalar.name != **name);
    if let Some(name) = settings.scalars.names.iter().find(is_missing) {
        return Err(BuildError::NoScalar { path: supply.path.clone(), name: name.clone() });
    }

    let kept = kept(format.attributes, settings);
    let mut arrays = Arrays::expecting(&input, supply.len(), kept, context)?;
    arrays.keeps_wedges = settings.makes_sheets();
    let mut marks = Marks::new(&context.store)?;
    arrays.fill(&mut marks, &mut input, context)?;
    let Arrays { vertices, doubles, mut triangles, polygons, corner_normals, texels, .. } = arrays;
    let Marks { bounds, mut used, far, .. } = marks;

    // Polygons are cut last, since their corners' positions may come after them.
    let mut read = input.finish()?;
    let count = vertices.len() + doubles.len();
    let (vertices, doubles) = (vertices.finish()?, doubles.finish_column()?);
    let mut take = |more: &[[u32; 3]]| {
        used.add(more, count)?;
        triangles.push(more)
    };
    read.tally.degenerate_faces += match is_double {
        true => polygons.cut(&context.cancel, places(&doubles), &mut take)?,
        false => polygons.cut(&context.cancel, places(&vertices.positions), &mut take)?,
    };
    let (coordinates, far) = (format.coordinates, far.finish_column()?);
    let came =
        Came { vertices, doubles, coordinates, scalars, used, bounds, far, corner_normals, texels, read };
    with_ids!(triangles.finish()?, triangles => came.finish(triangles, supply, settings, context))
}

/// All that a source has but its triangles.
struct Came {
    vertices: VertexColumns,
    doubles: Column<[f64; 3]>,
    coordinates: Coordinates,
    scalars: Vec<Scalar>,
    used: Used,
    bounds: Aabb,
    far: Column<Far>,
    corner_normals: Option<CornerNormals>,
    texels: Option<Texels>,
    read: SourceInfo,
}

impl Came {
    /// The source, with its triangles.
    fn finish<I: Id>(
        self,
        triangles: Column<[I; 3]>,
        supply: &Supply,
        settings: &Settings,
        context: &Context<'_>,
    ) -> Result<Source, BuildError> {
        let Came { mut vertices, doubles, coordinates, mut scalars, .. } = self;
        let Came { mut used, bounds, far, corner_normals, texels, read, .. } = self;
        let (is_double, count) = (coordinates.are_double(), vertices.positions.len() + doubles.len());
        if triangles.is_empty() {
            // So far from zero, corners that differ may have become one.
            refuse_far(&far, |_| true, supply, &read, context)?;
            let path = supply.path.clone();
            return Err(BuildError::Empty { path, faces: read.face_count, left_out: read.warnings });
        }

        // Only now is it known which vertices faces use; the others may lie anywhere.
        used.complete(&triangles, count, context)?;
        refuse_far(&far, |vertex| used.contains(vertex), supply, &read, context)?;

        let (corner_normals, of_normals) = match corner_normals {
            Some(normals) => normals.join(count, &context.store, &context.cancel)?,
            None => (None, None),
        };
        vertices.normals = vertices.normals.or(corner_normals);
        let (mut images, mut wedges, mut untinted) = (None, None, None);
        if let (Some(mut texels), Some(textures)) = (texels, &read.textures) {
            wedges = texels
                .kept(textures, supply, context)?
                .map(|(triangles, tiles)| (triangles, tiles, textures.materials.clone()));
            let own = vertices.colors.as_ref();
            let tiles = wedges.as_ref().map(|(_, tiles, _)| tiles);
            let (colors, tints) = texels.finish(textures, tiles, own, count, supply, context)?;
            vertices.colors = Some(colors);
            untinted = (tints > 0 && wedges.is_some()).then(|| {
                let tints = Counted(tints, "textured vertex");
                format!(
                    "colours of {tints} tint what becomes of images as colours of vertices, but not in sheets"
                )
            });
            images = Some(textures.images.len() as u64);
        }

        let mut columns = Columns { vertices, doubles, triangles, used, bounds };
        let mut small = None;
        if let Some(size) = settings.min_component {
            let (textured, rest) =
                wedges.map(|(triangles, tiles, materials)| (triangles, (tiles, materials))).unzip();
            let ((left, textured), counts) =
                small::leave_out(columns, textured, size, &supply.path, context)?;
            (columns, small) = (left, Some(counts));
            wedges = textured.zip(rest).map(|(triangles, (tiles, materials))| (triangles, tiles, materials));
        }

        ranges(&mut scalars, &columns, context)?;

        // From here on positions are singles, relative to the origin.
        let Columns { mut vertices, doubles, triangles, used, bounds } = columns;
        let bits = match (settings.positions, is_double) {
            (Positions::Exact, _) => None,
            (Positions::Lattice(bits), _) => Some(bits),
            (Positions::Auto, true) => detail::bits(&doubles, &triangles, &used, settings, context)?,
            (Positions::Auto, false) => {
                detail::bits(&vertices.positions, &triangles, &used, settings, context)?
            }
        };
        let local = match (bits, is_double) {
            (None, true) => local::doubles(doubles, coordinates, &used, context),
            (None, false) => local::singles(vertices.positions, bounds, &used, context),
            (Some(bits), true) => lattice::round(&doubles, bits, &used, context),
            (Some(bits), false) => lattice::round(&vertices.positions, bits, &used, context),
        };
        let Local { positions, bounds, origin, rounding, lattice_step, warning } = local?;
        vertices.positions = positions;
        let painted = wedges.map(|(triangles, tiles, materials)| {
            Painted::new(&triangles, &vertices.positions, materials, tiles, context)
        });
        let painted = painted.transpose()?;
        let leaf_triangles =
            painted.as_ref().and_then(|painted| settings.triangles_for(painted.texels, painted.count()));
        let provenance = provenance(&read);
        let SourceInfo { tally, mut warnings, .. } = read;
        warnings.extend(warning);
        warnings.extend(of_normals);
        warnings.extend(untinted);
        warnings.extend(painted.as_ref().and_then(Painted::warning));
        let facts = SourceFacts {
            origin,
            lattice_step,
            tally,
            small,
            warnings,
            provenance,
            scalars,
            images,
            leaf_triangles,
        };
        Ok(Source { vertices, triangles: I::triangles(triangles), bounds, rounding, facts, painted })
    }
}

/// Where vertices are, as the file has them.
fn places_of(positions: &Column<[f32; 3]>) -> impl FnMut(u32) -> Result<[f32; 3], BuildError> {
    let mut positions = Cached::new(positions);
    move |vertex| Ok(positions.get(vertex as usize)?.unwrap_or_default())
}

/// Where vertices are; zero where there is none, as it is for all that comes after.
fn places<T: Pod + Into<f64>>(positions: &Column<[T; 3]>) -> impl FnMut(u32) -> Result<[f64; 3], BuildError> {
    let mut positions = Cached::new(positions);
    move |vertex| Ok(positions.get(vertex as usize)?.map_or([0.0; 3], |place| place.map(Into::into)))
}

/// Finds the range of each scalar, among the vertices that faces use.
fn ranges<I: Id>(
    scalars: &mut [Scalar],
    columns: &Columns<I>,
    context: &Context<'_>,
) -> Result<(), BuildError> {
    const STEP: usize = 1 << 16;
    let Columns { vertices, used, .. } = columns;
    let (count, words) = (vertices.scalars.first().map_or(0, Column::len), vertices.scalars.len());
    let places: Vec<_> = scalar_places(scalars).map(|(place, _)| place).collect();
    let mut rows = Vec::new();
    for start in (0..count).step_by(STEP) {
        context.check()?;
        let rows = vertices.read_scalars(start..count.min(start + STEP), &mut rows)?;
        let used = (start..).zip(rows.chunks_exact(words)).filter(|(vertex, _)| used.contains(*vertex));
        for (_, row) in used {
            for (scalar, place) in scalars.iter_mut().zip(&places) {
                scalar.range.add(scalar.kind.value(&row[place.clone()]));
            }
        }
    }
    Ok(())
}

/// Attributes of vertices in the file.
pub(crate) fn kept(read: Attributes, settings: &Settings) -> Attributes {
    Attributes { octahedral: settings.normals == Normals::Computed, ..read }
}

/// The arrays when all has come.
struct Columns<I: Id> {
    /// Positions are here or in `doubles`.
    vertices: VertexColumns,
    doubles: Column<[f64; 3]>,
    triangles: Column<[I; 3]>,
    used: Used,
    /// Of all singles.
    bounds: Aabb,
}

/// Refuses vertices that are too far from zero for all that follows, if one of them matters.
fn refuse_far(
    far: &Column<Far>,
    matters: impl Fn(usize) -> bool,
    supply: &Supply,
    read: &SourceInfo,
    context: &Context<'_>,
) -> Result<(), BuildError> {
    local::each(far, context, |_, places| {
        let Some(&[vertex, offset, line, value]) = places.iter().find(|far| matters(far[0] as usize)) else {
            return Ok(());
        };

        let place = |base| SourceLocation {
            element: "vertex".to_owned(),
            index: vertex - base,
            offset,
            line: Some(line).filter(|line| *line > 0),
        };

        let value = f64::from_bits(value);
        let list = supply.path.clone();
        let scan = |(_, beside): &(usize, &Beside)| beside.first.is_some_and(|first| first <= vertex);
        let error = match read.beside.iter().enumerate().rfind(scan) {
            None => SourceError::TooFar { path: list, place: place(0), value },
            Some((index, scan)) => {
                let place = place(scan.first.unwrap_or(0));
                let error = SourceError::TooFar { path: scan.path.clone(), place, value };
                SourceError::Member { list, index, error: Box::new(error) }
            }
        };
        Err(error.into())
    })
}

/// Provenance, as the file stores it.
fn provenance(read: &SourceInfo) -> Provenance {
    Provenance {
        name: read.name.clone(),
        encoding: read.encoding.clone(),
        byte_len: read.byte_len,
        hash: read.hash,
        vertex_count: read.vertex_count,
        face_count: read.face_count,
        comments: read.comments.clone(),
    }
}

/// Counts that ingest found, as the repair report wants them.
pub(crate) fn repairs(source: &Source) -> crate::report::Repairs {
    let tally = &source.facts.tally;
    crate::report::Repairs {
        small_components: source.facts.small,
        degenerate_faces: tally.degenerate_faces,
        polygons_triangulated: tally.polygons_triangulated,
        dropped_faces: tally.dropped_faces,
        dropped_vertices: tally.dropped_vertices,
        missing_faces: tally.missing_faces,
        ..Default::default()
    }
}
