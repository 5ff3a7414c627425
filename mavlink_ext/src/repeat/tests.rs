use super::*;
use crate::dialect::Message;
use crate::dialect::tandem::{
    COMMAND_ACK_DATA, COMMAND_CANCEL_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA,
};
use crate::wire::Encoder;

const STATION: Address = Address::new(255, 190);
const EVEN: Loss = Loss {
    share: 0.2,
    run: 1.2,
};

fn at(millis: u64) -> Stamp {
    Stamp::ZERO + Duration::from_millis(millis)
}

fn command(encoder: &mut Encoder) -> RawFrame {
    encoder.encode(&Message::COMMAND_LONG(COMMAND_LONG_DATA::default()))
}

fn heartbeat(encoder: &mut Encoder) -> RawFrame {
    encoder.encode(&Message::HEARTBEAT(HEARTBEAT_DATA::default()))
}

#[test]
fn a_command_goes_as_often_as_the_loss_asks_for() {
    let mut encoder = Encoder::new(STATION);
    for (loss, copies) in [(0.0, 0), (0.05, 2), (0.2, 4), (0.3, 5), (1.0, 7)] {
        let mut repeater = Repeater::new();
        repeater.set_loss(Loss {
            share: loss,
            run: 1.0,
        });
        let frame = command(&mut encoder);
        repeater.sent(at(0), &frame);
        repeater.sent(at(0), &heartbeat(&mut encoder));
        assert!(repeater.tick(at(1)).is_empty(), "not at once");
        let sent: Vec<RawFrame> = (2..60).flat_map(|ms| repeater.tick(at(ms))).collect();
        assert_eq!(sent, vec![frame; copies], "at a loss of {loss}");
    }
}

#[test]
fn where_losses_come_in_bursts_no_burst_delays_a_command_by_much_more_than_its_length() {
    let bursts = Loss {
        share: 0.2,
        run: 10.0,
    };
    let times = copies(bursts, true);
    for burst_ms in 0..800 {
        let burst = Duration::from_millis(burst_ms);
        let next = times.iter().find(|at| **at >= burst).expect("one goes on");
        assert!(*next <= burst.mul_f64(1.2) + SPACING, "{next:?} {burst:?}");
    }
    let of_an_answer = copies(bursts, false);
    assert_eq!(
        of_an_answer,
        times[..of_an_answer.len()],
        "as long as it lasts"
    );
    assert!(
        of_an_answer.len() >= 10 && times.len() <= 40,
        "{}",
        times.len()
    );
}

#[test]
fn copies_end_with_the_acknowledgement_which_is_repeated_for_each_that_still_comes() {
    let mut station = Repeater::new();
    station.set_loss(EVEN);
    let sent = command(&mut Encoder::new(STATION));
    station.sent(at(0), &sent);
    let early: Vec<RawFrame> = (1..60).flat_map(|ms| station.tick(at(ms))).collect();
    assert_eq!(early.len(), 4);
    assert_eq!(station.tick(at(60)).len(), 1, "nothing was heard");

    let mut uav = Repeater::new();
    uav.set_loss(EVEN);
    let ack = Message::COMMAND_ACK(COMMAND_ACK_DATA::default());
    let ack = Encoder::new(Address::new(1, 191)).encode(&ack);
    uav.heard(at(90), &sent, false);
    uav.sent(at(90), &ack);
    assert_eq!(uav.tick(at(110)).len(), 4);
    uav.heard(at(160), &sent, true);
    uav.heard(at(160), &sent, true);
    assert_eq!(uav.tick(at(160)), std::slice::from_ref(&ack));

    station.heard(at(170), &ack, false);
    assert_eq!(station.due(), None);
}

