//! One view's picture, and what is uploaded anew whenever it is drawn.

use std::marker::PhantomData;
use std::mem::size_of;

use bytemuck::{Pod, Zeroable};
use wgpu::{Buffer, BufferUsages, Device, Queue, Sampler};

use super::camera::{Camera3, Lens, NEAR_M, Viewport};
use super::gpu::Frame;
use super::grid::Grid;
use super::pipelines::{COLOR, DEPTH, Pipelines, SAMPLES};
use super::ramp::ramp;
use super::scene::{Coloring, Scene, Surfaces};
use super::sketch::{PlainVertex, Segment};

/// A picture and what was drawn into it.
pub(crate) struct View {
    pub(crate) picture: Picture,
    pub(crate) shown: Option<Frame>,
    pub(crate) globals: Buffer,
    pub(crate) globals_binding: wgpu::BindGroup,
    pub(crate) tile_origins: GrowingBuffer<[f32; 4]>,
    pub(crate) solid: GrowingBuffer<PlainVertex>,
    pub(crate) glass: GrowingBuffer<PlainVertex>,
    pub(crate) segments: GrowingBuffer<Segment>,
}

pub(crate) struct Picture {
    pub(crate) size_px: [u32; 2],
    pub(crate) samples: wgpu::TextureView,
    pub(crate) depth: wgpu::TextureView,
    pub(crate) finished: wgpu::Texture,
    pub(crate) finished_view: wgpu::TextureView,
    pub(crate) screen_binding: wgpu::BindGroup,
}

/// What the shader knows of the view: the struct of the same name there.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(crate) struct Globals {
    clip_from_eye: [[f32; 4]; 4],
    eye: [f32; 4],
    forward: [f32; 4],
    size_px: [f32; 2],
    ramp_m: [f32; 2],
    modes: [u32; 2],
    near_m: f32,
    parallel_depth_per_metre: f32,
    grid: [f32; 4],
    ramp: [[f32; 4]; 32],
}

impl View {
    pub(crate) fn new(
        device: &Device,
        pipelines: &Pipelines,
        sampler: &Sampler,
        size_px: [u32; 2],
    ) -> Self {
        let globals = new_buffer(device, size_of::<Globals>(), BufferUsages::UNIFORM);
        let globals_binding = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("globals"),
            layout: &pipelines.globals_layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: globals.as_entire_binding(),
            }],
        });
        Self {
            picture: Picture::new(device, pipelines, sampler, size_px),
            shown: None,
            globals,
            globals_binding,
            tile_origins: GrowingBuffer::new(device),
            solid: GrowingBuffer::new(device),
            glass: GrowingBuffer::new(device),
            segments: GrowingBuffer::new(device),
        }
    }
}

impl Picture {
    fn new(device: &Device, pipelines: &Pipelines, sampler: &Sampler, size_px: [u32; 2]) -> Self {
        let texture = |label, format, sample_count, usage| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d {
                    width: size_px[0],
                    height: size_px[1],
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
        };
        let drawn = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let read = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_SRC;
        let whole =
            |texture: &wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
        let finished = texture("map view", COLOR, 1, drawn | read);
        let finished_view = whole(&finished);
        let screen_binding = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("map view"),
            layout: &pipelines.screen_layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(&finished_view),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: wgpu::BindingResource::Sampler(sampler),
                },
            ],
        });
        Self {
            size_px,
            samples: whole(&texture("map view samples", COLOR, SAMPLES, drawn)),
            depth: whole(&texture("map view depth", DEPTH, SAMPLES, drawn)),
            finished,
            finished_view,
            screen_binding,
        }
    }

    /// A pass that draws the picture anew.
    pub(crate) fn begin_pass<'a>(
        &self,
        encoder: &'a mut wgpu::CommandEncoder,
        background: [u8; 3],
    ) -> wgpu::RenderPass<'a> {
        let [r, g, b] = background.map(|c| f64::from(c) / 255.0);
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("map view"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.samples,
                depth_slice: None,
                resolve_target: Some(&self.finished_view),
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a: 1.0 }),
                    store: wgpu::StoreOp::Discard,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.depth,
                depth_ops: Some(wgpu::Operations {
                    // Infinitely far.
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Discard,
                }),
                stencil_ops: None,
            }),
            timestamp_writes: None,
            occlusion_query_set: None,
            multiview_mask: None,
        })
    }
}

impl Globals {
    /// Those of `scene` as `camera` sees it.
    pub(crate) fn of(scene: &Scene, camera: &Camera3, viewport: Viewport) -> Self {
        let grid = Grid::of(camera);
        let eye = camera.eye().raw.map(|c| c as f32);
        // Lines and overlays on the floor lie within its voxels: half above it and half below.
        let lift_m = 1.5 * scene.resolution_m().max(0.01);
        let forward = camera.axes()[2].map(|c| c as f32);
        let hides_backs = u8::from(scene.look.surfaces == Surfaces::Observed);
        let clip_from_eye = camera.clip_from_eye(viewport).map(|c| c as f32);
        Self {
            clip_from_eye: clip_from_eye.into(),
            eye: [eye.x, eye.y, eye.z, lift_m as f32],
            forward: [forward.x, forward.y, forward.z, f32::from(hides_backs)],
            size_px: [viewport.width as f32, viewport.height as f32],
            ramp_m: scene.heights_m().map(|m| m as f32),
            modes: [
                match scene.look.coloring {
                    Coloring::Camera => 0,
                    Coloring::Height => 1,
                    Coloring::Certainty => 2,
                },
                match camera.lens() {
                    Lens::Perspective => 0,
                    Lens::Parallel => 1,
                },
            ],
            near_m: NEAR_M as f32,
            parallel_depth_per_metre: camera.parallel_depth_per_metre() as f32,
            grid: [
                grid.center.raw.x as f32,
                grid.center.raw.y as f32,
                grid.radius_m as f32,
                grid.spacing_m as f32,
            ],
            ramp: std::array::from_fn(|i| {
                let [r, g, b] = ramp(i as f64 / 31.0).map(|c| f32::from(c) / 255.0);
                [r, g, b, 1.0]
            }),
        }
    }
}

pub(crate) fn new_buffer(device: &Device, bytes: usize, usage: BufferUsages) -> Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: bytes as u64,
        usage: usage | BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

/// A vertex buffer that is as large as it has ever been needed.
pub(crate) struct GrowingBuffer<T> {
    pub(crate) buffer: Buffer,
    /// How many items are in it.
    pub(crate) items: u32,
    kind: PhantomData<T>,
}

impl<T: Pod> GrowingBuffer<T> {
    fn new(device: &Device) -> Self {
        Self {
            buffer: new_buffer(device, 16 * size_of::<T>(), BufferUsages::VERTEX),
            items: 0,
            kind: PhantomData,
        }
    }

    /// Replaces the items; those for which the device has no buffer large enough are left out.
    pub(crate) fn write(&mut self, device: &Device, queue: &Queue, items: &[T]) {
        let most = device.limits().max_buffer_size as usize / size_of::<T>();
        let items = &items[..items.len().min(most)];
        let bytes: &[u8] = bytemuck::cast_slice(items);
        if bytes.len() as u64 > self.buffer.size() {
            let room = items.len().next_power_of_two().min(most) * size_of::<T>();
            self.buffer = new_buffer(device, room, BufferUsages::VERTEX);
        }
        if !bytes.is_empty() {
            queue.write_buffer(&self.buffer, 0, bytes);
        }
        self.items = items.len() as u32;
    }
}
