//! Which vertices of different tiles are one: those at the same place, or no farther from each other than the tiles were cut apart.
//!
//! Those at the same place become one first. Of others two become one that are the nearest of each other among those of their tiles.
//! Two vertices of one tile always stay two. So the tile's faces keep their shapes, and what meets there already goes on to do so.

use crate::error::SourceError;
use crate::weld::{ordered, plain};
use bytemuck::{Pod, Zeroable};
use chpm_extmem::{Buffer, BufferWriter, Cancel, Reservation, Sorted, Sorter, Store};
use std::collections::{HashMap, VecDeque};
use std::ops::Range;

/// Vertices after which a wish to stop is looked for.
const HEED: u64 = 1 << 14;
/// Vertices for whose memory the budget is asked at once.
const STEP: u64 = 1 << 12;
/// Bytes that a vertex takes that others may be near to, at most.
const ENTRY: u64 = 512;
/// The way in which vertices are met, of length 1. Walls and grounds are not at a right angle to it, so that few are met at a time.
const WAY: [f64; 3] = [0.6, 0.36, 0.714_422_843_979_67];

/// Vertices of tiles, one tile after the other.
pub(crate) struct Seams {
    places: Sorter<Place>,
    /// How far apart two may be; 0 for the same place.
    weld: f64,
    /// Of each tile its box and its first vertex.
    boxes: Vec<Extent>,
    starts: Vec<u64>,
    vertices: u64,
    store: Store,
}

/// Where a vertex is, in the order in which they are met.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Pod, Zeroable)]
#[repr(C)]
struct Place {
    /// Along the way, if there is a distance.
    along: u64,
    position: [u64; 3],
    vertex: u32,
    tile: u32,
}

/// The box of a tile.
#[derive(Clone, Copy)]
struct Extent {
    min: [f64; 3],
    max: [f64; 3],
}

impl Extent {
    const NOTHING: Extent = Extent { min: [f64::INFINITY; 3], max: [f64::NEG_INFINITY; 3] };

    fn add(&mut self, position: [f64; 3]) {
        for (axis, x) in position.into_iter().enumerate() {
            self.min[axis] = self.min[axis].min(x);
            self.max[axis] = self.max[axis].max(x);
        }
    }

    /// Whether a place is no farther from it than this along any axis.
    fn is_near(&self, position: [f64; 3], reach: f64) -> bool {
        (0..3)
            .all(|axis| position[axis] >= self.min[axis] - reach && position[axis] <= self.max[axis] + reach)
    }

    fn meets(&self, other: &Extent, reach: f64) -> bool {
        (0..3).all(|axis| {
            other.max[axis] >= self.min[axis] - reach && other.min[axis] <= self.max[axis] + reach
        })
    }
}

/// New numbers of the vertices of all tiles.
pub(crate) struct NewNumbers {
    /// The new number of each: that of another one if it is left out.
    of: Buffer<u32>,
    /// For each tile the first number of its own, and behind them how many there are.
    firsts: Vec<u32>,
    /// How many are left out.
    pub(crate) joined: u64,
}

impl NewNumbers {
    /// The new number of a vertex, if there is one.
    pub(crate) fn get(&self, vertex: u32) -> Option<u32> {
        self.of.get(vertex as usize).copied()
    }

    /// The numbers of the vertices of a tile that stay.
    pub(crate) fn of_tile(&self, tile: usize) -> Range<u32> {
        let at = |tile: usize| self.firsts.get(tile).or(self.firsts.last()).copied().unwrap_or(0);
        at(tile)..at(tile + 1)
    }
}

impl Seams {
    pub(crate) fn new(weld: f64, store: &Store) -> Seams {
        let places = Sorter::new(store, "vertices of tiles");
        Seams { places, weld, boxes: Vec::new(), starts: Vec::new(), vertices: 0, store: store.clone() }
    }

