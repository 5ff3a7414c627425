//! Copies of commands on links that lose, and those of what comes back: see [`mavlink_ext::repeat`].

use std::collections::{BTreeMap, BTreeSet};

use maps::time::Stamp;
use mavlink_ext::dialect::TANDEM_IDS;
use mavlink_ext::repeat::{Duplicates, Reception, Repeater};
use mavlink_ext::{Address, RawFrame, SystemId};

#[derive(Debug, Default)]
struct Lane {
    reception: Reception,
    /// Vehicles with a companion, which drops the copies that it is sent; an autopilot would obey each of them.
    with_companion: BTreeSet<SystemId>,
    repeater: Repeater,
}

/// Of all links.
#[derive(Debug, Default)]
pub(super) struct Copies {
    duplicates: Duplicates,
    lanes: BTreeMap<usize, Lane>,
}

impl Copies {
    /// A frame came on a link.
    pub(super) fn heard(&mut self, now: Stamp, link: usize, frame: &RawFrame) {
        let lane = self.lanes.entry(link).or_default();
        lane.reception.heard(frame);
        if TANDEM_IDS.contains(&frame.message_id()) {
            lane.with_companion.insert(frame.from().system);
        }
        lane.repeater
            .set_loss(lane.reception.loss().unwrap_or_default());
        let is_copy = !self.duplicates.is_new(now, frame);
        lane.repeater.heard(now, frame, is_copy);
    }

    /// A frame is sent on a link. What is sent on all links, or to all, has no copies.
    pub(super) fn sent(&mut self, now: Stamp, link: Option<usize>, frame: &RawFrame) {
        let lane = link.and_then(|link| self.lanes.get_mut(&link));
        if let Some((lane, target)) = lane.zip(frame.target())
            && lane.with_companion.contains(&target.system)
        {
            lane.repeater.sent(now, frame);
        }
    }

    /// These commands are not wanted any more at this vehicle.
    pub(super) fn forget(&mut self, vehicle: Address, commands: &[u16]) {
        for lane in self.lanes.values_mut() {
            lane.repeater.forget(vehicle, commands);
        }
    }

    /// Copies whose time has come, and their links.
    pub(super) fn due(&mut self, now: Stamp) -> Vec<(usize, RawFrame)> {
        let mut due = Vec::new();
        for (link, lane) in &mut self.lanes {
            let copies = lane.repeater.tick(now);
            due.extend(copies.into_iter().map(|copy| (*link, copy)));
        }
        due
    }

    /// When the next is.
    pub(super) fn next_due(&self) -> Option<Stamp> {
        (self.lanes.values())
            .filter_map(|lane| lane.repeater.due())
            .min()
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use mavlink_ext::dialect::tandem::{COMMAND_LONG_DATA, HEARTBEAT_DATA, TANDEM_STATUS_DATA};
    use mavlink_ext::{Encoder, Message};

    use super::*;

    const COMPANION: Address = Address::new(1, 191);
    const ROVER: Address = Address::new(2, 1);

    fn command_to(target: Address) -> RawFrame {
        let command = COMMAND_LONG_DATA {
            target_system: target.system.0,
            target_component: target.component.0,
            ..COMMAND_LONG_DATA::default()
        };
        Encoder::new(Address::new(255, 190)).encode(&Message::COMMAND_LONG(command))
    }

    #[test]
    fn commands_have_copies_on_a_link_that_loses_and_only_where_a_companion_drops_them() {
        let mut copies = Copies::default();
        let mut companion = Encoder::new(COMPANION);
        let mut rover = Encoder::new(ROVER);
        let at = |millis| Stamp::ZERO + Duration::from_millis(millis);
        for number in 0..100 {
            let status = Message::TANDEM_STATUS(TANDEM_STATUS_DATA::default());
            let heartbeat = Message::HEARTBEAT(HEARTBEAT_DATA::default());
            for frame in [companion.encode(&status), rover.encode(&heartbeat)] {
                if number % 5 != 0 {
                    copies.heard(at(number * 100), 0, &frame);
                }
            }
        }
        copies.sent(at(10_000), Some(0), &command_to(ROVER));
        assert_eq!(copies.next_due(), None);
        let command = command_to(COMPANION);
        copies.sent(at(10_000), Some(0), &command);
        assert_eq!(copies.next_due(), Some(at(10_002)));
        assert_eq!(copies.due(at(10_050)), vec![(0, command); 4]);
        copies.forget(COMPANION, &[0]);
        assert_eq!(copies.next_due(), None);
    }
}
