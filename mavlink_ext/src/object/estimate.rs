//! What the sender knows of the link: how long the way takes, and how much of what it sends is lost.
//!
//! Each report echoes the symbol that came last, with the time it lay there. The sender knows when that symbol left, and
//! how many had left before it: so one report tells the round trip, the share lost, and what cannot be under way any more.

use std::collections::VecDeque;
use std::time::Duration;

use maps::time::Stamp;

use crate::dialect::tandem::TANDEM_REPORT_DATA;

/// Half of the weight of what the reports said is gone after so many symbols.
const MEMORY_SYMBOLS: f64 = 1000.0;
/// Fewer symbols than this say nothing about loss.
const MIN_SYMBOLS: f64 = 30.0;
/// More loss than this is taken for an outage, against which redundancy does not help.
const MAX_LOSS: f64 = 0.8;
/// Fewer losses than this say nothing about bursts.
const MIN_SPREAD: f64 = 5.0;
/// Longer bursts are outages, against which redundancy does not help.
const MAX_BURSTINESS: f64 = 16.0;
/// Less loss than this is none.
const LEAST_LOSS: f64 = 0.002;
/// Copies of one message are all lost with this probability at most.
const ALL_LOST: f64 = 0.002;
/// How far back it is remembered which symbols were sent when.
const HISTORY: Duration = Duration::from_secs(4);
/// Symbols remembered at most: what the fastest link carries in that time.
const MAX_HISTORY: usize = 1 << 17;
/// `echo_age` where nothing is echoed.
pub(super) const NO_ECHO: u32 = u32::MAX;
/// A symbol that was overtaken is late by less than this share of the round trip, or than others were lately.
const OVERTAKEN: f64 = 0.125;
/// How much of that is remembered after each report.
const REMEMBERED: f64 = 0.99;
/// From the end of a round of symbols to the report of what is missing: the receiver waits a little for late ones.
const REPORT_LATENCY: Duration = Duration::from_millis(45);

/// A symbol that was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sent {
    /// When.
    pub(super) at: Stamp,
    /// Symbols sent by then, with this one.
    pub(super) symbols: u64,
    /// Bytes sent by then.
    pub(super) bytes: u64,
}

/// A symbol that was sent and has arrived.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Echo {
    pub(super) sent: Sent,
    /// How long the way there and that of the report back took.
    pub(super) round_trip: Duration,
    /// Symbols that the peer has received, modulo 2³².
    pub(super) received: u32,
}

/// Round trip and loss, from reports.
#[derive(Clone, Debug)]
pub(super) struct LinkEstimate {
    /// Smoothed round trip and its mean deviation (RFC 6298); `None` before the first sample.
    round_trip: Option<(Duration, Duration)>,
    /// Lower half of the transfer and symbol, and when it was sent; the newest last.
    history: VecDeque<(u16, u16, Sent)>,
    total: u64,
    /// Symbols sent and received, decaying.
    sent: f64,
    received: f64,
    /// The square of how far the losses between two reports were from the mean share, and what it would be if each symbol was
    /// lost for itself; decaying. Losses that come in bursts make it larger.
    spread: (f64, f64),
    /// Symbols the peer had received when the one sent last of those echoed came; `None` after the peer's restart.
    last: Option<u32>,
    /// The one sent last of those echoed.
    newest: Option<Sent>,
    /// By how much symbols were overtaken at most, lately.
    overtaken: Duration,
}

impl LinkEstimate {
    pub(super) fn new() -> Self {
        Self {
            round_trip: None,
            history: VecDeque::new(),
            total: 0,
            sent: 0.0,
            received: 0.0,
            spread: (0.0, 0.0),
            last: None,
            newest: None,
            overtaken: Duration::ZERO,
        }
    }

    /// A symbol was sent; with it, so many bytes were.
    pub(super) fn symbol_sent(&mut self, at: Stamp, (transfer, symbol): (u32, u16), bytes: u64) {
        self.total += 1;
        let sent = Sent {
            at,
            symbols: self.total,
            bytes,
        };
        self.history.push_back((transfer as u16, symbol, sent));
        let is_old = |at: Stamp, oldest: &Sent| at.since(oldest.at) > HISTORY;
        while self.history.len() > MAX_HISTORY
            || (self.history.front()).is_some_and(|(_, _, oldest)| is_old(at, oldest))
        {
            self.history.pop_front();
        }
    }

