use std::time::Duration;

use super::*;

fn at(millis: u64) -> Stamp {
    Stamp::ZERO + Duration::from_millis(millis)
}

/// Numbers the frames of `count` sends, one a millisecond, and says when each arrived.
fn journey(profile: Profile, bytes: usize, count: u64) -> (Vec<(u64, u64)>, ChannelStats) {
    let mut channel = Channel::new(profile, 3);
    let mut arrivals = Vec::new();
    for ms in 0..count + 5000 {
        if ms < count {
            channel.send(at(ms), ms, bytes);
        }
        arrivals.extend(channel.arrived(at(ms)).into_iter().map(|frame| (frame, ms)));
    }
    (arrivals, channel.stats())
}

#[test]
fn an_ideal_link_delivers_at_once() {
    let (arrivals, _) = journey(Profile::IDEAL, 100, 50);
    assert!(arrivals.iter().all(|(sent, arrived)| sent == arrived));
    assert_eq!(arrivals.len(), 50);
}

#[test]
fn a_saturated_link_delivers_its_rate_and_delays_by_its_buffer() {
    // 100 bytes a millisecond onto half of that.
    let profile = Profile::of_rate(400_000.0, Duration::from_millis(20));
    let (arrivals, stats) = journey(profile, 100, 4000);
    let within = arrivals
        .iter()
        .filter(|(_, ms)| (1000..3000).contains(ms))
        .count();
    assert!(
        (990..=1010).contains(&within),
        "{within} frames in two seconds"
    );
    let longest = arrivals.iter().map(|(sent, arrived)| arrived - sent).max();
    assert!(
        longest.is_some_and(|ms| (500..=525).contains(&ms)),
        "{longest:?}"
    );
    assert!(stats.dropped > 1500, "{stats:?}");
    assert_eq!(stats.dropped + arrivals.len() as u64, 4000);
}

#[test]
fn a_frame_larger_than_the_buffer_passes_an_empty_one() {
    let profile = Profile {
        buffer_bytes: 10,
        ..Profile::of_rate(80_000.0, Duration::ZERO)
    };
    let mut channel = Channel::new(profile, 1);
    channel.send(at(0), "large", 1000);
    channel.send(at(0), "next", 1);
    assert_eq!(channel.next_arrival(), Some(at(100)));
    assert_eq!(channel.arrived(at(100)), ["large"]);
    assert_eq!(channel.stats().dropped, 1);
}

#[track_caller]
fn check_loss(loss: Loss, share: f64, length: f64) {
    let profile = Profile {
        loss,
        ..Profile::IDEAL
    };
    let (arrivals, stats) = journey(profile, 1, 200_000);
    assert!(
        (stats.lost as f64 / 200_000.0 - share).abs() < 0.02,
        "{stats:?}"
    );
    let bursts = arrivals
        .windows(2)
        .filter(|pair| pair[1].0 > pair[0].0 + 1)
        .count();
    let mean = stats.lost as f64 / bursts as f64;
    assert!((mean / length - 1.0).abs() < 0.15, "bursts of {mean}");
}

#[test]
fn losses_are_as_many_and_as_bursty_as_asked() {
    check_loss(Loss::Even(0.2), 0.2, 1.25);
    check_loss(
        Loss::Bursts {
            share: 0.2,
            length: 20.0,
        },
        0.2,
        20.0,
    );
    check_loss(
        Loss::Bursts {
            share: 0.05,
            length: 5.0,
        },
        0.05,
        5.0,
    );
}

#[test]
fn a_burst_passes_while_nothing_is_sent_and_small_frames_do_not_shorten_it() {
    // A full frame takes 10 ms: bursts of 100 ms.
    let loss = Loss::Bursts {
        share: 0.2,
        length: 10.0,
    };
    let profile = Profile {
        loss,
        ..Profile::of_rate(8.0 * 28_000.0, Duration::ZERO)
    };
    let lost_after_lost = |every_ms: u64| {
        let mut channel = Channel::new(profile.clone(), 5);
        let mut lost = Vec::new();
        for i in 0..200_000 {
            let before = channel.stats().lost;
            channel.send(at(i * every_ms), (), 20);
            lost.push(channel.stats().lost > before);
        }
        let pairs = lost.windows(2).filter(|pair| pair[0]);
        let (count, both) = pairs.fold((0, 0), |(count, both), pair| {
            (count + 1, both + u32::from(pair[1]))
        });
        let share = f64::from(count) / 200_000.0;
        assert!((share - 0.2).abs() < 0.03, "{share} lost");
        f64::from(both) / f64::from(count)
    };
    let [close, apart, far] = [1, 50, 2000].map(lost_after_lost);
    assert!((close - 0.99).abs() < 0.01, "{close}");
    assert!((apart - 0.63).abs() < 0.06, "{apart}");
    assert!((far - 0.2).abs() < 0.03, "{far}: each for itself");
}

#[test]
fn jitter_keeps_the_order_and_overtaking_does_not() {
    let jitter = Profile {
        delay: Duration::from_millis(20),
        jitter: Duration::from_millis(30),
        ..Profile::IDEAL
    };
    let (arrivals, _) = journey(jitter.clone(), 1, 1000);
    assert!(arrivals.is_sorted());
    let (arrivals, _) = journey(
        Profile {
            overtake: 0.2,
            ..jitter
        },
        1,
        1000,
    );
    assert!(!arrivals.is_sorted_by_key(|(sent, _)| *sent));
    assert_eq!(arrivals.len(), 1000);
}

#[test]
fn nothing_passes_in_an_outage() {
    let profile = Profile {
        outages: vec![Outage {
            from: at(100),
            span: Duration::from_millis(200),
        }],
        ..Profile::IDEAL
    };
    let (arrivals, _) = journey(profile, 1, 500);
    assert_eq!(arrivals.len(), 300);
    assert!(arrivals.iter().all(|(sent, _)| !(100..300).contains(sent)));
}

#[test]
fn a_frame_may_arrive_twice() {
    let (arrivals, stats) = journey(
        Profile {
            repeat: 0.5,
            ..Profile::IDEAL
        },
        1,
        1000,
    );
    assert!((1400..1600).contains(&arrivals.len()), "{}", arrivals.len());
    assert_eq!(stats.arrived, arrivals.len() as u64);
}

#[test]
fn the_same_seed_has_the_same_result() {
    let profile = Profile::named("lossy20").expect("known");
    assert_eq!(
        journey(profile.clone(), 100, 2000),
        journey(profile, 100, 2000)
    );
}

#[test]
fn every_name_is_a_profile() {
    assert!(
        Profile::NAMES
            .iter()
            .all(|name| Profile::named(name).is_some())
    );
    assert_eq!(Profile::named("perfect"), None);
}
