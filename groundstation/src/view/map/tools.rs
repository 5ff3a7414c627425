//! What a click on the map does, and the buttons above the map.

use egui::{Painter, PointerButton, Pos2, Rect, Response, Stroke, Ui, Vec2};
use maps::frame::{Point, World};

use super::{MapView, touched};
use crate::command::{Command, SurveyArea};
use crate::model::vehicle::Vehicle;
use crate::model::{Model, Source};
use crate::render::{self, Coloring, Surfaces};
use crate::view::camera::CameraCommand;
use crate::view::layers::Layer;
use crate::view::theme;

/// A drag shorter than this, in points, is a click.
const CLICK: f32 = 6.0;

/// What the left mouse button does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tool {
    /// Moves the view.
    #[default]
    Look,
    /// Sets a goal for the active ground vehicle: a click is the place, a drag from it the heading.
    Goal,
    /// Draws the rectangle that the active aircraft surveys.
    Survey,
}

/// Lets the tool plan: gives a command when the button is released.
pub(super) fn plan(
    painter: &Painter,
    response: &Response,
    model: &Model,
    view: &mut MapView,
) -> Option<Command> {
    let vehicle = model
        .active_vehicle()
        .filter(|vehicle| fits(view.tool, vehicle))?;
    let ground = |position: Pos2| {
        let ray = view.camera.ray(
            render::callback::pixel_at(response.rect, position),
            view.viewport,
        );
        match view.tool {
            // A goal is the floor one sees, a survey the ground below the walls.
            Tool::Goal => touched(model, &view.scene, ray),
            Tool::Look | Tool::Survey => ray
                .distance_to_height_m(0.0)
                .filter(|m| *m < 10_000.0)
                .map(|m| ray.at(m)),
        }
    };
    let pointer = response.interact_pointer_pos();
    if response.clicked_by(PointerButton::Primary) && view.tool == Tool::Goal {
        let place = ground(pointer?)?;
        return Some(goal(vehicle, place, None));
    }
    if response.drag_started_by(PointerButton::Primary) {
        let origin = response.ctx.input(|input| input.pointer.press_origin());
        view.drag = origin.and_then(&ground);
    }
    let from = view.drag?;
    let to = pointer.and_then(&ground)?;
    sketch(painter, response.rect, view, from, to);
    if !response.drag_stopped_by(PointerButton::Primary) {
        return None;
    }
    view.drag = None;
    let moved = response
        .ctx
        .input(|input| input.pointer.press_origin())
        .zip(pointer);
    let is_click = moved.is_some_and(|(origin, end)| origin.distance(end) < CLICK);
    match view.tool {
        Tool::Look => None,
        Tool::Goal if is_click => Some(goal(vehicle, from, None)),
        Tool::Goal => Some(goal(vehicle, from, Some(compass_deg(from, to)))),
        Tool::Survey => {
            view.tool = Tool::Look;
            let area = SurveyArea {
                from_m: [from.raw.x, from.raw.y],
                to_m: [to.raw.x, to.raw.y],
                altitude_m: model.config.survey.altitude_m,
                spacing_m: model.config.survey.spacing_m,
            };
            Some(Command::PlanSurvey {
                vehicle: vehicle.id,
                area,
            })
        }
    }
}

fn fits(tool: Tool, vehicle: &Vehicle) -> bool {
    match tool {
        Tool::Look => false,
        Tool::Goal => vehicle.kind.drives(),
        Tool::Survey => vehicle.kind.flies(),
    }
}

fn goal(vehicle: &Vehicle, place: Point<World>, heading_deg: Option<f64>) -> Command {
    Command::PlanPath {
        vehicle: vehicle.id,
        x_m: place.raw.x,
        y_m: place.raw.y,
        heading_deg,
    }
}

fn compass_deg(from: Point<World>, to: Point<World>) -> f64 {
    let along = (to - from).raw;
    along.x.atan2(along.y).to_degrees().rem_euclid(360.0)
}

/// What would be planned if the button were released now.
fn sketch(painter: &Painter, rect: Rect, view: &MapView, from: Point<World>, to: Point<World>) {
    let at = |x: f64, y: f64| {
        let pixel = view
            .camera
            .project(Point::new(x, y, from.raw.z), view.viewport)?;
        Some(render::callback::position_of(rect, pixel))
    };
    let (a, b) = (from.raw, to.raw);
    let line = Stroke::new(2.0, theme::CYAN);
    match view.tool {
        Tool::Look => {}
        Tool::Goal => {
            if let (Some(start), Some(end)) = (at(a.x, a.y), at(b.x, b.y)) {
                painter.circle_stroke(start, 6.0, line);
                painter.arrow(start, end - start, line);
            }
        }
        Tool::Survey => {
            let corners: Option<Vec<Pos2>> =
                [at(a.x, a.y), at(b.x, a.y), at(b.x, b.y), at(a.x, b.y)]
                    .into_iter()
                    .collect();
            if let Some(corners) = corners {
                painter.add(egui::Shape::closed_line(corners, line));
            }
        }
    }
}

