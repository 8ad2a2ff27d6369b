//! What is hidden behind what is drawn already: a pyramid of farthest distances.
//!
//! The chunks that were seen in the last picture are drawn first; their distances from the eye, reduced to
//! the farthest of each square of 16² pixels (`reduce.wgsl`), come back to the CPU, which makes the
//! coarser levels. A box whose nearest point lies beyond the farthest distance over all pixels that it can
//! cover is hidden. The others are drawn then: no picture differs from that without culling.
#![expect(
    clippy::cast_possible_truncation,
    reason = "pixels of a picture; f64 becomes f32 as on the adapter"
)]

use super::method::Context;
use super::target;
use glam::{DVec3, Mat4, Vec2, Vec3};

/// Pixels along the edge of a square of the finest level.
pub(crate) const SQUARE: u32 = 16;
/// Most squares along an edge that a box is compared with.
const MOST_ACROSS: u32 = 4;

/// Farthest distances over squares, finest level first.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Pyramid {
    // pixels of the picture
    size: [u32; 2],
    levels: Vec<Level>,
}

#[derive(Debug, Clone, PartialEq)]
struct Level {
    size: [u32; 2],
    farthest: Vec<f32>,
}

impl Level {
    fn at(&self, x: u32, y: u32) -> f32 {
        self.farthest[(y * self.size[0] + x) as usize]
    }

    /// Half as large along each edge.
    fn coarser(&self) -> Self {
        let size = self.size.map(|n| n.div_ceil(2));
        let mut farthest = Vec::with_capacity((size[0] * size[1]) as usize);
        for y in 0..size[1] {
            for x in 0..size[0] {
                let mut most = 0.0f32;
                for j in 2 * y..(2 * y + 2).min(self.size[1]) {
                    for i in 2 * x..(2 * x + 2).min(self.size[0]) {
                        most = most.max(self.at(i, j));
                    }
                }
                farthest.push(most);
            }
        }
        Self { size, farthest }
    }
}

impl Pyramid {
    /// From the finest level of a picture of `size` pixels; `None` where the numbers do not fit.
    pub(crate) fn new(size: [u32; 2], farthest: Vec<f32>) -> Option<Self> {
        let finest = size.map(|n| n.div_ceil(SQUARE));
        if finest[0] * finest[1] == 0 || farthest.len() != (finest[0] * finest[1]) as usize {
            return None;
        }
        let mut levels = vec![Level {
            size: finest,
            farthest,
        }];
        while let Some(last) = levels.last().filter(|l| l.size[0].max(l.size[1]) > 1) {
            let next = last.coarser();
            levels.push(next);
        }
        Some(Self { size, levels })
    }

    /// Whether all of a box lies behind what is drawn. `eye` and the box in the bone frame, mm.
    pub(crate) fn hides(
        &self,
        clip_from_bone: &Mat4,
        eye: DVec3,
        (lo, hi): (DVec3, DVec3),
    ) -> bool {
        let nearest = (eye.clamp(lo, hi) - eye).length() as f32;
        let (lo, hi) = (lo.as_vec3(), hi.as_vec3());
        let mut from = Vec2::INFINITY;
        let mut to = Vec2::NEG_INFINITY;
        for n in 0..8 {
            let corner = Vec3::select(glam::BVec3::new(n & 1 == 0, n & 2 == 0, n & 4 == 0), lo, hi);
            let clip = *clip_from_bone * corner.extend(1.0);
            if clip.w <= 1e-3 {
                return false;
            }
            let ndc = Vec2::new(clip.x, -clip.y) / clip.w;
            from = from.min(ndc);
            to = to.max(ndc);
        }
        let size = Vec2::new(self.size[0] as f32, self.size[1] as f32);
        let pixel = |ndc: Vec2| ((ndc * 0.5 + 0.5) * size).clamp(Vec2::ZERO, size - 1.0);
        // a pixel more on each side: what is rasterised may be rounded outwards
        let from = (pixel(from) - 1.0).max(Vec2::ZERO).as_uvec2() / SQUARE;
        let to = (pixel(to) + 1.0).min(size - 1.0).as_uvec2() / SQUARE;
        let mut shift = 0;
        let across = |shift: u32| ((to >> shift) - (from >> shift)).max_element() + 1;
        while across(shift) > MOST_ACROSS && (shift as usize) + 1 < self.levels.len() {
            shift += 1;
        }
        let level = &self.levels[shift as usize];
        let (from, to) = (from >> shift, to >> shift);
        (from.y..=to.y).all(|y| (from.x..=to.x).all(|x| level.at(x, y) < nearest))
    }
}

