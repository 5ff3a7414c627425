//! Commands over a link that loses: sent several times, heard once.
//!
//! A command that is lost costs its sender a timeout of more than a second. It is small, so that on a link that loses a
//! share of the frames it goes so often within a few dozen milliseconds that all are lost once in a thousand times; so does its
//! acknowledgement. Bursts of losses may be longer: an unanswered command goes on with pauses that grow, and each copy that comes
//! is acknowledged once more. The copies are the same frame, but for a signature, and the other end drops all but the first: it must be
//! one of Tandem's programs. Nothing that MAVLink says of commands changes, nor who counts `confirmation`.
//!
//! - [`Reception`] tells the loss of one direction from the sequence numbers of what comes. Radios lose much the same both ways.
//! - [`Repeater`] sends copies, [`Duplicates`] drops them; also those of a frame that came over two links.

use std::collections::{BTreeMap, HashSet, VecDeque};
use std::hash::{BuildHasher as _, BuildHasherDefault, DefaultHasher};
use std::time::Duration;

use maps::time::Stamp;

use crate::wire::{Address, RawFrame};

/// Copies are sent until all are lost with this probability at most.
const ALL_LOST: f64 = 0.001;
/// No frame is sent more often at once, however bad the link is.
const MAX_TIMES: u32 = 8;
/// Where losses come in bursts, copies go for so long in any case: most bursts do not last longer.
const OUTLASTED: Duration = Duration::from_millis(45);
/// More frames than this lost one after the other, on average, are bursts: at a loss of a half, two are chance.
const BURST: f64 = 2.5;
/// Less loss than this is none.
const LEAST_LOSS: f64 = 0.005;
/// Time from one copy to the next at least.
const SPACING: Duration = Duration::from_millis(2);
/// Where losses come in bursts, each copy goes so many times as long after the first as the one before: no burst delays a command by much
/// more than its own length.
const LATER_IN_BURSTS: f64 = 1.2;
/// Elsewhere, further copies of a command that is not acknowledged go from this time on, and so much later each.
const LATE: Duration = Duration::from_millis(60);
const LATER: f64 = 1.5;
/// Then a command is repeated as MAVLink says.
const LATEST: Duration = Duration::from_secs(1);
/// Acknowledgements kept for copies of their commands.
const MAX_ANSWERS: usize = 32;
/// Copies that wait at most: far more than an operator's commands make.
const MAX_WAITING: usize = 256;
/// A copy of a command, and of what else an answer is waited for, is recognised within this time.
const REMEMBERED: Duration = Duration::from_secs(3);
/// A copy of another frame. Shorter than the time between two heartbeats: some senders do not count their frames.
const REMEMBERED_BRIEFLY: Duration = Duration::from_millis(500);
/// Frames remembered at most, of each kind.
const MAX_REMEMBERED: usize = 1 << 14;
/// Half of the weight of what was received is gone after so many frames: soon, so that a link that gets worse is noticed, and
/// late, since hundreds of frames may come between two bursts. The worse of both counts.
const MEMORY_FRAMES: [f64; 2] = [200.0, 2000.0];
/// Fewer frames than this say nothing about loss.
const MIN_FRAMES: f64 = 20.0;
/// Senders whose sequence is followed.
const MAX_SENDERS: usize = 64;

/// Whether an answer is waited for: commands, missions and parameters, and what answers them.
fn is_awaited(frame: &RawFrame) -> bool {
    matches!(
        frame.message_id(),
        // SET_MODE; parameters; missions; commands
        11 | 20..=23 | 39..=47 | 51 | 73 | 75..=77 | 80
    )
}

/// Sends copies of what an answer is waited for.
#[derive(Clone, Debug, Default)]
pub struct Repeater {
    loss: Loss,
    /// What goes next, and when; by time.
    waiting: BTreeMap<(Stamp, u64), RawFrame>,
    counted: u64,
    /// Our last acknowledgements, the newest last.
    answers: VecDeque<RawFrame>,
}

const COMMAND_INT: u32 = 75;
const COMMAND_LONG: u32 = 76;
const COMMAND_ACK: u32 = 77;
const COMMAND_CANCEL: u32 = 80;

