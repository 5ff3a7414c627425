//! What companions say: their state, the map's origin, and the map itself as objects.

use std::time::Duration;

use geodesy::{Geodetic, Origin};
use maps::tile::{Tile, TileId};
use maps::time::Stamp;
use mavlink_ext::dialect::tandem::{
    TANDEM_ORIGIN_DATA, TANDEM_STATUS_DATA, TandemStatusFlags, TandemTracking,
};
use mavlink_ext::object::StreamId;
use mavlink_ext::object::digest::Item;
use mavlink_ext::{Address, Message, convert};

use super::{Outbox, Station};
use crate::model::Timed;
use crate::model::log::Severity;
use crate::model::map::{CompanionStatus, MapOrigin, Tracking};
use crate::model::missions::{Mission, PlanKind};
use crate::modes::Kind;

/// More companions than this are nobody's fleet.
const MAX_COMPANIONS: usize = 16;

impl Station {
    /// Takes in what a companion says.
    pub(super) fn hear_companion(
        &mut self,
        now: Stamp,
        from: Address,
        message: &Message,
        outbox: &mut Outbox,
    ) {
        self.asker.handle(now, from, message);
        match message {
            Message::TANDEM_STATUS(status) => {
                if let Some(companion) = self.companion(now, from) {
                    companion.status = Some(Timed::new(status_of(status), now));
                }
            }
            Message::TANDEM_ORIGIN(origin) => self.hear_origin(from, origin),
            Message::TANDEM_OBJECT(_) | Message::TANDEM_SYMBOL(_) => {
                self.hear_object(now, from, message, outbox);
            }
            // Where the map was seen from; of a companion that is known to build it.
            Message::ODOMETRY(odometry) => {
                if let Some(companion) = self.model.map.companions.get_mut(&from)
                    && let Some(pose) = convert::odometry_pose(odometry)
                {
                    companion.world_from_body = Some(Timed::new(pose, now));
                }
            }
            Message::HEARTBEAT(_) => {
                if let Some(companion) = self.model.map.companions.get_mut(&from) {
                    companion.heard_at = Some(now);
                }
            }
            _ => {}
        }
    }

    fn companion(
        &mut self,
        now: Stamp,
        from: Address,
    ) -> Option<&mut crate::model::map::Companion> {
        let companions = &mut self.model.map.companions;
        if companions.len() >= MAX_COMPANIONS && !companions.contains_key(&from) {
            return None;
        }
        let is_new = !companions.contains_key(&from);
        let companion = companions.entry(from).or_default();
        companion.heard_at = Some(now);
        if is_new {
            self.say(Severity::Notice, format!("companion {from} is here"));
        }
        self.model.map.companions.get_mut(&from)
    }

    fn hear_origin(&mut self, from: Address, told: &TANDEM_ORIGIN_DATA) {
        let known = self.model.map.origin.as_ref();
        let geodetic = Geodetic {
            lat_deg: convert::e7_to_deg(told.lat),
            lon_deg: convert::e7_to_deg(told.lon),
            alt_m: f64::from(told.alt) / 1000.0,
        };
        let same = known.is_some_and(|known| {
            known.from.is_some() && known.epoch == told.epoch && known.geodetic == geodetic
        });
        if same {
            return;
        }
        match Origin::new(geodetic.lat_deg, geodetic.lon_deg, geodetic.alt_m) {
            Ok(origin) => {
                let text = format!(
                    "map origin {:.7}°, {:.7}°",
                    geodetic.lat_deg, geodetic.lon_deg
                );
                self.say(Severity::Notice, text);
                self.set_origin(MapOrigin {
                    origin,
                    geodetic,
                    from: Some(from),
                    epoch: told.epoch,
                });
            }
            Err(error) => self.say(
                Severity::Error,
                format!("companion {from} tells no origin: {error}"),
            ),
        }
    }

    fn hear_object(&mut self, now: Stamp, from: Address, message: &Message, outbox: &mut Outbox) {
        let step = self.receiver.handle(now, from, message);
        outbox.extend(step.send);
        for object in step.events {
            if object.id.stream == StreamId::TILE {
                self.take_tile(now, from, &object.bytes);
            }
        }
    }

    /// Reports what is missing of objects, and asks for what the map lacks.
    pub(super) fn tick_companions(&mut self, outbox: &mut Outbox) {
        let now = self.model.now;
        outbox.extend(self.receiver.tick(now).send);
        let path = self.tiles_ahead();
        self.asker.toward(&path);
        outbox.extend(self.asker.tick(now));
    }

    /// The tiles in which rovers are, and through which their planned paths lead.
    fn tiles_ahead(&self) -> Vec<TileId> {
        let Some(voxels) = &self.model.map.voxels else {
            return Vec::new();
        };
        let rovers = self.model.vehicles.values();
        let rovers = rovers.filter(|vehicle| vehicle.kind == Kind::Rover);
        let places = rovers.filter_map(|rover| rover.position.map(|position| position.value));
        let plans = self.model.missions.values().filter_map(Mission::plan);
        let paths = plans.filter(|plan| matches!(plan.kind, PlanKind::Path { .. }));
        let places = places.chain(paths.flat_map(|plan| plan.line.iter().copied()));
        let mut tiles: Vec<_> = places
            .map(|place| TileId::of(voxels.key_of(place)))
            .collect();
        tiles.sort_unstable();
        tiles.dedup();
        tiles
    }

    fn take_tile(&mut self, now: Stamp, from: Address, bytes: &[u8]) {
        match Tile::decode(bytes) {
            Ok(tile) => {
                self.model.map.receive(now, &tile);
                // Also if it is refused: it would be no better if it came again.
                let item = Item::new(tile.version, bytes);
                self.asker.has(now, from, tile.id, item);
            }
            Err(error) => {
                self.model.map.refuse(error.to_string());
                self.say(Severity::Error, format!("a map tile was refused: {error}"));
            }
        }
    }
}

fn status_of(told: &TANDEM_STATUS_DATA) -> CompanionStatus {
    let known = |value: u16| (value != u16::MAX).then_some(value);
    let millis = |value: u16| known(value).map(|ms| Duration::from_millis(ms.into()));
    CompanionStatus {
        map_digest: told.map_digest,
        voxels_occupied: told.voxels_occupied,
        tiles_known: told.tiles_known,
        tiles_delivered: told.tiles_delivered,
        frames: told.frames,
        frames_tracked: told.frames_tracked,
        frame_rate_hz: f64::from(told.frame_rate) / 100.0,
        queued_bytes: told.queued,
        link_rate_bps: told.link_rate,
        slam_latency: millis(told.latency_slam),
        delivery_latency: millis(told.latency_delivery),
        loss: known(told.loss).map(|permille| f64::from(permille) / 1000.0),
        tracking: match told.tracking {
            tracking if tracking == TandemTracking::TANDEM_TRACKING_GOOD as u8 => Tracking::Good,
            tracking if tracking == TandemTracking::TANDEM_TRACKING_LOST as u8 => Tracking::Lost,
            _ => Tracking::None,
        },
        finished: u16::from(told.flags)
            & TandemStatusFlags::TANDEM_STATUS_FLAGS_SOURCE_FINISHED.bits()
            != 0,
    }
}
