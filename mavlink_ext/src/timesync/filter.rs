//! Offset and skew of a peer's clock from round trips.
//!
//! Each exchange bounds the offset from above by `p − s` and from below by `p − r`. Of every few seconds the least upper
//! and the greatest lower bound are kept: queues only widen them. The offset lies in their intersection, each widened by
//! how far the clocks may have drifted since.
//!
//! ```text
//! upper = min over i of  (p − s)ᵢ + skew·age + 3σ·age        offset = (upper + lower) / 2
//! lower = max over i of  (p − r)ᵢ + skew·age − 3σ·age        bound  = (upper − lower) / 2      sigma = bound / √3
//! ```
//!
//! The skew is the common slope of two lines, one through the upper and one through the lower bounds, each with its own
//! height: the least delays need not be alike, nor known. Bounds far off their line were delayed and weigh little. Before
//! anything was heard, clocks may drift as quartz oscillators do; that is the prior of a Bayesian regression.
//!
//! - D. L. Mills, RFC 5905 §10 (the clock filter: least delay); K. Marzullo, S. Owicki, 1983 (intersection);
//!   S. Moon, P. Skelly, D. Towsley, INFOCOM 1999 (skew from one-way delays).

use std::collections::VecDeque;
use std::time::Duration;

use maps::time::Stamp;

use super::{ClockSource, Estimate};

/// Of each span of this length, the best bounds are kept.
const BIN: Duration = Duration::from_secs(10);
/// Spans remembered: ten minutes and a half. Longer, and the temperature of the oscillators changes.
const BINS: usize = 64;
/// Standard uncertainty of the skew of two computers' clocks before anything is known: 100 ppm is three of it.
pub(super) const SKEW_SIGMA: f64 = 100e-6 / 3.0;
/// The skew is never known better: it changes with the temperature.
const LEAST_SKEW_SIGMA: f64 = 1e-6;
/// No two clocks that work differ by more.
const MAX_SKEW: f64 = 500e-6;
/// Bounds are not known better than this, in seconds: time to read a clock and to hand a message to the system.
const READING: f64 = 50e-6;
/// Of an exponential distribution; of an even one it is less.
const DEVIATION_OF_MEDIAN: f64 = 1.5;
/// The weights of the regression depend on its result.
const PASSES: usize = 3;

/// One answered request. Invariant: it was answered after it was sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Exchange {
    /// In the middle between sent and received.
    at: Stamp,
    /// The offset is at least this, in nanoseconds.
    lower: i64,
    /// The offset is at most this, in nanoseconds.
    upper: i64,
}

impl Exchange {
    /// `None` where the peer's time is none, or before we asked.
    pub(super) fn new(sent: i64, received: Stamp, peer: i64) -> Option<Self> {
        let received = i64::try_from(received.as_nanos()).ok()?;
        let round_trip = received.checked_sub(sent).filter(|span| *span >= 0)?;
        let at = u64::try_from(sent.checked_add(round_trip / 2)?).ok()?;
        (peer > 0).then_some(())?;
        Some(Self {
            at: Stamp::from_nanos(at),
            lower: peer.checked_sub(received)?,
            upper: peer.checked_sub(sent)?,
        })
    }
}

/// A bound on the offset, and when it was found.
#[derive(Clone, Copy, Debug)]
struct Bound {
    at: Stamp,
    value: i64,
}

/// The best bounds of some seconds.
#[derive(Clone, Copy, Debug)]
struct Bin {
    start: Stamp,
    lower: Bound,
    upper: Bound,
}

/// Bounds of the recent past, and the skew that they show.
#[derive(Clone, Debug)]
pub(super) struct Filter {
    bins: VecDeque<Bin>,
    skew: f64,
    skew_sigma: f64,
}

impl Default for Filter {
    fn default() -> Self {
        Self {
            bins: VecDeque::new(),
            skew: 0.0,
            skew_sigma: SKEW_SIGMA,
        }
    }
}

