use std::path::PathBuf;

use maps::frame::{Isometry, Point};
use maps::tile::TileId;
use maps::voxel::{MapDigest, Rgb, VoxelMap};
use mavlink_ext::dialect::tandem::{
    COMMAND_LONG_DATA, GPS_RAW_INT_DATA, HEARTBEAT_DATA, HOME_POSITION_DATA, MavAutopilot,
    MavResult, MavType, PARAM_REQUEST_LIST_DATA, TANDEM_ORIGIN_DATA, TANDEM_REPORT_DATA,
    TIMESYNC_DATA,
};
use mavlink_ext::object::digest::{Asker, Item};
use mavlink_ext::object::{Receiver, ReceiverLimits};
use nalgebra::{Isometry3, Matrix6};
use slam::Tracked;

use super::*;
use crate::config::Config;
use crate::pipeline::uav::MapFigures;
use crate::pipeline::{EncodedTile, TilesChanged};
use crate::report::Report;

const OWN: Address = Address::new(1, 191);
const AUTOPILOT: Address = Address::new(1, 1);
const STATION: Address = Address::new(255, 190);

fn at(ms: u64) -> Stamp {
    Stamp::from_nanos(ms * 1_000_000)
}

/// A companion and all that it did.
struct Bench {
    companion: Companion,
    sent: Vec<(LinkId, RawFrame)>,
    told: Vec<String>,
    reports: Vec<Report>,
    source_stopped: bool,
    exited: bool,
    autopilot: Encoder,
    station: Encoder,
}

impl Bench {
    fn new(change: impl FnOnce(&mut Config)) -> Self {
        let mut config = Config::default();
        config.source.path = PathBuf::from("flight.mcap");
        change(&mut config);
        let settings = config.check().expect("sound");
        let figures = Figures::new("flight", Some(2), &settings.mapping);
        Self {
            companion: Companion::new(&settings, figures, 7),
            sent: Vec::new(),
            told: Vec::new(),
            reports: Vec::new(),
            source_stopped: false,
            exited: false,
            autopilot: Encoder::new(AUTOPILOT),
            station: Encoder::new(STATION),
        }
    }

    fn step(&mut self, ms: u64, event: Event) {
        let Self {
            companion,
            sent,
            told,
            reports,
            source_stopped,
            exited,
            ..
        } = self;
        companion.step(at(ms), event, |action| match action {
            Action::Send(link, frame) => sent.push((link, frame)),
            Action::Log(_, text) => told.push(text),
            Action::WriteReport(report) => reports.push(*report),
            Action::StopSource => *source_stopped = true,
            Action::Exit => *exited = true,
        });
    }

    fn hear_autopilot(&mut self, ms: u64, message: &Message) -> RawFrame {
        let frame = self.autopilot.encode(message);
        self.step(ms, Event::Received(LinkId::Autopilot, frame.clone()));
        frame
    }

    fn hear_station(&mut self, ms: u64, message: &Message) -> RawFrame {
        let frame = self.station.encode(message);
        self.step(ms, Event::Received(LinkId::Ground, frame.clone()));
        frame
    }

    /// Messages of ours sent on this link so far, taken.
    fn take(&mut self, link: LinkId) -> Vec<Message> {
        let sent = std::mem::take(&mut self.sent);
        let ours = sent
            .iter()
            .filter(|(l, frame)| *l == link && frame.from() == OWN);
        ours.map(|(_, frame)| frame.decode().expect("our own"))
            .collect()
    }
}

fn autopilot_heartbeat() -> Message {
    Message::HEARTBEAT(HEARTBEAT_DATA {
        mavtype: MavType::MAV_TYPE_QUADROTOR,
        autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
        ..HEARTBEAT_DATA::default()
    })
}

fn station_heartbeat() -> Message {
    Message::HEARTBEAT(HEARTBEAT_DATA {
        mavtype: MavType::MAV_TYPE_GCS,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        ..HEARTBEAT_DATA::default()
    })
}

#[test]
fn a_peer_that_asks_for_the_time_is_answered_on_its_link() {
    let mut bench = Bench::new(|_| ());
    let request = Message::TIMESYNC(TIMESYNC_DATA {
        tc1: 0,
        ts1: 77,
        ..TIMESYNC_DATA::default()
    });
    bench.hear_autopilot(5, &request);
    let answers = bench.take(LinkId::Autopilot);
    let answer =
        |m: &Message| matches!(m, Message::TIMESYNC(t) if t.ts1 == 77 && t.tc1 == 5_000_000);
    assert!(answers.iter().any(answer), "{answers:?}");
}

