//! Orders to vehicles, as MAVLink commands with answers.

use std::collections::{BTreeMap, VecDeque};

use maps::time::Stamp;
use mavlink_ext::command::{Client, CommandError, Request, Superseding};
use mavlink_ext::dialect::cmd;
use mavlink_ext::dialect::tandem::MavResult;
use mavlink_ext::{Address, ComponentId, Message, SystemId};

use super::{Outbox, Station};
use crate::command::Order;
use crate::model::orders::OrderState;
use crate::model::vehicle::{Presence, Vehicle};
use crate::modes::{Firmware, Kind, Mode};
use crate::script;

/// As the command protocol does it: the first time and three more.
const TRIES: u8 = 4;
/// `DO_SET_MODE`: the mode is the autopilot's own.
const CUSTOM_MODE: f32 = 1.0;

/// Commands that wait for their answers, and those that follow when these are accepted.
#[derive(Debug, Default)]
pub(super) struct Conversations {
    client: Option<Client>,
    open: BTreeMap<(Address, u16), Open>,
}

#[derive(Debug)]
struct Open {
    order: u64,
    then: VecDeque<Request>,
}

impl Station {
    /// Sends an order, unless it makes no sense; either way it is listed.
    pub(super) fn order(&mut self, id: SystemId, order: Order, outbox: &mut Outbox) {
        let now = self.model.now;
        let requests = match self.model.vehicles.get(&id) {
            None => Err(format!("vehicle {} has never been heard", id.0)),
            Some(vehicle) => self.possible(vehicle, order),
        };
        match requests {
            Err(why) => {
                self.model
                    .orders
                    .add(now, id, order, OrderState::Refused(why));
            }
            Ok(requests) => {
                let number = self.model.orders.add(
                    now,
                    id,
                    order,
                    OrderState::Sent {
                        attempt: 1,
                        of: TRIES,
                    },
                );
                self.send_first(
                    id,
                    Open {
                        order: number,
                        then: requests.into(),
                    },
                    outbox,
                );
            }
        }
    }

    fn possible(&self, vehicle: &Vehicle, order: Order) -> Result<Vec<Request>, String> {
        if vehicle.presence(self.model.now) == Presence::Lost && !is_safe(order) {
            return Err(format!("the link to {} is lost", vehicle.name()));
        }
        if order == Order::Disarm && vehicle.is_airborne() {
            return Err(format!("{} is in the air: it would fall", vehicle.name()));
        }
        requests(vehicle, order)
    }

    fn send_first(&mut self, id: SystemId, mut open: Open, outbox: &mut Outbox) {
        let Some(request) = open.then.pop_front() else {
            return;
        };
        let to = Address {
            system: id,
            component: ComponentId::AUTOPILOT,
        };
        let (own, now) = (self.own, self.model.now);
        let command = request.command();
        let client = self
            .conversations
            .client
            .get_or_insert_with(|| Client::new(own));
        // Whoever presses "return" after "take off" wants no late repetition of the first.
        match client.supersede(now, to, request) {
            Ok(Superseding { message, ended }) => {
                self.void.push((to, ended.clone()));
                let ended = ended.into_iter().chain([command]);
                for old in ended.filter_map(|old| self.conversations.open.remove(&(to, old))) {
                    if let Some(order) = self.model.orders.get_mut(old.order) {
                        order.state = OrderState::Superseded;
                        order.answered_at = Some(now);
                    }
                }
                self.conversations.open.insert((to, command), open);
                outbox.push(message);
            }
            Err(error) => {
                if let Some(order) = self.model.orders.get_mut(open.order) {
                    order.state = OrderState::Refused(error.to_string());
                    order.answered_at = Some(now);
                }
            }
        }
    }

    /// Looks whether a message answers something.
    pub(super) fn hear_answers(
        &mut self,
        now: Stamp,
        from: Address,
        message: &Message,
        outbox: &mut Outbox,
    ) {
        self.hear_transfer(now, from, message, outbox);
        if let Message::COMMAND_ACK(ack) = message
            && ack.result == MavResult::MAV_RESULT_IN_PROGRESS
            && let Some(open) = self.conversations.open.get(&(from, ack.command))
            && let Some(order) = self.model.orders.get_mut(open.order)
        {
            let percent = Some(ack.progress).filter(|percent| (1..=100).contains(percent));
            order.state = OrderState::InProgress { percent };
        }
        let Some(client) = &mut self.conversations.client else {
            return;
        };
        let step = client.handle(now, from, message);
        outbox.extend(step.send);
        for outcome in step.events {
            self.answered(outcome.vehicle, outcome.command, outcome.result, outbox);
        }
    }

    /// Repeats what was not answered, and looks for the effects of what was accepted.
    pub(super) fn tick_orders(&mut self, outbox: &mut Outbox) {
        let now = self.model.now;
        if let Some(client) = &mut self.conversations.client {
            let step = client.tick(now);
            for message in &step.send {
                if let Message::COMMAND_LONG(long) = message {
                    let to = Address::new(long.target_system, long.target_component);
                    let open = self.conversations.open.get(&(to, long.command));
                    if let Some(order) = open.and_then(|open| self.model.orders.get_mut(open.order))
                    {
                        order.state = OrderState::Sent {
                            attempt: long.confirmation + 1,
                            of: TRIES,
                        };
                    }
                }
            }
            outbox.extend(step.send);
            for outcome in step.events {
                self.answered(outcome.vehicle, outcome.command, outcome.result, outbox);
            }
        }
        let vehicles = &self.model.vehicles;
        for sent in self.model.orders.iter_mut() {
            let waits = sent.confirmed_at.is_none() && sent.state == OrderState::Accepted;
            let vehicle = vehicles.get(&sent.vehicle).filter(|_| waits);
            if vehicle.is_some_and(|vehicle| script::shows(vehicle, sent, now)) {
                sent.confirmed_at = Some(now);
            }
        }
    }

