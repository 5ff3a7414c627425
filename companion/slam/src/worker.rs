//! One thread for the work on the map, so that tracking need not wait for it.
//!
//! Whoever starts a job says when its result is due, by counting frames, not time: with and without the thread, and on
//! machines of any speed, the same frame is the first to see it. If the job is not done by then, tracking waits.

use std::io;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{Builder, JoinHandle};

type Job<T> = Box<dyn FnOnce() -> T + Send>;

/// Does one job at a time.
pub enum Worker<T> {
    /// In the caller's thread, at once; the result waits here.
    Here(Option<T>),
    /// In a thread of its own.
    Thread(Thread<T>),
}

/// A running thread. Dropping it waits for the job in hand.
pub struct Thread<T> {
    /// Dropped to end the thread.
    jobs: Option<SyncSender<Job<T>>>,
    results: Receiver<T>,
    busy: bool,
    handle: Option<JoinHandle<()>>,
}

impl<T: Send + 'static> Worker<T> {
    /// A thread of its own.
    pub fn thread(name: &str) -> io::Result<Self> {
        let (jobs, next) = sync_channel::<Job<T>>(1);
        let (send, results) = sync_channel(1);
        let handle = Builder::new().name(name.into()).spawn(move || {
            for job in next {
                if send.send(job()).is_err() {
                    return;
                }
            }
        })?;
        Ok(Self::Thread(Thread {
            jobs: Some(jobs),
            results,
            busy: false,
            handle: Some(handle),
        }))
    }

    /// Starts a job; the result of the one before must have been taken.
    pub fn start(&mut self, job: impl FnOnce() -> T + Send + 'static) {
        match self {
            Self::Here(result) => *result = Some(job()),
            Self::Thread(thread) => {
                let sent = thread.jobs.as_ref().map(|jobs| jobs.send(Box::new(job)));
                thread.busy = matches!(sent, Some(Ok(())));
            }
        }
    }

    /// The result of the job that was started, waited for; `None` if none was, or if it died.
    pub fn take(&mut self) -> Option<T> {
        match self {
            Self::Here(result) => result.take(),
            Self::Thread(thread) => {
                let busy = std::mem::take(&mut thread.busy);
                busy.then(|| thread.results.recv().ok()).flatten()
            }
        }
    }
}

impl<T> Drop for Thread<T> {
    fn drop(&mut self) {
        self.jobs = None;
        if let Some(handle) = self.handle.take() {
            // A panic there has been printed by the thread itself.
            let _outcome = handle.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_kinds_give_the_result_of_each_job_once() {
        let thread = Worker::thread("test").expect("a thread");
        for mut worker in [Worker::Here(None), thread] {
            assert_eq!(worker.take(), None, "nothing was asked");
            for i in 0..3 {
                worker.start(move || i * i);
                assert_eq!(worker.take(), Some(i * i));
                assert_eq!(worker.take(), None, "taken before");
            }
            worker.start(|| 7);
        }
    }

    #[test]
    fn a_job_that_dies_leaves_no_result_and_no_hang() {
        let mut worker = Worker::thread("test-dies").expect("a thread");
        worker.start(|| -> u8 { panic!("on purpose") });
        assert_eq!(worker.take(), None);
        worker.start(|| 1);
        assert_eq!(worker.take(), None, "there is nobody left to do it");
    }
}
