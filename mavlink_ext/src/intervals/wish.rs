//! One message that is wanted: what was asked, what arrives, and what follows from both.

use std::time::Duration;

use maps::time::Stamp;

use super::{IntervalEvent, Rate, stream_of};
use crate::command::CommandError;
use crate::dialect::tandem::{MavDataStream, MavResult};

/// Arrivals are counted for so many intervals.
const COUNTED: u32 = 8;
/// And for at least so long.
const LEAST_WINDOW: Duration = Duration::from_secs(2);
/// What is sent more seldom is not waited for, but asked about.
const LONGEST_WINDOW: Duration = Duration::from_secs(10);
/// When at least this share of the expected messages comes, the link loses the others.
const ENOUGH: f64 = 0.4;
/// An interval longer by this factor is not what was asked for.
const MUCH_LONGER: f64 = 1.5;
/// So many windows with too little, one after another, are no bad luck.
const SLOW_WINDOWS: u32 = 3;
/// Failures in a row after which another way is tried.
const MAX_FAILURES: u32 = 3;
/// Questions about one interval.
const MAX_QUESTIONS: u32 = 3;
/// The answer to a question that was acknowledged comes within this time.
const ANSWER: Duration = Duration::from_millis(1500);
/// First pause after a failure; each further one is twice as long.
const PAUSE: Duration = Duration::from_secs(5);
const LONGEST_PAUSE: Duration = Duration::from_mins(5);

/// How the vehicle is asked for the message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Way {
    /// `MAV_CMD_SET_MESSAGE_INTERVAL`.
    Interval,
    /// `REQUEST_DATA_STREAM` with this stream.
    Stream(MavDataStream),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// To be asked for.
    Due { at: Stamp },
    /// Asked for.
    Asked,
    /// Promised, not yet seen.
    Promised,
    /// Not seen, and to be asked about.
    Doubted { questions: u32, next: Stamp },
    /// Comes, or comes no more, as it should.
    Settled,
    /// Cannot be had.
    Unavailable,
}

#[derive(Clone, Debug)]
pub(super) struct Wish {
    message: u32,
    rate: Rate,
    way: Way,
    state: State,
    /// Time between two messages that the vehicle has told, where it is not the one asked for.
    told: Option<Duration>,
    window_start: Stamp,
    arrived: u32,
    slow_windows: u32,
    /// In a row: it was promised and does not come.
    failures: u32,
    /// How often it was asked for since it last came as it should.
    asked_again: u32,
}

impl Wish {
    pub(super) fn new(now: Stamp, message: u32, rate: Rate) -> Self {
        Self {
            message,
            rate,
            way: Way::Interval,
            state: State::Due { at: now },
            told: None,
            window_start: now,
            arrived: 0,
            slow_windows: 0,
            failures: 0,
            asked_again: 0,
        }
    }

    pub(super) fn rate(&self) -> Rate {
        self.rate
    }

    pub(super) fn way(&self) -> Way {
        self.way
    }

    /// Since when it waits to be asked for.
    pub(super) fn due(&self, now: Stamp) -> Option<Stamp> {
        match self.state {
            State::Due { at } => Some(at).filter(|at| *at <= now),
            _ => None,
        }
    }

    /// Since when it waits to be asked about.
    pub(super) fn doubted(&self, now: Stamp) -> Option<Stamp> {
        match self.state {
            State::Doubted { questions, next } => {
                Some(next).filter(|next| *next <= now && questions < MAX_QUESTIONS)
            }
            _ => None,
        }
    }

    pub(super) fn arrived(&mut self) {
        self.arrived = self.arrived.saturating_add(1);
    }

    /// The command to send it goes out.
    pub(super) fn asked(&mut self) {
        self.state = State::Asked;
    }

