//! How far a replay has come, for whoever watches.

use std::io::{self, IsTerminal as _, Write as _};
use std::time::Duration;

use companion::replay::Progress;

/// One line that is overwritten on a terminal, a line now and then elsewhere.
pub(crate) struct ProgressLine {
    terminal: bool,
    shown: Duration,
}

impl ProgressLine {
    pub(crate) fn new() -> Self {
        Self {
            terminal: io::stderr().is_terminal(),
            shown: Duration::ZERO,
        }
    }

    pub(crate) fn show(&mut self, progress: Progress) {
        let Progress {
            frames,
            of,
            elapsed,
        } = progress;
        let last = of.is_some_and(|of| frames == of as u64);
        let every = Duration::from_millis(if self.terminal { 200 } else { 5000 });
        if !last && elapsed < self.shown + every {
            return;
        }
        self.shown = elapsed;
        let of = of.map_or(String::new(), |of| format!(" of {of}"));
        let rate = frames as f64 / elapsed.as_secs_f64();
        let (start, end) = if self.terminal {
            ("\r", if last { "\n" } else { "" })
        } else {
            ("", "\n")
        };
        // Nothing depends on it: a closed terminal stops no replay.
        let _shown = write!(
            io::stderr(),
            "{start}{frames}{of} frames, {rate:.1} a second{end}"
        );
    }
}
