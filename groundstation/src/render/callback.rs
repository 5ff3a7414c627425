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

#[cfg(test)]
mod tests {
    use egui::vec2;
    use egui_kittest::Harness;
    use egui_kittest::wgpu::{WgpuTestRenderer, create_render_state, default_wgpu_setup};
    use maps::frame::Point;
    use maps::voxel::{LogOdds, Rgb, Voxel, VoxelKey, VoxelMap};

    use super::*;

    /// A red square of 4 m with its middle at the origin, seen from above from 10 m, which is 8.28 m of height.
    fn red_square() -> Arc<Scene> {
        let mut map = VoxelMap::new(0.1);
        for x in -20..20 {
            for y in -20..20 {
                let color = Some(Rgb([248, 0, 0]));
                map.set_voxel(
                    VoxelKey { x, y, z: -1 },
                    Voxel {
                        color,
                        ..Voxel::new(LogOdds(70))
                    },
                );
            }
        }
        let mut scene = Scene::default();
        scene.look.grid = false;
        scene.update_map(&map, &map.tile_ids());
        Arc::new(scene)
    }

    /// Whether the panel `rect` of a window of 200 x 100 points shows red at these positions.
    fn reds<const N: usize>(rect: Rect, positions: [[u32; 2]; N]) -> [bool; N] {
        let state = create_render_state(
            default_wgpu_setup(),
            egui_wgpu::RendererOptions::PREDICTABLE,
        );
        install(&state);
        let scene = red_square();
        let mut window = Harness::builder()
            .with_size(vec2(200.0, 100.0))
            .renderer(WgpuTestRenderer::from_render_state(state))
            .build_ui(move |ui| {
                let camera = Camera3::default().top_down();
                ui.ctx()
                    .debug_painter()
                    .add(shape(rect, ViewId(0), Arc::clone(&scene), camera));
            });
        let image = window.render().expect("a picture");
        positions.map(|[x, y]| {
            let [r, g, b, _] = image.get_pixel(x, y).0;
            r > 200 && g < 30 && b < 30
        })
    }

    #[test]
    fn a_panel_shows_the_scene_and_nothing_beside_it() {
        let rect = Rect::from_min_size(pos2(100.0, 0.0), vec2(100.0, 100.0));
        // The square covers the middle 48 points of the panel.
        let shown = reds(rect, [[150, 50], [130, 30], [122, 50], [150, 78], [50, 50]]);
        assert_eq!(shown, [true, true, false, false, false]);
    }

    #[test]
    fn a_panel_that_is_partly_outside_the_window_keeps_its_proportions() {
        let rect = Rect::from_min_size(pos2(-50.0, 0.0), vec2(100.0, 100.0));
        let shown = reds(
            rect,
            [
                [2, 50],
                [22, 50],
                [28, 50],
                [2, 28],
                [2, 22],
                [2, 72],
                [2, 78],
            ],
        );
        assert_eq!(shown, [true, true, false, true, false, true, false]);
    }

    #[test]
    fn a_panel_without_room_is_no_trouble() {
        let rect = Rect::from_min_size(pos2(20.0, 20.0), vec2(0.0, 40.0));
        assert_eq!(reds(rect, [[20, 30]]), [false]);
    }

    #[test]
    fn pixels_and_positions_are_each_others_inverse() {
        let rect = Rect::from_min_size(pos2(30.0, 40.0), vec2(320.0, 240.0));
        let position = pos2(100.0, 90.0);
        assert_eq!(position_of(rect, pixel_at(rect, position)), position);
        let camera = Camera3::default();
        let pixel = camera
            .project(Point::origin(), viewport_of(rect))
            .expect("in view");
        assert!(
            (position_of(rect, pixel) - rect.center()).length() < 1e-3,
            "the target is in the middle"
        );
    }
}
