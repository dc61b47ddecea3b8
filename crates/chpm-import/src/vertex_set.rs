//! Vertices that were left out.

/// A set of vertices that takes memory up to its largest member only: what a header promises costs nothing.
#[derive(Debug, Default)]
pub(crate) struct VertexSet {
    words: Vec<u64>,
}

impl VertexSet {
    pub(crate) fn is_empty(&self) -> bool {
        self.words.is_empty()
    }

    pub(crate) fn contains(&self, vertex: u64) -> bool {
        self.words.get((vertex / 64) as usize).is_some_and(|word| word >> (vertex % 64) & 1 == 1)
    }

    pub(crate) fn insert(&mut self, vertex: u64) {
        let word = (vertex / 64) as usize;
        if word >= self.words.len() {
            self.words.resize(word + 1, 0);
        }
        self.words[word] |= 1 << (vertex % 64);
    }
}
