//! Commands and their acknowledgements, both ends.
//!
//! A client repeats a command until it is acknowledged, counting `confirmation` up, and waits longer while the vehicle
//! says that it is in progress. At most one command of a number is under way at one vehicle, since an acknowledgement
//! names only the number. A command under way can be cancelled, and a newer one can take the place of those that are still
//! repeated. <https://mavlink.io/en/services/command.html>

mod client;
#[cfg(test)]
mod tests;

use crate::convert::{deg_to_e7, e7_to_deg};
use crate::dialect::Message;
use crate::dialect::tandem::{
    COMMAND_ACK_DATA, COMMAND_INT_DATA, COMMAND_LONG_DATA, MavFrame, MavResult,
};
use crate::service::is_for;
use crate::wire::Address;

pub use client::{Client, Superseding};

/// `COMMAND_ACK.progress` where it is not known.
const PROGRESS_UNKNOWN: u8 = u8::MAX;

/// What is to be done.
#[derive(Clone, Debug, PartialEq)]
pub enum Request {
    /// `COMMAND_LONG`: seven plain parameters.
    Long {
        /// `MAV_CMD`, see [`crate::dialect::cmd`].
        command: u16,
        /// Parameters 1 to 7.
        params: [f32; 7],
    },
    /// `COMMAND_INT`: with a position, which single precision could not hold.
    At {
        /// `MAV_CMD`.
        command: u16,
        /// What the altitude is measured from.
        frame: MavFrame,
        /// Parameters 1 to 4.
        params: [f32; 4],
        /// Latitude, WGS-84.
        lat_deg: f64,
        /// Longitude, WGS-84.
        lon_deg: f64,
        /// Altitude in the frame.
        alt_m: f32,
    },
}

impl Request {
    /// A command of up to seven parameters; those not given are 0.
    pub fn long(command: u16, first_params: &[f32]) -> Self {
        let mut params = [0.0; 7];
        for (to, from) in params.iter_mut().zip(first_params) {
            *to = *from;
        }
        Self::Long { command, params }
    }

    /// Its number.
    pub fn command(&self) -> u16 {
        match self {
            Self::Long { command, .. } | Self::At { command, .. } => *command,
        }
    }

    fn to_message(&self, to: Address, confirmation: u8) -> Message {
        match *self {
            Self::Long { command, params } => {
                let [param1, param2, param3, param4, param5, param6, param7] = params;
                Message::COMMAND_LONG(COMMAND_LONG_DATA {
                    param1,
                    param2,
                    param3,
                    param4,
                    param5,
                    param6,
                    param7,
                    command,
                    target_system: to.system.0,
                    target_component: to.component.0,
                    confirmation,
                })
            }
            Self::At {
                command,
                frame,
                params: [param1, param2, param3, param4],
                lat_deg,
                lon_deg,
                alt_m,
            } => Message::COMMAND_INT(COMMAND_INT_DATA {
                param1,
                param2,
                param3,
                param4,
                x: deg_to_e7(lat_deg),
                y: deg_to_e7(lon_deg),
                z: alt_m,
                command,
                target_system: to.system.0,
                target_component: to.component.0,
                frame,
                current: 0,
                autocontinue: 0,
            }),
        }
    }
}

/// How a command ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Who was commanded.
    pub vehicle: Address,
    /// Which command.
    pub command: u16,
    /// What came of it.
    pub result: Result<(), CommandError>,
}

/// Why a command was not carried out.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CommandError {
    /// The vehicle will not, or cannot.
    #[error("the vehicle answered {result:?}")]
    Refused {
        /// Its answer.
        result: MavResult,
    },
    /// The vehicle does not answer.
    #[error("no answer from the vehicle to {tries} tries")]
    NoAnswer {
        /// How often it was sent.
        tries: u32,
    },
    /// The same command is under way at that vehicle.
    #[error("command {command} is already under way")]
    UnderWay {
        /// Its number.
        command: u16,
    },
}

