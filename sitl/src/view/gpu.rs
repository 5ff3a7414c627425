//! Draws the 3-D view on the graphics card, into a picture of its own, and copies that into the window.
//!
//! The picture is made apart because egui's own pass has no depth. What stands still is uploaded once a scene; a drawing that
//! is shown already is not drawn again.

use std::marker::PhantomData;
use std::mem::size_of;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use egui::{Pos2, Rect, pos2};
use egui_wgpu::{CallbackResources, CallbackTrait, RenderState, ScreenDescriptor};
use sitl::render::diorama::{Texture, Vertex};
use wgpu::{Buffer, BufferUsages, CommandBuffer, CommandEncoder, Device, Queue};

use super::eye::{Eye, NEAR_M};
use super::pipelines::{COLOR, DEPTH, Dot, Pipelines, Segment};
use super::worker::{Loaded, VoxelMesh};

/// What one picture shows.
#[derive(Debug)]
pub(crate) struct Drawing {
    pub(crate) eye: Eye,
    pub(crate) loaded: Arc<Loaded>,
    pub(crate) shows_surfaces: bool,
    pub(crate) voxels: Option<Arc<VoxelMesh>>,
    pub(crate) moving: Arc<Vec<Vertex>>,
    /// What is added to the scene.
    pub(crate) solid: Vec<Vertex>,
    pub(crate) glass: Vec<Vertex>,
    pub(crate) segments: Vec<Segment>,
    pub(crate) dots: Vec<Dot>,
}

/// Makes the renderer and leaves it with egui's; a processor that draws in place of a graphics card takes one sample a
/// pixel, unless the picture is worth it.
pub(crate) fn install(state: &RenderState, is_worth_it: bool) {
    let is_slow = state.adapter.get_info().device_type == wgpu::DeviceType::Cpu;
    let samples = if is_slow && !is_worth_it { 1 } else { 4 };
    let renderer = Renderer::new(state, samples);
    state.renderer.write().callback_resources.insert(renderer);
}

/// The drawing as something egui paints in `rect`.
pub(crate) fn shape(rect: Rect, drawing: Arc<Drawing>) -> egui::Shape {
    egui_wgpu::Callback::new_paint_callback(rect, Shown { rect, drawing }).into()
}

struct Shown {
    rect: Rect,
    drawing: Arc<Drawing>,
}

impl CallbackTrait for Shown {
    fn prepare(
        &self,
        _device: &Device,
        _queue: &Queue,
        screen: &ScreenDescriptor,
        _egui_encoder: &mut CommandEncoder,
        resources: &mut CallbackResources,
    ) -> Vec<CommandBuffer> {
        let Some(renderer) = resources.get_mut::<Renderer>() else {
            return Vec::new();
        };
        let on_screen = in_pixels(self.rect, screen.pixels_per_point);
        let size_px = [on_screen.width() as u32, on_screen.height() as u32];
        let commands = renderer.draw(size_px, &self.drawing);
        commands.into_iter().collect()
    }

    fn paint(
        &self,
        info: egui::PaintCallbackInfo,
        pass: &mut wgpu::RenderPass<'static>,
        resources: &CallbackResources,
    ) {
        let Some(renderer) = resources.get::<Renderer>() else {
            return;
        };
        // egui's viewport is cut off at the edge of the window, which would squeeze a panel that is partly outside.
        let on_screen = in_pixels(self.rect, info.pixels_per_point);
        let (min, size) = (on_screen.min, on_screen.size());
        if size.x >= 1.0 && size.y >= 1.0 && size.max_elem() <= renderer.largest_px() as f32 {
            pass.set_viewport(min.x, min.y, size.x, size.y, 0.0, 1.0);
            renderer.copy_to_screen(pass);
        }
    }
}

fn in_pixels(rect: Rect, pixels_per_point: f32) -> Rect {
    let round = |p: Pos2| {
        let p = p * pixels_per_point;
        pos2(p.x.round(), p.y.round())
    };
    Rect::from_min_max(round(rect.min), round(rect.max))
}

