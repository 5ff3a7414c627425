//! What comes while it is measured: queues that keep the newest, and a handle by which others end the wait for more.
//!
//! A recording waits for its reader; a camera does not. What arrives is put into one bounded queue for each topic. A
//! full queue loses its oldest message and counts it, so that a slow reader works on what is new and says what it missed.
//! Here alone is state shared behind a lock: a channel can lose what is newest, or block, but not what is oldest.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use maps::time::Stamp;
use serde::Serialize;

/// A message as it came.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Received {
    /// When its publisher made it, on the publisher's clock.
    pub at: Stamp,
    /// The how manyth of its publisher.
    pub sequence: i64,
    /// CDR with its encapsulation header.
    pub bytes: Vec<u8>,
}

/// What was received and not used, in messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Losses {
    /// Pushed out by newer ones, as the reader was slow.
    pub overflowed: u64,
    /// Not what their type says, or without what `rmw_zenoh` sends beside each.
    pub damaged: u64,
    /// Images without a partner.
    pub unpaired: u64,
    /// Images older than the last frame, or of the same time.
    pub late: u64,
}

impl Losses {
    /// All together.
    pub fn total(&self) -> u64 {
        let Self {
            overflowed,
            damaged,
            unpaired,
            late,
        } = self;
        overflowed + damaged + unpaired + late
    }
}

/// A handle on a source whose frames come at their own time. Copies are handles on the same source.
#[derive(Clone, Debug)]
pub struct Live(pub(crate) Arc<Inbox>);

impl Live {
    /// Ends the source: a wait for the next frame ends at once, and there are no more.
    pub fn stop(&self) {
        self.0.stop();
    }

    /// What it has lost so far.
    pub fn losses(&self) -> Losses {
        self.0.lock().losses
    }
}

/// Queues, one for each topic, with one place to wait at.
#[derive(Debug)]
pub(crate) struct Inbox {
    queues: Mutex<Queues>,
    changed: Condvar,
    /// How many bytes each queue holds; a single message may have more.
    most_bytes: usize,
}

#[derive(Debug)]
struct Queues {
    each: Vec<Queue>,
    arrivals: u64,
    stopped: bool,
    losses: Losses,
}

#[derive(Debug, Default)]
struct Queue {
    /// How many messages it holds.
    depth: usize,
    /// With their numbers in order of arrival.
    messages: VecDeque<(u64, Received)>,
    bytes: usize,
}

/// What waiting for a message came to.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Taken {
    /// The oldest message, and the number of its queue.
    Message(usize, Received),
    /// Nothing came in time.
    Nothing,
    /// There will be no more.
    Stopped,
}

impl Inbox {
    /// A queue for each number of messages that it shall hold.
    pub(crate) fn new(depths: &[usize], most_bytes: usize) -> Self {
        let queue = |&depth: &usize| Queue {
            depth: depth.max(1),
            ..Queue::default()
        };
        let queues = Queues {
            each: depths.iter().map(queue).collect(),
            arrivals: 0,
            stopped: false,
            losses: Losses::default(),
        };
        Self {
            queues: Mutex::new(queues),
            changed: Condvar::new(),
            most_bytes,
        }
    }

    /// Puts a message into a queue; never waits.
    pub(crate) fn put(&self, queue: usize, message: Received) {
        let mut all = self.lock();
        let number = all.arrivals;
        all.arrivals += 1;
        let Queues { each, losses, .. } = &mut *all;
        let Some(queue) = each.get_mut(queue) else {
            return;
        };
        queue.bytes += message.bytes.len();
        queue.messages.push_back((number, message));
        while queue.messages.len() > queue.depth
            || (queue.bytes > self.most_bytes && queue.messages.len() > 1)
        {
            if queue.pop().is_some() {
                losses.overflowed += 1;
            }
        }
        drop(all);
        self.changed.notify_all();
    }

    /// The oldest message of those queues that `wants`, waiting up to `patience` for one.
    pub(crate) fn take(&self, wants: impl Fn(usize) -> bool, patience: Duration) -> Taken {
        let is_idle = |all: &mut Queues| !all.stopped && all.oldest(&wants).is_none();
        let waited = self
            .changed
            .wait_timeout_while(self.lock(), patience, is_idle);
        let (mut all, _timeout) = waited.unwrap_or_else(PoisonError::into_inner);
        if all.stopped {
            return Taken::Stopped;
        }
        let oldest = all.oldest(&wants);
        let message = oldest.and_then(|index| Some((index, all.each[index].pop()?)));
        message.map_or(Taken::Nothing, |(index, message)| {
            Taken::Message(index, message)
        })
    }

