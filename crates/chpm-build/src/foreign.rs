//! How values of other crates are written to a checkpoint.

use chpm_format::Gaps;
use chpm_mesh::Aabb;
use chpm_qem::{Deviation, Refusals};
use serde::{Deserialize, Serialize};

#[derive(Serialize, Deserialize)]
#[serde(remote = "Aabb")]
pub(crate) struct AabbFields {
    min: [f32; 3],
    max: [f32; 3],
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Deviation")]
pub(crate) struct DeviationFields {
    normal: f32,
    color: f32,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Gaps")]
pub(crate) struct GapsFields {
    fine: f32,
    base: f32,
    from: f32,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Refusals")]
pub(crate) struct RefusalsFields([u64; 8]);
