//! The mouse on the map: the point that is grabbed stays under the cursor.
//!
//! Left drag slides the map, right or middle drag turns it, the wheel goes nearer. A click is left to the caller.

use egui::{PointerButton, Response};
use maps::frame::{Point, World};

use super::callback::{pixel_at, viewport_of};
use super::camera::{Camera3, Ray};

/// A drag under way.
#[derive(Clone, Debug, Default)]
pub struct Navigation {
    grabbed: Option<Point<World>>,
}

impl Navigation {
    /// Half a turn for a drag over this many points.
    const HALF_TURN: f32 = 700.0;
    /// How much a point of the wheel brings nearer; a usual notch is 50.
    const PER_WHEEL_POINT: f64 = 0.004;

    /// Moves `camera` as the mouse over `response`'s panel asks. `touch` says where a ray meets the map or the ground,
    /// as [`super::pick::pick`] does; where it meets nothing, the view moves about a point as far away as the target.
    pub fn update(
        &mut self,
        response: &Response,
        camera: &mut Camera3,
        touch: impl Fn(Ray) -> Option<Point<World>>,
    ) {
        let viewport = viewport_of(response.rect);
        let seen_at = |camera: &Camera3, position: egui::Pos2| {
            let ray = camera.ray(pixel_at(response.rect, position), viewport);
            anchor(camera, ray, touch(ray))
        };
        let slides = response.dragged_by(PointerButton::Primary);
        let turns = response.dragged_by(PointerButton::Secondary)
            || response.dragged_by(PointerButton::Middle);
        if !slides && !turns {
            self.grabbed = None;
        } else if let Some(position) = response.interact_pointer_pos() {
            let delta = response.drag_delta();
            let grabbed = *self
                .grabbed
                .get_or_insert_with(|| seen_at(camera, position - delta));
            if slides {
                *camera = camera.panned(grabbed, pixel_at(response.rect, position), viewport);
            } else {
                let radians =
                    |points: f32| f64::from(points / Self::HALF_TURN) * std::f64::consts::PI;
                *camera = camera.orbited(grabbed, -radians(delta.x), radians(delta.y));
            }
        }
        let Some(position) = response.hover_pos() else {
            return;
        };
        let wheel = response.ctx.input(|input| input.smooth_scroll_delta().y);
        let pinch = response.ctx.input(egui::InputState::zoom_delta);
        let factor = (-f64::from(wheel) * Self::PER_WHEEL_POINT).exp() / f64::from(pinch);
        if factor.to_bits() != 1_f64.to_bits() && factor.is_finite() && factor > 0.0 {
            let anchor = seen_at(camera, position);
            *camera = camera.zoomed(anchor, factor);
        }
    }
}

/// What the mouse holds on to: what the ray meets, unless that is nothing or out of all proportion.
fn anchor(camera: &Camera3, ray: Ray, touched: Option<Point<World>>) -> Point<World> {
    let far_m = 20.0 * camera.distance_m();
    let at_target = || {
        let along = camera.axes()[2].dot(&ray.direction.raw);
        ray.at((camera.distance_m() - camera.depth_m(ray.origin)) / along)
    };
    touched
        .filter(|point| {
            let depth_m = camera.depth_m(*point);
            point.is_finite() && depth_m < far_m
        })
        .unwrap_or_else(at_target)
}
