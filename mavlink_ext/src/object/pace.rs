//! How fast to send: as much as the link carries, with next to nothing waiting in its buffers, since commands wait there, too.
//!
//! The way of each echoed symbol tells how long it waited: the round trip less the shortest one. Where nothing waits, the
//! pace grows; where something does, the growth of the waiting time tells what the link carries, whatever share it loses:
//!
//! ```text
//! capacity = sent / (1 + d wait / d t)      over the last reports, as in trend-line estimators (Carlucci et al.,
//!                                           Analysis and Design of the Google Congestion Control for WebRTC, 2016)
//! pace     = capacity · (1 + (target − wait) / settling time)
//! ```
//!
//! Loss says nothing about the pace: radios lose without being full. A radio that reports its own buffer
//! (`RADIO_STATUS.txbuf`, <https://mavlink.io/en/messages/common.html#RADIO_STATUS>) is believed, too.

use std::collections::VecDeque;
use std::time::Duration;

use maps::time::Stamp;

use super::estimate::Echo;
use super::{SYMBOL_BYTES, SYMBOL_FRAME_BYTES};

/// The budget that may be saved up, as a span of time.
const BURST: Duration = Duration::from_millis(30);
/// Who sends more than the budget beside objects holds them up for no longer than this afterwards.
const DEBT: Duration = Duration::from_millis(500);
/// How long a symbol shall wait on the way, at least so long that the link never runs dry between two ticks.
const TARGET: Duration = Duration::from_millis(12);
/// The target on slow links, in frames.
const TARGET_FRAMES: f64 = 1.0;
/// On slow links symbols are small enough to take no longer than this: a command waits until the frame under way is over.
const LONGEST_FRAME: Duration = Duration::from_millis(10);
/// But not smaller: what surrounds a symbol takes 18 bytes.
const LEAST_SYMBOL: usize = 96;
/// The trend is taken over so long, or a round trip.
const WINDOW: Duration = Duration::from_millis(300);
/// Echoes kept for it.
const MAX_ECHOES: usize = 256;
/// What every symbol of so long had to wait, and so many of them, is a queue; the rest is jitter.
const STANDING: Duration = Duration::from_millis(100);
const STANDING_ECHOES: usize = 5;
/// The wait comes back to the target within this, or two round trips.
const SETTLING: Duration = Duration::from_millis(250);
/// Growth in a second where nothing waits. Before anything ever waited, the pace doubles each round trip.
const GROWTH: f64 = 0.1;
/// Growth in a second where little waits.
const DOUBT: f64 = 0.03;
/// The shortest round trip is forgotten after two to three times this: the vehicle moves, the radio finds another way.
const BASE_SPAN: Duration = Duration::from_secs(10);
/// The share of the pace that is kept while the buffers are emptied to see the shortest round trip.
const DRAINING: f64 = 0.5;
/// A queue gets shorter when less than this share of what the link carries is sent.
const LITTLE: f64 = 0.85;
/// If it does not within this and two round trips, it may be none.
const STUCK: Duration = Duration::from_secs(1);
/// So many times the target cannot be jitter.
const REAL: f64 = 4.0;
/// If less than this share of what used to arrive arrives, buffers overflow,
const OVERFLOWING: f64 = 0.7;
/// unless chance does that once in a thousand times: so many standard deviations.
const CHANCE: f64 = 3.0;
/// The share that is lost on the air is averaged over this time.
const AIR_MEMORY_S: f64 = 3.0;
/// The slowest pace, in bytes per second: a symbol every other second.
const SLOWEST: f64 = 133.0;
/// The pace at the start, as a share of the budget.
const FIRST: f64 = 0.25;
/// After a radio said that its buffer fills, the pace does not grow for so long.
const RADIO_MEMORY: Duration = Duration::from_secs(2);

