//! Many models in one run: which, whether they need building, side by side, and what became of them.

/// One progress display for all models.
mod display;
/// Whether an output is what a build would make.
pub(crate) mod fingerprint;
/// Models with names, from typed inputs.
pub(crate) mod inputs;
/// Lists of models with settings of their own.
pub(crate) mod manifest;
pub(crate) mod page;
/// Models side by side.
pub(crate) mod run;
/// Which models belong to which machine.
pub(crate) mod shard;
/// Results of every model, for people and programs.
pub(crate) mod summary;
