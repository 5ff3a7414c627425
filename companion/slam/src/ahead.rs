//! A thread that looks at the next frames while one is tracked.

use std::io;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::{Builder, JoinHandle};

use maps::camera::RgbdFrame;

use crate::front_end::{FrontEnd, Look};
use crate::tracked::FrameError;

/// A frame, and what was found in it.
pub type Looked = (RgbdFrame, Result<Look, FrameError>);

/// An iterator over frames in which features have been sought: what makes two processors worth more than one.
///
/// The order stays, nothing is left out, and whoever takes too long makes the thread wait: memory is bounded. Dropping it
/// ends the thread after the frame in hand.
pub struct Ahead<E> {
    /// Dropped to stop the thread.
    looked: Option<Receiver<Result<Looked, E>>>,
    thread: Option<JoinHandle<()>>,
}

impl<E: Send + 'static> Ahead<E> {
    /// Looks at up to `most` frames ahead. Errors of `frames` are passed on.
    pub fn new(
        frames: impl Iterator<Item = Result<RgbdFrame, E>> + Send + 'static,
        front_end: FrontEnd,
        most: usize,
    ) -> io::Result<Self> {
        let (send, looked) = sync_channel(most);
        let thread = Builder::new().name("slam-look".into()).spawn(move || {
            for frame in frames {
                let looked = frame.map(|frame| {
                    let look = front_end.look(&frame);
                    (frame, look)
                });
                if send.send(looked).is_err() {
                    return;
                }
            }
        })?;
        Ok(Self {
            looked: Some(looked),
            thread: Some(thread),
        })
    }
}

impl<E> Iterator for Ahead<E> {
    type Item = Result<Looked, E>;

    fn next(&mut self) -> Option<Self::Item> {
        self.looked.as_ref()?.recv().ok()
    }
}

impl<E> Drop for Ahead<E> {
    fn drop(&mut self) {
        self.looked = None;
        if let Some(thread) = self.thread.take() {
            // A panic there has been printed by the thread itself.
            let _outcome = thread.join();
        }
    }
}
