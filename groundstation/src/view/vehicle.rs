//! One card per vehicle: what it does, where it is, what it runs on, and the orders it can be given.

use std::time::Duration;

use egui::{RichText, Ui};

use super::status::state_of;
use super::widgets::Hold;
use super::{theme, widgets};
use crate::command::{Command, Order};
use crate::model::vehicle::{Presence, Vehicle};
use crate::model::{Model, Source};
use crate::modes::Mode;

const FAST: Duration = Duration::from_millis(500);
/// Rows of values are lower than rows of buttons.
const ROW: f32 = 16.0;
const SLOW: Duration = Duration::from_secs(2);

/// All vehicles.
pub fn vehicles_ui(ui: &mut Ui, model: &Model) -> Vec<Command> {
    let mut commands = Vec::new();
    if model.vehicles.is_empty() {
        ui.label(RichText::new("No vehicle has been heard yet.").color(theme::DIM));
    }
    for vehicle in model.vehicles.values() {
        let accent = theme::vehicle(vehicle.id);
        widgets::card(ui, accent, |ui| {
            vehicle_ui(ui, model, vehicle, &mut commands);
        });
        ui.add_space(4.0);
    }
    commands
}

fn vehicle_ui(ui: &mut Ui, model: &Model, vehicle: &Vehicle, commands: &mut Vec<Command>) {
    ui.horizontal(|ui| {
        ui.label(RichText::new(vehicle.name()).heading());
        let (state, ink) = state_of(model, vehicle);
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.label(RichText::new(state).color(ink));
        });
    });
    egui::Grid::new(("telemetry", vehicle.id.0))
        .num_columns(2)
        .spacing([14.0, 2.0])
        .min_row_height(ROW)
        .show(ui, |ui| {
            telemetry_ui(ui, model, vehicle);
        });
    if let Some(reason) = vehicle.not_ready.back()
        && vehicle.ready.is_some_and(|ready| !ready.value)
        && model.now.since(reason.at) < Duration::from_secs(30)
    {
        ui.label(RichText::new(&reason.value).small().color(theme::AMBER));
    }
    if model.source == Source::Live {
        orders_ui(ui, model, vehicle, commands);
    }
}

fn telemetry_ui(ui: &mut Ui, model: &Model, vehicle: &Vehicle) {
    let now = model.now;
    widgets::value_ui(
        ui,
        "Position",
        vehicle.position.as_ref(),
        (now, FAST),
        |p| format!("{:+.2} E  {:+.2} N m", p.raw.x, p.raw.y),
    );
    if vehicle.kind.flies() {
        widgets::value_ui(ui, "Altitude", vehicle.fix.as_ref(), (now, FAST), |fix| {
            format!("{:.2} m above home", fix.above_home_m)
        });
    }
    widgets::value_ui(ui, "Speed", vehicle.fix.as_ref(), (now, FAST), |fix| {
        format!("{:.2} m/s", fix.speed_mps)
    });
    widgets::value_ui(
        ui,
        "Heading",
        vehicle.attitude.as_ref(),
        (now, FAST),
        |attitude| {
            let heading = attitude.heading_deg().round() as u32 % 360;
            let whole = |deg: f64| deg.round() as i32;
            let (roll, pitch) = (whole(attitude.roll_deg()), whole(attitude.pitch_deg()));
            format!("{heading:03}°  roll {roll:+}° pitch {pitch:+}°")
        },
    );
    widgets::value_ui(
        ui,
        "Battery",
        vehicle.battery.as_ref(),
        (now, SLOW),
        |battery| {
            let part = |value: Option<String>| value.unwrap_or_else(|| "–".to_owned());
            format!(
                "{} V  {} %",
                part(battery.voltage_v.map(|v| format!("{v:.1}"))),
                part(battery.remaining_percent.map(|p| p.to_string())),
            )
        },
    );
    widgets::value_ui(ui, "GPS", vehicle.gps.as_ref(), (now, SLOW), |gps| {
        let fix = match gps.fix_type {
            0 | 1 => "no fix",
            2 => "2-D fix",
            3 => "3-D fix",
            4 => "3-D fix, DGPS",
            5 => "3-D fix, RTK float",
            6 => "3-D fix, RTK fixed",
            7 => "static",
            8 => "3-D fix, PPP",
            _ => "unknown fix",
        };
        gps.satellites.map_or_else(
            || fix.to_owned(),
            |count| format!("{fix}, {count} satellites"),
        )
    });
    widgets::value_ui(
        ui,
        "Mission",
        vehicle.mission.as_ref(),
        (now, SLOW * 5),
        |mission| {
            let total = mission
                .total
                .map_or_else(String::new, |total| format!(" of {total}"));
            let done = if mission.complete { "  complete" } else { "" };
            format!("item {}{total}{done}", mission.current)
        },
    );
}

/// The buttons: what is safe acts at once, what moves something wants a hold, what starts motors a longer one.
fn orders_ui(ui: &mut Ui, model: &Model, vehicle: &Vehicle, commands: &mut Vec<Command>) {
    let name = vehicle.name();
    let heard = vehicle.presence(model.now) == Presence::Present;
    let armed = vehicle.is_armed();
    let mut order = |order: Order| commands.push(Command::Order(vehicle.id, order));
    ui.add_space(4.0);
    ui.horizontal_wrapped(|ui| {
        if !armed
            && widgets::hold_button(
                ui,
                &format!("Arm {name}"),
                Hold::long("starts the motors"),
                heard,
            )
        {
            order(Order::Arm);
        }
        if armed {
            let on_the_ground = heard && !vehicle.is_airborne();
            if widgets::hold_button(
                ui,
                &format!("Disarm {name}"),
                Hold::long("stops the motors"),
                on_the_ground,
            ) {
                order(Order::Disarm);
            }
        }
        let has_mission = model
            .missions
            .get(&vehicle.id)
            .is_some_and(crate::model::missions::Mission::is_verified)
            || vehicle
                .mission
                .is_some_and(|mission| mission.value.total.is_some_and(|total| total > 0));
        let can_start = heard && armed && has_mission;
        if widgets::hold_button(
            ui,
            &format!("Start mission {name}"),
            Hold::short("the vehicle sets off by itself"),
            can_start,
        ) {
            order(Order::StartMission);
        }
        if vehicle.kind.flies() && armed && !vehicle.is_airborne() {
            let altitude_m = model.config.survey.altitude_m;
            let label = format!("Take off {name} to {altitude_m:.1} m");
            if widgets::hold_button(
                ui,
                &label,
                Hold::long("the vehicle leaves the ground"),
                heard,
            ) {
                order(Order::Takeoff { altitude_m });
            }
        }
        if vehicle.kind.flies()
            && vehicle.is_airborne()
            && widgets::hold_button(
                ui,
                &format!("Land {name}"),
                Hold::short("the vehicle comes down where it is"),
                heard,
            )
        {
            order(Order::Land);
        }
        safe_orders_ui(ui, vehicle, &name, &mut order);
    });
}

/// Stopping and coming back are never behind a dialog, nor disabled by a weak link.
fn safe_orders_ui(ui: &mut Ui, vehicle: &Vehicle, name: &str, order: &mut impl FnMut(Order)) {
    if !vehicle.is_armed() {
        return;
    }
    if ui.button(format!("Hold {name}")).clicked() {
        order(Order::Hold);
    }
    let can_return = Mode::Rtl.number(vehicle.firmware, vehicle.kind).is_some();
    if can_return && ui.button(format!("RTL {name}")).clicked() {
        order(Order::ReturnToLaunch);
    }
}