/// Lets bytes go at the pace that the link carries, up to a budget.
#[derive(Clone, Debug)]
pub(super) struct Pacer {
    /// Bytes per second, as the operator allows.
    ceiling: f64,
    capacity: f64,
    /// Bytes that may be sent now.
    budget: f64,
    refilled: Stamp,
    /// Whether more could have been sent since the last echo.
    limited: bool,
    echoes: VecDeque<Echo>,
    /// The shortest round trips of the last three spans, the newest first.
    base: [Duration; 3],
    base_since: Stamp,
    /// How long symbols wait in the link's buffers.
    wait: Duration,
    has_waited: bool,
    drain_until: Stamp,
    /// Since when the wait does not fall although less is sent than the link carries.
    stuck_since: Option<Stamp>,
    /// Whether the buffers were emptied for that in vain.
    drained: bool,
    /// The share that the link loses when nothing waits.
    air_loss: f64,
    radio_full: Option<Stamp>,
    round_trip: Duration,
    /// How much larger the variance of losses is than if each symbol was lost for itself.
    burstiness: f64,
}

impl Pacer {
    pub(super) fn new(now: Stamp, bytes_per_second: u32) -> Self {
        let ceiling = f64::from(bytes_per_second).max(SLOWEST);
        Self {
            ceiling,
            capacity: (ceiling * FIRST).max(SLOWEST),
            budget: 0.0,
            refilled: now,
            limited: false,
            echoes: VecDeque::new(),
            base: [Duration::MAX; 3],
            base_since: now,
            wait: Duration::ZERO,
            has_waited: false,
            drain_until: now,
            stuck_since: None,
            drained: false,
            air_loss: 0.0,
            radio_full: None,
            round_trip: Duration::ZERO,
            burstiness: 1.0,
        }
    }

    /// Bytes per second at present.
    pub(super) fn rate(&self, now: Stamp) -> f64 {
        let settling = SETTLING.max(self.round_trip * 2).as_secs_f64();
        let correction = 1.0 + (self.target() - self.wait.as_secs_f64()) / settling;
        let draining = if now < self.drain_until {
            DRAINING
        } else {
            1.0
        };
        (self.capacity * correction.clamp(0.5, 1.25) * draining).clamp(SLOWEST, self.ceiling)
    }

    /// How long symbols wait in the link's buffers at present.
    pub(super) fn wait(&self) -> Duration {
        self.wait
    }

    fn target(&self) -> f64 {
        let frame = (self.symbol_bytes() + SYMBOL_FRAME_BYTES) as f64;
        (TARGET_FRAMES * frame / self.capacity).max(TARGET.as_secs_f64())
    }

    /// How large symbols should be at present.
    pub(super) fn symbol_bytes(&self) -> usize {
        let frame = (self.capacity * LONGEST_FRAME.as_secs_f64()) as usize;
        let symbol = frame.saturating_sub(SYMBOL_FRAME_BYTES) / 8 * 8;
        symbol.clamp(LEAST_SYMBOL, SYMBOL_BYTES)
    }

    /// Time has passed: more may be sent.
    pub(super) fn refill(&mut self, now: Stamp) {
        let rate = self.rate(now);
        let earned = rate * now.since(self.refilled).as_secs_f64();
        // Even a very slow link must be able to send one frame.
        self.budget = (self.budget + earned).min((rate * BURST.as_secs_f64()).max(1.0));
        self.refilled = now;
    }

    /// Whether anything may be sent now.
    pub(super) fn allows(&self) -> bool {
        self.budget > 0.0
    }

    /// Bytes are sent.
    pub(super) fn spend(&mut self, bytes: f64) {
        let most = self.capacity * DEBT.as_secs_f64();
        self.budget = (self.budget - bytes).max(-most);
    }

    /// There was more to send than allowed.
    pub(super) fn ran_out(&mut self) {
        self.limited = true;
    }

