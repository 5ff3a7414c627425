//! What waits to be sent, by class.

use std::collections::VecDeque;
use std::sync::Arc;

use maps::time::Stamp;

use super::OfferError;
use super::transfer::priority;
use crate::object::{Object, ObjectId, Service};

/// An object, and when it was offered.
#[derive(Clone, Debug)]
pub(super) struct Waiting {
    pub(super) object: Arc<Object>,
    pub(super) offered: Stamp,
}

/// Whether the older object is worth nothing once the newer one is there.
pub(super) fn replaces(newer: &Object, older: &Object) -> bool {
    match newer.service {
        Service::Reliable | Service::BestEffort => {
            (older.id.stream, older.id.key) == (newer.id.stream, newer.id.key)
                && older.service == newer.service
        }
        Service::Latest { .. } => {
            older.id.stream == newer.id.stream && matches!(older.service, Service::Latest { .. })
        }
    }
}

/// Objects that wait, those of each priority in a line of their own.
#[derive(Debug, Default)]
pub(super) struct Queue([VecDeque<Waiting>; 3]);

impl Queue {
    /// Takes an object, unless more than `max_bytes` would wait. Whether it has taken the place of an older one: what changes
    /// often is not always last.
    pub(super) fn push(&mut self, waiting: Waiting, max_bytes: usize) -> Result<bool, OfferError> {
        let object = &waiting.object;
        let line = usize::from(priority(object.service));
        let mut places = self.0[line].iter();
        let place = places.position(|older| replaces(object, &older.object));
        let freed = place.map_or(0, |place| self.0[line][place].object.bytes.len());
        let (id, bytes, queued) = (object.id, object.bytes.len(), self.bytes() - freed);
        if queued + bytes > max_bytes {
            return Err(OfferError::Full { id, bytes, queued });
        }
        match place {
            Some(place) => self.0[line][place] = waiting,
            None => self.0[line].push_back(waiting),
        }
        Ok(place.is_some())
    }

    /// The one of this priority that has waited longest, of those that may go.
    pub(super) fn pop(
        &mut self,
        priority: u8,
        may_go: impl Fn(ObjectId) -> bool,
    ) -> Option<Waiting> {
        let line = &mut self.0[usize::from(priority)];
        let place = line.iter().position(|waiting| may_go(waiting.object.id))?;
        line.remove(place)
    }

    /// Drops what is not wanted any more.
    pub(super) fn retain(&mut self, mut is_wanted: impl FnMut(&Waiting) -> bool) {
        for line in &mut self.0 {
            line.retain(&mut is_wanted);
        }
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &Waiting> {
        self.0.iter().flatten()
    }

    pub(super) fn bytes(&self) -> usize {
        self.iter().map(|waiting| waiting.object.bytes.len()).sum()
    }
}
