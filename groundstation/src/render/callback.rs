//! The map view in an egui panel.
//!
//! ```no_run
//! # fn example(ui: &mut egui::Ui, state: &egui_wgpu::RenderState, scene: std::sync::Arc<groundstation::render::Scene>) {
//! use groundstation::render::{Camera3, ViewId, callback};
//!
//! callback::install(state); // once, when the window opens
//!
//! let (rect, _) = ui.allocate_exact_size(ui.available_size(), egui::Sense::click_and_drag());
//! ui.painter().add(callback::shape(rect, ViewId(0), scene, Camera3::default())); // each frame
//! # }
//! ```
//!
//! The picture is drawn in `prepare`, into a texture of its own, and only if something changed; `paint` copies it.

use std::sync::Arc;

use egui::{Pos2, Rect, pos2};
use egui_wgpu::{CallbackResources, CallbackTrait, RenderState, ScreenDescriptor};
use wgpu::{CommandBuffer, CommandEncoder, Device, Queue};

use super::camera::{Camera3, Viewport};
use super::gpu::{Frame, Renderer, ViewId};
use super::scene::Scene;

/// Makes the renderer and leaves it with egui's. Until this has been called, map views stay empty.
pub fn install(state: &RenderState) {
    let renderer = Renderer::new(&state.device, &state.queue, state.target_format);
    state.renderer.write().callback_resources.insert(renderer);
}

/// The map view as something egui paints: `scene` as `camera` sees it, in `rect`. Each panel has its own `view`.
pub fn shape(rect: Rect, view: ViewId, scene: Arc<Scene>, camera: Camera3) -> egui::Shape {
    let callback = MapCallback {
        rect,
        view,
        scene,
        camera,
    };
    egui_wgpu::Callback::new_paint_callback(rect, callback).into()
}

/// The size of a panel, in points: what camera methods are to be given together with [`pixel_at`].
pub fn viewport_of(rect: Rect) -> Viewport {
    Viewport {
        width: f64::from(rect.width()),
        height: f64::from(rect.height()),
    }
}

/// A position in the window as a pixel of the panel `rect`.
pub fn pixel_at(rect: Rect, position: Pos2) -> [f64; 2] {
    let from_corner = position - rect.min;
    [f64::from(from_corner.x), f64::from(from_corner.y)]
}

/// A pixel of the panel `rect` as a position in the window.
pub fn position_of(rect: Rect, pixel: [f64; 2]) -> Pos2 {
    pos2(rect.min.x + pixel[0] as f32, rect.min.y + pixel[1] as f32)
}

struct MapCallback {
    rect: Rect,
    view: ViewId,
    scene: Arc<Scene>,
    camera: Camera3,
}

impl CallbackTrait for MapCallback {
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
        let frame = Frame {
            scene: Arc::clone(&self.scene),
            camera: self.camera,
            size_px: [on_screen.width() as u32, on_screen.height() as u32],
        };
        renderer.draw(self.view, &frame).into_iter().collect()
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
        let largest = renderer.largest_px() as f32;
        let fits = on_screen.width() >= 1.0
            && on_screen.height() >= 1.0
            && on_screen.width() <= largest
            && on_screen.height() <= largest
            && on_screen.min.x >= -2.0 * largest
            && on_screen.min.y >= -2.0 * largest
            && on_screen.max.x < 2.0 * largest - 1.0
            && on_screen.max.y < 2.0 * largest - 1.0;
        if fits {
            let (min, size) = (on_screen.min, on_screen.size());
            pass.set_viewport(min.x, min.y, size.x, size.y, 0.0, 1.0);
            renderer.copy_to_screen(self.view, pass);
        }
    }
}

fn in_pixels(rect: Rect, pixels_per_point: f32) -> Rect {
    let round = |p: Pos2| {
        pos2(
            (p.x * pixels_per_point).round(),
            (p.y * pixels_per_point).round(),
        )
    };
    Rect::from_min_max(round(rect.min), round(rect.max))
}
