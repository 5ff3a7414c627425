//! Which moment is shown: it runs, stands, and goes anywhere, forwards and backwards.
//!
//! The world is a function of time, so that any moment can be shown. Where vehicles are simulated beside it, their time is
//! the present: nothing is shown beyond it, and who does not look back follows it.

use std::time::Duration;

use maps::time::Stamp;

/// How fast time may run.
pub(crate) const SPEEDS: [f64; 7] = [0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0];
const NORMAL: usize = 3;
/// Traffic goes on for so long.
const LENGTH: Duration = Duration::from_mins(4);
/// A slow picture must not make time leap.
const LONGEST_PASS_S: f64 = 0.25;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TimeLine {
    at: Stamp,
    playing: bool,
    speed: usize,
    /// The present of vehicles that are simulated.
    present: Option<Stamp>,
    /// Whether it goes with them.
    follows: bool,
}

impl TimeLine {
    /// Stands at that moment.
    pub(crate) fn new(at: Stamp) -> Self {
        Self {
            at,
            playing: false,
            speed: NORMAL,
            present: None,
            follows: false,
        }
    }

    pub(crate) fn at(&self) -> Stamp {
        self.at
    }

    pub(crate) fn is_playing(&self) -> bool {
        self.playing || self.follows
    }

    /// Whether it shows the present of vehicles.
    pub(crate) fn follows(&self) -> bool {
        self.follows
    }

    /// The present of vehicles, where there are any.
    pub(crate) fn present(&self) -> Option<Stamp> {
        self.present
    }

    pub(crate) fn speed(&self) -> f64 {
        SPEEDS[self.speed]
    }

    /// The last moment that can be shown.
    pub(crate) fn end(&self) -> Stamp {
        self.present.unwrap_or(Stamp::ZERO + LENGTH)
    }

    /// The vehicles have come to that moment.
    pub(crate) fn reach(&mut self, present: Stamp) {
        if self.present.is_none() {
            self.follows = true;
        }
        self.present = Some(present);
        if self.follows {
            self.at = present;
        }
    }

    /// So many seconds of real time have passed.
    pub(crate) fn advance(&mut self, seconds: f64) {
        if !self.playing || self.follows {
            return;
        }
        let seconds = if seconds.is_finite() { seconds } else { 0.0 };
        let passed = seconds.clamp(0.0, LONGEST_PASS_S) * self.speed();
        self.at = (self.at + Duration::from_secs_f64(passed)).min(self.end());
        if self.at == self.end() {
            self.playing = false;
            self.follows = self.present.is_some();
        }
    }

    /// Stands, or runs on.
    pub(crate) fn toggle(&mut self) {
        self.playing = !self.is_playing();
        self.follows = false;
        if self.playing && self.at >= self.end() {
            if self.present.is_some() {
                self.follow();
            } else {
                self.at = Stamp::ZERO;
            }
        }
    }

    /// Goes to the present of the vehicles and on with them.
    pub(crate) fn follow(&mut self) {
        if let Some(present) = self.present {
            (self.at, self.follows, self.playing) = (present, true, false);
        }
    }

    /// Goes there; whether time runs on does not change, unless it was the vehicles'.
    pub(crate) fn seek(&mut self, at: Stamp) {
        self.at = at.min(self.end());
        self.follows = false;
    }

    /// Goes by so much and stands there.
    pub(crate) fn step(&mut self, by: Duration, forwards: bool) {
        self.seek(if forwards { self.at + by } else { self.at - by });
        self.playing = false;
    }

    pub(crate) fn set_speed(&mut self, index: usize) {
        self.speed = index.min(SPEEDS.len() - 1);
    }

    pub(crate) fn faster(&mut self) {
        self.set_speed(self.speed + 1);
    }

    pub(crate) fn slower(&mut self) {
        self.set_speed(self.speed.saturating_sub(1));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn second(seconds: u64) -> Stamp {
        Stamp::ZERO + Duration::from_secs(seconds)
    }

    #[test]
    fn it_stands_until_it_is_played_and_stands_again_when_it_is_paused() {
        let mut line = TimeLine::new(second(8));
        line.advance(0.1);
        assert_eq!(line.at(), second(8));
        line.toggle();
        (0..20).for_each(|_| line.advance(0.1));
        assert!(line.at().distance(second(10)) < Duration::from_micros(1));
        line.toggle();
        line.advance(0.1);
        assert!(line.at().distance(second(10)) < Duration::from_micros(1));
    }

    #[test]
    fn it_goes_both_ways_and_stays_within_its_ends() {
        let mut line = TimeLine::new(second(8));
        line.step(Duration::from_millis(100), false);
        assert_eq!(line.at(), Stamp::from_nanos(7_900_000_000));
        line.step(Duration::from_mins(1), false);
        assert_eq!(line.at(), Stamp::ZERO);
        line.seek(second(999));
        assert_eq!(line.at(), second(240));
        line.toggle();
        assert_eq!((line.at(), line.is_playing()), (Stamp::ZERO, true), "anew");
        line.seek(second(100));
        assert!(line.is_playing(), "seeking does not stop it");
    }

    #[test]
    fn speeds_have_ends_and_a_slow_pass_makes_no_leap() {
        let mut line = TimeLine::new(Stamp::ZERO);
        (0..9).for_each(|_| line.faster());
        assert!((line.speed() - 10.0).abs() < 1e-9);
        line.toggle();
        line.advance(100.0);
        assert_eq!(line.at(), Stamp::from_nanos(2_500_000_000));
        (0..9).for_each(|_| line.slower());
        assert!((line.speed() - 0.1).abs() < 1e-9);
        line.advance(f64::NAN);
    }

    #[test]
    fn it_goes_with_the_vehicles_until_someone_looks_back() {
        let mut line = TimeLine::new(Stamp::ZERO);
        line.reach(second(3));
        assert_eq!((line.at(), line.follows()), (second(3), true));
        line.seek(second(1));
        line.reach(second(4));
        assert_eq!((line.at(), line.follows()), (second(1), false));
        line.seek(second(9));
        assert_eq!(line.at(), second(4), "nobody knows what comes");
        line.follow();
        line.reach(second(5));
        assert_eq!(line.at(), second(5));
        line.toggle();
        line.reach(second(6));
        assert_eq!((line.at(), line.is_playing()), (second(5), false));
        line.toggle();
        (0..10).for_each(|_| line.advance(0.25));
        assert!(line.follows(), "it has caught up");
    }
}
