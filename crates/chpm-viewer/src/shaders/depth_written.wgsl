// What a pixel keeps in OpenGL, where depth runs from -1 to 1 and is brought to 0 to 1 after the division: far away, near / distance
// would be lost against that 1. So every pixel writes it.

struct Shown {
    @location(0) color: vec4<f32>,
    @builtin(frag_depth) depth: f32,
}

struct Named {
    @location(0) key: u32,
    @builtin(frag_depth) depth: f32,
}

// Of a pixel, the last coordinate is one by the distance.
fn depth_of(position: vec4<f32>) -> f32 {
    return frame.forward.w * position.w;
}

fn shown(color: vec4<f32>, position: vec4<f32>, at: vec3<f32>) -> Shown {
    return Shown(color, depth_of(position));
}

fn named(key: u32, position: vec4<f32>, at: vec3<f32>) -> Named {
    return Named(key, depth_of(position));
}

@fragment
fn deep(@builtin(position) position: vec4<f32>) -> @builtin(frag_depth) f32 {
    return depth_of(position);
}

@fragment
fn deep_cut(seen: Bare) -> @builtin(frag_depth) f32 {
    cut(seen.at);
    return depth_of(seen.position);
}
