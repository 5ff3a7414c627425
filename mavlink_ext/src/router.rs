//! Which links a frame goes out on.
//!
//! As in <https://mavlink.io/en/guide/routing.html>: frames are forwarded as they are, even those nobody here
//! understands; those for all go to every other link, those for one address to the link where it was heard. In
//! addition:
//!
//! - A frame that comes again, over another link or as a copy, is dropped, and so are our own. Therefore no ring of routers
//!   lets a frame circle, and two links to the same place are as good as the better one at any moment.
//! - Tandem's own messages never go to a flight controller: its router would drop them, after they filled its link.

use std::collections::BTreeMap;
use std::time::Duration;

use maps::time::Stamp;

use crate::dialect::TANDEM_IDS;
use crate::repeat::Duplicates;
use crate::wire::{Address, RawFrame};

/// An address that was not heard on a link for so long, but on another since, has left it.
const LEFT_AFTER: Duration = Duration::from_secs(3);
/// Addresses remembered; the one silent for longest makes room.
const MAX_ROUTES: usize = 1024;

/// A link, as its owner numbers it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct LinkId(pub usize);

/// What is at the other end of a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkKind {
    /// A flight controller.
    Autopilot,
    /// Ground stations, other companions.
    Network,
}

/// What is to be done with a frame that came in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Route {
    /// Whether it is, also, for us.
    pub is_for_us: bool,
    /// Links it goes out on.
    pub forward: Vec<LinkId>,
    /// Whether this very frame was heard before: then it goes nowhere.
    pub is_copy: bool,
}

/// When an address was last heard on each link.
type Heard = BTreeMap<LinkId, Stamp>;

/// Knows the links, and learns who is where.
#[derive(Clone, Debug)]
pub struct Router {
    own: Address,
    links: BTreeMap<LinkId, LinkKind>,
    heard: BTreeMap<Address, Heard>,
    duplicates: Duplicates,
}

impl Router {
    /// A router whose owner has this address, without links.
    pub fn new(own: Address) -> Self {
        Self {
            own,
            links: BTreeMap::new(),
            heard: BTreeMap::new(),
            duplicates: Duplicates::new(),
        }
    }

    /// Adds a link.
    pub fn add_link(&mut self, link: LinkId, kind: LinkKind) {
        self.links.insert(link, kind);
    }

    /// The link on which an address was heard last.
    pub fn link_of(&self, address: Address) -> Option<LinkId> {
        let heard = self.heard.get(&address)?;
        heard
            .iter()
            .max_by_key(|(_, at)| **at)
            .map(|(link, _)| *link)
    }

    /// What to do with a frame that came in on a link.
    pub fn route(&mut self, now: Stamp, from_link: LinkId, frame: &RawFrame) -> Route {
        let is_copy = !self.duplicates.is_new(now, frame);
        if is_copy || frame.from() == self.own {
            return Route {
                is_for_us: false,
                forward: Vec::new(),
                is_copy,
            };
        }
        self.learn(now, from_link, frame.from());
        let is_for_us = frame
            .target()
            .is_none_or(|target| self.own.is_addressed_by(target));
        let mut forward = if frame.target() == Some(self.own) {
            Vec::new()
        } else {
            self.links_for(frame)
        };
        forward.retain(|link| *link != from_link);
        Route {
            is_for_us,
            forward,
            is_copy,
        }
    }

    /// Links that a frame of our own goes out on.
    pub fn route_own(&self, frame: &RawFrame) -> Vec<LinkId> {
        self.links_for(frame)
    }

    /// Notes where an address is.
    fn learn(&mut self, now: Stamp, link: LinkId, address: Address) {
        if !self.heard.contains_key(&address) && self.heard.len() >= MAX_ROUTES {
            let last = |heard: &Heard| heard.values().max().copied();
            let silent_longest = self.heard.iter().min_by_key(|(_, heard)| last(heard));
            if let Some(forgotten) = silent_longest.map(|(address, _)| *address) {
                self.heard.remove(&forgotten);
            }
        }
        let heard = self.heard.entry(address).or_default();
        heard.insert(link, now);
        heard.retain(|_, at| now.since(*at) < LEFT_AFTER);
    }