#[test]
fn a_frame_that_comes_back_on_the_other_link_is_not_forwarded_again() {
    let mut bench = Bench::new(|_| ());
    let beat = bench.hear_autopilot(0, &autopilot_heartbeat());
    bench.sent.clear();
    bench.step(1, Event::Received(LinkId::Ground, beat));
    assert_eq!(bench.sent, []);
}

fn is_ours_only_for_the_ground(message: &Message) -> bool {
    TANDEM_IDS.contains(&message.message_id())
}

#[test]
fn an_onboard_controller_beats_once_a_second_on_both_links() {
    let mut bench = Bench::new(|_| ());
    for ms in (0..3000).step_by(10) {
        bench.step(ms, Event::Tick);
    }
    let beats = |bench: &Bench, link| {
        let on = bench.sent.iter().filter(move |(l, _)| *l == link);
        let decoded = on.map(|(_, frame)| frame.decode().expect("our own"));
        decoded
            .filter(|m| matches!(m, Message::HEARTBEAT(h) if h.mavtype == MavType::MAV_TYPE_ONBOARD_CONTROLLER))
            .count()
    };
    assert_eq!(beats(&bench, LinkId::Autopilot), 3);
    assert_eq!(beats(&bench, LinkId::Ground), 3);
}

#[test]
fn frames_are_forwarded_between_the_links_as_they_are() {
    let mut bench = Bench::new(|_| ());
    let beat = bench.hear_autopilot(0, &autopilot_heartbeat());
    assert!(bench.sent.contains(&(LinkId::Ground, beat)));
    let list = Message::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA {
        target_system: 1,
        target_component: 1,
    });
    let asked = bench.hear_station(1, &list);
    assert!(bench.sent.contains(&(LinkId::Autopilot, asked)));
}

#[test]
fn nothing_of_tandems_dialect_reaches_the_autopilot() {
    let mut bench = Bench::new(|config| config.links.ground_bytes_per_s = 1_000_000);
    bench.hear_autopilot(0, &autopilot_heartbeat());
    bench.hear_station(0, &station_heartbeat());
    let origin = Message::TANDEM_ORIGIN(TANDEM_ORIGIN_DATA::default());
    bench.hear_station(1, &origin);
    bench.step(2, Event::TilesChanged(changed_tiles(1).1));
    for ms in (10..3000).step_by(10) {
        bench.step(ms, Event::Tick);
    }
    let to_autopilot = |(link, _): &&(LinkId, RawFrame)| *link == LinkId::Autopilot;
    for (_, frame) in bench.sent.iter().filter(to_autopilot) {
        assert!(
            !TANDEM_IDS.contains(&frame.message_id()),
            "{}",
            frame.message_id()
        );
    }
    assert!(
        bench
            .take(LinkId::Ground)
            .iter()
            .any(is_ours_only_for_the_ground)
    );
}

#[test]
fn the_origin_is_asked_of_the_autopilot_and_told_once_a_second() {
    let mut bench = Bench::new(|_| ());
    bench.hear_autopilot(0, &autopilot_heartbeat());
    bench.step(10, Event::Tick);
    let asked = bench.take(LinkId::Autopilot);
    let wants_home = |m: &Message| matches!(m, Message::COMMAND_LONG(c) if c.command == cmd::REQUEST_MESSAGE && (c.param1 - 242.0).abs() < 0.1);
    assert!(asked.iter().any(wants_home), "{asked:?}");
    let home = Message::HOME_POSITION(HOME_POSITION_DATA {
        latitude: 470_000_000,
        longitude: 80_000_000,
        altitude: 400_000,
        ..HOME_POSITION_DATA::default()
    });
    bench.hear_autopilot(20, &home);
    let fix = Message::GPS_RAW_INT(GPS_RAW_INT_DATA {
        alt: 400_000,
        alt_ellipsoid: 447_000,
        ..GPS_RAW_INT_DATA::default()
    });
    bench.hear_autopilot(25, &fix);
    for ms in (30..3030).step_by(10) {
        bench.step(ms, Event::Tick);
    }
    let told = bench.take(LinkId::Ground);
    let origins: Vec<_> = told
        .iter()
        .filter_map(|m| match m {
            Message::TANDEM_ORIGIN(origin) => Some((origin.lat, origin.lon, origin.alt)),
            _ => None,
        })
        .collect();
    assert!((2..=3).contains(&origins.len()), "{origins:?}");
    assert!(
        origins
            .iter()
            .all(|&o| o == (470_000_000, 80_000_000, 447_000))
    );
}

