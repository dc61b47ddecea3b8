//! STL and OBJ as they come, and as they must not; images of all formats.

mod damaged_textures;
mod hostile;
mod materials;
mod obj;
mod stl;
mod textures;