/// The pass that makes the finest level.
#[derive(Debug)]
pub(crate) struct Reduce {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
}

/// WGSL of the pass.
pub(crate) fn text() -> String {
    include_str!("reduce.wgsl").to_owned()
}

impl Reduce {
    /// The pipeline.
    pub(crate) fn new(context: &Context) -> Self {
        let device = &context.device;
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("farthest"),
            entries: &[super::pipeline::texture_entry(
                0,
                wgpu::TextureSampleType::Float { filterable: false },
                wgpu::TextureViewDimension::D2,
            )],
        });
        let module = super::shader(device, "farthest", text());
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("farthest"),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("farthest"),
            layout: Some(&pipeline_layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("vertex_main"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("fragment_main"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[Some(wgpu::TextureFormat::R32Float.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        Self { pipeline, layout }
    }

    /// The pyramid of the distances that were drawn; submits `encoder` and waits.
    pub(crate) fn pyramid(
        &self,
        context: &Context,
        mut encoder: wgpu::CommandEncoder,
        distances: &wgpu::TextureView,
        size: [u32; 2],
    ) -> anyhow::Result<Option<Pyramid>> {
        let device = &context.device;
        let [width, height] = size.map(|n| n.div_ceil(SQUARE));
        let out = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("farthest"),
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::R32Float,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let view = out.create_view(&wgpu::TextureViewDescriptor::default());
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("farthest"),
            layout: &self.layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::TextureView(distances),
            }],
        });
        {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("farthest"),
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: &view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                        store: wgpu::StoreOp::Store,
                    },
                })],
                ..Default::default()
            });
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.draw(0..3, 0..1);
        }
        context.queue.submit([encoder.finish()]);
        let bytes = target::read(device, &context.queue, &out, 4)?;
        Ok(Pyramid::new(size, bytemuck::pod_collect_to_vec(&bytes)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use osteon_sim_core::pose::Pose;

    /// A wall that fills the picture but for one square, everywhere `far` mm from the eye.
    fn wall(size: [u32; 2], far: f32, gap: Option<u32>) -> Pyramid {
        let count = size.map(|n| n.div_ceil(SQUARE)).iter().product::<u32>();
        let mut all = vec![far; count as usize];
        if let Some(gap) = gap {
            all[gap as usize] = 1e30;
        }
        Pyramid::new(size, all).unwrap()
    }

    #[test]
    fn a_box_behind_a_wall_is_hidden_and_one_before_it_or_in_its_gap_is_not() {
        let camera = Camera::at_plan(&Pose::IDENTITY, DVec3::Y);
        let axes = camera.axes();
        let size = [333, 250];
        let clip = camera.clip_from_bone(333.0 / 250.0);
        let cube = |distance: f64| {
            let middle = axes.eye + axes.forward * distance;
            (middle - 8.0, middle + 8.0)
        };
        let whole = wall(size, 300.0, None);
        assert!(whole.hides(&clip, axes.eye, cube(340.0)));
        assert!(!whole.hides(&clip, axes.eye, cube(280.0)));
        // it begins before the wall
        assert!(!whole.hides(&clip, axes.eye, cube(305.0)));
        // around the eye
        assert!(!whole.hides(&clip, axes.eye, (axes.eye - 5.0, axes.eye + 5.0)));
        let columns = size[0].div_ceil(SQUARE);
        let middle = 7 * columns + columns / 2;
        assert!(!wall(size, 300.0, Some(middle)).hides(&clip, axes.eye, cube(340.0)));
        assert!(wall(size, 300.0, Some(0)).hides(&clip, axes.eye, cube(340.0)));
    }

    #[test]
    fn every_level_holds_the_farthest_of_the_finer_one() {
        let size = [16 * 13, 16 * 7];
        let values: Vec<f32> = (0..13 * 7).map(|n| ((n * 37) % 101) as f32).collect();
        let pyramid = Pyramid::new(size, values.clone()).unwrap();
        let last = pyramid.levels.last().unwrap();
        assert_eq!(last.size, [1, 1]);
        let most = values.iter().copied().fold(0.0f32, f32::max);
        assert!((last.farthest[0] - most).abs() < f32::EPSILON);
        assert!(
            Pyramid::new(size, vec![0.0; 3]).is_none() && Pyramid::new([0, 9], vec![]).is_none()
        );
    }
}
