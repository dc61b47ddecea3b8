//! Draws a CHPM with wgpu: in a window, or without one into an image.
#![forbid(unsafe_code)]