/// What the shader knows of the view: the struct of the same name there.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Globals {
    clip_from_world: [[f32; 4]; 4],
    eye: [f32; 4],
    right: [f32; 4],
    up: [f32; 4],
    forward: [f32; 4],
    air: [f32; 4],
    size_px: [f32; 2],
    near_m: f32,
    lift_m: f32,
}

impl Globals {
    fn of(drawing: &Drawing, size_px: [u32; 2]) -> Self {
        let eye = &drawing.eye;
        let size = size_px.map(f64::from);
        let four = |v: nalgebra::Vector3<f64>| [v.x as f32, v.y as f32, v.z as f32, 0.0];
        let aspect = size[0] / size[1].max(1.0);
        let [r, g, b] = drawing.loaded.diorama.air.map(|c| f32::from(c) / 255.0);
        Self {
            clip_from_world: eye.clip_from_world(size).map(|c| c as f32).into(),
            eye: four(eye.position.coords),
            right: four(eye.right * (eye.tan * aspect)),
            up: four(eye.up * eye.tan),
            forward: four(eye.forward),
            air: [r, g, b, drawing.loaded.diorama.haze],
            size_px: size.map(|px| px as f32),
            near_m: NEAR_M as f32,
            lift_m: 0.04,
        }
    }
}

/// What this module keeps on the graphics card.
struct Renderer {
    device: Device,
    queue: Queue,
    samples: u32,
    pipelines: Pipelines,
    samplers: [wgpu::Sampler; 2],
    globals: Buffer,
    scene: Option<GpuScene>,
    picture: Option<Picture>,
    moving: (Option<Arc<Vec<Vertex>>>, GrowingBuffer<Vertex>),
    solid: GrowingBuffer<Vertex>,
    glass: GrowingBuffer<Vertex>,
    segments: GrowingBuffer<Segment>,
    dots: GrowingBuffer<Dot>,
    voxels: (Option<Arc<VoxelMesh>>, GrowingBuffer<Vertex>),
}

struct GpuScene {
    loaded: Arc<Loaded>,
    still: GrowingBuffer<Vertex>,
    binding: wgpu::BindGroup,
}

struct Picture {
    size_px: [u32; 2],
    /// None if there is one sample a pixel.
    samples: Option<wgpu::TextureView>,
    depth: wgpu::TextureView,
    finished: wgpu::TextureView,
    screen_binding: wgpu::BindGroup,
    shown: Option<Arc<Drawing>>,
}

impl Renderer {
    fn new(state: &RenderState, samples: u32) -> Self {
        let (device, queue) = (&state.device, &state.queue);
        let sampler = |address_u, mipmap_filter| {
            device.create_sampler(&wgpu::SamplerDescriptor {
                address_mode_u: address_u,
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                mipmap_filter,
                ..wgpu::SamplerDescriptor::default()
            })
        };
        Self {
            pipelines: Pipelines::new(device, state.target_format, samples),
            samplers: [
                sampler(
                    wgpu::AddressMode::ClampToEdge,
                    wgpu::MipmapFilterMode::Linear,
                ),
                sampler(wgpu::AddressMode::Repeat, wgpu::MipmapFilterMode::Nearest),
            ],
            globals: new_buffer(device, size_of::<Globals>(), BufferUsages::UNIFORM),
            scene: None,
            picture: None,
            moving: (None, GrowingBuffer::new(device)),
            solid: GrowingBuffer::new(device),
            glass: GrowingBuffer::new(device),
            segments: GrowingBuffer::new(device),
            dots: GrowingBuffer::new(device),
            voxels: (None, GrowingBuffer::new(device)),
            device: device.clone(),
            queue: queue.clone(),
            samples,
        }
    }

    /// The largest width and height a picture can have; larger ones are drawn at this size and stretched.
    fn largest_px(&self) -> u32 {
        self.device.limits().max_texture_dimension_2d
    }

