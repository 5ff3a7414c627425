//! The map on its way to the ground station.
//!
//! The newest version of every tile is kept, encoded. The first ground station that is heard on the ground link gets
//! through the object transport what changes, and what it asks for because it lacks it; if it falls silent and another one
//! is heard, that one does.

mod backlog;

use std::collections::BTreeMap;
use std::time::Duration;

use maps::tile::TileId;
use maps::time::Stamp;
use mavlink_ext::dialect::tandem::MavType;
use mavlink_ext::object::digest::{Answerer, Item};
use mavlink_ext::object::{
    Object, ObjectId, OfferError, Sender, SenderEvent, SenderSettings, Service, StreamId,
};
use mavlink_ext::presence::LOST_AFTER;
use mavlink_ext::service::Ends;
use mavlink_ext::{Address, Message};

use crate::histogram::Histogram;
use crate::pipeline::EncodedTile;
use backlog::Backlog;

/// Sends map tiles to one ground station at a time.
pub(super) struct MapLink {
    own: Address,
    session: u16,
    bytes_per_second: u32,
    tiles: BTreeMap<TileId, EncodedTile>,
    /// Tiles whose newest version the sender has not taken yet.
    backlog: Backlog,
    /// What there is, to compare with what the ground station has.
    answerer: Answerer,
    /// Answers to the ground station's questions.
    answers: Vec<Message>,
    station: Option<Station>,
    offered: u64,
    /// Versions replaced by newer ones at former ground stations before they were sent.
    replaced: u64,
    /// Of frames with parts of objects since they were asked for.
    object_bytes: u64,
    delays: Histogram,
}

struct Station {
    address: Address,
    last_heartbeat: Stamp,
    sender: Sender,
}

impl MapLink {
    /// `session` should differ from that of the program's last start.
    pub(super) fn new(own: Address, session: u16, bytes_per_second: u32) -> Self {
        Self {
            own,
            session,
            bytes_per_second,
            tiles: BTreeMap::new(),
            backlog: Backlog::default(),
            answerer: Answerer::default(),
            answers: Vec::new(),
            station: None,
            offered: 0,
            replaced: 0,
            object_bytes: 0,
            delays: Histogram::default(),
        }
    }

    /// Takes new versions of tiles.
    pub(super) fn offer(&mut self, now: Stamp, tiles: Vec<EncodedTile>) {
        for tile in tiles {
            self.answerer
                .has(tile.id, Item::new(tile.version, &tile.bytes));
            // Who is not there yet asks for it later.
            if self.station.is_some() {
                self.backlog.push(tile.id);
            }
            self.tiles.insert(tile.id, tile);
        }
        self.hand_over(now);
    }

    /// Tells it of any message that came in on the ground link.
    pub(super) fn handle(&mut self, now: Stamp, from: Address, message: &Message) {
        if let Message::HEARTBEAT(heartbeat) = message
            && heartbeat.mavtype == MavType::MAV_TYPE_GCS
        {
            self.heard(now, from);
        }
        let Some(station) = &mut self.station else {
            return;
        };
        let ends = Ends {
            own: self.own,
            peer: station.address,
        };
        if let Some(answer) = self.answerer.handle(now, ends, from, message) {
            self.answers.push(answer.message);
            for tile in answer.same {
                let known = self.tiles.get(&tile);
                let id = known.and_then(|known| ObjectId::of_tile(tile, known.version));
                if let Some(id) = id {
                    station.sender.is_there(id);
                }
            }
            for tile in answer.lacking {
                if let Some(id) = ObjectId::of_tile(tile, 0) {
                    station.sender.is_lacking(StreamId::TILE, id.key);
                    self.backlog.push(tile);
                }
            }
        }
        for event in station.sender.handle(now, from, message).events {
            match event {
                SenderEvent::Delivered { after, .. } => self.delays.add(after),
                SenderEvent::Refused(id) => {
                    tracing::warn!(%id, "the ground station refuses a tile");
                }
                // Tiles have no deadline; and a ground station that has started anew asks for what it lacks.
                SenderEvent::Expired(_) | SenderEvent::ReceiverRestarted { .. } => {}
            }
        }
    }

