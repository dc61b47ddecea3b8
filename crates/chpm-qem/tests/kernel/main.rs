//! The kernel from outside: exact answers on small meshes, what must hold on any mesh, and its quality beside an oracle.

mod anew;
mod attributes;
mod bounds;
mod forced;
mod group_border;
mod hand;
mod play;
mod properties;
mod quality;
