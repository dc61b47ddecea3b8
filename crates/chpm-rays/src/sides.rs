//! Which components of the source are turned inside out.
//!
//! 1. A component is closed where each of its edges is gone along as often one way as the other. Then its signed volume says whether its triangles turn left as seen from
//!    outside.
//! 2. A component that lies within another is turned as that one is, so that walls of cavities stay what they are; and once more where points inside of it would be inside less than zero times.
//!    Who is around it is found by rays from its farthest vertices, ahead and back, by the side on which each meets the next component. Components that overlap are not within
//!    each other: both rays have to say so, and the boxes.
//! 3. Components that are not closed are judged together, since parts of a wall seldom are one: they are turned where the signed volume is negative about each point of a box four times
//!    as large as theirs. Otherwise they have no inside, and stay as they are.

mod forest;
mod shape;

use crate::bound::Bound;
use crate::caster::Caster;
use crate::error::RayError;
use crate::ray::{Hit, Ray, Seek};
use chpm_format::Page;
use chpm_mesh::ClusterId;
use forest::Forest;
use shape::{AHEAD, Shape};

/// Whether the components of a file's leaves are turned inside out.
#[derive(Debug)]
pub struct Sides {
    /// The first piece of each cluster; a piece is what a leaf has of a component.
    starts: Vec<u32>,
    /// Of each piece, but where all are one component.
    turned: Vec<bool>,
    is_whole: bool,
    /// Components that have triangles.
    pub components: u64,
    /// Those of them that are turned.
    pub turned_components: u64,
}

/// With more pieces than this a model is judged as a whole.
const MOST: usize = 1 << 18;
/// Leaves that are read side by side, for each thread.
const BATCH: usize = 4;

/// A leaf's pieces, and which of them has each of its shared vertices.
struct Part {
    shapes: Vec<Shape>,
    shared: Vec<(u32, u32)>,
}

impl Sides {
    /// Bytes that finding them takes, for so many vertices of leaves and shared ones.
    pub fn memory(vertices: u64, shared: u64) -> u64 {
        (2 * size_of::<Shape>() + 40) as u64 * vertices.min(MOST as u64) + 4 * shared
    }

    /// Reads all leaves, on the threads of rayon's current pool; `begun` is told each and may end it.
    ///
    /// # Errors
    /// [`RayError::Format`] for a damaged page, [`RayError::Stopped`].
    pub fn find<D: AsRef<[u8]> + Sync>(
        caster: &mut Caster<'_, D>,
        begun: &(impl Fn() -> bool + Sync),
    ) -> Result<Self, RayError> {
        let file = caster.file;
        let leaves: Vec<ClusterId> = (0..)
            .map(ClusterId)
            .zip(file.clusters())
            .filter(|(_, record)| record.is_leaf())
            .map(|(id, _)| id)
            .collect();
        let mut starts = vec![0; file.clusters().len()];
        let mut shapes: Vec<Shape> = Vec::new();
        let mut forest = Forest::default();
        let mut owners = vec![u32::MAX; file.header().shared_vertex_count as usize];
        let mut is_whole = false;
        for some in leaves.chunks(BATCH * rayon::current_num_threads()) {
            let read = |leaf: &ClusterId| {
                if !begun() {
                    return Err(RayError::Stopped);
                }
                Ok(part(&file.page(*leaf)?.view()))
            };
            let parts = caster.memory.readers.read(some, read)?;
            for (leaf, part) in some.iter().zip(parts) {
                starts[leaf.index()] = shapes.len() as u32;
                is_whole |= shapes.len() + part.shapes.len() > MOST;
                if is_whole {
                    let all = shapes.drain(..).chain(part.shapes);
                    let whole = all.fold(Shape::EMPTY, |whole, shape| whole.with(&shape));
                    shapes.push(whole);
                    continue;
                }
                shapes.extend(part.shapes);
                forest.grow(shapes.len());
                for (id, piece) in part.shared {
                    let (owner, piece) = (&mut owners[id as usize], starts[leaf.index()] + piece);
                    if *owner == u32::MAX { *owner = piece } else { forest.join(*owner, piece) }
                }
            }
        }
        drop(owners);
        if is_whole {
            forest = Forest::default();
            forest.grow(1);
        }

        let of_piece: Vec<u32> = (0..shapes.len() as u32).map(|piece| forest.root(piece)).collect();
        let pieces = (0..).zip(std::mem::take(&mut shapes));
        shapes = vec![Shape::EMPTY; of_piece.len()];
        pieces.for_each(|(piece, shape): (usize, _)| {
            let sum = &mut shapes[of_piece[piece] as usize];
            *sum = sum.with(&shape);
        });
        let mut sides = Sides { starts, turned: Vec::new(), is_whole, components: 0, turned_components: 0 };
        let turned = sides.judge(caster, &shapes, &of_piece, begun)?;
        sides.components = shapes.iter().filter(|shape| shape.triangles > 0).count() as u64;
        sides.turned_components = turned.iter().filter(|is_turned| **is_turned).count() as u64;
        sides.turned = of_piece.iter().map(|component| turned[*component as usize]).collect();
        Ok(sides)
    }

