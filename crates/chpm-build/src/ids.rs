//! Numbers of a source's vertices: of 32 bits, or of 64 where there are more. All that counts the whole of a source goes by [`Id`]; within a region
//! numbers have 32 bits.

use bytemuck::Pod;
#[cfg(test)]
use bytemuck::Zeroable;
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

impl Id for u64 {
    const IDS: Ids = Ids::Wide;
    const NONE: u64 = u64::MAX;
    const MOST: usize = usize::MAX;

    #[inline]
    fn of(index: usize) -> u64 {
        index as u64
    }

    #[inline]
    fn index(self) -> usize {
        self as usize
    }

    #[inline]
    fn bits(self) -> u64 {
        self
    }

    fn triangles(triangles: Column<[u64; 3]>) -> Triangles {
        Triangles::Wide(triangles)
    }
}

/// An id that counts from 2^33 on: whoever takes one for 32 bits, or for the place of its vertex, is found out with a small model.
#[cfg(test)]
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Pod, Zeroable)]
#[repr(transparent)]
pub(crate) struct Far(u64);

#[cfg(test)]
impl Far {
    const START: u64 = 1 << 33;
}

#[cfg(test)]
impl Id for Far {
    const IDS: Ids = Ids::Far;
    const NONE: Far = Far(u64::MAX);
    const MOST: usize = usize::MAX;

    fn of(index: usize) -> Far {
        Far(Far::START + index as u64)
    }

    fn index(self) -> usize {
        assert!(self.0 >= Far::START && self != Far::NONE, "{} is no id", self.0);
        (self.0 - Far::START) as usize
    }

    fn bits(self) -> u64 {
        self.0
    }

    fn triangles(triangles: Column<[Far; 3]>) -> Triangles {
        Triangles::Far(triangles)
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
    /// 64 bits from 2^33 on.
    #[cfg(test)]
    Far,
}

/// Triangles of a whole source, by ids of one kind.
#[derive(Serialize, Deserialize)]
pub(crate) enum Triangles {
    Narrow(Column<[u32; 3]>),
    Wide(Column<[u64; 3]>),
    #[cfg(test)]
    Far(Column<[Far; 3]>),
}

impl Triangles {
    /// How many there are.
    pub(crate) fn len(&self) -> usize {
        match self {
            Triangles::Narrow(triangles) => triangles.len(),
            Triangles::Wide(triangles) => triangles.len(),
            #[cfg(test)]
            Triangles::Far(triangles) => triangles.len(),
        }
    }
}

/// Does the same with triangles, or with the type of an id, of whichever kind.
macro_rules! with_ids {
    ($triangles:expr, $name:ident => $then:expr) => {
        match $triangles {
            $crate::ids::Triangles::Narrow($name) => $then,
            $crate::ids::Triangles::Wide($name) => $then,
            #[cfg(test)]
            $crate::ids::Triangles::Far($name) => $then,
        }
    };
    ($kind:expr, type $id:ident => $then:expr) => {
        match $kind {
            $crate::ids::Ids::Narrow => {
                type $id = u32;
                $then
            }
            $crate::ids::Ids::Wide => {
                type $id = u64;
                $then
            }
            #[cfg(test)]
            $crate::ids::Ids::Far => {
                type $id = $crate::ids::Far;
                $then
            }
        }
    };
}
pub(crate) use with_ids;