    /// A question about it goes out, or cannot be asked.
    pub(super) fn asked_about(&mut self, now: Stamp) {
        if let State::Doubted { questions, .. } = self.state {
            self.state = State::Doubted {
                questions: questions + 1,
                // The command is repeated for longer than that; its outcome brings this forward.
                next: now + LONGEST_PAUSE,
            };
        }
    }

    /// The question was acknowledged or was not, and its answer is waited for a little longer.
    pub(super) fn question_ended(&mut self, now: Stamp) {
        if let State::Doubted { questions, .. } = self.state {
            let next = now + ANSWER;
            self.state = State::Doubted { questions, next };
        }
    }

    /// The stream that it is part of was asked for.
    pub(super) fn stream_asked(&mut self, now: Stamp) {
        self.promised(now);
    }

    fn promised(&mut self, now: Stamp) {
        self.state = State::Promised;
        self.told = None;
        self.restart_window(now);
    }

    /// What came of the command to send it.
    pub(super) fn answered(
        &mut self,
        now: Stamp,
        result: Result<(), CommandError>,
    ) -> Option<IntervalEvent> {
        if self.state != State::Asked {
            return None;
        }
        let message = self.message;
        match result {
            Ok(()) => {
                self.promised(now);
                if self.rate == Rate::Default {
                    self.settled(now);
                    return Some(IntervalEvent::Granted { message });
                }
                // It would take too long to see.
                if self
                    .interval()
                    .is_some_and(|i| i * COUNTED > LONGEST_WINDOW)
                {
                    self.doubt(now);
                }
                None
            }
            Err(CommandError::Refused { result })
                if result != MavResult::MAV_RESULT_TEMPORARILY_REJECTED =>
            {
                self.try_other_way(now)
            }
            // Silence is no refusal, however long it lasts.
            Err(_) => {
                self.ask_later(now);
                None
            }
        }
    }

    /// The vehicle told the interval: in microseconds, −1 for never, 0 where it cannot.
    pub(super) fn told(&mut self, now: Stamp, interval_us: i32) -> Option<IntervalEvent> {
        if !matches!(self.state, State::Doubted { .. }) {
            return None;
        }
        let told = u64::try_from(interval_us).ok().filter(|us| *us > 0);
        let told = told.map(Duration::from_micros);
        match (self.rate, told) {
            (Rate::Every(_), Some(told)) => Some(self.settle(now, told)),
            (Rate::Off, None) | (Rate::Default, _) => {
                self.settled(now);
                let message = self.message;
                Some(IntervalEvent::Granted { message })
            }
            (Rate::Every(_), None) if interval_us == 0 => self.try_other_way(now),
            (Rate::Every(_), None) | (Rate::Off, Some(_)) => self.failed(now),
        }
    }

    /// Lets time pass. Whether the vehicle can be asked about intervals is `can_ask`.
    pub(super) fn tick(&mut self, now: Stamp, can_ask: bool) -> Option<IntervalEvent> {
        match self.state {
            State::Promised if self.window_is_over(now) => self.judge_promise(now),
            State::Settled if self.window_is_over(now) => self.judge_settled(now),
            State::Doubted { questions, next }
                if now >= next && (!can_ask || questions >= MAX_QUESTIONS) =>
            {
                match self.seen(now) {
                    Some(seen) if self.interval().is_some() => Some(self.settle(now, seen)),
                    _ => self.failed(now),
                }
            }
            _ => None,
        }
    }

    fn judge_promise(&mut self, now: Stamp) -> Option<IntervalEvent> {
        let message = self.message;
        if self.is_as_asked(now) {
            self.settled(now);
            self.asked_again = 0;
            return Some(IntervalEvent::Granted { message });
        }
        match self.way {
            Way::Interval => {
                self.doubt(now);
                None
            }
            // Nobody can be asked about a stream.
            Way::Stream(_) => match self.seen(now) {
                Some(seen) => Some(self.settle(now, seen)),
                None => self.failed(now),
            },
        }
    }

