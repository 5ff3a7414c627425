//! The object transport over bad links, in simulated time.
//!
//! A UAV sends more map tiles than the link carries, BEV frames and telemetry; the ground station sends commands. The
//! emulator of [`sitl::link`] lies between them. Each case is run with 0, 100 and 200 ms of delay one way, and the worst
//! of the three is reported:
//!
//! - `goodput_share`: bytes of tiles delivered in 40 s, as a share of `rate × (1 − loss)` less the bytes of the BEV frames delivered,
//! - `bev_in_time`: share of BEV frames delivered within [`BEV_DEADLINE`],
//! - `bev_age_p99_ms`: how old 99 of 100 delivered BEV frames are at most, `bev_age_p50_ms` the median,
//! - `command_p99_ms`: from a command to its acknowledgement, less twice the delay one way; left out of the figures where more
//!   than one in a hundred is never answered, which `commands_answered` tells,
//! - `catch_up_s`: after 30 s in which nothing passes, until the tiles that changed meanwhile are there (five seconds' worth of
//!   the link) and nothing waits,
//! - `bytes_per_tile`: of frames sent in both directions for each tile delivered; BEV frames, telemetry and commands count, too.

mod tandem;
mod team;

use std::time::Duration;

use sitl::link::{Loss, Profile};

use super::{Figures, Outcome, Request, Table};
use team::Measured;

/// A BEV frame that is older is worthless.
const BEV_DEADLINE: Duration = Duration::from_millis(500);
/// Delays one way.
const DELAYS_MS: [u64; 3] = [0, 100, 200];
/// Frames in a burst of losses.
const BURST: f64 = 10.0;
const SEED: u64 = 1100;

/// A rate by its name, with the BEV frames that it carries: how many a second, of how many bytes.
const RATES: [(&str, f64, u32, usize); 4] = [
    ("28mbit", 28e6, 10, 16_000),
    ("10mbit", 10e6, 10, 16_000),
    ("1mbit", 1e6, 5, 3_000),
    ("115kbit", 115_200.0, 1, 2_000),
];

const LOSSES: [(&str, f64, bool); 9] = [
    ("0", 0.0, false),
    ("5", 0.05, false),
    ("10", 0.1, false),
    ("20", 0.2, false),
    ("30", 0.3, false),
    ("5b", 0.05, true),
    ("10b", 0.1, true),
    ("20b", 0.2, true),
    ("30b", 0.3, true),
];

/// What is asked of a link.
#[derive(Clone, Debug)]
struct Case {
    profile: Profile,
    loss: f64,
    bev_hz: u32,
    bev_bytes: usize,
    seed: u64,
}

impl Case {
    fn rate(&self) -> f64 {
        self.profile.bytes_per_second.unwrap_or(f64::INFINITY)
    }
}

/// The metrics, and whether more is worse.
const METRICS: [(&str, bool); 8] = [
    ("goodput_share", false),
    ("bev_in_time", false),
    ("bev_age_p50_ms", true),
    ("bev_age_p99_ms", true),
    ("command_p99_ms", true),
    ("commands_answered", false),
    ("catch_up_s", true),
    ("bytes_per_tile", true),
];

/// Runs every case.
pub(super) fn run(request: &mut Request<'_>) -> anyhow::Result<Outcome> {
    let seed = request.seed.unwrap_or(SEED);
    let mut figures = Figures::default();
    let header = ["", "delay"].into_iter().chain(METRICS.map(|m| m.0));
    let mut table = Table {
        title: "The object transport over bad links".to_owned(),
        header: header.map(str::to_owned).collect(),
        rows: Vec::new(),
    };
    for (rate_name, bits, bev_hz, bev_bytes) in RATES {
        for (loss_name, loss, bursty) in LOSSES {
            let name = format!("{rate_name}/{loss_name}");
            let mut worst = [f64::NAN; METRICS.len()];
            for delay_ms in DELAYS_MS {
                let delay = Duration::from_millis(delay_ms);
                let losses = if bursty {
                    Loss::Bursts {
                        share: loss,
                        length: BURST,
                    }
                } else {
                    Loss::Even(loss)
                };
                let case = Case {
                    profile: Profile {
                        loss: losses,
                        jitter: Duration::from_millis(2),
                        ..Profile::of_rate(bits, delay)
                    },
                    loss,
                    bev_hz,
                    bev_bytes,
                    seed: seed + delay_ms,
                };
                let measured = team::run(&case, tandem::Tandem::new(&case));
                let row = metrics(&case, &measured);
                table.rows.push(table_row(&name, delay_ms, &row));
                for ((worst, value), (_, more_is_worse)) in worst.iter_mut().zip(row).zip(METRICS) {
                    let is_worse = if more_is_worse {
                        value > *worst
                    } else {
                        value < *worst
                    };
                    if worst.is_nan() || is_worse {
                        *worst = value;
                    }
                }
            }
            for ((metric, _), value) in METRICS.into_iter().zip(worst) {
                if value.is_finite() {
                    figures.set(&[&name, metric], value)?;
                }
            }
            (request.say)(&format!("{name} done"));
        }
    }
    Ok(Outcome {
        figures,
        text: table.to_string(),
    })
}

fn table_row(name: &str, delay_ms: u64, row: &[f64]) -> Vec<String> {
    let cells = row.iter().map(|value| format!("{value:.3}"));
    [name.to_owned(), format!("{delay_ms} ms")]
        .into_iter()
        .chain(cells)
        .collect()
}

/// The figures of one run, in the order of [`METRICS`].
fn metrics(case: &Case, measured: &Measured) -> [f64; 8] {
    let room = case.rate() * (1.0 - case.loss) * measured.saturated.as_secs_f64();
    let of_bev = measured.bev_bytes as f64;
    let answered = measured.commands.iter().flatten().count();
    let age = |share: f64| percentile(&measured.bev_ages, share) * 1e3;
    [
        measured.tile_bytes as f64 / (room - of_bev),
        measured.bev_in_time as f64 / measured.bev_offered as f64,
        age(0.5),
        age(0.99),
        percentile(&measured.commands, 0.99) * 1e3 - 2e3 * case.profile.delay.as_secs_f64(),
        answered as f64 / measured.commands.len() as f64,
        measured
            .catch_up
            .map_or(f64::INFINITY, |span| span.as_secs_f64()),
        measured.wire_bytes as f64 / measured.tiles as f64,
    ]
}

/// In seconds; infinite for what never came.
fn percentile(spans: &[Option<Duration>], share: f64) -> f64 {
    let mut seconds: Vec<f64> = spans
        .iter()
        .map(|span| span.map_or(f64::INFINITY, |s| s.as_secs_f64()))
        .collect();
    seconds.sort_by(f64::total_cmp);
    let at = (seconds.len().saturating_sub(1) as f64 * share).ceil() as usize;
    seconds.get(at).copied().unwrap_or(f64::NAN)
}
