//! Draws scenes on the graphics card, into pictures of its own.
//!
//! A mesh is uploaded once and dropped when no scene has it any more; a view whose scene, camera and size are those of
//! its last picture keeps that picture. Everything is drawn in one pass with four samples a pixel: opaque things first,
//! near before far, then what one sees through. The user interface only copies the finished picture into its window.
//!
//! The picture is made apart because egui's own pass may have no depth at all, and its depth would not be reversed.

use std::collections::BTreeMap;
use std::mem::size_of;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use maps::frame::{Point, World};
use wgpu::{Buffer, BufferUsages, CommandBuffer, Device, Queue, TextureFormat};

use super::camera::{Camera3, Lens, NEAR_M, Viewport};
use super::grid::Grid;
use super::mesh::{TileMesh, Vertex};
use super::pipelines::{COLOR, DEPTH, Pipelines, SAMPLES};
use super::ramp::ramp;
use super::scene::{Coloring, Scene, Surfaces};
use super::sketch::{PlainVertex, Segment, Sketch};

/// Which of several views of the map in one window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ViewId(pub u64);

/// What one picture shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// What there is.
    pub scene: Arc<Scene>,
    /// From where it is seen.
    pub camera: Camera3,
    /// Width and height of the picture in pixels.
    pub size_px: [u32; 2],
}

/// What this module keeps on the graphics card.
pub struct Renderer {
    device: Device,
    queue: Queue,
    pipelines: Pipelines,
    sampler: wgpu::Sampler,
    /// The same two triangles again and again: four corners, six indices.
    indices: Buffer,
    indexed_quads: usize,
    /// By the address of the mesh, which is kept alive with its vertices.
    tiles: BTreeMap<usize, GpuTile>,
    views: BTreeMap<ViewId, View>,
}

struct GpuTile {
    mesh: Arc<TileMesh>,
    /// None if there is nothing to draw.
    vertices: Option<Buffer>,
}

/// A picture and what was drawn into it.
struct View {
    picture: Picture,
    shown: Option<Frame>,
    globals: Buffer,
    globals_binding: wgpu::BindGroup,
    tile_origins: GrowingBuffer<[f32; 4]>,
    solid: GrowingBuffer<PlainVertex>,
    glass: GrowingBuffer<PlainVertex>,
    segments: GrowingBuffer<Segment>,
}

struct Picture {
    size_px: [u32; 2],
    samples: wgpu::TextureView,
    depth: wgpu::TextureView,
    finished: wgpu::Texture,
    finished_view: wgpu::TextureView,
    screen_binding: wgpu::BindGroup,
}

/// What the shader knows of the view: the struct of the same name there.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Globals {
    clip_from_eye: [[f32; 4]; 4],
    eye: [f32; 4],
    size_px: [f32; 2],
    ramp_m: [f32; 2],
    modes: [u32; 2],
    near_m: f32,
    parallel_depth_per_metre: f32,
    grid: [f32; 4],
    ramp: [[f32; 4]; 32],
}

