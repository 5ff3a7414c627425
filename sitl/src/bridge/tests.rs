//! What the bridge does for a fake `ArduPilot`.

mod fake;

use std::net::{Ipv4Addr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use nalgebra::Vector3;
use proptest::prelude::*;

use super::serve::Until;
use super::*;
use crate::scene::Name;
use crate::vehicle::copter::GRAVITY;
use fake::{Fake, Felt, drive, fly, frame, frame_16};

fn setup(scene: &Scene, vehicle: VehicleKind) -> Setup<'_> {
    let start = Start {
        x_m: 0.0,
        y_m: 0.0,
        heading_deg: 90.0,
    };
    Setup {
        vehicle,
        scene,
        start,
    }
}

fn room() -> Scene {
    Scene::generate(Name::Room, 1)
}

/// Ends a bridge, also when the test fails: it would run for ever.
struct Ends<'a>(&'a AtomicBool);

impl Drop for Ends<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Runs a bridge at a socket of its own beside `with`; returns what it counted.
fn beside(vehicle: VehicleKind, with: impl FnOnce(&UdpSocket)) -> Counters {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a free port");
    let stop = AtomicBool::new(false);
    let scene = room();
    let serve_it = || {
        let mut bridge = Bridge::new(setup(&scene, vehicle));
        let until = Until {
            stop: &stop,
            simulated: None,
        };
        serve(&mut bridge, &socket, until).expect("loopback works");
        bridge.counters()
    };
    thread::scope(|scope| {
        let server = thread::Builder::new()
            .name("bridge".to_owned())
            .spawn_scoped(scope, serve_it);
        let server = server.expect("there are threads");
        let ends = Ends(&stop);
        with(&socket);
        drop(ends);
        server.join().expect("it does not panic")
    })
}

#[test]
fn a_copter_flies_to_a_point_in_lockstep_and_its_rangefinder_sees_the_floor() {
    let counters = beside(VehicleKind::Copter, |socket| {
        let to = Vector3::new(1.5, 1.3, -1.5);
        let felt = Fake::new(socket).go(to, 15, fly);
        assert!((felt.position - to).norm() < 0.1, "{felt:?}");
        assert!(felt.velocity.norm() < 0.05, "{felt:?}");
        assert!((felt.range_m - 1.5).abs() < 0.1, "{felt:?}");
        assert!(
            (felt.force - Vector3::new(0.0, 0.0, -GRAVITY)).norm() < 0.2,
            "{felt:?}"
        );
        assert!((felt.time_s - 15.002_5).abs() < 1e-6, "{felt:?}");
    });
    let expected = Counters {
        frames: 6001,
        ..Counters::default()
    };
    assert_eq!(counters, expected);
}

#[test]
fn a_rover_drives_to_a_point_and_stops_there() {
    beside(VehicleKind::Rover, |socket| {
        // Behind it and to the left: it has to turn.
        let to = Vector3::new(3.0, -2.0, 0.0);
        let felt = Fake::new(socket).go(to, 30, drive);
        assert!((felt.position - to).norm() < 0.5, "{felt:?}");
        assert!(
            felt.velocity.norm() < 1e-6 && felt.position.z.abs() < 1e-9,
            "{felt:?}"
        );
    });
}

#[test]
fn a_rover_feels_its_turns_and_steers_as_ardupilot_does() {
    let scene = room();
    let mut bridge = Bridge::new(setup(&scene, VehicleKind::Rover));
    let right_and_ahead = [2000, 1500, 1800];
    for count in 0..2000 {
        bridge
            .handle(&frame_16(count, &right_and_ahead))
            .expect("a frame");
    }
    let (_, answer) = bridge
        .handle(&frame_16(2000, &right_and_ahead))
        .expect("a frame");
    let felt = Felt::of(answer);
    let (speed, turn) = (felt.velocity.norm(), felt.gyro.z);
    assert!(
        (speed - 0.9).abs() < 1e-6 && turn > 1.0,
        "to the right: {felt:?}"
    );
    // Pushed to the right by what turns it there: v·ω.
    assert!((felt.force.y - speed * turn).abs() < 0.02, "{felt:?}");
    assert!((felt.force.z + GRAVITY).abs() < 1e-9, "{felt:?}");
}

