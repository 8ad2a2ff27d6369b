//! Methods that draw a mesh of each chunk: surface nets, faces, splats.
//!
//! Chunks whose bricks changed are meshed again on the CPU, by several threads where there are many,
//! and uploaded into buffers of their own. A view draws the chunks that its frustum touches.
#![expect(
    clippy::cast_possible_truncation,
    reason = "chunk counts are bounded by the mirror; f64 becomes f32 for the GPU"
)]

use super::View;
use super::atlas::Atlas;
use super::frustum::Frustum;
use super::method::{Context, Fate, Method, Squares};
use super::occlusion::Pyramid;
use super::pipeline::Recipe;
use crate::meshing::bits::{Apron, Occupied, read_chunk};
use crate::meshing::faces::{faces, surface_voxels};
use crate::meshing::greedy::{self, greedy};
use crate::meshing::nets::{self, Around, Net, net};
use crate::mirror::Model;
use glam::DVec3;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::grid::CHUNK;
use std::collections::VecDeque;
use std::thread;

/// Chunks that one frame meshes: some milliseconds of work.
const CHUNKS_PER_FRAME: usize = 128;
/// Chunks from which on threads pay.
const WORTH_THREADS: usize = 8;
/// Chunks in the picture from which on it pays to find out what is hidden.
const WORTH_CULLING: usize = 24;
/// Most threads.
const MOST_THREADS: usize = 8;

/// What a chunk becomes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mesher {
    /// Surface nets: triangles.
    Nets,
    /// A rectangle for each face of a voxel.
    Faces,
    /// Merged rectangles.
    Greedy,
    /// The voxels that have a face, each drawn as a box.
    Splats,
}

impl Mesher {
    /// WGSL of the method.
    pub(crate) fn text(self) -> String {
        let own = match self {
            Self::Nets => include_str!("mesh.wgsl"),
            Self::Faces | Self::Greedy => include_str!("cubes.wgsl"),
            Self::Splats => include_str!("splats.wgsl"),
        };
        super::shader_text(&[include_str!("atlas.wgsl"), own])
    }
}

/// Room that a thread needs.
#[derive(Debug)]
struct Bench {
    apron: Apron,
    greedy: greedy::Scratch,
    nets: nets::Scratch,
}

impl Bench {
    fn new() -> Self {
        Self {
            apron: Apron::new(),
            greedy: greedy::Scratch::new(),
            nets: nets::Scratch::new(),
        }
    }
}

/// A chunk's mesh: instances or vertices, and the vertices' triangles.
#[derive(Debug, Default)]
struct Mesh {
    words: Vec<u32>,
    net: Net,
}

impl Mesh {
    fn of(
        mesher: Mesher,
        bench: &mut Bench,
        occupied: &Occupied,
        model: &Model,
        chunk: usize,
    ) -> Self {
        let mut mesh = Self::default();
        occupied.apron(&model.bone, chunk, &mut bench.apron);
        match mesher {
            Mesher::Nets => {
                let around = Around::new(&model.bone, &model.cut, chunk);
                net(&bench.apron, &around, &mut bench.nets, &mut mesh.net);
            }
            Mesher::Faces => faces(&bench.apron, &mut mesh.words),
            Mesher::Greedy => greedy(&bench.apron, &mut bench.greedy, &mut mesh.words),
            Mesher::Splats => surface_voxels(&bench.apron, &mut mesh.words),
        }
        mesh
    }
}

/// A chunk's mesh on the adapter.
#[derive(Debug)]
struct Piece {
    data: wgpu::Buffer,
    // triangles of a net
    indices: Option<wgpu::Buffer>,
    count: u32,
}

/// The meshes of all chunks.
#[derive(Debug)]
pub(crate) struct Chunked {
    mesher: Mesher,
    pipeline: wgpu::RenderPipeline,
    // back faces too: a section plane opens the shell
    open: wgpu::RenderPipeline,
    occupied: Occupied,
    waiting: Vec<bool>,
    queue: VecDeque<usize>,
    benches: Vec<Bench>,
    pieces: Vec<Option<Piece>>,
    boxes: Vec<(DVec3, DVec3)>,
    places: wgpu::BindGroup,
    stride: u32,
    // in the picture: the chunks that are drawn first, and those that wait for what these hide
    first: Vec<usize>,
    later: Vec<usize>,
    // not hidden in the last picture
    seen: Vec<bool>,
    fates: Vec<Fate>,
    is_open: bool,
}

