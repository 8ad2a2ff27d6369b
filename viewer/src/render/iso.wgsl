// The bone: iso-surface of min(solid, cut), marched through the map of bricks.

struct Screen { @builtin(position) position: vec4f, @location(0) ndc: vec2f };

// One square of the picture per instance (x in the low half, y in the high half), two triangles.
@vertex
fn vertex_main(@builtin(vertex_index) i: u32, @location(0) square: u32) -> Screen {
    let corner = array(vec2u(0, 0), vec2u(0, 1), vec2u(1, 0), vec2u(1, 0), vec2u(0, 1), vec2u(1, 1))[i];
    let at = vec2f(vec2u(square & 0xffffu, square >> 16u) + corner) * globals.square.xy;
    let ndc = vec2f(at.x - 1.0, 1.0 - at.y);
    return Screen(vec4f(ndc, 1.0, 1.0), ndc);
}

struct Found { hit: bool, of_section: bool, p: vec3f };

fn find(direction: vec3f) -> Found {
    let eye = globals.eye.xyz;
    let box = span_of_box(eye, 1.0 / direction, globals.box_lo.xyz, globals.box_hi.xyz);
    let span = visible_part(eye, direction, vec2f(max(box.x, 0.0) + 1e-3, box.y));
    if span.y <= span.x { return Found(false, false, eye); }
    let hit = march(eye, direction, span.x, span.y);
    let on_plane = span.x > max(box.x, 0.0) + 2e-3 && hit.t - span.x < 1e-4;
    return Found(hit.found, hit.found && on_plane, eye + direction * hit.t);
}

fn nothing() -> Surface { return Surface(vec4f(0.0), vec4f(0.0), vec4f(0.0), 1.0); }

fn outward_at(p: vec3f, direction: vec3f) -> vec3f {
    let both = sample_at(p).value;
    return normal_at(p, both.y < both.x, -direction);
}

@fragment
fn fragment_main(screen: Screen) -> Surface {
    let direction = ray_through(screen.ndc);
    let found = find(direction);
    if !found.hit { return nothing(); }
    if found.of_section {
        let n = globals.section.xyz;
        return surface(found.p, n, tissue_at(found.p, n).xyz, 0.0, KIND_BONE);
    }
    let n = outward_at(found.p, direction);
    let colour = bone_colour(found.p, n);
    return surface(found.p, n, colour.xyz, colour.w, KIND_BONE);
}