#[test]
fn at_rest_the_line_is_what_ardupilot_reads() {
    let scene = room();
    let mut bridge = Bridge::new(setup(&scene, VehicleKind::Copter));
    let (step, answer) = bridge.handle(&frame_16(0, &[0; 16])).expect("a frame");
    let line = std::str::from_utf8(answer).expect("ASCII");
    assert_eq!(step, Step::Simulated);
    let keys = [
        "\n{\"timestamp\":0.0025,\"imu\":{\"gyro\":[",
        "],\"accel_body\":[",
        "]},\"position\":[",
        "],\"velocity\":[",
        "],\"quaternion\":[",
        "],\"rng_1\":",
    ];
    let mut rest = line;
    for key in keys {
        let at = rest.find(key).unwrap_or_else(|| panic!("{key} in {line}"));
        rest = &rest[at + key.len()..];
    }
    let felt = Felt::of(answer);
    assert!(
        (felt.force - Vector3::new(0.0, 0.0, -GRAVITY)).norm() < 1e-9,
        "{felt:?}"
    );
    assert!(
        (felt.angles[2] - std::f64::consts::FRAC_PI_2).abs() < 1e-9,
        "east: {felt:?}"
    );
    assert!(felt.range_m < 0.01, "{felt:?}");
}

#[test]
fn a_frame_that_comes_twice_is_answered_twice_and_simulated_once() {
    let scene = room();
    let mut bridge = Bridge::new(setup(&scene, VehicleKind::Copter));
    let mut answer = |count| {
        let (step, answer) = bridge
            .handle(&frame_16(count, &[1800; 4]))
            .expect("a frame");
        (step, answer.to_vec())
    };
    let (_, first) = answer(7);
    assert_eq!(answer(7), (Step::Repeated, first));
    let (step, later) = answer(8);
    assert!((Felt::of(&later).time_s - 0.005).abs() < 1e-12 && step == Step::Simulated);
    answer(11);
    let expected = Counters {
        frames: 3,
        duplicates: 1,
        missed: 2,
        ..Counters::default()
    };
    assert_eq!(bridge.counters(), expected);
}

#[test]
fn frames_from_the_beginning_are_a_new_ardupilot_in_a_new_world() {
    let scene = room();
    let mut bridge = Bridge::new(setup(&scene, VehicleKind::Copter));
    for count in 0..2000 {
        bridge
            .handle(&frame_16(count, &[1900; 4]))
            .expect("a frame");
    }
    assert!(
        bridge.plant().highest_m() > 5.0,
        "{} m",
        bridge.plant().highest_m()
    );
    let error = bridge
        .handle(&frame_16(1997, &[1900; 4]))
        .expect_err("late");
    assert_eq!(error.to_string(), "frame 1997 comes after frame 1999");
    let (step, answer) = bridge.handle(&frame_16(0, &[1000; 4])).expect("a frame");
    let felt = Felt::of(answer);
    assert_eq!(step, Step::Restarted);
    assert!(
        felt.position.norm() < 1e-9 && (felt.time_s - 0.0025).abs() < 1e-12,
        "{felt:?}"
    );
    assert_eq!(
        (bridge.counters().restarts, bridge.counters().refused),
        (1, 1)
    );
}

#[test]
fn the_same_frames_give_the_same_bytes_and_sixteen_channels_more_change_nothing() {
    let scene = Scene::generate(Name::ResidentialAlley, 1000);
    let fly = |magic: u16| {
        let mut bridge = Bridge::new(setup(&scene, VehicleKind::Copter));
        let mut answers = Vec::new();
        for count in 0..300 {
            let (_, answer) = bridge
                .handle(&frame(magic, 1200, count, &[1600, 1620, 1590, 1600]))
                .expect("a frame");
            answers.push(answer.to_vec());
        }
        answers
    };
    let first = fly(18_458);
    assert_eq!(first, fly(18_458));
    assert_eq!(first, fly(29_569));
}

#[track_caller]
fn check_refused(bytes: &[u8], words: &str) {
    let error = Packet::parse(bytes).expect_err(words);
    assert_eq!(error.to_string(), words);
}

#[test]
fn packets_that_are_not_ardupilots_are_refused_by_name() {
    check_refused(
        &[],
        "a packet of 0 bytes is too short for one of ArduPilot's",
    );
    check_refused(
        &frame_16(0, &[])[..7],
        "a packet of 7 bytes is too short for one of ArduPilot's",
    );
    check_refused(
        &[0xFD; 40],
        "a packet that begins with 65021 is none of ArduPilot's, which begin with 18458 or 29569",
    );
    check_refused(
        &frame_16(0, &[])[..39],
        "a packet that begins with 18458 has 39 bytes, not 40",
    );
    let long = [frame(29_569, 400, 0, &[]), vec![0]].concat();
    check_refused(
        &long,
        "a packet that begins with 29569 has 73 bytes, not 72",
    );
    check_refused(
        &frame(18_458, 0, 0, &[]),
        "0 frames a second are too few: set SIM_RATE_HZ to 11 or more",
    );
}

