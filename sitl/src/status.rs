//! Where the vehicles are, for whoever watches the terminal.

use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::time::Duration;

use maps::time::Stamp;
use sitl::simulation::{COPTER, Simulation};

/// How often the line changes, in simulated time.
const EVERY: Duration = Duration::from_millis(500);

/// One line that is overwritten: each vehicle's mode and where it truly is.
#[derive(Default)]
pub(crate) struct StatusLine {
    due: Stamp,
}

impl StatusLine {
    pub(crate) fn show(&mut self, simulation: &Simulation) {
        let now = simulation.now();
        if now < self.due {
            return;
        }
        self.due = now + EVERY;
        let mut line = format!("{:7.1} s", now.as_secs_f64());
        for autopilot in simulation.vehicles() {
            let name = if autopilot.address() == COPTER {
                "copter"
            } else {
                "rover"
            };
            let armed = if autopilot.is_armed() { " armed" } else { "" };
            let [x, y, z]: [f64; 3] = autopilot.truth().position().raw.coords.into();
            let mode = autopilot.mode();
            // Writing to a string cannot fail.
            let _written = write!(
                line,
                "   {name} {mode}{armed} at ({x:.1}, {y:.1}, {z:.1}) m"
            );
        }
        // Nothing depends on it: a closed terminal stops no simulation. What was there before may have been longer.
        let _shown = write!(io::stderr(), "\r{line}\x1b[K");
    }
}
