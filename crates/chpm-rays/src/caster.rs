//! Batches of rays: whose turn it is, and which pages are in memory.

use crate::bound::Bound;
use crate::error::RayError;
use crate::mesh::Mesh;
use crate::ray::{Hit, Ray, Seek};
use crate::readers::Readers;
use crate::tree::{MeshKey, Tree};
use crate::walk::{Flat, Open, Resident, State, Walk};
use chpm_format::{Chpm, ErrorKind};
use chpm_mesh::{Bytes, ClusterId};
use chpm_space::{Patch, Unproven};
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Pages read so far, and how often.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Reads {
    /// Reads of pages.
    pub pages: u64,
    /// Their bytes in the file.
    pub bytes: u64,
    /// Pages that were read at least once.
    pub different: u64,
    /// Triangles of the meshes that were made of them, each counted once.
    pub triangles: u64,
}

/// Rays that go on between two questions whether to stop.
const SOME: usize = 1024;

/// Memory for rays.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Memory {
    /// For meshes that are kept.
    pub meshes: Bytes,
    /// Rays at a time.
    pub rays: usize,
    pub(crate) readers: Readers,
}

impl Memory {
    /// Bytes of a ray with its answer, where it stands and what it still has to look at.
    pub(crate) const RAY: u64 = 768;

    /// Bytes of a thread that casts.
    pub const THREAD: u64 = 1 << 20;

    /// This much for meshes and so many rays at a time, with a reader for each thread.
    pub const fn new(meshes: Bytes, rays: usize) -> Self {
        Memory { meshes, rays, readers: Readers::ALL }
    }

    /// Divides what so many threads have: a quarter for rays, an eighth for pages in the making.
    pub fn divide(all: Bytes, threads: usize) -> Self {
        Self::with_rays(all, threads, Self::RAY)
    }

    /// The same, for rays of so many bytes.
    pub(crate) fn with_rays(all: Bytes, threads: usize, each: u64) -> Self {
        let rays = (all.0 / 4 / each).clamp(1, 1 << 20);
        let readers = Readers::within(all.0 / 8, threads);
        let meshes = Bytes(all.0.saturating_sub(rays * each + readers.more()));
        Memory { meshes, rays: rays as usize, readers }
    }

    /// Bytes that the index of a file takes and a page in the making, whatever is read.
    pub fn own<D: AsRef<[u8]>>(file: &Chpm<D>) -> u64 {
        let meshes = (2 * size_of::<Option<Resident>>() + 2) as u64 * file.clusters().len() as u64;
        Tree::bytes(file) + meshes + Readers::EACH
    }
}

/// A file that rays are cast at.
#[derive(Debug)]
pub struct Caster<'a, D> {
    pub(crate) file: &'a Chpm<D>,
    tree: Tree,
    /// Of the last bound that was common to all rays.
    flat: Option<(Bound, Flat)>,
    meshes: Vec<Option<Resident>>,
    /// By mesh.
    was_read: Vec<bool>,
    pub(crate) memory: Memory,
    used: u64,
    round: u32,
    reads: Reads,
    /// Of the rays of a batch.
    states: Vec<State>,
}

impl<'a, D: AsRef<[u8]> + Sync> Caster<'a, D> {
    /// Reads the tables of a file.
    pub fn new(file: &'a Chpm<D>, memory: Memory) -> Self {
        let clusters = file.clusters().len();
        Caster {
            file,
            tree: Tree::new(file),
            flat: None,
            meshes: std::iter::repeat_with(|| None).take(2 * clusters).collect(),
            was_read: vec![false; 2 * clusters],
            memory,
            used: 0,
            round: 0,
            reads: Reads::default(),
            states: Vec::new(),
        }
    }

    /// Reads so far.
    pub fn reads(&self) -> Reads {
        self.reads
    }

    /// How far the source and the mesh of a bound that is common to all rays are from each other at most. For leaves that is by how much their coordinates were rounded.
    ///
    /// # Errors
    /// A file that does not know.
    pub fn distance(&self, bound: &Bound) -> Result<f64, RayError> {
        let certified = self.file.header().error_kind() == Some(ErrorKind::Certified);
        if !certified || !self.file.has_gaps() {
            let got = if certified { "version 1.0, which has no gaps" } else { "estimated errors" };
            return Err(Unproven { expected: "a file with proven distances", got }.into());
        }
        let distance = |key: MeshKey| {
            let record = &self.file.clusters()[key as usize / 2];
            let gaps = self.file.gaps(record.group());
            match key % 2 == 1 {
                false => gaps.distance(record.max_error),
                true if record.is_trimmed() => gaps.distance(record.min_error),
                true => record.min_error,
            }
        };
        let present = self.tree.present(self.file, bound);
        Ok(present.into_iter().map(distance).fold(0.0, f32::max).into())
    }

    /// Whether each cluster is there at its finest in the mesh of a bound that is common to all rays.
    pub(crate) fn finest(&self, bound: &Bound) -> Vec<bool> {
        let mut finest = vec![false; self.file.clusters().len()];
        for key in self.tree.present(self.file, bound) {
            finest[key as usize / 2] |= key % 2 == 1;
        }
        finest
    }