    /// The commands that draw it, to be submitted; `None` if it is shown already.
    fn draw(&mut self, size_px: [u32; 2], drawing: &Arc<Drawing>) -> Option<CommandBuffer> {
        let largest = self.largest_px();
        let size_px = size_px.map(|px| px.clamp(1, largest));
        let mut picture = match self.picture.take() {
            Some(picture) if picture.size_px == size_px => picture,
            _ => self.new_picture(size_px),
        };
        let shown = picture.shown.as_ref();
        let is_shown = shown.is_some_and(|shown| Arc::ptr_eq(shown, drawing));
        let commands = (!is_shown).then(|| {
            self.upload(drawing, size_px);
            self.render(&picture, drawing)
        });
        picture.shown = Some(Arc::clone(drawing));
        self.picture = Some(picture);
        commands
    }

    fn copy_to_screen(&self, pass: &mut wgpu::RenderPass<'_>) {
        if let Some(picture) = &self.picture {
            pass.set_pipeline(&self.pipelines.screen);
            pass.set_bind_group(0, &picture.screen_binding, &[]);
            pass.draw(0..3, 0..1);
        }
    }

    fn upload(&mut self, drawing: &Drawing, size_px: [u32; 2]) {
        let (device, queue) = (&self.device, &self.queue);
        let globals = Globals::of(drawing, size_px);
        queue.write_buffer(&self.globals, 0, bytemuck::bytes_of(&globals));
        self.solid.write(device, queue, &drawing.solid);
        self.glass.write(device, queue, &drawing.glass);
        self.segments.write(device, queue, &drawing.segments);
        self.dots.write(device, queue, &drawing.dots);
        let (shown, buffer) = &mut self.moving;
        if !shown
            .as_ref()
            .is_some_and(|shown| Arc::ptr_eq(shown, &drawing.moving))
        {
            buffer.write(device, queue, &drawing.moving);
            *shown = Some(Arc::clone(&drawing.moving));
        }
        let (shown, buffer) = &mut self.voxels;
        if let Some(voxels) = &drawing.voxels
            && !shown
                .as_ref()
                .is_some_and(|shown| Arc::ptr_eq(shown, voxels))
        {
            buffer.write(device, queue, &voxels.vertices);
            *shown = Some(Arc::clone(voxels));
        }
        let is_there = self.scene.as_ref();
        if !is_there.is_some_and(|scene| Arc::ptr_eq(&scene.loaded, &drawing.loaded)) {
            self.scene = Some(self.new_scene(&drawing.loaded));
        }
    }