    fn links_for(&self, frame: &RawFrame) -> Vec<LinkId> {
        let is_tandem = TANDEM_IDS.contains(&frame.message_id());
        let takes = |kind: LinkKind| !(is_tandem && kind == LinkKind::Autopilot);
        let heard_there = |link: LinkId, target: Address| {
            let mut heard = self.heard.iter();
            heard.any(|(address, on)| on.contains_key(&link) && address.is_addressed_by(target))
        };
        self.links
            .iter()
            .filter(|(_, kind)| takes(**kind))
            .map(|(link, _)| *link)
            .filter(|link| {
                frame
                    .target()
                    .is_none_or(|target| heard_there(*link, target))
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dialect::Message;
    use crate::dialect::tandem::{COMMAND_LONG_DATA, HEARTBEAT_DATA, TANDEM_STATUS_DATA};
    use crate::wire::Encoder;

    const OWN: Address = Address::new(1, 191);
    const COPTER: Address = Address::new(1, 1);
    const STATION: Address = Address::new(255, 190);
    const AUTOPILOT: LinkId = LinkId(0);
    const GROUND: LinkId = LinkId(1);
    const OTHER: LinkId = LinkId(2);

    fn router() -> Router {
        let mut router = Router::new(OWN);
        router.add_link(AUTOPILOT, LinkKind::Autopilot);
        router.add_link(GROUND, LinkKind::Network);
        router.add_link(OTHER, LinkKind::Network);
        router
    }

    fn heartbeat(from: Address) -> RawFrame {
        Encoder::new(from).encode(&Message::HEARTBEAT(HEARTBEAT_DATA::default()))
    }

    /// Each has another sequence number: one that comes twice is a copy.
    fn command(from: Address, target: Address) -> RawFrame {
        static NUMBER: std::sync::atomic::AtomicU8 = std::sync::atomic::AtomicU8::new(0);
        let number = NUMBER.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let mut encoder = Encoder::new(from);
        for _ in 0..number {
            encoder.encode(&Message::HEARTBEAT(HEARTBEAT_DATA::default()));
        }
        encoder.encode(&Message::COMMAND_LONG(COMMAND_LONG_DATA {
            target_system: target.system.0,
            target_component: target.component.0,
            ..COMMAND_LONG_DATA::default()
        }))
    }

    fn status(from: Address) -> RawFrame {
        Encoder::new(from).encode(&Message::TANDEM_STATUS(TANDEM_STATUS_DATA::default()))
    }

    fn route(router: &mut Router, link: LinkId, frame: &RawFrame) -> (bool, Vec<LinkId>) {
        let route = router.route(Stamp::ZERO, link, frame);
        (route.is_for_us, route.forward)
    }

    #[test]
    fn what_is_for_all_goes_to_every_other_link_and_to_us() {
        let mut router = router();
        let heard = route(&mut router, AUTOPILOT, &heartbeat(COPTER));
        assert_eq!(heard, (true, vec![GROUND, OTHER]));
        let unknown = RawFrame::from_bytes(&[0xFE, 1, 0, 1, 1, 163, 7, 0, 0]).expect("a frame");
        assert_eq!(
            route(&mut router, AUTOPILOT, &unknown),
            (true, vec![GROUND, OTHER])
        );
    }

    #[test]
    fn what_is_addressed_goes_where_the_address_was_heard() {
        let mut router = router();
        let before = route(&mut router, GROUND, &command(STATION, COPTER));
        assert_eq!(before, (false, vec![]), "nobody knows it yet");
        router.route(Stamp::ZERO, AUTOPILOT, &heartbeat(COPTER));
        let command_to =
            |router: &mut Router, target| route(router, GROUND, &command(STATION, target));
        assert_eq!(command_to(&mut router, COPTER), (false, vec![AUTOPILOT]));
        assert_eq!(command_to(&mut router, OWN), (true, vec![]));
        let all_of_1 = Address::new(1, 0);
        assert_eq!(command_to(&mut router, all_of_1), (true, vec![AUTOPILOT]));
        assert_eq!(router.route_own(&command(OWN, STATION)), [GROUND]);
    }

    #[test]
    fn our_messages_never_reach_a_flight_controller() {
        let mut router = router();
        assert_eq!(router.route_own(&status(OWN)), [GROUND, OTHER]);
        let peer = Address::new(2, 191);
        assert_eq!(
            route(&mut router, OTHER, &status(peer)),
            (true, vec![GROUND])
        );
    }

    #[test]
    fn a_frame_that_comes_back_is_dropped() {
        let mut router = router();
        let dropped = (false, vec![]);
        assert_eq!(route(&mut router, GROUND, &heartbeat(OWN)), dropped);
        let mut encoder = Encoder::new(COPTER);
        let mut next = || encoder.encode(&Message::HEARTBEAT(HEARTBEAT_DATA::default()));
        let first = next();
        router.route(Stamp::ZERO, AUTOPILOT, &first);
        assert_eq!(route(&mut router, GROUND, &first), dropped);
        assert_eq!(
            router.link_of(COPTER),
            Some(AUTOPILOT),
            "nothing is learned from it"
        );
        let later = Stamp::ZERO + LEFT_AFTER;
        let moved = router.route(later, GROUND, &next());
        assert_eq!(moved.forward, [AUTOPILOT, OTHER], "it was moved");
        assert_eq!(router.link_of(COPTER), Some(GROUND));
        let to_copter = command(OWN, COPTER);
        assert_eq!(router.route_own(&to_copter), [GROUND]);
    }

    #[test]
    fn two_links_to_one_place_are_as_good_as_the_better_one() {
        let mut router = router();
        let mut encoder = Encoder::new(STATION);
        let mut taken = 0;
        for number in 0..100_u64 {
            let frame = encoder.encode(&Message::HEARTBEAT(HEARTBEAT_DATA::default()));
            let now = Stamp::ZERO + Duration::from_millis(10 * number);
            for (link, is_lost) in [(GROUND, number % 2 == 0), (OTHER, number % 3 == 0)] {
                if !is_lost {
                    taken += u32::from(router.route(now, link, &frame).is_for_us);
                }
            }
        }
        assert_eq!(taken, 83, "all but those lost on both, each once");
        assert_eq!(router.route_own(&command(OWN, STATION)), [GROUND, OTHER]);
    }

    #[test]
    fn a_flood_of_addresses_is_bounded() {
        let mut router = router();
        for system in 0..=u8::MAX {
            for component in 0..=u8::MAX {
                router.learn(Stamp::ZERO, GROUND, Address::new(system, component));
            }
        }
        assert_eq!(router.heard.len(), MAX_ROUTES);
    }
}
