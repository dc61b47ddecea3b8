//! STL and OBJ as they come, and as they must not.

mod hostile;
mod obj;
mod stl;