/// Where the offset may be, in nanoseconds more than the filter's base.
#[derive(Clone, Copy, Debug)]
struct Span {
    lower: f64,
    upper: f64,
}

impl Filter {
    /// Adds an exchange, in the order in which they are received.
    pub(super) fn insert(&mut self, exchange: Exchange) {
        let Exchange { at, lower, upper } = exchange;
        let lower = Bound { at, value: lower };
        let upper = Bound { at, value: upper };
        match self.bins.back_mut() {
            Some(bin) if at.since(bin.start) < BIN => {
                if upper.value < bin.upper.value {
                    bin.upper = upper;
                }
                if lower.value > bin.lower.value {
                    bin.lower = lower;
                }
            }
            _ => {
                if self.bins.len() >= BINS {
                    self.bins.pop_front();
                }
                self.bins.push_back(Bin {
                    start: at,
                    lower,
                    upper,
                });
            }
        }
        self.fit_skew();
    }

    /// Whether an exchange fits what is known.
    pub(super) fn agrees(&self, now: Stamp, exchange: &Exchange) -> bool {
        let (Some(base), Some(known)) = (self.base(), self.span(now)) else {
            return true;
        };
        from_base(exchange.lower, base) <= known.upper
            && from_base(exchange.upper, base) >= known.lower
    }

    /// The estimate; `None` before the first exchange.
    pub(super) fn estimate(&self, now: Stamp) -> Option<Estimate> {
        let base = self.base()?;
        let span = self.span(now)?;
        let middle = f64::midpoint(span.lower, span.upper).round() as i128;
        let offset = (i128::from(base) + middle).clamp(i64::MIN.into(), i64::MAX.into());
        let bound = (span.upper - span.lower) / 2.0;
        Some(Estimate {
            offset: i64::try_from(offset).unwrap_or(i64::MAX),
            skew: self.skew,
            skew_sigma: self.skew_sigma,
            sigma: duration_of_nanos(bound / 3.0_f64.sqrt()),
            bound: duration_of_nanos(bound),
            source: ClockSource::RoundTrips,
        })
    }

    /// What values are counted from, so that they fit a float.
    fn base(&self) -> Option<i64> {
        self.bins.back().map(|bin| bin.lower.value)
    }

    /// Where the offset is now.
    fn span(&self, now: Stamp) -> Option<Span> {
        let newest = self.bins.back()?;
        // The skew may be wrong once in a while; bounds that clocks of any kind keep are not.
        [self.skew_sigma * 3.0, MAX_SKEW]
            .into_iter()
            .map(|drift| self.intersection(now, self.bins.iter(), drift))
            .find(|span| span.lower <= span.upper)
            .or_else(|| Some(self.intersection(now, [newest].into_iter(), MAX_SKEW)))
            .map(|span| Span {
                lower: span.lower.min(span.upper),
                upper: span.upper.max(span.lower),
            })
    }

