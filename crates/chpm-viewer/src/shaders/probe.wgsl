// The depth at one pixel.

struct Probe {
    pixel: vec2<u32>,
    unused: vec2<u32>,
}

@group(0) @binding(0) var<uniform> probe: Probe;
@group(0) @binding(1) var depth: texture_2d<f32>;
@group(0) @binding(2) var<storage, read_write> found: array<f32>;

@compute @workgroup_size(1)
fn look() {
    found[0] = textureLoad(depth, probe.pixel, 0).x;
}
