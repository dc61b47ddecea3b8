//! Searches from samples in an order in which each is near the one before, whatever order they are told in.

use crate::sample::Sampler;
use chpm_mesh::curve::morton;
use nalgebra::Point3;
use rayon::prelude::*;
use std::ops::Range;

/// Parts of a mesh whose samples are summed up in turn; fixed, so that no sum depends on threads.
const CHUNK: usize = 64;
/// Chunks that one task sweeps.
const CHUNKS: usize = 128;
/// Samples that are held and put in order at a time.
const MOST: usize = 16_384;
/// Of those, so many are searched from in turn.
const STRETCH: usize = 4_096;

/// Parts of a mesh that are swept together.
#[derive(Clone, Debug)]
pub struct Block {
    parts: Range<usize>,
}

/// A sample, the area that it stands for, and its chunk.
struct Held {
    point: Point3<f64>,
    area: f64,
    chunk: usize,
}

impl Block {
    /// Bytes of samples that a task holds and searches from, about.
    pub const BYTES: u64 = MOST as u64 * 160;

    /// All parts of a mesh.
    pub fn all(samples: &Sampler<'_>) -> impl IndexedParallelIterator<Item = Block> + use<> {
        let (count, each) = (samples.part_count(), CHUNK * CHUNKS);
        (0..count.div_ceil(each))
            .into_par_iter()
            .map(move |i| Block { parts: i * each..count.min((i + 1) * each) })
    }

    /// How many parts there are.
    pub fn part_count(&self) -> usize {
        self.parts.len()
    }

    /// Searches from all samples by `search`, which gets from sample to sample what `start` has made, and the area. What was found is handed to `tell`, each sample with
    /// its point and its area, in the order of the samples, and with what the chunk of parts that it is in comes to; that is answered.
    pub fn sweep<S, F: Send, T: Default>(
        self,
        samples: &Sampler<'_>,
        start: impl Fn() -> S + Sync,
        search: impl Fn(&mut S, Point3<f64>, f64) -> F + Sync,
        tell: impl Fn(&mut T, Point3<f64>, f64, F),
    ) -> Vec<T> {
        let mut told: Vec<T> = Vec::new();
        told.resize_with(self.parts.len().div_ceil(CHUNK), T::default);
        let mut held: Vec<Held> = Vec::new();
        let mut flush = |held: &mut Vec<Held>| {
            let found = find(held, &start, &search);
            for (sample, found) in held.drain(..).zip(found) {
                tell(&mut told[sample.chunk], sample.point, sample.area, found);
            }
        };
        for (chunk, first) in self.parts.clone().step_by(CHUNK).enumerate() {
            samples.samples_of(first..self.parts.end.min(first + CHUNK), |point, area| {
                held.push(Held { point, area, chunk });
                if held.len() == MOST {
                    flush(&mut held);
                }
            });
        }
        flush(&mut held);
        told
    }
}

/// Runs a search from each sample.
fn find<S, F: Send>(
    held: &[Held],
    start: &(impl Fn() -> S + Sync),
    search: &(impl Fn(&mut S, Point3<f64>, f64) -> F + Sync),
) -> Vec<F> {
    let order = order(held);
    let stretches: Vec<Vec<(u32, F)>> = order
        .par_chunks(STRETCH)
        .map(|stretch| {
            let mut state = start();
            let found = stretch.iter().map(|place| {
                let place = *place as u32;
                let Held { point, area, .. } = held[place as usize];
                (place, search(&mut state, point, area))
            });
            found.collect()
        })
        .collect();
    let mut found: Vec<Option<F>> = Vec::new();
    found.resize_with(held.len(), || None);
    for (i, one) in stretches.into_iter().flatten() {
        found[i as usize] = Some(one);
    }
    found.into_iter().flatten().collect()
}

/// Samples along a curve that fills space: each below the number of its cell.
fn order(held: &[Held]) -> Vec<u64> {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for sample in held {
        for axis in 0..3 {
            low[axis] = low[axis].min(sample.point[axis]);
            high[axis] = high[axis].max(sample.point[axis]);
        }
    }
    let widest = (0..3).map(|axis| high[axis] - low[axis]).fold(f64::MIN_POSITIVE, f64::max);
    let cells = f64::from(CELLS - 1) / widest;
    let mut order: Vec<u64> =
        (0..).zip(held).map(|(i, sample)| u64::from(cell(sample, &low, cells)) << 32 | i).collect();
    order.sort_unstable();
    order
}

fn cell(sample: &Held, low: &[f64; 3], cells: f64) -> u32 {
    morton([0, 1, 2].map(|axis| ((sample.point[axis] - low[axis]) * cells) as u16)) as u32
}

/// Cells along an axis.
const CELLS: u32 = 1 << 10;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::Density;
    use chpm_mesh::TriMesh;
    use chpm_synth::{Shape, Synth};

    #[test]
    fn samples_are_told_in_their_order_and_searched_from_in_a_better_one() {
        // Vertices and triangles in no order.
        let mesh = Synth::new(Shape::Terrain, 9000, 2).to_mesh();
        let count = mesh.positions.len();
        let at = |v: usize| v * 7919 % count;
        let mut positions = vec![[f32::NAN; 3]; count];
        (0..count).for_each(|v| positions[at(v)] = mesh.positions[v]);
        let mut triangles: Vec<[u32; 3]> =
            mesh.triangles.iter().map(|t| t.map(|v| at(v as usize) as u32)).collect();
        triangles.sort_unstable();
        let mesh = TriMesh::new(positions, triangles);
        let density = Density { per_triangle: 3, budget: 0, seed: 0 };
        let sampler = Sampler::new(&mesh, density);
        let mut expected = Vec::new();
        for first in (0..sampler.part_count()).step_by(CHUNK) {
            let mut chunk = Vec::new();
            let end = sampler.part_count().min(first + CHUNK);
            sampler.samples_of(first..end, |point, area| chunk.push((point, area)));
            expected.push(chunk);
        }
        // The way from sample to sample, as it is told and as it is searched.
        let way = |points: &[Point3<f64>]| points.windows(2).map(|p| (p[1] - p[0]).norm()).sum::<f64>();
        let told = way(&expected.iter().flatten().map(|(point, _)| *point).collect::<Vec<_>>());
        let searched = std::sync::Mutex::new(0.0);
        let found: Vec<Vec<(Point3<f64>, f64)>> = Block::all(&sampler)
            .flat_map_iter(|block| {
                block.sweep(
                    &sampler,
                    || None,
                    |last: &mut Option<Point3<f64>>, point, _| {
                        *searched.lock().unwrap() += last.map_or(0.0, |last| (point - last).norm());
                        *last = Some(point);
                        point
                    },
                    |chunk: &mut Vec<_>, point, area, found| {
                        assert_eq!(point, found);
                        chunk.push((point, area));
                    },
                )
            })
            .collect();
        assert_eq!(found, expected);
        let searched = *searched.lock().unwrap();
        assert!(sampler.part_count() > 2 * CHUNK * CHUNKS && searched < 0.2 * told, "{searched} {told}");
    }
}
