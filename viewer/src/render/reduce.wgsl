// The farthest distance of each square of 16 x 16 pixels; without end where a pixel shows nothing.

@group(0) @binding(0) var distances: texture_2d<f32>;

@vertex
fn vertex_main(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32(i32(i & 1u) * 4 - 1), f32(i32(i >> 1u) * 4 - 1));
    return vec4f(corner, 0.0, 1.0);
}

@fragment
fn fragment_main(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let size = vec2i(textureDimensions(distances));
    let first = vec2i(position.xy) * 16;
    let end = min(first + 16, size);
    var farthest = 0.0;
    for (var y = first.y; y < end.y; y += 1) {
        for (var x = first.x; x < end.x; x += 1) {
            let d = textureLoad(distances, vec2i(x, y), 0).x;
            farthest = max(farthest, select(1e30, d, d > 0.0));
        }
        if farthest > 1e29 { break; }
    }
    return vec4f(farthest, 0.0, 0.0, 0.0);
}
