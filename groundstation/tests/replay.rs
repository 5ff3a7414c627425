//! Recorded telemetry through the same step as live telemetry, drawn without a window.

use std::fs::File;
use std::io::{BufReader, Cursor};
use std::path::{Path, PathBuf};
use std::time::Duration;

use groundstation::config::Config;
use groundstation::model::{Model, Source};
use groundstation::modes::{Kind, Mode};
use groundstation::replay::{Replay, ReplayError, Steer};
use groundstation::station::{Event, Station};
use maps::time::Stamp;
use mavlink_ext::dialect::tandem::{HEARTBEAT_DATA, MavAutopilot, MavModeFlag, MavState, MavType};
use mavlink_ext::tlog::TlogWriter;
use mavlink_ext::{Address, Encoder, Message, SystemId};

/// A recording of real telemetry; `None`, with a note, where the data is absent.
#[expect(clippy::print_stdout, reason = "says that nothing was tested")]
fn recorded(name: &str) -> Option<Replay> {
    let path: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../shared/data/telemetry")
        .join(name);
    let Ok(file) = File::open(&path) else {
        println!("{} is absent: nothing is tested", path.display());
        return None;
    };
    Some(Replay::read(BufReader::new(file)).expect("a recording"))
}

/// A rover in AUTO, once a second from 0 to 9 s, disarmed from 5 s on.
fn generated() -> Replay {
    let mut log = TlogWriter::new(Vec::new());
    let mut encoder = Encoder::new(Address::new(2, 1));
    for second in 0..10 {
        let mut base_mode = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
        base_mode.set(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED, second < 5);
        let heartbeat = HEARTBEAT_DATA {
            custom_mode: 10,
            mavtype: MavType::MAV_TYPE_GROUND_ROVER,
            autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
            base_mode,
            system_status: MavState::MAV_STATE_ACTIVE,
            mavlink_version: 3,
        };
        let frame = encoder.encode(&Message::HEARTBEAT(heartbeat));
        log.write(1_700_000_000_000_000 + second * 1_000_000, &frame)
            .expect("to memory");
    }
    Replay::read(Cursor::new(log.into_inner())).expect("a recording")
}

/// The station after `span` of real time of a replay.
fn play(station: &mut Station, replay: &mut Replay, span: Duration) {
    let advance = replay.advance(span);
    if advance.restart {
        station.restart();
    }
    for (at, frame) in advance.frames {
        let event = Event::Frame {
            link: 0,
            frame: frame.clone(),
        };
        station.step(*at, event, &mut |action| {
            panic!("a replay does nothing: {action:?}")
        });
    }
    station.step(advance.now, Event::Tick, &mut |action| {
        panic!("a replay does nothing: {action:?}")
    });
}

fn station(replay: &Replay) -> Station {
    Station::new(Model::new(
        Config::default(),
        Source::Replay,
        replay.epoch_unix_us(),
    ))
}

fn is_armed(station: &Station) -> bool {
    station.model().vehicles[&SystemId(2)].is_armed()
}

#[test]
fn a_replay_shows_what_was_so_at_each_moment_however_one_gets_there() {
    let mut replay = generated();
    let mut station = station(&replay);
    play(&mut station, &mut replay, Duration::from_secs(2));
    assert!(is_armed(&station));
    assert_eq!(
        station.model().vehicles[&SystemId(2)].heartbeat.value.mode,
        Mode::Auto
    );
    replay.steer(Steer::Seek(Duration::from_secs(7)));
    play(&mut station, &mut replay, Duration::ZERO);
    assert!(!is_armed(&station));
    replay.steer(Steer::Seek(Duration::from_secs(3)));
    play(&mut station, &mut replay, Duration::ZERO);
    assert!(is_armed(&station), "wound back");
    assert_eq!(replay.position(), Stamp::ZERO + Duration::from_secs(3));
}

#[test]
fn a_replay_runs_as_fast_as_it_is_told_and_stops_at_its_end() {
    let mut replay = generated();
    replay.steer(Steer::Speed(4.0));
    replay.advance(Duration::from_secs(1));
    assert_eq!(replay.position(), Stamp::ZERO + Duration::from_secs(4));
    replay.steer(Steer::Pause);
    replay.advance(Duration::from_secs(1));
    assert_eq!(replay.position(), Stamp::ZERO + Duration::from_secs(4));
    replay.steer(Steer::Play);
    replay.advance(Duration::from_mins(1));
    assert!(replay.is_at_end() && !replay.is_playing());
    assert_eq!(replay.position(), replay.length());
}

#[test]
fn what_is_no_recording_is_refused() {
    for bytes in [
        &b""[..],
        b"this is no telemetry log, but it is long enough to look like one",
    ] {
        assert!(matches!(
            Replay::read(bytes),
            Err(ReplayError::Empty { .. })
        ));
    }
}

#[test]
fn a_file_of_mostly_damage_is_no_recording() {
    let record = |unix_us: u64| {
        let frame =
            Encoder::new(Address::new(1, 1)).encode(&Message::HEARTBEAT(HEARTBEAT_DATA::default()));
        [&unix_us.to_be_bytes()[..], frame.bytes()].concat()
    };
    let mut log = Vec::new();
    for second in 0..9 {
        log.extend(record(1_700_000_000_000_000 + second * 1_000_000));
    }
    assert!(Replay::read(&log[..]).is_ok());
    log.extend([0x55; 40]);
    log.extend(record(1_700_000_010_000_000));
    log.extend([0x55; 40]);
    let refused = Replay::read(&log[..]).err().map(|error| error.to_string());
    assert!(refused.is_some_and(|text| text.contains(".ulg")));
}

#[test]
fn a_recorded_copter_mission_ends_where_it_began() {
    let Some(mut replay) = recorded("sitl_copter_quad_mission.tlog") else {
        return;
    };
    let mut station = station(&replay);
    replay.steer(Steer::Seek(Duration::from_hours(1)));
    play(&mut station, &mut replay, Duration::ZERO);
    let copter = &station.model().vehicles[&SystemId(1)];
    assert_eq!(copter.kind, Kind::Copter);
    let place = copter.position.expect("it has satellites").value.raw;
    assert!(place.x.hypot(place.y) < 1.0, "{place:?}");
    assert!(copter.track.len() > 100 && !copter.is_armed());
    assert!(copter.mission.is_some_and(|mission| mission.value.complete));
}

#[test]
fn a_recorded_submarine_without_a_fix_is_shown_all_the_same() {
    let Some(mut replay) = recorded("mavlink-server_00025-2024-04-22.tlog") else {
        return;
    };
    let mut station = station(&replay);
    replay.steer(Steer::Seek(Duration::from_secs(100)));
    play(&mut station, &mut replay, Duration::ZERO);
    let submarine = station.model().active_vehicle().expect("a vehicle");
    assert_eq!(submarine.kind, Kind::Submarine);
    assert!(submarine.attitude.is_some() && submarine.battery.is_some());
    assert!(station.model().log.iter().len() > 0);
}