impl Renderer {
    /// For pictures that [`Renderer::copy_to_screen`] copies into a target of format `target`.
    pub fn new(device: &Device, queue: &Queue, target: TextureFormat) -> Self {
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..wgpu::SamplerDescriptor::default()
        });
        let mut renderer = Self {
            device: device.clone(),
            queue: queue.clone(),
            pipelines: Pipelines::new(device, target),
            sampler,
            indices: new_buffer(device, size_of::<u32>(), BufferUsages::INDEX),
            indexed_quads: 0,
            tiles: BTreeMap::new(),
            views: BTreeMap::new(),
        };
        renderer.index(4096);
        renderer
    }

    /// The largest width and height a picture can have; larger ones are drawn at this size and stretched.
    pub fn largest_px(&self) -> u32 {
        self.device.limits().max_texture_dimension_2d
    }

    /// Draws `frame` as the picture of `view`: the commands for it, to be submitted; `None` if it shows it already.
    pub fn draw(&mut self, view: ViewId, frame: &Frame) -> Option<CommandBuffer> {
        let largest = self.largest_px();
        let size_px = frame.size_px.map(|px| px.clamp(1, largest));
        let mut current = match self.views.remove(&view) {
            Some(current) if current.picture.size_px == size_px => current,
            _ => self.new_view(size_px),
        };
        let commands = (current.shown.as_ref() != Some(frame)).then(|| {
            let commands = self.render(&mut current, frame);
            current.shown = Some(frame.clone());
            commands
        });
        self.views.insert(view, current);
        commands
    }

    /// Copies the picture of `view` over the viewport of a pass whose target has the format given to [`Renderer::new`].
    /// Does nothing before the first [`Renderer::draw`] of the view.
    pub fn copy_to_screen(&self, view: ViewId, pass: &mut wgpu::RenderPass<'_>) {
        if let Some(view) = self.views.get(&view) {
            pass.set_pipeline(&self.pipelines.screen);
            pass.set_bind_group(0, &view.picture.screen_binding, &[]);
            pass.draw(0..3, 0..1);
        }
    }

    /// Gives back what `view` needs.
    pub fn forget(&mut self, view: ViewId) {
        self.views.remove(&view);
    }

    /// The picture of `view`, of format `Rgba8Unorm`.
    pub(crate) fn picture(&self, view: ViewId) -> Option<&wgpu::Texture> {
        self.views.get(&view).map(|view| &view.picture.finished)
    }

    fn render(&mut self, view: &mut View, frame: &Frame) -> CommandBuffer {
        let [width, height] = view.picture.size_px.map(f64::from);
        let viewport = Viewport { width, height };
        let Frame { scene, camera, .. } = frame;
        self.tiles
            .retain(|_, tile| Arc::strong_count(&tile.mesh) > 1);
        let seen = seen_tiles(scene, camera, viewport);
        for mesh in &seen {
            self.upload(mesh);
        }
        let eye = camera.eye();
        let origins: Vec<_> = seen.iter().map(|mesh| origin_from_eye(mesh, eye)).collect();
        let sketch = Sketch::of(scene, camera, viewport);
        view.tile_origins.write(self, &origins);
        view.solid.write(self, &sketch.solid);
        view.glass.write(self, &sketch.glass);
        view.segments.write(self, &sketch.segments);
        let globals = globals(scene, camera, viewport);
        self.queue
            .write_buffer(&view.globals, 0, bytemuck::bytes_of(&globals));

        let mut encoder = self
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor {
                label: Some("map view"),
            });
        {
            let mut pass = begin_pass(&mut encoder, &view.picture, scene.look.background);
            pass.set_bind_group(0, &view.globals_binding, &[]);
            self.draw_voxels(&mut pass, view, &seen, scene.look.surfaces);
            self.draw_sketch(&mut pass, view, &sketch, scene.look.grid);
        }
        encoder.finish()
    }

    fn upload(&mut self, mesh: &Arc<TileMesh>) {
        let address = Arc::as_ptr(mesh) as usize;
        if self.tiles.contains_key(&address) {
            return;
        }
        let bytes: &[u8] = bytemuck::cast_slice(mesh.vertices());
        let vertices = (!bytes.is_empty()).then(|| {
            let buffer = new_buffer(&self.device, bytes.len(), BufferUsages::VERTEX);
            self.queue.write_buffer(&buffer, 0, bytes);
            buffer
        });
        self.index(mesh.quads());
        self.tiles.insert(
            address,
            GpuTile {
                mesh: Arc::clone(mesh),
                vertices,
            },
        );
    }

    /// Makes sure that there are indices for this many quads.
    fn index(&mut self, quads: usize) {
        if quads <= self.indexed_quads {
            return;
        }
        let quads = quads.next_power_of_two();
        let indices: Vec<u32> = (0..quads as u32)
            .flat_map(|quad| [0, 1, 2, 0, 2, 3].map(|corner| 4 * quad + corner))
            .collect();
        self.indices = new_buffer(
            &self.device,
            size_of_val(indices.as_slice()),
            BufferUsages::INDEX,
        );
        self.queue
            .write_buffer(&self.indices, 0, bytemuck::cast_slice(&indices));
        self.indexed_quads = quads;
    }

    fn draw_voxels(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        view: &View,
        seen: &[Arc<TileMesh>],
        surfaces: Surfaces,
    ) {
        pass.set_pipeline(&self.pipelines.voxels);
        pass.set_vertex_buffer(1, view.tile_origins.buffer.slice(..));
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint32);
        for (instance, mesh) in (0_u32..).zip(seen) {
            let quads = match surfaces {
                Surfaces::All => mesh.quads(),
                Surfaces::Observed => mesh.observed_quads(),
            };
            let uploaded = self.tiles.get(&(Arc::as_ptr(mesh) as usize));
            if let Some(vertices) = uploaded.and_then(|tile| tile.vertices.as_ref()) {
                pass.set_vertex_buffer(0, vertices.slice(..));
                pass.draw_indexed(0..6 * quads as u32, 0, instance..instance + 1);
            }
        }
    }

    fn draw_sketch(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        view: &View,
        sketch: &Sketch,
        has_grid: bool,
    ) {
        let Pipelines {
            hidden_solid,
            solid,
            ground,
            glass,
            lines,
            hidden_lines,
            casings,
            ..
        } = &self.pipelines;
        if !sketch.solid.is_empty() {
            pass.set_vertex_buffer(0, view.solid.buffer.slice(..));
            for pipeline in [hidden_solid, solid] {
                pass.set_pipeline(pipeline);
                pass.draw(0..sketch.solid.len() as u32, 0..1);
            }
        }
        if has_grid {
            pass.set_pipeline(ground);
            pass.draw(0..4, 0..1);
        }
        if !sketch.glass.is_empty() {
            pass.set_pipeline(glass);
            pass.set_vertex_buffer(0, view.glass.buffer.slice(..));
            pass.draw(0..sketch.glass.len() as u32, 0..1);
        }
        if !sketch.segments.is_empty() {
            pass.set_vertex_buffer(0, view.segments.buffer.slice(..));
            let segments = sketch.segments.len() as u32;
            pass.set_pipeline(hidden_lines);
            pass.draw(0..4, sketch.ground_segments as u32..segments);
            for pipeline in [casings, lines] {
                pass.set_pipeline(pipeline);
                pass.draw(0..4, 0..segments);
            }
        }
    }

    fn new_view(&self, size_px: [u32; 2]) -> View {
        let globals = new_buffer(&self.device, size_of::<Globals>(), BufferUsages::UNIFORM);
        let globals_binding = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("globals"),
            layout: &self.pipelines.globals_layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: globals.as_entire_binding(),
            }],
        });
        View {
            picture: self.new_picture(size_px),
            shown: None,
            globals,
            globals_binding,
            tile_origins: GrowingBuffer::new(&self.device),
            solid: GrowingBuffer::new(&self.device),
            glass: GrowingBuffer::new(&self.device),
            segments: GrowingBuffer::new(&self.device),
        }
    }

    fn new_picture(&self, size_px: [u32; 2]) -> Picture {
        let texture = |label, format, sample_count, usage| {
            self.device.create_texture(&wgpu::TextureDescriptor {
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
        let screen_binding = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("map view"),
            layout: &self.pipelines.screen_layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(&finished_view),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: wgpu::BindingResource::Sampler(&self.sampler),
                },
            ],
        });
        Picture {
            size_px,
            samples: whole(&texture("map view samples", COLOR, SAMPLES, drawn)),
            depth: whole(&texture("map view depth", DEPTH, SAMPLES, drawn)),
            finished,
            finished_view,
            screen_binding,
        }
    }
}

