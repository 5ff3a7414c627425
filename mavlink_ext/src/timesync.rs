//! How a peer's clock relates to ours, from `TIMESYNC` round trips.
//!
//! ```text
//! offset = peer's stamp − (sent + received) / 2        error ≤ round trip / 2
//! ```
//!
//! As in NTP's clock filter (RFC 5905 §10) the shortest of the recent round trips is believed: queues only lengthen
//! them. Its bound grows with age, as clocks drift. <https://mavlink.io/en/services/timesync.html>

use std::collections::VecDeque;
use std::time::Duration;

use maps::time::Stamp;

use crate::dialect::Message;
use crate::dialect::tandem::TIMESYNC_DATA;
use crate::service::{Ends, Step, is_for};
use crate::wire::Address;

/// Time between our requests.
const INTERVAL: Duration = Duration::from_secs(1);
/// Round trips remembered.
const SAMPLES: usize = 16;
/// Requests that may still be answered.
const OUTSTANDING: usize = 8;
/// Crystals of two computers may drift apart so fast, in nanoseconds per nanosecond.
const DRIFT: f64 = 100e-6;

/// One round trip.
#[derive(Clone, Copy, Debug)]
struct Sample {
    /// Peer's clock minus ours, in nanoseconds.
    offset: i64,
    round_trip: Duration,
    at: Stamp,
}

impl Sample {
    fn bound(&self, now: Stamp) -> Duration {
        self.round_trip / 2 + now.distance(self.at).mul_f64(DRIFT)
    }
}

/// Asks a peer for its time, and answers everybody.
#[derive(Clone, Debug)]
pub struct Timesync {
    ends: Ends,
    due: Stamp,
    outstanding: VecDeque<i64>,
    samples: VecDeque<Sample>,
}

impl Timesync {
    /// Knows nothing yet; asks at the first tick.
    pub fn new(ends: Ends) -> Self {
        Self {
            ends,
            due: Stamp::ZERO,
            outstanding: VecDeque::new(),
            samples: VecDeque::new(),
        }
    }

    /// Tells it of any message that came in.
    pub fn handle(&mut self, now: Stamp, from: Address, message: &Message) -> Step<()> {
        let Message::TIMESYNC(sync) = message else {
            return Step::none();
        };
        if !is_for(self.ends.own, message) {
            return Step::none();
        }
        if sync.tc1 == 0 {
            return Step::send(timesync(from, nanos(now), sync.ts1));
        }
        let asked = self.outstanding.iter().position(|sent| *sent == sync.ts1);
        if let Some(place) = asked.filter(|_| from == self.ends.peer) {
            self.outstanding.remove(place);
            self.answered(now, sync.ts1, sync.tc1);
        }
        Step::none()
    }

    fn answered(&mut self, now: Stamp, sent: i64, peer_time: i64) {
        let round_trip = nanos(now).saturating_sub(sent);
        let Ok(round_trip_nanos) = u64::try_from(round_trip) else {
            return;
        };
        let sample = Sample {
            offset: peer_time.saturating_sub(sent.saturating_add(round_trip / 2)),
            round_trip: Duration::from_nanos(round_trip_nanos),
            at: now,
        };
        // Two bounds that do not meet: the peer has restarted, and its clock with it.
        let contradicts = |old: &Sample| {
            let apart = Duration::from_nanos(old.offset.abs_diff(sample.offset));
            apart > old.bound(now) + sample.bound(now)
        };
        if self.best(now).as_ref().is_some_and(contradicts) {
            self.samples.clear();
        }
        if self.samples.len() >= SAMPLES {
            self.samples.pop_front();
        }
        self.samples.push_back(sample);
    }

    fn best(&self, now: Stamp) -> Option<Sample> {
        let samples = self.samples.iter();
        samples.min_by_key(|sample| sample.bound(now)).copied()
    }

    /// Peer's clock minus ours in nanoseconds, and how far that may be off; `None` before the first answer.
    pub fn offset(&self, now: Stamp) -> Option<(i64, Duration)> {
        self.best(now)
            .map(|sample| (sample.offset, sample.bound(now)))
    }

