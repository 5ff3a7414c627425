//! A vehicle's parameters.

use super::{Encoding, Parameter, from_wire_name, to_wire_name};
use crate::dialect::Message;
use crate::dialect::tandem::PARAM_VALUE_DATA;
use crate::service::{Step, is_for};
use crate::wire::Address;

/// Values sent in one tick when the whole list was asked for.
const VALUES_PER_TICK: usize = 10;
/// The index in a value that nobody asked for by index.
const NO_INDEX: u16 = u16::MAX;

/// A client has set a parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Changed {
    /// Its name.
    pub name: String,
    /// Its new value.
    pub value: f64,
}

/// Parameters that clients read and set. Values are cast to floats.
#[derive(Clone, Debug)]
pub struct Server {
    own: Address,
    parameters: Vec<Parameter>,
    /// The next one to send of the list that was asked for.
    listing: Option<usize>,
}

impl Server {
    /// These parameters, in this order.
    pub fn new(own: Address, parameters: Vec<Parameter>) -> Self {
        Self {
            own,
            parameters,
            listing: None,
        }
    }

    /// The value of a parameter.
    pub fn get(&self, name: &str) -> Option<f64> {
        self.parameters
            .iter()
            .find(|parameter| parameter.name == name)
            .map(|parameter| parameter.value)
    }

    /// All of them.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// Tells it of any message that came in.
    pub fn handle(&mut self, message: &Message) -> Step<Changed> {
        if !is_for(self.own, message) {
            return Step::none();
        }
        match message {
            Message::PARAM_REQUEST_LIST(_) => {
                self.listing = Some(0);
                Step::none()
            }
            Message::PARAM_REQUEST_READ(request) => {
                let index = usize::try_from(request.param_index).ok().or_else(|| {
                    let name = from_wire_name(&request.param_id)?;
                    self.parameters.iter().position(|p| p.name == name)
                });
                let value = index.and_then(|index| self.value(index, index as u16));
                value.map_or_else(Step::none, Step::send)
            }
            Message::PARAM_SET(set) => {
                let Some(name) = from_wire_name(&set.param_id) else {
                    return Step::none();
                };
                let Some(index) = self.parameters.iter().position(|p| p.name == name) else {
                    return Step::none();
                };
                self.set(index, set.param_value)
            }
            _ => Step::none(),
        }
    }

    /// Answers with the value that holds now: a value that is no number changes nothing.
    fn set(&mut self, index: usize, wire: f32) -> Step<Changed> {
        let parameter = &mut self.parameters[index];
        let mut step = Step::none();
        if wire.is_finite() {
            parameter.value = Encoding::Cast.decode(parameter.kind, wire);
            step.events.push(Changed {
                name: parameter.name.clone(),
                value: parameter.value,
            });
        }
        step.send.extend(self.value(index, NO_INDEX));
        step
    }

    fn value(&self, index: usize, param_index: u16) -> Option<Message> {
        let parameter = self.parameters.get(index)?;
        Some(Message::PARAM_VALUE(PARAM_VALUE_DATA {
            param_value: Encoding::Cast.encode(parameter.kind, parameter.value),
            param_count: self.parameters.len() as u16,
            param_index,
            param_id: to_wire_name(&parameter.name),
            param_type: parameter.kind,
        }))
    }

    /// Lets time pass: sends some of the list that was asked for.
    pub fn tick(&mut self) -> Step<Changed> {
        let Some(start) = self.listing else {
            return Step::none();
        };
        let end = (start + VALUES_PER_TICK).min(self.parameters.len());
        self.listing = (end < self.parameters.len()).then_some(end);
        let values = (start..end).filter_map(|index| self.value(index, index as u16));
        Step {
            send: values.collect(),
            events: Vec::new(),
        }
    }
}
