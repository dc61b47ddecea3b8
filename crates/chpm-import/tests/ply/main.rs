//! PLY files: the flavours of the world read exactly, errors say where, and no bytes make the reader panic.

mod errors;
mod flavours;
mod forge;
mod grid;
mod hostile;
mod roundtrip;
mod scalars;
