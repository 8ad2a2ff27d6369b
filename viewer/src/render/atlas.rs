//! Textures of the bone: an index over bricks and two atlases of 10³ tiles.
//!
//! ```text
//! index (R32Uint)   cell -> slot, or how far the next slot is
//! field (Rg16Float) slot -> solid and cut distance, kept apart so that each is interpolated alone
//! tissue (Rgba8)    slot -> colour of the tissue
//! density (R16Float) slot -> CT number, for the section alone
//! ```
//! A changed brick is one write of 4 kB per tile that shows it; nothing is rebuilt.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    reason = "lattice and picture edges are bounded far below the target type; f64 becomes f32 for the GPU"
)]

use super::pipeline::texture_entry;
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
    bytes: u64,
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
        let size = tiles.map(|n| n * TILE as u32);
        check(device, size.into_iter().chain(map.dims().map(|n| n as u32)))?;
        let field = texture(device, "field", size, wgpu::TextureFormat::Rg16Float);
        let tissue = texture(device, "tissue", size, wgpu::TextureFormat::Rgba8Unorm);
        let index = texture(
            device,
            "index",
            map.dims().map(|n| n as u32),
            wgpu::TextureFormat::R32Uint,
        );
        let cells = bytemuck::cast_slice(map.index());
        write(
            queue,
            &index,
            [0; 3],
            map.dims().map(|n| n as u32),
            cells,
            4,
        );
        let bytes = cells.len() as u64 + 8 * texels(size);
        Ok(Self {
            bytes,
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

    /// Bytes of all textures.
    pub(crate) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Uploads a slot's tile.
    pub(crate) fn upload(&mut self, queue: &wgpu::Queue, model: &Model, slot: usize) {
        // a slot of another model's map would be out of range: it is not ours to draw
        if slot >= self.has_tissue.len() {
            return;
        }
        let [nx, ny, _, _] = self.layout.tiles;
        let origin = origin_of(slot, [nx, ny]);
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
            4,
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
                4,
            );
        }
    }
}

/// CT numbers of all bricks, for the section.
#[derive(Debug)]
pub(crate) struct Density {
    texture: wgpu::Texture,
    group: wgpu::BindGroup,
    layout: wgpu::BindGroupLayout,
    tiles: [u32; 3],
    has: Vec<bool>,
    tile: Vec<u16>,
}

impl Density {
    /// Room for all slots of a model.
    pub(crate) fn new(device: &wgpu::Device, model: &Model) -> anyhow::Result<Self> {
        let tiles = tiles_for(model.map.slots());
        let size = tiles.map(|n| n * TILE as u32);
        check(device, size)?;
        let texture = texture(device, "density", size, wgpu::TextureFormat::R16Float);
        let filtered = wgpu::TextureSampleType::Float { filterable: true };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("density"),
            entries: &[texture_entry(0, filtered, wgpu::TextureViewDimension::D3)],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("density"),
            layout: &layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::TextureView(&view),
            }],
        });
        Ok(Self {
            texture,
            group,
            layout,
            tiles,
            has: vec![false; model.map.slots()],
            tile: vec![0; TILE_TEXELS],
        })
    }

    /// Uploads a slot's tile, the first time only: densities never change.
    pub(crate) fn upload(&mut self, queue: &wgpu::Queue, model: &Model, slot: usize) {
        if self.has.get(slot) != Some(&false) {
            return;
        }
        self.has[slot] = true;
        model.map.gather_density(&model.bone, slot, &mut self.tile);
        let origin = origin_of(slot, [self.tiles[0], self.tiles[1]]);
        let bytes = bytemuck::cast_slice(&self.tile);
        write(queue, &self.texture, origin, [TILE as u32; 3], bytes, 2);
    }

    /// The group for the section's pipeline.
    pub(crate) fn group(&self) -> &wgpu::BindGroup {
        &self.group
    }

    /// Its layout.
    pub(crate) fn layout(&self) -> &wgpu::BindGroupLayout {
        &self.layout
    }

    /// Bytes of the texture.
    pub(crate) fn bytes(&self) -> u64 {
        2 * texels(self.tiles.map(|n| n * TILE as u32))
    }
}

fn texels(size: [u32; 3]) -> u64 {
    size.into_iter().map(u64::from).product()
}

/// Refuses textures beyond the adapter's edge.
fn check(device: &wgpu::Device, edges: impl IntoIterator<Item = u32>) -> anyhow::Result<()> {
    let most = device.limits().max_texture_dimension_3d;
    if edges.into_iter().any(|n| n > most) {
        anyhow::bail!(
            "the bone's textures exceed the adapter's {most} texels along one edge; start the session with a larger --voxel-mm"
        );
    }
    Ok(())
}

/// First texel of a slot's tile, where a row of tiles is `nx` long and a layer `ny` high.
fn origin_of(slot: usize, [nx, ny]: [u32; 2]) -> [u32; 3] {
    let s = slot as u32;
    [s % nx, s / nx % ny, s / (nx * ny)].map(|n| n * TILE as u32)
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

/// Writes a box of texels of `texel` bytes.
fn write(
    queue: &wgpu::Queue,
    texture: &wgpu::Texture,
    origin: [u32; 3],
    size: [u32; 3],
    bytes: &[u8],
    texel: u32,
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
            bytes_per_row: Some(texel * size[0]),
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

/// Layout of the bone's textures.
pub(crate) fn textures_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    let filtered = wgpu::TextureSampleType::Float { filterable: true };
    let deep = wgpu::TextureViewDimension::D3;
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("bone"),
        entries: &[
            texture_entry(0, wgpu::TextureSampleType::Uint, deep),
            texture_entry(1, filtered, deep),
            texture_entry(2, filtered, deep),
            wgpu::BindGroupLayoutEntry {
                binding: 3,
                visibility: wgpu::ShaderStages::FRAGMENT,
                ty: wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
                count: None,
            },
        ],
    })
}