/// Which command a frame is about; MAVLink 2 leaves zeros at the end out.
fn command_in(frame: &RawFrame) -> Option<u16> {
    let offset = match frame.message_id() {
        COMMAND_INT | COMMAND_LONG => 28,
        COMMAND_ACK | COMMAND_CANCEL => 0,
        _ => return None,
    };
    let at = |place: usize| frame.payload().get(place).copied().unwrap_or(0);
    Some(u16::from_le_bytes([at(offset), at(offset + 1)]))
}

/// How long after a frame its copies go. Those of a command go on until it is acknowledged.
fn copies(Loss { share, run }: Loss, is_command: bool) -> Vec<Duration> {
    let grown = |first: Duration, by: f64, until: Duration| {
        std::iter::successors(Some(first), move |after| {
            Some(after.mul_f64(by).max(*after + SPACING))
        })
        .take_while(move |after| *after <= until)
    };
    if run > BURST {
        let until = if is_command { LATEST } else { OUTLASTED };
        return grown(SPACING, LATER_IN_BURSTS, until).collect();
    }
    let times = (ALL_LOST.ln() / share.min(0.9).ln()).ceil() as u32;
    let soon = (1..times.min(MAX_TIMES)).map(|copy| SPACING * copy);
    let late = grown(LATE, LATER, LATEST).filter(|_| is_command);
    soon.chain(late).collect()
}

impl Repeater {
    /// Nothing waits, and the link is taken for good.
    pub fn new() -> Self {
        Self::default()
    }

    /// What the link loses.
    pub fn set_loss(&mut self, loss: Loss) {
        self.loss = loss;
    }

    /// A frame was sent: its copies, if it gets any, will come from [`Self::tick`].
    pub fn sent(&mut self, now: Stamp, frame: &RawFrame) {
        if frame.message_id() == COMMAND_CANCEL {
            // A late copy of the command would begin it again.
            let (vehicle, command) = (frame.target(), command_in(frame));
            if let (Some(vehicle), Some(command)) = (vehicle, command) {
                self.forget(vehicle, &[command]);
            }
        }
        if !is_awaited(frame) || self.loss.share < LEAST_LOSS {
            return;
        }
        let is_command = matches!(frame.message_id(), COMMAND_INT | COMMAND_LONG);
        for after in copies(self.loss, is_command) {
            self.wait(now + after, frame);
        }
        if frame.message_id() == COMMAND_ACK {
            if self.answers.len() >= MAX_ANSWERS {
                self.answers.pop_front();
            }
            self.answers.push_back(frame.clone());
        }
    }

    /// These commands are not wanted any more: a copy that waits must not come after a newer one. See
    /// [`crate::command::Client::supersede`].
    pub fn forget(&mut self, vehicle: Address, commands: &[u16]) {
        self.waiting.retain(|_, waits| {
            let is_command = matches!(waits.message_id(), COMMAND_INT | COMMAND_LONG);
            let is_named = command_in(waits).is_some_and(|command| commands.contains(&command));
            !(is_command && is_named && waits.target() == Some(vehicle))
        });
    }

    fn wait(&mut self, until: Stamp, frame: &RawFrame) {
        if self.waiting.len() < MAX_WAITING {
            self.counted += 1;
            self.waiting.insert((until, self.counted), frame.clone());
        }
    }

    /// A frame came, perhaps a copy of one that came before. An acknowledgement ends the copies of its command; a copy of a
    /// command that we have acknowledged is acknowledged again, by another copy.
    pub fn heard(&mut self, now: Stamp, frame: &RawFrame, is_copy: bool) {
        let Some(command) = command_in(frame) else {
            return;
        };
        let is_answer = |ack: &RawFrame| ack.message_id() == COMMAND_ACK;
        if is_answer(frame) {
            self.waiting
                .retain(|_, waits| is_answer(waits) || command_in(waits) != Some(command));
        } else if is_copy {
            let is_ours = |ack: &&RawFrame| command_in(ack) == Some(command);
            let under_way = |ack: &RawFrame| self.waiting.values().any(|waits| waits == ack);
            let answer = self.answers.iter().rev().find(is_ours);
            if let Some(answer) = answer.filter(|ack| !under_way(ack)).cloned() {
                self.wait(now, &answer);
            }
        }
    }

    /// Copies whose time has come.
    pub fn tick(&mut self, now: Stamp) -> Vec<RawFrame> {
        let later = self.waiting.split_off(&(now, u64::MAX));
        std::mem::replace(&mut self.waiting, later)
            .into_values()
            .collect()
    }

    /// When the next copy is to be sent.
    pub fn due(&self) -> Option<Stamp> {
        self.waiting.keys().next().map(|(at, _)| *at)
    }
}

