
// Shadows of the key light: clusters as it sees them, and whether it sees what is drawn. The map has up to four parts, the finest first.

struct Part {
    // From what is relative to the eye: -1 to 1 across the part, and 0 to 1 toward the light.
    right: vec4<f32>,
    up: vec4<f32>,
    forward: vec4<f32>,
    // Where it is in the map: its middle, and half of its sides.
    place: vec4<f32>,
    // Depth over a texel to the right and upward where the surface leans by 45 degrees; what is always granted; how far it reaches.
    texel: vec4<f32>,
}

struct Shadows {
    parts: array<Part, 4>,
    count: vec4<u32>,
}

@group(3) @binding(0) var<uniform> shadows: Shadows;
@group(3) @binding(1) var map: texture_depth_2d;
@group(3) @binding(2) var compares: sampler_comparison;

// The key light's share of `light`, and in a studio.
const KEY = 0.54;
const STUDIO_KEY = 0.58;
// Where the light comes from beside, depth over a texel has no end; there is hardly any light there either.
const LEAST = 0.04;

// As `project` makes the image.
fn to_map(at: vec3<f32>) -> vec4<f32> {
    let across = vec2(dot(frame.right.xyz, at) + frame.right.w, dot(frame.up.xyz, at) + frame.up.w);
    return vec4(across, dot(frame.forward.xyz, at) + frame.forward.w, 1.0);
}

@vertex
fn mapped(@location(0) position: vec3<f32>) -> @builtin(position) vec4<f32> {
    return to_map(relative(position));
}

@vertex
fn mapped_cut(@location(0) position: vec3<f32>) -> Bare {
    let at = relative(position);
    return Bare(to_map(at), at, 0u);
}

@fragment
fn uncut(seen: Bare) {
    cut(seen.at);
}

// What the matrix of a vertex makes of a vector.
fn bent(v: vec3<f32>, straight: vec3<f32>, across: vec3<f32>) -> vec3<f32> {
    return straight * v + across.zxy * v.yzx + across.yzx * v.zxy;
}

// How much of the key light comes to a point of a triangle with this plane.
fn open(at: vec3<f32>, plane: vec3<f32>) -> f32 {
    let toward = max(dot(plane, frame.light.xyz), LEAST);
    for (var place = 0u; place < shadows.count.x; place++) {
        let part = shadows.parts[place];
        let x = dot(part.right.xyz, at) + part.right.w;
        let y = dot(part.up.xyz, at) + part.up.w;
        if max(abs(x), abs(y)) < part.texel.w {
            // As far as the surface itself comes toward the light over the texels that are looked at.
            let lean = abs(vec2(dot(part.right.xyz, plane), dot(part.up.xyz, plane))) * part.texel.xy;
            let granted = part.texel.z + (lean.x + lean.y) / toward;
            let depth = dot(part.forward.xyz, at) + part.forward.w + granted;
            return textureSampleCompareLevel(map, compares, part.place.xy + part.place.zw * vec2(x, -y), depth);
        }
    }
    return 1.0;
}

fn less(facing: vec3<f32>, at: vec3<f32>, share: f32) -> f32 {
    let key = select(KEY, STUDIO_KEY, frame.look.w == 1u) * max(dot(facing, frame.light.xyz), 0.0);
    return light(facing, at) - key * (1.0 - share);
}

fn shaded(facing: vec3<f32>, at: vec3<f32>) -> f32 {
    return less(facing, at, open(at, facing));
}

// Smooth light on a mesh of planes: where it is round, a point is looked up on the surface that the corners' normals stand for (Hanika,
// "Hacking the shadow terminator"), not below it on a plane that others of the same round hide.
fn shaded_smoothly(at: vec3<f32>, straight: vec3<f32>, across: vec3<f32>, anchor: vec3<f32>) -> f32 {
    let plane = facing_plane(at);
    let above = max(dot(anchor - bent(at, straight, across), plane), 0.0);
    return less(smoothed(at, straight, across), at, open(at + plane * above, plane));
}
