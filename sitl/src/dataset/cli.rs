//! `sitl dataset`: its options, what it says, and how it is ended.

use std::fmt;
use std::io::{IsTerminal as _, Write as _};
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context as _, bail};
use maps::time::Stamp;

use super::{Layout, Local, Progress, Settings, Size, Split, check, run};
use crate::scene::Name;

/// How often the line on a terminal changes.
const LINE_EVERY: Duration = Duration::from_millis(500);
/// How often a line is added to a log.
const LOG_EVERY: Duration = Duration::from_secs(30);

/// Which seeds of a split.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Seeds {
    /// The first ones.
    First(u64),
    /// From one to before another.
    Range(std::ops::Range<u64>),
}

impl FromStr for Seeds {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str| {
            text.parse()
                .map_err(|_no_number| format!("{text:?} is not a number; give 20 or 100..120"))
        };
        match text.split_once("..") {
            None => Ok(Self::First(number(text)?)),
            Some((from, to)) => Ok(Self::Range(number(from)?..number(to)?)),
        }
    }
}

impl Seeds {
    fn of(&self, split: Split) -> std::ops::Range<u64> {
        match self {
            Self::First(count) => {
                let start = split.seeds().start;
                start..start.saturating_add(*count)
            }
            Self::Range(range) => range.clone(),
        }
    }
}

/// The options of `sitl dataset`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// What the data is for.
    #[arg(long, value_enum, required_unless_present = "check")]
    split: Option<Split>,
    /// The folder of the data set; the split gets a folder in it.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The scenes, with commas between them. Default: all streets.
    #[arg(long, value_enum, value_delimiter = ',', value_name = "NAMES")]
    scenes: Vec<Name>,
    /// How many seeds from the split's first, or A..B (without B).
    #[arg(long, value_name = "N|A..B", default_value = "10")]
    seeds: Seeds,
    /// Frames of each sequence.
    #[arg(long, value_name = "N", default_value_t = 40)]
    frames: u32,
    /// Frames a second. Default: 2, or 10 in the OPV2V layout.
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// Which files to write.
    #[arg(long, value_enum, default_value = "tandem")]
    layout: Layout,
    /// How many threads work. Default: as many as there are processors.
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Only reads what is there, and compares it with what was written.
    #[arg(long)]
    check: bool,
}

/// Makes or checks a data set. `clock` tells how long the program runs.
pub fn execute(args: &Args, clock: impl Fn() -> Stamp) -> anyhow::Result<()> {
    if args.check {
        return execute_check(args);
    }
    let split = args.split.context("which --split?")?;
    let settings = settings(args, split);
    let stop = Arc::new(AtomicBool::new(false));
    let asked = Arc::clone(&stop);
    ctrlc::set_handler(move || asked.store(true, Ordering::Relaxed))
        .context("cannot listen for ctrl-c")?;
    let mut line = Line::new(clock());
    let outcome = run(&settings, &Local, &stop, |progress| {
        line.show(progress, clock());
    });
    line.end();
    let outcome = outcome?;
    let written = Size(outcome.bytes);
    if outcome.missing > 0 {
        let (made, missing) = (outcome.made, outcome.missing);
        bail!(
            "stopped: {made} sequences made now, {missing} are missing; the same command goes on"
        );
    }
    let (made, kept) = (outcome.made, outcome.kept);
    say(&format!(
        "{made} sequences made, {written}; {kept} were there already\n"
    ));
    Ok(())
}

fn settings(args: &Args, split: Split) -> Settings {
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    Settings {
        split,
        layout: args.layout,
        out: args.out.clone(),
        scenes: if args.scenes.is_empty() {
            Name::STREETS.to_vec()
        } else {
            args.scenes.clone()
        },
        seeds: args.seeds.of(split),
        frames: args.frames,
        rate_hz: args.rate.unwrap_or(args.layout.usual_hz()),
        threads: args.threads.unwrap_or_else(cores),
    }
}

