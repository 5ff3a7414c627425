//! What has gone through a link.

use std::sync::atomic::{AtomicU64, Ordering};

/// What has gone through a link since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkStats {
    /// Bytes of frames sent, to all peers together, without the headers of lower layers.
    pub bytes_sent: u64,
    /// Bytes received.
    pub bytes_received: u64,
    /// Frames sent, to all peers together.
    pub frames_sent: u64,
    /// Good frames received.
    pub frames_received: u64,
    /// Damaged, cut off or unsupported frames received.
    pub bad_frames: u64,
    /// Frames not sent since the peer does not take them as fast.
    pub frames_dropped: u64,
    /// Peers that frames for all are sent to.
    pub peers: usize,
}

#[derive(Default)]
pub(super) struct Counters {
    bytes_sent: AtomicU64,
    bytes_received: AtomicU64,
    frames_sent: AtomicU64,
    frames_received: AtomicU64,
    bad_frames: AtomicU64,
    frames_dropped: AtomicU64,
}

fn add(counter: &AtomicU64, count: u64) {
    counter.fetch_add(count, Ordering::Relaxed);
}

impl Counters {
    /// A frame of so many bytes was sent.
    pub(super) fn sent(&self, bytes: usize) {
        add(&self.frames_sent, 1);
        add(&self.bytes_sent, bytes as u64);
    }

    /// A frame was not sent.
    pub(super) fn dropped(&self) {
        add(&self.frames_dropped, 1);
    }

    /// So many bytes came.
    pub(super) fn received(&self, bytes: usize) {
        add(&self.bytes_received, bytes as u64);
    }

    /// A good frame came.
    pub(super) fn heard(&self) {
        add(&self.frames_received, 1);
    }

    /// So many bad frames came.
    pub(super) fn bad(&self, frames: u64) {
        add(&self.bad_frames, frames);
    }

    pub(super) fn stats(&self, peers: usize) -> LinkStats {
        let get = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        LinkStats {
            bytes_sent: get(&self.bytes_sent),
            bytes_received: get(&self.bytes_received),
            frames_sent: get(&self.frames_sent),
            frames_received: get(&self.frames_received),
            bad_frames: get(&self.bad_frames),
            frames_dropped: get(&self.frames_dropped),
            peers,
        }
    }
}
