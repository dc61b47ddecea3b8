//! Why a collapse is not carried out. A refusal is a counted value, never a silent exit.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::AddAssign;

/// The reason that a half-edge collapse u -> v is refused.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Refusal {
    /// It would join two locked vertices by a new edge, which another cluster may have or create as well.
    LockedEdge,
    /// The link condition fails: u and v have a common neighbour that is not an apex of their edge.
    Link,
    /// A triangle would turn over (or close to it).
    Flip,
    /// The faces about u form no single fan.
    NonManifold,
    /// u or v has, or v would get, too many faces.
    Valence,
    /// u lies on the mesh boundary and the edge does not.
    Boundary,
    /// The last triangle of a component, or of one that hangs on by single vertices, would vanish.
    Component,
    /// A triangle would lose its area.
    Degenerate,
}

impl Refusal {
    /// All reasons, in the order in which counts are stored.
    pub const ALL: [Refusal; 8] = [
        Refusal::LockedEdge,
        Refusal::Link,
        Refusal::Flip,
        Refusal::NonManifold,
        Refusal::Valence,
        Refusal::Boundary,
        Refusal::Component,
        Refusal::Degenerate,
    ];
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Refusal::LockedEdge => "locked edge",
            Refusal::Link => "link",
            Refusal::Flip => "flip",
            Refusal::NonManifold => "non-manifold",
            Refusal::Valence => "valence",
            Refusal::Boundary => "boundary",
            Refusal::Component => "component",
            Refusal::Degenerate => "degenerate",
        })
    }
}

/// Refusals by reason, in the order of [`Refusal::ALL`].
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub struct Refusals(pub [u64; 8]);

impl Refusals {
    /// Counts one.
    pub fn add(&mut self, refusal: Refusal) {
        self.0[refusal as usize] += 1;
    }

    /// How many there were for one reason.
    pub fn of(&self, refusal: Refusal) -> u64 {
        self.0[refusal as usize]
    }
}

impl AddAssign for Refusals {
    fn add_assign(&mut self, other: Self) {
        for (mine, theirs) in self.0.iter_mut().zip(other.0) {
            *mine += theirs;
        }
    }
}
