// The lighting of a picture: corners are darker, since less light comes there, and so is the ground below the model. All of it by the
// depths around a pixel: 1 leaves a colour as it is.

@group(0) @binding(1) var depth: texture_2d<f32>;

// Depths that are looked at around a pixel.
const LOOKS = 24;
// How far, as a share of the model's diagonal, and in pixels at most.
const REACH = 0.06;
const MOST = 160.0;
// Of the light that comes from everywhere, what corners may lose.
const DARKEST = 0.85;
const GOLDEN = 2.399963;

@vertex
fn everywhere(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    return vec4(4.0 * f32(corner & 1u) - 1.0, 4.0 * f32(corner >> 1u) - 1.0, 0.5, 1.0);
}

// From the eye to what is at distance 1 along the sight in a pixel.
fn ray(pixel: vec2<f32>) -> vec3<f32> {
    let image = vec2(2.0, -2.0) * pixel / frame.size.xy + vec2(-1.0, 1.0);
    let right = frame.right.xyz / dot(frame.right.xyz, frame.right.xyz);
    let up = frame.up.xyz / dot(frame.up.xyz, frame.up.xyz);
    return frame.forward.xyz + right * image.x + up * image.y;
}

fn depth_at(pixel: vec2<i32>) -> f32 {
    let last = vec2<i32>(frame.size.xy) - 1;
    return textureLoad(depth, clamp(pixel, vec2(0), last), 0).x;
}

// What is seen in a pixel, relative to the eye.
fn seen(pixel: vec2<i32>) -> vec3<f32> {
    return ray(vec2<f32>(pixel) + 0.5) * (frame.forward.w / depth_at(pixel));
}

// The smaller of two steps to the neighbours: the other one may leave the surface.
fn slope(pixel: vec2<i32>, at: vec3<f32>, along: vec2<i32>) -> vec3<f32> {
    let ahead = seen(pixel + along) - at;
    let back = at - seen(pixel - along);
    let has_ahead = depth_at(pixel + along) > 0.0;
    let has_back = depth_at(pixel - along) > 0.0;
    return select(back, ahead, has_ahead && (dot(ahead, ahead) < dot(back, back) || !has_back));
}

@fragment
fn contact(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(position.xy);
    var at: vec3<f32>;
    var normal: vec3<f32>;
    var fade = 1.0;
    if depth_at(pixel) > 0.0 {
        at = seen(pixel);
        normal = normalize(cross(evened(slope(pixel, at, vec2(1, 0))), evened(slope(pixel, at, vec2(0, 1)))));
        normal = select(normal, -normal, dot(normal, at) > 0.0);
    } else {
        // The ground of a studio, if the sight goes down to it from above.
        let sight = ray(position.xy);
        let down = dot(sight, frame.sky.xyz);
        if !(frame.look.w == 1u && frame.sky.w < 0.0 && down < 0.0) {
            return vec4(1.0);
        }
        at = sight * (frame.sky.w / down);
        normal = frame.sky.xyz;
        fade = 1.6;
    }

    let reach = REACH * frame.size.z * select(1.0, 2.5, fade > 1.0);
    let away = dot(at, frame.forward.xyz);
    let pixels = clamp(0.5 * reach * length(frame.up.xyz) * frame.size.y / away, 2.0, MOST);
    // Another turn in every pixel and in every picture of a mean.
    let turn = 6.2832 * fract(52.9829 * fract(dot(position.xy, vec2(0.06711, 0.00584))) + 7.0 * frame.size.w);
    var hidden = 0.0;
    for (var look = 0; look < LOOKS; look++) {
        let share = sqrt((f32(look) + 0.5) / f32(LOOKS));
        let angle = turn + GOLDEN * f32(look);
        let there = pixel + vec2<i32>(round(pixels * share * vec2(cos(angle), sin(angle))));
        if depth_at(there) <= 0.0 {
            continue;
        }
        let way = seen(there) - at;
        let far = length(way);
        let rises = dot(way, normal) / max(far, 1e-20) - 0.06;
        hidden += max(rises, 0.0) * max(1.0 - far / reach, 0.0);
    }
    let light = max(1.0 - DARKEST * 2.6 * fade * hidden / f32(LOOKS), 1.0 - DARKEST);
    return vec4(vec3(light), 1.0);
}
