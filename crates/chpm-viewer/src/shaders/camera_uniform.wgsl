// What all shaders look through: a camera and its image.

struct Frame {
    // The eye, in two parts: what is near it loses nothing, and equal positions stay equal.
    eye_high: vec4<f32>,
    eye_low: vec4<f32>,
    // Scaled so that x / w and y / w are the image's; the last one gives w, and carries the near plane.
    right: vec4<f32>,
    up: vec4<f32>,
    forward: vec4<f32>,
    // Towards the light.
    light: vec4<f32>,
    // Width, height; the model's diagonal; how far the image is moved.
    size: vec4<f32>,
    // What is up in the model; how far above the eye the ground is.
    sky: vec4<f32>,
    // Smooth; colours: 0 plain, 1 of vertices, 2 of the draw, 3 of the triangle; wires; the light of a studio.
    look: vec4<u32>,
    // Beyond this plane nothing is drawn: its normal, and its place relative to the eye.
    clip: vec4<f32>,
    // What each coordinate is multiplied by, once it is relative to the eye.
    stretch: vec4<f32>,
}

@group(0) @binding(0) var<uniform> frame: Frame;

fn relative(position: vec3<f32>) -> vec3<f32> {
    return ((position - frame.eye_high.xyz) - frame.eye_low.xyz) * frame.stretch.xyz;
}

fn project(at: vec3<f32>) -> vec4<f32> {
    // Reversed depth, from 1 at the near plane to 0 infinitely far.
    return vec4(dot(frame.right.xyz, at), dot(frame.up.xyz, at), frame.forward.w, dot(frame.forward.xyz, at));
}

// The same direction, its longest part from 1 to 2: what is 1e-9 or 1e36 long has no length in singles, since that takes squares. By a power
// of two, which rounds nothing.
fn evened(v: vec3<f32>) -> vec3<f32> {
    let longest = max(abs(v.x), max(abs(v.y), abs(v.z)));
    let exponent = min(bitcast<u32>(longest) & 0x7f800000u, 0x7e800000u);
    return v * bitcast<f32>(0x7f000000u - exponent);
}

// Of what is lit from the front as well; of no direction, hardly.
fn light(facing: vec3<f32>, at: vec3<f32>) -> f32 {
    let key = max(dot(facing, frame.light.xyz), 0.0);
    let head = max(-dot(facing, normalize(evened(at))), 0.0);
    if frame.look.w == 1u {
        // The sky from above, a little from the ground, and the key: the eye brings hardly any light.
        return 0.22 + 0.20 * dot(facing, frame.sky.xyz) + 0.58 * key + 0.14 * head;
    }
    return 0.16 + 0.54 * key + 0.34 * head;
}

