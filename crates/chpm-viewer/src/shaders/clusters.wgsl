// Clusters, each at a position of its progressive mesh, from blocks of vertices and corners (gpu/block.rs). What a pixel keeps is in
// depth_kept.wgsl, or depth_shown.wgsl with its depths.

// Words of a vertex: with its colour, or without.
override unit: u32 = 4u;
// Whether the target converts from linear.
override to_linear: bool = false;
// Whether something is clipped: a driver may test depth later where pixels can vanish.
override clipped: bool = false;

struct Draw {
    // The first vertex, and the first corner, in the slab.
    vertices: u32,
    corners: u32,
    // Id of the first triangle.
    key: u32,
    tint: u32,
}

struct Vertex {
    @location(0) position: vec3<f32>,
    @location(1) facing: u32,
    @location(2) color: vec4<f32>,
}

// What a look needs travels from vertices to pixels, and nothing else: on a processor that draws, all of it costs.

// One colour for each draw, by the planes of triangles.
struct Bare {
    @builtin(position) @invariant position: vec4<f32>,
    // Relative to the eye.
    @location(0) at: vec3<f32>,
    @location(1) @interpolate(flat, either) tint: u32,
}

// A colour for each vertex, and what becomes of the plane of a face at it: a symmetric matrix, its diagonal and what is beside it.
struct Seen {
    @builtin(position) @invariant position: vec4<f32>,
    @location(0) at: vec3<f32>,
    @location(1) straight: vec3<f32>,
    @location(2) across: vec3<f32>,
    @location(3) color: vec3<f32>,
}

// The same, by triangle.
struct Apart {
    @builtin(position) @invariant position: vec4<f32>,
    @location(0) at: vec3<f32>,
    @location(1) straight: vec3<f32>,
    @location(2) across: vec3<f32>,
    @location(3) color: vec3<f32>,
    @location(4) corner: vec3<f32>,
    @location(5) @interpolate(flat, either) key: u32,
}

@group(0) @binding(1) var<storage, read> draws: array<Draw>;
@group(1) @binding(0) var<storage, read> data: array<u32>;

const PLAIN = vec3<f32>(0.78, 0.76, 0.72);

// No direction; see facing.rs of chpm-mesh.
const FLAT = 0x80018001u;

fn unfolded(uv: vec2<f32>) -> vec3<f32> {
    let z = 1.0 - abs(uv.x) - abs(uv.y);
    let t = max(-z, 0.0);
    return vec3(uv - select(vec2(-t), vec2(t), uv >= vec2(0.0)), z);
}

fn see(vertex: Vertex, index: u32) -> Seen {
    var seen: Seen;
    seen.at = relative(vertex.position);
    seen.position = project(seen.at);
    // A plane stays as it is.
    seen.straight = vec3(1.0);
    seen.across = vec3(0.0);
    if frame.look.x == 1u && vertex.facing != FLAT {
        let is_crease = (vertex.facing & 1u) != 0u;
        // Where heights are stretched, a line goes with them, and a normal the other way.
        let stretch = select(1.0 / frame.stretch.xyz, frame.stretch.xyz, is_crease);
        let way = normalize(normalize(unfolded(unpack2x16snorm(vertex.facing))) * stretch);
        seen.straight = way * way;
        seen.across = way.yzx * way.zxy;
        if is_crease {
            // On a crease, it loses what it leans along it.
            seen.straight = 1.0 - seen.straight;
            seen.across = -seen.across;
        }
    }
    seen.color = PLAIN;
    if frame.look.y == 1u {
        seen.color = vertex.color.rgb;
    } else if frame.look.y == 2u {
        seen.color = unpack4x8unorm(draws[index].tint).rgb;
    }
    return seen;
}

@vertex
fn bare(@location(0) position: vec3<f32>, @builtin(instance_index) index: u32) -> Bare {
    let at = relative(position);
    return Bare(project(at), at, draws[index].tint);
}

@vertex
fn indexed(vertex: Vertex, @builtin(instance_index) index: u32) -> Seen {
    return see(vertex, index);
}

