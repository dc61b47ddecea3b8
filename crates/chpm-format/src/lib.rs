//! The CHPM file: reader, writer, verify, dump; no I/O.
