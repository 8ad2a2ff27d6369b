//! The ways of drawing the bone behind one face.
//!
//! A method fills the surface buffers ([`super::target`]) where its bone is; light, tool and overlays
//! are the same for all. All of them read the bone's textures ([`super::atlas`]), which the renderer
//! keeps up to date.

use super::View;
use super::atlas::Atlas;
use super::chunked::{Chunked, Mesher};
use super::iso::Iso;
use super::occlusion::Pyramid;
use super::section::Section;
use crate::mirror::Model;

/// The methods.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Default,
    clap::ValueEnum,
    serde::Serialize,
    serde::Deserialize,
)]
pub enum Kind {
    /// Smooth iso-surface of the fields, marched ray by ray through the map of bricks
    #[default]
    Iso,
    /// Surface nets of each chunk, meshed on the CPU: for weak graphics cards
    Mesh,
    /// Faces between voxels of bone and air, the thesis's mesh
    Cubes,
    /// The same faces merged into rectangles
    Greedy,
    /// Voxels as ray-traced boxes, the thesis's choice
    Splats,
    /// CT densities on a section plane, the bone behind it
    Section,
}

impl Kind {
    /// All, in the order of the key that changes them.
    pub const ALL: [Self; 6] = [
        Self::Iso,
        Self::Mesh,
        Self::Cubes,
        Self::Greedy,
        Self::Splats,
        Self::Section,
    ];

    /// Name in reports and on buttons.
    pub fn name(self) -> &'static str {
        match self {
            Self::Iso => "iso",
            Self::Mesh => "mesh",
            Self::Cubes => "cubes",
            Self::Greedy => "greedy",
            Self::Splats => "splats",
            Self::Section => "section",
        }
    }

    /// What it is, for people.
    pub(crate) fn about(self) -> &'static str {
        match self {
            Self::Iso => "Smooth surface of the bone, exact between the voxels.",
            Self::Mesh => "Triangles of the smooth surface: less work for a weak graphics card.",
            Self::Cubes => "Voxels as cubes, one rectangle for each face.",
            Self::Greedy => "Voxels as cubes, their faces merged into larger rectangles.",
            Self::Splats => "Voxels as boxes, each found by a ray in every pixel.",
            Self::Section => "CT densities on a section plane through the tool's tip.",
        }
    }

    /// The one after it.
    pub(crate) fn next(self) -> Self {
        let at = Self::ALL.iter().position(|&k| k == self).unwrap_or(0);
        Self::ALL[(at + 1) % Self::ALL.len()]
    }
}

/// What a method works with.
#[derive(Debug, Clone)]
pub(crate) struct Context {
    /// The device.
    pub(crate) device: wgpu::Device,
    /// Its queue.
    pub(crate) queue: wgpu::Queue,
    /// Layout of group 0, the globals.
    pub(crate) globals: wgpu::BindGroupLayout,
    /// Layout of group 1, the bone's textures.
    pub(crate) textures: wgpu::BindGroupLayout,
}

/// One way of drawing the bone.
pub(crate) trait Method: core::fmt::Debug {
    /// Takes note that a slot's values changed: every slot once after a method was made for a model.
    fn changed(&mut self, context: &Context, model: &Model, slot: usize);

    /// Does what the changes ask for, as much as one frame can bear; `all` = to the end.
    fn update(&mut self, context: &Context, model: &Model, all: bool) -> anyhow::Result<()>;

    /// Whether something is left to do.
    fn is_behind(&self) -> bool {
        false
    }

    /// Chooses what of the bone a view shows.
    fn aim(&mut self, context: &Context, view: &View, atlas: &Atlas);