fn execute_check(args: &Args) -> anyhow::Result<()> {
    let mut found = false;
    for name in ["train", "val", "validate", "test"] {
        let folder = args.out.join(name);
        let is_asked = args.split.is_none_or(|split| {
            [Layout::Tandem, Layout::Opv2v]
                .iter()
                .any(|layout| layout.folder(split) == name)
        });
        if is_asked && folder.join("dataset.json").is_file() {
            let checked = check(&folder)?;
            let (sequences, bytes) = (checked.sequences, Size(checked.bytes));
            say(&format!(
                "{}: {sequences} sequences, {bytes}: as written\n",
                folder.display()
            ));
            found = true;
        }
    }
    if !found {
        bail!("there is no data set in {}", args.out.display());
    }
    Ok(())
}

/// What the user is told on the way: one line that changes, or a line now and then in a log.
struct Line {
    start: Stamp,
    due: Option<Stamp>,
    is_terminal: bool,
}

impl Line {
    fn new(start: Stamp) -> Self {
        let is_terminal = std::io::stderr().is_terminal();
        Self {
            start,
            due: None,
            is_terminal,
        }
    }

    fn show(&mut self, progress: &Progress, now: Stamp) {
        let Some(due) = self.due else {
            // What takes time before the first frame is not counted.
            self.start = now;
            self.due = Some(
                now + if self.is_terminal {
                    LINE_EVERY
                } else {
                    LOG_EVERY
                },
            );
            say(&format!("{}\n", Announcement(progress)));
            return;
        };
        let is_last = progress.sequences == progress.all_sequences;
        if now < due && !is_last {
            return;
        }
        self.due = Some(
            now + if self.is_terminal {
                LINE_EVERY
            } else {
                LOG_EVERY
            },
        );
        let text = status(progress, now.since(self.start));
        say(&if self.is_terminal {
            format!("\r{text}\x1b[K")
        } else {
            format!("{text}\n")
        });
    }

    fn end(&self) {
        if self.is_terminal && self.due.is_some() {
            say("\n");
        }
    }
}

/// Nothing depends on it: a closed terminal stops no work.
fn say(text: &str) {
    let _said = write!(std::io::stderr(), "{text}");
}

/// What is told before it starts.
struct Announcement<'a>(&'a Progress);

impl fmt::Display for Announcement<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Progress {
            all_frames,
            all_bytes,
            sequences,
            all_sequences,
            room,
            ..
        } = self.0;
        let missing = all_sequences - sequences;
        let (needed, free) = (Size(*all_bytes), Size(*room));
        write!(
            f,
            "{missing} of {all_sequences} sequences to make, {all_frames} frames, about {needed} ({free} free)"
        )
    }
}

fn status(progress: &Progress, elapsed: Duration) -> String {
    let Progress {
        frames,
        all_frames,
        sequences,
        all_sequences,
        ..
    } = progress;
    let rate = *frames as f64 / elapsed.as_secs_f64().max(1e-3);
    let left_s = (all_frames - frames) as f64 / rate.max(1e-9);
    let share = 100 * frames / (*all_frames).max(1);
    let left = left_s as u64;
    let (hours, minutes, seconds) = (left / 3600, left / 60 % 60, left % 60);
    format!(
        "{share:3} %  {frames} of {all_frames} frames, {sequences} of {all_sequences} sequences, {}, \
         {rate:.1} frames/s, {hours}:{minutes:02}:{seconds:02} left",
        Size(progress.bytes)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_are_a_number_from_the_first_of_the_split_or_a_range() {
        let of = |text: &str, split| text.parse::<Seeds>().map(|seeds| seeds.of(split));
        assert_eq!(of("3", Split::Val), Ok(1000..1003));
        assert_eq!(of("1100..1102", Split::Test), Ok(1100..1102));
        let error = of("many", Split::Train).expect_err("no number");
        assert!(
            error.contains("many") && error.contains("100..120"),
            "{error}"
        );
    }

    #[test]
    fn the_line_tells_rate_and_time_left() {
        let progress = Progress {
            frames: 30,
            all_frames: 120,
            bytes: 90_000_000,
            sequences: 3,
            all_sequences: 12,
            ..Progress::default()
        };
        assert_eq!(
            status(&progress, Duration::from_mins(1)),
            " 25 %  30 of 120 frames, 3 of 12 sequences, 90 MB, 0.5 frames/s, 0:03:00 left"
        );
    }

    #[test]
    fn nothing_to_do_has_a_line_too() {
        let text = status(&Progress::default(), Duration::ZERO);
        assert!(text.contains("0 of 0 frames"), "{text}");
    }
}
