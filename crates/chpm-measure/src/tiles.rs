//! A surface in tiles that are loaded when a search comes to them, so that it need not fit into memory.

use crate::box_tree::{BoxTree, squared_distance_to_box};
use crate::bvh::Bvh;
use crate::parting::Parting;
use chpm_mesh::{Aabb, TriMesh, geom};
use nalgebra::{Point3, Vector3};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock};

/// A surface of tiles. Searches may come from any thread; which tiles are in memory shows in the time only.
pub struct Tiles<'a> {
    boxes: Vec<Aabb>,
    tree: BoxTree,
    slots: Vec<Slot>,
    load: Box<dyn Fn(usize) -> TriMesh + Sync + 'a>,
    /// Bytes of hierarchies to keep.
    budget: u64,
    held: AtomicU64,
    clock: AtomicU64,
}

#[derive(Default)]
struct Slot {
    bvh: Mutex<Option<Arc<Bvh>>>,
    /// Separation of the halves, found when the tile was first loaded, if boxes say little: it need not be loaded to see that it is far away.
    halves: OnceLock<Option<Parting>>,
    /// When it was loaded or last asked for under pressure.
    used: AtomicU64,
}

impl<'a> Tiles<'a> {
    /// A surface of a tile in each of `boxes`. `load` gives a tile's mesh, the same one every time, inside its box; about
    /// `budget` bytes of loaded tiles are kept, besides those that searches are at.
    pub fn new(boxes: Vec<Aabb>, budget: u64, load: impl Fn(usize) -> TriMesh + Sync + 'a) -> Self {
        let tree = BoxTree::parted(&boxes, |between, sets| part(&boxes, &load, between, sets));
        let slots = boxes.iter().map(|_| Slot::default()).collect();
        let (held, clock) = (AtomicU64::new(0), AtomicU64::new(0));
        Tiles { boxes, tree, slots, load: Box::new(load), budget, held, clock }
    }

    /// Tiles, loaded or not.
    pub fn count(&self) -> usize {
        self.slots.len()
    }

    /// A tile's mesh, loaded anew.
    pub fn mesh(&self, tile: usize) -> TriMesh {
        (self.load)(tile)
    }

    /// The triangles of a tile.
    pub(crate) fn bvh(&self, tile: usize) -> Arc<Bvh> {
        let slot = &self.slots[tile];
        let now = self.clock.fetch_add(1, Ordering::Relaxed);
        slot.used.store(now, Ordering::Relaxed);
        let mut held = lock(&slot.bvh);
        if let Some(bvh) = &*held {
            return Arc::clone(bvh);
        }
        let mesh = (self.load)(tile);
        let bvh = Arc::new(Bvh::new(&mesh.positions, &mesh.triangles));
        *held = Some(Arc::clone(&bvh));
        slot.halves.get_or_init(|| bvh.halves());
        // Counted before another thread can drop it, or the sum would fall below zero.
        let bytes = bvh.len_bytes() as u64;
        let all = self.held.fetch_add(bytes, Ordering::Relaxed) + bytes;
        drop(held);
        if all > self.budget {
            self.drop_oldest(tile);
        }
        bvh
    }

    /// Goes a quarter below the budget, so that this is not done for every tile that comes.
    fn drop_oldest(&self, but: usize) {
        let mut tiles: Vec<(u64, usize)> =
            self.slots.iter().enumerate().map(|(i, slot)| (slot.used.load(Ordering::Relaxed), i)).collect();
        tiles.sort_unstable();
        for (_, tile) in tiles {
            if self.held.load(Ordering::Relaxed) <= self.budget / 4 * 3 {
                return;
            }
            if tile != but
                && let Some(bvh) = lock(&self.slots[tile].bvh).take()
            {
                self.held.fetch_sub(bvh.len_bytes() as u64, Ordering::Relaxed);
            }
        }
    }

    /// A tree of the boxes.
    pub(crate) fn tree(&self) -> &BoxTree {
        &self.tree
    }

    /// The boxes that tiles are in.
    pub(crate) fn boxes(&self) -> &[Aabb] {
        &self.boxes
    }

    /// Whether something of a tile can be nearer than the square root of `best`.
    pub(crate) fn may_be_nearer(&self, tile: usize, point: Point3<f64>, best: f64) -> bool {
        let of_halves = |halves: &Parting| halves.squared_distances(point).into_iter().any(|d| d < best);
        squared_distance_to_box(point, &self.boxes[tile]) < best
            && self.slots[tile].halves.get().and_then(Option::as_ref).is_none_or(of_halves)
    }
}

