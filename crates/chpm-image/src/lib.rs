//! Rows of images, from the top, in bounded memory: the fence around the codecs.
//!
//! [`ImageRows`] tells the format by the first bytes and hands out RGBA of 8 bits, straight alpha, sRGB as it is stored. The same
//! bytes come out on every machine. Everything here takes untrusted bytes.
#![forbid(unsafe_code)]

mod alpha;
mod encode;
mod error;
mod forward;
mod jpeg;
mod png;
mod rows;

pub use alpha::Alpha;
pub use encode::{Encoded, encode};
pub use error::ImageError;
pub use rows::ImageRows;