impl Chunked {
    /// Room for a model's meshes.
    pub(crate) fn new(context: &Context, mesher: Mesher, model: &Model) -> Self {
        let device = &context.device;
        let bone = &model.bone;
        let layout = places_layout(device);
        let [pipeline, open] = pipelines(context, mesher, &layout);
        let stride = device.limits().min_uniform_buffer_offset_alignment.max(16);
        let mut occupied = Occupied::new(bone.chunk_count());
        for chunk in 0..bone.chunk_count() {
            read_chunk(bone, &model.cut, chunk, occupied.rows_mut(chunk));
        }
        let threads = thread::available_parallelism().map_or(1, usize::from);
        Self {
            mesher,
            pipeline,
            open,
            occupied,
            waiting: vec![false; bone.chunk_count()],
            queue: VecDeque::new(),
            benches: (0..threads.min(MOST_THREADS))
                .map(|_| Bench::new())
                .collect(),
            pieces: (0..bone.chunk_count()).map(|_| None).collect(),
            boxes: (0..bone.chunk_count())
                .map(|c| chunk_box(bone, c))
                .collect(),
            places: places(context, &layout, bone, stride),
            stride,
            first: Vec::new(),
            later: Vec::new(),
            seen: vec![true; bone.chunk_count()],
            fates: vec![Fate::Empty; bone.chunk_count()],
            is_open: false,
        }
    }

    /// Meshes of chunks in the order of the list.
    fn mesh(&mut self, model: &Model, chunks: &[usize]) -> anyhow::Result<Vec<Mesh>> {
        let (mesher, occupied) = (self.mesher, &self.occupied);
        if chunks.len() < WORTH_THREADS || self.benches.len() < 2 {
            let bench = &mut self.benches[0];
            let all = chunks.iter();
            return Ok(all
                .map(|&c| Mesh::of(mesher, bench, occupied, model, c))
                .collect());
        }
        let share = chunks.len().div_ceil(self.benches.len());
        thread::scope(|scope| {
            let mut workers = Vec::new();
            for (bench, part) in self.benches.iter_mut().zip(chunks.chunks(share)) {
                let work = move || -> Vec<Mesh> {
                    let all = part.iter();
                    all.map(|&c| Mesh::of(mesher, bench, occupied, model, c))
                        .collect()
                };
                workers.push(
                    thread::Builder::new()
                        .name("mesher".into())
                        .spawn_scoped(scope, work)?,
                );
            }
            let mut meshes = Vec::with_capacity(chunks.len());
            for worker in workers {
                let part = worker.join();
                meshes.extend(
                    part.map_err(|_panic| anyhow::anyhow!("a mesher failed; restart the viewer"))?,
                );
            }
            Ok(meshes)
        })
    }

    fn draw_all(&self, pass: &mut wgpu::RenderPass<'_>, chunks: &[usize]) {
        for &chunk in chunks {
            let Some(piece) = &self.pieces[chunk] else {
                continue;
            };
            pass.set_bind_group(2, &self.places, &[self.stride * chunk as u32]);
            pass.set_vertex_buffer(0, piece.data.slice(..));
            if let Some(indices) = &piece.indices {
                pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint16);
                pass.draw_indexed(0..piece.count, 0, 0..1);
            } else {
                pass.draw(0..4, 0..piece.count);
            }
        }
    }

    fn upload(&mut self, context: &Context, chunk: usize, mesh: &Mesh) {
        let is_net = self.mesher == Mesher::Nets;
        let (data, count): (&[u8], usize) = if is_net {
            (
                bytemuck::cast_slice(&mesh.net.vertices),
                mesh.net.indices.len(),
            )
        } else {
            (bytemuck::cast_slice(&mesh.words), mesh.words.len())
        };
        if count == 0 {
            self.pieces[chunk] = None;
            return;
        }
        let old = self.pieces[chunk].take();
        let (old_data, old_indices) = old.map_or((None, None), |p| (Some(p.data), p.indices));
        let vertex = wgpu::BufferUsages::VERTEX;
        let index = wgpu::BufferUsages::INDEX;
        let triangles: &[u8] = bytemuck::cast_slice(&mesh.net.indices);
        self.pieces[chunk] = Some(Piece {
            data: fill(context, old_data, data, vertex),
            indices: is_net.then(|| fill(context, old_indices, triangles, index)),
            count: count as u32,
        });
    }
}