/// Separation of two sets of tiles: looked for where they meet, at that triangle of the tile in between which is nearest to the first set.
fn part(
    boxes: &[Aabb],
    load: &impl Fn(usize) -> TriMesh,
    between: usize,
    sets: [&[u32]; 2],
) -> Option<Parting> {
    let away = middle(sets[1], boxes) - middle(sets[0], boxes);
    let mesh = load(between);
    fn along(t: &&[u32; 3], mesh: &TriMesh, away: &Vector3<f64>) -> f64 {
        mesh.corners(**t).map(|c| geom::to_f64(c).coords.dot(away)).iter().sum()
    }
    let first =
        mesh.triangles.iter().min_by(|a, b| along(a, &mesh, &away).total_cmp(&along(b, &mesh, &away)))?;
    Parting::find(mesh.corners(*first), |set, visit| {
        for tile in sets[set] {
            let mesh = load(*tile as usize);
            mesh.triangles.as_flattened().iter().for_each(|v| visit(mesh.positions[*v as usize]));
        }
    })
}

fn middle(set: &[u32], boxes: &[Aabb]) -> Vector3<f64> {
    let all = set.iter().map(|tile| boxes[*tile as usize].center().coords);
    all.sum::<Vector3<f64>>() / set.len() as f64
}

fn lock(bvh: &Mutex<Option<Arc<Bvh>>>) -> MutexGuard<'_, Option<Arc<Bvh>>> {
    bvh.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Searcher;
    use chpm_synth::{Shape, Synth};
    use std::sync::atomic::AtomicUsize;

    #[test]
    fn tiles_of_blades_are_loaded_where_they_are() {
        // A fan askew, whose tiles have their boxes in one another.
        let ring = |i: u32| {
            let angle = 0.2 + 1.2 * f64::from(i) / 3200.0;
            [angle.cos() as f32, angle.sin() as f32, 0.0]
        };
        let blade = |i: u32| [[0.0, 0.0, 1.0], ring(i), ring(i + 1)];
        let part = |tile: u32| {
            let corners: Vec<_> = (100 * tile..100 * tile + 100).flat_map(blade).collect();
            TriMesh::new(corners, (0..100).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect())
        };
        let loads = AtomicUsize::new(0);
        let boxes = (0..32).map(|tile| Aabb::of_points(&part(tile).positions)).collect();
        let tiles = Tiles::new(boxes, 0, |tile| {
            loads.fetch_add(1, Ordering::Relaxed);
            part(tile as u32)
        });
        let mut searcher = Searcher::new(&tiles);
        for i in 0..3200 {
            let middle = |sum: Point3<f64>, c: Point3<f64>| sum + c.coords / 3.0;
            let middle = blade(i).map(chpm_mesh::geom::to_f64).into_iter().fold(Point3::origin(), middle);
            assert!(searcher.nearest(middle).unwrap().distance < 1e-7);
        }
        // Each point loads its own tile, as nothing is kept, and at times one beside it; the first ones see what all are like.
        let loads = loads.load(Ordering::Relaxed);
        assert!(loads < 2 * 3200, "{loads}");
    }

    #[test]
    fn tiles_answer_as_the_whole_does_whatever_the_budget() {
        let mesh = Synth::new(Shape::Isosurface, 4000, 5).to_mesh();
        let parts: Vec<TriMesh> =
            mesh.triangles.chunks(97).map(|t| TriMesh::new(mesh.positions.clone(), t.to_vec())).collect();
        let bounds = |part: &TriMesh| {
            Aabb::of_points(part.triangles.as_flattened().iter().map(|v| &part.positions[*v as usize]))
        };
        let whole = Bvh::new(&mesh.positions, &mesh.triangles);
        assert!(whole.len_bytes() as u64 <= Bvh::bytes(mesh.triangles.len() as u64));
        for budget in [0, 40_000, u64::MAX] {
            let loads = AtomicUsize::new(0);
            let tiles = Tiles::new(parts.iter().map(bounds).collect(), budget, |tile| {
                loads.fetch_add(1, Ordering::Relaxed);
                parts[tile].clone()
            });
            assert_eq!(tiles.count(), parts.len());
            let mut searcher = Searcher::new(&tiles);
            for point in mesh.positions.iter().step_by(7) {
                let point = Point3::from(point.map(|x| 1.05 * f64::from(x) + 0.01));
                let hit = searcher.nearest(point).unwrap();
                assert!((hit.distance - whole.distance(point)).abs() < 1e-14);
                let mut best = f64::INFINITY;
                assert!(searcher.improve(hit.tile, point, &mut best));
                assert!((best.sqrt() - hit.distance).abs() < 1e-14);
                assert!(!searcher.improve(hit.tile, point, &mut best), "nothing is nearer than the nearest");
            }
            let loads = loads.load(Ordering::Relaxed);
            // Each once for its triangles, and some before that, to see how they lie.
            assert!(budget < u64::MAX || loads <= 8 * parts.len(), "{loads}");
            assert!(budget > 0 || loads > 8 * parts.len(), "{loads}");
        }
        let none = Tiles::new(vec![Aabb::EMPTY], 0, |_| TriMesh::default());
        assert_eq!(Searcher::new(&none).nearest(Point3::origin()), None);
        let mut everything = f64::INFINITY;
        assert!(!Searcher::new(&none).improve(0, Point3::origin(), &mut everything));
    }
}
