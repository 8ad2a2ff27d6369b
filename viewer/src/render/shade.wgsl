// Light on the surface buffers: two lamps that stand to the camera, a sky that bone closes, and the
// shadow of the key lamp.

@group(2) @binding(0) var colours: texture_2d<f32>;
@group(2) @binding(1) var normals: texture_2d<f32>;
@group(2) @binding(2) var distances: texture_2d<f32>;

struct Screen { @builtin(position) position: vec4f, @location(0) ndc: vec2f };

// The squares of `iso.wgsl`.
@vertex
fn vertex_main(@builtin(vertex_index) i: u32, @location(0) square: u32) -> Screen {
    let corner = array(vec2u(0, 0), vec2u(0, 1), vec2u(1, 0), vec2u(1, 0), vec2u(0, 1), vec2u(1, 1))[i];
    let at = vec2f(vec2u(square & 0xffffu, square >> 16u) + corner) * globals.square.xy;
    let ndc = vec2f(at.x - 1.0, 1.0 - at.y);
    return Screen(vec4f(ndc, 1.0, 1.0), ndc);
}

@vertex
fn background_vertex(@builtin(vertex_index) i: u32) -> Screen {
    let corner = vec2f(f32(i32(i & 1u) * 4 - 1), f32(i32(i >> 1u) * 4 - 1));
    return Screen(vec4f(corner, 1.0, 1.0), corner);
}

@fragment
fn background_fragment(screen: Screen) -> @location(0) vec4f { return background(screen.ndc); }

fn background(ndc: vec2f) -> vec4f {
    let c = mix(vec3f(0.075, 0.085, 0.10), vec3f(0.19, 0.215, 0.25), 0.5 + 0.5 * ndc.y);
    return vec4f(c, 1.0);
}

// Share of the sky seen from a surface point: bone found at a few places above it.
fn openness(p: vec3f, n: vec3f) -> f32 {
    let helper = select(vec3f(1.0, 0.0, 0.0), vec3f(0.0, 1.0, 0.0), abs(n.x) > 0.7);
    let a = normalize(cross(n, helper));
    let b = cross(n, a);
    var closed = 0.30 * filled(p + n * 1.0);
    closed += 0.16 * filled(p + n * 3.0);
    closed += 0.16 * filled(p + n * 2.0 + a * 2.6);
    closed += 0.16 * filled(p + n * 2.0 - a * 2.6);
    closed += 0.16 * filled(p + n * 2.0 + b * 2.6);
    closed += 0.16 * filled(p + n * 2.0 - b * 2.6);
    return 1.0 - 0.85 * min(closed, 1.0);
}

fn filled(p: vec3f) -> f32 {
    return select(smoothstep(-0.9, 0.6, value_at(p)), 0.0, is_hidden(p));
}

fn key_light_at(p: vec3f) -> f32 {
    let direction = select(globals.key_light.xyz, vec3f(1e-6), abs(globals.key_light.xyz) < vec3f(1e-6));
    let box = span_of_box(p, 1.0 / direction, globals.box_lo.xyz, globals.box_hi.xyz);
    let span = visible_part(p, direction, vec2f(0.0, box.y));
    return select(1.0, 0.25, span.y > span.x && march(p, direction, span.x, span.y).found);
}

// `open` in [0, 1] is the share of the sky that the point sees, `key` the share of the key light
// that reaches it.
fn shade(albedo: vec3f, n: vec3f, to_eye: vec3f, gloss: f32, open: f32, key: f32) -> vec3f {
    let sky = mix(vec3f(0.16, 0.15, 0.15), vec3f(0.30, 0.32, 0.35), 0.5 + 0.5 * dot(n, globals.up.xyz));
    let key_cos = max(dot(n, globals.key_light.xyz), 0.0);
    let fill_cos = max(dot(n, globals.fill_light.xyz), 0.0);
    let head_cos = max(dot(n, to_eye), 0.0);
    var light = sky * open;
    light += vec3f(0.80, 0.77, 0.72) * key_cos * key;
    light += vec3f(0.15, 0.17, 0.21) * fill_cos * open;
    light += vec3f(0.14) * head_cos * open;
    let half_way = normalize(globals.key_light.xyz + to_eye);
    let glint = pow(max(dot(n, half_way), 0.0), 28.0) * gloss * key * step(0.0, key_cos);
    return albedo * light + vec3f(glint);
}

@fragment
fn fragment_main(screen: Screen) -> @location(0) vec4f {
    let at = vec2i(screen.position.xy);
    let away = textureLoad(distances, at, 0).x;
    var result = background(screen.ndc);
    // a loop of at most one turn: a software renderer jumps over a loop that no pixel enters, never
    // over a branch
    for (var turn = 0; turn < select(0, 1, away > 0.0); turn += 1) {
        result = vec4f(lit(at, away, ray_through(screen.ndc)), 1.0);
    }
    return result;
}

fn lit(at: vec2i, away: f32, direction: vec3f) -> vec3f {
    let colour = textureLoad(colours, at, 0);
    let normal = textureLoad(normals, at, 0);
    if normal.w == KIND_FLAT { return colour.rgb; }
    let p = globals.eye.xyz + direction * away;
    let n = normalize(normal.xyz);
    var key = 1.0;
    if globals.eye.w > 0.5 && dot(n, globals.key_light.xyz) > 0.0 {
        key = key_light_at(p + n * 0.6 * globals.ray_y.w);
    }
    let is_tool = normal.w == KIND_TOOL;
    // steel mirrors the dim room: darker where it is looked at edge-on
    let albedo = to_linear(colour.rgb) * select(1.0, 0.75 + 0.25 * abs(dot(n, direction)), is_tool);
    return to_screen(shade(albedo, n, -direction, colour.w, openness(p, n), key));
}