    /// The vertex that comes next, of a tile no earlier than those before; none for one that is nowhere.
    pub(crate) fn push(&mut self, position: Option<[f64; 3]>, tile: usize) -> Result<(), SourceError> {
        while self.boxes.len() <= tile {
            self.boxes.push(Extent::NOTHING);
            self.starts.push(self.vertices);
        }
        if let Some(position) = position {
            // Zero has two signs, and one place.
            let position = position.map(|x| x + 0.0);
            self.boxes[tile].add(position);
            let along = if self.weld > 0.0 { ordered(along(position)) } else { 0 };
            let (vertex, tile) = (self.vertices as u32, tile as u32);
            self.places.push(Place { along, position: position.map(ordered), vertex, tile })?;
        }
        self.vertices += 1;
        Ok(())
    }

    /// Meets all vertices, and gives those that stay their numbers: the order of the tiles.
    pub(crate) fn finish(self, cancel: &Cancel) -> Result<NewNumbers, SourceError> {
        const LEFT_OUT: u32 = u32::MAX;
        let Seams { places, weld, boxes, starts, vertices, store } = self;
        let mut joined = BufferWriter::<[u32; 2]>::new(&store, "joined vertices", 0)?;
        let mut places = Heeded { places: places.finish()?, met: 0, cancel };
        match weld > 0.0 {
            true => join_near(&mut places, weld, &boxes, &store, &mut joined)?,
            false => join_equal(&mut places, &mut joined)?,
        }
        drop(places);

        let joined = joined.finish()?;
        let mut of = Buffer::<u32>::zeroed(&store, "numbers of vertices", vertices as usize)?;
        joined.iter().for_each(|[vertex, _]| of[*vertex as usize] = LEFT_OUT);
        let (mut next, mut firsts, mut starts) =
            (0, Vec::with_capacity(starts.len() + 1), starts.iter().peekable());
        for (vertex, number) in (0..).zip(of.iter_mut()) {
            while starts.next_if(|start| **start <= vertex).is_some() {
                firsts.push(next);
            }
            if *number != LEFT_OUT {
                *number = next;
                next += 1;
            }
        }
        firsts.resize(firsts.len() + starts.count() + 1, next);
        joined.iter().for_each(|[vertex, stays]| of[*vertex as usize] = of[*stays as usize]);
        Ok(NewNumbers { of, firsts, joined: joined.len() as u64 })
    }
}

/// Places in their order, until that is to stop.
struct Heeded<'a> {
    places: Sorted<Place>,
    met: u64,
    cancel: &'a Cancel,
}

impl Heeded<'_> {
    fn next(&mut self) -> Result<Option<Place>, SourceError> {
        self.met += 1;
        if self.met.is_multiple_of(HEED) && self.cancel.is_cancelled() {
            return Err(SourceError::Cancelled);
        }
        Ok(self.places.next()?)
    }
}

/// Vertices at one place come together, those of a tile behind those of the tiles before: the second of a tile becomes one with the second
/// of another.
fn join_equal(places: &mut Heeded<'_>, joined: &mut BufferWriter<[u32; 2]>) -> Result<(), SourceError> {
    let mut stay: Vec<u32> = Vec::new();
    let (mut last, mut of_tile) = (None::<Place>, 0);
    while let Some(place) = places.next()? {
        let is_same = last.is_some_and(|last| last.position == place.position);
        let is_of_tile = is_same && last.is_some_and(|last| last.tile == place.tile);
        of_tile = if is_of_tile { of_tile + 1 } else { 0 };
        if !is_same {
            stay.clear();
        }
        match stay.get(of_tile) {
            Some(other) => joined.extend_from_slice(&[[place.vertex, *other]])?,
            None => stay.push(place.vertex),
        }
        last = Some(place);
    }
    Ok(())
}

