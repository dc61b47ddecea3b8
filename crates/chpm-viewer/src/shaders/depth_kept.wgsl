// What a pixel keeps where the depth of the rasteriser is the one of `project`, to the last bit of a float.

struct Shown {
    @location(0) color: vec4<f32>,
}

struct Named {
    @location(0) key: u32,
}

fn shown(color: vec4<f32>, position: vec4<f32>, at: vec3<f32>) -> Shown {
    return Shown(color);
}

fn named(key: u32, position: vec4<f32>, at: vec3<f32>) -> Named {
    return Named(key);
}

// Depth alone, of what is not clipped.
@fragment
fn deep_cut(seen: Bare) {
    cut(seen.at);
}
