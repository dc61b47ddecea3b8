//! Flags of each vertex during a run, a byte each.

/// Flags of a vertex.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(crate) struct VertexFlags(u8);

impl VertexFlags {
    /// Locked or of too high a valence: stays.
    pub(crate) const FIXED: VertexFlags = VertexFlags(1);
    /// Has collapsed.
    pub(crate) const GONE: VertexFlags = VertexFlags(1 << 1);
    /// Of an open fan. Collapses that pass the link test keep it so.
    pub(crate) const BOUNDARY: VertexFlags = VertexFlags(1 << 2);
    /// Nothing legal could be done with it when it came up.
    pub(crate) const WAITING: VertexFlags = VertexFlags(1 << 3);
    /// In the queue at the price of a forced collapse.
    pub(crate) const OFFERED: VertexFlags = VertexFlags(1 << 4);
    /// Something about it has changed since its bound was found.
    pub(crate) const STALE: VertexFlags = VertexFlags(1 << 5);

    /// Whether it has any of these flags.
    #[inline]
    pub(crate) fn is(self, flags: VertexFlags) -> bool {
        self.0 & flags.0 != 0
    }

    #[inline]
    pub(crate) fn set(&mut self, flags: VertexFlags) {
        self.0 |= flags.0;
    }

    #[inline]
    pub(crate) fn drop(&mut self, flags: VertexFlags) {
        self.0 &= !flags.0;
    }
}
