//! Uploads: write the plan, read it back, compare. Only equal counts.

use maps::time::Stamp;
use mavlink_ext::mission::{Download, MissionItem, Upload, differences};
use mavlink_ext::service::Ends;
use mavlink_ext::{Address, ComponentId, Message, SystemId};

use super::{Outbox, Station};
use crate::model::Timed;
use crate::model::log::Severity;
use crate::model::missions::{HomeItem, Transfer};
use crate::model::vehicle::{MissionProgress, Presence};

/// Where an upload stands.
#[derive(Debug)]
pub(super) enum Conversation {
    Writing(Box<Upload>),
    Reading {
        sent: Vec<MissionItem>,
        download: Download,
    },
}

impl Station {
    /// Begins to upload the plan of a vehicle.
    pub(super) fn upload(&mut self, id: SystemId, outbox: &mut Outbox) {
        let now = self.model.now;
        let Some(mission) = self.model.missions.get_mut(&id) else {
            return;
        };
        let Some(plan) = mission.plan().filter(|_| !mission.is_transferring()) else {
            return;
        };
        let items = plan.items.clone();
        let heard = self
            .model
            .vehicles
            .get(&id)
            .is_some_and(|v| v.presence(now) == Presence::Present);
        let ends = Ends {
            own: self.own,
            peer: Address {
                system: id,
                component: ComponentId::AUTOPILOT,
            },
        };
        let started = if heard {
            Upload::start(now, ends, items).map_err(|error| error.to_string())
        } else {
            Err("the vehicle is not heard".to_owned())
        };
        match started {
            Ok((upload, message)) => {
                mission.transfer = Transfer::Uploading {
                    done: 0,
                    total: upload.items().len(),
                };
                self.transfers
                    .insert(id, Conversation::Writing(Box::new(upload)));
                outbox.push(message);
            }
            Err(reason) => mission.transfer = Transfer::Failed { at: now, reason },
        }
    }

    /// Lets the conversations hear a message.
    pub(super) fn hear_transfer(
        &mut self,
        now: Stamp,
        from: Address,
        message: &Message,
        outbox: &mut Outbox,
    ) {
        if let Some(conversation) = self.transfers.remove(&from.system) {
            self.continue_transfer(from.system, conversation, outbox, |conversation| {
                match conversation {
                    Conversation::Writing(upload) => {
                        Progress::of_upload(upload.handle(now, from, message))
                    }
                    Conversation::Reading { download, .. } => {
                        Progress::of_download(download.handle(now, from, message))
                    }
                }
            });
        }
    }

    /// Lets time pass in the conversations.
    pub(super) fn tick_transfers(&mut self, outbox: &mut Outbox) {
        let now = self.model.now;
        for (id, conversation) in std::mem::take(&mut self.transfers) {
            self.continue_transfer(
                id,
                conversation,
                outbox,
                |conversation| match conversation {
                    Conversation::Writing(upload) => Progress::of_upload(upload.tick(now)),
                    Conversation::Reading { download, .. } => {
                        Progress::of_download(download.tick(now))
                    }
                },
            );
        }
    }

    fn continue_transfer(
        &mut self,
        id: SystemId,
        mut conversation: Conversation,
        outbox: &mut Outbox,
        go_on: impl FnOnce(&mut Conversation) -> Progress,
    ) {
        let progress = go_on(&mut conversation);
        outbox.extend(progress.send);
        match progress.end {
            None => {
                self.show_transfer(id, state_of(&conversation));
                self.transfers.insert(id, conversation);
            }
            Some(Err(reason)) => self.end_transfer(
                id,
                Transfer::Failed {
                    at: self.model.now,
                    reason,
                },
            ),
            Some(Ok(read)) => self.transfer_went_through(id, conversation, &read, outbox),
        }
    }

