//! The graphics processor: what it is, what is on it, and what it is told to draw.

pub mod arena;
pub mod block;
pub mod buffers;
pub mod camera_uniform;
pub mod context;
pub mod fault;
pub mod lighting;
pub mod occlusion;
pub mod passes;
pub mod pipelines;
pub mod probe;
pub mod shadows;
pub mod sheets;

pub use arena::Arena;
pub use block::Block;
pub use camera_uniform::CameraUniform;
pub use context::{AdapterChoice, Gpu};
pub use occlusion::{Answers, Occlusion, Questions, TestBox};
pub use passes::{DrawBuffers, DrawList, Drawn, Mark};
pub use pipelines::{Kind, Pipelines};
pub use probe::Probe;
pub use shadows::{Casters, ShadowMap};
pub use sheets::Sheets;
