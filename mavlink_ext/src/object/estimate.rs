//! What the sender knows of the link: its round trip, and how much of what it sends is lost.

use std::collections::VecDeque;
use std::time::Duration;

use maps::time::Stamp;

/// Half of the weight of what the reports said is gone after so many symbols.
const MEMORY_SYMBOLS: f64 = 1000.0;
/// Fewer symbols than this say nothing about loss.
const MIN_SYMBOLS: f64 = 30.0;
/// More loss than this is taken for an outage, against which redundancy does not help.
const MAX_LOSS: f64 = 0.8;
/// How far back the count of symbols sent is remembered.
const HISTORY: Duration = Duration::from_secs(4);

/// Round trip and loss, from reports.
#[derive(Clone, Debug)]
pub(super) struct LinkEstimate {
    /// Smoothed round trip and its mean deviation (RFC 6298); `None` before the first sample.
    round_trip: Option<(Duration, Duration)>,
    /// Symbols sent so far, at some moments.
    history: VecDeque<(Stamp, u64)>,
    /// Symbols sent and received, decaying.
    sent: f64,
    received: f64,
    /// Symbols the peer had received, and those we had sent long enough before, at its last report.
    last: Option<(u32, u64)>,
}

impl LinkEstimate {
    pub(super) fn new() -> Self {
        Self {
            round_trip: None,
            history: VecDeque::new(),
            sent: 0.0,
            received: 0.0,
            last: None,
        }
    }

    /// So many symbols had been sent by `now`.
    pub(super) fn sent_by(&mut self, now: Stamp, total: u64) {
        if self.history.back().is_none_or(|(_, last)| *last != total) {
            self.history.push_back((now, total));
        }
        while self
            .history
            .front()
            .is_some_and(|(at, _)| now.since(*at) > HISTORY)
        {
            self.history.pop_front();
        }
    }

    /// An announcement was answered after so long.
    pub(super) fn round_trip_was(&mut self, sample: Duration) {
        self.round_trip = Some(match self.round_trip {
            None => (sample, sample / 2),
            Some((smooth, deviation)) => (
                smooth.mul_f64(0.875) + sample.mul_f64(0.125),
                deviation.mul_f64(0.75) + smooth.abs_diff(sample).mul_f64(0.25),
            ),
        });
    }

    /// After so long, what was sent has arrived and been reported, or is lost.
    pub(super) fn patience(&self) -> Duration {
        let (smooth, deviation) = self
            .round_trip
            .unwrap_or((Duration::from_millis(300), Duration::from_millis(50)));
        (smooth + deviation * 4).clamp(Duration::from_millis(10), Duration::from_secs(2))
    }

    /// A report came: the peer has received so many symbols in its session, modulo 2³².
    pub(super) fn reported(&mut self, now: Stamp, received: u32) {
        let round_trip = self.round_trip.map_or(Duration::ZERO, |(smooth, _)| smooth);
        let before = now - round_trip;
        let sent = self.history.iter().rev().find(|(at, _)| *at <= before);
        let Some(&(_, sent)) = sent else {
            return;
        };
        if let Some((last_received, last_sent)) = self.last {
            let news = received.wrapping_sub(last_received);
            if news > u32::MAX / 2 || sent < last_sent {
                return; // An older report overtaken by a newer one.
            }
            let sent_since = (sent - last_sent) as f64;
            let keep = 0.5_f64.powf(sent_since / MEMORY_SYMBOLS);
            self.sent = self.sent * keep + sent_since;
            self.received = self.received * keep + f64::from(news);
        }
        self.last = Some((received, sent));
    }

    /// The peer counts from zero again.
    pub(super) fn peer_restarted(&mut self) {
        self.last = None;
    }

    /// The share of symbols lost lately; `None` before enough were sent.
    pub(super) fn loss(&self) -> Option<f64> {
        (self.sent >= MIN_SYMBOLS).then(|| (1.0 - self.received / self.sent).clamp(0.0, MAX_LOSS))
    }

    /// How many symbols to send so that `needed` arrive: on average, and so many standard deviations more.
    pub(super) fn to_deliver(&self, needed: u32, deviations: f64) -> u32 {
        let loss = self.loss().unwrap_or(0.0);
        let n = f64::from(needed);
        let spread = deviations * (n * loss).sqrt();
        ((n + spread) / (1.0 - loss)).ceil() as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loss_follows_the_reports() {
        let mut link = LinkEstimate::new();
        let at = |millis| Stamp::from_nanos(millis * 1_000_000);
        assert_eq!(link.loss(), None);
        assert_eq!(link.to_deliver(100, 1.0), 100);
        let mut received = 0;
        for step in 0..=100 {
            link.sent_by(at(step * 100), step * 50);
            link.reported(at(step * 100), received);
            received += 40;
        }
        let loss = link.loss().expect("5000 symbols were sent");
        assert!((loss - 0.2).abs() < 0.01, "{loss}");
        assert_eq!(link.to_deliver(100, 1.0), 131);
        for step in 101..=200 {
            received += 10;
            link.sent_by(at(step * 100), step * 50);
            link.reported(at(step * 100), received);
        }
        let loss = link.loss().expect("10000 symbols were sent");
        assert!((loss - 0.8).abs() < 0.03, "{loss}");
    }

    #[test]
    fn patience_covers_a_round_trip_that_varies() {
        let mut link = LinkEstimate::new();
        for millis in [100, 140, 100, 140, 100, 140, 100, 140] {
            link.round_trip_was(Duration::from_millis(millis));
        }
        let patience = link.patience();
        assert!(patience > Duration::from_millis(140) && patience < Duration::from_millis(300));
    }
}