    fn transfer_went_through(
        &mut self,
        id: SystemId,
        conversation: Conversation,
        read: &[MissionItem],
        outbox: &mut Outbox,
    ) {
        let at = self.model.now;
        match conversation {
            Conversation::Writing(upload) => {
                let ends = Ends {
                    own: self.own,
                    peer: Address {
                        system: id,
                        component: ComponentId::AUTOPILOT,
                    },
                };
                let (download, message) = Download::start(at, ends);
                outbox.push(message);
                self.show_transfer(id, Transfer::ReadingBack { done: 0, total: 0 });
                let sent = upload.items().to_vec();
                self.transfers
                    .insert(id, Conversation::Reading { sent, download });
            }
            Conversation::Reading { sent, .. } => {
                let found = differences(&sent, &self.without_home(id, &sent, read));
                let transfer = if found.is_empty() {
                    Transfer::Verified {
                        at,
                        items: read.len(),
                    }
                } else {
                    Transfer::Differs {
                        at,
                        differences: found.iter().map(ToString::to_string).collect(),
                    }
                };
                self.end_transfer(id, transfer);
            }
        }
    }

    /// What was read back, but for the home position, which is the vehicle's own affair.
    fn without_home(
        &self,
        id: SystemId,
        sent: &[MissionItem],
        read: &[MissionItem],
    ) -> Vec<MissionItem> {
        let mut read = read.to_vec();
        let plan = self
            .model
            .missions
            .get(&id)
            .and_then(|mission| mission.plan());
        if let (Some(HomeItem::First), Some(sent), Some(read)) =
            (plan.map(|plan| plan.home), sent.first(), read.first_mut())
        {
            *read = *sent;
        }
        read
    }

    fn show_transfer(&mut self, id: SystemId, transfer: Transfer) {
        if let Some(mission) = self.model.missions.get_mut(&id) {
            mission.transfer = transfer;
        }
    }

    fn end_transfer(&mut self, id: SystemId, transfer: Transfer) {
        let name = self.model.name_of(id);
        let (severity, text) = match &transfer {
            Transfer::Verified { items, .. } => (
                Severity::Notice,
                format!("{name} has all {items} items, verified"),
            ),
            Transfer::Differs { differences, .. } => (
                Severity::Error,
                format!("{name} has another mission: {}", differences.join("; ")),
            ),
            Transfer::Failed { reason, .. } => (
                Severity::Error,
                format!("upload to {name} failed: {reason}"),
            ),
            Transfer::None | Transfer::Uploading { .. } | Transfer::ReadingBack { .. } => return,
        };
        self.say(severity, text);
        let at = self.model.now;
        let verified = matches!(transfer, Transfer::Verified { .. });
        self.show_transfer(id, transfer);
        if let Some(vehicle) = self.model.vehicles.get_mut(&id).filter(|_| verified) {
            // What was reached of an earlier mission says nothing about this one.
            vehicle.mission = Some(Timed::new(MissionProgress::default(), at));
        }
    }
}

fn state_of(conversation: &Conversation) -> Transfer {
    match conversation {
        Conversation::Writing(upload) => {
            let (done, total) = upload.progress();
            Transfer::Uploading { done, total }
        }
        Conversation::Reading { download, .. } => {
            let (done, total) = download.progress();
            Transfer::ReadingBack { done, total }
        }
    }
}

/// What one message or tick did to a conversation.
struct Progress {
    send: Vec<Message>,
    /// What was read, nothing for an upload; or why it failed.
    end: Option<Result<Vec<MissionItem>, String>>,
}

type Step<T> = mavlink_ext::service::Step<Result<T, mavlink_ext::mission::MissionError>>;

impl Progress {
    fn of_upload(step: Step<()>) -> Self {
        let end = step.events.into_iter().next();
        let end = end.map(|end| end.map(|()| Vec::new()).map_err(|error| error.to_string()));
        Self {
            send: step.send,
            end,
        }
    }

    fn of_download(step: Step<Vec<MissionItem>>) -> Self {
        let end = step.events.into_iter().next();
        Self {
            send: step.send,
            end: end.map(|end| end.map_err(|error| error.to_string())),
        }
    }
}