#[test]
fn a_command_that_is_cancelled_or_void_has_no_late_copies() {
    let to = |system, number| COMMAND_LONG_DATA {
        command: number,
        target_system: system,
        target_component: 1,
        ..COMMAND_LONG_DATA::default()
    };
    let mut encoder = Encoder::new(STATION);
    let mut frame = |long| encoder.encode(&Message::COMMAND_LONG(long));
    let (takeoff, other_vehicle, other) = (frame(to(2, 22)), frame(to(1, 22)), frame(to(2, 400)));
    let kept = [&other_vehicle, &other];
    let after = |repeater: &mut Repeater| -> Vec<RawFrame> {
        let mut all = repeater.tick(at(1000));
        all.retain(|frame| frame.message_id() == COMMAND_LONG);
        all
    };
    let mut repeater = Repeater::new();
    repeater.set_loss(EVEN);
    for frame in [&takeoff, &other_vehicle, &other] {
        repeater.sent(at(0), frame);
    }
    let mut cancelling = repeater.clone();
    repeater.forget(Address::new(2, 1), &[22]);
    let copies = after(&mut repeater);
    assert!(!copies.is_empty() && copies.iter().all(|copy| kept.contains(&copy)));

    let cancel = Message::COMMAND_CANCEL(COMMAND_CANCEL_DATA {
        command: 22,
        target_system: 2,
        target_component: 1,
    });
    cancelling.sent(at(1), &encoder.encode(&cancel));
    let has_cancel = |waits: &RawFrame| waits.message_id() == COMMAND_CANCEL;
    assert!(cancelling.waiting.values().any(has_cancel), "itself copied");
    assert_eq!(after(&mut cancelling), copies);
}

#[test]
fn copies_are_dropped_and_a_repeated_command_is_not() {
    let mut encoder = Encoder::new(STATION);
    let mut duplicates = Duplicates::new();
    let first = command(&mut encoder);
    let again = command(&mut encoder);
    assert!(duplicates.is_new(at(0), &first));
    assert!(!duplicates.is_new(at(5), &first));
    assert!(duplicates.is_new(at(10), &again), "another sequence number");
    assert!(!duplicates.is_new(at(3000), &first));
    assert!(duplicates.is_new(at(3002), &first), "forgotten by now");
}

#[test]
fn a_flood_of_frames_and_commands_is_bounded() {
    let mut duplicates = Duplicates::new();
    let mut reception = Reception::new();
    let mut repeater = Repeater::new();
    repeater.set_loss(EVEN);
    for sender in 0..40_000_u32 {
        let [system, component, ..] = sender.to_le_bytes();
        let frame = command(&mut Encoder::new(Address::new(system, component)));
        duplicates.is_new(at(0), &frame);
        reception.heard(&frame);
        repeater.sent(at(0), &frame);
    }
    let Memory { known, order, .. } = &duplicates.awaited;
    assert_eq!((known.len(), order.len()), (MAX_REMEMBERED, MAX_REMEMBERED));
    assert_eq!(reception.last.len(), MAX_SENDERS);
    assert_eq!(repeater.waiting.len(), MAX_WAITING);
}

#[test]
fn loss_is_read_from_sequence_numbers_also_where_frames_overtake_and_come_twice() {
    let mut encoder = Encoder::new(STATION);
    let mut reception = Reception::new();
    assert_eq!(reception.loss(), None);
    let frames: Vec<RawFrame> = (0..3000).map(|_| heartbeat(&mut encoder)).collect();
    for (number, pair) in frames.chunks(2).enumerate() {
        if number % 5 == 0 {
            reception.heard(&pair[1]); // The other is lost: one frame in ten.
        } else if number % 5 == 2 {
            // Overtaken, and copies of both.
            for frame in [&pair[1], &pair[0], &pair[1], &pair[0], &pair[0]] {
                reception.heard(frame);
            }
        } else {
            for frame in pair {
                reception.heard(frame);
            }
        }
    }
    let loss = reception.loss().expect("enough came");
    assert!((loss.share - 0.1).abs() < 0.02, "{loss:?}");
    assert!(loss.run < 1.1, "{loss:?}");
}

#[test]
fn bursts_are_told_from_single_losses_and_a_command_is_spread_over_them() {
    let mut encoder = Encoder::new(STATION);
    let mut reception = Reception::new();
    let mut repeater = Repeater::new();
    let mut copies = Vec::new();
    // Nine in three hundred, one after the other.
    for number in 0..3000 {
        let frame = heartbeat(&mut encoder);
        if number % 300 < 9 {
            continue;
        }
        reception.heard(&frame);
        if number % 300 == 299 {
            repeater.set_loss(reception.loss().expect("enough came"));
            repeater.sent(at(0), &command(&mut Encoder::new(STATION)));
            copies.push((0..50).map(|ms| repeater.tick(at(ms)).len()).sum::<usize>());
        }
    }
    let loss = reception.loss().expect("enough came");
    assert!(
        (loss.share - 0.03).abs() < 0.01 && (loss.run - 9.0).abs() < 1.0,
        "{loss:?}"
    );
    assert_eq!(copies[1..], [13; 9], "also long after a burst");
}
