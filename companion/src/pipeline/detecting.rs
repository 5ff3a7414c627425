//! A detector of people and vehicles in the thread `detector`, which looks at every Nth frame while others are tracked.
//!
//! Its answer is due with the next frame that it looks at, N frames later: by the count of frames, not by time, so that a
//! replay gives the same map on any machine. If it is not done by then, tracking waits.

use std::sync::Arc;

use maps::camera::RgbdFrame;
use maps::time::Stamp;
use perception::{DetectError, Detector, FastestDet, Image, OpenError, WrongLength, Yolox};
use serde::Serialize;
use slam::{Object, Worker};

use crate::config::{DetectorKind, DetectorSettings};

/// The other processors are for tracking.
const THREADS: usize = 1;

/// Why a detector cannot be used, or could not look at a frame.
#[derive(Debug, thiserror::Error)]
pub enum DetectorError {
    /// Its weights are none.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// It cannot look: its weights are of another kind.
    #[error(transparent)]
    Look(#[from] DetectError),
    /// The frame is damaged.
    #[error(transparent)]
    Image(#[from] WrongLength),
}

/// What a detector has done so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct DetectorFigures {
    /// Frames in which it has looked.
    pub frames: u64,
    /// What it has found in them, whether it can move or not.
    pub objects: u64,
    /// Frames in which it could not look.
    pub failed: u64,
    /// Answers of no use, since their frames could not be tracked or were too long ago.
    pub unheard: u64,
}

/// A detector for any thread.
pub type SharedDetector = Arc<dyn Detector + Send + Sync>;

/// Opens the detector of the configuration, and has it look once: at nothing, to see whether its weights are of its kind.
pub fn open(settings: &DetectorSettings) -> Result<SharedDetector, DetectorError> {
    let (weights, least_score) = (settings.weights.as_path(), settings.least_score);
    let detector: SharedDetector = match settings.kind {
        DetectorKind::Yolox => Arc::new(Yolox::open(weights, least_score, THREADS)?),
        DetectorKind::FastestDet => Arc::new(FastestDet::open(weights, least_score, THREADS)?),
    };
    detector.detect(&Image::new(1, 1, &[[0; 3]])?)?;
    Ok(detector)
}

/// What was seen in the frame taken at that time.
pub(super) struct Answer {
    pub(super) of: Stamp,
    pub(super) objects: Vec<Object>,
}

type Outcome = Result<Answer, DetectorError>;

/// Has a detector look at every Nth frame.
pub struct Lookout {
    detector: SharedDetector,
    every_frames: usize,
    worker: Worker<Outcome>,
    /// Frames until the next look.
    to_go: usize,
    figures: DetectorFigures,
}

impl Lookout {
    /// In a thread; where the system gives none, in the caller's, with the same result.
    pub fn new(detector: SharedDetector, every_frames: usize) -> Self {
        let worker = Worker::thread("detector").unwrap_or(Worker::Here(None));
        Self::with(worker, detector, every_frames)
    }

    fn with(worker: Worker<Outcome>, detector: SharedDetector, every_frames: usize) -> Self {
        Self {
            detector,
            every_frames: every_frames.max(1),
            worker,
            to_go: 0,
            figures: DetectorFigures::default(),
        }
    }

    /// The detector of the configuration, if there is one.
    pub fn open(settings: Option<&DetectorSettings>) -> Result<Option<Self>, DetectorError> {
        let lookout = |s: &DetectorSettings| Ok(Self::new(open(s)?, s.every_frames));
        settings.map(lookout).transpose()
    }

    /// To be called with each frame, in order: the answer that is due with it.
    pub(super) fn pass(&mut self, frame: &RgbdFrame) -> Option<Answer> {
        if self.to_go > 0 {
            self.to_go -= 1;
            return None;
        }
        self.to_go = self.every_frames - 1;
        let due = self.worker.take();
        let detector = Arc::clone(&self.detector);
        let (of, size, rgb) = (frame.at, [frame.width, frame.height], frame.rgb.clone());
        self.worker.start(move || {
            let objects = look(detector.as_ref(), size, &rgb)?;
            Ok(Answer { of, objects })
        });
        due.and_then(|outcome| self.count(outcome))
    }

