//! A recording processed without links: what `companion replay` does.
//!
//! The same decoding, SLAM and mapping as in flight, as fast as they go, in the calling thread. What is left behind is that of a
//! flight, and beside it `frames.csv`, what each frame took and what came of it, and `report.html`, a page for people.

mod chart;
mod frames;
mod page;

use std::io::Write as _;
use std::path::Path;
use std::time::Duration;

use maps::time::Stamp;
use maps::trajectory::Trajectory;
use sensors::prefetch::Prefetch;
use sensors::{RgbdSource as _, SourceError};

use crate::clock::Clock;
use crate::config::Settings;
use crate::figures::Figures;
use crate::output::{self, OutputError};
use crate::pipeline::detecting::{DetectorError, Lookout};
use crate::pipeline::uav::Mapper;
use crate::pipeline::{self, Ending, Seen, SourceEnded};
use crate::report::Report;
use frames::{Row, Sample, Samples};
use page::Page;

/// Why a recording could not be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The recording cannot be read.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The detector cannot be used.
    #[error("the detector cannot be used: correct [detector]")]
    Detector(#[from] DetectorError),
    /// The system gives no thread to decode on.
    #[error("cannot start a thread")]
    Thread(#[from] std::io::Error),
    /// The results cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// How far a replay has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Frames processed.
    pub frames: u64,
    /// Of how many, if that is known.
    pub of: Option<usize>,
    /// Since the start.
    pub elapsed: Duration,
}

/// Whether a replay goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Continue {
    /// It does.
    Yes,
    /// It ends here; what there is, is written.
    No,
}

/// Processes the recording of the settings and writes `report.json`, `report.html`, `frames.csv`, `trajectory.txt`, `map.ot`
/// and `map.bt`. A recording that turns out damaged is an error, but what came before the damage is written first.
pub fn replay(
    settings: &Settings,
    clock: Clock,
    mut progress: impl FnMut(Progress) -> Continue,
) -> Result<Report, ReplayError> {
    let lookout = Lookout::open(settings.detector.as_ref())?;
    let source = pipeline::open_source(&settings.source)?;
    let ahead = pipeline::decoded_ahead(source.as_ref());
    let front_end = Mapper::front_end(source.camera(), &settings.mapping);
    let mut source = Prefetch::with(source, ahead, move |frame| front_end.look(frame))?;
    let mut figures = Figures::new(source.name(), source.frame_count(), &settings.mapping);
    let mut mapper = Mapper::new(source.camera(), &settings.mapping, lookout);
    let (mut rows, mut samples) = (Vec::new(), Samples::default());
    let (ending, damage) = loop {
        let (frame, seen) = match source.next_made() {
            Ok(Some(made)) => made,
            Ok(None) => break (Ending::Finished, None),
            Err(error) => break (Ending::Failed(pipeline::chain(&error)), Some(error)),
        };
        let taken = (&frame, seen, source.beside());
        let done = pipeline::process(&mut mapper, taken, clock);
        if samples.wants(figures.frames()) {
            samples.add(Sample::draw(&frame, &mapper.overlay()));
        }
        figures.add_frame(&done);
        rows.push(Row::new(frame.at, &done));
        let so_far = Progress {
            frames: figures.frames(),
            of: source.frame_count(),
            elapsed: clock.now().since(Stamp::ZERO),
        };
        if progress(so_far) == Continue::No {
            break (Ending::Stopped, None);
        }
    };
    mapper.finish();
    let kept = Kept {
        mapper: &mapper,
        rows: &rows,
        samples: &samples,
    };
    let report = kept.conclude(&source, figures, ending, (clock, &settings.out))?;
    damage.map_or(Ok(report), |error| Err(error.into()))
}

/// What has been kept of a replay that is over.
struct Kept<'a> {
    mapper: &'a Mapper,
    rows: &'a [Row],
    samples: &'a Samples,
}

impl Kept<'_> {
    fn conclude(
        &self,
        source: &Prefetch<Seen>,
        mut figures: Figures,
        ending: Ending,
        (clock, out): (Clock, &Path),
    ) -> Result<Report, OutputError> {
        let trajectory = self.mapper.trajectory();
        output::write_map(out, self.mapper.map(), &trajectory)?;
        output::write_atomically(&out.join("frames.csv"), |file| {
            frames::write_csv(self.rows, file)
        })?;
        figures.end(&SourceEnded {
            ending,
            ate: output::ate(source.truth(), &trajectory),
            map: self.mapper.figures(),
            floor: self.mapper.floor(),
            losses: source.live().map(|live| live.losses()),
            detector: self.mapper.detector(),
        });
        let report = figures.report(clock.now());
        report.write(out)?;
        // Frames come in order of time, and no pose that is not finite is told.
        if let Ok(estimate) = Trajectory::new(trajectory) {
            let truth = output::truth(source.truth());
            let page = Page {
                report: &report,
                estimate: &estimate,
                truth: truth.as_ref(),
                rows: self.rows,
                samples: self.samples.all(),
                map: self.mapper.map(),
            };
            let html = page.html();
            output::write_atomically(&out.join("report.html"), |file| {
                file.write_all(html.as_bytes())
            })?;
        }
        Ok(report)
    }
}
