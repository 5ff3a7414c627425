//! Small things that several views are made of.

use std::time::Duration;

use egui::{
    Color32, CornerRadius, Id, Pos2, Rect, Response, RichText, Role, Sense, Shape, Stroke,
    StrokeKind, TextStyle, Ui, Vec2, WidgetInfo,
};
use maps::time::Stamp;

use super::theme;
use crate::model::{Freshness, Timed};
use crate::modes::Kind;

/// How long a button must be held, and what happens then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hold {
    span: Duration,
    consequence: &'static str,
}

impl Hold {
    /// For a start, a landing, an upload: half a second prevents a slip and costs no safety.
    pub const fn short(consequence: &'static str) -> Self {
        Self {
            span: Duration::from_millis(500),
            consequence,
        }
    }

    /// For what starts or stops motors.
    pub const fn long(consequence: &'static str) -> Self {
        Self {
            span: Duration::from_secs(1),
            consequence,
        }
    }
}

/// A button that acts only when it was held down for `span`; letting go before cancels. `label` names the target: another
/// label is another button, so a hold ends when the active vehicle changes.
pub fn hold_button(ui: &mut Ui, label: &str, hold: Hold, enabled: bool) -> bool {
    let span = hold.span;
    let font = TextStyle::Button.resolve(ui.style());
    let ink = if enabled {
        theme::TEXT
    } else {
        theme::DIM.gamma_multiply(0.6)
    };
    let galley = ui.painter().layout_no_wrap(label.to_owned(), font, ink);
    let wanted = galley.size() + 2.0 * ui.spacing().button_padding;
    let size = Vec2::new(wanted.x, wanted.y.max(ui.spacing().interact_size.y));
    let (rect, _) = ui.allocate_exact_size(size, Sense::hover());
    let id = ui.scope_id().with(("hold", label));
    let sense = if enabled {
        Sense::click_and_drag()
    } else {
        Sense::hover()
    };
    let response = ui.interact(rect, id, sense);
    response.widget_info(|| WidgetInfo::labeled(Role::Button, enabled, label));
    let (progress, done) = hold_progress(ui, &response, id, span, enabled);
    let visuals = if enabled {
        ui.style().interact(&response)
    } else {
        &ui.visuals().widgets.noninteractive
    };
    let (fill, line) = (visuals.weak_bg_fill, visuals.bg_stroke);
    let painter = ui.painter();
    painter.rect(rect, CornerRadius::same(4), fill, line, StrokeKind::Inside);
    if progress > 0.0 {
        let filled =
            Rect::from_min_size(rect.min, Vec2::new(rect.width() * progress, rect.height()));
        painter.rect_filled(
            filled,
            CornerRadius::same(4),
            theme::CYAN.gamma_multiply(0.45),
        );
    }
    painter.galley(rect.center() - galley.size() / 2.0, galley, ink);
    let seconds = span.as_secs_f32();
    response.on_hover_text(format!(
        "{}\npress and hold for {seconds} s",
        hold.consequence
    ));
    done
}

/// How much of the hold has passed, and whether it has just been completed.
fn hold_progress(
    ui: &Ui,
    response: &Response,
    id: Id,
    span: Duration,
    enabled: bool,
) -> (f32, bool) {
    let now = ui.input(|input| input.time);
    let held = enabled && response.is_pointer_button_down_on();
    // When it was pressed; infinity once it has acted, until it is released.
    let pressed: Option<f64> = ui.data(|data| data.get_temp(id));
    if !held {
        if pressed.is_some() {
            ui.data_mut(|data| data.remove::<f64>(id));
        }
        return (0.0, false);
    }
    let pressed = pressed.unwrap_or(now);
    ui.ctx().request_repaint();
    let passed = now - pressed;
    let done = passed >= span.as_secs_f64();
    ui.data_mut(|data| data.insert_temp(id, if done { f64::INFINITY } else { pressed }));
    if pressed.is_infinite() {
        return (1.0, false);
    }
    ((passed / span.as_secs_f64()).clamp(0.0, 1.0) as f32, done)
}

/// A heading in small letters.
pub fn caption(ui: &mut Ui, text: &str) {
    ui.label(
        RichText::new(text.to_uppercase())
            .text_style(theme::caption())
            .color(theme::DIM),
    );
}

/// A group of things on a card.
pub fn card<R>(ui: &mut Ui, accent: Color32, contents: impl FnOnce(&mut Ui) -> R) -> R {
    let frame = egui::Frame::new()
        .fill(theme::CARD)
        .corner_radius(6)
        .inner_margin(egui::Margin::symmetric(10, 8));
    let shown = frame.show(ui, |ui| {
        ui.set_width(ui.available_width());
        contents(ui)
    });
    let rect = shown.response.rect;
    let edge = Rect::from_min_size(rect.min, Vec2::new(3.0, rect.height()));
    ui.painter()
        .rect_filled(edge, CornerRadius::same(2), accent);
    shown.inner
}

