//! Reads all parameters of a vehicle, and sets single ones.

use std::collections::BTreeMap;
use std::time::Duration;

use maps::time::Stamp;

use super::{Encoding, Parameter, from_wire_name, to_wire_name};
use crate::dialect::Message;
use crate::dialect::tandem::{
    PARAM_REQUEST_LIST_DATA, PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, PARAM_VALUE_DATA,
};
use crate::service::{Due, Ends, Retry, Step};
use crate::wire::Address;

/// Silence before what is missing is asked for, or a setting repeated.
const TIMEOUT: Duration = Duration::from_secs(1);
/// How often.
const RETRIES: u32 = 5;
/// Missing values asked for at once.
const BATCH: usize = 10;

/// Why parameters could not be read or set.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ParamError {
    /// The vehicle stopped answering.
    #[error("no answer from the vehicle after {read} of {total} parameters")]
    NoAnswer {
        /// Parameters read.
        read: usize,
        /// Parameters of the vehicle; 0 if it never answered.
        total: usize,
    },
    /// The vehicle does not confirm a setting.
    #[error("the vehicle does not confirm parameter {name}")]
    NotConfirmed {
        /// Its name.
        name: String,
    },
}

/// What happened.
#[derive(Clone, Debug, PartialEq)]
pub enum ClientEvent {
    /// All parameters were read, or could not be.
    Read(Result<(), ParamError>),
    /// A parameter was set: the vehicle says it has this value now, which may be another than was asked for.
    Set(Result<Parameter, ParamError>),
}

/// A client for one vehicle's parameters.
#[derive(Clone, Debug)]
pub struct Client {
    ends: Ends,
    encoding: Encoding,
    /// By index.
    known: BTreeMap<u16, Parameter>,
    total: usize,
    reading: Option<Retry>,
    setting: Option<(Parameter, Retry)>,
}

impl Client {
    /// Knows nothing yet.
    pub fn new(ends: Ends, encoding: Encoding) -> Self {
        Self {
            ends,
            encoding,
            known: BTreeMap::new(),
            total: 0,
            reading: None,
            setting: None,
        }
    }

    /// The parameters read so far, in the vehicle's order.
    pub fn parameters(&self) -> impl Iterator<Item = &Parameter> {
        self.known.values()
    }

    /// How many were read, and how many there are.
    pub fn progress(&self) -> (usize, usize) {
        (self.known.len(), self.total)
    }

    /// Begins to read all of them.
    pub fn read_all(&mut self, now: Stamp) -> Message {
        self.known.clear();
        self.total = 0;
        self.reading = Some(Retry::new(now, TIMEOUT, RETRIES));
        self.list()
    }

    /// Begins to set one. A setting that is not confirmed yet is forgotten.
    pub fn set(&mut self, now: Stamp, parameter: Parameter) -> Message {
        let message = self.set_message(&parameter);
        self.setting = Some((parameter, Retry::new(now, TIMEOUT, RETRIES)));
        message
    }

    /// Tells it of any message that came in.
    pub fn handle(&mut self, now: Stamp, from: Address, message: &Message) -> Step<ClientEvent> {
        match message {
            Message::PARAM_VALUE(value) if from == self.ends.peer => self.value(now, value),
            _ => Step::none(),
        }
    }

    fn value(&mut self, now: Stamp, value: &PARAM_VALUE_DATA) -> Step<ClientEvent> {
        let Some(name) = from_wire_name(&value.param_id) else {
            return Step::none();
        };
        let parameter = Parameter {
            name,
            value: self.encoding.decode(value.param_type, value.param_value),
            kind: value.param_type,
        };
        let mut step = Step::none();
        if let Some((asked, _)) = &self.setting
            && asked.name == parameter.name
        {
            self.setting = None;
            step.events.push(ClientEvent::Set(Ok(parameter.clone())));
        }
        let known = self.known.values_mut().find(|p| p.name == parameter.name);
        if let Some(known) = known {
            *known = parameter;
        } else if value.param_index < value.param_count {
            self.known.insert(value.param_index, parameter);
            self.total = usize::from(value.param_count);
        }
        if self.reading.is_some() {
            self.reading = Some(Retry::new(now, TIMEOUT, RETRIES));
            if self.total > 0 && self.known.len() >= self.total {
                self.reading = None;
                step.events.push(ClientEvent::Read(Ok(())));
            }
        }
        step
    }

    /// Lets time pass: asks for what is missing, repeats settings, and gives up in the end.
    pub fn tick(&mut self, now: Stamp) -> Step<ClientEvent> {
        let mut step = Step::none();
        match self.reading.as_mut().map(|retry| retry.check(now)) {
            None | Some(Due::Nothing) => {}
            Some(Due::Again) if self.total == 0 => step.send.push(self.list()),
            Some(Due::Again) => {
                let missing = (0..self.total as u16).filter(|i| !self.known.contains_key(i));
                step.send
                    .extend(missing.take(BATCH).map(|index| self.request(index)));
            }
            Some(Due::GiveUp) => {
                self.reading = None;
                let (read, total) = self.progress();
                let error = ParamError::NoAnswer { read, total };
                step.events.push(ClientEvent::Read(Err(error)));
            }
        }
        let due = self.setting.as_mut().map(|(_, retry)| retry.check(now));
        if let Some((parameter, _)) = &self.setting {
            match due {
                None | Some(Due::Nothing) => {}
                Some(Due::Again) => step.send.push(self.set_message(parameter)),
                Some(Due::GiveUp) => {
                    let name = parameter.name.clone();
                    let error = ParamError::NotConfirmed { name };
                    step.events.push(ClientEvent::Set(Err(error)));
                    self.setting = None;
                }
            }
        }
        step
    }

    fn list(&self) -> Message {
        Message::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA {
            target_system: self.ends.peer.system.0,
            target_component: self.ends.peer.component.0,
        })
    }

    fn request(&self, index: u16) -> Message {
        Message::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
            param_index: i16::try_from(index).unwrap_or(i16::MAX),
            target_system: self.ends.peer.system.0,
            target_component: self.ends.peer.component.0,
            param_id: to_wire_name(""),
        })
    }

    fn set_message(&self, parameter: &Parameter) -> Message {
        Message::PARAM_SET(PARAM_SET_DATA {
            param_value: self.encoding.encode(parameter.kind, parameter.value),
            target_system: self.ends.peer.system.0,
            target_component: self.ends.peer.component.0,
            param_id: to_wire_name(&parameter.name),
            param_type: parameter.kind,
        })
    }
}
