//! The object transport over bad links, in simulated time.
//!
//! A UAV sends more map tiles than the link carries, BEV frames and telemetry; the ground station sends commands. The
//! emulator of [`sitl::link`] lies between them. For 40 s tiles and BEV frames share the link, then tiles have it for
//! themselves. Each case is run with 0, 100 and 200 ms of delay one way, and the worst of the three is reported:
//!
//! - `goodput_share`: bytes of tiles delivered without BEV frames beside them, as a share of `rate × (1 − loss)`,
//! - `shared_goodput`: the same of tiles and BEV frames together while they share the link,
//! - `bev_in_time`: share of BEV frames delivered within [`BEV_DEADLINE`],
//! - `bev_age_p99_ms`: how old 99 of 100 delivered BEV frames are at most, `bev_age_p50_ms` the median,
//! - `command_p99_ms`: from a command to its acknowledgement, less twice the delay one way; left out of the figures where more
//!   than one in a hundred is never answered, which `commands_answered` tells,
//! - `command_bound_ms`: the same of commands that are sent over and over on an empty link ([`bound`]): no way to send can beat it
//!   in the long run (it is taken over 400 s, so that a figure over 80 s may be less by chance),
//! - `catch_up_s`: after 30 s in which nothing passes, until the tiles that changed meanwhile are there (five seconds' worth of
//!   the link) and nothing waits,
//! - `bytes_per_tile`: of frames sent in both directions for each tile delivered without BEV frames beside it; telemetry and commands count, too.
//!
//! Side by side with it, `<rate>/<loss>/resend/<metric>` and `<rate>/<loss>/blind/<metric>` are what [`resend`], the way of
//! MAVLink FTP, and [`blind`], that of MAVLink's picture transmission, make of the same bytes on the same link.

mod blind;
mod bound;
mod resend;
mod tandem;
mod team;

use std::sync::mpsc;
use std::time::Duration;

use rayon::prelude::*;
use sitl::link::{Loss, Profile};

use super::{Figures, Outcome, Request, Table};
use blind::Blind;
use resend::Resend;
use tandem::Tandem;
use team::Run;

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
const METRICS: [(&str, bool); 10] = [
    ("goodput_share", false),
    ("shared_goodput", false),
    ("bev_in_time", false),
    ("bev_age_p50_ms", true),
    ("bev_age_p99_ms", true),
    ("command_p99_ms", true),
    ("command_bound_ms", true),
    ("commands_answered", false),
    ("catch_up_s", true),
    ("bytes_per_tile", true),
];

/// Ways to bring objects over, ours first; its figures have no name of their own.
const METHODS: [&str; 3] = ["tandem", "resend", "blind"];

/// One rate with one kind of loss.
struct Cell {
    name: String,
    cases: Vec<Case>,
}

/// Of each method, the figures for each delay.
type Rows = [Vec<[f64; METRICS.len()]>; METHODS.len()];

/// Runs every case.
pub(super) fn run(request: &mut Request<'_>) -> anyhow::Result<Outcome> {
    let cells = cells(request.seed.unwrap_or(SEED));
    let (done, results) = mpsc::sync_channel(cells.len());
    let measured: Vec<(&Cell, Rows)> = std::thread::scope(|scope| {
        let cells = &cells;
        scope.spawn(move || {
            cells.par_iter().enumerate().for_each(|(place, cell)| {
                let _nobody_waits = done.send((place, cell, measure(cell)));
            });
        });
        let mut measured: Vec<_> = results
            .iter()
            .inspect(|(_, cell, _)| (request.say)(&format!("{} done", cell.name)))
            .collect();
        measured.sort_by_key(|(place, ..)| *place);
        measured
            .into_iter()
            .map(|(_, cell, rows)| (cell, rows))
            .collect()
    });
    let mut figures = Figures::default();
    let header = ["", "", "delay"].into_iter().chain(METRICS.map(|m| m.0));
    let mut table = Table {
        title: "The object transport over bad links".to_owned(),
        header: header.map(str::to_owned).collect(),
        rows: Vec::new(),
    };
    for (cell, rows) in measured {
        for (method, rows) in METHODS.into_iter().zip(rows) {
            let named = rows.iter().zip(DELAYS_MS);
            (table.rows)
                .extend(named.map(|(row, delay)| table_row(&cell.name, method, delay, row)));
            for (place, (metric, more_is_worse)) in METRICS.into_iter().enumerate() {
                let of_metric = rows.iter().map(|row| row[place]);
                let worst = if more_is_worse {
                    of_metric.fold(f64::NEG_INFINITY, f64::max)
                } else {
                    of_metric.fold(f64::INFINITY, f64::min)
                };
                if worst.is_finite() {
                    let ours = [cell.name.as_str(), metric];
                    let theirs = [cell.name.as_str(), method, metric];
                    let keys: &[&str] = if method == METHODS[0] { &ours } else { &theirs };
                    figures.set(keys, worst)?;
                }
            }
        }
    }
    Ok(Outcome {
        figures,
        text: table.to_string(),
    })
}

