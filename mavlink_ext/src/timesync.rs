//! How a peer's clock relates to ours: from `TIMESYNC` round trips, or from satellite time known to both.
//!
//! An answer with the peer's time `p` to a request sent at `s`, received at `r`, proves that the peer's clock is ahead of
//! ours by
//!
//! ```text
//! p − r  ≤  offset  ≤  p − s          r − s = round trip
//! ```
//!
//! since no message arrives before it was sent. Many answers narrow this (`filter`): the least delay there and the
//! least delay back need not be of the same answer. What is left is as wide as the least delay there and back together, and
//! **nothing that is exchanged over the link tells where in it the offset is**: 200 ms there and 50 ms back look like 125 ms
//! each way, 75 ms off. So the standard uncertainty is that of an even distribution, never below
//! `least round trip / (2 √3)`. Change in time is seen better: the skew of the clocks to a few parts in a million.
//!
//! What both ends know from satellites has no such asymmetry. A peer's `SYSTEM_TIME` pairs its clock with UTC, however
//! long it was under way; where our own clock is paired too, the more certain of the two ways is believed.
//!
//! <https://mavlink.io/en/services/timesync.html>, <https://mavlink.io/en/messages/common.html#SYSTEM_TIME>

mod filter;
#[cfg(test)]
mod tests;
mod utc;

use std::collections::VecDeque;
use std::time::Duration;

use maps::time::Stamp;

use crate::dialect::Message;
use crate::dialect::tandem::TIMESYNC_DATA;
use crate::service::{Ends, Step, is_for};
use crate::wire::Address;

use filter::{Exchange, Filter};
pub use utc::{Utc, system_time};

/// Time between our requests.
const INTERVAL: Duration = Duration::from_secs(1);
/// Requests that may still be answered.
const OUTSTANDING: usize = 8;

/// Where an [`Estimate`] is from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClockSource {
    /// `TIMESYNC`: the link's asymmetry is in it.
    RoundTrips,
    /// UTC that both ends have, as from satellites.
    Utc,
}

/// How the peer's clock relates to ours at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Peer's clock minus ours, in nanoseconds.
    pub offset: i64,
    /// How much faster the peer's clock runs, in nanoseconds per nanosecond: 40e-6 for 40 ppm.
    pub skew: f64,
    /// Standard uncertainty of the skew.
    pub skew_sigma: f64,
    /// Standard uncertainty of the offset (one sigma). Grows with the time since the last good exchange.
    pub sigma: Duration,
    /// The offset is not further off than this: of round trips, as long as the clocks run evenly; of UTC, three sigma.
    pub bound: Duration,
    /// Where it is from.
    pub source: ClockSource,
}

/// What the owner should know.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimesyncEvent {
    /// The peer's clock has jumped, as when it restarts: what was translated before does not hold any more.
    Restarted,
}

/// Asks a peer for its time, and answers everybody.
#[derive(Clone, Debug)]
pub struct Timesync {
    ends: Ends,
    due: Stamp,
    /// When we asked, on our clock.
    outstanding: VecDeque<i64>,
    filter: Filter,
    /// An answer that contradicts all before it; another one like it is believed.
    doubt: Option<Exchange>,
    peer_utc: Option<Utc>,
    own_utc: Option<Utc>,
}

impl Timesync {
    /// Knows nothing yet; asks at the first tick.
    pub fn new(ends: Ends) -> Self {
        Self {
            ends,
            due: Stamp::ZERO,
            outstanding: VecDeque::new(),
            filter: Filter::default(),
            doubt: None,
            peer_utc: None,
            own_utc: None,
        }
    }

    /// Tells it of any message that came in.
    pub fn handle(&mut self, now: Stamp, from: Address, message: &Message) -> Step<TimesyncEvent> {
        match message {
            Message::SYSTEM_TIME(time) if from == self.ends.peer => {
                self.peer_utc = Utc::of_sender(now, time).or(self.peer_utc);
                Step::none()
            }
            // Our own request may come back to us through some loop: its answer would say nothing.
            Message::TIMESYNC(sync) if from != self.ends.own && is_for(self.ends.own, message) => {
                if sync.tc1 == 0 {
                    return Step::send(timesync(from, nanos(now), sync.ts1));
                }
                self.answered(now, from, sync)
            }
            _ => Step::none(),
        }
    }

