//! Shaders without an adapter.

use super::*;
use wgpu::naga;

fn texts() -> Vec<(&'static str, String)> {
    vec![
        ("iso", iso::text()),
        ("section", section::text()),
        ("mesh", chunked::Mesher::Nets.text()),
        ("cubes", chunked::Mesher::Faces.text()),
        ("splats", chunked::Mesher::Splats.text()),
        ("shade", shade::text()),
        ("tool", tool::text()),
        ("boxes", boxes::text()),
        ("reduce", occlusion::text()),
        ("blit", include_str!("blit.wgsl").to_owned()),
    ]
}

#[test]
fn all_shaders_are_valid() {
    for (name, text) in texts() {
        let module = naga::front::wgsl::parse_str(&text)
            .unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(&text)));
        let flags = naga::valid::ValidationFlags::all();
        let mut validator = naga::valid::Validator::new(flags, naga::valid::Capabilities::empty());
        let checked = validator.validate(&module);
        assert!(checked.is_ok(), "{name}: {:?}", checked.err());
    }
}

#[test]
fn a_broken_shader_is_seen() {
    let text = iso::text().replace("find(direction)", "find(screen)");
    let parsed = naga::front::wgsl::parse_str(&text).map_err(drop);
    let valid = parsed.and_then(|m| {
        let flags = naga::valid::ValidationFlags::all();
        let mut validator = naga::valid::Validator::new(flags, naga::valid::Capabilities::empty());
        validator.validate(&m).map_err(drop).map(drop)
    });
    assert!(valid.is_err());
}

#[test]
fn the_uniforms_have_the_size_that_the_shader_reads() {
    for (text, name, size) in [
        (iso::text(), "Globals", size_of::<Globals>()),
        (tool::text(), "Tool", size_of::<tool::ToolUniform>()),
    ] {
        let module = naga::front::wgsl::parse_str(&text).unwrap();
        let span = module.types.iter().find_map(|(_, t)| match &t.inner {
            naga::TypeInner::Struct { span, .. } if t.name.as_deref() == Some(name) => Some(*span),
            _ => None,
        });
        assert_eq!(span, u32::try_from(size).ok(), "{name}");
    }
}