    /// A symbol has arrived; how long round trips are, and how much larger the variance of losses is than if each symbol was
    /// lost for itself.
    pub(super) fn echoed(
        &mut self,
        now: Stamp,
        echo: Echo,
        (round_trip, burstiness): (Duration, f64),
    ) {
        (self.round_trip, self.burstiness) = (round_trip, burstiness);
        let since_last =
            (self.echoes.back()).map_or(Duration::ZERO, |last| echo.sent.at.since(last.sent.at));
        self.echoes.push_back(echo);
        let window = WINDOW.max(round_trip);
        let is_old = |oldest: &Echo| echo.sent.at.since(oldest.sent.at) > window;
        while self.echoes.len() > MAX_ECHOES || self.echoes.front().is_some_and(is_old) {
            self.echoes.pop_front();
        }
        self.update_base(now, echo.round_trip);
        let lately = |(place, other): &(usize, &Echo)| {
            *place < STANDING_ECHOES || echo.sent.at.since(other.sent.at) <= STANDING
        };
        let newest_first = self.echoes.iter().rev().enumerate();
        let least = (newest_first.take_while(lately))
            .map(|(_, echo)| echo.round_trip)
            .min();
        self.wait = least.map_or(Duration::ZERO, |least| {
            least.saturating_sub(self.shortest())
        });
        self.adapt(now, since_last);
    }

    fn shortest(&self) -> Duration {
        self.base.into_iter().min().unwrap_or_default()
    }

    /// Remembers the shortest round trip; now and then the buffers are emptied, or it would never be seen again.
    fn update_base(&mut self, now: Stamp, round_trip: Duration) {
        if now.since(self.base_since) >= BASE_SPAN {
            self.base_since = now;
            self.base.rotate_right(1);
            self.base[0] = Duration::MAX;
            self.drain_until = now + (self.wait + TARGET).div_f64(1.0 - DRAINING);
        }
        self.base[0] = self.base[0].min(round_trip);
    }

    fn adapt(&mut self, now: Stamp, since_last: Duration) {
        // After an outage, nobody knows.
        let elapsed = since_last.min(WINDOW).as_secs_f64();
        let waits = self.wait.as_secs_f64() > self.target() / 2.0;
        let (arrived, symbols) = self.arrived();
        if waits {
            self.has_waited = true;
            if let Some((sent, trend)) = self.trend() {
                let passed = arrived / (1.0 - self.air_loss);
                let overflows = passed < OVERFLOWING.min(1.0 - CHANCE * self.deviation(symbols));
                let gets_through = if overflows { passed } else { 1.0 };
                self.follow(now, (sent, trend, gets_through), elapsed);
            }
            if self.limited && self.wait.as_secs_f64() < 2.0 * self.target() {
                // It may be jitter: if it is a queue, the trend will tell.
                self.capacity *= 1.0 + DOUBT * elapsed;
            }
            self.limited = false;
            self.capacity = self.capacity.clamp(SLOWEST, self.ceiling);
            return;
        }
        (self.stuck_since, self.drained) = (None, false);
        self.air_loss += (1.0 - arrived - self.air_loss) * (elapsed / AIR_MEMORY_S).min(1.0);
        if self.limited
            && self
                .radio_full
                .is_none_or(|at| now.since(at) > RADIO_MEMORY)
        {
            self.capacity *= if self.has_waited {
                1.0 + GROWTH * elapsed
            } else {
                2_f64.powf(elapsed / self.round_trip.max(BURST).as_secs_f64())
            };
        }
        self.limited = false;
        self.capacity = self.capacity.clamp(SLOWEST, self.ceiling);
    }

