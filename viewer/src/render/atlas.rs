//! Textures of the bone: an index over bricks and two atlases of 10³ tiles.
//!
//! ```text
//! index (R32Uint)   cell -> slot, or how far the next slot is
//! field (Rg16Float) slot -> solid and cut distance, kept apart so that each is interpolated alone
//! tissue (Rgba8)    slot -> colour of the tissue
//! ```
//! A changed brick is one write of 4 kB per tile that shows it; nothing is rebuilt.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    reason = "lattice and picture edges are bounded far below the target type; f64 becomes f32 for the GPU"
)]

use crate::bricks::{BrickMap, TILE, TILE_TEXELS};
use crate::mirror::Model;
use glam::DVec3;
use osteon_sim_core::grid::BRICK;

/// Where the bricks are, for the shader.
#[derive(Debug, Clone)]
pub(crate) struct AtlasLayout {
    /// Voxel spacing, mm.
    pub(crate) spacing_mm: DVec3,
    /// Corners of the indexed box, bone frame, mm.
    pub(crate) box_lo_mm: DVec3,
    /// The other corner.
    pub(crate) box_hi_mm: DVec3,
    /// Lowest brick of the index.
    pub(crate) index_lo: [i32; 4],
    /// Cells of the index along each axis.
    pub(crate) index_dims: [i32; 4],
    /// Tiles of the atlases along each axis.
    pub(crate) tiles: [u32; 4],
    /// Middles of all bricks, bone frame, mm.
    pub(crate) centres_mm: Vec<DVec3>,
    /// Half the diagonal of a brick, mm.
    pub(crate) brick_radius_mm: f64,
}

impl AtlasLayout {
    /// No bone.
    pub(crate) const NONE: Self = Self {
        spacing_mm: DVec3::ONE,
        box_lo_mm: DVec3::ZERO,
        box_hi_mm: DVec3::ZERO,
        index_lo: [0; 4],
        index_dims: [1; 4],
        tiles: [1; 4],
        centres_mm: Vec::new(),
        brick_radius_mm: 0.0,
    };
}

/// The textures of one bone.
#[derive(Debug)]
pub(crate) struct Atlas {
    field: wgpu::Texture,
    tissue: wgpu::Texture,
    group: wgpu::BindGroup,
    layout: AtlasLayout,
    // slots whose tissue is on the adapter: it never changes
    has_tissue: Vec<bool>,
    field_tile: Vec<[u16; 2]>,
    tissue_tile: Vec<[u8; 4]>,
}

impl Atlas {
    /// Room for all slots of a model, and its index.
    pub(crate) fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        model: &Model,
        group_layout: &wgpu::BindGroupLayout,
    ) -> anyhow::Result<Self> {
        let map = &model.map;
        let tiles = tiles_for(map.slots());
        let most = device.limits().max_texture_dimension_3d;
        let longest = tiles
            .map(|n| n * TILE as u32)
            .into_iter()
            .chain(map.dims().map(|n| n as u32))
            .max();
        if longest.is_some_and(|n| n > most) {
            anyhow::bail!(
                "the bone's textures exceed the adapter's {most} texels along one edge; start the session with a larger --voxel-mm"
            );
        }
        let size = tiles.map(|n| n * TILE as u32);
        let field = texture(device, "field", size, wgpu::TextureFormat::Rg16Float);
        let tissue = texture(device, "tissue", size, wgpu::TextureFormat::Rgba8Unorm);
        let index = texture(
            device,
            "index",
            map.dims().map(|n| n as u32),
            wgpu::TextureFormat::R32Uint,
        );
        let cells = bytemuck::cast_slice(map.index());
        write(queue, &index, [0; 3], map.dims().map(|n| n as u32), cells);
        Ok(Self {
            group: bind(device, group_layout, [&index, &field, &tissue]),
            layout: layout_of(model, tiles),
            has_tissue: vec![false; map.slots()],
            field_tile: vec![[0; 2]; TILE_TEXELS],
            tissue_tile: vec![[0; 4]; TILE_TEXELS],
            field,
            tissue,
        })
    }

    /// Where the bricks are.
    pub(crate) fn layout(&self) -> &AtlasLayout {
        &self.layout
    }

    /// The textures for the bone pass.
    pub(crate) fn group(&self) -> &wgpu::BindGroup {
        &self.group
    }

    /// Uploads at most `most` dirty tiles, oldest first, and returns how many were.
    pub(crate) fn upload(&mut self, queue: &wgpu::Queue, model: &mut Model, most: usize) -> usize {
        let mut count = 0;
        while count < most {
            let Some(slot) = model.dirty.pop() else {
                break;
            };
            // a slot of another model's map would be out of range: it is not ours to draw
            if slot < self.has_tissue.len() {
                self.upload_slot(queue, model, slot);
            }
            count += 1;
        }
        count
    }

    fn upload_slot(&mut self, queue: &wgpu::Queue, model: &Model, slot: usize) {
        let [nx, ny, _, _] = self.layout.tiles;
        let s = slot as u32;
        let origin = [s % nx, s / nx % ny, s / (nx * ny)].map(|n| n * TILE as u32);
        let size = [TILE as u32; 3];
        model
            .map
            .gather_field(&model.bone, &model.cut, slot, &mut self.field_tile);
        write(
            queue,
            &self.field,
            origin,
            size,
            bytemuck::cast_slice(&self.field_tile),
        );
        if !core::mem::replace(&mut self.has_tissue[slot], true) {
            model
                .map
                .gather_tissue(&model.bone, slot, &mut self.tissue_tile);
            write(
                queue,
                &self.tissue,
                origin,
                size,
                bytemuck::cast_slice(&self.tissue_tile),
            );
        }
    }
}

