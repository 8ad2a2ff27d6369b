// CT densities on the section plane; behind it the bone. Follows `iso.wgsl`.

@group(2) @binding(0) var density_atlas: texture_3d<f32>;  // HU

fn grey_of(hu: f32) -> f32 {
    return clamp((hu - globals.window.x) / max(globals.window.y, 1.0) + 0.5, 0.0, 1.0);
}

@fragment
fn section_fragment(screen: Screen) -> Surface {
    let direction = ray_through(screen.ndc);
    let found = find(direction);
    if !found.hit { return nothing(); }
    if found.of_section {
        let s = sample_at(found.p);
        let hu = textureSampleLevel(density_atlas, trilinear, s.uvw, 0.0).x;
        let grey = vec3f(grey_of(hu));
        return surface(found.p, globals.section.xyz, grey, 0.0, KIND_FLAT);
    }
    let n = outward_at(found.p, direction);
    let colour = bone_colour(found.p, n);
    return surface(found.p, n, colour.xyz, colour.w, KIND_BONE);
}