/// Recognises frames that came before.
#[derive(Clone, Debug, Default)]
pub struct Duplicates {
    awaited: Memory,
    others: Memory,
}

impl Duplicates {
    /// Nothing came before.
    pub fn new() -> Self {
        Self::default()
    }

    /// Whether this very frame is heard for the first time within half a second; 3 s if an answer to it is waited for.
    pub fn is_new(&mut self, now: Stamp, frame: &RawFrame) -> bool {
        if is_awaited(frame) {
            self.awaited.is_new(now, REMEMBERED, frame)
        } else {
            self.others.is_new(now, REMEMBERED_BRIEFLY, frame)
        }
    }
}

#[derive(Clone, Debug, Default)]
struct Memory {
    hasher: BuildHasherDefault<DefaultHasher>,
    known: HashSet<u64>,
    order: VecDeque<(Stamp, u64)>,
}

impl Memory {
    fn is_new(&mut self, now: Stamp, remembered: Duration, frame: &RawFrame) -> bool {
        let is_old = |at: Stamp| now.since(at) > remembered;
        while self.order.len() >= MAX_REMEMBERED
            || self.order.front().is_some_and(|(at, _)| is_old(*at))
        {
            if let Some((_, hash)) = self.order.pop_front() {
                self.known.remove(&hash);
            }
        }
        // Each copy is signed anew when it leaves.
        let copy = (frame.from(), frame.sequence(), frame.message_id());
        let hash = self.hasher.hash_one((copy, frame.payload()));
        let is_new = self.known.insert(hash);
        if is_new {
            self.order.push_back((now, hash));
        }
        is_new
    }
}

/// What a link loses.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Loss {
    /// Share of the frames, 0 to 1.
    pub share: f64,
    /// How many are lost one after the other, on average; 0 if none.
    pub run: f64,
}

/// Counts that decay.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    came: f64,
    missing: f64,
    /// Runs of missing frames.
    runs: f64,
}

impl Tally {
    fn count(&mut self, missing: f64, memory_frames: f64) {
        let keep = 0.5_f64.powf(1.0 / memory_frames);
        self.came = self.came * keep + 1.0;
        self.missing = (self.missing * keep + missing).max(0.0);
        self.runs = self.runs * keep + f64::from(u8::from(missing > 0.0));
    }

    fn share(&self) -> f64 {
        self.missing / (self.came + self.missing)
    }
}

/// What of the frames sent to us is lost.
#[derive(Clone, Debug, Default)]
pub struct Reception {
    /// The highest sequence number of each sender, and which of the 128 up to it came: the lowest bit is its own.
    last: BTreeMap<Address, (u8, u128)>,
    /// For each of [`MEMORY_FRAMES`].
    tallies: [Tally; 2],
}

impl Reception {
    /// Nothing has come yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// A frame came. A copy of one that came before says nothing.
    pub fn heard(&mut self, frame: &RawFrame) {
        let from = frame.from();
        if !self.last.contains_key(&from) && self.last.len() >= MAX_SENDERS {
            return;
        }
        let sequence = frame.sequence();
        let (last, came) = *self
            .last
            .entry(from)
            .or_insert((sequence.wrapping_sub(1), 0));
        let ahead = sequence.wrapping_sub(last);
        let (missing, now) = if (1..=128).contains(&ahead) {
            let earlier = came.checked_shl(u32::from(ahead)).unwrap_or(0);
            (f64::from(ahead - 1), (sequence, earlier | 1))
        } else {
            // It was overtaken, and taken for lost; unless it is a copy.
            let bit = 1 << u32::from(last.wrapping_sub(sequence)).min(127);
            if came & bit != 0 {
                return;
            }
            (-1.0, (last, came | bit))
        };
        self.last.insert(from, now);
        for (tally, memory) in self.tallies.iter_mut().zip(MEMORY_FRAMES) {
            tally.count(missing, memory);
        }
    }

    /// What was lost lately; `None` before enough came.
    pub fn loss(&self) -> Option<Loss> {
        let [_, late] = &self.tallies;
        let share = self.tallies.iter().map(Tally::share).fold(0.0, f64::max);
        let run = if late.runs > 0.0 {
            late.missing / late.runs
        } else {
            0.0
        };
        (late.came >= MIN_FRAMES).then_some(Loss { share, run })
    }
}

#[cfg(test)]
mod tests;
