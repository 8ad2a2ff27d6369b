//! The picture and the buffers under it.
//!
//! A frame has two passes: the methods and the tool fill the *surface buffers* (colour, normal,
//! distance from the eye, depth), and light turns them into the picture. The place of a point is the
//! eye plus its ray times the distance, which costs a quarter of a buffer of places.

use anyhow::anyhow;
use std::sync::Arc;

/// Format of the picture; values are screen values (gamma-encoded), as egui's are.
pub(crate) const COLOUR: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
/// Format of the depth buffer.
pub(crate) const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// Formats of the surface buffers: colour and gloss; normal and kind; distance from the eye, mm.
pub(crate) const SURFACES: [wgpu::TextureFormat; 3] = [
    wgpu::TextureFormat::Rgba8Unorm,
    wgpu::TextureFormat::Rgba16Float,
    wgpu::TextureFormat::R32Float,
];

/// Bytes of their texels.
const SURFACE_BYTES: [u32; 3] = [4, 8, 4];

/// Bytes a row of a read-back buffer is aligned to.
const ROW_ALIGNMENT: u32 = wgpu::COPY_BYTES_PER_ROW_ALIGNMENT;

/// Textures of one size.
#[derive(Debug)]
pub(crate) struct Target {
    colour: wgpu::Texture,
    colour_view: Arc<wgpu::TextureView>,
    surfaces: [wgpu::Texture; 3],
    surface_views: [wgpu::TextureView; 3],
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
        let surfaces = SURFACES.map(|format| texture("surfaces", format, attached | read));
        let view = |t: &wgpu::Texture| t.create_view(&wgpu::TextureViewDescriptor::default());
        Self {
            colour_view: Arc::new(view(&colour)),
            depth_view: view(&depth),
            surface_views: surfaces.each_ref().map(view),
            surfaces,
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

    /// The surface buffers in the order of [`SURFACES`].
    pub(crate) fn surface_views(&self) -> &[wgpu::TextureView; 3] {
        &self.surface_views
    }

    /// Begins to fill the surface buffers, `anew` with nothing anywhere, else on what they hold.
    pub(crate) fn begin_surfaces<'e>(
        &self,
        encoder: &'e mut wgpu::CommandEncoder,
        anew: bool,
    ) -> wgpu::RenderPass<'e> {
        let colour = if anew {
            wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT)
        } else {
            wgpu::LoadOp::Load
        };
        let attachments = self.surface_views.each_ref().map(|view| {
            Some(wgpu::RenderPassColorAttachment {
                view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: colour,
                    store: wgpu::StoreOp::Store,
                },
            })
        });
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("surfaces"),
            color_attachments: &attachments,
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.depth_view,
                depth_ops: Some(wgpu::Operations {
                    load: if anew {
                        wgpu::LoadOp::Clear(1.0)
                    } else {
                        wgpu::LoadOp::Load
                    },
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        })
    }

    /// Begins the picture: dark. The depth can be read, not written.
    pub(crate) fn begin_picture<'e>(
        &self,
        encoder: &'e mut wgpu::CommandEncoder,
    ) -> wgpu::RenderPass<'e> {
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
                depth_ops: None,
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
        read(device, queue, &self.colour, 4)
    }

    /// Bytes of all textures, the depth included.
    pub(crate) fn bytes(&self) -> u64 {
        let texels = |t: &wgpu::Texture| u64::from(t.width()) * u64::from(t.height());
        let surfaces = self.surfaces.iter().zip(SURFACE_BYTES);
        let beside = surfaces.map(|(t, bytes)| texels(t) * u64::from(bytes));
        8 * texels(&self.colour) + beside.sum::<u64>()
    }

    /// A surface buffer as bytes, row by row from the top. Waits for the adapter.
    pub(crate) fn read_surface(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        which: usize,
    ) -> anyhow::Result<Vec<u8>> {
        read(device, queue, &self.surfaces[which], SURFACE_BYTES[which])
    }
}

/// The bytes of a texture with texels of `texel` bytes.
pub(crate) fn read(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    texture: &wgpu::Texture,
    texel: u32,
) -> anyhow::Result<Vec<u8>> {
    let [width, height] = [texture.width(), texture.height()];
    let row = (texel * width).next_multiple_of(ROW_ALIGNMENT);
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("read-back"),
        size: u64::from(row) * u64::from(height),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo {
            buffer: &buffer,
            layout: wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(row),
                rows_per_image: None,
            },
        },
        texture.size(),
    );
    queue.submit([encoder.finish()]);
    let (sender, receiver) = std::sync::mpsc::sync_channel(1);
    // the receiver outlives the callback: it runs inside the poll below
    buffer.map_async(wgpu::MapMode::Read, .., move |result| {
        drop(sender.send(result));
    });
    device
        .poll(wgpu::PollType::wait_indefinitely())
        .map_err(|e| anyhow!("the graphics adapter stopped answering ({e}); restart the viewer"))?;
    receiver
        .recv()?
        .map_err(|e| anyhow!("the picture cannot be read back ({e}); restart the viewer"))?;
    let bytes = buffer
        .get_mapped_range(..)
        .map_err(|e| anyhow!("the picture cannot be read back ({e}); restart the viewer"))?;
    let rows = bytes.chunks_exact(row as usize);
    Ok(rows
        .flat_map(|r| r[..(texel * width) as usize].iter().copied())
        .collect())
}
