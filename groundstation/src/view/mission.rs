//! The plan for the active vehicle: what it is, whether the vehicle has it, and how far it has got.

use egui::{RichText, Ui};

use super::{theme, widgets};
use crate::command::{Command, SurveyArea};
use crate::model::missions::{Mission, Plan, PlanKind, PlanState, Transfer};
use crate::model::vehicle::{Presence, Vehicle};
use crate::model::{Model, Source};
use crate::modes::Mode;

/// The plan of the active vehicle.
pub fn mission_ui(ui: &mut Ui, model: &Model) -> Vec<Command> {
    let mut commands = Vec::new();
    let Some(vehicle) = model.active_vehicle() else {
        ui.label(RichText::new("Select a vehicle to plan for.").color(theme::DIM));
        return commands;
    };
    let nothing = Mission::default();
    let mission = model.missions.get(&vehicle.id).unwrap_or(&nothing);
    widgets::card(ui, theme::vehicle(vehicle.id), |ui| {
        ui.label(RichText::new(format!("Plan for {}", vehicle.name())).strong());
        plan_ui(ui, model, vehicle, mission);
        transfer_ui(ui, vehicle, mission);
        progress_ui(ui, vehicle, mission);
        if model.source == Source::Live {
            buttons_ui(ui, model, vehicle, mission, &mut commands);
        }
    });
    commands
}

fn plan_ui(ui: &mut Ui, model: &Model, vehicle: &Vehicle, mission: &Mission) {
    match &mission.plan {
        PlanState::None => {
            let hint = if model.source == Source::Replay {
                "Plans are not shown in a replay."
            } else if vehicle.kind.drives() {
                "Choose the goal tool and click a place on the map."
            } else if vehicle.kind.flies() {
                "Choose the survey tool and drag a rectangle on the map."
            } else {
                "There is no planner for this kind of vehicle."
            };
            ui.label(RichText::new(hint).color(theme::DIM));
        }
        PlanState::Planning { .. } => {
            ui.horizontal(|ui| {
                ui.spinner();
                ui.label("Looking for a path");
            });
        }
        PlanState::Ready(plan) => figures_ui(ui, plan),
        PlanState::Refused { reason, .. } => {
            let text = RichText::new(format!("No plan: {reason}"));
            widgets::signed(ui, widgets::Sign::Attention, text, theme::AMBER);
        }
    }
}

fn figures_ui(ui: &mut Ui, plan: &Plan) {
    let figures = match &plan.kind {
        PlanKind::Path {
            length_m,
            min_clearance_m,
            gear_changes,
            ..
        } => vec![
            ("Length", format!("{length_m:.2} m")),
            ("Clearance", format!("{min_clearance_m:.2} m")),
            ("Gear changes", gear_changes.to_string()),
        ],
        PlanKind::Survey {
            area:
                SurveyArea {
                    altitude_m,
                    spacing_m,
                    ..
                },
            length_m,
        } => vec![
            ("Length", format!("{length_m:.1} m")),
            ("Altitude", format!("{altitude_m:.1} m above home")),
            ("Line spacing", format!("{spacing_m:.1} m")),
        ],
    };
    egui::Grid::new("plan figures")
        .num_columns(2)
        .spacing([14.0, 2.0])
        .min_row_height(16.0)
        .show(ui, |ui| {
            for (name, value) in figures
                .into_iter()
                .chain([("Items", plan.items.len().to_string())])
            {
                ui.label(RichText::new(name).small().color(theme::DIM));
                ui.label(RichText::new(value).monospace());
                ui.end_row();
            }
        });
}

fn transfer_ui(ui: &mut Ui, vehicle: &Vehicle, mission: &Mission) {
    let name = vehicle.name();
    let share = |done: usize, total: usize| done as f32 / total.max(1) as f32;
    match &mission.transfer {
        Transfer::None => {
            if mission.plan().is_some() {
                ui.label(RichText::new(format!("Not on {name} yet")).color(theme::DIM));
            }
        }
        Transfer::Uploading { done, total } => {
            ui.label(format!("Uploading to {name}: {done} of {total}"));
            widgets::bar(ui, share(*done, *total), theme::CYAN);
        }
        Transfer::ReadingBack { done, total } => {
            ui.label(format!("Reading back from {name}: {done} of {total}"));
            widgets::bar(ui, share(*done, *total), theme::CYAN);
        }
        Transfer::Verified { items, .. } => {
            let text = RichText::new(format!("verified: {name} has all {items} items"));
            widgets::signed(ui, widgets::Sign::Done, text, theme::GREEN);
        }
        Transfer::Differs { differences, .. } => {
            let words = format!(
                "{name} has something else: {} differences",
                differences.len()
            );
            widgets::signed(
                ui,
                widgets::Sign::Attention,
                RichText::new(words).strong(),
                theme::RED,
            );
            for difference in differences.iter().take(6) {
                ui.label(RichText::new(difference).small().color(theme::TEXT));
            }
        }
        Transfer::Failed { reason, .. } => {
            let text = RichText::new(format!("Upload to {name} failed: {reason}")).strong();
            widgets::signed(ui, widgets::Sign::Attention, text, theme::RED);
        }
    }
}

fn progress_ui(ui: &mut Ui, vehicle: &Vehicle, mission: &Mission) {
    let (Some(progress), Some(plan)) = (vehicle.mission, mission.plan()) else {
        return;
    };
    if !mission.is_verified() {
        return;
    }
    let last = plan.items.len().saturating_sub(1).max(1);
    let at = if progress.value.complete {
        last
    } else {
        usize::from(progress.value.current).min(last)
    };
    let under_way = vehicle.is_armed() && vehicle.heartbeat.value.mode == Mode::Auto;
    let words = if progress.value.complete {
        "Mission complete".to_owned()
    } else if under_way {
        format!("Under way: item {at} of {last}")
    } else {
        format!("On board, not under way: item {at} of {last} is next")
    };
    ui.label(words);
    widgets::bar(ui, at as f32 / last as f32, theme::vehicle(vehicle.id));
}

fn buttons_ui(
    ui: &mut Ui,
    model: &Model,
    vehicle: &Vehicle,
    mission: &Mission,
    commands: &mut Vec<Command>,
) {
    let name = vehicle.name();
    let heard = vehicle.presence(model.now) == Presence::Present;
    ui.horizontal_wrapped(|ui| {
        let label = format!("Upload to {name}");
        if widgets::hold_button(
            ui,
            &label,
            widgets::Hold::short("replaces the mission on board"),
            heard && mission.can_upload(),
        ) {
            commands.push(Command::Upload(vehicle.id));
        }
        let discard = egui::Button::new("Discard plan");
        if ui.add_enabled(mission.can_upload(), discard).clicked() {
            commands.push(Command::DiscardPlan(vehicle.id));
        }
    });
}