    /// A report came. What it echoes, if that is news.
    pub(super) fn reported(&mut self, now: Stamp, report: &TANDEM_REPORT_DATA) -> Option<Echo> {
        let name = (report.echo_transfer, report.echo_symbol);
        let age = Duration::from_micros(u64::from(report.echo_age));
        if report.echo_age == NO_ECHO || age > HISTORY {
            return None;
        }
        let mut backwards = self.history.iter().rev();
        let &(_, _, sent) = backwards.find(|(transfer, symbol, _)| (*transfer, *symbol) == name)?;
        let way = now.since(sent.at).checked_sub(age)?;
        let newest = self.newest.replace(sent);
        if let Some(newest) = newest
            && newest.symbols >= sent.symbols
        {
            // A symbol or report that was overtaken, or the same symbol once more.
            self.overtaken = self.overtaken.max(newest.at.since(sent.at));
            self.newest = Some(newest);
            return None;
        }
        if let (Some(newest), Some(last)) = (newest, self.last) {
            let sent_since = (sent.symbols - newest.symbols) as f64;
            let news = f64::from(report.symbols.wrapping_sub(last)).min(sent_since);
            self.count(sent_since, news);
        }
        self.last = Some(report.symbols);
        self.overtaken = self.overtaken.mul_f64(REMEMBERED);
        self.round_trip_was(way);
        Some(Echo {
            sent,
            round_trip: way,
            received: report.symbols,
        })
    }

    /// So many more were sent, and so many of them received.
    fn count(&mut self, sent: f64, received: f64) {
        let keep = 0.5_f64.powf(sent / MEMORY_SYMBOLS);
        if let Some(loss) = self.loss() {
            let off = sent * (1.0 - loss) - received;
            let (seen, expected) = self.spread;
            let of_each = sent * loss * (1.0 - loss);
            self.spread = (seen * keep + off * off, expected * keep + of_each);
        }
        self.sent = self.sent * keep + sent;
        self.received = self.received * keep + received;
    }

    /// How much larger the variance of losses is than if each symbol was lost for itself.
    pub(super) fn burstiness(&self) -> f64 {
        let (seen, expected) = self.spread;
        if expected < MIN_SPREAD {
            return 1.0;
        }
        (seen / expected).clamp(1.0, MAX_BURSTINESS)
    }

    fn round_trip_was(&mut self, sample: Duration) {
        self.round_trip = Some(match self.round_trip {
            None => (sample, sample / 2),
            Some((smooth, deviation)) => (
                smooth.mul_f64(0.875) + sample.mul_f64(0.125),
                deviation.mul_f64(0.75) + smooth.abs_diff(sample).mul_f64(0.25),
            ),
        });
    }

    /// The smoothed round trip; a guess before it is known.
    pub(super) fn round_trip(&self) -> Duration {
        self.round_trip
            .map_or(Duration::from_millis(300), |(smooth, _)| smooth)
    }

    /// After so long, what was sent has arrived and been reported, or is lost.
    pub(super) fn patience(&self) -> Duration {
        let deviation = self
            .round_trip
            .map_or(Duration::from_millis(50), |(_, deviation)| deviation);
        (self.round_trip() + deviation * 4).clamp(Duration::from_millis(10), Duration::from_secs(2))
    }

    /// Whether a symbol sent then has arrived or is lost: one that was sent clearly later has been echoed.
    pub(super) fn has_passed(&self, sent: Stamp) -> bool {
        let slack = self.round_trip().mul_f64(OVERTAKEN).max(self.overtaken);
        self.newest.is_some_and(|newest| newest.at > sent + slack)
    }

    /// How many more rounds of symbols arrive within this time after the one that begins now.
    pub(super) fn further_rounds(&self, within: Duration) -> u32 {
        let round_trip = self.round_trip();
        let after_first = within.saturating_sub(round_trip / 2).as_secs_f64();
        (after_first / (round_trip + REPORT_LATENCY).as_secs_f64()) as u32
    }

    /// The peer counts from zero again.
    pub(super) fn peer_restarted(&mut self) {
        self.last = None;
    }