/// Vertices at one place come together first, as [`join_equal`] has it. Those of two tiles that are the nearest ones of each other become one then; all are the first on the way.
fn join_near(
    places: &mut Heeded<'_>,
    weld: f64,
    boxes: &[Extent],
    store: &Store,
    joined: &mut BufferWriter<[u32; 2]>,
) -> Result<(), SourceError> {
    let others = neighbours(boxes, weld);
    let mut near = Near::new(weld, store)?;
    // What is at one place; the second vertices of tiles are the second one.
    let mut here: Vec<Stay> = Vec::new();
    let (mut tile, mut of_tile) = (u32::MAX, 0);
    while let Some(place) = places.next()? {
        let position = place.position.map(plain);
        let is_near = |other: &u32| boxes[*other as usize].is_near(position, weld);
        if !others[place.tile as usize].iter().any(is_near) {
            continue;
        }
        if here.first().is_some_and(|stay| stay.position != position) {
            near.take(&mut here, joined)?;
            tile = u32::MAX;
        }
        of_tile = if place.tile == tile { of_tile + 1 } else { 0 };
        tile = place.tile;
        match here.get_mut(of_tile) {
            Some(stay) => stay.vertices.push([place.vertex, tile]),
            None => here.push(Stay::new(position, of_tile, [place.vertex, tile])),
        }
    }
    near.take(&mut here, joined)?;
    near.pass(f64::INFINITY, joined)
}

/// For each tile the others that it may have a vertex near to.
fn neighbours(boxes: &[Extent], weld: f64) -> Vec<Vec<u32>> {
    let of = |at: usize| {
        let is_near = |(other, there): &(usize, &Extent)| *other != at && boxes[at].meets(there, weld);
        let others = boxes.iter().enumerate().filter(is_near);
        others.map(|(other, _)| other as u32).collect()
    };
    (0..boxes.len()).map(of).collect()
}

/// Places of vertices, as long as others may be near to them.
struct Near {
    weld: f64,
    /// In the order of the way, and how many were there before the first.
    stay: VecDeque<Stay>,
    left: u64,
    /// How many of all have been met by whatever is near to them.
    passed: u64,
    /// Which of them are in a cell of a grid: their numbers in that order.
    cells: HashMap<[i64; 3], VecDeque<u64>>,
    share: Reservation,
    reserved: u64,
}

/// Vertices of different tiles at one place.
struct Stay {
    position: [f64; 3],
    /// Which of those of its tiles at this place it is.
    of_tile: usize,
    /// Each with its tile.
    vertices: Vec<[u32; 2]>,
    /// For each tile around the nearest one that has a vertex of it and none of these tiles, and its squared distance.
    nearest: Vec<(u32, f64, u64)>,
    /// The first of those that are one with it, and of that one the others.
    first: u64,
    rest: Vec<u64>,
    /// The vertex that all of them become.
    stays: u32,
}

impl Stay {
    fn new(position: [f64; 3], of_tile: usize, vertex: [u32; 2]) -> Stay {
        let [stays, _] = vertex;
        let vertices = vec![vertex];
        Stay { position, of_tile, vertices, nearest: Vec::new(), first: 0, rest: Vec::new(), stays }
    }

    fn tiles(&self) -> impl Iterator<Item = u32> {
        self.vertices.iter().map(|[_, tile]| *tile)
    }

    fn shares_a_tile(&self, other: &Stay) -> bool {
        self.tiles().any(|tile| other.tiles().any(|there| there == tile))
    }

    /// Knows another one; of two that are as near the first stays the nearest.
    fn meet(&mut self, tiles: impl Iterator<Item = u32>, squared: f64, at: u64) {
        for tile in tiles {
            match self.nearest.iter_mut().find(|(of, ..)| *of == tile) {
                Some((_, least, nearest)) if (squared, at) < (*least, *nearest) => {
                    (*least, *nearest) = (squared, at);
                }
                Some(_) => {}
                None => self.nearest.push((tile, squared, at)),
            }
        }
    }

    fn is_nearest(&self, at: u64) -> bool {
        self.nearest.iter().any(|(_, _, nearest)| *nearest == at)
    }
}

impl Near {
    fn new(weld: f64, store: &Store) -> Result<Near, SourceError> {
        let share = store.budget.reserve_work("vertices to weld", 0)?;
        let (stay, cells) = (VecDeque::new(), HashMap::new());
        Ok(Near { weld, stay, left: 0, passed: 0, cells, share, reserved: 0 })
    }

