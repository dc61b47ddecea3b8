//! External memory: budget, work directory, buffers in memory or on disk, the only memory map.
