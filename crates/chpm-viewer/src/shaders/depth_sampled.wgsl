// Depth of a sample in OpenGL, where a pixel has several: as in depth_written.wgsl, but where the sample is, which not every driver tells
// by its position. Nobody else looks at these depths: they need not be the same to the last bit.

fn depth_of(position: vec4<f32>, at: vec3<f32>) -> f32 {
    return frame.forward.w / dot(frame.forward.xyz, at);
}
