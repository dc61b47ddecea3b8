//! Pages, pictures and their proofs, on small generated models and a software adapter.

/// Generated models and the ways that a camera goes about them.
mod models;
/// A device to draw with; there must be one.
mod screen;

/// A clipping plane, the light and roll.
mod clip;
/// Culling leaves out hidden surface, and nothing that is seen.
mod culling;
/// How far a picture is from that of the full model.
mod deviation;
/// Refusals of a device are errors.
mod faults;
/// Pages come whole, checked, and within their budget, or with an error that says what is wrong.
mod fetch;
/// Pictures as they were.
mod golden;
/// Models much larger than what may be used.
mod limits;
/// Measured points are on the source, however coarse the picture is.
mod measure;
/// Pictures from the processor, triangle by triangle.
mod raster;
/// They are the same.
mod reference;
/// Smooth shading shows no borders of clusters.
mod seams;
/// Shadows of the key light.
mod shadows;
/// Edges without stairs in frames that do not wait.
mod smooth;
/// Two models in one picture.
mod together;
