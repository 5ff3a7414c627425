//! The map of a companion on its way into the station's.

use super::*;

/// Some ground with a colour.
pub(super) fn floor() -> VoxelMap {
    let mut map = VoxelMap::new(0.1);
    let range = -25..25;
    let hits: Vec<_> = range
        .clone()
        .flat_map(|x| {
            range
                .clone()
                .map(move |y| Point::new(f64::from(x) * 0.1 + 0.05, f64::from(y) * 0.1 + 0.05, 0.0))
        })
        .collect();
    let colors = vec![Rgb([90, 120, 150]); hits.len()];
    map.insert_scan(&Scan {
        colors: &colors,
        max_range_m: 10.0,
        ..Scan::new(Point::new(0.0, 0.0, 1.5), &hits)
    });
    map
}

/// Sends a map as a companion does, over a perfect link.
pub(super) fn deliver_map(bench: &mut Bench, map: &VoxelMap) {
    deliver_map_in_session(bench, map, 7);
}

fn deliver_map_in_session(bench: &mut Bench, map: &VoxelMap, session: u16) {
    let ends = Ends {
        own: COMPANION,
        peer: bench.model().config.address(),
    };
    let mut sender = Sender::new(bench.now, ends, session, SenderSettings::default());
    for id in map.tile_ids() {
        let mut tile = map.tile(id).expect("known");
        tile.version = 1;
        let id = ObjectId::of_tile(id, 1).expect("near the origin");
        let object = Object {
            id,
            service: Service::Reliable,
            bytes: tile.encode(),
        };
        sender.offer(bench.now, object).expect("there is room");
    }
    for _ in 0..300 {
        bench.now += Duration::from_millis(20);
        for message in sender.tick(bench.now).send {
            bench.hear(COMPANION, &message);
        }
        bench.feed(Event::Tick);
        for message in std::mem::take(&mut bench.sent) {
            for answer in sender
                .handle(bench.now, bench.model().config.address(), &message)
                .send
            {
                bench.hear(COMPANION, &answer);
            }
        }
        if sender.is_idle() {
            break;
        }
    }
    assert!(sender.is_idle(), "every tile is delivered");
}

fn status(digest: u64, flags: u8) -> Message {
    Message::TANDEM_STATUS(TANDEM_STATUS_DATA {
        map_digest: digest,
        flags,
        ..TANDEM_STATUS_DATA::default()
    })
}

#[test]
fn a_companion_is_asked_what_is_new_on_its_map_but_not_in_a_replay() {
    for (source, questions) in [(Source::Live, 1), (Source::Replay, 0)] {
        let mut bench = Bench::new(source);
        bench.hear(COMPANION, &status(1, 0));
        bench.feed(Event::Tick);
        let asked = bench.sent.iter().filter(|message| {
            matches!(message, Message::TANDEM_DIGEST(digest)
                if digest.target_system == COMPANION.system.0)
        });
        assert_eq!(asked.count(), questions);
    }
}

#[test]
fn what_a_companion_that_starts_anew_maps_replaces_what_is_here() {
    let mut bench = Bench::new(Source::Live);
    deliver_map(&mut bench, &floor());
    let mut other = floor();
    let hits = [Point::new(0.55, 0.55, 0.75)];
    other.insert_scan(&Scan::new(Point::new(0.0, 0.0, 1.5), &hits));
    // Its versions begin at one again.
    deliver_map_in_session(&mut bench, &other, 8);
    let here = bench.model().map.voxels.as_ref();
    assert_eq!(here.map(VoxelMap::digest), Some(other.digest()));
}

#[test]
fn a_companions_camera_is_where_its_odometry_says_while_that_is_sound() {
    let mut bench = Bench::new(Source::Live);
    let odometry = Odometry {
        at: Stamp::ZERO,
        world_from_body: Isometry::claim(nalgebra::Isometry3::translation(1.0, 2.0, 3.0)),
        velocity: None,
        turn_rate: None,
        covariance: None,
        reset_counter: 0,
        quality: 90,
    };
    let told = odometry_message(&odometry);
    let place = |bench: &Bench| {
        let companion = bench.model().map.companions.get(&COMPANION)?;
        Some(companion.world_from_body?.value.translation())
    };
    bench.hear(COMPANION, &Message::ODOMETRY(told.clone()));
    assert_eq!(place(&bench), None, "nobody that builds a map");
    bench.hear(COMPANION, &status(0, 0));
    bench.hear(COMPANION, &Message::ODOMETRY(told.clone()));
    let failed = ODOMETRY_DATA {
        quality: -1,
        x: 9.0,
        ..told
    };
    bench.hear(COMPANION, &Message::ODOMETRY(failed));
    let error = place(&bench).expect("told") - Point::new(1.0, 2.0, 3.0);
    assert!(error.norm() < 1e-6, "{error:?}");
}

#[test]
fn a_camera_that_has_lost_its_place_is_a_caution_until_the_recording_ends() {
    let mut bench = Bench::new(Source::Live);
    let lost = |flags| {
        Message::TANDEM_STATUS(TANDEM_STATUS_DATA {
            tracking: TandemTracking::TANDEM_TRACKING_LOST as u8,
            flags,
            ..TANDEM_STATUS_DATA::default()
        })
    };
    let is_told = |bench: &Bench| {
        let is_it = |(level, text): &(Level, String)| {
            *level == Level::Caution && text.contains("lost its place")
        };
        bench.alerts().iter().any(is_it)
    };
    bench.hear(COMPANION, &status(0, 0));
    bench.silence(Duration::from_millis(100));
    assert!(!is_told(&bench));
    bench.hear(COMPANION, &lost(0));
    bench.silence(Duration::from_millis(100));
    assert!(is_told(&bench));
    bench.hear(COMPANION, &lost(1));
    bench.silence(Duration::from_millis(100));
    assert!(!is_told(&bench));
}

#[test]
fn a_map_that_was_received_whole_is_equal_by_its_digest() {
    let mut bench = Bench::new(Source::Live);
    let map = floor();
    deliver_map(&mut bench, &map);
    bench.hear(COMPANION, &status(map.digest().0, 0));
    bench.silence(Duration::from_secs(2));
    assert_eq!(
        bench.model().map.agreement(),
        Agreement::Arriving,
        "not finished"
    );
    bench.hear(COMPANION, &status(map.digest().0, 1));
    assert_eq!(bench.model().map.agreement(), Agreement::Equal);
    assert_eq!(
        bench.model().map.digest.map(|digest| digest.value),
        Some(map.digest())
    );
    bench.silence(Duration::from_secs(5));
    bench.hear(COMPANION, &status(map.digest().0 ^ 1, 1));
    bench.silence(Duration::from_millis(100));
    assert_eq!(bench.model().map.agreement(), Agreement::Differs);
    assert!(
        bench
            .alerts()
            .iter()
            .any(|(level, _)| *level == Level::Caution)
    );
}