    fn answered(&mut self, now: Stamp, from: Address, sync: &TIMESYNC_DATA) -> Step<TimesyncEvent> {
        // Older autopilots name nobody in their answers; one to another's request does not mirror our stamp.
        let asked = self.outstanding.iter().position(|sent| *sent == sync.ts1);
        let Some(place) = asked.filter(|_| from == self.ends.peer) else {
            return Step::none();
        };
        // A copy of the answer finds nothing any more.
        self.outstanding.remove(place);
        let Some(exchange) = Exchange::new(sync.ts1, now, sync.tc1) else {
            return Step::none();
        };
        if self.filter.agrees(now, &exchange) {
            self.doubt = None;
            self.filter.insert(exchange);
            return Step::none();
        }
        // One answer may be wrong; two that agree are from a clock that has jumped.
        let Some(doubted) = self.doubt.replace(exchange) else {
            self.due = now;
            return Step::none();
        };
        let mut anew = Filter::default();
        anew.insert(doubted);
        if !anew.agrees(now, &exchange) {
            self.due = now;
            return Step::none();
        }
        anew.insert(exchange);
        self.filter = anew;
        self.doubt = None;
        // Its boot time went with the clock.
        self.peer_utc = None;
        Step::event(TimesyncEvent::Restarted)
    }

    /// How our clock relates to UTC, if somebody knows: a clock that a satellite receiver's pulse disciplines, or
    /// [`Self::utc`] of the autopilot beside us. Believed for [`Utc::LIFE`], so tell it again and again.
    pub fn set_own_utc(&mut self, utc: Option<Utc>) {
        self.own_utc = utc;
    }

    /// How our clock relates to UTC, as this peer tells by its `SYSTEM_TIME` and by round trips; `None` if it does not. Good
    /// where the peer is near, as an autopilot on a serial port.
    pub fn utc(&self, now: Stamp) -> Option<Utc> {
        let peer = self.peer_utc.filter(|utc| utc.is_fresh(now))?;
        let peer_ahead = self.filter.estimate(now)?;
        Some(peer.moved(peer_ahead.offset, peer_ahead.sigma))
    }

    /// The best there is; `None` before anything came.
    pub fn estimate(&self, now: Stamp) -> Option<Estimate> {
        let by_utc = self.by_utc(now);
        let Some(by_round_trips) = self.filter.estimate(now) else {
            return by_utc;
        };
        // Both ends call it UTC, but a clock that was set by hand is none, and a peer may count from another start here
        // than in its answers: it must fit what the round trips prove.
        let fits = |utc: &Estimate| {
            let apart = Duration::from_nanos(utc.offset.abs_diff(by_round_trips.offset));
            apart <= by_round_trips.bound.saturating_add(utc.bound)
        };
        let better = by_utc.filter(|utc| utc.sigma < by_round_trips.sigma && fits(utc));
        Some(better.map_or(by_round_trips, |utc| Estimate {
            skew: by_round_trips.skew,
            skew_sigma: by_round_trips.skew_sigma,
            ..utc
        }))
    }

    fn by_utc(&self, now: Stamp) -> Option<Estimate> {
        let fresh = |utc: Option<Utc>| utc.filter(|utc| utc.is_fresh(now));
        let (own, peer) = (fresh(self.own_utc)?, fresh(self.peer_utc)?);
        let sigma = utc::together(own.sigma(now), peer.sigma(now));
        Some(Estimate {
            offset: own.offset.saturating_sub(peer.offset),
            skew: 0.0,
            skew_sigma: filter::SKEW_SIGMA,
            sigma,
            bound: sigma.saturating_mul(3),
            source: ClockSource::Utc,
        })
    }

    /// Peer's clock minus ours in nanoseconds, and how far that may be off; `None` before the first answer.
    pub fn offset(&self, now: Stamp) -> Option<(i64, Duration)> {
        self.estimate(now)
            .map(|estimate| (estimate.offset, estimate.bound))
    }

    /// A stamp of the peer on our clock, and how far it may be off. `None` before the first answer, or if that was
    /// before our clock started. The skew is taken into account, so the stamp may be old.
    pub fn to_own(&self, now: Stamp, peer: Stamp) -> Option<(Stamp, Duration)> {
        let estimate = self.estimate(now)?;
        let unskewed = i128::from(peer.as_nanos()) - i128::from(estimate.offset);
        // Before now, a clock that runs faster was less ahead.
        let ago = i128::from(now.as_nanos()) - unskewed;
        let own = unskewed + (ago as f64 * estimate.skew).round() as i128;
        let drifted = Duration::from_nanos(u64::try_from(ago.unsigned_abs()).unwrap_or(u64::MAX))
            .mul_f64(estimate.skew_sigma * 3.0);
        let own = u64::try_from(own).ok()?;
        let bound = estimate.bound.saturating_add(drifted);
        Some((Stamp::from_nanos(own), bound))
    }

    /// Lets time pass: asks once a second, and tells UTC where we know it.
    pub fn tick(&mut self, now: Stamp) -> Step<TimesyncEvent> {
        if now < self.due {
            return Step::none();
        }
        self.due = now + INTERVAL;
        if self.outstanding.len() >= OUTSTANDING {
            self.outstanding.pop_front();
        }
        self.outstanding.push_back(nanos(now));
        let mut step = Step::send(timesync(self.ends.peer, 0, nanos(now)));
        let own_utc = self.own_utc.filter(|utc| utc.is_fresh(now));
        step.send
            .extend(own_utc.and_then(|utc| system_time(now, &utc)));
        step
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
