// Voxels as boxes: the rectangle around each one's picture, and a ray against the box in each pixel
// (Majercik, Crassin, Shirley, McGuire: A Ray-Box Intersection Algorithm and Efficient Dynamic Voxel
// Rendering, JCGT 7(3), 2018), chunk by chunk.

struct Place { origin: vec4f };  // xyz: the chunk's first voxel

@group(2) @binding(0) var<uniform> place: Place;

struct Corner {
    @builtin(position) position: vec4f,
    @location(0) ndc: vec2f,
    @location(1) @interpolate(flat) centre: vec3f,
};

@vertex
fn vertex_main(@builtin(vertex_index) i: u32, @location(0) packed: u32) -> Corner {
    let voxel = vec3f(vec3u(packed, packed >> 5u, packed >> 10u) & vec3u(31u));
    let centre = (place.origin.xyz + voxel) * globals.spacing.xyz;
    var lo = vec2f(1e9);
    var hi = vec2f(-1e9);
    var nearest = 1e9;
    for (var n = 0u; n < 8u; n += 1u) {
        let side = vec3f(vec3u(n, n >> 1u, n >> 2u) & vec3u(1u)) - 0.5;
        let clip = globals.clip_from_bone * vec4f(centre + side * globals.spacing.xyz, 1.0);
        nearest = min(nearest, clip.w);
        let ndc = clip.xy / max(clip.w, 1e-6);
        lo = min(lo, ndc);
        hi = max(hi, ndc);
    }
    // around the eye: the whole picture
    if nearest <= 1e-3 { lo = vec2f(-1.0); hi = vec2f(1.0); }
    let ndc = vec2f(select(lo.x, hi.x, (i & 1u) == 1u), select(lo.y, hi.y, (i & 2u) == 2u));
    return Corner(vec4f(ndc, 0.5, 1.0), ndc, centre);
}

@fragment
fn fragment_main(corner: Corner) -> Surface {
    let eye = globals.eye.xyz;
    let direction = ray_through(corner.ndc);
    let near = (corner.centre - sign(direction) * 0.5 * globals.spacing.xyz - eye) / direction;
    let far = (corner.centre + sign(direction) * 0.5 * globals.spacing.xyz - eye) / direction;
    let enter = max(max(near.x, near.y), near.z);
    let leave = min(min(far.x, far.y), far.z);
    let p = eye + direction * enter;
    if enter > leave || enter <= 0.0 || is_hidden(p) { discard; }
    var n = vec3f(0.0, 0.0, -sign(direction.z));
    if near.x >= near.y && near.x >= near.z {
        n = vec3f(-sign(direction.x), 0.0, 0.0);
    } else if near.y >= near.z {
        n = vec3f(0.0, -sign(direction.y), 0.0);
    }
    let colour = bone_colour(p, n);
    return surface(p, n, colour.xyz, colour.w, KIND_BONE);
}