#[test]
fn without_a_pulse_motors_stand_and_servos_are_in_the_middle() {
    let packet = Packet::parse(&frame_16(0, &[0, 900, 1250, 2300])).expect("a frame");
    let expected = [(0.0, 0.0), (0.0, -1.0), (0.25, -0.5), (1.0, 1.0)];
    for (channel, (power, deflection)) in (1..).zip(expected) {
        assert!((packet.power(channel) - power).abs() < 1e-12, "{channel}");
        assert!(
            (packet.deflection(channel) - deflection).abs() < 1e-12,
            "{channel}"
        );
    }
    for channel in [0, 33, usize::MAX] {
        assert!(
            packet.deflection(channel).abs() < 1e-12,
            "there is no channel {channel}"
        );
    }
}

#[test]
fn hostile_packets_and_strangers_are_not_answered_and_disturb_nobody() {
    let counters = beside(VehicleKind::Copter, |socket| {
        let mut fake = Fake::new(socket);
        let felt = fake.exchange(&[1000; 4]);
        let stranger = Fake::new(socket);
        for bytes in [&b"hello"[..], &[0; 1500], &frame_16(0, &[2000; 4])] {
            stranger.send(bytes);
        }
        fake.send(&[1, 2, 3]);
        // All of it has been read when this is answered.
        let next = fake.exchange(&[1000; 4]);
        assert!(
            (next.time_s - felt.time_s - 0.0025).abs() < 1e-12,
            "{next:?}"
        );
        stranger.socket.set_nonblocking(true).expect("possible");
        assert!(
            stranger.socket.recv(&mut [0; 16]).is_err(),
            "a stranger is answered"
        );
    });
    assert_eq!((counters.frames, counters.refused), (2, 4));
}

#[test]
fn an_ardupilot_that_restarts_at_another_port_is_taken_up_when_the_old_one_is_silent() {
    let counters = beside(VehicleKind::Copter, |socket| {
        let mut old = Fake::new(socket);
        for _ in 0..10 {
            old.exchange(&[1900; 4]);
        }
        let felt = Fake::new(socket).insist(&[1000; 4]);
        assert!(
            (felt.time_s - 0.0025).abs() < 1e-12,
            "from the beginning: {felt:?}"
        );
    });
    assert_eq!((counters.frames, counters.restarts), (11, 1));
    assert!(counters.refused > 0, "at first it is a stranger");
}

#[test]
fn a_copter_lands_on_what_is_below_it() {
    let scene = room();
    let snapshot = Rays::new(&scene).at(maps::time::Stamp::ZERO);
    let height = |x: f64, y: f64| {
        let hit = snapshot.cast(nalgebra::Point3::new(x, y, 2.0), -Vector3::z(), 5.0);
        hit.map_or(0.0, |hit| 2.0 - hit.range_m)
    };
    // What stands on the table in the middle.
    let (x, y, top) = (1.3, 0.0, height(1.3, 0.0));
    assert!(
        top > 0.4 && (height(1.33, 0.03) - top).abs() < 1e-9,
        "{top} m"
    );
    let mut bridge = Bridge::new(setup(&scene, VehicleKind::Copter));
    let to = Vector3::new(y, x, -1.8);
    let (_, answer) = bridge.handle(&frame_16(0, &[0; 16])).expect("a frame");
    let mut felt = Felt::of(answer);
    for count in 1..8000 {
        let channels = if count < 6000 {
            fly(&felt, to)
        } else {
            vec![1000; 4]
        };
        let (_, answer) = bridge.handle(&frame_16(count, &channels)).expect("a frame");
        felt = Felt::of(answer);
    }
    assert!((-felt.position.z - top).abs() < 1e-6, "{felt:?} on {top} m");
    assert!(
        felt.range_m < 1e-6 && felt.velocity.norm() < 1e-12,
        "{felt:?}"
    );
}

#[test]
fn a_rovers_rangefinder_looks_ahead() {
    let scene = room();
    let mut bridge = Bridge::new(Setup {
        vehicle: VehicleKind::Rover,
        scene: &scene,
        // From the middle of the room towards a wall.
        start: Start {
            x_m: 1.3,
            y_m: 0.6,
            heading_deg: 0.0,
        },
    });
    let mut felt = |count| {
        let (_, answer) = bridge
            .handle(&frame_16(count, &[1500, 1500, 1700]))
            .expect("a frame");
        Felt::of(answer)
    };
    let first = felt(0);
    assert!(first.range_m < 3.0, "{first:?}");
    let last = (1..500).map(&mut felt).last().expect("some frames");
    let driven = last.position.x - first.position.x;
    assert!(driven > 0.3, "{last:?}");
    assert!(
        (first.range_m - last.range_m - driven).abs() < 1e-6,
        "{first:?} then {last:?}"
    );
}

/// `sitl bridge`, without `sitl`.
#[derive(clap::Parser, Debug)]
struct Program {
    #[command(flatten)]
    args: cli::Args,
}

