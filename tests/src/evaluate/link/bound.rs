//! What no way to send commands can beat: frames of one byte at every millisecond, and nothing else on the link.

use std::time::Duration;

use maps::time::Stamp;
use sitl::link::Channel;

use super::Case;

/// Longer than the run of a transport, since bursts are rare.
const SPAN: Duration = Duration::from_secs(400);
const STEP: Duration = Duration::from_millis(1);

/// From a wish to command to the answer, less twice the delay one way, at every millisecond. `None` where no answer came before the end.
pub(super) fn command_spans(case: &Case) -> Vec<Option<Duration>> {
    let (there, back) = (first_arrivals(case, 0), first_arrivals(case, 1));
    let at = |step: usize| Stamp::ZERO + STEP * step as u32;
    let delays = case.profile.delay * 2;
    // The last ones would find the end.
    let asked = there.len() * 9 / 10;
    (0..asked)
        .map(|step| {
            let heard = there[step]?;
            // What comes between two steps is answered at the next.
            let answered = heard.as_nanos().div_ceil(STEP.as_nanos() as u64) as usize;
            let known = (*back.get(answered)?)?;
            Some(known.since(at(step)).saturating_sub(delays))
        })
        .collect()
}

/// The earliest arrival of what is sent at a step or later.
fn first_arrivals(case: &Case, direction: u64) -> Vec<Option<Stamp>> {
    let steps = (SPAN.as_nanos() / STEP.as_nanos()) as u32;
    let mut channel = Channel::new(case.profile.clone(), case.seed + direction);
    let mut arrivals = vec![None; steps as usize];
    let mut now = Stamp::ZERO;
    let mut note = |channel: &mut Channel<u32>, now: Stamp| {
        while let Some(at) = channel.next_arrival().filter(|at| *at <= now) {
            for step in channel.arrived(at) {
                arrivals[step as usize] = Some(at);
            }
        }
    };
    for step in 0..steps {
        now = Stamp::ZERO + STEP * step;
        channel.send(now, step, 1);
        note(&mut channel, now);
    }
    note(&mut channel, now + case.profile.delay * 2 + STEP * 1000);
    let mut earliest = None;
    for arrival in arrivals.iter_mut().rev() {
        earliest = [*arrival, earliest].into_iter().flatten().min();
        *arrival = earliest;
    }
    arrivals
}