/// Tiles along each axis for `slots` slots: as near to a cube as can be.
fn tiles_for(slots: usize) -> [u32; 3] {
    let mut n = 1usize;
    while n * n * n < slots {
        n += 1;
    }
    let deep = slots.div_ceil(n * n).max(1);
    [n as u32, n as u32, deep as u32]
}

fn layout_of(model: &Model, tiles: [u32; 3]) -> AtlasLayout {
    let map: &BrickMap = &model.map;
    let spacing = model.bone.grid().spacing_mm;
    let corner = |brick: [usize; 3]| {
        let v = brick.map(|n| (n * BRICK) as f64 - 0.5);
        DVec3::from_array(v) * spacing
    };
    let (lo, dims) = (map.lo(), map.dims());
    AtlasLayout {
        spacing_mm: spacing,
        box_lo_mm: corner(lo),
        box_hi_mm: corner(core::array::from_fn(|a| lo[a] + dims[a])),
        // at most 512 bricks along an axis
        index_lo: extend(lo.map(|n| n as i32)),
        index_dims: extend(dims.map(|n| n as i32)),
        tiles: [tiles[0], tiles[1], tiles[2], 0],
        centres_mm: map
            .coords(&model.bone)
            .map(|brick| corner(brick) + 0.5 * BRICK as f64 * spacing)
            .collect(),
        brick_radius_mm: 0.5 * BRICK as f64 * spacing.length(),
    }
}

fn extend([x, y, z]: [i32; 3]) -> [i32; 4] {
    [x, y, z, 0]
}

fn texture(
    device: &wgpu::Device,
    label: &str,
    size: [u32; 3],
    format: wgpu::TextureFormat,
) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: extent(size),
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D3,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    })
}

fn extent([width, height, depth_or_array_layers]: [u32; 3]) -> wgpu::Extent3d {
    wgpu::Extent3d {
        width,
        height,
        depth_or_array_layers,
    }
}

/// Writes a box of four-byte texels.
fn write(
    queue: &wgpu::Queue,
    texture: &wgpu::Texture,
    origin: [u32; 3],
    size: [u32; 3],
    bytes: &[u8],
) {
    let [x, y, z] = origin;
    queue.write_texture(
        wgpu::TexelCopyTextureInfo {
            origin: wgpu::Origin3d { x, y, z },
            ..texture.as_image_copy()
        },
        bytes,
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(4 * size[0]),
            rows_per_image: Some(size[1]),
        },
        extent(size),
    );
}

fn bind(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    textures: [&wgpu::Texture; 3],
) -> wgpu::BindGroup {
    let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
        label: Some("trilinear"),
        mag_filter: wgpu::FilterMode::Linear,
        min_filter: wgpu::FilterMode::Linear,
        ..Default::default()
    });
    let views = textures.map(|t| t.create_view(&wgpu::TextureViewDescriptor::default()));
    let [index, field, tissue] = views.each_ref().map(wgpu::BindingResource::TextureView);
    let sampler = wgpu::BindingResource::Sampler(&sampler);
    let resources = [index, field, tissue, sampler];
    let entries: Vec<_> = (0u32..)
        .zip(resources)
        .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
        .collect();
    device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("bone"),
        layout,
        entries: &entries,
    })
}
