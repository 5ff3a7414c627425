//! The 3-D view.

use std::sync::Arc;

use egui::{Align2, Color32, FontId, PointerButton, Rect, Sense, Ui, pos2, vec2};
use maps::frame::{Body, Isometry, World};
use nalgebra::Point3;
use sitl::depth_camera::d455;
use sitl::scene::RoadUser;
use sitl::truth;

use super::{App, Follow, Layer};
use crate::view::eye::Eye;
use crate::view::gpu::{self, Drawing};
use crate::view::sensors::Wanted;
use crate::view::sketch;
use crate::view::worker::{Loaded, VoxelMesh};

/// So many points of dragging are half a turn.
const HALF_TURN: f64 = 700.0;
const PER_WHEEL_POINT: f64 = 0.002;
/// Labels of what is farther away would only be clutter.
const LABELS_M: f64 = 60.0;

impl App {
    pub(super) fn scene_ui(&mut self, ui: &mut Ui) {
        let size = ui.available_size().max(vec2(1.0, 1.0));
        let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
        response.widget_info(|| {
            egui::WidgetInfo::labeled(egui::Role::Canvas, true, "scene in three dimensions")
        });
        let in_points = [f64::from(rect.width()), f64::from(rect.height())];
        self.drag(&response);
        let painter = ui.painter_at(rect);
        painter.rect_filled(rect, 0.0, Color32::from_rgb(34, 37, 43));
        let Some(loaded) = self.current().cloned() else {
            let text = self.failed.map_or_else(
                || format!("preparing {} {}", self.scene.0, self.scene.1),
                |error| error.to_string(),
            );
            let font = FontId::proportional(18.0);
            let middle = rect.center();
            painter.text(middle, Align2::CENTER_CENTER, text, font, Color32::WHITE);
            return;
        };
        let wanted = self.wanted();
        let eye = self.eye(&loaded, in_points);
        let users = truth::boxes(&loaded.scene, wanted.at);
        let drawing = self.draw(&loaded, &wanted, eye, &users);
        painter.add(gpu::shape(rect, drawing));
        if self.layers.has(Layer::Labels) {
            labels(&painter, rect, &eye, &users);
        }
        self.captions(&painter, rect, &wanted);
    }

    fn drag(&mut self, response: &egui::Response) {
        let shift = response.ctx.input(|input| input.modifiers.shift);
        let is_primary = response.dragged_by(PointerButton::Primary);
        let pans = response.dragged_by(PointerButton::Secondary)
            || response.dragged_by(PointerButton::Middle)
            || (is_primary && shift);
        let delta = response.drag_delta();
        let [right, down] = [delta.x, delta.y].map(f64::from);
        if pans {
            let per_point = self.orbit.distance_m / 600.0;
            let base_rad = self.base().map_or(0.0, |(_, heading)| heading);
            self.orbit
                .shift(-right * per_point, 1.6 * down * per_point, base_rad);
        } else if is_primary {
            let turn = std::f64::consts::PI / HALF_TURN;
            self.orbit.turn(-right * turn, down * turn);
        }
        if (pans || is_primary) && self.follow == Follow::Camera {
            // Who turns an eye that sits in a camera takes it out.
            self.follow = Follow::Drone;
        }
        if response.hovered() {
            let wheel = response.ctx.input(|input| input.smooth_scroll_delta().y);
            let pinch = response.ctx.input(egui::InputState::zoom_delta);
            self.orbit
                .zoom((-f64::from(wheel) * PER_WHEEL_POINT).exp() / f64::from(pinch).max(0.01));
        }
    }

    /// What the eye goes with: its place and its heading.
    pub(super) fn base(&self) -> Option<(Point3<f64>, f64)> {
        let scene = &self.current()?.scene;
        let wanted = self.wanted();
        let of = |pose: Isometry<World, Body>, up_m: f64| {
            let ahead = pose.rotation() * nalgebra::Vector3::x();
            let place = pose.translation().raw + nalgebra::Vector3::z() * up_m;
            (place, ahead.y.atan2(ahead.x))
        };
        Some(match self.follow {
            Follow::Free => (Point3::origin(), 0.0),
            Follow::Drone | Follow::Camera => of(wanted.uav(scene), 0.0),
            Follow::Ground => of(wanted.ugv(scene), 1.0),
        })
    }

    pub(super) fn eye(&self, loaded: &Loaded, size: [f64; 2]) -> Eye {
        if self.follow == Follow::Camera {
            let pose = self.wanted().uav_camera(&loaded.scene);
            return Eye::of_camera(pose, &d455(), size);
        }
        let (place, heading_rad) = self.base().unwrap_or((Point3::origin(), 0.0));
        self.orbit.eye(place, heading_rad)
    }

