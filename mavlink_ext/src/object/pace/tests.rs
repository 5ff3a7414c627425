use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::*;
use crate::object::estimate::Sent;

const STEP: Duration = Duration::from_millis(10);

/// A link with a buffer of half a second that carries `carries` bytes per second, both ways together take `delay`.
struct Pipe {
    now: Stamp,
    pacer: Pacer,
    carries: f64,
    delay: Duration,
    queue: f64,
    sent: u64,
    received: u32,
    /// Added to each round trip, from none to this.
    jitter: Duration,
    random: Pcg64,
    /// What there is to send, in bytes per second.
    offered: f64,
    /// The share that is lost on the way, in bursts of ten.
    loss: f64,
    in_burst: bool,
    under_way: VecDeque<(Stamp, Echo)>,
}

impl Pipe {
    fn new(allowed: u32, carries: f64, delay_ms: u64) -> Self {
        Self {
            now: Stamp::ZERO,
            pacer: Pacer::new(Stamp::ZERO, allowed),
            carries,
            delay: Duration::from_millis(delay_ms),
            queue: 0.0,
            sent: 0,
            received: 0,
            jitter: Duration::ZERO,
            random: Pcg64::seed_from_u64(5),
            offered: f64::INFINITY,
            loss: 0.0,
            in_burst: false,
            under_way: VecDeque::new(),
        }
    }

    fn loses(&mut self) -> bool {
        let changes = if self.in_burst {
            0.1
        } else {
            0.1 * self.loss / (1.0 - self.loss)
        };
        self.in_burst ^= self.random.random_bool(changes);
        self.in_burst
    }

    fn burstiness(&self) -> f64 {
        if self.loss > 0.0 { 10.0 } else { 1.0 }
    }

    /// Always has something to send. The mean rate that gets through, and the longest wait, in seconds.
    fn run(&mut self, seconds: u64) -> (f64, f64) {
        let (mut carried, mut longest) = (0.0, 0.0_f64);
        let mut left = 0.0;
        for _ in 0..seconds * 100 {
            self.now += STEP;
            self.pacer.refill(self.now);
            let leaves = (self.carries * STEP.as_secs_f64()).min(self.queue);
            self.queue -= leaves;
            carried += leaves;
            let mut taken = None;
            left += self.offered * STEP.as_secs_f64();
            while self.pacer.allows() && left > 0.0 {
                left -= 266.0;
                self.pacer.spend(266.0);
                self.sent += 266;
                if self.queue + 266.0 > (self.carries / 2.0).max(600.0) {
                    continue; // The buffer is full.
                }
                self.queue += 266.0;
                if self.loses() {
                    continue;
                }
                self.received += 1;
                taken = Some(Sent {
                    at: self.now,
                    symbols: self.sent / 266,
                    bytes: self.sent,
                });
            }
            if left > 0.0 {
                self.pacer.ran_out();
            }
            let wait = Duration::from_secs_f64(self.queue / self.carries);
            longest = longest.max(wait.as_secs_f64());
            if let Some(sent) = taken {
                let jitter = self.jitter.mul_f64(self.random.random());
                let round_trip = self.delay + wait + jitter;
                let received = self.received;
                let echo = Echo {
                    sent,
                    round_trip,
                    received,
                };
                self.under_way.push_back((self.now + round_trip, echo));
            }
            while let Some(&(arrives, echo)) = self.under_way.front()
                && arrives <= self.now
            {
                self.under_way.pop_front();
                self.pacer
                    .echoed(self.now, echo, (echo.round_trip, self.burstiness()));
            }
        }
        (carried / seconds as f64, longest)
    }
}

#[test]
fn a_link_within_the_budget_is_filled_and_its_buffer_stays_empty() {
    for (carries, delay_ms) in [(14_400.0, 0), (125_000.0, 200), (1.25e6, 400), (3.5e6, 20)] {
        let mut pipe = Pipe::new(carries as u32 * 10 / 9, carries, delay_ms);
        pipe.run(10);
        let (carried, longest) = pipe.run(60);
        assert!(
            carried > 0.97 * carries,
            "{carried} of {carries} at {delay_ms} ms"
        );
        let most = 0.07 + 3.0 * 266.0 / carries;
        assert!(longest < most, "{longest} s at {carries} and {delay_ms} ms");
    }
}

