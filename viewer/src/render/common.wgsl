// Shared by all passes of the 3-D view. Bone frame, mm. Colours are linear until `to_screen`.

struct Globals {
    clip_from_bone: mat4x4f,
    eye: vec4f,         // xyz: eye, mm; w: 1 = cast shadows
    ray_x: vec4f,       // xyz: right, scaled to the picture's half width at unit depth; w: shortest step, mm
    ray_y: vec4f,       // xyz: up, scaled likewise; w: band, mm
    ray_z: vec4f,       // xyz: forward, unit
    spacing: vec4f,     // xyz: voxel spacing, mm
    box_lo: vec4f,      // xyz: corner of the indexed box, mm
    box_hi: vec4f,
    index_lo: vec4i,    // xyz: lowest brick of the index
    index_dims: vec4i,  // xyz: bricks along each axis of the index
    tiles: vec4u,       // xyz: tiles along each axis of the atlas
    key_light: vec4f,   // xyz: towards the light, unit
    fill_light: vec4f,
    up: vec4f,
    square: vec4f,      // xy: edge of a square of the picture in clip units
};

@group(0) @binding(0) var<uniform> globals: Globals;

fn to_linear(c: vec3f) -> vec3f { return c * c * (0.76 * c + 0.24 * sqrt(max(c, vec3f(0.0)))); }
fn to_screen(c: vec3f) -> vec3f { return pow(clamp(c, vec3f(0.0), vec3f(1.0)), vec3f(1.0 / 2.2)); }

// Two lights and a sky. `open` in [0, 1] is the share of the sky that the point sees, `key` the
// share of the key light that reaches it.
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