    fn new_scene(&self, loaded: &Arc<Loaded>) -> GpuScene {
        let (device, queue) = (&self.device, &self.queue);
        let mut still = GrowingBuffer::new(device);
        still.write(device, queue, &loaded.diorama.still);
        let [atlas, sky] = [&loaded.diorama.atlas, &loaded.diorama.sky]
            .map(|texture| new_texture(device, queue, texture));
        let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
        let [atlas_sampler, sky_sampler] = &self.samplers;
        let binding = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("scene"),
            layout: &self.pipelines.scene_layout,
            entries: &[
                entry(0, self.globals.as_entire_binding()),
                entry(1, wgpu::BindingResource::TextureView(&atlas)),
                entry(2, wgpu::BindingResource::TextureView(&sky)),
                entry(3, wgpu::BindingResource::Sampler(atlas_sampler)),
                entry(4, wgpu::BindingResource::Sampler(sky_sampler)),
            ],
        });
        GpuScene {
            loaded: Arc::clone(loaded),
            still,
            binding,
        }
    }

    fn new_picture(&self, size_px: [u32; 2]) -> Picture {
        let texture = |format, sample_count, usage| {
            let texture = self.device.create_texture(&wgpu::TextureDescriptor {
                label: Some("3-D view"),
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
            });
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        };
        let drawn = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let finished = texture(COLOR, 1, drawn | wgpu::TextureUsages::TEXTURE_BINDING);
        let screen_binding = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("3-D view"),
            layout: &self.pipelines.screen_layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(&finished),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: wgpu::BindingResource::Sampler(&self.samplers[0]),
                },
            ],
        });
        Picture {
            size_px,
            samples: (self.samples > 1).then(|| texture(COLOR, self.samples, drawn)),
            depth: texture(DEPTH, self.samples, drawn),
            finished,
            screen_binding,
            shown: None,
        }
    }

    fn render(&self, picture: &Picture, drawing: &Drawing) -> CommandBuffer {
        let mut encoder = self
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor {
                label: Some("3-D view"),
            });
        let mut pass = picture.begin_pass(&mut encoder);
        if let Some(scene) = &self.scene {
            pass.set_bind_group(0, &scene.binding, &[]);
            self.draw_things(&mut pass, scene, drawing);
        }
        drop(pass);
        encoder.finish()
    }

    fn draw_things(&self, pass: &mut wgpu::RenderPass<'_>, scene: &GpuScene, drawing: &Drawing) {
        let all = &self.pipelines;
        pass.set_pipeline(&all.sky);
        pass.draw(0..3, 0..1);
        pass.set_pipeline(&all.surfaces);
        if drawing.shows_surfaces {
            scene.still.draw_vertices(pass);
            self.moving.1.draw_vertices(pass);
        }
        self.solid.draw_vertices(pass);
        if drawing.voxels.is_some() {
            self.voxels.1.draw_vertices(pass);
        }
        pass.set_pipeline(&all.dots);
        self.dots.draw_quads(pass);
        pass.set_pipeline(&all.glass);
        self.glass.draw_vertices(pass);
        for lines in [&all.hidden_lines, &all.lines] {
            pass.set_pipeline(lines);
            self.segments.draw_quads(pass);
        }
    }
}

impl Picture {
    fn begin_pass<'a>(&self, encoder: &'a mut CommandEncoder) -> wgpu::RenderPass<'a> {
        let (view, resolve_target) = match &self.samples {
            Some(samples) => (samples, Some(&self.finished)),
            None => (&self.finished, None),
        };
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("3-D view"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view,
                depth_slice: None,
                resolve_target,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                    store: wgpu::StoreOp::Store,
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

fn new_texture(device: &Device, queue: &Queue, texture: &Texture) -> wgpu::TextureView {
    let extent = |size: [usize; 2]| wgpu::Extent3d {
        width: size[0] as u32,
        height: size[1] as u32,
        depth_or_array_layers: 1,
    };
    let on_card = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("surfaces"),
        size: extent(texture.size),
        mip_level_count: 1 + texture.halved.len() as u32,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: COLOR,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let levels = std::iter::once(texture).chain(&texture.halved);
    for (mip_level, level) in (0..).zip(levels) {
        let to = wgpu::TexelCopyTextureInfo {
            mip_level,
            ..on_card.as_image_copy()
        };
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(4 * level.size[0] as u32),
            rows_per_image: None,
        };
        let bytes = bytemuck::cast_slice(&level.pixels);
        queue.write_texture(to, bytes, layout, extent(level.size));
    }
    on_card.create_view(&wgpu::TextureViewDescriptor::default())
}

fn new_buffer(device: &Device, bytes: usize, usage: BufferUsages) -> Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: bytes as u64,
        usage: usage | BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

/// A vertex buffer that is as large as it has ever been needed.
struct GrowingBuffer<T> {
    buffer: Buffer,
    items: u32,
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
    fn write(&mut self, device: &Device, queue: &Queue, items: &[T]) {
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

    fn draw_vertices(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_vertex_buffer(0, self.buffer.slice(..));
        pass.draw(0..self.items, 0..1);
    }

    /// Four corners an item.
    fn draw_quads(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_vertex_buffer(0, self.buffer.slice(..));
        pass.draw(0..4, 0..self.items);
    }
}