// Without indices, so that every triangle has corners and an id of its own.
@vertex
fn pulled(@builtin(vertex_index) corner: u32, @builtin(instance_index) index: u32) -> Apart {
    let place = draws[index].corners + corner;
    let number = (data[place / 2u] >> (16u * (place % 2u))) & 0xffffu;
    let at = unit * (draws[index].vertices + number);
    let position = bitcast<vec3<f32>>(vec3(data[at], data[at + 1u], data[at + 2u]));
    // Without colours nobody looks at it.
    let color = unpack4x8unorm(data[at + unit - 1u]);
    let seen = see(Vertex(position, data[at + 3u], color), index);
    var weights = vec3(0.0);
    weights[corner % 3u] = 1.0;
    return Apart(seen.position, seen.at, seen.straight, seen.across, seen.color, weights, draws[index].key + corner / 3u);
}

@vertex
fn depth_only(@location(0) position: vec3<f32>) -> @builtin(position) @invariant vec4<f32> {
    return project(relative(position));
}

// The plane of the triangle, facing the eye: both sides are lit, whichever is seen. Its length is 1, or 0 for no plane.
fn facing_plane(at: vec3<f32>) -> vec3<f32> {
    let plane = cross(evened(dpdx(at)), evened(dpdy(at)));
    let length = length(plane);
    let toward = select(plane, -plane, dot(plane, at) > 0.0);
    return select(vec3(0.0), toward / length, length > 0.0);
}

// What vertices make of it.
fn smoothed(at: vec3<f32>, straight: vec3<f32>, across: vec3<f32>) -> vec3<f32> {
    let toward = facing_plane(at);
    let made = straight * toward + across.zxy * toward.yzx + across.yzx * toward.zxy;
    let size = length(made);
    let normal = select(toward, made / size, size > 1e-3);
    // Near a silhouette it may look away from the eye although the triangle does not: the triangle's own takes its place there, by and by.
    let away = dot(normal, normalize(evened(at)));
    let mixed = mix(normal, toward, smoothstep(-0.15, 0.15, away));
    let rest = length(mixed);
    return select(toward, mixed / rest, rest > 1e-3);
}

// Leaves out what is clipped; after all that looks at neighbours.
fn cut(at: vec3<f32>) {
    if clipped && dot(frame.clip.xyz, at) > frame.clip.w {
        discard;
    }
}

fn encoded(color: vec3<f32>) -> vec4<f32> {
    let c = clamp(color, vec3(0.0), vec3(1.0));
    if to_linear {
        return vec4(select(pow((c + 0.055) / 1.055, vec3(2.4)), c / 12.92, c <= vec3(0.04045)), 1.0);
    }
    return vec4(c, 1.0);
}

@fragment
fn bared(seen: Bare) -> Shown {
    let color = select(PLAIN, unpack4x8unorm(seen.tint).rgb, frame.look.y == 2u);
    let lit = color * light(facing_plane(seen.at), seen.at);
    cut(seen.at);
    return shown(encoded(lit), seen.position, seen.at);
}

@fragment
fn colored(seen: Seen) -> Shown {
    let lit = seen.color * light(smoothed(seen.at, seen.straight, seen.across), seen.at);
    cut(seen.at);
    return shown(encoded(lit), seen.position, seen.at);
}

@fragment
fn wired(seen: Apart) -> Shown {
    var color = seen.color;
    if frame.look.y == 3u {
        var hash = seen.key * 2654435761u;
        hash = (hash ^ (hash >> 15u)) * 2246822519u;
        hash = hash ^ (hash >> 13u);
        color = 0.25 + 0.75 * unpack4x8unorm(hash).rgb;
    }
    let lit = color * light(smoothed(seen.at, seen.straight, seen.across), seen.at);
    let steps = max(fwidth(seen.corner), vec3(1e-20));
    let distance = seen.corner / steps;
    // Where triangles come down to a few pixels, edges would hide what they are the edges of.
    let fade = 1.0 - smoothstep(0.15, 0.6, max(steps.x, max(steps.y, steps.z)));
    let edge = fade * (1.0 - smoothstep(0.4, 1.2, min(distance.x, min(distance.y, distance.z))));
    let color_and_edge = mix(lit, vec3(0.03, 0.04, 0.06), select(0.0, 0.85 * edge, frame.look.z == 1u));
    cut(seen.at);
    return shown(encoded(color_and_edge), seen.position, seen.at);
}

@fragment
fn identified(seen: Apart) -> Named {
    cut(seen.at);
    return named(seen.key, seen.position, seen.at);
}
