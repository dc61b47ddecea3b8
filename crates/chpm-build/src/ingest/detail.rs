//! How fine a lattice has to be for a model: its step is a share of what level 0 will err, which nothing knows before that is built. So some
//! pieces, as large as leaves, are taken out of the source and halved as leaves are.
//!
//! A piece is the vertices of the smallest box about a seed that has enough of them, and the triangles that have no other. Two passes over the
//! vertices and one over the triangles find them, in the source's order, so that neither threads nor memory show.

use super::lattice::{Coordinate, bits_for, ranges};
use super::local::each;
use super::used::Used;
use crate::config::Settings;
use crate::context::Context;
use crate::error::BuildError;
use crate::ids::Id;
use bytemuck::Pod;
use chpm_extmem::{Cached, Column};
use chpm_qem::{Decimator, Patch};
use rayon::prelude::*;
use std::collections::HashMap;

/// The most pieces; a bit of a mask each.
const PIECES: usize = 16;
/// One leaf of so many is looked at, up to as many as there are pieces.
const SPARSE: u64 = 4;
/// Of the largest error in the median piece, as much is the most that a step may be. Pieces err 0.5 to 0.9 times as much as level 0 does in the
/// median, where group borders are halved as well: of that it is a quarter to a half.
const SHARE: f64 = 0.5;
/// The most vertices of a piece, whatever leaves are to have.
const MOST_VERTICES: usize = 8192;
/// The most triangles of a piece: where far more meet at few vertices, some will do.
const MOST_TRIANGLES: usize = 4 * MOST_VERTICES;

/// Sizes of boxes are told apart by the exponent of a double and so many bits after it.
const SHIFT: u32 = 52 - 3;
const SIZES: usize = 1 << (63 - SHIFT);
const INFINITE: usize = (f64::INFINITY.to_bits() >> SHIFT) as usize;

/// Bits that are set for vertices of pieces, by some of a hash of theirs: most others are passed by without a search.
const FILTER_BITS: u32 = 23;
/// All that is held beside the arrays, and more.
const BYTES: u64 = 12 << 20;

/// Bits of the lattice; none where positions had better be exact.
pub(super) fn bits<T: Coordinate, I: Id>(
    positions: &Column<[T; 3]>,
    triangles: &Column<[I; 3]>,
    used: &Used,
    settings: &Settings,
    context: &Context<'_>,
) -> Result<Option<u8>, BuildError>
where
    [T; 3]: Pod,
{
    let _share = context.store.budget.reserve_work("a sample of the model", BYTES)?;
    let ranges = ranges(positions, used, context)?;
    let pieces = pieces::<T, I>(positions, triangles, used, settings, context)?;
    let diagonal = ranges.iter().map(|(low, high)| (high - low) * (high - low)).sum::<f64>().sqrt();
    // What is left out below that error is not there to be kept.
    let finest = settings.finest_error.map_or(0.0, |error| error.of(diagonal));
    context.check()?;
    Ok(bits_for(ranges, SHARE * median_error(&pieces, settings).max(finest)))
}

/// Some of a model, as large as a leaf.
struct Piece {
    seed: [f64; 3],
    /// Half a side of the box that it fills.
    reach: f64,
    /// Which vertices it has, rising.
    vertices: Vec<usize>,
    /// Relative to the seed, so that it does not matter how far that is from zero.
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u16; 3]>,
    /// Vertices of triangles that are outside in part.
    locked: Vec<bool>,
}

impl Piece {
    fn at(seed: [f64; 3]) -> Self {
        let (vertices, positions, triangles, locked) = Default::default();
        Piece { seed, reach: 0.0, vertices, positions, triangles, locked }
    }

    fn offset<T: Coordinate>(&self, point: [T; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| point[axis].into() - self.seed[axis])
    }

    /// The vertex's number here, if it has it.
    fn local(&self, vertex: usize) -> Option<u16> {
        self.vertices.binary_search(&vertex).ok().map(|at| at as u16)
    }

    /// The error of half of it.
    fn error(&self, decimator: &mut Decimator, keep: f64) -> f64 {
        let patch = Patch {
            positions: &self.positions,
            triangles: &self.triangles,
            locked: &self.locked,
            ..Patch::default()
        };
        // In a build most borders are halved as well; where a piece ends, its inside is not to pay for them.
        let is_fixed = |triangle: &&[u16; 3]| triangle.iter().any(|v| self.locked[usize::from(*v)]);
        let fixed = self.triangles.iter().filter(is_fixed).count();
        let free = self.triangles.len() - fixed;
        let outcome = decimator.decimate(&patch, fixed + (free as f64 * keep) as usize, 0.0);
        outcome.collapses.last().map_or(0.0, |last| f64::from(last.error))
    }
}

fn size([x, y, z]: [f64; 3]) -> f64 {
    x.abs().max(y.abs()).max(z.abs())
}

