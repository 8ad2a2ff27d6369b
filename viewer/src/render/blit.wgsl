// Copies the 3-D picture into the window. Texels are loaded, not sampled through egui's shader,
// which costs twice as much on a CPU.

struct Copy {
    target_px: vec4f,  // xy: corner, zw: size of the rectangle on the screen, pixels
    options: vec4f,    // x: 1 = the screen encodes sRGB itself
};

@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var<uniform> copy: Copy;

@vertex
fn vertex_main(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32(i32(i & 1u) * 4 - 1), f32(i32(i >> 1u) * 4 - 1));
    return vec4f(corner, 0.0, 1.0);
}

@fragment
fn fragment_main(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let size = vec2f(textureDimensions(picture));
    let at = (position.xy - copy.target_px.xy) / copy.target_px.zw * size;
    var colour: vec3f;
    if all(abs(size - copy.target_px.zw) < vec2f(0.5)) {
        colour = textureLoad(picture, clamp(vec2i(at), vec2i(0), vec2i(size) - 1), 0).rgb;
    } else {
        let corner = floor(at - 0.5);
        let f = at - 0.5 - corner;
        let last = vec2i(size) - 1;
        let lo = clamp(vec2i(corner), vec2i(0), last);
        let hi = clamp(vec2i(corner) + 1, vec2i(0), last);
        let above = mix(textureLoad(picture, lo, 0).rgb, textureLoad(picture, vec2i(hi.x, lo.y), 0).rgb, f.x);
        let below = mix(textureLoad(picture, vec2i(lo.x, hi.y), 0).rgb, textureLoad(picture, hi, 0).rgb, f.x);
        colour = mix(above, below, f.y);
    }
    if copy.options.x > 0.5 { colour = pow(colour, vec3f(2.2)); }
    return vec4f(colour, 1.0);
}