#[track_caller]
fn check_command(command: u16, param1: f32, component: u8, expected: Option<MavResult>) {
    let mut bench = Bench::new(|_| ());
    let request = Message::COMMAND_LONG(COMMAND_LONG_DATA {
        param1,
        command,
        target_system: 1,
        target_component: component,
        ..COMMAND_LONG_DATA::default()
    });
    bench.hear_station(5, &request);
    let answers = bench.take(LinkId::Ground);
    let ack = answers.iter().find_map(|m| match m {
        Message::COMMAND_ACK(ack) => Some((ack.command, ack.result, ack.target_system)),
        _ => None,
    });
    assert_eq!(
        ack,
        expected.map(|result| (command, result, 255)),
        "{command} to 1/{component}"
    );
    if expected == Some(MavResult::MAV_RESULT_ACCEPTED) {
        assert!(
            answers.iter().any(is_ours_only_for_the_ground),
            "{answers:?}"
        );
    }
}

#[test]
fn on_a_ground_link_that_loses_a_command_is_obeyed_once_and_acknowledged_several_times() {
    let mut bench = Bench::new(|_| ());
    for number in 0..100 {
        let report = Message::TANDEM_REPORT(TANDEM_REPORT_DATA::default());
        if number % 5 == 0 {
            bench.station.encode(&report); // Lost.
        } else {
            bench.hear_station(number, &report);
        }
    }
    bench.sent.clear();
    let command = bench.hear_station(
        1000,
        &Message::COMMAND_LONG(COMMAND_LONG_DATA {
            command: 31_010,
            target_system: OWN.system.0,
            target_component: OWN.component.0,
            ..COMMAND_LONG_DATA::default()
        }),
    );
    bench.step(1050, Event::Tick);
    bench.step(1060, Event::Received(LinkId::Ground, command));
    bench.step(1070, Event::Tick);
    let acks = bench.sent.iter().map(|(_, frame)| frame);
    let acks: Vec<&RawFrame> = acks.filter(|frame| frame.message_id() == 77).collect();
    assert_eq!(
        acks.len(),
        1 + 4 + 1,
        "at once, four copies, and one for the copy that came"
    );
    assert!(
        acks.iter().all(|ack| *ack == acks[0]),
        "the same frame: obeyed once"
    );
}

#[test]
fn commands_to_us_are_acknowledged_and_those_to_others_are_not() {
    let (status, origin) = (54_107.0, 54_100.0);
    check_command(
        cmd::REQUEST_MESSAGE,
        status,
        191,
        Some(MavResult::MAV_RESULT_ACCEPTED),
    );
    check_command(
        cmd::REQUEST_MESSAGE,
        origin,
        191,
        Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED),
    );
    check_command(
        cmd::REQUEST_MESSAGE,
        f32::NAN,
        191,
        Some(MavResult::MAV_RESULT_UNSUPPORTED),
    );
    check_command(
        cmd::COMPONENT_ARM_DISARM,
        1.0,
        191,
        Some(MavResult::MAV_RESULT_UNSUPPORTED),
    );
    check_command(cmd::COMPONENT_ARM_DISARM, 1.0, 1, None);
    check_command(cmd::COMPONENT_ARM_DISARM, 1.0, 0, None);
}

fn frame_done(ms: u64, state: State) -> Event {
    Event::FrameDone(Box::new(FrameDone {
        released: at(ms),
        tracked: Some(Tracked {
            at: at(ms),
            state,
            world_from_camera: Isometry::claim(Isometry3::translation(1.0, 2.0, 1.5)),
            covariance: Matrix6::identity() * 1e-4,
            reset_counter: 0,
            points: 200,
            rejected: 0,
            moving_share: 0.0,
            keyframe: false,
        }),
        keyframes: 0,
        tracking: Duration::from_millis(20),
        mapping: Duration::ZERO,
    }))
}

#[test]
fn the_autopilot_gets_odometry_at_thirty_hertz_at_most() {
    let mut bench = Bench::new(|_| ());
    for ms in (1000..2000).step_by(10) {
        bench.step(ms, frame_done(ms, State::Tracking));
    }
    let odometry = |m: &Message| matches!(m, Message::ODOMETRY(o) if o.quality == 100);
    let sent = bench
        .take(LinkId::Autopilot)
        .iter()
        .filter(|m| odometry(m))
        .count();
    assert!((25..=31).contains(&sent), "{sent} in a second");
}

