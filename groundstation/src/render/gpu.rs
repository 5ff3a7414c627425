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

use maps::frame::{Point, World};
use wgpu::{Buffer, BufferUsages, CommandBuffer, Device, Queue, TextureFormat};

use super::camera::{Camera3, Viewport};
use super::mesh::TileMesh;
use super::pipelines::Pipelines;
use super::scene::Scene;
use super::sketch::Sketch;
use super::view::{Globals, View, new_buffer};

/// Which of several views of the map in one window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ViewId(pub u64);

/// What one picture shows.
#[derive(Clone, Debug)]
pub struct Frame {
    /// What there is.
    pub scene: Arc<Scene>,
    /// From where it is seen.
    pub camera: Camera3,
    /// Width and height of the picture in pixels.
    pub size_px: [u32; 2],
}

impl PartialEq for Frame {
    /// Scenes in the same place are the same; the others are compared.
    fn eq(&self, other: &Self) -> bool {
        self.size_px == other.size_px
            && self.camera == other.camera
            && (Arc::ptr_eq(&self.scene, &other.scene) || self.scene == other.scene)
    }
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
            _ => View::new(&self.device, &self.pipelines, &self.sampler, size_px),
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
        let (device, queue) = (&self.device, &self.queue);
        view.tile_origins.write(device, queue, &origins);
        view.solid.write(device, queue, &sketch.solid);
        view.glass.write(device, queue, &sketch.glass);
        view.segments.write(device, queue, &sketch.segments);
        let globals = Globals::of(scene, camera, viewport);
        self.queue
            .write_buffer(&view.globals, 0, bytemuck::bytes_of(&globals));

        let mut encoder = self
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor {
                label: Some("map view"),
            });
        {
            let mut pass = view.picture.begin_pass(&mut encoder, scene.look.background);
            pass.set_bind_group(0, &view.globals_binding, &[]);
            self.draw_voxels(&mut pass, view, &seen);
            let ground_segments = sketch.ground_segments as u32;
            self.draw_sketch(&mut pass, view, ground_segments, scene.look.grid);
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

    fn draw_voxels(&self, pass: &mut wgpu::RenderPass<'_>, view: &View, seen: &[Arc<TileMesh>]) {
        pass.set_pipeline(&self.pipelines.voxels);
        pass.set_vertex_buffer(1, view.tile_origins.buffer.slice(..));
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint32);
        for (instance, mesh) in (0_u32..).zip(seen) {
            let uploaded = self.tiles.get(&(Arc::as_ptr(mesh) as usize));
            if let Some(vertices) = uploaded.and_then(|tile| tile.vertices.as_ref()) {
                pass.set_vertex_buffer(0, vertices.slice(..));
                pass.draw_indexed(0..6 * mesh.quads() as u32, 0, instance..instance + 1);
            }
        }
    }

    fn draw_sketch(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        view: &View,
        ground_segments: u32,
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
        pass.set_vertex_buffer(0, view.solid.buffer.slice(..));
        for pipeline in [hidden_solid, solid] {
            pass.set_pipeline(pipeline);
            pass.draw(0..view.solid.items, 0..1);
        }
        if has_grid {
            pass.set_pipeline(ground);
            pass.draw(0..4, 0..1);
        }
        pass.set_pipeline(glass);
        pass.set_vertex_buffer(0, view.glass.buffer.slice(..));
        pass.draw(0..view.glass.items, 0..1);

        let segments = view.segments.items;
        pass.set_vertex_buffer(0, view.segments.buffer.slice(..));
        pass.set_pipeline(hidden_lines);
        pass.draw(0..4, ground_segments.min(segments)..segments);
        for pipeline in [casings, lines] {
            pass.set_pipeline(pipeline);
            pass.draw(0..4, 0..segments);
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
