// The bone's textures, as every method reads them: a map of 8^3 bricks and atlases of their tiles.

@group(1) @binding(0) var index_map: texture_3d<u32>;
@group(1) @binding(1) var field_atlas: texture_3d<f32>;   // r: solid, g: cut; units of the band, positive inside
@group(1) @binding(2) var tissue_atlas: texture_3d<f32>;  // colour of the tissue times a; a: 1 where there is any
@group(1) @binding(3) var trilinear: sampler;

const EMPTY: u32 = 0x80000000u;  // high bit: no brick here, low bits: bricks to the nearest one
const TILE: f32 = 10.0;          // a brick and one voxel around it
const BONE: vec3f = vec3f(0.890, 0.855, 0.788);  // #e3dac9
const MOST_STEPS: i32 = 256;

struct Sample { value: vec2f, tile: u32, uvw: vec3f };
struct Hit { found: bool, t: f32 };

// Voxel coordinates moved by a half, so that brick k covers [8k, 8k + 8) on each axis.
fn voxel_of(p: vec3f) -> vec3f { return p / globals.spacing.xyz + 0.5; }

fn entry_at(cell: vec3i) -> u32 {
    if any(cell < vec3i(0)) || any(cell >= globals.index_dims.xyz) { return EMPTY | 1u; }
    return textureLoad(index_map, cell, 0).x;
}

fn uvw_in_atlas(tile: u32, in_brick: vec3f) -> vec3f {
    let n = globals.tiles.xyz;
    let at = vec3u(tile % n.x, (tile / n.x) % n.y, tile / (n.x * n.y));
    return (vec3f(at) * TILE + in_brick + 1.0) / (vec3f(n) * TILE);
}

fn sample_at(p: vec3f) -> Sample {
    let v = voxel_of(p);
    let brick = vec3i(floor(v * 0.125));
    let entry = entry_at(brick - globals.index_lo.xyz);
    if (entry & EMPTY) != 0u { return Sample(vec2f(-1.0, 1.0), EMPTY, vec3f(0.0)); }
    let uvw = uvw_in_atlas(entry, v - vec3f(brick) * 8.0);
    return Sample(textureSampleLevel(field_atlas, trilinear, uvw, 0.0).xy, entry, uvw);
}

fn value_at(p: vec3f) -> f32 {
    let s = sample_at(p).value;
    return min(s.x, s.y);
}

// Parameters where a ray enters and leaves a box.
fn span_of_box(origin: vec3f, inverse: vec3f, lo: vec3f, hi: vec3f) -> vec2f {
    let a = (lo - origin) * inverse;
    let b = (hi - origin) * inverse;
    let near = min(a, b);
    let far = max(a, b);
    return vec2f(max(max(near.x, near.y), near.z), min(min(far.x, far.y), far.z));
}

fn march(origin: vec3f, direction: vec3f, from_t: f32, to_t: f32) -> Hit {
    let inverse = 1.0 / direction;
    var t = from_t;
    var outside_t = from_t;
    var outside_value = -1.0;
    for (var i = 0; i < MOST_STEPS; i += 1) {
        if t >= to_t { break; }
        let v = voxel_of(origin + direction * t);
        let brick = vec3i(floor(v * 0.125));
        let entry = entry_at(brick - globals.index_lo.xyz);
        if (entry & EMPTY) != 0u {
            // all bricks nearer than `reach` are empty: leave their box in one step
            let reach = i32(entry & 0xffffu);
            let lo = (vec3f((brick - reach + 1) * 8) - 0.5) * globals.spacing.xyz;
            let hi = (vec3f((brick + reach) * 8) - 0.5) * globals.spacing.xyz;
            t = max(span_of_box(origin, inverse, lo, hi).y, t) + 0.01 * globals.ray_x.w;
            outside_t = t;
            outside_value = -1.0;
            continue;
        }
        let uvw = uvw_in_atlas(entry, v - vec3f(brick) * 8.0);
        let both = textureSampleLevel(field_atlas, trilinear, uvw, 0.0).xy;
        let value = min(both.x, both.y);
        if value > 0.0 {
            return Hit(true, surface_between(origin, direction, vec2f(outside_t, t), vec2f(outside_value, value)));
        }
        outside_t = t;
        outside_value = value;
        // both fields are distances, so their minimum never overstates the way to the surface
        t += max(-value * globals.ray_y.w * 0.95, globals.ray_x.w);
    }
    return Hit(false, to_t);
}

// Root of the field on a span that begins outside and ends inside: two false-position steps.
fn surface_between(origin: vec3f, direction: vec3f, span: vec2f, value: vec2f) -> f32 {
    var a = span.x;
    var b = span.y;
    var fa = value.x;
    var fb = value.y;
    for (var i = 0; i < 2; i += 1) {
        let t = a + (b - a) * clamp(fa / (fa - fb), 0.02, 0.98);
        let f = value_at(origin + direction * t);
        if f > 0.0 { b = t; fb = f; } else { a = t; fa = f; }
    }
    return a + (b - a) * clamp(fa / (fa - fb), 0.0, 1.0);
}

