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
    square: vec4f,      // xy: edge of a square of the picture in clip units; z: radians of a pixel
    plan_origin: vec4f, // xyz: the plan's origin, mm
    plan_axis: vec4f,   // xyz: its z, unit, out of the joint face
    section: vec4f,     // xyz: unit normal of the section plane, w: its place along it, mm; bone beyond is hidden
    window: vec4f,      // x: centre, y: width of the grey scale, HU
    options: vec4u,     // x: colouring, y: 1 = there is a section plane, z: 1 = the tool shows through bone
};

@group(0) @binding(0) var<uniform> globals: Globals;

const COLOUR_BONE: u32 = 0u;    // bone outside, the layers on a cut
const COLOUR_TISSUE: u32 = 1u;  // the layers everywhere
const COLOUR_PLAN: u32 = 2u;    // depth below the plan's origin

// What a point of the surface buffers is, in `normal.w`.
const KIND_BONE: f32 = 1.0;
const KIND_TOOL: f32 = 2.0;
const KIND_FLAT: f32 = 3.0;     // shown as it is, without light

// One pixel of the surface buffers. `at.x`: distance from the eye, mm; 0 where there is nothing.
struct Surface {
    @location(0) colour: vec4f,   // rgb: screen values, w: gloss
    @location(1) normal: vec4f,   // xyz: outward, unit; w: kind
    @location(2) at: vec4f,
    @builtin(frag_depth) depth: f32,
};

// The same where the rasterised depth is kept.
struct Sheet {
    @location(0) colour: vec4f,
    @location(1) normal: vec4f,
    @location(2) at: vec4f,
};

fn to_linear(c: vec3f) -> vec3f { return c * c * (0.76 * c + 0.24 * sqrt(max(c, vec3f(0.0)))); }
fn to_screen(c: vec3f) -> vec3f { return pow(clamp(c, vec3f(0.0), vec3f(1.0)), vec3f(1.0 / 2.2)); }

// Direction of the ray through a place of the picture; no component is zero.
fn ray_through(ndc: vec2f) -> vec3f {
    let d = normalize(globals.ray_z.xyz + globals.ray_x.xyz * ndc.x + globals.ray_y.xyz * ndc.y);
    return select(d, vec3f(1e-6), abs(d) < vec3f(1e-6));
}

fn depth_of(p: vec3f) -> f32 {
    let clip = globals.clip_from_bone * vec4f(p, 1.0);
    return clamp(clip.z / clip.w, 0.0, 1.0);
}

// Whether the section plane hides a point.
fn is_hidden(p: vec3f) -> bool {
    return globals.options.y == 1u && dot(p, globals.section.xyz) > globals.section.w;
}

fn surface(p: vec3f, n: vec3f, colour: vec3f, gloss: f32, kind: f32) -> Surface {
    let away = distance(p, globals.eye.xyz);
    return Surface(vec4f(colour, gloss), vec4f(n, kind), vec4f(away, 0.0, 0.0, 0.0), depth_of(p));
}

fn sheet(p: vec3f, n: vec3f, colour: vec3f, gloss: f32, kind: f32) -> Sheet {
    return Sheet(vec4f(colour, gloss), vec4f(n, kind), vec4f(distance(p, globals.eye.xyz), 0.0, 0.0, 0.0));
}