#[test]
fn a_budget_far_above_the_link_is_corrected() {
    let mut pipe = Pipe::new(3_500_000, 125_000.0, 100);
    pipe.run(15);
    let (carried, longest) = pipe.run(60);
    assert!(carried > 0.95 * 125_000.0, "{carried}");
    assert!(longest < 0.1, "{longest}");
}

#[test]
fn bursts_of_losses_are_not_taken_for_a_full_buffer() {
    for delay_ms in [0, 200, 400] {
        let mut pipe = Pipe::new(125_000, 125_000.0, delay_ms);
        pipe.loss = 0.3;
        pipe.run(10);
        let (carried, longest) = pipe.run(60);
        assert!(carried > 0.95 * 125_000.0, "{carried} at {delay_ms} ms");
        assert!(longest < 0.1, "{longest} at {delay_ms} ms");
    }
}

#[test]
fn a_full_buffer_is_noticed_while_losses_come_in_bursts() {
    let mut pipe = Pipe::new(2_000_000, 1.25e6, 100);
    pipe.loss = 0.2;
    pipe.run(10);
    pipe.carries = 300_000.0;
    pipe.run(5);
    let (_, longest) = pipe.run(20);
    assert!(longest < 0.1, "{longest}");
}

#[test]
fn jitter_is_not_taken_for_a_queue() {
    let mut pipe = Pipe::new(250_000, 250_000.0, 100);
    pipe.jitter = Duration::from_millis(40);
    pipe.run(20);
    let (carried, _) = pipe.run(60);
    assert!(carried > 0.85 * 250_000.0, "{carried}");
}

#[test]
fn who_has_little_to_send_may_send_more_at_any_time() {
    let mut pipe = Pipe::new(250_000, 250_000.0, 100);
    pipe.jitter = Duration::from_millis(40);
    pipe.run(10);
    pipe.offered = 25_000.0;
    pipe.run(60);
    pipe.offered = f64::INFINITY;
    let (carried, _) = pipe.run(5);
    assert!(carried > 0.75 * 250_000.0, "{carried}");
}

#[test]
fn a_link_that_gets_worse_and_better_is_followed() {
    let mut pipe = Pipe::new(2_000_000, 1.25e6, 100);
    pipe.run(10);
    pipe.carries = 300_000.0;
    pipe.run(5);
    let (carried, longest) = pipe.run(20);
    assert!(carried > 285_000.0, "{carried}");
    assert!(longest < 0.06, "{longest}");
    pipe.carries = 1.25e6;
    pipe.run(20);
    let (carried, _) = pipe.run(10);
    assert!(carried > 1.15e6, "{carried}");
}

#[test]
fn a_way_that_became_longer_is_not_taken_for_a_queue_for_ever() {
    let mut pipe = Pipe::new(100_000, 125_000.0, 50);
    pipe.run(10);
    pipe.delay = Duration::from_millis(250);
    pipe.run(40);
    let (carried, _) = pipe.run(10);
    assert!(carried > 95_000.0, "{carried}");
}

#[test]
fn a_radio_whose_buffer_fills_slows_the_pace() {
    let mut pacer = Pacer::new(Stamp::ZERO, 100_000);
    let before = pacer.rate(Stamp::ZERO);
    pacer.radio_has_room(Stamp::ZERO, 95);
    assert!(pacer.rate(Stamp::ZERO) >= before);
    pacer.radio_has_room(Stamp::ZERO, 10);
    assert!(pacer.rate(Stamp::ZERO) < 0.75 * before);
    for _ in 0..1000 {
        pacer.radio_has_room(Stamp::ZERO, 0);
    }
    assert!(pacer.rate(Stamp::ZERO) >= SLOWEST / 2.0);
}
