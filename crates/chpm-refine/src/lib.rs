//! Selection of a mesh from a CHPM: cuts, PM positions, extraction; no I/O.
