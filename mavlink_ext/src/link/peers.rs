//! Which peers a socket has heard, and which MAVLink addresses at each of them.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::time::Duration;

use crate::wire::{Address, ComponentId};

/// Beyond this the peer silent for longest is forgotten.
const MAX_PEERS: usize = 32;
/// Addresses remembered at one peer; more can only be an attack.
const MAX_ADDRESSES: usize = 256;
/// A learned peer that says nothing for so long is not sent to any more.
const SILENCE: Duration = Duration::from_secs(30);

struct Peer {
    last_heard: Duration,
    addresses: BTreeSet<Address>,
}

/// The peers of one link. Times are spans since it was opened.
pub(super) struct Peers {
    /// The one peer of a link that sends to a given place.
    fixed: Option<SocketAddr>,
    /// Where to send as long as nobody was heard.
    called: Option<SocketAddr>,
    heard: BTreeMap<SocketAddr, Peer>,
}

impl Peers {
    /// Peers become known by what they send.
    pub(super) fn learned() -> Self {
        Self {
            fixed: None,
            called: None,
            heard: BTreeMap::new(),
        }
    }

    /// As [`Self::learned`], and while nobody is heard, everything is sent there.
    pub(super) fn called(address: SocketAddr) -> Self {
        Self {
            called: Some(address),
            ..Self::learned()
        }
    }

    /// One peer, known from the start, and no other.
    pub(super) fn fixed(peer: SocketAddr) -> Self {
        Self {
            fixed: Some(peer),
            called: None,
            heard: BTreeMap::new(),
        }
    }

    /// A peer has connected, and has not said who it is.
    pub(super) fn connected(&mut self, peer: SocketAddr, now: Duration) {
        self.entry(peer, now);
    }

    /// A peer is gone.
    pub(super) fn closed(&mut self, peer: SocketAddr) {
        self.heard.remove(&peer);
    }

    /// Whether datagrams from there are for us.
    pub(super) fn hears(&self, sender: SocketAddr) -> bool {
        self.fixed.is_none_or(|peer| peer == sender)
    }

    /// A frame of `address` came from `peer`.
    pub(super) fn learn(&mut self, peer: SocketAddr, address: Address, now: Duration) {
        let peer = self.entry(peer, now);
        if peer.addresses.len() < MAX_ADDRESSES {
            peer.addresses.insert(address);
        }
    }

    fn entry(&mut self, peer: SocketAddr, now: Duration) -> &mut Peer {
        if !self.heard.contains_key(&peer) && self.heard.len() >= MAX_PEERS {
            let silent_longest = self.heard.iter().min_by_key(|(_, peer)| peer.last_heard);
            if let Some(forgotten) = silent_longest.map(|(at, _)| *at) {
                self.heard.remove(&forgotten);
            }
        }
        let peer = self.heard.entry(peer).or_insert_with(|| Peer {
            last_heard: now,
            addresses: BTreeSet::new(),
        });
        peer.last_heard = now;
        peer
    }

    /// Where a frame for `target` goes.
    pub(super) fn targets(&self, target: Option<Address>, now: Duration) -> Vec<SocketAddr> {
        if let Some(peer) = self.fixed {
            return vec![peer];
        }
        let live = || {
            self.heard
                .iter()
                .filter(|(_, peer)| now.saturating_sub(peer.last_heard) <= SILENCE)
        };
        if let Some(everybody) = self.called
            && live().next().is_none()
        {
            return vec![everybody];
        }
        let all = || live().map(|(at, _)| *at).collect();
        let Some(target) = target else {
            return all();
        };
        let heard_at = |target: Address| -> Vec<SocketAddr> {
            live()
                .filter(|(_, peer)| peer.addresses.iter().any(|a| a.is_addressed_by(target)))
                .map(|(at, _)| *at)
                .collect()
        };
        // Its component may be quiet by nature; then the peers with its system are the best guess.
        let whole_system = Address {
            component: ComponentId::ALL,
            ..target
        };
        [heard_at(target), heard_at(whole_system)]
            .into_iter()
            .find(|peers| !peers.is_empty())
            .unwrap_or_else(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(port: u16) -> SocketAddr {
        SocketAddr::from(([127, 0, 0, 1], port))
    }

    #[test]
    fn a_silent_peer_is_sent_to_for_half_a_minute() {
        let mut peers = Peers::learned();
        peers.learn(at(1), Address::new(1, 1), Duration::from_secs(5));
        assert_eq!(peers.targets(None, Duration::from_secs(35)), [at(1)]);
        assert!(peers.targets(None, Duration::from_secs(36)).is_empty());
    }

    #[test]
    fn a_network_is_called_until_somebody_answers() {
        let mut peers = Peers::called(at(9));
        assert_eq!(peers.targets(None, Duration::ZERO), [at(9)]);
        peers.learn(at(1), Address::new(1, 1), Duration::ZERO);
        assert_eq!(peers.targets(None, Duration::ZERO), [at(1)]);
        assert_eq!(peers.targets(None, Duration::from_mins(1)), [at(9)]);
    }

    #[test]
    fn an_unheard_component_is_looked_for_where_its_system_is() {
        let mut peers = Peers::learned();
        peers.learn(at(1), Address::new(1, 1), Duration::ZERO);
        peers.learn(at(2), Address::new(2, 1), Duration::ZERO);
        let targets = |system, component| {
            peers.targets(Some(Address::new(system, component)), Duration::ZERO)
        };
        assert_eq!(targets(2, 1), [at(2)]);
        assert_eq!(targets(2, 154), [at(2)]);
        assert_eq!(targets(3, 1), [at(1), at(2)], "nobody knows: ask all");
    }

    #[test]
    fn a_flood_of_peers_does_not_grow_the_table() {
        let mut peers = Peers::learned();
        for port in 1..1000 {
            peers.learn(
                at(port),
                Address::new(1, 1),
                Duration::from_millis(port.into()),
            );
        }
        assert_eq!(peers.targets(None, Duration::from_secs(1)).len(), MAX_PEERS);
        for address in 0..=u8::MAX {
            for component in 0..=u8::MAX {
                peers.learn(
                    at(1),
                    Address::new(address, component),
                    Duration::from_secs(1),
                );
            }
        }
        assert_eq!(peers.heard[&at(1)].addresses.len(), MAX_ADDRESSES);
    }
}
