//! Progress is data: work reports counts, whoever started it draws them.

/// Receives progress. Tasks come one after the other; pieces of one may be reported from any thread.
pub trait Progress: Sync {
    /// A task begins; `total` units of work are expected (triangles, clusters or bytes, whatever the task counts).
    fn begin(&self, task: &str, total: u64);
    /// `done` more units of the running task are done.
    fn advance(&self, done: u64);
    /// The task has ended, well or not.
    fn end(&self);
    /// Something that whoever waits should know, about earlier work for example.
    fn note(&self, _text: &str) {}
}

/// Draws nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _: &str, _: u64) {}
    fn advance(&self, _: u64) {}
    fn end(&self) {}
}