/// The buttons above the map.
pub(super) fn toolbar(ui: &mut Ui, rect: Rect, model: &Model, view: &mut MapView) {
    let area = Rect::from_min_size(
        rect.min + Vec2::splat(10.0),
        Vec2::new(rect.width() - 20.0, 36.0),
    );
    let mut bar = ui.new_child(
        egui::UiBuilder::new()
            .max_rect(area)
            .layout(egui::Layout::left_to_right(egui::Align::Min)),
    );
    let frame = egui::Frame::new()
        .fill(theme::PANEL.gamma_multiply(0.92))
        .corner_radius(6)
        .inner_margin(4);
    frame.show(&mut bar, |ui| {
        ui.horizontal(|ui| {
            if model.source == Source::Live {
                tool_buttons(ui, model, view);
                ui.separator();
            }
            view_buttons(ui, model, view);
        });
    });
}

fn tool_buttons(ui: &mut Ui, model: &Model, view: &mut MapView) {
    let active = model.active_vehicle();
    let name = active.map_or_else(String::new, Vehicle::name);
    let mut tool = |ui: &mut Ui, which: Tool, label: String, hint: &str| {
        let enabled = which == Tool::Look || active.is_some_and(|vehicle| fits(which, vehicle));
        let button = egui::Button::new(label).selected(view.tool == which);
        let response = ui
            .add_enabled(enabled, button)
            .on_hover_text(hint)
            .on_disabled_hover_text(hint);
        if response.clicked() {
            view.tool = which;
        }
        if !enabled && view.tool == which {
            view.tool = Tool::Look;
        }
    };
    tool(
        ui,
        Tool::Look,
        "Look".to_owned(),
        "drag slides, right drag turns, wheel zooms",
    );
    let drives = active.is_some_and(|vehicle| vehicle.kind.drives());
    let goal = if drives {
        format!("Goal for {name}")
    } else {
        "Goal".to_owned()
    };
    tool(
        ui,
        Tool::Goal,
        goal,
        "click a place on the map to plan a path there; drag to give a heading (a ground vehicle must be active)",
    );
    let flies = active.is_some_and(|vehicle| vehicle.kind.flies());
    let survey = if flies {
        format!("Survey with {name}")
    } else {
        "Survey".to_owned()
    };
    tool(
        ui,
        Tool::Survey,
        survey,
        "drag a rectangle to survey (an aircraft must be active)",
    );
}

fn view_buttons(ui: &mut Ui, model: &Model, view: &mut MapView) {
    if ui
        .button("Fit")
        .on_hover_text("show all of the map")
        .clicked()
    {
        view.command(CameraCommand::Fit);
    }
    if ui
        .button("Top")
        .on_hover_text("straight down, north up")
        .clicked()
    {
        view.command(CameraCommand::Top);
    }
    if let Some(vehicle) = model.active_vehicle() {
        let following = view.follow == Some(vehicle.id);
        if ui
            .add(egui::Button::new("Follow").selected(following))
            .clicked()
        {
            view.command(if following {
                CameraCommand::Free
            } else {
                CameraCommand::Follow(vehicle.id)
            });
        }
    }
    ui.menu_button("Layers", |ui| {
        for layer in Layer::ALL {
            let mut shown = view.layers.shows(layer);
            if ui.checkbox(&mut shown, layer.label()).changed() {
                view.layers.toggle(layer);
            }
        }
    });
    ui.menu_button("Colour", |ui| {
        for (coloring, label) in [
            (Coloring::Camera, "As the camera saw it"),
            (Coloring::Height, "By height"),
            (Coloring::Certainty, "By certainty"),
        ] {
            ui.radio_value(&mut view.coloring, coloring, label);
        }
        ui.separator();
        ui.radio_value(
            &mut view.surfaces,
            Surfaces::Observed,
            "Walls clear from behind",
        );
        ui.radio_value(&mut view.surfaces, Surfaces::All, "Walls solid");
        ui.separator();
        let mut cut = view.cut_m.is_some();
        if ui.checkbox(&mut cut, "Cut off above").changed() {
            view.cut_m = cut.then_some(1.8);
        }
        if let Some(cut_m) = &mut view.cut_m {
            ui.add(
                egui::Slider::new(cut_m, 0.1..=5.0)
                    .suffix(" m")
                    .text("height"),
            );
        }
    });
}
