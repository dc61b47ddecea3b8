// Clusters, each at a position of its progressive mesh, from blocks that never change (gpu/block.rs).

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
    // Width, height.
    size: vec4<f32>,
    // Smooth; colours: 0 plain, 1 of vertices, 2 of the draw, 3 of the triangle; wires; whether the target converts from linear.
    look: vec4<u32>,
}

struct Draw {
    vertices: u32,
    colors: u32,
    targets: u32,
    corners: u32,
    // Vertices of the base mesh, and of the position.
    base: u32,
    count: u32,
    // Id of the first triangle.
    key: u32,
    tint: u32,
}

// What a look needs travels from vertices to pixels, and nothing else: on a processor that draws, all of it costs.

// One colour for each draw, by the planes of triangles.
struct Bare {
    @builtin(position) @invariant position: vec4<f32>,
    // Relative to the eye.
    @location(0) at: vec3<f32>,
    @location(1) @interpolate(flat, either) tint: u32,
}

// A colour and a normal for each vertex.
struct Seen {
    @builtin(position) @invariant position: vec4<f32>,
    @location(0) at: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) color: vec3<f32>,
}

// The same, by triangle.
struct Apart {
    @builtin(position) @invariant position: vec4<f32>,
    @location(0) at: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) color: vec3<f32>,
    @location(3) corner: vec3<f32>,
    @location(4) @interpolate(flat, either) key: u32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> draws: array<Draw>;
@group(1) @binding(0) var<storage, read> data: array<vec4<u32>>;

const PLAIN = vec3<f32>(0.78, 0.76, 0.72);

// One of the 16-bit numbers that start at a unit.
fn half(at: u32, index: u32) -> u32 {
    let word = data[at + index / 8u][(index / 2u) % 4u];
    return (word >> (16u * (index % 2u))) & 0xffffu;
}

fn project(at: vec3<f32>) -> vec4<f32> {
    // Reversed depth, from 1 at the near plane to 0 infinitely far.
    return vec4(dot(frame.right.xyz, at), dot(frame.up.xyz, at), frame.forward.w, dot(frame.forward.xyz, at));
}

fn relative(position: vec3<f32>) -> vec3<f32> {
    return (position - frame.eye_high.xyz) - frame.eye_low.xyz;
}

// Where a vertex of a draw is at its position: along the collapses.
fn resolve(index: u32, finest: u32) -> u32 {
    let count = draws[index].count;
    if finest < count {
        return finest;
    }
    let base = draws[index].base;
    let targets = draws[index].targets;
    var vertex = finest;
    while vertex >= count {
        let next = half(targets, vertex - base);
        // Targets are smaller; whatever is read where no vertex is, is no way round for ever.
        if next >= vertex {
            break;
        }
        vertex = next;
    }
    return vertex;
}

fn normal_of(code: u32) -> vec3<f32> {
    let uv = unpack2x16snorm(code);
    let z = 1.0 - abs(uv.x) - abs(uv.y);
    let t = max(-z, 0.0);
    return vec3(uv - select(vec2(-t), vec2(t), uv >= vec2(0.0)), z);
}

fn see(index: u32, finest: u32) -> Seen {
    let vertex = resolve(index, finest);
    let unit = data[draws[index].vertices + vertex];
    var seen: Seen;
    seen.at = relative(bitcast<vec3<f32>>(unit.xyz));
    seen.position = project(seen.at);
    seen.normal = vec3(0.0);
    if frame.look.x == 1u {
        seen.normal = normal_of(unit.w);
    }
    seen.color = PLAIN;
    if frame.look.y == 1u {
        let colors = draws[index].colors;
        if colors != draws[index].targets {
            seen.color = unpack4x8unorm(data[colors + vertex / 4u][vertex % 4u]).rgb;
        }
    } else if frame.look.y == 2u {
        seen.color = unpack4x8unorm(draws[index].tint).rgb;
    }
    return seen;
}

@vertex
fn bare(@builtin(vertex_index) vertex: u32, @builtin(instance_index) index: u32) -> Bare {
    let at = relative(bitcast<vec3<f32>>(data[draws[index].vertices + resolve(index, vertex)].xyz));
    return Bare(project(at), at, draws[index].tint);
}

@vertex
fn indexed(@builtin(vertex_index) vertex: u32, @builtin(instance_index) index: u32) -> Seen {
    return see(index, vertex);
}

// Without indices, so that every triangle has corners and an id of its own.
@vertex
fn pulled(@builtin(vertex_index) corner: u32, @builtin(instance_index) index: u32) -> Apart {
    let seen = see(index, half(draws[index].corners, corner));
    var weights = vec3(0.0);
    weights[corner % 3u] = 1.0;
    return Apart(seen.position, seen.at, seen.normal, seen.color, weights, draws[index].key + corner / 3u);
}

@vertex
fn depth_only(@builtin(vertex_index) vertex: u32, @builtin(instance_index) index: u32)
    -> @builtin(position) @invariant vec4<f32> {
    let at = data[draws[index].vertices + resolve(index, vertex)].xyz;
    return project(relative(bitcast<vec3<f32>>(at)));
}

fn shade(at: vec3<f32>, smooth_normal: vec3<f32>, color: vec3<f32>) -> vec3<f32> {
    var normal = smooth_normal;
    // Vertices without a direction, and flat shading.
    let plane = cross(dpdx(at), dpdy(at));
    if dot(normal, normal) == 0.0 {
        normal = plane;
    }
    let length = length(normal);
    normal = select(vec3(0.0), normal / length, length > 0.0);
    // Both sides are drawn alike.
    normal = select(normal, -normal, dot(normal, at) > 0.0);
    let key = max(dot(normal, frame.light.xyz), 0.0);
    let head = max(-dot(normal, normalize(at)), 0.0);
    return color * (0.16 + 0.54 * key + 0.34 * head);
}

fn shown(color: vec3<f32>) -> vec4<f32> {
    let c = clamp(color, vec3(0.0), vec3(1.0));
    if frame.look.w == 0u {
        return vec4(c, 1.0);
    }
    return vec4(select(pow((c + 0.055) / 1.055, vec3(2.4)), c / 12.92, c <= vec3(0.04045)), 1.0);
}

@fragment
fn bared(seen: Bare) -> @location(0) vec4<f32> {
    let color = select(PLAIN, unpack4x8unorm(seen.tint).rgb, frame.look.y == 2u);
    return shown(shade(seen.at, vec3(0.0), color));
}

@fragment
fn colored(seen: Seen) -> @location(0) vec4<f32> {
    return shown(shade(seen.at, seen.normal, seen.color));
}

@fragment
fn wired(seen: Apart) -> @location(0) vec4<f32> {
    var color = seen.color;
    if frame.look.y == 3u {
        var hash = seen.key * 2654435761u;
        hash = (hash ^ (hash >> 15u)) * 2246822519u;
        hash = hash ^ (hash >> 13u);
        color = 0.25 + 0.75 * unpack4x8unorm(hash).rgb;
    }
    let lit = shade(seen.at, seen.normal, color);
    let distance = seen.corner / max(fwidth(seen.corner), vec3(1e-20));
    let edge = 1.0 - smoothstep(0.4, 1.2, min(distance.x, min(distance.y, distance.z)));
    return shown(mix(lit, vec3(0.03, 0.04, 0.06), select(0.0, 0.85 * edge, frame.look.z == 1u)));
}

@fragment
fn identified(seen: Apart) -> @location(0) u32 {
    return seen.key;
}
