//! Numbers of a source's vertices: of 32 bits, or of 64 where there are more. All that counts the whole of a source goes by [`Id`]; within a region
//! numbers have 32 bits.

use bytemuck::{Pod, Zeroable};
use chpm_extmem::Column;
use serde::{Deserialize, Serialize};
use std::fmt::Debug;

/// The number of a vertex. What it is decides nothing: ids have the order of what they count, and results are the same with any kind.
pub(crate) trait Id: Pod + Ord + Send + Sync + Debug {
    /// Which kind it is.
    const IDS: Ids;
    /// No vertex.
    const NONE: Self;
    /// The most vertices that can be numbered.
    const MOST: usize;

    /// The id of the vertex at a place.
    fn of(index: usize) -> Self;

    /// The place of the vertex.
    fn index(self) -> usize;

    /// Its bits, for hashes.
    fn bits(self) -> u64;

    /// Triangles over ids that fit 32 bits.
    fn narrowed(triangles: Vec<[Self; 3]>) -> Vec<[u32; 3]> {
        triangles.into_iter().map(|triangle| triangle.map(|vertex| vertex.index() as u32)).collect()
    }

    /// Triangles that are known to be of this kind.
    fn triangles(triangles: Column<[Self; 3]>) -> Triangles;
}

impl Id for u32 {
    const IDS: Ids = Ids::Narrow;
    const NONE: u32 = u32::MAX;
    const MOST: usize = u32::MAX as usize;

    #[inline]
    fn of(index: usize) -> u32 {
        index as u32
    }

    #[inline]
    fn index(self) -> usize {
        self as usize
    }

    #[inline]
    fn bits(self) -> u64 {
        self.into()
    }

    fn narrowed(triangles: Vec<[u32; 3]>) -> Vec<[u32; 3]> {
        triangles
    }

    fn triangles(triangles: Column<[u32; 3]>) -> Triangles {
        Triangles::Narrow(triangles)
    }
}

/// An id of 64 bits. In tests of this crate it counts from 2^33 on, so that whoever takes one for 32 bits, or for the place of its vertex, is found out with a
/// small model.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Pod, Zeroable)]
#[repr(transparent)]
pub(crate) struct Wide(u64);

impl Wide {
    const START: u64 = if cfg!(test) { 1 << 33 } else { 0 };
}

impl Id for Wide {
    const IDS: Ids = Ids::Wide;
    const NONE: Wide = Wide(u64::MAX);
    const MOST: usize = usize::MAX;

    #[inline]
    fn of(index: usize) -> Wide {
        Wide(Wide::START + index as u64)
    }

    #[inline]
    fn index(self) -> usize {
        debug_assert!(self != Wide::NONE && self.0.checked_sub(Wide::START).is_some(), "{} is no id", self.0);
        (self.0 - Wide::START) as usize
    }

    #[inline]
    fn bits(self) -> u64 {
        self.0
    }

    fn triangles(triangles: Column<[Wide; 3]>) -> Triangles {
        Triangles::Wide(triangles)
    }
}

/// A kind of ids.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub enum Ids {
    /// 32 bits.
    #[default]
    Narrow,
    /// 64 bits.
    Wide,
}

/// Triangles of a whole source, by ids of one kind.
#[derive(Serialize, Deserialize)]
pub(crate) enum Triangles {
    Narrow(Column<[u32; 3]>),
    Wide(Column<[Wide; 3]>),
}

impl Triangles {
    /// How many there are.
    pub(crate) fn len(&self) -> usize {
        match self {
            Triangles::Narrow(triangles) => triangles.len(),
            Triangles::Wide(triangles) => triangles.len(),
        }
    }
}

/// Does the same with triangles, or with the type of an id, of whichever kind.
macro_rules! with_ids {
    ($triangles:expr, $name:ident => $then:expr) => {
        match $triangles {
            $crate::ids::Triangles::Narrow($name) => $then,
            $crate::ids::Triangles::Wide($name) => $then,
        }
    };
    ($kind:expr, type $id:ident => $then:expr) => {
        match $kind {
            $crate::ids::Ids::Narrow => {
                type $id = u32;
                $then
            }
            $crate::ids::Ids::Wide => {
                type $id = $crate::ids::Wide;
                $then
            }
        }
    };
}
pub(crate) use with_ids;
