//! Commands to the companion: it can be asked for its messages, and refuses everything else by name.

use maps::time::Stamp;
use mavlink_ext::dialect::cmd;
use mavlink_ext::dialect::tandem::{MavResult, TANDEM_ORIGIN_DATA, TANDEM_STATUS_DATA};
use mavlink_ext::dialect::{Message, MessageData as _};
use mavlink_ext::{Address, command};

use super::Companion;
use crate::event::{Action, LinkId};

impl Companion {
    /// Carries out a command to us and acknowledges it.
    pub(super) fn obey(
        &mut self,
        now: Stamp,
        link: LinkId,
        incoming: &command::Incoming,
        act: &mut dyn FnMut(Action),
    ) {
        let (result, answer) = match incoming.command {
            cmd::REQUEST_MESSAGE => self.requested(now, link, incoming.params[0]),
            _ => (MavResult::MAV_RESULT_UNSUPPORTED, None),
        };
        self.outbox.send(link, &incoming.ack(result), act);
        if let Some(answer) = answer {
            self.outbox.send(link, &answer, act);
        }
    }

    fn requested(&self, now: Stamp, link: LinkId, id: f32) -> (MavResult, Option<Message>) {
        let is = |wanted: u32| (id - wanted as f32).abs() < 0.5;
        let ours = is(TANDEM_STATUS_DATA::ID) || is(TANDEM_ORIGIN_DATA::ID);
        if !ours {
            return (MavResult::MAV_RESULT_UNSUPPORTED, None);
        }
        if link == LinkId::Autopilot {
            // The flight controller between us would drop the answer.
            return (MavResult::MAV_RESULT_DENIED, None);
        }
        if is(TANDEM_STATUS_DATA::ID) {
            return (
                MavResult::MAV_RESULT_ACCEPTED,
                Some(self.status_message(now)),
            );
        }
        match self.origin.message() {
            Some(origin) => (MavResult::MAV_RESULT_ACCEPTED, Some(origin)),
            None => (MavResult::MAV_RESULT_TEMPORARILY_REJECTED, None),
        }
    }
}

/// Whether a command names this component. One to all components of a vehicle is its autopilot's to answer.
pub(super) fn names(own: Address, message: &Message) -> bool {
    match message {
        Message::COMMAND_LONG(long) => long.target_component == own.component.0,
        Message::COMMAND_INT(int) => int.target_component == own.component.0,
        _ => false,
    }
}
