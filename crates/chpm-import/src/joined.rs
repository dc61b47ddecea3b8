//! Joins vertices of equal position, in memory that the budget bounds: which vertices are one, and what they are numbered as.

use crate::error::{ImportError, SourceError};
use crate::weld::Corner;
use chpm_extmem::{BufferWriter, Cached, Cancel, Column, Sorted, Sorter, Store};

/// Vertices by position.
pub(crate) enum Keys {
    Singles(Sorter<u128>),
    Doubles(Sorter<[u128; 2]>),
}

impl Keys {
    pub(crate) fn new(are_doubles: bool, store: &Store) -> Keys {
        match are_doubles {
            false => Keys::Singles(Sorter::new(store, "vertices by position")),
            true => Keys::Doubles(Sorter::new(store, "vertices by position")),
        }
    }

    pub(crate) fn push(&mut self, position: [f64; 3], vertex: u32) -> Result<(), ImportError> {
        // Adding zero takes the sign from a zero, and changes nothing else.
        let position = position.map(|x| x + 0.0);
        match self {
            Keys::Singles(sorter) => sorter.push(Corner::new(position, vertex))?,
            Keys::Doubles(sorter) => sorter.push(Corner::new(position, vertex))?,
        }
        Ok(())
    }

    /// Begins to look for vertices of equal position.
    pub(crate) fn finish(self) -> Result<SortedKeys, ImportError> {
        Ok(match self {
            Keys::Singles(sorter) => SortedKeys::Singles(sorter.finish()?, None),
            Keys::Doubles(sorter) => SortedKeys::Doubles(sorter.finish()?, None),
        })
    }
}

/// Vertices in the order of their positions, and the first of those that the last one is equal to.
pub(crate) enum SortedKeys {
    Singles(Sorted<u128>, Option<u128>),
    Doubles(Sorted<[u128; 2]>, Option<[u128; 2]>),
}

impl SortedKeys {
    /// The next vertex, and the first vertex that has its position.
    pub(crate) fn next(&mut self) -> Result<Option<(u32, u32)>, ImportError> {
        match self {
            SortedKeys::Singles(sorted, first) => next(sorted, first),
            SortedKeys::Doubles(sorted, first) => next(sorted, first),
        }
    }
}

fn next<C: Corner>(sorted: &mut Sorted<C>, first: &mut Option<C>) -> Result<Option<(u32, u32)>, ImportError> {
    let Some(corner) = sorted.next()? else { return Ok(None) };
    let found = first.filter(|first| first.place() == corner.place()).unwrap_or(corner);
    *first = Some(found);
    Ok(Some((corner.number(), found.number())))
}

/// Two numbers of 32 bits that are sorted by the higher one.
pub(crate) fn pair(high: u32, low: u32) -> u64 {
    u64::from(high) << 32 | u64::from(low)
}

/// Pairs in order, of which those are taken whose higher number is the one that is asked for.
pub(crate) struct Pairs {
    sorted: Sorted<u64>,
    next: Option<u64>,
}

impl Pairs {
    pub(crate) fn new(sorter: Sorter<u64>) -> Result<Pairs, ImportError> {
        let mut sorted = sorter.finish()?;
        let next = sorted.next()?;
        Ok(Pairs { sorted, next })
    }

    /// The lower number of the next pair, if its higher one is `high`. To be asked with ascending numbers.
    pub(crate) fn of(&mut self, high: u32) -> Result<Option<u32>, ImportError> {
        let Some(pair) = self.next.filter(|pair| (pair >> 32) as u32 == high) else { return Ok(None) };
        self.next = self.sorted.next()?;
        Ok(Some(pair as u32))
    }
}

/// Numbers in the mesh of the file's vertices: none of these is their own number if no two are joined.
pub(crate) struct Numbers {
    column: Option<Cached<u32>>,
}

impl Numbers {
    /// `joined` are vertices that got the number of an earlier one, with it; the others are numbered in their order.
    pub(crate) fn new(
        joined: Sorter<u64>,
        vertices: u64,
        store: &Store,
        cancel: &Cancel,
    ) -> Result<Numbers, ImportError> {
        let mut own = 0..;
        Self::with(joined, vertices, |vertex| own.next().unwrap_or(vertex), store, cancel)
    }

    /// The same, where the others keep their numbers.
    pub(crate) fn of_firsts(
        joined: Sorter<u64>,
        vertices: u64,
        store: &Store,
        cancel: &Cancel,
    ) -> Result<Numbers, ImportError> {
        Self::with(joined, vertices, |vertex| vertex, store, cancel)
    }

    fn with(
        joined: Sorter<u64>,
        vertices: u64,
        mut own: impl FnMut(u32) -> u32,
        store: &Store,
        cancel: &Cancel,
    ) -> Result<Numbers, ImportError> {
        let mut joined = Pairs::new(joined)?;
        if joined.next.is_none() {
            return Ok(Numbers { column: None });
        }
        let mut writer = BufferWriter::new(store, "numbers of vertices", vertices as usize)?;
        let mut block = Vec::with_capacity(BLOCK);
        for vertex in 0..vertices as u32 {
            block.push(joined.of(vertex)?.unwrap_or_else(|| own(vertex)));
            if block.len() == BLOCK {
                cancel.check().map_err(|_| SourceError::Cancelled)?;
                writer.extend_from_slice(&block)?;
                block.clear();
            }
        }
        writer.extend_from_slice(&block)?;
        let column: Column<u32> = writer.finish_column()?;
        Ok(Numbers { column: Some(Cached::new(column)) })
    }

    pub(crate) fn of(&mut self, vertex: u32) -> Result<u32, ImportError> {
        match &mut self.column {
            None => Ok(vertex),
            Some(column) => Ok(column.get(vertex as usize)?.unwrap_or(vertex)),
        }
    }
}

const BLOCK: usize = 1 << 14;