    fn answered(
        &mut self,
        from: Address,
        command: u16,
        result: Result<(), CommandError>,
        outbox: &mut Outbox,
    ) {
        let now = self.model.now;
        let Some(open) = self.conversations.open.remove(&(from, command)) else {
            return;
        };
        if result.is_ok() && !open.then.is_empty() {
            self.send_first(from.system, open, outbox);
            return;
        }
        let Some(order) = self.model.orders.get_mut(open.order) else {
            return;
        };
        order.answered_at = Some(now);
        order.state = match result {
            Ok(()) => OrderState::Accepted,
            Err(CommandError::Refused { result }) => OrderState::Denied {
                result: words(result).to_owned(),
            },
            Err(CommandError::NoAnswer { .. }) => OrderState::NoAnswer,
            Err(error @ CommandError::UnderWay { .. }) => OrderState::Refused(error.to_string()),
        };
        if *order.texts == [] as [String; 0]
            && let OrderState::Denied { .. } = order.state
        {
            // What it said of its readiness shortly before is the best explanation there is until it says more.
            let vehicle = self.model.vehicles.get(&from.system);
            let reason = vehicle.and_then(|vehicle| vehicle.not_ready.back());
            if let Some(reason) = reason
                .filter(|reason| order.order == Order::Arm && now.since(reason.at).as_secs() < 5)
            {
                order.texts.push(reason.value.clone());
            }
        }
    }
}

/// Stopping and coming back are tried on any link.
fn is_safe(order: Order) -> bool {
    matches!(order, Order::Hold | Order::ReturnToLaunch | Order::Land)
}

/// The commands that carry out an order, one after the other.
fn requests(vehicle: &Vehicle, order: Order) -> Result<Vec<Request>, String> {
    let mode = |mode: Mode| {
        let number = mode
            .number(vehicle.firmware, vehicle.kind)
            .ok_or_else(|| no_mode(vehicle, mode))?;
        let [main, sub] = vehicle.firmware.mode_parameters(number);
        Ok::<_, String>(Request::long(cmd::DO_SET_MODE, &[CUSTOM_MODE, main, sub]))
    };
    Ok(match order {
        Order::Arm => vec![Request::long(cmd::COMPONENT_ARM_DISARM, &[1.0])],
        Order::Disarm => vec![Request::long(cmd::COMPONENT_ARM_DISARM, &[0.0])],
        Order::Takeoff { altitude_m } => {
            if !vehicle.kind.flies() {
                return Err(format!("{} cannot fly", vehicle.name()));
            }
            if vehicle.firmware != Firmware::ArduPilot {
                // Others take the altitude for one above mean sea level.
                return Err(format!(
                    "{} does not run ArduPilot: begin its mission with a take-off instead",
                    vehicle.name()
                ));
            }
            if !vehicle.is_armed() {
                return Err(format!("{} is not armed: arm it first", vehicle.name()));
            }
            let climb = Request::long(
                cmd::NAV_TAKEOFF,
                &[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, altitude_m as f32],
            );
            vec![mode(Mode::Guided)?, climb]
        }
        Order::StartMission => vec![Request::long(cmd::MISSION_START, &[0.0, 0.0])],
        Order::Hold => vec![mode(holding(vehicle))?],
        Order::ReturnToLaunch => vec![mode(Mode::Rtl)?],
        Order::Land => vec![mode(Mode::Land)?],
        Order::Mode(wanted) => vec![mode(wanted)?],
    })
}

fn no_mode(vehicle: &Vehicle, mode: Mode) -> String {
    let name = vehicle.name();
    match vehicle.firmware {
        Firmware::Other => format!(
            "the modes of {name}'s autopilot are unknown here: it runs neither ArduPilot nor PX4"
        ),
        Firmware::ArduPilot | Firmware::Px4 => format!("{name} has no mode {mode}"),
    }
}

/// The mode in which a vehicle stays where it is without a pilot's sticks.
fn holding(vehicle: &Vehicle) -> Mode {
    match vehicle.kind {
        _ if vehicle.firmware == Firmware::Px4 => Mode::Hold,
        Kind::Copter => Mode::Brake,
        Kind::Plane => Mode::Loiter,
        Kind::Submarine => Mode::PosHold,
        Kind::Rover | Kind::Boat | Kind::Other(_) => Mode::Hold,
    }
}

fn words(result: MavResult) -> &'static str {
    match result {
        MavResult::MAV_RESULT_ACCEPTED => "accepted",
        MavResult::MAV_RESULT_TEMPORARILY_REJECTED => "not now",
        MavResult::MAV_RESULT_DENIED => "not like this",
        MavResult::MAV_RESULT_UNSUPPORTED => "it does not know this command",
        MavResult::MAV_RESULT_FAILED => "it failed",
        MavResult::MAV_RESULT_IN_PROGRESS => "in progress",
        MavResult::MAV_RESULT_CANCELLED => "cancelled",
        MavResult::MAV_RESULT_COMMAND_LONG_ONLY
        | MavResult::MAV_RESULT_COMMAND_INT_ONLY
        | MavResult::MAV_RESULT_COMMAND_UNSUPPORTED_MAV_FRAME => {
            "it wants another form of the command"
        }
        MavResult::MAV_RESULT_NOT_IN_CONTROL => "another station is in control",
    }
}