    /// A cell is two distances long, so that what is near is in eight of them at most.
    fn cell(&self, position: [f64; 3]) -> [i64; 3] {
        position.map(|x| (x / (2.0 * self.weld)).floor() as i64)
    }

    fn at(&self, at: u64) -> &Stay {
        &self.stay[(at - self.left) as usize]
    }

    fn at_mut(&mut self, at: u64) -> &mut Stay {
        &mut self.stay[(at - self.left) as usize]
    }

    /// Goes on to a place along the way. What is a distance behind it has met all that is near, and becomes one with what came before; what is two more behind that is told.
    fn pass(&mut self, to: f64, joined: &mut BufferWriter<[u32; 2]>) -> Result<(), SourceError> {
        while self.passed < self.left + self.stay.len() as u64
            && along(self.at(self.passed).position) < to - self.weld
        {
            let passed = self.passed;
            let mut nearest = std::mem::take(&mut self.at_mut(passed).nearest);
            nearest.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.2.cmp(&b.2)));
            for (_, _, other) in &nearest {
                if *other < passed && self.at(*other).is_nearest(passed) {
                    self.join(*other, passed);
                }
            }
            self.at_mut(passed).nearest = nearest;
            self.passed += 1;
        }
        // Whatever is one with the first of some is a distance from it at most, and what that may meet is one more away.
        while self.left < self.passed
            && let Some(stay) = self.stay.pop_front_if(|stay| along(stay.position) < to - 4.0 * self.weld)
        {
            for [vertex, _] in stay.vertices.iter().filter(|[vertex, _]| *vertex != stay.stays) {
                joined.extend_from_slice(&[[*vertex, stay.stays]])?;
            }
            let cell = self.cell(stay.position);
            if let Some(inside) = self.cells.get_mut(&cell) {
                inside.pop_front();
                if inside.is_empty() {
                    self.cells.remove(&cell);
                }
            }
            self.left += 1;
        }
        Ok(())
    }

    /// Makes two one, with all that are one with either, if no two of them are of one tile and none is farther than the distance from the first.
    fn join(&mut self, a: u64, b: u64) {
        let [a, b] = [a, b].map(|at| self.at(at).first);
        let (first, second) = (a.min(b), a.max(b));
        if first == second {
            return;
        }
        let of = |at: u64| std::iter::once(at).chain(self.at(at).rest.iter().copied());
        let place = self.at(first).position;
        let fits = |at: u64| {
            let stay = self.at(at);
            squared_distance(stay.position, place) <= self.weld * self.weld
                && of(first).all(|other| !self.at(other).shares_a_tile(stay))
        };
        if !of(second).all(fits) {
            return;
        }
        let more: Vec<u64> = of(second).collect();
        let stays = self.at(first).stays;
        for at in &more {
            let stay = self.at_mut(*at);
            (stay.first, stay.stays) = (first, stays);
            stay.rest.clear();
        }
        self.at_mut(first).rest.extend(more);
    }

    /// Takes what is at one place, farther on the way.
    fn take(&mut self, here: &mut Vec<Stay>, joined: &mut BufferWriter<[u32; 2]>) -> Result<(), SourceError> {
        let Some(Stay { position, .. }) = here.first() else { return Ok(()) };
        // Sums are rounded.
        let slack = 1e-14 * position.iter().map(|x| x.abs()).sum::<f64>();
        self.pass(along(*position) - slack, joined)?;
        for stay in here.drain(..) {
            self.add(stay)?;
        }
        Ok(())
    }

    fn add(&mut self, mut new: Stay) -> Result<(), SourceError> {
        let count = self.stay.len() as u64 + 1;
        if count > self.reserved {
            self.reserved = count.next_multiple_of(STEP);
            self.share.resize(self.reserved * ENTRY)?;
        }
        let (position, number) = (new.position, self.left + self.stay.len() as u64);
        new.first = number;
        let [from, to] = [-self.weld, self.weld].map(|step| self.cell(position.map(|x| x + step)));
        for corner in 0..8 {
            let cell =
                std::array::from_fn(|axis| if corner >> axis & 1 == 1 { to[axis] } else { from[axis] });
            let is_again = (0..3).any(|axis| corner >> axis & 1 == 1 && from[axis] == to[axis]);
            if is_again {
                continue;
            }
            for at in self.cells.get(&cell).into_iter().flatten() {
                let stay = &mut self.stay[(at - self.left) as usize];
                let squared = squared_distance(stay.position, position);
                let is_met = squared <= self.weld * self.weld && stay.of_tile == new.of_tile;
                if is_met && !stay.shares_a_tile(&new) {
                    stay.meet(new.tiles(), squared, number);
                    new.meet(stay.tiles(), squared, *at);
                }
            }
        }
        let cell = self.cell(position);
        self.cells.entry(cell).or_default().push_back(number);
        self.stay.push_back(new);
        Ok(())
    }
}

