// What is kept of a pixel, or of a sample of one, where its depth is written: that of `depth_of` in depth_written.wgsl or depth_sampled.wgsl.

struct Shown {
    @location(0) color: vec4<f32>,
    @builtin(frag_depth) depth: f32,
}

struct Named {
    @location(0) key: u32,
    @builtin(frag_depth) depth: f32,
}

fn shown(color: vec4<f32>, position: vec4<f32>, at: vec3<f32>) -> Shown {
    return Shown(color, depth_of(position, at));
}

fn named(key: u32, position: vec4<f32>, at: vec3<f32>) -> Named {
    return Named(key, depth_of(position, at));
}
