// Surface nets of one chunk. Normals come from the fields, pixel by pixel, as the iso-surface's do.

struct Place { origin: vec4f };  // xyz: the chunk's first voxel

@group(2) @binding(0) var<uniform> place: Place;

struct Corner { @builtin(position) position: vec4f, @location(0) in_bone: vec3f };

// `at`: 1024ths of a voxel from the one before the chunk's first.
@vertex
fn vertex_main(@location(0) at: vec4u) -> Corner {
    let p = (place.origin.xyz + vec3f(at.xyz) / 1024.0 - 1.0) * globals.spacing.xyz;
    return Corner(globals.clip_from_bone * vec4f(p, 1.0), p);
}

@fragment
fn fragment_main(corner: Corner) -> Sheet {
    let p = corner.in_bone;
    if is_hidden(p) { discard; }
    let both = sample_at(p).value;
    let n = normal_at(p, both.y < both.x, normalize(globals.eye.xyz - p));
    let colour = bone_colour(p, n);
    return sheet(p, n, colour.xyz, colour.w, KIND_BONE);
}
