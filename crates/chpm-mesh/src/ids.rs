//! Typed indices. A local vertex is a `u16` inside one cluster; everything global has a type of its own.

use serde::{Deserialize, Serialize};
use std::fmt;

macro_rules! id {
    ($(#[$doc:meta])* $name:ident, $prefix:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Serialize, Deserialize)]
        pub struct $name(pub u32);

        impl $name {
            /// "No such thing": the parent of a root, for example.
            pub const NONE: $name = $name(u32::MAX);

            /// The id as an index into its table.
            pub fn index(self) -> usize {
                self.0 as usize
            }

            /// Whether this is not [`Self::NONE`].
            pub fn is_some(self) -> bool {
                self != Self::NONE
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                if self.is_some() { write!(f, concat!($prefix, "{}"), self.0) } else { f.write_str("none") }
            }
        }
    };
}

id!(
    /// Index of a cluster in the cluster table, which is its order in the file.
    ClusterId,
    "cluster "
);
id!(
    /// Index of a dependency group in the group table.
    GroupId,
    "group "
);

/// Height of a cluster above the leaves: a leaf is at level 0, a parent one above its highest child.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Default, Serialize, Deserialize)]
pub struct Level(pub u32);

impl fmt::Display for Level {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "level {}", self.0)
    }
}
