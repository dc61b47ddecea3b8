//! Disjoint sets over small numbers.

/// A number that is in no set.
const ABSENT: u32 = u32::MAX;

/// Union-find with path halving; the smaller number is the root. A number may be absent until it is first joined.
#[derive(Debug, Default)]
pub(super) struct Sets {
    parents: Vec<u32>,
    /// How many sets there are.
    pub(super) count: u32,
}

impl Sets {
    /// Numbers below `len`, none of them in a set yet.
    pub(super) fn absent(&mut self, len: usize) {
        self.parents.clear();
        self.parents.resize(len, ABSENT);
        self.count = 0;
    }

    /// Numbers below `len`, each a set of its own.
    pub(super) fn singletons(&mut self, len: usize) {
        self.parents.clear();
        self.parents.extend(0..len as u32);
        self.count = len as u32;
    }

    /// Numbers that there are, absent ones included.
    pub(super) fn len(&self) -> usize {
        self.parents.len()
    }

    /// Whether `x` was joined to anything, itself included.
    pub(super) fn contains(&self, x: u32) -> bool {
        self.parents[x as usize] != ABSENT
    }

    /// The root of the set of `x`, which must be in one.
    #[inline]
    pub(super) fn find(&mut self, mut x: u32) -> u32 {
        loop {
            let parent = self.parents[x as usize];
            if parent == x {
                return x;
            }
            let above = self.parents[parent as usize];
            self.parents[x as usize] = above;
            x = above;
        }
    }

    /// Joins the sets of `x` and `y`; an absent one starts its own first. Returns whether they were apart.
    pub(super) fn join(&mut self, x: u32, y: u32) -> bool {
        for v in [x, y] {
            if !self.contains(v) {
                self.parents[v as usize] = v;
                self.count += 1;
            }
        }
        self.join_present(x, y)
    }

    /// [`Self::join`] for numbers that are in sets.
    #[inline]
    pub(super) fn join_present(&mut self, x: u32, y: u32) -> bool {
        if self.parents[x as usize] == self.parents[y as usize] {
            return false;
        }
        let (x, y) = (self.find(x), self.find(y));
        if x == y {
            return false;
        }
        self.parents[x.max(y) as usize] = x.min(y);
        self.count -= 1;
        true
    }
}