#[test]
fn the_program_serves_until_its_duration_is_over_and_reports() {
    let free = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).and_then(|socket| socket.local_addr());
    let address = free.expect("a free port");
    let listen = address.to_string();
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("bridge.json");
    let arguments = [
        "sitl",
        "--vehicle",
        "copter",
        "--listen",
        &listen,
        "--duration",
        "0.5",
    ];
    let path = file.to_str().expect("it is text");
    let arguments = arguments.into_iter().chain(["--report", path]);
    let args = <Program as clap::Parser>::try_parse_from(arguments)
        .expect("arguments")
        .args;
    let stop = AtomicBool::new(false);
    thread::scope(|scope| {
        let run = thread::Builder::new().name("bridge".to_owned());
        let run = run
            .spawn_scoped(scope, || cli::run(&args, &stop))
            .expect("there are threads");
        let ends = Ends(&stop);
        let mut fake = Fake::to(address);
        fake.insist(&[1900; 4]);
        for _ in 0..199 {
            fake.exchange(&[1900; 4]);
        }
        run.join()
            .expect("it does not panic")
            .expect("it ends well");
        drop(ends);
    });
    let report = std::fs::read(&file).expect("there is a report");
    let report: serde_json::Value = serde_json::from_slice(&report).expect("JSON");
    assert_eq!(report["counters"]["frames"], 200);
    assert_eq!(
        (report["vehicle"].as_str(), report["scene"].as_str()),
        (Some("copter"), Some("room"))
    );
    assert!(
        report["highest_m"].as_f64().is_some_and(|high| high > 0.5),
        "{report}"
    );
}

#[test]
fn an_address_in_use_is_named_with_the_remedy() {
    let taken = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a free port");
    let address = taken.local_addr().expect("bound").to_string();
    let parse = |listen: &str| {
        let arguments = ["sitl", "--vehicle", "rover", "--listen", listen];
        <Program as clap::Parser>::try_parse_from(arguments)
    };
    let args = parse(&address).expect("arguments").args;
    let error = cli::run(&args, &AtomicBool::new(false)).expect_err("it is taken");
    let words = format!(
        "cannot listen at {address} (is another bridge there? then choose another --listen)"
    );
    assert_eq!(error.to_string(), words);
    let error = parse("nowhere").expect_err("nowhere is no address");
    assert!(
        error.to_string().contains("expected a port, such as 9002"),
        "{error}"
    );
}

#[test]
fn a_bridge_ends_when_so_much_time_was_simulated() {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a free port");
    let mut fake = Fake::new(&socket);
    // All frames wait in the socket: the loop ends by itself after the fourth.
    for _ in 0..10 {
        fake.send(&frame_16(fake.count, &[1000; 4]));
        fake.count += 1;
    }
    let scene = room();
    let mut bridge = Bridge::new(setup(&scene, VehicleKind::Rover));
    let stop = AtomicBool::new(false);
    let simulated = Some(Duration::from_millis(10));
    serve(
        &mut bridge,
        &socket,
        Until {
            stop: &stop,
            simulated,
        },
    )
    .expect("loopback works");
    assert_eq!(bridge.counters().frames, 4);
}

#[test]
fn no_bytes_make_it_panic() {
    let scene = room();
    let packets = prop::collection::vec(prop::collection::vec(any::<u8>(), 0..100), 1..20);
    proptest!(ProptestConfig::with_cases(64), |(packets in packets)| {
        let mut bridge = Bridge::new(setup(&scene, VehicleKind::Copter));
        for packet in &packets {
            if let Ok((_, answer)) = bridge.handle(packet) {
                Felt::of(answer);
            }
        }
        let Counters { frames, duplicates, refused, .. } = bridge.counters();
        prop_assert_eq!(frames + duplicates + refused, packets.len() as u64);
    });
}

#[test]
fn any_frames_are_answered_with_numbers() {
    let scene = room();
    let channels = prop::collection::vec(any::<u16>(), 16);
    let frames = prop::collection::vec((any::<u32>(), channels), 1..60);
    proptest!(ProptestConfig::with_cases(64), |(rover in any::<bool>(), wide in any::<bool>(), rate in 11_u16.., frames in frames)| {
        let vehicle = if rover { VehicleKind::Rover } else { VehicleKind::Copter };
        let mut bridge = Bridge::new(setup(&scene, vehicle));
        let magic = if wide { 29_569 } else { 18_458 };
        for (count, channels) in frames {
            if let Ok((_, answer)) = bridge.handle(&frame(magic, rate, count, &channels)) {
                let felt = Felt::of(answer);
                let numbers = felt.position.iter().chain(&felt.force).chain(&felt.gyro);
                prop_assert!(numbers.copied().all(f64::is_finite), "{:?}", felt);
                prop_assert!(felt.range_m >= 0.0);
            }
        }
    });
}