    /// Answers rays in their order, on the threads of rayon's current pool: what each meets, or for [`Seek::Within`] how far it gets; infinite where it meets nothing. Whatever the threads
    /// and the memory, the answers are the same. Asks `go_on` before each page, and between some rays.
    ///
    /// # Errors
    /// [`RayError::Format`] for a damaged page, [`RayError::Stopped`].
    pub fn cast(
        &mut self,
        rays: &[Ray],
        bound: &Bound,
        seek: Seek,
        go_on: &(impl Fn() -> bool + Sync),
        mut each: impl FnMut(Option<Hit>, f64),
    ) -> Result<(), RayError> {
        // A cap would have a ray meet finer meshes.
        let is_flat = bound.is_common() && rays.iter().all(|ray| ray.cap == f64::INFINITY);
        if is_flat && self.flat.as_ref().is_none_or(|(known, _)| known != bound) {
            let keys = self.tree.present(self.file, bound);
            self.flat = Some((*bound, Flat::new(self.file, &keys)));
        }
        for some in rays.chunks(self.memory.rays.max(1)) {
            self.batch(some, bound, seek, is_flat, go_on)?;
            for state in &self.states {
                match state {
                    State::Done(found) if found.is_met => each(found.hit, found.upper),
                    _ => each(None, f64::INFINITY),
                }
            }
        }
        Ok(())
    }

    fn batch(
        &mut self,
        rays: &[Ray],
        bound: &Bound,
        seek: Seek,
        is_flat: bool,
        go_on: &(impl Fn() -> bool + Sync),
    ) -> Result<(), RayError> {
        // The room of earlier batches serves again.
        let mut states = std::mem::take(&mut self.states);
        states.clear();
        states.resize(rays.len(), State::Begins);
        loop {
            self.round += 1;
            let Caster { file, ref tree, ref flat, ref meshes, round, .. } = *self;
            let flat = flat.as_ref().filter(|_| is_flat).map(|(_, flat)| flat);
            let (clusters, records, members) = (file.clusters(), file.groups(), file.members());
            let walk = Walk { file, clusters, records, members, tree, bound, seek, flat, meshes, round };
            let moved = |state: &State| match state {
                State::Begins => true,
                State::Waits(key, ..) => meshes[*key as usize].is_some(),
                State::Done(_) => false,
            };
            // Many may wait for one page, so that it is not only asked before each.
            states.par_chunks_mut(SOME).zip(rays.par_chunks(SOME)).try_for_each_init(
                Vec::<Open>::new,
                |open, (states, rays)| {
                    if states.iter().any(moved) && !go_on() {
                        return Err(RayError::Stopped);
                    }
                    for (state, ray) in states.iter_mut().zip(rays).filter(|(state, _)| moved(state)) {
                        let before = std::mem::replace(state, State::Begins);
                        *state = walk.go(ray, before, open);
                    }
                    Ok(())
                },
            )?;

            let mut wanted: Vec<MeshKey> = states
                .iter()
                .filter_map(|state| if let State::Waits(key, ..) = state { Some(*key) } else { None })
                .collect();
            if wanted.is_empty() {
                break;
            }
            wanted.sort_unstable();
            let mut queues: Vec<(usize, MeshKey)> =
                wanted.chunk_by(|a, b| a == b).map(|queue| (queue.len(), queue[0])).collect();
            // The longest first.
            queues.sort_unstable_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
            self.read(queues.into_iter().map(|(_, key)| key), go_on)?;
        }
        self.states = states;
        Ok(())
    }

    /// Reads as many meshes as fit, at least one, in place of those that were not needed for longest.
    fn read(
        &mut self,
        keys: impl Iterator<Item = MeshKey>,
        go_on: &(impl Fn() -> bool + Sync),
    ) -> Result<(), RayError> {
        let (mut chosen, mut room) = (Vec::new(), 0);
        for key in keys {
            let bytes = self.bytes(key);
            if !chosen.is_empty() && room + bytes > self.memory.meshes.0 {
                break;
            }
            room += bytes;
            chosen.push(key);
        }
        self.make_room(room);

        let file = self.file;
        let read = |key: &MeshKey| {
            if !go_on() {
                return Err(RayError::Stopped);
            }
            let page = file.page(ClusterId(key / 2))?;
            let view = page.view();
            let n = if key % 2 == 1 { view.vertex_count() } else { view.base_vertex_count };
            Ok(Arc::new(Mesh::new(&Patch::at(&view, n))))
        };
        let made = self.memory.readers.read(&chosen, read)?;
        for (key, mesh) in chosen.into_iter().zip(made) {
            let cluster = key / 2;
            self.used += self.bytes(key);
            self.reads.pages += 1;
            self.reads.bytes += u64::from(self.file.clusters()[cluster as usize].page_len);
            if !self.was_read[key as usize] {
                self.reads.different += u64::from(!self.was_read[key as usize ^ 1]);
                self.reads.triangles += mesh.len() as u64;
                self.was_read[key as usize] = true;
            }
            self.meshes[key as usize] = Some(Resident { mesh, last: AtomicU32::new(self.round) });
        }
        Ok(())
    }

    fn make_room(&mut self, room: u64) {
        if self.used + room <= self.memory.meshes.0 {
            return;
        }
        let mut kept: Vec<(u32, MeshKey)> = (0..)
            .zip(&self.meshes)
            .filter_map(|(key, resident)| {
                resident.as_ref().map(|resident| (resident.last.load(Relaxed), key))
            })
            .collect();
        kept.sort_unstable();
        for (_, key) in kept {
            if self.used + room <= self.memory.meshes.0 {
                break;
            }
            self.meshes[key as usize] = None;
            self.used -= self.bytes(key);
        }
    }

    fn bytes(&self, key: MeshKey) -> u64 {
        Mesh::bytes_of(&self.file.clusters()[key as usize / 2], key % 2 == 1)
    }
}
