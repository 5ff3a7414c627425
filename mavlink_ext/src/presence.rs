//! Heartbeats: ours once a second, and who else is there.
//!
//! <https://mavlink.io/en/services/heartbeat.html>: sent from the working loop, so that a hung program falls silent. What
//! a component is follows from the heartbeat's type, never from its id.

use std::collections::BTreeMap;
use std::time::Duration;

use maps::time::Stamp;

use crate::dialect::Message;
use crate::dialect::tandem::{HEARTBEAT_DATA, MavAutopilot, MavModeFlag, MavState, MavType};
use crate::service::Step;
use crate::wire::Address;

/// Time between our heartbeats.
const INTERVAL: Duration = Duration::from_secs(1);
/// After so long a silence a peer is lost: four heartbeats missed, with half an interval to spare.
pub const LOST_AFTER: Duration = Duration::from_millis(4500);
/// More peers than this are not remembered.
const MAX_PEERS: usize = 256;

/// Somebody whose heartbeats we hear, or heard.
#[derive(Clone, Debug, PartialEq)]
pub struct Peer {
    /// The newest heartbeat.
    pub heartbeat: HEARTBEAT_DATA,
    /// When it came.
    pub last_heartbeat: Stamp,
    /// Whether it is still there.
    pub alive: bool,
}

impl Peer {
    /// Whether it is a flight controller, not a camera, a companion or a ground station.
    pub fn is_autopilot(&self) -> bool {
        self.heartbeat.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID
    }

    /// Whether its motors may turn.
    pub fn is_armed(&self) -> bool {
        self.heartbeat
            .base_mode
            .contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED)
    }
}

/// What changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PresenceEvent {
    /// Somebody is heard for the first time, or again.
    Appeared(Address),
    /// Somebody is not heard any more.
    Lost(Address),
}

/// Says that we are there, and knows who else is.
#[derive(Clone, Debug)]
pub struct Presence {
    own: Address,
    heartbeat: HEARTBEAT_DATA,
    due: Stamp,
    peers: BTreeMap<Address, Peer>,
}

impl Presence {
    /// Heartbeats with this content, the first one at the first tick.
    pub fn new(own: Address, heartbeat: HEARTBEAT_DATA) -> Self {
        Self {
            own,
            heartbeat,
            due: Stamp::ZERO,
            peers: BTreeMap::new(),
        }
    }

    /// Everybody heard so far, lost ones too.
    pub fn peers(&self) -> &BTreeMap<Address, Peer> {
        &self.peers
    }

    /// Whether this peer is there.
    pub fn is_alive(&self, peer: Address) -> bool {
        self.peers.get(&peer).is_some_and(|peer| peer.alive)
    }

    /// Tells it of any message that came in.
    pub fn handle(&mut self, now: Stamp, from: Address, message: &Message) -> Step<PresenceEvent> {
        let Message::HEARTBEAT(heartbeat) = message else {
            return Step::none();
        };
        let known = self.peers.get(&from);
        // Our own heartbeat came back to us through some loop; a flood of senders does not fill the memory.
        if from == self.own || (known.is_none() && self.peers.len() >= MAX_PEERS) {
            return Step::none();
        }
        let appeared = !known.is_some_and(|peer| peer.alive);
        let peer = Peer {
            heartbeat: heartbeat.clone(),
            last_heartbeat: now,
            alive: true,
        };
        self.peers.insert(from, peer);
        if appeared {
            Step::event(PresenceEvent::Appeared(from))
        } else {
            Step::none()
        }
    }

    /// Lets time pass: sends our heartbeat when it is due, and notices who fell silent.
    pub fn tick(&mut self, now: Stamp) -> Step<PresenceEvent> {
        let mut step = Step::none();
        if now >= self.due {
            // Counted from now, not from when it was due: after a stall there is no burst.
            self.due = now + INTERVAL;
            step.send.push(Message::HEARTBEAT(self.heartbeat.clone()));
        }
        for (address, peer) in &mut self.peers {
            if peer.alive && now.since(peer.last_heartbeat) > LOST_AFTER {
                peer.alive = false;
                step.events.push(PresenceEvent::Lost(*address));
            }
        }
        step
    }
}

/// The heartbeat of a companion computer.
pub fn companion_heartbeat() -> HEARTBEAT_DATA {
    peripheral_heartbeat(MavType::MAV_TYPE_ONBOARD_CONTROLLER)
}

/// The heartbeat of a ground station.
pub fn ground_station_heartbeat() -> HEARTBEAT_DATA {
    peripheral_heartbeat(MavType::MAV_TYPE_GCS)
}

fn peripheral_heartbeat(mavtype: MavType) -> HEARTBEAT_DATA {
    HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OWN: Address = Address::new(255, 190);
    const COMPANION: Address = Address::new(1, 191);

    fn hear(presence: &mut Presence, at: Stamp, from: Address) -> Vec<PresenceEvent> {
        let message = Message::HEARTBEAT(companion_heartbeat());
        presence.handle(at, from, &message).events
    }

    #[test]
    fn a_peer_appears_is_lost_after_four_and_a_half_seconds_and_appears_again() {
        let mut presence = Presence::new(OWN, ground_station_heartbeat());
        let start = Stamp::from_nanos(7);
        assert_eq!(
            hear(&mut presence, start, COMPANION),
            [PresenceEvent::Appeared(COMPANION)]
        );
        assert!(hear(&mut presence, start, COMPANION).is_empty());
        assert!(presence.tick(start + LOST_AFTER).events.is_empty());
        let late = start + LOST_AFTER + Duration::from_nanos(1);
        assert_eq!(presence.tick(late).events, [PresenceEvent::Lost(COMPANION)]);
        assert!(presence.tick(late).events.is_empty(), "told once");
        assert!(!presence.is_alive(COMPANION));
        assert_eq!(
            hear(&mut presence, late, COMPANION),
            [PresenceEvent::Appeared(COMPANION)]
        );
        assert!(!presence.peers()[&COMPANION].is_autopilot());
    }

    #[test]
    fn heartbeats_go_out_once_a_second_and_never_in_a_burst() {
        let mut presence = Presence::new(OWN, ground_station_heartbeat());
        let at = |millis| Stamp::ZERO + Duration::from_millis(millis);
        let sent: usize = (0..100)
            .map(|tick| presence.tick(at(tick * 50)).send.len())
            .sum();
        assert_eq!(sent, 5, "in five seconds");
        let after_a_stall: usize = (0..10)
            .map(|tick| presence.tick(at(60_000 + tick * 50)).send.len())
            .sum();
        assert_eq!(after_a_stall, 1);
    }

    #[test]
    fn our_own_echo_is_nobody_and_a_flood_is_bounded() {
        let mut presence = Presence::new(OWN, ground_station_heartbeat());
        assert!(hear(&mut presence, Stamp::ZERO, OWN).is_empty());
        for system in 0..=u8::MAX {
            for component in 0..=u8::MAX {
                hear(&mut presence, Stamp::ZERO, Address::new(system, component));
            }
        }
        assert_eq!(presence.peers().len(), MAX_PEERS);
    }
}