    /// Draws into the surface buffers; groups 0 and 1 are set. `squares` can show bone.
    fn draw(&self, pass: &mut wgpu::RenderPass<'_>, squares: &Squares);

    /// Whether [`Self::cull`] is worth its wait: something was not drawn yet, or may be hidden.
    fn is_culling(&self) -> bool {
        false
    }

    /// Takes note of what is hidden behind all that was drawn; `None` where that is not known.
    fn cull(&mut self, _view: &View, _pyramid: Option<&Pyramid>) {}

    /// Draws what [`Self::draw`] left for after [`Self::cull`].
    fn draw_rest(&self, _pass: &mut wgpu::RenderPass<'_>) {}

    /// What became of a chunk in the last picture.
    fn fate(&self, _chunk: usize) -> Fate {
        Fate::Drawn
    }

    /// Bytes on the adapter beside the bone's textures.
    fn bytes(&self) -> u64;
}

/// What became of a chunk in a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fate {
    /// It was drawn.
    Drawn,
    /// It lies outside the picture.
    Outside,
    /// It lies behind others.
    Hidden,
    /// Nothing of it is left to draw.
    Empty,
}

/// How many chunks met which fate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Fates {
    /// Drawn.
    pub(crate) drawn: usize,
    /// Outside the picture.
    pub(crate) outside: usize,
    /// Behind others.
    pub(crate) hidden: usize,
}

impl Fates {
    /// Counted.
    pub(crate) fn of(all: impl Iterator<Item = Fate>) -> Self {
        all.fold(Self::default(), |mut sum, fate| {
            match fate {
                Fate::Drawn => sum.drawn += 1,
                Fate::Outside => sum.outside += 1,
                Fate::Hidden => sum.hidden += 1,
                Fate::Empty => {}
            }
            sum
        })
    }
}

/// The squares of the picture that can show something, as a buffer of instances.
#[derive(Debug)]
pub(crate) struct Squares {
    buffer: wgpu::Buffer,
    count: u32,
}

/// Vertices of a square.
const SQUARE: u32 = 6;

impl Squares {
    /// None.
    pub(crate) fn new(device: &wgpu::Device) -> Self {
        Self {
            buffer: Self::buffer(device, 1024),
            count: 0,
        }
    }

    fn buffer(device: &wgpu::Device, bytes: u64) -> wgpu::Buffer {
        device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("squares"),
            size: bytes,
            usage: wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }

    /// Takes a list as [`super::tiles`] makes it.
    pub(crate) fn set(&mut self, device: &wgpu::Device, queue: &wgpu::Queue, list: &[u32]) {
        let bytes: &[u8] = bytemuck::cast_slice(list);
        if bytes.len() as u64 > self.buffer.size() {
            self.buffer = Self::buffer(device, bytes.len() as u64);
        }
        queue.write_buffer(&self.buffer, 0, bytes);
        // a picture has at most 2²⁰ squares
        self.count = u32::try_from(list.len()).unwrap_or(0);
    }

    /// Draws all of them with the pipeline that is set.
    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_vertex_buffer(0, self.buffer.slice(..));
        pass.draw(0..SQUARE, 0..self.count);
    }

    /// How a pipeline reads them.
    pub(crate) const LAYOUT: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {
        array_stride: size_of::<u32>() as u64,
        step_mode: wgpu::VertexStepMode::Instance,
        attributes: &[wgpu::VertexAttribute {
            format: wgpu::VertexFormat::Uint32,
            offset: 0,
            shader_location: 0,
        }],
    };
}

/// A method for a model, without anything of it yet.
pub(crate) fn make(
    kind: Kind,
    context: &Context,
    model: &Model,
) -> anyhow::Result<Box<dyn Method>> {
    Ok(match kind {
        Kind::Iso => Box::new(Iso::new(context)),
        Kind::Mesh => Box::new(Chunked::new(context, Mesher::Nets, model)),
        Kind::Cubes => Box::new(Chunked::new(context, Mesher::Faces, model)),
        Kind::Greedy => Box::new(Chunked::new(context, Mesher::Greedy, model)),
        Kind::Splats => Box::new(Chunked::new(context, Mesher::Splats, model)),
        Kind::Section => Box::new(Section::new(context, model)?),
    })
}