#[test]
fn the_operator_is_told_once_when_the_camera_is_lost_and_found() {
    let mut bench = Bench::new(|_| ());
    let lost = State::Lost { since: at(100) };
    for (ms, state) in [
        (33, State::Tracking),
        (66, State::Tracking),
        (100, lost),
        (133, lost),
        (166, State::Tracking),
    ] {
        bench.step(ms, frame_done(ms, state));
    }
    assert_eq!(
        bench.told,
        ["camera lost its place", "camera found its place again"]
    );
    let texts = bench.take(LinkId::Ground);
    let texts = texts.iter().filter(|m| matches!(m, Message::STATUSTEXT(_)));
    assert_eq!(texts.count(), 2);
}

#[test]
fn a_silent_autopilot_is_told() {
    let mut bench = Bench::new(|_| ());
    bench.hear_autopilot(0, &autopilot_heartbeat());
    for ms in (0..10_000).step_by(100) {
        bench.step(ms, Event::Tick);
    }
    assert_eq!(bench.told, ["autopilot heard", "autopilot is silent"]);
}

/// A small map with this many tiles, and its tiles ready for the wire.
fn changed_tiles(count: i32) -> (VoxelMap, TilesChanged) {
    let mut map = VoxelMap::new(0.1);
    let hits: Vec<_> = (0..count)
        .flat_map(|tile| {
            (0..20).map(move |i| Point::new(f64::from(tile) * 12.8 + 1.0, f64::from(i) * 0.1, 0.5))
        })
        .collect();
    let colors = vec![Rgb([200, 100, 50]); hits.len()];
    for origin in [Point::new(1.0, 1.0, 2.0), Point::new(2.0, 2.0, 2.0)] {
        map.insert_scan(&maps::scan::Scan {
            colors: &colors,
            max_range_m: 100.0,
            ..maps::scan::Scan::new(origin, &hits)
        });
    }
    let ids: Vec<TileId> = map.take_changed_tiles();
    let encoded = |id: TileId| {
        let mut tile = map.tile(id).expect("known");
        tile.version = 1;
        EncodedTile {
            id,
            version: 1,
            bytes: tile.encode(),
        }
    };
    let tiles: Vec<_> = ids.into_iter().map(encoded).collect();
    let figures = MapFigures {
        digest: map.digest(),
        tiles: tiles.len(),
        voxels_occupied: map.occupied_count(),
        voxels_known: map.known_count(),
    };
    (
        map,
        TilesChanged {
            map: figures,
            tiles,
        },
    )
}

/// Runs a companion against a ground station that hears the share `heard` of its frames; the station's map afterwards.
fn fly_over(
    heard: impl Fn(usize) -> bool,
    bench: &mut Bench,
    from_ms: u64,
    session: u32,
) -> VoxelMap {
    let mut station = Receiver::new(STATION, session, ReceiverLimits::default());
    let mut asker = Asker::new(STATION, session);
    let mut map = VoxelMap::new(0.1);
    let mut count = 0;
    for ms in (from_ms..from_ms + 20_000).step_by(10) {
        if ms % 1000 == 0 {
            bench.hear_station(ms, &station_heartbeat());
        }
        bench.step(ms, Event::Tick);
        let mut reports = station.tick(at(ms)).send;
        reports.extend(asker.tick(at(ms)));
        for message in bench.take(LinkId::Ground) {
            count += 1;
            if !heard(count) {
                continue;
            }
            asker.handle(at(ms), OWN, &message);
            let step = station.handle(at(ms), OWN, &message);
            reports.extend(step.send);
            for received in step.events {
                let tile = maps::tile::Tile::decode(&received.bytes).expect("sound");
                map.set_tile(&tile).expect("of this resolution");
                let item = Item::new(tile.version, &received.bytes);
                asker.has(at(ms), OWN, tile.id, item);
            }
        }
        for report in reports {
            bench.hear_station(ms, &report);
        }
    }
    map
}