    pub(crate) fn stop(&self) {
        self.lock().stopped = true;
        self.changed.notify_all();
    }

    /// Notes losses.
    pub(crate) fn lose(&self, note: impl FnOnce(&mut Losses)) {
        note(&mut self.lock().losses);
    }

    /// What has been lost so far.
    pub(crate) fn losses(&self) -> Losses {
        self.lock().losses
    }

    fn lock(&self) -> MutexGuard<'_, Queues> {
        // Nothing panics while it holds the lock; if it did, the queues would still be queues.
        self.queues.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Queues {
    /// Which queue has the oldest message of those that are wanted.
    fn oldest(&self, wants: &impl Fn(usize) -> bool) -> Option<usize> {
        let wanted = (0..self.each.len()).filter(|&index| wants(index));
        let first = |index: usize| Some((self.each[index].messages.front()?.0, index));
        wanted.filter_map(first).min().map(|(_, index)| index)
    }
}

impl Queue {
    fn pop(&mut self) -> Option<Received> {
        let (_, message) = self.messages.pop_front()?;
        self.bytes -= message.bytes.len();
        Some(message)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(sequence: i64, length: usize) -> Received {
        Received {
            at: Stamp::ZERO,
            sequence,
            bytes: vec![0; length],
        }
    }

    /// Queue and number of each message that is taken without waiting.
    fn taken(inbox: &Inbox) -> Vec<(usize, i64)> {
        let next = || match inbox.take(|_| true, Duration::ZERO) {
            Taken::Message(queue, message) => Some((queue, message.sequence)),
            Taken::Nothing | Taken::Stopped => None,
        };
        std::iter::from_fn(next).collect()
    }

    #[test]
    fn messages_of_all_queues_come_in_the_order_of_their_arrival() {
        let inbox = Inbox::new(&[3, 3], 100);
        for (queue, sequence) in [(1, 1), (0, 2), (0, 3), (1, 4)] {
            inbox.put(queue, message(sequence, 1));
        }
        assert_eq!(taken(&inbox), [(1, 1), (0, 2), (0, 3), (1, 4)]);
        assert_eq!(inbox.losses(), Losses::default());
    }

    #[test]
    fn a_full_queue_loses_its_oldest_and_counts_it_and_others_lose_nothing() {
        let inbox = Inbox::new(&[2, 2], 100);
        inbox.put(0, message(1, 1));
        for sequence in 2..=5 {
            inbox.put(1, message(sequence, 1));
        }
        assert_eq!(inbox.losses().overflowed, 2);
        assert_eq!(taken(&inbox), [(0, 1), (1, 4), (1, 5)]);
    }

    #[test]
    fn a_queue_holds_no_more_bytes_than_it_may_but_always_one_message() {
        let inbox = Inbox::new(&[10], 100);
        inbox.put(0, message(1, 60));
        inbox.put(0, message(2, 60));
        assert_eq!(taken(&inbox), [(0, 2)]);
        inbox.put(0, message(3, 500));
        assert_eq!(taken(&inbox), [(0, 3)]);
        assert_eq!(inbox.losses().overflowed, 1);
    }

    #[test]
    fn only_wanted_queues_are_taken_from() {
        let inbox = Inbox::new(&[2, 2], 100);
        inbox.put(0, message(1, 1));
        assert_eq!(
            inbox.take(|queue| queue == 1, Duration::ZERO),
            Taken::Nothing
        );
        assert_eq!(taken(&inbox), [(0, 1)]);
    }

    #[test]
    fn a_wait_ends_when_the_source_is_stopped_from_another_thread() {
        let inbox = Arc::new(Inbox::new(&[2], 100));
        let live = Live(Arc::clone(&inbox));
        let waiting = std::thread::Builder::new()
            .name("waiting".into())
            .spawn(move || inbox.take(|_| true, Duration::from_mins(1)))
            .expect("a thread");
        live.stop();
        assert_eq!(waiting.join().expect("it ends"), Taken::Stopped);
    }
}