    fn count(&mut self, outcome: Outcome) -> Option<Answer> {
        match outcome {
            Ok(answer) => {
                self.figures.frames += 1;
                self.figures.objects += answer.objects.len() as u64;
                Some(answer)
            }
            Err(error) => {
                if self.figures.failed == 0 {
                    tracing::warn!(%error, "the detector could not look at a frame; later ones are counted alone");
                }
                self.figures.failed += 1;
                None
            }
        }
    }

    /// So far, apart from what the SLAM has not heard.
    pub(super) fn figures(&self) -> DetectorFigures {
        self.figures
    }
}

fn look(
    detector: &dyn Detector,
    [width, height]: [usize; 2],
    rgb: &[[u8; 3]],
) -> Result<Vec<Object>, DetectorError> {
    let found = detector.detect(&Image::new(width, height, rgb)?)?;
    let object = |found: perception::Detection| Object {
        mobility: found.class.mobility().into(),
        score: found.score,
        bounds_px: found.bounds_px,
        mask: None,
    };
    Ok(found.into_iter().map(object).collect())
}

#[cfg(test)]
mod tests {
    use perception::{Class, Detection};
    use slam::Mobility;

    use super::*;

    /// Sees one person, as far left as the first pixel is red; nobody where it is blue, and cannot look where it is green.
    struct Fake;

    impl Detector for Fake {
        fn detect(&self, image: &Image<'_>) -> Result<Vec<Detection>, DetectError> {
            let [red, green, blue] = image.rgb()[0];
            if green > 0 {
                return Err(DetectError::Run("green".into()));
            }
            let class = Class::named("person").expect("COCO knows people");
            let left = f32::from(red);
            let person = Detection {
                class,
                score: 0.9,
                bounds_px: [left, 0.0, left + 1.0, 2.0],
            };
            Ok(if blue > 0 { vec![] } else { vec![person] })
        }
    }

    fn frame(number: u8, pixel: [u8; 3]) -> RgbdFrame {
        RgbdFrame {
            at: Stamp::from_nanos(number.into()),
            width: 2,
            height: 1,
            rgb: vec![pixel; 2],
            depth_m: vec![1.0; 2],
        }
    }

    #[test]
    fn an_answer_is_due_with_the_next_look_with_a_thread_and_without() {
        for every in [1, 3_u8] {
            let [with, without] = [true, false].map(|threaded| {
                let worker = threaded.then(|| Worker::thread("detector").expect("a thread"));
                let worker = worker.unwrap_or(Worker::Here(None));
                let mut lookout = Lookout::with(worker, Arc::new(Fake), every.into());
                let answers = (0..10).map(|i| {
                    let answer = lookout.pass(&frame(i, [i, 0, 0]))?;
                    assert_eq!(answer.objects[0].mobility, Mobility::Dynamic);
                    Some((i, answer.of, answer.objects[0].bounds_px[0] as u8))
                });
                answers.flatten().collect::<Vec<_>>()
            });
            assert_eq!(with, without);
            let due = (every..10).step_by(every.into());
            let expected = due.map(|i| (i, Stamp::from_nanos((i - every).into()), i - every));
            assert_eq!(with, expected.collect::<Vec<_>>());
        }
    }

    #[test]
    fn a_look_that_fails_is_counted_and_the_next_one_is_as_good_as_ever() {
        let mut lookout = Lookout::new(Arc::new(Fake), 1);
        let mut damaged = frame(2, [5, 0, 0]);
        damaged.rgb.pop();
        let frames = [
            frame(0, [0, 9, 0]),
            frame(1, [0, 0, 9]),
            damaged,
            frame(3, [1, 0, 0]),
            frame(4, [1, 0, 0]),
        ];
        let counts = frames.map(|f| lookout.pass(&f).map(|answer| answer.objects.len()));
        assert_eq!(counts, [None, None, Some(0), None, Some(1)]);
        let expected = DetectorFigures {
            frames: 2,
            objects: 1,
            failed: 2,
            unheard: 0,
        };
        assert_eq!(lookout.figures(), expected);
    }
}
