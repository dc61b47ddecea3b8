//! Which vertices of different tiles are one: those at the same place, or no farther from each other than the tiles were cut apart.
//!
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
const ENTRY: u64 = 256;
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

/// Each vertex becomes one with the nearest of those that were met before and stay, and that none of its tile has become one with.
fn join_near(
    places: &mut Heeded<'_>,
    weld: f64,
    boxes: &[Extent],
    store: &Store,
    joined: &mut BufferWriter<[u32; 2]>,
) -> Result<(), SourceError> {
    let others = neighbours(boxes, weld);
    let mut near = Near::new(weld, store)?;
    while let Some(place) = places.next()? {
        let position = place.position.map(plain);
        let is_near = |other: &u32| boxes[*other as usize].is_near(position, weld);
        if !others[place.tile as usize].iter().any(is_near) {
            continue;
        }
        near.pass(position);
        match near.join(position, place.tile) {
            Some(other) => joined.extend_from_slice(&[[place.vertex, other]])?,
            None => near.add(position, place)?,
        }
    }
    Ok(())
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

/// Vertices that stay and that others may be near to.
struct Near {
    weld: f64,
    /// In the order of the way, and how many were there before the first.
    stay: VecDeque<Stay>,
    passed: u64,
    /// Which of them are in a cell of a grid: their numbers in that order.
    cells: HashMap<[i64; 3], VecDeque<u64>>,
    share: Reservation,
    reserved: u64,
}

struct Stay {
    position: [f64; 3],
    vertex: u32,
    /// Its tile, and those of the vertices that became one with it.
    tiles: Vec<u32>,
}

impl Near {
    fn new(weld: f64, store: &Store) -> Result<Near, SourceError> {
        let share = store.budget.reserve_work("vertices to weld", 0)?;
        Ok(Near { weld, stay: VecDeque::new(), passed: 0, cells: HashMap::new(), share, reserved: 0 })
    }

    /// A cell is two distances long, so that what is near is in eight of them at most.
    fn cell(&self, position: [f64; 3]) -> [i64; 3] {
        position.map(|x| (x / (2.0 * self.weld)).floor() as i64)
    }

    /// Leaves those behind that are too far back for a vertex here, and for all that come.
    fn pass(&mut self, position: [f64; 3]) {
        // Sums are rounded.
        let slack = 1e-14 * position.iter().map(|x| x.abs()).sum::<f64>();
        let least = along(position) - self.weld - slack;
        while self.stay.front().is_some_and(|stay| along(stay.position) < least)
            && let Some(stay) = self.stay.pop_front()
        {
            let cell = self.cell(stay.position);
            if let Some(inside) = self.cells.get_mut(&cell) {
                inside.pop_front();
                if inside.is_empty() {
                    self.cells.remove(&cell);
                }
            }
            self.passed += 1;
        }
    }

    /// The nearest one, which is then one with a vertex of this tile; the earlier of two that are as near.
    fn join(&mut self, position: [f64; 3], tile: u32) -> Option<u32> {
        let [from, to] = [-self.weld, self.weld].map(|step| self.cell(position.map(|x| x + step)));
        let mut best: Option<(f64, u64)> = None;
        for corner in 0..8 {
            let cell =
                std::array::from_fn(|axis| if corner >> axis & 1 == 1 { to[axis] } else { from[axis] });
            let is_again = (0..3).any(|axis| corner >> axis & 1 == 1 && from[axis] == to[axis]);
            if is_again {
                continue;
            }
            for at in self.cells.get(&cell).into_iter().flatten() {
                let stay = &self.stay[(at - self.passed) as usize];
                let squared = squared_distance(stay.position, position);
                let is_better = best.is_none_or(|best| (squared, *at) < best);
                if squared <= self.weld * self.weld && is_better && !stay.tiles.contains(&tile) {
                    best = Some((squared, *at));
                }
            }
        }
        best.map(|(_, at)| {
            let stay = &mut self.stay[(at - self.passed) as usize];
            stay.tiles.push(tile);
            stay.vertex
        })
    }

    fn add(&mut self, position: [f64; 3], place: Place) -> Result<(), SourceError> {
        let count = self.stay.len() as u64 + 1;
        if count > self.reserved {
            self.reserved = count.next_multiple_of(STEP);
            self.share.resize(self.reserved * ENTRY)?;
        }
        let cell = self.cell(position);
        self.cells.entry(cell).or_default().push_back(self.passed + self.stay.len() as u64);
        self.stay.push_back(Stay { position, vertex: place.vertex, tiles: vec![place.tile] });
        Ok(())
    }
}

fn squared_distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum()
}

fn along(position: [f64; 3]) -> f64 {
    position[0] * WAY[0] + position[1] * WAY[1] + position[2] * WAY[2]
}
