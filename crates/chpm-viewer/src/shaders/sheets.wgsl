// Clusters in the colours of their sheets; see clusters.wgsl. Where a triangle is in its sheet follows from where it is in space and from its
// chart, both of which the block has behind its corners (gpu/block.rs).

@group(2) @binding(0) var sheets: texture_2d<f32>;
@group(2) @binding(1) var texels: sampler;

struct Painted {
    @builtin(position) @invariant position: vec4<f32>,
    @location(0) at: vec3<f32>,
    @location(1) straight: vec3<f32>,
    @location(2) across: vec3<f32>,
    @location(3) color: vec3<f32>,
    // In the texture, from 0 to 1.
    @location(4) place: vec2<f32>,
    @location(5) @interpolate(flat, either) has_sheet: u32,
}

fn three(at: u32) -> vec3<f32> {
    return bitcast<vec3<f32>>(vec3(data[at], data[at + 1u], data[at + 2u]));
}

fn two(at: u32) -> vec2<f32> {
    return bitcast<vec2<f32>>(vec2(data[at], data[at + 1u]));
}

// Of a draw, the tint is where its sheet is told of, or 0 for none; and the key, where the charts of its triangles are.
@vertex
fn pulled_painted(@builtin(vertex_index) corner: u32, @builtin(instance_index) index: u32) -> Painted {
    let place = draws[index].corners + corner;
    let number = (data[place / 2u] >> (16u * (place % 2u))) & 0xffffu;
    let at = unit * (draws[index].vertices + number);
    let position = three(at);
    let seen = see(Vertex(position, data[at + 3u], unpack4x8unorm(data[at + unit - 1u])), index);
    var painted = Painted(seen.position, seen.at, seen.straight, seen.across, seen.color, vec2(0.0), 0u);
    let sheet = draws[index].tint;
    if sheet != 0u {
        let triangle = corner / 3u;
        let number = (data[draws[index].key + triangle / 2u] >> (16u * (triangle % 2u))) & 0xffffu;
        let chart = sheet + 8u + 8u * number;
        let way = position - three(sheet);
        let in_sheet = vec2(dot(three(chart), way), dot(three(chart + 3u), way)) + two(chart + 6u);
        painted.place = in_sheet * bitcast<f32>(data[sheet + 3u]) + two(sheet + 4u);
        painted.has_sheet = 1u;
    }
    return painted;
}

// Whether a pixel is among those that are left out where only a share is seen: of 4 x 4, in the order of Bayer.
fn is_left_out(share: f32, position: vec4<f32>) -> bool {
    let x = u32(position.x);
    let y = u32(position.y);
    let order = (((x ^ y) & 1u) << 3u) | ((y & 1u) << 2u) | ((x ^ y) & 2u) | ((y & 2u) >> 1u);
    return 16.0 * share < f32(order) + 0.5;
}

@fragment
fn painted(seen: Painted) -> Shown {
    let texel = textureSample(sheets, texels, seen.place);
    let color = select(seen.color, texel.rgb, seen.has_sheet != 0u);
    let lit = color * light(smoothed(seen.at, seen.straight, seen.across), seen.at);
    cut(seen.at);
    if seen.has_sheet != 0u && is_left_out(texel.a, seen.position) {
        discard;
    }
    return shown(encoded(lit), seen.position, seen.at);
}