/// Near ones first: what they hide costs less.
fn seen_tiles(scene: &Scene, camera: &Camera3, viewport: Viewport) -> Vec<Arc<TileMesh>> {
    let mut seen: Vec<_> = scene
        .shared_meshes()
        .filter_map(|mesh| {
            let (low, high) = mesh.bounds()?;
            let middle = Point::from_raw(nalgebra::center(&low.raw, &high.raw));
            camera
                .may_see(low, high, viewport)
                .then(|| (camera.depth_m(middle), Arc::clone(mesh)))
        })
        .collect();
    seen.sort_by(|a, b| a.0.total_cmp(&b.0));
    seen.into_iter().map(|(_, mesh)| mesh).collect()
}

fn begin_pass<'a>(
    encoder: &'a mut wgpu::CommandEncoder,
    picture: &Picture,
    background: [u8; 3],
) -> wgpu::RenderPass<'a> {
    let [r, g, b] = background.map(|c| f64::from(c) / 255.0);
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("map view"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: &picture.samples,
            depth_slice: None,
            resolve_target: Some(&picture.finished_view),
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a: 1.0 }),
                store: wgpu::StoreOp::Discard,
            },
        })],
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: &picture.depth,
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

fn globals(scene: &Scene, camera: &Camera3, viewport: Viewport) -> Globals {
    let grid = Grid::of(camera);
    let eye = camera.eye().raw.map(|c| c as f32);
    // Lines and overlays on the floor lie within its voxels: half above it and half below.
    let lift_m = 1.5 * scene.resolution_m().max(0.01);
    let clip_from_eye = camera.clip_from_eye(viewport).map(|c| c as f32);
    Globals {
        clip_from_eye: clip_from_eye.into(),
        eye: [eye.x, eye.y, eye.z, lift_m as f32],
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

/// The tile's low corner from the eye and the edge of a voxel; the difference is taken before rounding.
fn origin_from_eye(mesh: &TileMesh, eye: Point<World>) -> [f32; 4] {
    let from_eye = mesh.origin - eye;
    [
        from_eye.raw.x as f32,
        from_eye.raw.y as f32,
        from_eye.raw.z as f32,
        mesh.resolution_m as f32,
    ]
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
    items: std::marker::PhantomData<T>,
}

impl<T: Pod> GrowingBuffer<T> {
    fn new(device: &Device) -> Self {
        Self {
            buffer: new_buffer(device, 16 * size_of::<T>(), BufferUsages::VERTEX),
            items: std::marker::PhantomData,
        }
    }

    fn write(&mut self, renderer: &Renderer, items: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(items);
        if bytes.len() as u64 > self.buffer.size() {
            self.buffer = new_buffer(
                &renderer.device,
                bytes.len().next_power_of_two(),
                BufferUsages::VERTEX,
            );
        }
        if !bytes.is_empty() {
            renderer.queue.write_buffer(&self.buffer, 0, bytes);
        }
    }
}

const _: () = assert!(size_of::<Vertex>() == 8, "the shader reads two words");
