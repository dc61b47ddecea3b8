// Boxes against depth: a pyramid of farthest depths, and a test of every box against the few texels that it covers.

struct Box {
    low: vec3<f32>,
    // Draw that shows what is inside, or none.
    draw: u32,
    high: vec3<f32>,
    unused: u32,
}

struct Params {
    // Boxes; words of a draw's arguments; levels.
    boxes: u32,
    stride: u32,
    levels: u32,
    unused: u32,
    // Width, height and first texel of every level; level 0 is the depth itself.
    level: array<vec4<u32>, 16>,
}

// The level that a pass of the pyramid makes.
struct Step {
    level: u32,
}

@group(0) @binding(1) var<uniform> params: Params;
// Not texture_depth_2d: OpenGL could then only compare with it.
@group(0) @binding(2) var depth: texture_2d<f32>;
@group(0) @binding(3) var<storage, read_write> pyramid: array<f32>;
@group(0) @binding(4) var<storage, read> boxes: array<Box>;
@group(0) @binding(5) var<storage, read_write> flags: array<u32>;
@group(0) @binding(6) var<storage, read_write> arguments: array<u32>;
@group(1) @binding(0) var<uniform> step: Step;

const NONE = 0xffffffffu;

fn texel(level: u32, x: u32, y: u32) -> f32 {
    if level == 0u {
        return textureLoad(depth, vec2(x, y), 0).x;
    }
    let at = params.level[level];
    return pyramid[at.z + y * at.x + x];
}

@compute @workgroup_size(8, 8)
fn reduce(@builtin(global_invocation_id) id: vec3<u32>) {
    let at = params.level[step.level];
    if id.x >= at.x || id.y >= at.y {
        return;
    }
    let below = step.level - 1u;
    let last = params.level[below].xy - vec2(1u);
    let a = min(2u * id.xy, last);
    let b = min(a + vec2(1u), last);
    let left = min(texel(below, a.x, a.y), texel(below, a.x, b.y));
    let right = min(texel(below, b.x, a.y), texel(below, b.x, b.y));
    pyramid[at.z + id.y * at.x + id.x] = min(left, right);
}

// Whether a part of the box may be seen.
fn sees(bounds: Box) -> bool {
    let near = frame.forward.w;
    var low = vec2(1e30);
    var high = vec2(-1e30);
    var nearest = 1e30;
    for (var corner = 0u; corner < 8u; corner++) {
        let upper = vec3((corner & 1u) != 0u, (corner & 2u) != 0u, (corner & 4u) != 0u);
        let at = relative(select(bounds.low, bounds.high, upper));
        let w = dot(frame.forward.xyz, at);
        if !(w > 1.001 * near) {
            // The near plane cuts it.
            return true;
        }
        let image = vec2(dot(frame.right.xyz, at), -dot(frame.up.xyz, at)) / w;
        low = min(low, image);
        high = max(high, image);
        nearest = min(nearest, w);
    }
    // A pixel more on every side pays for all rounding.
    let size = frame.size.xy;
    let first = (0.5 * low + 0.5) * size - 1.0;
    let last = (0.5 * high + 0.5) * size + 1.0;
    if !(all(first <= size) && all(last >= vec2(0.0))) {
        return !(any(first > size) || any(last < vec2(0.0)));
    }
    var a = vec2<u32>(clamp(first, vec2(0.0), size - 1.0));
    var b = vec2<u32>(clamp(last, vec2(0.0), size - 1.0));
    var level = 0u;
    while level + 1u < params.levels && any(b - a > vec2(3u)) {
        level++;
        a = a >> vec2(1u);
        b = b >> vec2(1u);
    }
    let depth_of_box = near / nearest * 1.00001;
    for (var y = a.y; y <= b.y; y++) {
        for (var x = a.x; x <= b.x; x++) {
            if texel(level, x, y) <= depth_of_box {
                return true;
            }
        }
    }
    return false;
}

@compute @workgroup_size(64)
fn test(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.boxes {
        return;
    }
    let bounds = boxes[id.x];
    let seen = select(0u, 1u, sees(bounds));
    flags[id.x] = seen;
    if bounds.draw != NONE {
        // The number of instances.
        arguments[bounds.draw * params.stride + 1u] = seen;
    }
}
