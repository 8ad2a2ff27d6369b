// Faces between voxels of bone and of air, one instance each, merged or not.

struct Place { origin: vec4f };  // xyz: the chunk's first voxel

@group(2) @binding(0) var<uniform> place: Place;

struct Corner {
    @builtin(position) position: vec4f,
    @location(0) in_bone: vec3f,
    @location(1) @interpolate(flat) direction: u32,
};

// x, y, z: five bits each; direction: three; size less one along the other axes: five each.
@vertex
fn vertex_main(@builtin(vertex_index) i: u32, @location(0) face: u32) -> Corner {
    let voxel = vec3f(vec3u(face, face >> 5u, face >> 10u) & vec3u(31u));
    let direction = (face >> 15u) & 7u;
    let size = vec2f(vec2u(face >> 18u, face >> 23u) & vec2u(31u)) + 1.0;
    let axis = direction >> 1u;
    let ahead = (direction & 1u) == 1u;
    // anticlockwise seen from outside: the other axes change places on the near sides
    let first = f32(select(i >> 1u, i & 1u, ahead)) * size.x;
    let second = f32(select(i & 1u, i >> 1u, ahead)) * size.y;
    var offset = vec3f(0.0);
    offset[axis] = select(0.0, 1.0, ahead);
    offset[(axis + 1u) % 3u] = first;
    offset[(axis + 2u) % 3u] = second;
    let p = (place.origin.xyz + voxel - 0.5 + offset) * globals.spacing.xyz;
    return Corner(globals.clip_from_bone * vec4f(p, 1.0), p, direction);
}

@fragment
fn fragment_main(corner: Corner) -> Sheet {
    let p = corner.in_bone;
    if is_hidden(p) { discard; }
    var n = vec3f(0.0);
    n[corner.direction >> 1u] = select(-1.0, 1.0, (corner.direction & 1u) == 1u);
    let colour = bone_colour(p, n);
    return sheet(p, n, colour.xyz, colour.w, KIND_BONE);
}