/// The pipelines of a mesher: closed shells, and such that a section plane opens.
fn pipelines(
    context: &Context,
    mesher: Mesher,
    layout: &wgpu::BindGroupLayout,
) -> [wgpu::RenderPipeline; 2] {
    let groups = [&context.globals, &context.textures, layout];
    let attributes = [wgpu::VertexAttribute {
        format: match mesher {
            Mesher::Nets => wgpu::VertexFormat::Uint16x4,
            _ => wgpu::VertexFormat::Uint32,
        },
        offset: 0,
        shader_location: 0,
    }];
    let buffers = [wgpu::VertexBufferLayout {
        array_stride: if mesher == Mesher::Nets { 8 } else { 4 },
        step_mode: match mesher {
            Mesher::Nets => wgpu::VertexStepMode::Vertex,
            _ => wgpu::VertexStepMode::Instance,
        },
        attributes: &attributes,
    }];
    let recipe = |cull| Recipe {
        label: "chunks",
        text: mesher.text(),
        entries: ["vertex_main", "fragment_main"],
        groups: &groups,
        buffers: &buffers,
        topology: match mesher {
            Mesher::Nets => wgpu::PrimitiveTopology::TriangleList,
            _ => wgpu::PrimitiveTopology::TriangleStrip,
        },
        depth: wgpu::CompareFunction::Less,
        cull,
    };
    // a splat's rectangle faces the eye
    let cull = (mesher != Mesher::Splats).then_some(wgpu::Face::Back);
    [cull, None].map(|cull| recipe(cull).surfaces(&context.device))
}

/// Writes bytes (a multiple of four) into a buffer; into a new one, half as large again, where the
/// old one is too small.
fn fill(
    context: &Context,
    old: Option<wgpu::Buffer>,
    bytes: &[u8],
    usage: wgpu::BufferUsages,
) -> wgpu::Buffer {
    let need = bytes.len() as u64;
    let buffer = old.filter(|b| b.size() >= need).unwrap_or_else(|| {
        context.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("chunk"),
            size: (need + need / 2).next_multiple_of(256),
            usage: usage | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    });
    context.queue.write_buffer(&buffer, 0, bytes);
    buffer
}

/// Corners of all that a chunk's mesh can reach, bone frame, mm.
pub(crate) fn chunk_box(bone: &Bone, chunk: usize) -> (DVec3, DVec3) {
    let spacing = bone.grid().spacing_mm;
    let first = DVec3::from_array(bone.chunk_coord(chunk).map(|c| f64::from(c) * CHUNK as f64));
    (
        (first - 1.0) * spacing,
        (first + (CHUNK as f64 + 1.0)) * spacing,
    )
}

fn places_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("chunk's place"),
        entries: &[wgpu::BindGroupLayoutEntry {
            binding: 0,
            visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Uniform,
                has_dynamic_offset: true,
                min_binding_size: wgpu::BufferSize::new(16),
            },
            count: None,
        }],
    })
}

/// The first voxel of each chunk, `stride` bytes apart.
fn places(
    context: &Context,
    layout: &wgpu::BindGroupLayout,
    bone: &Bone,
    stride: u32,
) -> wgpu::BindGroup {
    let words = stride as usize / 4;
    let mut origins = vec![0.0f32; words * bone.chunk_count()];
    for (chunk, origin) in origins.chunks_exact_mut(words).enumerate() {
        for (to, c) in origin.iter_mut().zip(bone.chunk_coord(chunk)) {
            *to = f32::from(c) * CHUNK as f32;
        }
    }
    let bytes: &[u8] = bytemuck::cast_slice(&origins);
    let buffer = super::uniforms::buffer(&context.device, "chunks' places", bytes.len());
    context.queue.write_buffer(&buffer, 0, bytes);
    context
        .device
        .create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("chunks' places"),
            layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer: &buffer,
                    offset: 0,
                    size: wgpu::BufferSize::new(16),
                }),
            }],
        })
}

