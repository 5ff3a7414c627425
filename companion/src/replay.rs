//! A recording processed without links: what `companion replay` does.
//!
//! The same decoding, SLAM and mapping as in flight, as fast as they go, in the calling thread.

use std::path::Path;
use std::time::Duration;

use maps::time::Stamp;
use sensors::prefetch::Prefetch;
use sensors::{RgbdSource as _, SourceError};

use crate::clock::Clock;
use crate::config::Settings;
use crate::figures::Figures;
use crate::output::{self, OutputError};
use crate::pipeline::uav::Mapper;
use crate::pipeline::{self, Ending, Seen, SourceEnded};
use crate::report::Report;

/// Why a recording could not be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The recording cannot be read.
    #[error(transparent)]
    Source(#[from] SourceError),
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

/// Processes the recording of the settings and writes `report.json`, `trajectory.txt`, `map.ot` and `map.bt`. A
/// recording that turns out damaged is an error, but what came before the damage is written first.
pub fn replay(
    settings: &Settings,
    clock: Clock,
    mut progress: impl FnMut(Progress) -> Continue,
) -> Result<Report, ReplayError> {
    let source = pipeline::open_source(&settings.source)?;
    let ahead = pipeline::decoded_ahead(source.as_ref());
    let front_end = Mapper::front_end(source.camera(), &settings.mapping);
    let mut source = Prefetch::with(source, ahead, move |frame| front_end.look(frame))?;
    let mut figures = Figures::new(source.name(), source.frame_count(), &settings.mapping);
    let mut mapper = Mapper::new(source.camera(), &settings.mapping);
    let (ending, damage) = loop {
        let (frame, seen) = match source.next_made() {
            Ok(Some(made)) => made,
            Ok(None) => break (Ending::Finished, None),
            Err(error) => break (Ending::Failed(pipeline::chain(&error)), Some(error)),
        };
        figures.add_frame(&pipeline::process(
            &mut mapper,
            (&frame, seen, source.beside()),
            clock,
        ));
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
    let report = conclude(&mapper, &source, figures, ending, (clock, &settings.out))?;
    damage.map_or(Ok(report), |error| Err(error.into()))
}

fn conclude(
    mapper: &Mapper,
    source: &Prefetch<Seen>,
    mut figures: Figures,
    ending: Ending,
    (clock, out): (Clock, &Path),
) -> Result<Report, OutputError> {
    let trajectory = mapper.trajectory();
    output::write_map(out, mapper.map(), &trajectory)?;
    figures.end(&SourceEnded {
        ending,
        ate: output::ate(source.truth(), &trajectory),
        map: mapper.figures(),
        floor: mapper.floor(),
        losses: source.live().map(|live| live.losses()),
    });
    let report = figures.report(clock.now());
    report.write(out)?;
    Ok(report)
}