    /// Something waits: what is sent, how the wait changes, and what arrives tells what the link carries.
    fn follow(&mut self, now: Stamp, (sent, trend, passed): (f64, f64, f64), elapsed: f64) {
        let weight = (elapsed / WINDOW.as_secs_f64()).min(1.0);
        if passed < 1.0 {
            // The buffer is full, the wait cannot grow any more: what arrives is what the link carries.
            self.stuck_since = None;
            self.capacity += (sent * passed - self.capacity) * weight;
        } else if sent > LITTLE * self.capacity || trend < -(1.0 - LITTLE) / 2.0 {
            self.stuck_since = None;
            let carried = sent / (1.0 + trend).max(0.1);
            // Who has little to send learns only that the link carries that, unless a real queue stands.
            let is_told = self.limited || carried > self.capacity;
            if is_told || self.wait.as_secs_f64() > REAL * self.target() {
                self.capacity += (carried - self.capacity) * weight;
            }
        } else {
            self.stuck(now, sent);
        }
    }

    /// A queue would get shorter now. Where it does not even if still less is sent, the way itself became longer.
    fn stuck(&mut self, now: Stamp, sent: f64) {
        let since = *self.stuck_since.get_or_insert(now);
        if now.since(since) <= STUCK + self.round_trip * 2 {
            return;
        }
        self.stuck_since = None;
        if self.drained {
            self.drained = false;
            self.base = [self.shortest() + self.wait, Duration::MAX, Duration::MAX];
            self.capacity = sent;
        } else {
            self.drained = true;
            self.drain_until = now + STUCK;
        }
    }

    /// Which share of the symbols sent lately has arrived, and how many that were.
    fn arrived(&self) -> (f64, u64) {
        let (Some(first), Some(last)) = (self.echoes.front(), self.echoes.back()) else {
            return (1.0, 0);
        };
        let sent = last.sent.symbols - first.sent.symbols;
        let received = last.received.wrapping_sub(first.received);
        let share = f64::from(received) / sent.max(1) as f64;
        (
            if sent == 0 {
                1.0
            } else {
                share.clamp(0.05, 1.0)
            },
            sent,
        )
    }

    /// By how much the share of so many symbols that arrives differs by chance, relative to what arrives on average.
    fn deviation(&self, symbols: u64) -> f64 {
        let odds = self.air_loss / (1.0 - self.air_loss);
        (odds * self.burstiness / symbols.max(1) as f64).sqrt()
    }

    /// Bytes sent per second lately, and by how much the wait grows meanwhile; `None` if too little was seen.
    fn trend(&self) -> Option<(f64, f64)> {
        let (first, last) = (self.echoes.front()?, self.echoes.back()?);
        let span = last.sent.at.since(first.sent.at);
        if self.echoes.len() < 4 || span < WINDOW / 2 {
            return None;
        }
        let sent = (last.sent.bytes - first.sent.bytes) as f64 / span.as_secs_f64();
        let points = self.echoes.iter().map(|echo| {
            let at = echo.sent.at.since(first.sent.at);
            (at.as_secs_f64(), echo.round_trip.as_secs_f64())
        });
        Some((sent, slope(points)?))
    }

    /// A radio on our side says which share of its buffer is free, in percent.
    pub(super) fn radio_has_room(&mut self, now: Stamp, percent: u8) {
        // The thresholds are those of ArduPilot, which slows its streams down in the same way.
        let factor = match percent {
            0..20 => 0.7,
            20..50 => 0.9,
            _ => return,
        };
        self.radio_full = Some(now);
        self.has_waited = true;
        self.capacity = (self.capacity * factor).max(SLOWEST);
    }
}

/// Of the straight line that fits best; `None` without two different abscissas.
fn slope(points: impl Iterator<Item = (f64, f64)> + Clone) -> Option<f64> {
    let n = points.clone().count() as f64;
    let (x, y) = points
        .clone()
        .fold((0.0, 0.0), |(x, y), p| (x + p.0 / n, y + p.1 / n));
    let (xx, xy) = points.fold((0.0, 0.0), |(xx, xy), p| {
        (xx + (p.0 - x).powi(2), xy + (p.0 - x) * (p.1 - y))
    });
    (xx > 0.0).then(|| xy / xx)
}

#[cfg(test)]
mod tests;
