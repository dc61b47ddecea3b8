// Depth of a pixel in OpenGL, where it runs from -1 to 1 and is brought to 0 to 1 after the division: far away, near / distance
// would be lost against that 1. So every pixel writes it.

// Of a pixel, the last coordinate is one by the distance.
fn depth_of(position: vec4<f32>, at: vec3<f32>) -> f32 {
    return frame.forward.w * position.w;
}

@fragment
fn deep(@builtin(position) position: vec4<f32>) -> @builtin(frag_depth) f32 {
    return depth_of(position, vec3<f32>());
}

@fragment
fn deep_cut(seen: Bare) -> @builtin(frag_depth) f32 {
    cut(seen.at);
    return depth_of(seen.position, seen.at);
}
