//! What the operator sees and can do, through the accessibility tree: the same views as in the window.

use std::time::Duration;

use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use groundstation::command::{Command, Order};
use groundstation::config::Config;
use groundstation::model::alerts::{Cause, Level};
use groundstation::model::missions::{Mission, PlanState, Transfer};
use groundstation::model::orders::OrderState;
use groundstation::model::vehicle::{Battery, Heartbeat, Vehicle};
use groundstation::model::{Model, Source, Timed};
use groundstation::modes::{Firmware, Kind, Mode};
use groundstation::view::{alerts, mission, orders, status, theme, vehicle};
use maps::time::Stamp;
use mavlink_ext::SystemId;

const ROVER: SystemId = SystemId(2);
const STEP: f32 = 0.05;

fn at(seconds: u64) -> Stamp {
    Stamp::ZERO + Duration::from_secs(seconds)
}

fn model(source: Source, armed: bool) -> Model {
    let mut model = Model::new(Config::default(), source, 1_700_000_000_000_000);
    let told = Heartbeat {
        mode: Mode::Hold,
        armed,
        system_status: 3,
    };
    let mut rover = Vehicle::new(ROVER, Kind::Rover, Timed::new(told, at(10)));
    rover.firmware = Firmware::ArduPilot;
    rover.battery = Some(Timed::new(
        Battery {
            voltage_v: Some(12.4),
            current_a: None,
            remaining_percent: Some(81),
        },
        at(10),
    ));
    model.vehicles.insert(ROVER, rover);
    model.active = Some(ROVER);
    model.now = at(10);
    model
}

/// A view and what has been asked for in it.
struct Shown {
    model: Model,
    asked: Vec<Command>,
}

fn show<'a>(
    model: Model,
    view: impl Fn(&mut egui::Ui, &Model) -> Vec<Command> + 'a,
) -> Harness<'a, Shown> {
    let shown = Shown {
        model,
        asked: Vec::new(),
    };
    let draw = move |ui: &mut egui::Ui, shown: &mut Shown| {
        let asked = view(ui, &shown.model);
        shown.asked.extend(asked);
    };
    let mut harness = Harness::builder()
        .with_size(egui::vec2(700.0, 700.0))
        .with_step_dt(STEP)
        .with_context_setup(theme::apply)
        .build_ui_state(draw, shown);
    harness.run_steps(3);
    harness
}

/// Holds a button down for about so long.
fn hold(harness: &mut Harness<'_, Shown>, label: &str, seconds: f32) {
    let center = harness.get_by_label(label).rect().center();
    harness.hover_at(center);
    harness.run_steps(1);
    harness.drag_at(center);
    harness.run_steps((seconds / STEP).round() as usize);
    harness.drop_at(center);
    harness.run_steps(2);
}

#[test]
fn a_pill_names_the_vehicle_and_its_state() {
    let harness = show(model(Source::Live, true), status::status_ui);
    harness.get_by_label("UGV 2: ARMED · HOLD");
}

#[test]
fn a_lost_vehicle_says_so_and_for_how_long() {
    let mut lost = model(Source::Live, true);
    lost.now = at(52);
    let harness = show(lost, status::status_ui);
    harness.get_by_label("UGV 2: LINK LOST 42 s");
}

#[test]
fn a_click_on_the_pill_makes_the_vehicle_active() {
    let mut harness = show(model(Source::Live, false), status::status_ui);
    harness.get_by_label_contains("UGV 2: ").click();
    harness.run_steps(2);
    assert_eq!(harness.state().asked, [Command::Select(ROVER)]);
}

#[test]
fn arming_wants_a_hold_of_a_second() {
    let mut harness = show(model(Source::Live, false), vehicle::vehicles_ui);
    hold(&mut harness, "Arm UGV 2", 0.7);
    assert!(harness.state().asked.is_empty(), "let go too early");
    hold(&mut harness, "Arm UGV 2", 1.3);
    assert_eq!(
        harness.state().asked,
        [Command::Order(ROVER, Order::Arm)],
        "once, however long it is held"
    );
}

#[test]
fn a_click_does_not_arm() {
    let mut harness = show(model(Source::Live, false), vehicle::vehicles_ui);
    harness.get_by_label("Arm UGV 2").click();
    harness.run_steps(40);
    assert!(harness.state().asked.is_empty());
}

#[test]
fn stopping_and_coming_back_act_at_once() {
    let mut harness = show(model(Source::Live, true), vehicle::vehicles_ui);
    harness.get_by_label("Hold UGV 2").click();
    harness.run_steps(2);
    harness.get_by_label("RTL UGV 2").click();
    harness.run_steps(2);
    let asked = [Order::Hold, Order::ReturnToLaunch].map(|order| Command::Order(ROVER, order));
    assert_eq!(harness.state().asked, asked);
}

#[test]
fn a_lost_vehicle_cannot_be_armed() {
    let mut lost = model(Source::Live, false);
    lost.now = at(20);
    let mut harness = show(lost, vehicle::vehicles_ui);
    hold(&mut harness, "Arm UGV 2", 1.5);
    assert!(harness.state().asked.is_empty());
}

