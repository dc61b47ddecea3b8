//! Searches a surface of tiles for one point after the other.

use crate::box_tree::{BoxTree, squared_distance_to_box};
use crate::bvh::Bvh;
use crate::proof::Corners;
use crate::tiles::Tiles;
use nalgebra::Point3;
use std::sync::Arc;

/// Tiles that are kept at hand: those around a point where some meet.
const HELD: usize = 6;

/// Searches [`Tiles`], best from points that each are near the one before: it begins with what was nearest to that, and keeps the tiles at hand that
/// it was at last.
pub struct Searcher<'t> {
    tiles: &'t Tiles<'t>,
    held: Held,
    last: Option<Hit>,
}

/// The nearest triangle of a surface of tiles.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Hit {
    /// The tile that it is in.
    pub tile: usize,
    /// Its distance.
    pub distance: f64,
    square: f64,
    place: usize,
}

/// Tiles at hand, the last one first.
#[derive(Default)]
struct Held(Vec<(usize, Arc<Bvh>)>);

impl Held {
    fn bvh(&mut self, tiles: &Tiles<'_>, tile: usize) -> &Bvh {
        match self.0.iter().position(|(held, _)| *held == tile) {
            Some(at) => self.0[..=at].rotate_right(1),
            None => {
                self.0.truncate(HELD - 1);
                self.0.insert(0, (tile, tiles.bvh(tile)));
            }
        }
        &self.0[0].1
    }
}

impl<'t> Searcher<'t> {
    /// Bytes that one keeps at hand at most, where no tile has more than so many triangles.
    pub fn bytes(triangles: u64) -> u64 {
        HELD as u64 * Bvh::bytes(triangles)
    }

    /// Of all tiles.
    pub fn new(tiles: &'t Tiles<'t>) -> Self {
        Searcher { tiles, held: Held::default(), last: None }
    }

    /// The nearest triangle of all tiles; none where there is none. Among triangles at the same distance what was nearest before may decide.
    pub fn nearest(&mut self, point: Point3<f64>) -> Option<Hit> {
        let known = self.again(point);
        self.nearer(point, known)
    }

    /// As [`Searcher::nearest`], but not looked for where what was nearest before is nearer than `enough`, which gets its tile. The nearest triangle is then no farther;
    /// where `alone` is asked for, it is in that tile.
    pub fn near_enough(
        &mut self,
        point: Point3<f64>,
        alone: bool,
        enough: impl Fn(usize) -> f64,
    ) -> Option<Hit> {
        let known = self.again(point);
        match known {
            Some(hit) if hit.distance < enough(hit.tile) && !(alone && self.has_other(point, hit)) => known,
            _ => self.nearer(point, known),
        }
    }

    /// Distance from another point to the triangle that was nearest before: an upper bound to start with.
    fn again(&mut self, point: Point3<f64>) -> Option<Hit> {
        let last = self.last?;
        let square = self.held.bvh(self.tiles, last.tile).squared_distance(last.place, point);
        Some(Hit { distance: square.sqrt(), square, ..last })
    }

    /// Whether another tile than that of a hit may be as near.
    fn has_other(&self, point: Point3<f64>, hit: Hit) -> bool {
        let (mut best, mut has_other) = (hit.square, false);
        self.tiles.tree().search(point, &mut best, |place, best| {
            let tile = self.tiles.tree().order()[place] as usize;
            if tile != hit.tile && self.tiles.may_be_nearer(tile, point, *best) {
                // Nothing more has to be looked at.
                (*best, has_other) = (0.0, true);
            }
        });
        has_other
    }

    fn nearer(&mut self, point: Point3<f64>, known: Option<Hit>) -> Option<Hit> {
        let Searcher { tiles, held, last } = self;
        let mut hit = known.map(|hit| (hit.tile, hit.place));
        let mut best = known.map_or(f64::INFINITY, |hit| hit.square);
        let mut look = |tile: usize, best: &mut f64| {
            if let Some(place) = held.bvh(tiles, tile).improve(point, best) {
                hit = Some((tile, place));
            }
        };
        if let Some(known) = known {
            look(known.tile, &mut best);
        }
        tiles.tree().search(point, &mut best, |place, best| {
            let tile = tiles.tree().order()[place] as usize;
            if known.is_none_or(|known| known.tile != tile) && tiles.may_be_nearer(tile, point, *best) {
                look(tile, best);
            }
        });
        // A distance that is not a number is none.
        let hit = hit.filter(|_| best < f64::INFINITY);
        *last = hit.map(|(tile, place)| Hit { tile, distance: best.sqrt(), square: best, place }).or(*last);
        hit.and(*last)
    }

    /// Lowers `best`, a squared distance, to that of the nearest triangle of one tile; whether it has one that is nearer.
    pub fn improve(&mut self, tile: usize, point: Point3<f64>, best: &mut f64) -> bool {
        self.tiles.may_be_nearer(tile, point, *best)
            && self.held.bvh(self.tiles, tile).improve(point, best).is_some()
    }

    /// The triangle that leaves a point most room to the distance that its tile may have; none if all are farther than theirs. `near` is a tree of
    /// [`Tiles::boxes`] that reach as far.
    pub(crate) fn roomiest(
        &mut self,
        point: Point3<f64>,
        near: &BoxTree,
        of: impl Fn(usize) -> f64,
    ) -> Option<Hit> {
        let (mut everything, mut room, mut hit) = (f64::INFINITY, 0.0, None);
        near.search(point, &mut everything, |place, _| {
            let tile = near.order()[place] as usize;
            // What is no nearer leaves no more room.
            let most = of(tile) - room;
            let mut best = (most * most).next_up();
            if most >= 0.0
                && squared_distance_to_box(point, &self.tiles.boxes()[tile]) < best
                && let Some(place) = self.held.bvh(self.tiles, tile).improve(point, &mut best)
            {
                room = of(tile) - best.sqrt();
                hit = Some(Hit { tile, distance: best.sqrt(), square: best, place });
            }
        });
        hit
    }

    /// Whether every tile is farther than its own distance, with rounding on the safe side. `near` is a tree of [`Tiles::boxes`] that reach as
    /// far, and as rounding.
    pub(crate) fn is_beyond(
        &mut self,
        point: Point3<f64>,
        near: &BoxTree,
        of: impl Fn(usize) -> f64,
    ) -> bool {
        let (mut everything, mut is_beyond) = (f64::INFINITY, true);
        near.search(point, &mut everything, |place, everything| {
            let tile = near.order()[place] as usize;
            let mut best = f64::INFINITY;
            self.held.bvh(self.tiles, tile).lower_bound(point, &mut best);
            if best.sqrt() <= of(tile) {
                // Nothing more has to be looked at.
                (*everything, is_beyond) = (0.0, false);
            }
        });
        is_beyond
    }

    /// A distance that the point has from all triangles at least, with rounding on the safe side; infinite where there is none.
    pub(crate) fn lower_bound(&mut self, point: Point3<f64>) -> f64 {
        let mut best = f64::INFINITY;
        self.tiles.tree().search(point, &mut best, |place, best| {
            let tile = self.tiles.tree().order()[place] as usize;
            self.held.bvh(self.tiles, tile).lower_bound(point, best);
        });
        best.sqrt()
    }

    /// The triangle of a hit.
    pub(crate) fn corners(&mut self, hit: Hit) -> Corners {
        self.held.bvh(self.tiles, hit.tile).corners(hit.place)
    }
}
