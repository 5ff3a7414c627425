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

#[cfg(test)]
mod tests {
    use egui::{Event, Modifiers, MouseWheelUnit, Pos2, Rect, Sense, pos2, vec2};
    use egui_kittest::Harness;

    use super::*;
    use crate::render::callback::position_of;

    struct Panel {
        camera: Camera3,
        navigation: Navigation,
        rect: Rect,
    }

    fn on_ground(ray: Ray) -> Option<Point<World>> {
        ray.distance_to_height_m(0.0).map(|m| ray.at(m))
    }

    impl Panel {
        fn ground_at(&self, position: Pos2) -> Point<World> {
            let ray = self
                .camera
                .ray(pixel_at(self.rect, position), viewport_of(self.rect));
            on_ground(ray).expect("below the horizon")
        }
    }

    fn window() -> Harness<'static, Panel> {
        let panel = Panel {
            camera: Camera3::default(),
            navigation: Navigation::default(),
            rect: Rect::NOTHING,
        };
        let mut window = Harness::builder()
            .with_size(vec2(400.0, 300.0))
            .build_ui_state(
                |ui, panel: &mut Panel| {
                    let (rect, response) =
                        ui.allocate_exact_size(ui.available_size(), Sense::click_and_drag());
                    response
                        .widget_info(|| egui::WidgetInfo::labeled(egui::Role::Canvas, true, "map"));
                    panel.rect = rect;
                    panel
                        .navigation
                        .update(&response, &mut panel.camera, on_ground);
                },
                panel,
            );
        window.run_steps(2);
        window
    }

    fn press(window: &Harness<'_, Panel>, pos: Pos2, button: PointerButton, pressed: bool) {
        window.event(Event::PointerButton {
            pos,
            button,
            pressed,
            modifiers: Modifiers::NONE,
        });
    }

    fn drag(window: &mut Harness<'_, Panel>, button: PointerButton, path: &[Pos2]) {
        window.event(Event::PointerMoved(path[0]));
        press(window, path[0], button, true);
        window.step();
        for &position in path {
            window.event(Event::PointerMoved(position));
            window.step();
        }
        press(window, path[path.len() - 1], button, false);
        window.run_steps(2);
    }

    /// Points of the screen are single precision.
    const TOLERANCE_PX: f32 = 0.05;

    #[track_caller]
    fn check_is_under(panel: &Panel, point: Point<World>, position: Pos2) {
        let pixel = panel
            .camera
            .project(point, viewport_of(panel.rect))
            .expect("in view");
        let seen = position_of(panel.rect, pixel);
        assert!(
            (seen - position).length() < TOLERANCE_PX,
            "{point:?} is at {seen:?}, not {position:?}"
        );
    }

    #[test]
    fn a_left_drag_keeps_the_grabbed_ground_under_the_cursor() {
        let mut window = window();
        let path = [pos2(150.0, 180.0), pos2(190.0, 200.0), pos2(260.0, 150.0)];
        let grabbed = window.state().ground_at(path[0]);
        let pitch_rad = window.state().camera.pitch_rad();
        drag(&mut window, PointerButton::Primary, &path);
        check_is_under(window.state(), grabbed, path[2]);
        assert!(
            (window.state().camera.pitch_rad() - pitch_rad).abs() < 1e-12,
            "it only slides"
        );
    }

    #[test]
    fn a_right_drag_turns_about_the_grabbed_ground() {
        let mut window = window();
        let path = [pos2(250.0, 200.0), pos2(300.0, 220.0), pos2(330.0, 240.0)];
        let grabbed = window.state().ground_at(path[0]);
        let before = window.state().camera;
        drag(&mut window, PointerButton::Secondary, &path);
        check_is_under(window.state(), grabbed, path[0]);
        let after = window.state().camera;
        assert!(after.pitch_rad() > before.pitch_rad(), "down is steeper");
        assert!(
            after.heading_rad() < before.heading_rad(),
            "to the right turns the map counter-clockwise"
        );
    }

    #[test]
    fn the_wheel_goes_nearer_to_what_is_under_the_cursor() {
        let mut window = window();
        let position = pos2(120.0, 220.0);
        let aimed = window.state().ground_at(position);
        let before_m = (window.state().camera.eye() - aimed).norm();
        window.event(Event::PointerMoved(position));
        window.event(Event::MouseWheel {
            unit: MouseWheelUnit::Point,
            delta: vec2(0.0, 100.0),
            phase: egui::TouchPhase::Move,
            source: egui::MouseWheelSource::Wheel,
            modifiers: Modifiers::NONE,
        });
        window.run_steps(30);
        check_is_under(window.state(), aimed, position);
        let after_m = (window.state().camera.eye() - aimed).norm();
        assert!(
            (0.3..0.9).contains(&(after_m / before_m)),
            "{before_m} m before, {after_m} m after"
        );
    }

    #[test]
    fn the_sky_can_be_grabbed_too() {
        let mut window = window();
        let before = window.state().camera;
        let level = Camera3::looking_at(before.target(), 1.0, -0.3, 10.0);
        window.state_mut().camera = level;
        drag(
            &mut window,
            PointerButton::Primary,
            &[pos2(200.0, 100.0), pos2(240.0, 130.0)],
        );
        let after = window.state().camera;
        assert!(
            after != level && (after.target() - level.target()).norm() < 5.0,
            "{after:?}"
        );
    }
}
