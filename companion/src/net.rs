//! The MAVLink links, as two sockets whose frames become events.
//!
//! A link's thread never waits: when the event queue is full, which takes a program that hangs, telemetry is dropped
//! and counted.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::SyncSender;

use maps::time::Stamp;
use mavlink_ext::RawFrame;
use mavlink_ext::link::{Link, LinkError, LinkUri};

use crate::clock::Clock;
use crate::config::Settings;
use crate::event::{Event, LinkId};

/// The open links.
pub struct Links {
    autopilot: Option<Link>,
    ground: Option<Link>,
    dropped: Arc<AtomicU64>,
}

impl Links {
    /// Opens what is configured; frames go to `events`.
    pub fn open(
        settings: &Settings,
        clock: Clock,
        events: &SyncSender<(Stamp, Event)>,
    ) -> Result<Self, LinkError> {
        let dropped = Arc::new(AtomicU64::new(0));
        let open = |id: LinkId, uri: &LinkUri| {
            let (events, dropped) = (events.clone(), Arc::clone(&dropped));
            Link::open(&uri.to_string(), move |frame| {
                let event = (clock.now(), Event::Received(id, frame));
                if events.try_send(event).is_err() {
                    dropped.fetch_add(1, Ordering::Relaxed);
                }
            })
        };
        let autopilot = settings.autopilot.as_ref();
        let ground = settings.ground.as_ref();
        Ok(Self {
            autopilot: autopilot
                .map(|uri| open(LinkId::Autopilot, uri))
                .transpose()?,
            ground: ground.map(|uri| open(LinkId::Ground, uri)).transpose()?,
            dropped,
        })
    }

    /// Sends a frame. What a link cannot send is lost, as on the air; services repeat what matters.
    pub fn send(&self, id: LinkId, frame: &RawFrame) {
        let link = match id {
            LinkId::Autopilot => &self.autopilot,
            LinkId::Ground => &self.ground,
        };
        if let Some(link) = link
            && let Err(error) = link.send(frame)
        {
            tracing::debug!(?id, %error, "frame not sent");
        }
    }

    /// Frames dropped because the program did not keep up.
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }
}
