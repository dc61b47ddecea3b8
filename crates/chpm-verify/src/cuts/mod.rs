//! Whether random legal cuts hold together (I7).
//!
//! A cut is the image of the source under one map of its vertices, if all clusters that share a vertex have it in one place: then
//! edges go to edges, and an edge that is closed in the source is closed in the cut or is gone. A **crack** is where there
//! is no such map: between clusters, where one draws what its neighbour does not. Two things show it.
//!
//! - A *border edge* (`borders`) that an odd number of the cut's clusters have: its partner is not drawn. Edges are the same where their
//!   ends have the same shared ids and the same places, bit for bit. A vertex of one side inside an edge of the other is found by this too: neither
//!   side has the other's edges.
//! - A shared vertex that two clusters of the cut have in two places, or let go to two vertices. Sheets that meet in a vertex, or in
//!   an edge of two triangles on either side, come apart so without an odd edge.
//!
//! There is no crack without a border. Within one cluster a collapse opens nothing that was closed, and where the source is
//! open (at its rim, and where sheets only lie at the same place) the cut may be, too: coincident, collinear, overlapping or tangled
//! surfaces are none of this check's concern, for it asks for places only where two clusters say that they mean the same vertex.
//!
//! What it cannot judge: whether leaves share all that was one vertex in the source (I1), and whether a coarse cluster is what the
//! finer ones were (I4); what leaves do not share counts as the source's rim. Both are looked at without any cut. And where a strip between
//! a border and the rim has vanished from one cluster, so that the other side of that border has become the rim, edges between
//! its vertices may be without a partner; that these vertices are in one place is looked at there, too.

mod borders;
mod glance;
mod ledger;
mod local;
mod walk;

use crate::error::VerifyError;
use borders::Borders;
use chpm_extmem::{Cancel, Progress, Store};
use chpm_format::Chpm;
use chpm_refine::{CameraPath, Cut, Hierarchy, RefineError, View, random_cut, select};
use rayon::prelude::*;
use walk::Walker;

/// Cuts whose faults are told; further ones are counted.
const TOLD: usize = 20;
/// One part of so many of the memory for what is in work; the rest is for the borders of all clusters.
const WORK: u64 = 4;
/// Pixels of error in a camera's image of 512 x 512: 16 for the first camera, half as much for every next one, and again from 16.
const PIXELS: f64 = 16.0;
const HALVINGS: u64 = 12;

/// Findings about cuts.
#[derive(Debug)]
pub struct Cuts {
    /// Cuts that were drawn.
    pub count: u32,
    /// Seed of the first one.
    pub seed: u64,
    /// Triangles of all of them.
    pub triangles: u64,
    /// The first faults, of one cut each.
    pub faults: Vec<String>,
    /// Places that are wrong, over all cuts.
    pub fault_count: u64,
}

/// The file, as the other checks found it.
#[derive(Clone, Copy)]
pub struct Checked<'a, D> {
    /// Its pages are sound.
    pub file: &'a Chpm<D>,
    /// Whether every shared vertex is in one place wherever it is listed.
    pub is_even: bool,
}

/// Draws `count` cuts from `seed` on and looks at all their borders, several at a time. Even seeds are random
/// legal cuts, odd ones what random cameras select. `memory` is in bytes.
///
/// # Errors
/// [`VerifyError::Cancelled`], damage of the file, or those of the store.
pub fn check<D: AsRef<[u8]> + Sync>(
    Checked { file, is_even }: Checked<'_, D>,
    count: u32,
    seed: u64,
    store: &Store,
    memory: u64,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Cuts, VerifyError> {
    let borders = Borders::of(file, store, memory / WORK, progress, cancel)?;
    progress.begin("cuts", count.into());
    let checker = Checker { file, hierarchy: Hierarchy::new(file), borders };
    let each = memory / WORK / rayon::current_num_threads() as u64;
    let looked_at: Vec<Looked> = (0..u64::from(count))
        .into_par_iter()
        .map_init(
            || Walker::new(each, is_even),
            |walker, i| {
                cancel.check()?;
                let looked = checker.look(walker, seed.wrapping_add(i));
                progress.advance(1);
                looked
            },
        )
        .collect::<Result<_, VerifyError>>()?;
    progress.end();
    let mut found = Cuts { count, seed, triangles: 0, faults: Vec::new(), fault_count: 0 };
    for (i, looked) in (0..).zip(looked_at) {
        found.triangles += looked.triangles;
        if let Some((places, message)) = looked.fault {
            found.note(seed.wrapping_add(i), places, &message);
        }
    }
    Ok(found)
}

/// Bytes that it takes to look at cuts of a file whatever memory there is.
pub fn least<D: AsRef<[u8]>>(file: &Chpm<D>) -> u64 {
    Borders::least(file)
}

struct Checker<'a, D> {
    file: &'a Chpm<D>,
    hierarchy: Hierarchy,
    borders: Borders,
}

/// Findings about one cut.
struct Looked {
    triangles: u64,
    /// Number of wrong places, and the first one.
    fault: Option<(u64, String)>,
}

impl<D: AsRef<[u8]>> Checker<'_, D> {
    fn look(&self, walker: &mut Walker, seed: u64) -> Result<Looked, VerifyError> {
        let cut =
            match draw(self.file, &self.hierarchy, seed).and_then(|cut| cut.check(self.file).map(|()| cut)) {
                Ok(cut) => cut,
                // What the file itself makes impossible is told by the other checks, with a place.
                Err(error @ RefineError::Format(_)) => return Err(error.into()),
                Err(error) => return Ok(Looked { triangles: 0, fault: Some((1, error.to_string())) }),
            };
        let found = walker.look(self.file, &self.borders, &cut)?;
        let more = found.places.saturating_sub(1);
        Ok(Looked {
            triangles: found.triangles,
            fault: found.first.map(|first| {
                let rest = if more > 0 { format!("; {more} more in this cut") } else { String::new() };
                (found.places, first + &rest)
            }),
        })
    }
}

/// The cut of a seed.
///
/// # Errors
/// Damage of the file.
pub fn draw<D: AsRef<[u8]>>(file: &Chpm<D>, hierarchy: &Hierarchy, seed: u64) -> Result<Cut, RefineError> {
    let path = CameraPath::random(&file.header().aabb(), seed, 1);
    match path.cameras.first() {
        Some(camera) if seed % 2 == 1 => {
            let pixels = PIXELS * 0.5_f64.powi((seed / 2 % HALVINGS) as i32);
            select(file, hierarchy, &View::new(camera, [512, 512], pixels)?)
        }
        _ => random_cut(file, seed),
    }
}

impl Cuts {
    fn note(&mut self, seed: u64, places: u64, message: &str) {
        self.fault_count += places;
        if self.faults.len() < TOLD {
            self.faults.push(format!("I7 boundary: cut of seed {seed}: {message}"));
        }
    }
}

#[cfg(test)]
mod tests;