fn cells(seed: u64) -> Vec<Cell> {
    let mut cells = Vec::new();
    for (rate_name, bits, bev_hz, bev_bytes) in RATES {
        for (loss_name, loss, bursty) in LOSSES {
            let losses = if bursty {
                Loss::Bursts {
                    share: loss,
                    length: BURST,
                }
            } else {
                Loss::Even(loss)
            };
            let case = |delay_ms| Case {
                profile: Profile {
                    loss: losses,
                    jitter: Duration::from_millis(2),
                    ..Profile::of_rate(bits, Duration::from_millis(delay_ms))
                },
                loss,
                bev_hz,
                bev_bytes,
                seed: seed + delay_ms,
            };
            cells.push(Cell {
                name: format!("{rate_name}/{loss_name}"),
                cases: DELAYS_MS.map(case).to_vec(),
            });
        }
    }
    cells
}

fn measure(cell: &Cell) -> Rows {
    let bounds = cell.cases.iter().map(bound::command_spans);
    let bounds: Vec<f64> = bounds.map(|spans| percentile(&spans, 0.99)).collect();
    let of = |run: fn(&Case) -> Run| -> Vec<_> {
        let bounded = cell.cases.iter().zip(&bounds);
        bounded
            .map(|(case, bound)| metrics(case, &run(case), *bound))
            .collect()
    };
    [
        of(|case| team::run(case, Tandem::new(case))),
        of(|case| team::run(case, Resend::new(case))),
        of(|case| team::run(case, Blind::new(case))),
    ]
}

fn table_row(name: &str, method: &str, delay_ms: u64, row: &[f64]) -> Vec<String> {
    let cells = row.iter().map(|value| format!("{value:.3}"));
    [name.to_owned(), method.to_owned(), format!("{delay_ms} ms")]
        .into_iter()
        .chain(cells)
        .collect()
}

/// The figures of one run, in the order of [`METRICS`]; `bound` is that of the latency of commands, in seconds.
fn metrics(case: &Case, run: &Run, bound: f64) -> [f64; METRICS.len()] {
    let room = case.rate() * (1.0 - case.loss) * team::SATURATED.as_secs_f64();
    let Run { shared, alone, .. } = run;
    let commands: Vec<Option<Duration>> = [&shared.commands[..], &alone.commands[..]].concat();
    let answered = commands.iter().flatten().count();
    let (bev_ages, bev_in_time) = shared.bev();
    let age = |share: f64| percentile(&bev_ages, share) * 1e3;
    [
        alone.tile_bytes as f64 / room,
        (shared.tile_bytes + shared.bev_bytes) as f64 / room,
        bev_in_time,
        age(0.5),
        age(0.99),
        percentile(&commands, 0.99) * 1e3 - 2e3 * case.profile.delay.as_secs_f64(),
        bound * 1e3,
        answered as f64 / commands.len() as f64,
        (run.catch_up).map_or(f64::INFINITY, |span| span.as_secs_f64()),
        alone.wire_bytes as f64 / alone.tiles as f64,
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