    /// Whether each component is turned; by the number of its first piece.
    fn judge<D: AsRef<[u8]> + Sync>(
        &self,
        caster: &mut Caster<'_, D>,
        shapes: &[Shape],
        of_piece: &[u32],
        begun: &(impl Fn() -> bool + Sync),
    ) -> Result<Vec<bool>, RayError> {
        let open = shapes.iter().filter(|shape| !shape.is_closed());
        let open = open.fold(Shape::EMPTY, |sum, shape| sum.with(shape)).is_turned();
        let own: Vec<Option<bool>> =
            shapes.iter().map(|shape| if shape.is_closed() { shape.is_turned() } else { open }).collect();
        let mut turned: Vec<bool> = own.iter().map(|own| own == &Some(true)).collect();
        let mut order: Vec<u32> =
            (0..shapes.len() as u32).filter(|at| shapes[*at as usize].triangles > 0).collect();
        if order.iter().all(|at| turned[*at as usize] == turned[order[0] as usize]) {
            return Ok(turned);
        }

        let back = self.around(caster, shapes, of_piece, (&mut order, 1), &own, begun)?;
        let around = self.around(caster, shapes, of_piece, (&mut order, 0), &own, begun)?;
        // How many times a point is inside, counted by components from the outermost on.
        let mut inside = vec![0_i32; shapes.len()];
        for at in order {
            let at = at as usize;
            let mut outers = chain(&around, around[at]);
            let outer = outers.find(|outer| chain(&back, back[at]).any(|other| other == *outer));
            let (is_turned, times) =
                outer.map_or((false, 0), |outer| (turned[outer as usize], inside[outer as usize]));
            let sign = own[at].map_or(0, |own| if own == is_turned { 1 } else { -1 });
            let is_below = times + sign < 0;
            turned[at] = is_turned != is_below;
            inside[at] = times + if is_below { -sign } else { sign };
        }
        Ok(turned)
    }

    /// For each component the innermost one that a ray from its farthest vertex, ahead or back, comes out of, and whose box has its own. Orders them by how far they reach.
    fn around<D: AsRef<[u8]> + Sync>(
        &self,
        caster: &mut Caster<'_, D>,
        shapes: &[Shape],
        of_piece: &[u32],
        (order, way): (&mut [u32], usize),
        own: &[Option<bool>],
        begun: &(impl Fn() -> bool + Sync),
    ) -> Result<Vec<Option<u32>>, RayError> {
        // Whatever is around a component reaches farther.
        let reach = |at: &u32| shapes[*at as usize].reach[way];
        order.sort_by(|a, b| reach(b).total_cmp(&reach(a)));
        let mut around: Vec<Option<u32>> = vec![None; shapes.len()];
        let mut is_known = vec![false; shapes.len()];
        for some in order.chunks(caster.memory.rays.max(1)) {
            let met = self.met(caster, shapes, of_piece, (some, way), begun)?;
            for (at, met) in some.iter().zip(met) {
                let at = *at as usize;
                let met = met.filter(|(other, _)| is_known[*other as usize]);
                let next = met.and_then(|(other, is_back)| {
                    // Out of another component's back: it is around this one. Onto its front: they lie side by side.
                    let is_within = own[other as usize].is_some_and(|turned| is_back != turned);
                    if is_within { Some(other) } else { around[other as usize] }
                });
                let has_box = |other: &u32| shapes[at].is_in_box_of(&shapes[*other as usize]);
                let outer = chain(&around, next).find(has_box);
                (is_known[at], around[at]) = (true, outer);
            }
        }
        Ok(around)
    }

