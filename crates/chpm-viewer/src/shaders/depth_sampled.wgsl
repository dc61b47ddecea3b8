// What a sample keeps in OpenGL, where a pixel has several: as in depth_written.wgsl, but where the sample is, which not every driver tells
// by its position. Nobody else looks at these depths: they need not be the same to the last bit.

struct Shown {
    @location(0) color: vec4<f32>,
    @builtin(frag_depth) depth: f32,
}

struct Named {
    @location(0) key: u32,
    @builtin(frag_depth) depth: f32,
}

fn depth_of(at: vec3<f32>) -> f32 {
    return frame.forward.w / dot(frame.forward.xyz, at);
}

fn shown(color: vec4<f32>, position: vec4<f32>, at: vec3<f32>) -> Shown {
    return Shown(color, depth_of(at));
}

fn named(key: u32, position: vec4<f32>, at: vec3<f32>) -> Named {
    return Named(key, depth_of(at));
}