    fn draw(
        &mut self,
        loaded: &Arc<Loaded>,
        wanted: &Wanted,
        eye: Eye,
        users: &[RoadUser],
    ) -> Arc<Drawing> {
        let now = (*wanted, eye, self.layers, self.answers);
        if let Some((shown, drawing)) = &self.drawing
            && *shown == now
        {
            return Arc::clone(drawing);
        }
        let moving = match &self.moving {
            Some((at, moving)) if *at == wanted.at => Arc::clone(moving),
            _ => Arc::new(loaded.diorama.moving(&loaded.scene, wanted.at)),
        };
        self.moving = Some((wanted.at, Arc::clone(&moving)));
        let mut drawing = Drawing {
            eye,
            loaded: Arc::clone(loaded),
            shows_surfaces: self.layers.has(Layer::Surfaces),
            voxels: None,
            moving,
            solid: Vec::new(),
            glass: Vec::new(),
            segments: Vec::new(),
            dots: Vec::new(),
        };
        self.sketch(&mut drawing, wanted, users);
        let drawing = Arc::new(drawing);
        self.drawing = Some((now, Arc::clone(&drawing)));
        drawing
    }

    fn sketch(&self, drawing: &mut Drawing, wanted: &Wanted, users: &[RoadUser]) {
        let scene = &drawing.loaded.scene;
        if drawing.shows_surfaces {
            sketch::shadows(users, &mut drawing.glass);
        }
        if self.layers.has(Layer::Boxes) {
            sketch::boxes(users, &mut drawing.segments);
        }
        let ugv = wanted.ugv(scene).raw;
        let is_in_scene = users
            .iter()
            .any(|user| user.thing.class == sitl::scene::Class::Robot);
        if wanted.poses.ugv.is_some() || !is_in_scene {
            sketch::rover(&ugv, &mut drawing.solid);
        }
        sketch::heading(&ugv, &mut drawing.segments);
        if self.follow != Follow::Camera {
            let uav = wanted.uav(scene).raw;
            sketch::drone(&uav, &mut drawing.solid, &mut drawing.segments);
            if self.layers.has(Layer::Frustum) {
                let pose = wanted.uav_camera(scene);
                sketch::frustum(pose, &mut drawing.segments, &mut drawing.glass);
            }
        }
        if let Some(cloud) = &self.cloud
            && wanted.lidar
            && cloud.of.scene == wanted.scene
        {
            drawing.dots = sketch::dots(&cloud.echoes, self.layers.colouring);
        }
        if wanted.voxels {
            let of_scene = |mesh: &&Arc<VoxelMesh>| mesh.of.scene == wanted.scene;
            drawing.voxels = self.voxels.as_ref().filter(of_scene).cloned();
        }
    }

    fn captions(&self, painter: &egui::Painter, rect: Rect, wanted: &Wanted) {
        let mut lines = vec![format!("{}  seed {}", wanted.scene.0, wanted.scene.1)];
        if let Some(cloud) = self.cloud.as_ref().filter(|_| wanted.lidar) {
            let age = super::pictures::age(&cloud.of, wanted);
            let age = age.map_or(String::new(), |age| format!(", {age}"));
            lines.push(format!("LiDAR: {} returns{age}", cloud.echoes.len()));
        }
        if self.rate_hz > 0.0 && self.time.is_playing() {
            lines.push(format!("{:.0} pictures a second", self.rate_hz));
        }
        if let Some(history) = &self.history {
            lines.extend(history.lines().iter().cloned());
        }
        let at = rect.left_top() + vec2(10.0, 8.0);
        let colour = Color32::from_rgb(235, 240, 245);
        let text = lines.join("\n");
        let galley = painter.layout_no_wrap(text, FontId::proportional(13.0), colour);
        let around = Rect::from_min_size(at, galley.size()).expand(5.0);
        painter.rect_filled(around, 4.0, Color32::from_black_alpha(130));
        painter.galley(at, galley, colour);
    }
}

/// What road users are, and how fast, above each.
fn labels(painter: &egui::Painter, rect: Rect, eye: &Eye, users: &[RoadUser]) {
    let size = [f64::from(rect.width()), f64::from(rect.height())];
    for user in users {
        let up = nalgebra::Vector3::z() * (user.thing.size.z / 2.0 + 0.25);
        let top = user.thing.centre() + up;
        if (top - eye.position).norm() > LABELS_M {
            continue;
        }
        let Some([x, y]) = eye.pixel(top, size) else {
            continue;
        };
        let speed = user.velocity.norm();
        let class = format!("{:?}", user.thing.class).to_lowercase();
        let text = if speed > 0.05 {
            format!("{class} {speed:.1} m/s")
        } else {
            class
        };
        let at = rect.min + vec2(x as f32, y as f32);
        let font = FontId::proportional(11.0);
        let shadow = at + vec2(1.0, 1.0);
        painter.text(
            shadow,
            Align2::CENTER_BOTTOM,
            &text,
            font.clone(),
            Color32::BLACK,
        );
        painter.text(
            pos2(at.x, at.y),
            Align2::CENTER_BOTTOM,
            &text,
            font,
            Color32::WHITE,
        );
    }
}
