// The tool: a lathe mesh in steel.

struct Tool {
    clip_from_tool: mat4x4f,
    bone_from_tool: mat4x4f,
    colour: vec4f,  // rgb, screen values; w: gloss
};

@group(1) @binding(0) var<uniform> tool: Tool;

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
fn fragment_main(corner: Corner) -> @location(0) vec4f {
    let n = normalize(corner.normal);
    let to_eye = normalize(globals.eye.xyz - corner.in_bone);
    let facing = abs(dot(n, to_eye));
    let albedo = to_linear(tool.colour.rgb) * (0.75 + 0.25 * facing);
    let lit = shade(albedo, n, to_eye, tool.colour.w, 1.0, 1.0);
    return vec4f(to_screen(lit), 1.0);
}