    /// The share of symbols lost lately; `None` before enough were sent.
    pub(super) fn loss(&self) -> Option<f64> {
        (self.sent >= MIN_SYMBOLS).then(|| (1.0 - self.received / self.sent).clamp(0.0, MAX_LOSS))
    }

    /// How often to send a message of which one must arrive.
    pub(super) fn copies(&self) -> u32 {
        match self.loss() {
            Some(loss) if loss > LEAST_LOSS => (ALL_LOST.ln() / loss.ln()).ceil() as u32,
            Some(_) | None => 1,
        }
    }

    /// How many symbols to send so that `needed` arrive: on average, and so many standard deviations more.
    pub(super) fn to_deliver(&self, needed: u32, deviations: f64) -> u32 {
        let loss = self.loss().unwrap_or(0.0);
        let n = f64::from(needed);
        let spread = deviations * (n * loss * self.burstiness()).sqrt();
        ((n + spread) / (1.0 - loss)).ceil() as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: u64) -> Stamp {
        Stamp::ZERO + Duration::from_millis(millis)
    }

    /// Sends a symbol each millisecond, and reports every 50 ms which share of them has come, after a round trip of 100 ms.
    fn run(link: &mut LinkEstimate, millis: std::ops::Range<u64>, received: &mut u32, share: f64) {
        for ms in millis {
            link.symbol_sent(at(ms), (1, ms as u16), 266 * ms);
            if ms >= 100 && ms.is_multiple_of(50) {
                *received += (50.0 * share) as u32;
                let report = TANDEM_REPORT_DATA {
                    symbols: *received,
                    echo_transfer: 1,
                    echo_symbol: (ms - 100) as u16,
                    echo_age: 0,
                    ..TANDEM_REPORT_DATA::default()
                };
                let echo = link.reported(at(ms), &report).expect("it was sent");
                assert_eq!(echo.round_trip, Duration::from_millis(100));
                assert_eq!(link.reported(at(ms), &report), None, "no news");
            }
        }
    }

    #[test]
    fn loss_follows_the_reports() {
        let mut link = LinkEstimate::new();
        assert_eq!(link.loss(), None);
        assert_eq!(link.to_deliver(100, 1.0), 100);
        let mut received = 0;
        run(&mut link, 0..5_000, &mut received, 0.8);
        let loss = link.loss().expect("5000 symbols were sent");
        assert!((loss - 0.2).abs() < 0.01, "{loss}");
        assert_eq!(link.to_deliver(100, 1.0), 131);
        run(&mut link, 5_000..10_000, &mut received, 0.2);
        let loss = link.loss().expect("10000 symbols were sent");
        assert!((loss - 0.8).abs() < 0.03, "{loss}");
    }

    #[test]
    fn what_left_clearly_before_an_echoed_symbol_is_not_under_way() {
        let mut link = LinkEstimate::new();
        assert!(!link.has_passed(at(0)));
        run(&mut link, 0..201, &mut 0, 1.0);
        assert!(link.has_passed(at(80)), "100 has been echoed");
        assert!(!link.has_passed(at(95)), "it may have been overtaken");
    }

    #[test]
    fn a_report_about_what_was_never_sent_is_ignored() {
        let mut link = LinkEstimate::new();
        run(&mut link, 0..1000, &mut 0, 1.0);
        let forged = |symbol, age| TANDEM_REPORT_DATA {
            echo_transfer: 1,
            echo_symbol: symbol,
            echo_age: age,
            ..TANDEM_REPORT_DATA::default()
        };
        assert_eq!(link.reported(at(1000), &forged(5000, 0)), None);
        assert_eq!(link.reported(at(1000), &forged(999, 1 << 31)), None);
        assert_eq!(link.reported(at(1000), &forged(999, NO_ECHO)), None);
        assert_eq!(link.loss(), Some(0.0));
    }

    #[test]
    fn rounds_that_fit_before_a_deadline_are_counted() {
        let mut link = LinkEstimate::new();
        run(&mut link, 0..1000, &mut 0, 1.0);
        let rounds = |millis| link.further_rounds(Duration::from_millis(millis));
        assert_eq!(
            [rounds(0), rounds(150), rounds(250), rounds(400)],
            [0, 0, 1, 2]
        );
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
