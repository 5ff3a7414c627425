//! Text and instruments drawn over the map: names, the scale, what is under the cursor, the colours' meaning.

use egui::{Align2, Color32, FontFamily, FontId, Painter, Pos2, Rect, Stroke, Vec2};

use super::{MapView, touched};
use crate::model::Model;
use crate::model::vehicle::Presence;
use crate::render::{self, Coloring};
use crate::view::layers::Layer;
use crate::view::{theme, widgets};

const SMALL: FontId = FontId::new(11.0, FontFamily::Proportional);
const DIGITS: FontId = FontId::new(11.0, FontFamily::Monospace);
/// The scale is about this wide.
const SCALE_PX: f64 = 120.0;

/// The vehicles' names and the grid's numbers.
pub(super) fn labels(painter: &Painter, rect: Rect, model: &Model, view: &MapView) {
    if view.layers.shows(Layer::Grid) {
        for label in render::grid::labels(&view.camera, view.viewport) {
            let at = render::callback::position_of(rect, label.pixel);
            painter.text(
                at,
                Align2::CENTER_CENTER,
                label.text,
                SMALL,
                theme::DIM.gamma_multiply(0.7),
            );
        }
    }
    for vehicle in model.vehicles.values() {
        let Some(position) = vehicle.position else {
            continue;
        };
        let Some(pixel) = view.camera.project(position.value, view.viewport) else {
            continue;
        };
        let mut text = vehicle.name();
        if vehicle.presence(model.now) == Presence::Lost {
            text = format!("{text}  {} ago", widgets::age_text(position.age(model.now)));
        }
        let at = render::callback::position_of(rect, pixel) + Vec2::new(16.0, -18.0);
        tag(painter, at, &text, theme::vehicle(vehicle.id));
    }
}

/// Words on a dark ground, readable over any map.
fn tag(painter: &Painter, at: Pos2, text: &str, ink: Color32) {
    let galley = painter.layout_no_wrap(
        text.to_owned(),
        FontId::new(12.5, FontFamily::Proportional),
        ink,
    );
    let ground = Rect::from_min_size(at, galley.size()).expand2(Vec2::new(5.0, 2.0));
    painter.rect_filled(ground, 3.0, theme::GROUND.gamma_multiply(0.8));
    painter.galley(at, galley, ink);
}

/// Scale bar, place under the cursor, legend.
pub(super) fn instruments(
    painter: &Painter,
    rect: Rect,
    model: &Model,
    view: &MapView,
    cursor: Option<Pos2>,
) {
    let per_metre = view
        .camera
        .pixels_per_metre(view.camera.target(), view.viewport);
    let corner = rect.left_bottom() + Vec2::new(14.0, -14.0);
    if let Some((metres, width)) = scale(per_metre) {
        let end = corner + Vec2::new(width as f32, 0.0);
        let line = Stroke::new(1.5, theme::TEXT);
        painter.line_segment([corner, end], line);
        for tick in [corner, end] {
            painter.line_segment([tick, tick - Vec2::new(0.0, 6.0)], line);
        }
        let middle = corner + Vec2::new(width as f32 / 2.0, -4.0);
        painter.text(
            middle,
            Align2::CENTER_BOTTOM,
            format!("{metres} m"),
            SMALL,
            theme::TEXT,
        );
    }
    if let Some(cursor) = cursor {
        let ray = view
            .camera
            .ray(render::callback::pixel_at(rect, cursor), view.viewport);
        if let Some(place) = touched(model, &view.scene, ray) {
            let [x, y, z] = place.raw.coords.into();
            let text = format!("E {x:+.2}  N {y:+.2}  up {z:+.2} m");
            let at = corner + Vec2::new(SCALE_PX as f32 * 1.6, 0.0);
            painter.text(at, Align2::LEFT_BOTTOM, text, DIGITS, theme::TEXT);
        }
    }
    if view.coloring == Coloring::Height && model.map.tiles() > 0 {
        legend(painter, rect, view.scene.heights_m());
    }
    if model.map.tiles() == 0 && model.vehicles.is_empty() {
        let text = "Nothing has been received yet.";
        painter.text(
            rect.center(),
            Align2::CENTER_CENTER,
            text,
            FontId::proportional(15.0),
            theme::DIM,
        );
    }
}

/// A round number of metres and its width on the screen.
fn scale(pixels_per_metre: f64) -> Option<(f64, f64)> {
    let wanted = SCALE_PX / pixels_per_metre;
    if !(wanted.is_finite() && wanted > 0.0) {
        return None;
    }
    let decade = 10_f64.powf(wanted.log10().floor());
    let times = [5.0, 2.0, 1.0]
        .into_iter()
        .find(|times| times * decade <= wanted)?;
    // Rounded, so that 0.2 does not print as 0.2000001.
    let metres = (times * decade * 1e6).round() / 1e6;
    Some((metres, metres * pixels_per_metre))
}

fn legend(painter: &Painter, rect: Rect, [low_m, high_m]: [f64; 2]) {
    const SIZE: Vec2 = Vec2::new(12.0, 140.0);
    let area = Rect::from_min_size(rect.right_bottom() - SIZE - Vec2::new(58.0, 24.0), SIZE);
    let steps: u16 = 35;
    for step in 0..steps {
        let share = f64::from(step) / f64::from(steps - 1);
        let [r, g, b] = render::ramp::ramp(share);
        let top = area.bottom() - (f32::from(step) + 1.0) * SIZE.y / f32::from(steps);
        let band = Rect::from_min_size(
            Pos2::new(area.left(), top),
            Vec2::new(SIZE.x, SIZE.y / f32::from(steps) + 0.5),
        );
        painter.rect_filled(band, 0.0, Color32::from_rgb(r, g, b));
    }
    for (height_m, y) in [(high_m, area.top()), (low_m, area.bottom())] {
        let at = Pos2::new(area.right() + 6.0, y);
        painter.text(
            at,
            Align2::LEFT_CENTER,
            format!("{height_m:.1} m"),
            SMALL,
            theme::TEXT,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_is_a_round_number_that_fits() {
        for (per_metre, metres) in [
            (100.0, 1.0),
            (59.0, 2.0),
            (24.0, 5.0),
            (1000.0, 0.1),
            (0.05, 2000.0),
        ] {
            let (shown, width) = scale(per_metre).expect("a scale");
            assert!(
                (shown - metres).abs() < 1e-9,
                "{per_metre} px/m shows {shown} m"
            );
            assert!(width <= SCALE_PX + 1e-9 && width > SCALE_PX / 2.6);
        }
        assert_eq!(scale(f64::NAN), None);
        assert_eq!(scale(0.0), None);
    }
}