    /// Lets time pass: what to send to the ground station.
    pub(super) fn tick(&mut self, now: Stamp) -> Vec<Message> {
        self.hand_over(now);
        let mut send = std::mem::take(&mut self.answers);
        if let Some(station) = &mut self.station {
            let before = station.sender.stats(now).wire_bytes;
            send.extend(station.sender.tick(now).send);
            self.object_bytes += station.sender.stats(now).wire_bytes - before;
        }
        send
    }

    /// So many bytes more have left on the ground link beside objects: they count against its budget.
    pub(super) fn ground_link_has_sent(&mut self, bytes: u64) {
        if let Some(station) = &mut self.station {
            station.sender.link_has_sent(bytes);
        }
    }

    /// Bytes of objects' frames that [`Self::tick`] gave since the last call.
    pub(super) fn take_object_bytes(&mut self) -> u64 {
        std::mem::take(&mut self.object_bytes)
    }

    /// Versions of tiles that were sent, or wait to be: those offered less those replaced by newer ones before.
    pub(super) fn sent(&self, now: Stamp) -> u64 {
        let station = self.station.as_ref();
        let replaced = station.map_or(0, |s| s.sender.stats(now).objects_replaced);
        self.offered - self.replaced - replaced
    }

    /// Tiles whose newest version the ground station has.
    pub(super) fn delivered(&self, now: Stamp) -> usize {
        let station = self.station.as_ref();
        station.map_or(0, |station| station.sender.stats(now).keys_delivered)
    }

    /// Bytes of tiles that wait or are under way.
    pub(super) fn queued_bytes(&self, now: Stamp) -> usize {
        let station = self.station.as_ref();
        let backlog = self.backlog.iter().filter_map(|id| self.tiles.get(&id));
        let waiting: usize = backlog.map(|tile| tile.bytes.len()).sum();
        waiting + station.map_or(0, |station| station.sender.stats(now).bytes_pending)
    }

    /// Share of symbols lost on the way, 0 to 1, once it is known.
    pub(super) fn loss(&self, now: Stamp) -> Option<f64> {
        self.station
            .as_ref()
            .and_then(|station| station.sender.stats(now).loss)
    }

    /// 99th percentile of the time from offering a tile to its delivery.
    pub(super) fn delivery_p99(&self) -> Option<Duration> {
        self.delays.quantile(0.99)
    }

    /// A ground station is there: the one that gets the map, or the next if that one is gone.
    fn heard(&mut self, now: Stamp, from: Address) {
        match &mut self.station {
            Some(station) if station.address == from => {
                station.last_heartbeat = now;
                return;
            }
            Some(station) if now.since(station.last_heartbeat) <= LOST_AFTER => return,
            Some(_) | None => {}
        }
        let ends = Ends {
            own: self.own,
            peer: from,
        };
        let settings = SenderSettings {
            bytes_per_second: self.bytes_per_second,
            ..SenderSettings::default()
        };
        if let Some(former) = &self.station {
            self.replaced += former.sender.stats(now).objects_replaced;
            // Its receiver may come back: another session tells it that this is another transfer.
            self.session = self.session.wrapping_add(1);
        }
        self.station = Some(Station {
            address: from,
            last_heartbeat: now,
            sender: Sender::new(now, ends, self.session, settings),
        });
        // What it has of the map, it will say.
        self.backlog = Backlog::default();
        self.answers.clear();
    }

    /// Gives the sender what it has not taken yet, for as long as it has room.
    fn hand_over(&mut self, now: Stamp) {
        let Some(station) = &mut self.station else {
            return;
        };
        while let Some(id) = self.backlog.first() {
            let object = self.tiles.get(&id).and_then(|tile| {
                let id = ObjectId::of_tile(tile.id, tile.version)?;
                Some(Object {
                    id,
                    service: Service::Reliable,
                    bytes: tile.bytes.clone(),
                })
            });
            match object.map(|object| station.sender.offer(now, object)) {
                Some(Err(OfferError::Full { .. })) => return,
                Some(Ok(())) => self.offered += 1,
                Some(Err(error @ OfferError::Size { .. })) => {
                    tracing::error!(%error, "a tile cannot be sent");
                }
                // It has that version already.
                Some(Err(OfferError::Outdated { .. })) | None => {}
            }
            self.backlog.pop();
        }
    }
}