    fn judge_settled(&mut self, now: Stamp) -> Option<IntervalEvent> {
        let silent = self.arrived == 0 && self.interval().is_some();
        let good = self.is_as_asked(now);
        if good {
            self.asked_again = 0;
        }
        self.slow_windows = if good { 0 } else { self.slow_windows + 1 };
        self.restart_window(now);
        if good || (!silent && self.slow_windows < SLOW_WINDOWS) {
            return None;
        }
        self.ask_later(now);
        let message = self.message;
        Some(IntervalEvent::Lapsed { message })
    }

    /// It comes this often, which is as it was asked for, or all there is to have.
    fn settle(&mut self, now: Stamp, interval: Duration) -> IntervalEvent {
        self.settled(now);
        let message = self.message;
        let slower = |asked: Duration| interval > asked.mul_f64(MUCH_LONGER);
        match self.rate {
            Rate::Every(asked) if slower(asked) => {
                self.told = Some(interval);
                IntervalEvent::Slower { message, interval }
            }
            Rate::Every(_) | Rate::Default | Rate::Off => IntervalEvent::Granted { message },
        }
    }

    fn settled(&mut self, now: Stamp) {
        self.state = State::Settled;
        self.failures = 0;
        self.slow_windows = 0;
        self.restart_window(now);
    }

    fn failed(&mut self, now: Stamp) -> Option<IntervalEvent> {
        self.failures += 1;
        if self.failures >= MAX_FAILURES {
            return self.try_other_way(now);
        }
        self.ask_later(now);
        None
    }

    fn try_other_way(&mut self, now: Stamp) -> Option<IntervalEvent> {
        self.failures = 0;
        let stream = stream_of(self.message).filter(|_| self.interval().is_some());
        if let (Way::Interval, Some(stream)) = (self.way, stream) {
            self.way = Way::Stream(stream);
            self.state = State::Due { at: now };
            return None;
        }
        self.state = State::Unavailable;
        let message = self.message;
        Some(IntervalEvent::Unavailable { message })
    }

    /// At once the first time; then after pauses that grow, as nothing else bounds how often it goes wrong.
    fn ask_later(&mut self, now: Stamp) {
        let pause = match self.asked_again {
            0 => Duration::ZERO,
            again => PAUSE * (1 << (again - 1).min(10)),
        };
        self.asked_again = self.asked_again.saturating_add(1);
        let at = now + pause.min(LONGEST_PAUSE);
        self.state = State::Due { at };
    }

    fn doubt(&mut self, now: Stamp) {
        let (questions, next) = (0, now);
        self.state = State::Doubted { questions, next };
    }

    /// The interval that it should have; `None` where there is none.
    fn interval(&self) -> Option<Duration> {
        match self.rate {
            Rate::Every(asked) => Some(self.told.unwrap_or(asked)),
            Rate::Default | Rate::Off => None,
        }
    }

    fn restart_window(&mut self, now: Stamp) {
        self.window_start = now;
        self.arrived = 0;
    }

    fn window_is_over(&self, now: Stamp) -> bool {
        let counted = self.interval().map_or(LEAST_WINDOW, |i| i * COUNTED);
        now.since(self.window_start) >= counted.max(LEAST_WINDOW)
    }

    /// Time between two that arrived; `None` if none did.
    fn seen(&self, now: Stamp) -> Option<Duration> {
        let window = now.since(self.window_start);
        (self.arrived > 0).then(|| window / self.arrived)
    }

    fn is_as_asked(&self, now: Stamp) -> bool {
        match (self.rate, self.interval()) {
            (Rate::Every(_), Some(interval)) => {
                let window = now.since(self.window_start);
                let expected = window.as_secs_f64() / interval.as_secs_f64().max(1e-6);
                f64::from(self.arrived) >= expected * ENOUGH
            }
            // One may have been under way.
            (Rate::Off, _) => self.arrived <= 1,
            (Rate::Default | Rate::Every(_), _) => true,
        }
    }
}
