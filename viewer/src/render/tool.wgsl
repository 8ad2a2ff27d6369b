// The tool: a lathe mesh in steel.

struct Tool {
    clip_from_tool: mat4x4f,
    bone_from_tool: mat4x4f,
    colour: vec4f,  // rgb, screen values; w: gloss
};

@group(2) @binding(0) var<uniform> tool: Tool;

struct Corner {
    @builtin(position) position: vec4f,
    @location(0) in_bone: vec3f,
    @location(1) normal: vec3f,
};

@vertex
fn vertex_main(@location(0) position: vec3f, @location(1) normal: vec3f) -> Corner {
    let in_bone = (tool.bone_from_tool * vec4f(position, 1.0)).xyz;
    let turned = (tool.bone_from_tool * vec4f(normal, 0.0)).xyz;
    return Corner(tool.clip_from_tool * vec4f(position, 1.0), in_bone, turned);
}

@fragment
fn fragment_main(corner: Corner) -> Sheet {
    return sheet(corner.in_bone, normalize(corner.normal), tool.colour.rgb, tool.colour.w, KIND_TOOL);
}

// The part of the tool that bone hides, as a ghost over the picture.
@fragment
fn ghost_fragment(corner: Corner) -> @location(0) vec4f {
    let to_eye = normalize(globals.eye.xyz - corner.in_bone);
    let edge = 1.0 - abs(dot(normalize(corner.normal), to_eye));
    return vec4f(0.45, 0.80, 1.0, 0.18 + 0.55 * edge * edge);
}