/// The pieces, whole.
fn pieces<T: Coordinate, I: Id>(
    positions: &Column<[T; 3]>,
    triangles: &Column<[I; 3]>,
    used: &Used,
    settings: &Settings,
    context: &Context<'_>,
) -> Result<Vec<Piece>, BuildError>
where
    [T; 3]: Pod,
{
    let count = triangles.len() as u64;
    // As decompose has it: a power of two.
    let leaves = count.div_ceil(u64::from(settings.cluster_triangles).max(1)).next_power_of_two();
    // A closed surface has twice as many triangles as vertices.
    let wanted = ((count / leaves) as usize * 11 / 20).clamp(16, MOST_VERTICES);
    let number = (leaves / SPARSE).clamp(1, PIECES as u64) as usize;
    let mut pieces = seeds(positions, used, number)?;

    let mut sizes = vec![0u32; pieces.len() * SIZES];
    each(positions, context, |first, points| {
        for (_, point) in (first..).zip(points).filter(|(vertex, _)| used.contains(*vertex)) {
            for (piece, sizes) in pieces.iter().zip(sizes.chunks_exact_mut(SIZES)) {
                sizes[(size(piece.offset(*point)).to_bits() >> SHIFT) as usize] += 1;
            }
        }
        Ok(())
    })?;
    for (piece, sizes) in pieces.iter_mut().zip(sizes.chunks_exact(SIZES)) {
        let mut sum = 0;
        let fits = |count: &&u32| {
            sum += **count as usize;
            sum <= wanted
        };
        // Infinite where all fit.
        let fitting = sizes.iter().take_while(fits).count().min(INFINITE);
        piece.reach = f64::from_bits((fitting as u64) << SHIFT);
    }
    drop(sizes);

    each(positions, context, |first, points| {
        for (vertex, point) in (first..).zip(points).filter(|(vertex, _)| used.contains(*vertex)) {
            for piece in &mut pieces {
                let offset = piece.offset(*point);
                if size(offset) < piece.reach {
                    piece.vertices.push(vertex);
                    piece.positions.push(offset.map(|x| x as f32));
                }
            }
        }
        Ok(())
    })?;
    fill::<I>(&mut pieces, triangles, context)?;
    Ok(pieces)
}

/// Pieces that have a place each, spread over the order of the vertices.
fn seeds<T: Coordinate>(
    positions: &Column<[T; 3]>,
    used: &Used,
    number: usize,
) -> Result<Vec<Piece>, BuildError>
where
    [T; 3]: Pod,
{
    let (count, mut cached) = (positions.len(), Cached::new(positions));
    let mut pieces = Vec::with_capacity(number);
    for k in 0..number {
        let start = ((2 * k + 1) as u128 * count as u128 / (2 * number) as u128) as usize;
        let Some(vertex) = (start..count).chain(0..start).find(|vertex| used.contains(*vertex)) else {
            continue;
        };
        pieces.extend(cached.get(vertex)?.map(|point| Piece::at(point.map(Into::into))));
    }
    Ok(pieces)
}

/// Gives pieces their triangles, and locks what others have.
fn fill<I: Id>(
    pieces: &mut [Piece],
    triangles: &Column<[I; 3]>,
    context: &Context<'_>,
) -> Result<(), BuildError> {
    let mut filter = vec![0u64; 1 << (FILTER_BITS - 6)];
    let bit = |vertex: usize| {
        let hash = (vertex as u32).wrapping_mul(0x9e37_79b1) >> (32 - FILTER_BITS);
        ((hash / 64) as usize, 1u64 << (hash % 64))
    };
    let mut members: HashMap<usize, u16> = HashMap::new();
    for (number, piece) in pieces.iter_mut().enumerate() {
        piece.locked.resize(piece.vertices.len(), false);
        for vertex in &piece.vertices {
            let (word, mask) = bit(*vertex);
            filter[word] |= mask;
            *members.entry(*vertex).or_default() |= 1 << number;
        }
    }
    let of = |vertex: usize| {
        let (word, mask) = bit(vertex);
        if filter[word] & mask == 0 { 0 } else { members.get(&vertex).copied().unwrap_or(0) }
    };

    each(triangles, context, |_, triangles| {
        for triangle in triangles {
            let triangle = triangle.map(Id::index);
            let masks = triangle.map(of);
            let mut any = masks[0] | masks[1] | masks[2];
            while any != 0 {
                let piece = &mut pieces[any.trailing_zeros() as usize];
                any &= any - 1;
                match triangle.map(|v| piece.local(v)) {
                    [Some(a), Some(b), Some(c)] if a != b && b != c && c != a => {
                        if piece.triangles.len() < MOST_TRIANGLES {
                            piece.triangles.push([a, b, c]);
                        }
                    }
                    [Some(_), Some(_), Some(_)] => {}
                    corners => corners.iter().flatten().for_each(|v| piece.locked[usize::from(*v)] = true),
                }
            }
        }
        Ok(())
    })
}

/// The error of the piece that half of the others have less than.
fn median_error(pieces: &[Piece], settings: &Settings) -> f64 {
    let decimator = || {
        let mut decimator = Decimator::default();
        (decimator.topology, decimator.hasty) = (settings.topology, true);
        decimator
    };
    let mut errors: Vec<f64> = pieces
        .par_iter()
        .with_max_len(1)
        .map_init(decimator, |decimator, piece| piece.error(decimator, settings.keep))
        .collect();
    errors.sort_unstable_by(f64::total_cmp);
    errors.get(errors.len() / 2).copied().unwrap_or(0.0)
}