impl Method for Chunked {
    fn changed(&mut self, _context: &Context, model: &Model, slot: usize) {
        let chunk = model.map.chunk_of(slot);
        if !core::mem::replace(&mut self.waiting[chunk], true) {
            self.queue.push_back(chunk);
        }
    }

    fn update(&mut self, context: &Context, model: &Model, all: bool) -> anyhow::Result<()> {
        let most = if all { usize::MAX } else { CHUNKS_PER_FRAME };
        let count = self.queue.len().min(most);
        // a chunk's apron shows its neighbours' bits: first all bits, then the meshes
        for &chunk in &self.queue {
            read_chunk(
                &model.bone,
                &model.cut,
                chunk,
                self.occupied.rows_mut(chunk),
            );
        }
        let chunks: Vec<usize> = self.queue.drain(..count).collect();
        let meshes = self.mesh(model, &chunks)?;
        for (&chunk, mesh) in chunks.iter().zip(&meshes) {
            self.waiting[chunk] = false;
            self.upload(context, chunk, mesh);
        }
        Ok(())
    }

    fn is_behind(&self) -> bool {
        !self.queue.is_empty()
    }

    fn aim(&mut self, _context: &Context, view: &View, _atlas: &Atlas) {
        let frustum = Frustum::new(&view.camera.clip_from_bone(view.aspect()));
        self.is_open = view.look.section.is_some();
        self.first.clear();
        self.later.clear();
        for (chunk, (lo, hi)) in self.boxes.iter().enumerate() {
            self.fates[chunk] = if self.pieces[chunk].is_none() {
                Fate::Empty
            } else if !frustum.touches(*lo, *hi) {
                Fate::Outside
            } else if self.seen[chunk] {
                self.first.push(chunk);
                Fate::Drawn
            } else {
                self.later.push(chunk);
                Fate::Hidden
            };
        }
        // near ones first: what they hide is not shaded
        let eye = view.camera.axes().eye;
        let far = |chunk: &usize| {
            let (lo, hi) = self.boxes[*chunk];
            eye.distance_squared(0.5 * (lo + hi))
        };
        self.first.sort_by(|a, b| far(a).total_cmp(&far(b)));
    }

    fn draw(&self, pass: &mut wgpu::RenderPass<'_>, _squares: &Squares) {
        pass.set_pipeline(if self.is_open {
            &self.open
        } else {
            &self.pipeline
        });
        self.draw_all(pass, &self.first);
    }

    fn is_culling(&self) -> bool {
        self.first.len() + self.later.len() >= WORTH_CULLING
    }

    fn cull(&mut self, view: &View, pyramid: Option<&Pyramid>) {
        let clip_from_bone = view.camera.clip_from_bone(view.aspect());
        let eye = view.camera.axes().eye;
        let boxes = &self.boxes;
        let hides =
            |chunk: usize| pyramid.is_some_and(|p| p.hides(&clip_from_bone, eye, boxes[chunk]));
        for &chunk in &self.first {
            self.seen[chunk] = !hides(chunk);
        }
        for &chunk in &self.later {
            self.seen[chunk] = !hides(chunk);
        }
        let seen = &self.seen;
        self.later.retain(|&chunk| seen[chunk]);
        for &chunk in &self.later {
            self.fates[chunk] = Fate::Drawn;
        }
    }

    fn draw_rest(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_pipeline(if self.is_open {
            &self.open
        } else {
            &self.pipeline
        });
        self.draw_all(pass, &self.later);
    }

    fn fate(&self, chunk: usize) -> Fate {
        self.fates[chunk]
    }

    fn bytes(&self) -> u64 {
        let of = |p: &Piece| p.data.size() + p.indices.as_ref().map_or(0, wgpu::Buffer::size);
        let pieces: u64 = self.pieces.iter().flatten().map(of).sum();
        pieces + self.occupied.bytes()
    }
}
