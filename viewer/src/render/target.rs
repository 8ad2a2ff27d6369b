//! The picture: an own colour and depth texture.

use anyhow::anyhow;
use std::sync::Arc;

/// Format of the picture; values are screen values (gamma-encoded), as egui's are.
pub(crate) const COLOUR: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
/// Format of the depth buffer.
pub(crate) const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// Bytes a row of a read-back buffer is aligned to.
const ROW_ALIGNMENT: u32 = wgpu::COPY_BYTES_PER_ROW_ALIGNMENT;

/// Colour and depth textures of one size.
#[derive(Debug)]
pub(crate) struct Target {
    colour: wgpu::Texture,
    colour_view: Arc<wgpu::TextureView>,
    depth_view: wgpu::TextureView,
}

impl Target {
    /// A picture of `size` pixels, each edge in 1..= the device's limit.
    pub(crate) fn new(device: &wgpu::Device, size: [u32; 2]) -> Self {
        let most = device.limits().max_texture_dimension_2d;
        let [width, height] = size.map(|n| n.clamp(1, most));
        let texture = |label, format, usage| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d {
                    width,
                    height,
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
        };
        let attached = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let read = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_SRC;
        let colour = texture("picture", COLOUR, attached | read);
        let depth = texture("depth", DEPTH, attached);
        Self {
            colour_view: Arc::new(colour.create_view(&wgpu::TextureViewDescriptor::default())),
            depth_view: depth.create_view(&wgpu::TextureViewDescriptor::default()),
            colour,
        }
    }

    /// Width and height, pixels.
    pub(crate) fn size(&self) -> [u32; 2] {
        [self.colour.width(), self.colour.height()]
    }

    /// The colours.
    pub(crate) fn picture(&self) -> Arc<wgpu::TextureView> {
        Arc::clone(&self.colour_view)
    }

    /// Begins to draw: dark, and everything far away.
    pub(crate) fn begin<'e>(&self, encoder: &'e mut wgpu::CommandEncoder) -> wgpu::RenderPass<'e> {
        let dark = wgpu::Color {
            r: 0.12,
            g: 0.14,
            b: 0.165,
            a: 1.0,
        };
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("3-D view"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.colour_view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(dark),
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.depth_view,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(1.0),
                    store: wgpu::StoreOp::Discard,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        })
    }

    /// The picture as RGBA bytes, row by row from the top. Waits for the adapter.
    pub(crate) fn read(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
    ) -> anyhow::Result<Vec<u8>> {
        let [width, height] = self.size();
        let row = (4 * width).next_multiple_of(ROW_ALIGNMENT);
        let buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("read-back"),
            size: u64::from(row) * u64::from(height),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_texture_to_buffer(
            self.colour.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(row),
                    rows_per_image: None,
                },
            },
            self.colour.size(),
        );
        queue.submit([encoder.finish()]);
        let (sender, receiver) = std::sync::mpsc::sync_channel(1);
        // the receiver outlives the callback: it runs inside the poll below
        buffer.map_async(wgpu::MapMode::Read, .., move |result| {
            drop(sender.send(result));
        });
        device
            .poll(wgpu::PollType::wait_indefinitely())
            .map_err(|e| {
                anyhow!("the graphics adapter stopped answering ({e}); restart the viewer")
            })?;
        receiver
            .recv()?
            .map_err(|e| anyhow!("the picture cannot be read back ({e}); restart the viewer"))?;
        let bytes = buffer
            .get_mapped_range(..)
            .map_err(|e| anyhow!("the picture cannot be read back ({e}); restart the viewer"))?;
        let rows = bytes.chunks_exact(row as usize);
        Ok(rows
            .flat_map(|r| r[..4 * width as usize].iter().copied())
            .collect())
    }
}
