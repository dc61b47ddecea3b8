//! Things that are joined, two by two.

/// Trees whose roots are their least members.
#[derive(Debug, Default)]
pub(super) struct Forest(Vec<u32>);

impl Forest {
    /// So many things; new ones are alone.
    pub(super) fn grow(&mut self, count: usize) {
        self.0.extend(self.0.len() as u32..count as u32);
    }

    pub(super) fn root(&mut self, mut at: u32) -> u32 {
        while self.0[at as usize] != at {
            let above = self.0[self.0[at as usize] as usize];
            self.0[at as usize] = above;
            at = above;
        }
        at
    }

    pub(super) fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}