fn squared_distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum()
}

fn along(position: [f64; 3]) -> f64 {
    position[0] * WAY[0] + position[1] * WAY[1] + position[2] * WAY[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// For each vertex of some tiles the one that it becomes, and how many are left out.
    fn joined(tiles: &[Vec<[f64; 3]>], weld: f64) -> (Vec<u32>, u64) {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::create(folder.path(), 1 << 30).unwrap();
        let mut seams = Seams::new(weld, &store);
        for (tile, positions) in tiles.iter().enumerate() {
            positions.iter().for_each(|position| seams.push(Some(*position), tile).unwrap());
        }
        let numbers = seams.finish(&Cancel::default()).unwrap();
        let count = tiles.iter().map(Vec::len).sum::<usize>() as u32;
        ((0..count).map(|vertex| numbers.get(vertex).unwrap()).collect(), numbers.joined)
    }

    /// A grid of 40 by 40 points from an x on, whose height hangs on where a point is.
    fn grid(from: f64) -> Vec<[f64; 3]> {
        let at = |i: u32| f64::from(i) / 39.0;
        let place = |x: f64, y: f64| [x, y, 0.1 * libm::sin(5.0 * x) * libm::cos(7.0 * y)];
        (0..1600).map(|i| place(from + at(i % 40), at(i / 40))).collect()
    }

    #[test]
    fn what_is_at_one_place_becomes_one_whatever_is_near() {
        let tiles = [grid(0.0), grid(1.0)];
        let (exact, count) = joined(&tiles, 0.0);
        assert_eq!(count, 40);
        for weld in [1e-6, 0.01, 0.03, 0.05] {
            assert!(joined(&tiles, weld) == (exact.clone(), 40), "{weld}");
        }
    }

    #[test]
    fn what_is_off_by_less_than_neighbours_are_apart_finds_its_own() {
        for off in [[0.004, 0.0, 0.0], [0.003, -0.009, 0.002], [-0.002, 0.01, -0.004]] {
            let mut other = grid(1.0);
            other.iter_mut().flatten().zip(off.iter().cycle()).for_each(|(x, by)| *x += by);
            let tiles = [grid(0.0), other];
            let (found, count) = joined(&tiles, 0.05);
            assert_eq!(count, 40, "{off:?}");
            for row in 0..40 {
                assert_eq!(found[1600 + 40 * row], found[40 * row + 39], "{off:?} {row}");
            }
        }
    }

    #[test]
    fn more_tiles_than_two_become_one_and_twins_stay_two() {
        let corner = |x: f64, y: f64| vec![[x, y, 0.0], [1e3 * x, 1e3 * y, 1.0], [x, y, 0.0]];
        let tiles = [corner(0.0, 0.0), corner(1e-3, 0.0), corner(1e-3, 1e-3), corner(-1e-3, 2e-3)];
        let (found, count) = joined(&tiles, 0.01);
        assert_eq!(count, 6);
        for tile in 1..4 {
            assert_eq!((found[3 * tile], found[3 * tile + 2]), (found[0], found[2]), "{tile}");
        }
        assert_ne!(found[0], found[2]);
    }
}