    fn intersection<'a>(
        &self,
        now: Stamp,
        bins: impl Iterator<Item = &'a Bin>,
        drift: f64,
    ) -> Span {
        let base = self.base().unwrap_or(0);
        let mut span = Span {
            lower: f64::NEG_INFINITY,
            upper: f64::INFINITY,
        };
        for bin in bins {
            let drifted = |bound: Bound| from_base(bound.value, base) + self.skew * age(now, bound);
            let slack = |bound: Bound| drift * age(now, bound).abs();
            span.upper = span.upper.min(drifted(bin.upper) + slack(bin.upper));
            span.lower = span.lower.max(drifted(bin.lower) - slack(bin.lower));
        }
        span
    }

    fn fit_skew(&mut self) {
        let (Some(base), Some(newest)) = (self.base(), self.bins.back().map(|bin| bin.upper.at))
        else {
            return;
        };
        // In seconds; lower bounds upside down, so that delays lengthen both.
        let seconds = |bound: Bound, sign: f64| {
            let x = -age(newest, bound) * 1e-9;
            (x, sign * from_base(bound.value, base) * 1e-9)
        };
        let uppers: Vec<_> = self.bins.iter().map(|b| seconds(b.upper, 1.0)).collect();
        let lowers: Vec<_> = self.bins.iter().map(|b| seconds(b.lower, -1.0)).collect();
        for _ in 0..PASSES {
            let upper = Fit::of(&uppers, self.skew);
            let lower = Fit::of(&lowers, -self.skew);
            let information = upper.sxx + lower.sxx + SKEW_SIGMA.powi(-2);
            let pulled = upper.sxx * self.skew + upper.sxy + lower.sxx * self.skew - lower.sxy;
            self.skew = (pulled / information).clamp(-MAX_SKEW, MAX_SKEW);
            // Worse than its weights say, as after a change of the route: so much less is known.
            let worse = (upper.misfit + lower.misfit).max(1.0);
            let sigma = (worse / information).sqrt();
            self.skew_sigma = sigma.clamp(LEAST_SKEW_SIGMA, SKEW_SIGMA);
        }
    }
}

/// A line through bounds, as corrections to a slope.
#[derive(Clone, Copy, Debug, Default)]
struct Fit {
    /// Information about the slope.
    sxx: f64,
    /// Information times the correction of the slope.
    sxy: f64,
    /// Half of the mean square of the weighted residuals about the line: 1/2 where the weights are right.
    misfit: f64,
}

impl Fit {
    /// Of points that lie on a line of about this slope, or above it by a delay.
    fn of(points: &[(f64, f64)], slope: f64) -> Self {
        let level = |&(x, y): &(f64, f64)| y - slope * x;
        let floor = points.iter().map(level).fold(f64::INFINITY, f64::min);
        let excess: Vec<f64> = points.iter().map(|point| level(point) - floor).collect();
        let mut sorted = excess.clone();
        sorted.sort_by(f64::total_cmp);
        // The deviation of delays that are as often below the median as above it.
        let usual = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0) * DEVIATION_OF_MEDIAN;
        let weight = |excess: f64| 1.0 / (excess * excess + usual * usual + READING * READING);
        let weighted: Vec<(f64, f64, f64)> = (points.iter().zip(&excess))
            .map(|(&(x, _), &excess)| (weight(excess), x, excess))
            .collect();
        let sum = |term: &dyn Fn(f64, f64) -> f64| -> f64 {
            weighted.iter().map(|&(w, x, y)| w * term(x, y)).sum()
        };
        let total = sum(&|_, _| 1.0);
        if total <= 0.0 {
            return Self::default();
        }
        let (mean_x, mean_y) = (sum(&|x, _| x) / total, sum(&|_, y| y) / total);
        let sxx = sum(&|x, _| (x - mean_x).powi(2));
        let sxy = sum(&|x, y| (x - mean_x) * (y - mean_y));
        let syy = sum(&|_, y| (y - mean_y).powi(2));
        let explained = if sxx > 0.0 { sxy * sxy / sxx } else { 0.0 };
        // Weights that are guessed from a few points say little.
        let free = points.len().saturating_sub(3) as f64;
        let trust = free / points.len() as f64;
        Self {
            sxx: sxx * trust,
            sxy: sxy * trust,
            misfit: (syy - explained).max(0.0) / free.max(1.0) / 2.0,
        }
    }
}

/// In nanoseconds; negative where the bound is later than `now`.
fn age(now: Stamp, bound: Bound) -> f64 {
    (i128::from(now.as_nanos()) - i128::from(bound.at.as_nanos())) as f64
}

fn from_base(value: i64, base: i64) -> f64 {
    (i128::from(value) - i128::from(base)) as f64
}

fn duration_of_nanos(nanos: f64) -> Duration {
    Duration::from_nanos(nanos.max(0.0).round() as u64)
}