#[test]
fn the_map_arrives_over_a_link_that_loses_a_fifth() {
    let mut bench = Bench::new(|_| ());
    let (map, changed) = changed_tiles(3);
    bench.step(0, Event::TilesChanged(changed));
    let arrived = fly_over(|count| count % 5 != 0, &mut bench, 0, 1);
    assert_eq!(arrived.digest(), map.digest());
    bench.step(30_000, Event::Stop);
    assert!(
        bench.source_stopped && !bench.exited,
        "the map is finished first"
    );
    let ended = SourceEnded {
        ending: Ending::Stopped,
        ate: None,
        map: MapFigures {
            digest: map.digest(),
            tiles: 3,
            voxels_occupied: map.occupied_count(),
            voxels_known: map.known_count(),
        },
        floor: None,
        losses: None,
        detector: None,
    };
    bench.step(30_010, Event::SourceEnded(ended));
    assert!(bench.exited);
    let report = bench.reports.last().expect("written at the end");
    assert_eq!(report.map_digest, map.digest().to_string());
    assert_eq!(report.tiles_delivered, map.tile_ids().len());
    assert_eq!(report.tiles_sent, map.tile_ids().len() as u64);
    assert!(report.bytes_on_wire > 0 && !report.source_finished);
}

#[test]
fn a_ground_station_that_comes_late_or_again_gets_the_whole_map() {
    let mut bench = Bench::new(|_| ());
    let (map, changed) = changed_tiles(2);
    bench.step(0, Event::TilesChanged(changed));
    for ms in (0..5000).step_by(10) {
        bench.step(ms, Event::Tick);
    }
    assert_eq!(
        fly_over(|_| true, &mut bench, 5000, 1).digest(),
        map.digest(),
        "late"
    );
    assert_eq!(
        fly_over(|_| true, &mut bench, 25_000, 2).digest(),
        map.digest(),
        "again"
    );
}

#[test]
fn the_report_is_written_when_the_recording_is_over_and_the_map_is_still_served() {
    let mut bench = Bench::new(|_| ());
    bench.step(10, frame_done(10, State::Tracking));
    let empty = VoxelMap::new(0.05);
    let ended = SourceEnded {
        ending: Ending::Finished,
        ate: Some(crate::output::Ate {
            rmse_m: 0.1,
            frames: 1,
        }),
        map: MapFigures {
            digest: empty.digest(),
            tiles: 0,
            voxels_occupied: 0,
            voxels_known: 0,
        },
        floor: None,
        losses: None,
        detector: None,
    };
    bench.step(20, Event::SourceEnded(ended));
    let [report] = &bench.reports[..] else {
        panic!("one report, not {}", bench.reports.len());
    };
    assert!(report.source_finished && !bench.exited);
    assert_eq!((report.frames, report.frames_tracked), (1, 1));
    assert!((report.slam_fps - 50.0).abs() < 1e-9, "20 ms a frame");
    bench.step(2000, Event::Tick);
    let told = bench.take(LinkId::Ground);
    let finished =
        |m: &Message| matches!(m, Message::TANDEM_STATUS(s) if s.flags & 1 == 1 && s.frames == 1);
    assert!(told.iter().any(finished), "{told:?}");
    bench.step(3000, Event::Stop);
    assert!(bench.exited && bench.reports.len() == 2);
}

#[test]
fn a_camera_that_fails_is_told_and_the_map_is_kept() {
    let mut bench = Bench::new(|_| ());
    let ended = SourceEnded {
        ending: Ending::Failed("rgb/7.jpg is damaged".into()),
        ate: None,
        map: MapFigures {
            digest: MapDigest(1),
            tiles: 1,
            voxels_occupied: 2,
            voxels_known: 3,
        },
        floor: None,
        losses: None,
        detector: None,
    };
    bench.step(20, Event::SourceEnded(ended));
    assert_eq!(
        bench.told,
        ["rgb/7.jpg is damaged", "camera source failed, map is kept"]
    );
    assert_eq!(
        bench.reports[0].source_error.as_deref(),
        Some("rgb/7.jpg is damaged")
    );
    assert_eq!(
        bench.companion.ending(),
        Some(&Ending::Failed("rgb/7.jpg is damaged".into()))
    );
}

#[test]
fn frames_of_any_content_do_no_harm() {
    let mut bench = Bench::new(|_| ());
    let mut encoder = Encoder::new(Address::new(3, 77));
    for info in mavlink_ext::dialect::CATALOGUE {
        let Some(message) = Message::default_message_from_id(info.id) else {
            continue;
        };
        let frame = encoder.encode(&message);
        for link in LinkId::ALL {
            bench.step(1, Event::Received(link, frame.clone()));
        }
    }
}