#[test]
fn an_old_value_is_dashes() {
    let mut old = model(Source::Live, false);
    let harness = show(model(Source::Live, false), vehicle::vehicles_ui);
    harness.get_by_label("12.4 V  81 %");
    old.now = at(60);
    let harness = show(old, vehicle::vehicles_ui);
    assert!(harness.query_by_label("12.4 V  81 %").is_none());
    harness.get_by_label("– – –");
}

#[test]
fn a_recording_has_no_command_buttons() {
    let harness = show(model(Source::Replay, true), vehicle::vehicles_ui);
    for label in [
        "Disarm UGV 2",
        "Hold UGV 2",
        "RTL UGV 2",
        "Start mission UGV 2",
    ] {
        assert!(harness.query_by_label(label).is_none(), "{label}");
    }
}

#[test]
fn a_hold_ends_when_the_active_vehicle_changes() {
    let mut two = model(Source::Live, false);
    let told = Heartbeat {
        mode: Mode::Hold,
        armed: false,
        system_status: 3,
    };
    two.vehicles.insert(
        SystemId(3),
        Vehicle::new(SystemId(3), Kind::Rover, Timed::new(told, at(10))),
    );
    for id in [ROVER, SystemId(3)] {
        two.missions.insert(id, planned());
    }
    let mut harness = show(two, mission::mission_ui);
    let center = harness.get_by_label("Upload to UGV 2").rect().center();
    harness.hover_at(center);
    harness.run_steps(1);
    harness.drag_at(center);
    harness.run_steps(7);
    harness.state_mut().model.active = Some(SystemId(3));
    harness.run_steps(7);
    assert!(
        harness.state().asked.is_empty(),
        "{:?}",
        harness.state().asked
    );
}

fn planned() -> Mission {
    let plan = groundstation::model::missions::Plan {
        made_at: at(9),
        kind: groundstation::model::missions::PlanKind::Path {
            length_m: 3.2,
            min_clearance_m: 0.21,
            gear_changes: 2,
            goal_heading_rad: None,
        },
        items: Vec::new(),
        home: groundstation::model::missions::HomeItem::None,
        line: Vec::new(),
    };
    Mission {
        plan: PlanState::Ready(plan),
        transfer: Transfer::None,
    }
}

#[test]
fn a_plan_shows_its_figures_and_the_upload_names_its_target() {
    let mut with_plan = model(Source::Live, false);
    with_plan.missions.insert(ROVER, planned());
    let mut harness = show(with_plan, mission::mission_ui);
    harness.get_by_label("3.20 m");
    harness.get_by_label("0.21 m");
    hold(&mut harness, "Upload to UGV 2", 0.8);
    assert_eq!(harness.state().asked, [Command::Upload(ROVER)]);
}

#[test]
fn a_refused_plan_says_why() {
    let mut refused = model(Source::Live, false);
    let plan = PlanState::Refused {
        at: at(9),
        reason: "the goal is blocked".to_owned(),
    };
    refused.missions.insert(
        ROVER,
        Mission {
            plan,
            transfer: Transfer::None,
        },
    );
    let harness = show(refused, mission::mission_ui);
    harness.get_by_label("No plan: the goal is blocked");
}

#[test]
fn a_mission_that_differs_is_listed_difference_by_difference() {
    let mut differs = model(Source::Live, false);
    let transfer = Transfer::Differs {
        at: at(9),
        differences: vec!["mission item 3: elsewhere".to_owned()],
    };
    differs.missions.insert(
        ROVER,
        Mission {
            transfer,
            ..planned()
        },
    );
    let harness = show(differs, mission::mission_ui);
    harness.get_by_label_contains("has something else");
    harness.get_by_label("mission item 3: elsewhere");
}

#[test]
fn a_denied_order_says_why() {
    let mut denied = model(Source::Live, false);
    let state = OrderState::Denied {
        result: "it failed".to_owned(),
    };
    let id = denied.orders.add(at(9), ROVER, Order::Arm, state);
    if let Some(order) = denied.orders.get_mut(id) {
        order.texts.push("Arm: Battery low".to_owned());
    }
    let harness = show(denied, |ui, model| {
        orders::orders_ui(ui, model);
        Vec::new()
    });
    harness.get_by_label("denied: it failed (Arm: Battery low)");
}

#[test]
fn an_alert_can_be_acknowledged_and_stays() {
    let mut alarmed = model(Source::Live, true);
    alarmed.alerts.update(
        at(9),
        vec![(
            Level::Warning,
            Cause::VehicleLost(ROVER),
            "UGV 2: link lost".to_owned(),
        )],
    );
    let id = alarmed.alerts.present()[0].id;
    let mut harness = show(alarmed, alerts::alerts_ui);
    harness.get_by_label("UGV 2: link lost");
    harness.get_by_label("Acknowledge").click();
    harness.run_steps(2);
    assert_eq!(harness.state().asked, [Command::Acknowledge(id)]);
    harness.state_mut().model.alerts.acknowledge(id);
    harness.run_steps(2);
    harness.get_by_label("UGV 2: link lost");
    assert!(harness.query_by_label("Acknowledge").is_none());
}