    /// A stamp of the peer on our clock, and how far it may be off. `None` before the first answer, or if that was
    /// before our clock started.
    pub fn to_own(&self, now: Stamp, peer: Stamp) -> Option<(Stamp, Duration)> {
        let (offset, bound) = self.offset(now)?;
        let own = i128::from(peer.as_nanos()) - i128::from(offset);
        let own = u64::try_from(own).ok()?;
        Some((Stamp::from_nanos(own), bound))
    }

    /// Lets time pass: asks once a second.
    pub fn tick(&mut self, now: Stamp) -> Step<()> {
        if now < self.due {
            return Step::none();
        }
        self.due = now + INTERVAL;
        if self.outstanding.len() >= OUTSTANDING {
            self.outstanding.pop_front();
        }
        self.outstanding.push_back(nanos(now));
        Step::send(timesync(self.ends.peer, 0, nanos(now)))
    }
}

fn timesync(to: Address, tc1: i64, ts1: i64) -> Message {
    Message::TIMESYNC(TIMESYNC_DATA {
        tc1,
        ts1,
        target_system: to.system.0,
        target_component: to.component.0,
    })
}

/// A stamp as the message carries it; never 0, which would mean a request.
fn nanos(stamp: Stamp) -> i64 {
    i64::try_from(stamp.as_nanos()).unwrap_or(i64::MAX).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulated::{Air, Radio};

    const OWN: Address = Address::new(255, 190);
    const PEER: Address = Address::new(1, 191);
    const TICK: Duration = Duration::from_millis(1);

    /// Both ends for so long; the peer's clock is ahead by this. Returns our clock's end and our end.
    fn run(radio: Radio, span: Duration, ahead: Duration) -> (Stamp, Timesync) {
        let mut own = Timesync::new(Ends {
            own: OWN,
            peer: PEER,
        });
        let mut peer = Timesync::new(Ends {
            own: PEER,
            peer: OWN,
        });
        let (mut there, mut back) = (Air::new(OWN, radio, 1), Air::new(PEER, radio, 2));
        let mut now = Stamp::ZERO;
        while now < Stamp::ZERO + span {
            now += TICK;
            there.send(now, own.tick(now).send);
            back.send(now, peer.tick(now + ahead).send);
            for (from, message) in there.arrived(now) {
                back.send(now, peer.handle(now + ahead, from, &message).send);
            }
            for (from, message) in back.arrived(now) {
                there.send(now, own.handle(now, from, &message).send);
            }
        }
        (now, own)
    }

    #[test]
    fn the_offset_is_within_its_bound_on_a_bad_radio() {
        let ahead = Duration::from_secs(1234);
        let (now, own) = run(Radio::losing(0.3), Duration::from_secs(30), ahead);
        let (stamp, bound) = own.to_own(now, now + ahead).expect("answers came");
        assert!(
            stamp.distance(now) <= bound,
            "{stamp} for {now}, bound {bound:?}"
        );
        assert!(
            bound < Duration::from_millis(45),
            "half of 40 to 100 ms: {bound:?}"
        );
    }

    #[test]
    fn a_peer_that_restarts_is_believed_anew() {
        let (now, mut own) = run(
            Radio::PERFECT,
            Duration::from_secs(5),
            Duration::from_secs(9),
        );
        own.tick(now + INTERVAL);
        let sent = nanos(now + INTERVAL);
        let answer = timesync(OWN, 5_000_000, sent);
        let later = now + INTERVAL + TICK;
        own.handle(later, PEER, &answer);
        let (offset, _) = own.offset(later).expect("answers came");
        assert!(offset < 0, "its clock started after ours: {offset}");
        assert_eq!(
            own.to_own(later, Stamp::ZERO)
                .map(|(stamp, _)| stamp < later),
            Some(true)
        );
    }

    #[test]
    fn answers_for_others_and_made_up_ones_are_ignored() {
        let mut own = Timesync::new(Ends {
            own: OWN,
            peer: PEER,
        });
        own.tick(Stamp::from_nanos(1000));
        for (from, to, ts1) in [
            (PEER, Address::new(7, 7), 1000),
            (Address::new(9, 9), OWN, 1000),
            (PEER, OWN, 999),
        ] {
            let message = timesync(to, 77, ts1);
            own.handle(Stamp::from_nanos(2000), from, &message);
        }
        assert_eq!(own.offset(Stamp::from_nanos(2000)), None);
    }
}