// Outward normal from the field that makes the surface here: x from solid, y from the cut.
fn normal_at(p: vec3f, of_cut: bool, to_eye: vec3f) -> vec3f {
    let h = 0.5 * globals.spacing.xyz;
    let pick = select(vec2f(1.0, 0.0), vec2f(0.0, 1.0), of_cut);
    let s = sample_at(p);
    if s.tile == EMPTY { return to_eye; }
    // the tile holds one voxel more on each side, so half a voxel away needs no other brick
    let d = 0.5 / (vec3f(globals.tiles.xyz) * TILE);
    let gx = dot(field_uvw(s.uvw + vec3f(d.x, 0.0, 0.0)) - field_uvw(s.uvw - vec3f(d.x, 0.0, 0.0)), pick);
    let gy = dot(field_uvw(s.uvw + vec3f(0.0, d.y, 0.0)) - field_uvw(s.uvw - vec3f(0.0, d.y, 0.0)), pick);
    let gz = dot(field_uvw(s.uvw + vec3f(0.0, 0.0, d.z)) - field_uvw(s.uvw - vec3f(0.0, 0.0, d.z)), pick);
    let g = -vec3f(gx, gy, gz) / h;
    let length2 = dot(g, g);
    if length2 < 1e-12 { return to_eye; }
    return g * inverseSqrt(length2);
}

fn field_uvw(uvw: vec3f) -> vec2f { return textureSampleLevel(field_atlas, trilinear, uvw, 0.0).xy; }

// Colour of the tissue just inside a surface point and its presence, screen values.
fn tissue_at(p: vec3f, n: vec3f) -> vec4f {
    let s = sample_at(p - n * 0.6 * globals.spacing.xyz);
    if s.tile == EMPTY { return vec4f(BONE, 0.0); }
    let t = textureSampleLevel(tissue_atlas, trilinear, s.uvw, 0.0);
    return vec4f(select(BONE, t.xyz / max(t.w, 1e-3), t.w > 0.02), t.w);
}

// Depth below the plan's origin: green at it, then yellow and red to 20 mm, a line each millimetre.
fn plan_colour(p: vec3f) -> vec3f {
    let away = p - globals.plan_origin.xyz;
    let height = dot(away, globals.plan_axis.xyz);
    let radius = length(away - globals.plan_axis.xyz * height);
    let deep = clamp(-height / 20.0, 0.0, 1.0);
    var colour = mix(vec3f(0.45, 0.78, 0.55), vec3f(0.95, 0.84, 0.40), clamp(deep * 3.0, 0.0, 1.0));
    colour = mix(colour, vec3f(0.83, 0.27, 0.23), clamp(deep * 1.5 - 0.5, 0.0, 1.0));
    let line = 1.0 - smoothstep(0.04, 0.09, abs(fract(height + 0.5) - 0.5));
    colour *= 1.0 - 0.35 * line;
    return mix(colour, BONE, max(smoothstep(20.0, 24.0, radius), smoothstep(3.0, 6.0, height)));
}

// The bone's colour at a surface point, screen values; w: gloss.
fn bone_colour(p: vec3f, n: vec3f) -> vec4f {
    let both = sample_at(p).value;
    let of_cut = both.y < both.x;
    let tissue = tissue_at(p, n).xyz;
    // outside, only cartilage (the one bluish tissue) differs from bone: what else the labels say
    // there is partial volume
    let cartilage = smoothstep(0.0, 0.12, tissue.b - tissue.r);
    var colour = select(mix(BONE, tissue, 0.85 * cartilage), tissue, of_cut);
    if globals.options.x == COLOUR_TISSUE { colour = tissue; }
    if globals.options.x == COLOUR_PLAN { colour = plan_colour(p); }
    // the rim, where both surfaces meet, is drawn as a fine line
    let rim = 1.0 - smoothstep(0.05, 0.30, abs(both.x - both.y));
    return vec4f(colour * (1.0 - 0.25 * rim), select(0.10, 0.05, of_cut));
}

// The part of a ray that the section plane leaves.
fn visible_part(origin: vec3f, direction: vec3f, span: vec2f) -> vec2f {
    if globals.options.y == 0u { return span; }
    let ahead = dot(direction, globals.section.xyz);
    let t = (globals.section.w - dot(origin, globals.section.xyz)) / select(ahead, 1e-9, abs(ahead) < 1e-9);
    return select(vec2f(max(span.x, t), span.y), vec2f(span.x, min(span.y, t)), ahead > 0.0);
}
