//! Any source, decoded ahead on a thread of its own.
//!
//! Decoding a JPEG and a PNG takes a good part of a frame's time. A thread named `sensor-decode` does it while the
//! previous frame is tracked; a bounded channel holds it to a few frames ahead: it waits when the channel is full, so
//! that no frame of a recording is lost. A live source loses its oldest messages while it waits, and counts them.

use std::io;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::{Builder, JoinHandle};

use maps::camera::{Pinhole, RgbdFrame};

use crate::beside::Beside;
use crate::live::Live;
use crate::{RgbdSource, SourceError, TruthPose};

/// A frame with what was measured beside it and what was made of it.
type Decoded<T> = Result<(RgbdFrame, Beside, T), SourceError>;

/// A source whose frames are decoded ahead, with what else is made of each there.
pub struct Prefetch<T = ()> {
    name: String,
    camera: Pinhole,
    frame_count: Option<usize>,
    truth: Vec<TruthPose>,
    /// `None` once it has ended.
    frames: Option<Receiver<Decoded<T>>>,
    /// Beside the frame that was given last.
    beside: Beside,
    live: Option<Live>,
    /// Gives the source back.
    thread: Option<JoinHandle<Box<dyn RgbdSource>>>,
}

impl Prefetch {
    /// Starts decoding up to `ahead` frames (at least one) of `source`. Fails if the system gives no thread.
    pub fn new(source: Box<dyn RgbdSource>, ahead: usize) -> io::Result<Self> {
        Self::with(source, ahead, |_frame| ())
    }
}

impl<T: Send + 'static> Prefetch<T> {
    /// The same, with what `make` makes of each frame, in the same thread.
    pub fn with(
        mut source: Box<dyn RgbdSource>,
        ahead: usize,
        mut make: impl FnMut(&RgbdFrame) -> T + Send + 'static,
    ) -> io::Result<Self> {
        let (sender, frames) = sync_channel(ahead.max(1));
        let (name, camera) = (source.name().to_owned(), source.camera());
        let (frame_count, truth) = (source.frame_count(), source.truth().to_vec());
        let live = source.live();
        let thread = Builder::new().name("sensor-decode".into()).spawn(move || {
            // Ends with the source, at its first error, or when nobody waits for frames any more.
            while let Some(frame) = source.next_frame().transpose() {
                let failed = frame.is_err();
                let frame = frame.map(|frame| {
                    let made = make(&frame);
                    (frame, source.beside(), made)
                });
                if sender.send(frame).is_err() || failed {
                    break;
                }
            }
            source
        })?;
        Ok(Self {
            name,
            camera,
            frame_count,
            truth,
            frames: Some(frames),
            beside: Beside::default(),
            live,
            thread: Some(thread),
        })
    }

    /// The next frame and what was made of it; `None` after the last one.
    pub fn next_made(&mut self) -> Result<Option<(RgbdFrame, T)>, SourceError> {
        let next = self.frames.as_ref().and_then(|frames| frames.recv().ok());
        let Some((frame, beside, made)) = next.transpose()? else {
            return Ok(None);
        };
        self.beside = beside;
        Ok(Some((frame, made)))
    }
}

impl<T> Prefetch<T> {
    /// Ends the source, if it has not ended, and takes over what it has learnt of the truth while it was live.
    pub fn finish(&mut self) {
        // Without a receiver the thread's next `send` fails and it ends.
        self.frames = None;
        if let Some(live) = &self.live {
            live.stop();
        }
        // A panic there has been printed by the thread itself.
        if let Some(Ok(source)) = self.thread.take().map(JoinHandle::join) {
            self.truth = source.truth().to_vec();
        }
    }
}

impl<T: Send + 'static> RgbdSource for Prefetch<T> {
    fn name(&self) -> &str {
        &self.name
    }

    fn camera(&self) -> Pinhole {
        self.camera
    }

    fn frame_count(&self) -> Option<usize> {
        self.frame_count
    }

    fn truth(&self) -> &[TruthPose] {
        &self.truth
    }

    fn next_frame(&mut self) -> Result<Option<RgbdFrame>, SourceError> {
        Ok(self.next_made()?.map(|(frame, _made)| frame))
    }

    fn beside(&self) -> Beside {
        self.beside
    }

    fn live(&self) -> Option<Live> {
        self.live.clone()
    }
}

impl<T> Drop for Prefetch<T> {
    fn drop(&mut self) {
        self.finish();
    }
}

#[cfg(test)]
mod tests {
    use maps::time::Stamp;

    use super::*;

    /// Frames numbered by their stamps, then an error if `fails`.
    struct Counter {
        next: u64,
        count: u64,
        fails: bool,
    }

    impl RgbdSource for Counter {
        fn name(&self) -> &'static str {
            "counter"
        }

        fn camera(&self) -> Pinhole {
            Pinhole {
                width: 1,
                height: 1,
                fx: 1.0,
                fy: 1.0,
                cx: 0.0,
                cy: 0.0,
                distortion: [0.0; 5],
            }
        }

        fn frame_count(&self) -> Option<usize> {
            usize::try_from(self.count).ok()
        }

        fn truth(&self) -> &[TruthPose] {
            &[]
        }

        fn next_frame(&mut self) -> Result<Option<RgbdFrame>, SourceError> {
            if self.next == self.count {
                let reason = "broken".into();
                let path = "counter".into();
                let error = SourceError::Camera { path, reason };
                return if self.fails { Err(error) } else { Ok(None) };
            }
            self.next += 1;
            Ok(Some(RgbdFrame {
                at: Stamp::from_nanos(self.next),
                width: 1,
                height: 1,
                rgb: vec![[0; 3]],
                depth_m: vec![1.0],
            }))
        }
    }

    #[test]
    fn every_frame_arrives_once_and_in_order() {
        let counter = Counter {
            next: 0,
            count: 20,
            fails: false,
        };
        let mut source = Prefetch::new(Box::new(counter), 3).expect("a thread");
        for expected in 1..=20 {
            let frame = source.next_frame().expect("no error").expect("a frame");
            assert_eq!(frame.at, Stamp::from_nanos(expected));
        }
        assert_eq!(source.next_frame().expect("no error"), None);
        assert_eq!(source.next_frame().expect("still none"), None);
    }

    #[test]
    fn an_error_arrives_after_the_frames_before_it_and_ends_the_source() {
        let counter = Counter {
            next: 0,
            count: 2,
            fails: true,
        };
        let mut source = Prefetch::new(Box::new(counter), 1).expect("a thread");
        assert!(source.next_frame().expect("first").is_some());
        assert!(source.next_frame().expect("second").is_some());
        assert!(source.next_frame().is_err());
        assert_eq!(source.next_frame().expect("ended"), None);
    }

    #[test]
    fn a_source_dropped_early_ends_its_thread() {
        let counter = Counter {
            next: 0,
            count: u64::MAX,
            fails: false,
        };
        let mut source = Prefetch::new(Box::new(counter), 2).expect("a thread");
        assert!(source.next_frame().expect("first").is_some());
        // Hangs if the thread does not end.
        drop(source);
    }
}