impl CommandError {
    /// Whether the vehicle ended it because it was told to: `MAV_RESULT_CANCELLED`.
    pub fn is_cancelled(self) -> bool {
        let result = MavResult::MAV_RESULT_CANCELLED;
        self == Self::Refused { result }
    }
}

/// A command that a vehicle received, from either message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Incoming {
    /// Who commands.
    pub from: Address,
    /// `MAV_CMD`.
    pub command: u16,
    /// Parameters 1 to 4.
    pub params: [f32; 4],
    /// Parameters 5 and 6: degrees of latitude and longitude where the command has a position.
    pub x: f64,
    /// See `x`.
    pub y: f64,
    /// Parameter 7: an altitude where the command has a position.
    pub z: f32,
    /// What a position means; `None` in a `COMMAND_LONG`, where the command decides.
    pub frame: Option<MavFrame>,
    /// How often it was repeated.
    pub confirmation: u8,
}

impl Incoming {
    /// The command in a message for `own`; `None` if it is another message, or for somebody else.
    pub fn parse(own: Address, from: Address, message: &Message) -> Option<Self> {
        if !is_for(own, message) {
            return None;
        }
        match message {
            Message::COMMAND_LONG(long) => Some(Self {
                from,
                command: long.command,
                params: [long.param1, long.param2, long.param3, long.param4],
                x: f64::from(long.param5),
                y: f64::from(long.param6),
                z: long.param7,
                frame: None,
                confirmation: long.confirmation,
            }),
            Message::COMMAND_INT(int) => {
                let local = matches!(
                    int.frame,
                    MavFrame::MAV_FRAME_LOCAL_NED
                        | MavFrame::MAV_FRAME_LOCAL_ENU
                        | MavFrame::MAV_FRAME_LOCAL_FRD
                        | MavFrame::MAV_FRAME_BODY_FRD
                );
                // "local: x position in meters * 1e4, global: latitude in degrees * 10^7"
                let scaled = |v: i32| {
                    if local {
                        f64::from(v) * 1e-4
                    } else {
                        e7_to_deg(v)
                    }
                };
                Some(Self {
                    from,
                    command: int.command,
                    params: [int.param1, int.param2, int.param3, int.param4],
                    x: scaled(int.x),
                    y: scaled(int.y),
                    z: int.z,
                    frame: Some(int.frame),
                    confirmation: 0,
                })
            }
            _ => None,
        }
    }

    /// The acknowledgement.
    pub fn ack(&self, result: MavResult) -> Message {
        self.ack_with(result, 0)
    }

    /// The acknowledgement that it is being carried out, 0 to 100 percent of it done; `None` if that is not known. To be
    /// repeated every few seconds until it is done: a client waits 10 s for the next.
    pub fn in_progress(&self, percent: Option<u8>) -> Message {
        let progress = percent.map_or(PROGRESS_UNKNOWN, |percent| percent.min(100));
        self.ack_with(MavResult::MAV_RESULT_IN_PROGRESS, progress)
    }

    fn ack_with(&self, result: MavResult, progress: u8) -> Message {
        Message::COMMAND_ACK(COMMAND_ACK_DATA {
            command: self.command,
            result,
            progress,
            result_param2: 0,
            target_system: self.from.system.0,
            target_component: self.from.component.0,
        })
    }
}

/// A `COMMAND_CANCEL` that a vehicle received. It has no answer of its own: the command that it ends is acknowledged with
/// `MAV_RESULT_CANCELLED`, to whoever gave it ([`Incoming::ack`]). One that is over needs nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cancel {
    /// Who cancels; perhaps not who commanded.
    pub from: Address,
    /// `MAV_CMD`.
    pub command: u16,
}

impl Cancel {
    /// The cancellation in a message for `own`; `None` if it is another message, for somebody else, or for all, which the
    /// protocol forbids.
    pub fn parse(own: Address, from: Address, message: &Message) -> Option<Self> {
        let Message::COMMAND_CANCEL(cancel) = message else {
            return None;
        };
        let is_ours = cancel.target_system != 0 && is_for(own, message);
        is_ours.then_some(Self {
            from,
            command: cancel.command,
        })
    }
}