    /// The component that a ray from the farthest vertex of each one meets, and whether it meets its back.
    fn met<D: AsRef<[u8]> + Sync>(
        &self,
        caster: &mut Caster<'_, D>,
        shapes: &[Shape],
        of_piece: &[u32],
        (some, way): (&[u32], usize),
        begun: &(impl Fn() -> bool + Sync),
    ) -> Result<Vec<Option<(u32, bool)>>, RayError> {
        let direction = if way == 0 { AHEAD } else { AHEAD.map(|x| -x) };
        let ray = |at: &u32| {
            let from = shapes[*at as usize].far[way].map(f64::from);
            Ray { is_from_vertex: true, ..Ray::new(from, direction) }
        };
        let rays: Vec<Ray> = some.iter().map(ray).collect();
        let mut hits: Vec<Option<Hit>> = Vec::with_capacity(rays.len());
        caster.cast(&rays, &Bound::LEAVES, Seek::Nearest, begun, |hit, _| hits.push(hit))?;

        // By page, so that each is read once.
        let mut met = vec![None; some.len()];
        let mut order: Vec<usize> = (0..hits.len()).filter(|at| hits[*at].is_some()).collect();
        let cluster = |at: usize| hits[at].map_or(u32::MAX, |hit| hit.cluster.0);
        order.sort_by_key(|at| cluster(*at));
        for same in order.chunk_by(|a, b| cluster(*a) == cluster(*b)) {
            let leaf = ClusterId(cluster(same[0]));
            let page = caster.file.page(leaf)?;
            let page = page.view();
            let pieces = pieces(&page);
            for at in same {
                let Some(hit) = hits[*at] else { continue };
                let corner = page.triangles[hit.triangle as usize][0];
                let piece = self.starts[leaf.index()] + pieces[usize::from(corner)];
                let is_back = hit.normal.iter().zip(direction).map(|(a, b)| a * b).sum::<f64>() > 0.0;
                met[*at] = Some((of_piece[piece as usize], is_back));
            }
        }
        Ok(met)
    }

    /// Whether the component of each of a leaf's vertices is turned; nothing where none of the model is.
    pub fn of_leaf(&self, leaf: ClusterId, page: &Page<'_>) -> Option<Vec<bool>> {
        if self.turned_components == 0 {
            return None;
        }
        if self.is_whole {
            return Some(vec![true; page.vertex_count()]);
        }
        let first = self.starts[leaf.index()];
        Some(pieces(page).into_iter().map(|piece| self.turned[(first + piece) as usize]).collect())
    }
}

/// A component and those around it, from the innermost on.
fn chain(around: &[Option<u32>], first: Option<u32>) -> impl Iterator<Item = u32> {
    std::iter::successors(first, |at| around[*at as usize])
}

/// The piece of each vertex of a page, numbered from 0.
fn pieces(page: &Page<'_>) -> Vec<u32> {
    let mut forest = Forest::default();
    forest.grow(page.vertex_count());
    for [a, b, c] in page.triangles {
        forest.join((*a).into(), (*b).into());
        forest.join((*a).into(), (*c).into());
    }
    let mut numbers = vec![u32::MAX; page.vertex_count()];
    let mut count = 0;
    for vertex in 0..numbers.len() {
        // A root is the least of its tree, so it has its number.
        let root = forest.root(vertex as u32) as usize;
        if root == vertex {
            numbers[vertex] = count;
            count += 1;
        }
        numbers[vertex] = numbers[root];
    }
    numbers
}

fn part(page: &Page<'_>) -> Part {
    let pieces = pieces(page);
    let count = pieces.iter().max().map_or(0, |most| *most as usize + 1);
    let mut shapes = vec![Shape::EMPTY; count];
    let positions = page.vertices.positions;
    let keys: Vec<u64> = positions.iter().map(shape::key).collect();
    for triangle in page.triangles {
        let corners = triangle.map(usize::from);
        let shape = &mut shapes[pieces[corners[0]] as usize];
        shape.add(corners.map(|v| positions[v]), corners.map(|v| keys[v]));
    }
    let is_shared = |vertex: &usize| page.shared_bits[vertex / 8] >> (vertex % 8) & 1 == 1;
    let shared = (0..pieces.len()).filter(is_shared);
    let shared = shared.zip(page.shared_ids).map(|(vertex, id)| (*id, pieces[vertex])).collect();
    Part { shapes, shared }
}
