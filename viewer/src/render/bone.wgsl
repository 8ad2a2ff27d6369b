// The bone: iso-surface of min(solid, cut), marched through a map of 8^3 bricks.

@group(1) @binding(0) var index_map: texture_3d<u32>;
@group(1) @binding(1) var field_atlas: texture_3d<f32>;   // r: solid, g: cut; units of the band, positive inside
@group(1) @binding(2) var tissue_atlas: texture_3d<f32>;  // colour of the tissue times a; a: 1 where there is any
@group(1) @binding(3) var trilinear: sampler;

const EMPTY: u32 = 0x80000000u;  // high bit: no brick here, low bits: bricks to the nearest one
const TILE: f32 = 10.0;          // a brick and one voxel around it
const MOST_STEPS: i32 = 256;

struct Screen { @builtin(position) position: vec4f, @location(0) ndc: vec2f };
struct Pixel { @location(0) colour: vec4f, @builtin(frag_depth) depth: f32 };
struct Sample { value: vec2f, tile: u32, uvw: vec3f };
struct Hit { found: bool, t: f32 };

// One square of the picture per instance (x in the low half, y in the high half), two triangles.
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

fn filled(p: vec3f) -> f32 { return smoothstep(-0.9, 0.6, value_at(p)); }

// Bone colour outside; the layers' own colours on a cut.
fn albedo_at(p: vec3f, n: vec3f, of_cut: bool) -> vec3f {
    let inside = p - n * 0.6 * globals.spacing.xyz;
    let s = sample_at(inside);
    let bone = vec3f(0.890, 0.855, 0.788);
    if s.tile == EMPTY { return to_linear(bone); }
    let t = textureSampleLevel(tissue_atlas, trilinear, s.uvw, 0.0);
    let tissue = select(bone, t.xyz / max(t.w, 1e-3), t.w > 0.02);
    // outside, only cartilage (the one bluish tissue) differs from bone: what else the labels say
    // there is partial volume
    let cartilage = smoothstep(0.0, 0.12, tissue.b - tissue.r);
    let colour = select(mix(bone, tissue, 0.85 * cartilage), tissue, of_cut);
    return to_linear(colour);
}

fn background(ndc: vec2f) -> vec4f {
    let c = mix(vec3f(0.075, 0.085, 0.10), vec3f(0.19, 0.215, 0.25), 0.5 + 0.5 * ndc.y);
    return vec4f(c, 1.0);
}

@fragment
fn fragment_main(screen: Screen) -> Pixel {
    let nothing = Pixel(background(screen.ndc), 1.0);
    let eye = globals.eye.xyz;
    var direction = globals.ray_z.xyz + globals.ray_x.xyz * screen.ndc.x + globals.ray_y.xyz * screen.ndc.y;
    direction = normalize(direction);
    direction = select(direction, vec3f(1e-6), abs(direction) < vec3f(1e-6));
    let span = span_of_box(eye, 1.0 / direction, globals.box_lo.xyz, globals.box_hi.xyz);
    if span.y <= max(span.x, 0.0) { return nothing; }
    let hit = march(eye, direction, max(span.x, 0.0) + 1e-3, span.y);
    if !hit.found { return nothing; }

    let p = eye + direction * hit.t;
    let both = sample_at(p).value;
    let of_cut = both.y < both.x;
    let n = normal_at(p, of_cut, -direction);
    var albedo = albedo_at(p, n, of_cut);
    // the rim, where both surfaces meet, is drawn as a fine line
    let rim = 1.0 - smoothstep(0.05, 0.30, abs(both.x - both.y));
    albedo *= 1.0 - 0.45 * rim;
    var key = 1.0;
    if globals.eye.w > 0.5 && dot(n, globals.key_light.xyz) > 0.0 {
        key = key_light_at(p + n * 0.6 * globals.ray_y.w);
    }
    let colour = shade(albedo, n, -direction, select(0.10, 0.05, of_cut), openness(p, n), key);
    let clip = globals.clip_from_bone * vec4f(p, 1.0);
    return Pixel(vec4f(to_screen(colour), 1.0), clamp(clip.z / clip.w, 0.0, 1.0));
}

fn key_light_at(p: vec3f) -> f32 {
    let direction = select(globals.key_light.xyz, vec3f(1e-6), abs(globals.key_light.xyz) < vec3f(1e-6));
    let span = span_of_box(p, 1.0 / direction, globals.box_lo.xyz, globals.box_hi.xyz);
    return select(1.0, 0.25, march(p, direction, 0.0, span.y).found);
}
