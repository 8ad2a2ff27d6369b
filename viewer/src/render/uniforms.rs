//! Numbers that every pass reads: camera, lights, and where the bricks are.
#![expect(
    clippy::cast_possible_truncation,
    reason = "lattice and picture edges are bounded far below the target type; f64 becomes f32 for the GPU"
)]

use super::View;
use super::atlas::AtlasLayout;
use crate::camera::Camera;
use glam::{DVec3, Vec3};

/// `Globals` of `common.wgsl`.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct Globals {
    clip_from_bone: [[f32; 4]; 4],
    eye: [f32; 4],
    ray_x: [f32; 4],
    ray_y: [f32; 4],
    ray_z: [f32; 4],
    spacing: [f32; 4],
    box_lo: [f32; 4],
    box_hi: [f32; 4],
    index_lo: [i32; 4],
    index_dims: [i32; 4],
    tiles: [u32; 4],
    key_light: [f32; 4],
    fill_light: [f32; 4],
    up: [f32; 4],
    square: [f32; 4],
    plan_origin: [f32; 4],
    plan_axis: [f32; 4],
    section: [f32; 4],
    window: [f32; 4],
    options: [u32; 4],
}

/// Shortest step of a ray, in voxels: bounds the work of a grazing one.
const SHORTEST_STEP: f64 = 0.2;

impl Globals {
    /// The numbers of one picture; without a bone only the background is drawn.
    pub(crate) fn new(view: &View, atlas: Option<&AtlasLayout>) -> Self {
        let none = AtlasLayout::NONE;
        let layout = atlas.unwrap_or(&none);
        let axes = view.camera.axes();
        let half = Camera::half_extent(view.aspect());
        let spacing = layout.spacing_mm;
        let shortest = SHORTEST_STEP * spacing.min_element();
        // both lights stand to the camera as lamps would, so that no view is dark
        let light = |x: f64, y: f64, z: f64| {
            let v = axes.right * x + axes.up * y - axes.forward * z;
            v.try_normalize().unwrap_or(DVec3::Z)
        };
        let square = |n: u32| 2.0 * f64::from(super::tiles::EDGE) / f64::from(n.max(1));
        Self {
            clip_from_bone: view.camera.clip_from_bone(view.aspect()).to_cols_array_2d(),
            eye: with(axes.eye, if view.shadows { 1.0 } else { 0.0 }),
            ray_x: with(axes.right * half.x, shortest),
            ray_y: with(axes.up * half.y, spacing.length()),
            ray_z: with(axes.forward, 0.0),
            spacing: with(spacing, 0.0),
            box_lo: with(layout.box_lo_mm, 0.0),
            box_hi: with(layout.box_hi_mm, 0.0),
            index_lo: layout.index_lo,
            index_dims: layout.index_dims,
            tiles: layout.tiles,
            key_light: with(light(-0.45, 0.62, 0.80), 0.0),
            fill_light: with(light(0.8, -0.25, 0.5), 0.0),
            up: with(axes.up, 0.0),
            square: with(
                DVec3::new(square(view.size[0]), square(view.size[1]), 0.0),
                0.0,
            ),
            plan_origin: with(view.plan.translation, 0.0),
            plan_axis: with(view.plan.vector(DVec3::Z), 0.0),
            section: view
                .look
                .section
                .map_or([0.0; 4], |s| with(s.normal, s.offset_mm)),
            window: [view.look.window_hu[0], view.look.window_hu[1], 0.0, 0.0],
            options: [
                view.look.colouring as u32,
                u32::from(view.look.section.is_some()),
                u32::from(view.look.ghost),
                0,
            ],
        }
    }
}

fn with(v: DVec3, w: f64) -> [f32; 4] {
    Vec3::extend(v.as_vec3(), w as f32).to_array()
}

/// Layout of a group with one uniform buffer at binding 0.
pub(crate) fn layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("uniform"),
        entries: &[wgpu::BindGroupLayoutEntry {
            binding: 0,
            visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Uniform,
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        }],
    })
}

/// A uniform buffer of `bytes` bytes.
pub(crate) fn buffer(device: &wgpu::Device, label: &str, bytes: usize) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: bytes as u64,
        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

/// The group of [`layout`] for one buffer.
pub(crate) fn group(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    buffer: &wgpu::Buffer,
) -> wgpu::BindGroup {
    device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("uniform"),
        layout,
        entries: &[wgpu::BindGroupEntry {
            binding: 0,
            resource: buffer.as_entire_binding(),
        }],
    })
}
