//! The bar at the top: which vehicles, how they are, how well they are heard, and what the map is at.

use egui::{
    Color32, CornerRadius, RichText, Role, Sense, Stroke, StrokeKind, TextStyle, Ui, Vec2,
    WidgetInfo,
};

use super::{theme, widgets};
use crate::command::Command;
use crate::model::map::Agreement;
use crate::model::vehicle::{Presence, Vehicle};
use crate::model::{LINK_LOST_AFTER, Model, Source};

/// One pill per vehicle, the map, the links and the time.
pub fn status_ui(ui: &mut Ui, model: &Model) -> Vec<Command> {
    let mut commands = Vec::new();
    ui.horizontal_centered(|ui| {
        ui.label(
            RichText::new("TANDEM")
                .strong()
                .size(15.0)
                .color(theme::TEXT),
        );
        ui.add_space(6.0);
        if model.vehicles.is_empty() {
            ui.label(RichText::new("waiting for a vehicle").color(theme::DIM));
        }
        for vehicle in model.vehicles.values() {
            if pill_ui(ui, model, vehicle) {
                commands.push(Command::Select(vehicle.id));
            }
        }
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.label(RichText::new(format!("{} UTC", model.utc(model.now))).monospace());
            ui.separator();
            links_ui(ui, model);
            ui.separator();
            map_ui(ui, model);
        });
    });
    commands
}

/// A vehicle in one glance; a click makes it the active one.
fn pill_ui(ui: &mut Ui, model: &Model, vehicle: &Vehicle) -> bool {
    let lost = vehicle.presence(model.now) == Presence::Lost;
    let active = model.active == Some(vehicle.id);
    let (state, ink) = state_of(model, vehicle);
    let name = vehicle.name();
    let font = TextStyle::Button.resolve(ui.style());
    let text = |words: String, color| ui.painter().layout_no_wrap(words, font.clone(), color);
    let identity = theme::vehicle(vehicle.id);
    let name_text = text(name.clone(), theme::TEXT);
    let state_text = text(state.clone(), ink);
    let size = Vec2::new(name_text.size().x + state_text.size().x + 48.0, 28.0);
    let (rect, response) = ui.allocate_exact_size(size, Sense::click());
    let label = format!("{name}: {state}");
    response.widget_info(|| WidgetInfo::selected(Role::Button, true, active, &label));
    let line = if active {
        Stroke::new(1.5, theme::CYAN)
    } else {
        Stroke::new(1.0, theme::LINE)
    };
    let painter = ui.painter();
    painter.rect(
        rect,
        CornerRadius::same(14),
        theme::CARD,
        line,
        StrokeKind::Inside,
    );
    let symbol_at = rect.left_center() + Vec2::new(17.0, 0.0);
    painter.add(widgets::symbol(
        symbol_at,
        7.0,
        vehicle.kind,
        identity,
        lost,
    ));
    let name_at = rect.left_center() + Vec2::new(29.0, -name_text.size().y / 2.0);
    let state_at = name_at + Vec2::new(name_text.size().x + 8.0, 0.0);
    painter.galley(name_at, name_text, theme::TEXT);
    painter.galley(state_at, state_text, ink);
    let ages: Vec<String> = vehicle
        .link_ages(model.now)
        .map(|(link, age)| {
            let uri = model
                .links
                .get(link)
                .map_or("recording", |link| link.uri.as_str());
            format!("{uri}: heard {} ago", widgets::age_text(age))
        })
        .collect();
    response
        .on_hover_text(format!(
            "{}\nclick to make {name} the active vehicle",
            ages.join("\n")
        ))
        .clicked()
}

/// What the pill says, and in which colour.
pub(crate) fn state_of(model: &Model, vehicle: &Vehicle) -> (String, Color32) {
    let heartbeat = vehicle.heartbeat.value;
    if vehicle.presence(model.now) == Presence::Lost {
        let age = widgets::age_text(vehicle.heartbeat.age(model.now));
        // As its alert: only a vehicle that can do harm is a warning.
        let ink = if heartbeat.armed {
            theme::RED
        } else {
            theme::AMBER
        };
        return (format!("LINK LOST {age}"), ink);
    }
    let mode = heartbeat.mode;
    if heartbeat.system_status >= 5 {
        return (format!("FAILSAFE · {mode}"), theme::RED);
    }
    if heartbeat.armed {
        let what = if vehicle.is_airborne() {
            "FLYING"
        } else {
            "ARMED"
        };
        return (format!("{what} · {mode}"), theme::TEXT);
    }
    match vehicle.ready.map(|ready| ready.value) {
        Some(true) => (format!("READY · {mode}"), theme::GREEN),
        Some(false) => (format!("NOT READY · {mode}"), theme::AMBER),
        None => (format!("DISARMED · {mode}"), theme::DIM),
    }
}

fn links_ui(ui: &mut Ui, model: &Model) {
    if model.source == Source::Replay {
        ui.label(RichText::new("recording").color(theme::REPLAY));
        return;
    }
    if model.links.is_empty() {
        ui.label(RichText::new("no link").color(theme::DIM));
    }
    for link in &model.links {
        let age = link.heard_at.map(|at| model.now.since(at));
        let (text, color) = match (&link.error, age) {
            // It works, and something is wrong with it all the same, such as frames of somebody without the key.
            (error, Some(age)) if age <= LINK_LOST_AFTER => (
                format!("link {}/s", widgets::bytes_text(link.receive_rate_bps)),
                error.as_ref().map_or(theme::TEXT, |_| theme::AMBER),
            ),
            (Some(_), _) => ("link failed".to_owned(), theme::RED),
            (None, Some(age)) => (format!("link lost {}", widgets::age_text(age)), theme::RED),
            (None, None) => ("link silent".to_owned(), theme::DIM),
        };
        let shown = ui.label(RichText::new(text).color(color));
        shown.on_hover_text(format!(
            "{}\nreceived {}, sent {}\nbad frames {}{}",
            link.uri,
            widgets::bytes_text(link.bytes_received as f64),
            widgets::bytes_text(link.bytes_sent as f64),
            link.bad_frames,
            link.error
                .as_ref()
                .map_or(String::new(), |error| format!("\n{error}")),
        ));
    }
}

fn map_ui(ui: &mut Ui, model: &Model) {
    let map = &model.map;
    let (words, color) = match map.agreement() {
        Agreement::Unknown if map.tiles() == 0 => ("no map".to_owned(), theme::DIM),
        Agreement::Unknown | Agreement::Arriving => {
            (format!("map arriving · {} tiles", map.tiles()), theme::TEXT)
        }
        Agreement::Equal => (
            format!("map verified · {} tiles", map.tiles()),
            theme::GREEN,
        ),
        Agreement::Differs => (format!("map differs · {} tiles", map.tiles()), theme::AMBER),
    };
    ui.label(RichText::new(words).color(color));
}