/// A named value: dimmed with its age when old, dashes when too old to be believed.
pub fn value_ui<T>(
    ui: &mut Ui,
    name: &str,
    value: Option<&Timed<T>>,
    (now, period): (Stamp, Duration),
    text: impl FnOnce(&T) -> String,
) {
    ui.label(
        RichText::new(name)
            .text_style(TextStyle::Small)
            .color(theme::DIM),
    );
    let Some(value) = value else {
        ui.label(RichText::new("–").monospace().color(theme::DIM));
        ui.end_row();
        return;
    };
    let (words, age) = (text(&value.value), age_text(value.age(now)));
    match value.freshness(now, period) {
        Freshness::Fresh => ui.label(RichText::new(words).monospace().color(theme::TEXT)),
        Freshness::Old => ui.label(
            RichText::new(format!("{words}  {age} ago"))
                .monospace()
                .color(theme::DIM),
        ),
        Freshness::Lost => {
            let dashes = ui.label(RichText::new("– – –").monospace().color(theme::DIM));
            dashes.on_hover_text(format!("last {words}, {age} ago"))
        }
    };
    ui.end_row();
}

/// A span of time in at most three words: `0.4 s`, `12 s`, `03:25`.
pub fn age_text(age: Duration) -> String {
    let seconds = age.as_secs();
    if seconds < 10 {
        format!("{:.1} s", age.as_secs_f64())
    } else if seconds < 60 {
        format!("{seconds} s")
    } else {
        format!("{:02}:{:02}", seconds / 60, seconds % 60)
    }
}

/// Bytes in a unit that fits.
pub fn bytes_text(bytes: f64) -> String {
    if bytes < 1e3 {
        format!("{bytes:.0} B")
    } else if bytes < 1e6 {
        format!("{:.1} kB", bytes / 1e3)
    } else {
        format!("{:.1} MB", bytes / 1e6)
    }
}

/// The symbol of a vehicle: a square that stands on its tip flies, one that lies drives; hollow when it is lost.
pub fn symbol(center: Pos2, radius: f32, kind: Kind, color: Color32, hollow: bool) -> Shape {
    let (x, y) = (Vec2::new(radius, 0.0), Vec2::new(0.0, radius));
    let corners = if kind.flies() {
        vec![center - y, center + x, center + y, center - x]
    } else {
        let s = 0.8;
        vec![
            center - x * s - y * s,
            center + x * s - y * s,
            center + x * s + y * s,
            center - x * s + y * s,
        ]
    };
    if hollow {
        Shape::closed_line(corners, Stroke::new(1.5, color))
    } else {
        Shape::convex_polygon(corners, color, Stroke::NONE)
    }
}

/// A sign before words, so that colour is never the only cue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sign {
    /// A triangle: look here.
    Attention,
    /// A tick: this is done.
    Done,
    /// A cross: this came to nothing.
    Failed,
}

/// Draws a sign as high as the text beside it.
pub fn sign(ui: &mut Ui, sign: Sign, color: Color32) {
    let side = ui.text_style_height(&TextStyle::Body) * 0.8;
    let (rect, _) = ui.allocate_exact_size(Vec2::splat(side), Sense::hover());
    let at = |x: f32, y: f32| rect.min + Vec2::new(x, y) * side;
    let line = Stroke::new(1.8, color);
    let painter = ui.painter();
    match sign {
        Sign::Attention => {
            let corners = vec![at(0.5, 0.05), at(1.0, 0.95), at(0.0, 0.95)];
            painter.add(Shape::convex_polygon(corners, color, Stroke::NONE));
            let dark = Stroke::new(1.6, theme::GROUND);
            painter.line_segment([at(0.5, 0.35), at(0.5, 0.65)], dark);
            painter.line_segment([at(0.5, 0.76), at(0.5, 0.86)], dark);
        }
        Sign::Done => {
            painter.line(vec![at(0.1, 0.55), at(0.4, 0.85), at(0.95, 0.2)], line);
        }
        Sign::Failed => {
            painter.line_segment([at(0.15, 0.15), at(0.85, 0.85)], line);
            painter.line_segment([at(0.85, 0.15), at(0.15, 0.85)], line);
        }
    }
}

/// A sign and words in one colour.
pub fn signed(ui: &mut Ui, which: Sign, text: RichText, color: Color32) {
    ui.horizontal_wrapped(|ui| {
        sign(ui, which, color);
        ui.label(text.color(color));
    });
}

/// A bar that is filled to `share`.
pub fn bar(ui: &mut Ui, share: f32, color: Color32) {
    let size = Vec2::new(ui.available_width(), 6.0);
    let (rect, _) = ui.allocate_exact_size(size, Sense::hover());
    let filled = Rect::from_min_size(
        rect.min,
        Vec2::new(rect.width() * share.clamp(0.0, 1.0), rect.height()),
    );
    ui.painter()
        .rect_filled(rect, CornerRadius::same(3), theme::GROUND);
    ui.painter()
        .rect_filled(filled, CornerRadius::same(3), color);
}
