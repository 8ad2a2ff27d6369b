// Edges of chunks' boxes over the picture, for looking at what is culled.

struct Corner { @builtin(position) position: vec4f, @location(0) colour: vec4f };

@vertex
fn vertex_main(@location(0) place: vec3f, @location(1) colour: vec4f) -> Corner {
    return Corner(globals.clip_from_bone * vec4f(place, 1.0), colour);
}

@fragment
fn fragment_main(corner: Corner) -> @location(0) vec4f { return corner.colour; }
