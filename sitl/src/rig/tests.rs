use std::collections::BTreeMap;

use maps::frame::Isometry;
use sensors::ros::Image;
use sensors::ros::points::decode_places;
use sensors::ros::vehicle::{Imu, NavSatFix, Odometry, decode_time_reference};

use super::*;
use crate::platform;

const SECOND: Stamp = Stamp::from_nanos(1_000_000_000);

fn origin() -> Origin {
    "50.7277,7.0866,110".parse().expect("a place")
}

fn street() -> Setup {
    Setup::new(Name::ResidentialAlley, 3, origin())
}

/// One with these sensors.
fn with(aboard: &[&str]) -> Setup {
    let mut setup = street();
    setup.aboard = aboard.iter().map(|&name| name.to_owned()).collect();
    setup
}

fn run(setup: &Setup, until: Stamp) -> Vec<Packet> {
    let scene = Scene::generate(setup.scene, setup.seed);
    let mut rig = Rig::new(&scene, setup, Duration::from_mins(1)).expect("sensors that there are");
    rig.until(until)
}

fn of<'a>(packets: &'a [Packet], topic: &'a str) -> impl Iterator<Item = &'a Packet> {
    packets.iter().filter(move |packet| packet.topic == topic)
}

#[test]
fn a_second_of_a_street_has_as_many_messages_of_each_sensor_as_its_rate_says() {
    let packets = run(&street(), SECOND);
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for packet in &packets {
        *counts.entry(&packet.topic).or_default() += 1;
    }
    let expected = [
        ("/tf", 100),
        ("/tf_static", 2),
        ("/uav/camera/color/camera_info", 1),
        ("/uav/camera/color/image_raw", 15),
        ("/uav/camera/depth/image_rect_raw", 15),
        ("/uav/ground_truth/pose", 15),
        ("/uav/ground_truth/odom", 50),
        ("/uav/clock/reference", 1),
        ("/uav/imu/data_raw", 200),
        ("/uav/gnss/fix", 5),
        ("/uav/barometer/pressure", 25),
        ("/uav/rangefinder/range", 20),
        ("/ugv/ground_truth/odom", 50),
        ("/ugv/clock/reference", 1),
        ("/ugv/imu/data_raw", 200),
        ("/ugv/gnss/fix", 5),
        ("/ugv/wheels/joint_states", 50),
        // A sweep that starts before the end is complete after it.
        ("/ugv/lidar/points", 9),
        ("/ugv/radar/points", 14),
        ("/ugv/camera_front/camera_info", 1),
        ("/ugv/camera_front/image_raw/compressed", 10),
        ("/ugv/camera_left/camera_info", 1),
        ("/ugv/camera_left/image_raw/compressed", 10),
        ("/ugv/camera_rear/camera_info", 1),
        ("/ugv/camera_rear/image_raw/compressed", 10),
        ("/ugv/camera_right/camera_info", 1),
        ("/ugv/camera_right/image_raw/compressed", 10),
    ];
    assert_eq!(counts, expected.into());
    let in_order = packets
        .windows(2)
        .all(|pair| pair[0].logged <= pair[1].logged);
    assert!(in_order, "as they come in");
    let color = of(&packets, "/uav/camera/color/image_raw")
        .next()
        .expect("a picture");
    let image = Image::decode(&color.bytes).expect("our own");
    assert_eq!(
        (image.width, image.height, image.encoding),
        (640, 480, "rgb8")
    );
}

#[test]
fn inertial_units_feel_gravity_and_how_the_vehicle_moves() {
    let setup = with(&["uav/imu", "ugv/imu"]);
    let scene = Scene::generate(setup.scene, setup.seed);
    let packets = run(&setup, Stamp::from_nanos(8_000_000_000));
    for (platform, topic) in [
        (Platform::Uav, "/uav/imu/data_raw"),
        (Platform::Ugv, "/ugv/imu/data_raw"),
    ] {
        let readings: Vec<_> = of(&packets, topic)
            .map(|p| Imu::decode(&p.bytes).expect("our own"))
            .collect();
        let count = readings.len() as f64;
        let force = readings
            .iter()
            .map(|r| r.specific_force.norm())
            .sum::<f64>()
            / count;
        assert!((force - 9.81).abs() < 0.1, "{topic}: {force}");
        // Rates add up to how far the vehicle has turned.
        let turned: f64 = readings.iter().map(|r| r.rates.z / 200.0).sum();
        let heading = |at| platform.motion(&scene, at, setup.seed).0.heading_rad();
        let truth = heading(Stamp::from_nanos(8_000_000_000)) - heading(Stamp::ZERO);
        assert!(
            (turned - truth).abs() < 0.05,
            "{topic}: {turned} against {truth}"
        );
    }
}

#[test]
fn fixes_are_near_where_the_vehicle_was_at_their_stamp() {
    let setup = with(&["uav/gnss"]);
    let scene = Scene::generate(setup.scene, setup.seed);
    let packets = run(&setup, Stamp::from_nanos(3_000_000_000));
    let mut fixes = 0;
    for packet in of(&packets, "/uav/gnss/fix") {
        let fix = NavSatFix::decode(&packet.bytes).expect("our own");
        let truth = platform::uav(&scene, fix.at, setup.seed).translation();
        if fix.status < 0 {
            continue;
        }
        fixes += 1;
        let place = crate::wgs84::Geodetic {
            lat_deg: fix.latitude_deg,
            lon_deg: fix.longitude_deg,
            alt_m: fix.altitude_m,
        };
        let off = (setup.origin.to_world(place) - truth).raw.norm();
        let sigma = fix.variances_m2.iter().sum::<f64>().sqrt();
        assert!(off < 6.0 * sigma.max(0.05), "{off} m, it says {sigma}");
        assert!(
            packet.logged.since(fix.at) >= Duration::from_millis(100),
            "fixes come late"
        );
    }
    assert!(fixes > 5, "{fixes} fixes");
}

#[test]
fn points_of_the_lidar_lie_on_the_road_below_the_vehicle() {
    let packets = run(&with(&["ugv/lidar"]), Stamp::from_nanos(150_000_000));
    let cloud = of(&packets, "/ugv/lidar/points").next().expect("a sweep");
    let places = decode_places(&cloud.bytes)
        .expect("our own")
        .expect("x, y, z");
    assert!(places.points.len() > 15_000, "{}", places.points.len());
    let near = places
        .points
        .iter()
        .filter(|p| p[0].hypot(p[1]) < 4.0 && p[2] < -1.0);
    let heights: Vec<f32> = near.map(|p| p[2] + 1.2).collect();
    assert!(heights.len() > 500);
    let mean = heights.iter().sum::<f32>() / heights.len() as f32;
    assert!(mean.abs() < 0.1, "{mean} m above the road");
}

#[test]
fn a_clock_that_is_off_stamps_every_message_of_its_vehicle_and_no_other() {
    let mut setup = with(&[
        "uav/imu",
        "uav/gnss",
        "uav/barometer",
        "ugv/imu",
        "ugv/wheels",
    ]);
    setup.clocks[0] = ClockModel {
        start: Stamp::from_nanos(5_000_000_000),
        ..ClockModel::CRYSTAL
    };
    let packets = run(&setup, Stamp::from_nanos(2_500_000_000));
    for packet in &packets {
        let off = packet.at.as_nanos().cast_signed() - packet.logged.as_nanos().cast_signed();
        let expected = if packet.topic.starts_with("/uav") {
            5_000_000_000
        } else {
            0
        };
        if !packet.topic.starts_with("/tf") {
            // Sweeps and fixes are complete up to 0.14 s after the moment that they are of.
            assert!(
                (expected - 150_000_000..expected + 1_000_000).contains(&off),
                "{}: {off} ns",
                packet.topic
            );
        }
    }
    let reference = of(&packets, "/uav/clock/reference")
        .nth(2)
        .expect("one a second");
    let (shown, truth) = decode_time_reference(&reference.bytes).expect("our own");
    assert_eq!(truth, Stamp::from_nanos(2_000_000_000));
    let fast_ns = shown.as_nanos().cast_signed() - 7_000_000_000;
    assert!(
        (fast_ns - 40_000).abs() < 2_000,
        "20 ppm for 2 s: {fast_ns}"
    );
}

#[test]
fn a_fault_breaks_its_sensor_for_its_span_and_changes_no_other() {
    let aboard = [
        "uav/imu",
        "uav/gnss",
        "uav/barometer",
        "uav/rangefinder",
        "ugv/imu",
        "ugv/lidar",
        "ugv/radar",
    ];
    let sound = run(&with(&aboard), SECOND);
    for (line, sensor) in [
        ("0.2 ugv/imu off 0.5", "/ugv/imu"),
        ("0.2 ugv/imu frozen 0.5", "/ugv/imu"),
        ("0.2 ugv/lidar noise 5 0.5", "/ugv/lidar"),
        ("0.2 uav/gnss delay 0.3 0.5", "/uav/gnss"),
        ("0.2 uav/barometer noise 3 0.5", "/uav/barometer"),
        ("0.2 uav/rangefinder noise 3 0.5", "/uav/rangefinder"),
        ("0.2 ugv/radar noise 3 0.5", "/ugv/radar"),
        ("0.2 uav/imu noise 3 0.5", "/uav/imu"),
        ("0.2 uav/gnss noise 3 0.5", "/uav/gnss"),
    ] {
        let mut setup = with(&aboard);
        setup.faults = line.parse().expect("a script");
        let broken = run(&setup, SECOND);
        assert!(broken != sound, "{line}");
        let others = |packets: &[Packet]| -> Vec<Packet> {
            let others = packets.iter().filter(|p| !p.topic.starts_with(sensor));
            others.cloned().collect()
        };
        assert!(others(&broken) == others(&sound), "{line}: others");
        let own = |packets: &[Packet], from_ms: u64, to_ms: u64| -> Vec<Packet> {
            let [from, to] = [from_ms, to_ms].map(|ms| Stamp::from_nanos(ms * 1_000_000));
            let own = packets
                .iter()
                .filter(|p| p.topic.starts_with(sensor) && (from..to).contains(&p.at));
            own.cloned().collect()
        };
        assert!(
            own(&broken, 0, 190) == own(&sound, 0, 190),
            "{line}: before"
        );
        // What was delayed or is complete later may be missing at the end.
        assert!(
            own(&broken, 710, 880) == own(&sound, 710, 880),
            "{line}: after"
        );
    }
}

#[test]
fn a_frozen_sensor_says_the_same_again_with_new_stamps() {
    let mut setup = with(&["ugv/imu"]);
    setup.faults = "0.5 ugv/imu frozen".parse().expect("a script");
    let packets = run(&setup, SECOND);
    let readings: Vec<_> = of(&packets, "/ugv/imu/data_raw")
        .map(|p| Imu::decode(&p.bytes).expect("our own"))
        .collect();
    assert_eq!(readings.len(), 200);
    let last = &readings[99];
    for (index, reading) in readings.iter().enumerate().skip(100) {
        assert_eq!(reading.rates, last.rates);
        assert_eq!(reading.at, Stamp::from_nanos(index as u64 * 5_000_000));
    }
}

#[test]
fn a_fault_of_a_sensor_that_is_not_aboard_is_refused_with_those_that_are() {
    let mut setup = with(&["uav"]);
    setup.faults = "1 ugv/lidar off".parse().expect("a script");
    let scene = Scene::generate(setup.scene, setup.seed);
    let error = Rig::new(&scene, &setup, Duration::ZERO).err();
    let error = error.expect("no LiDAR");
    let cause = std::error::Error::source(&error).expect("the script");
    assert!(cause.to_string().contains("uav/camera"), "{cause}");
    let error = Rig::new(&scene, &with(&["uav/lidar"]), Duration::ZERO).err();
    let error = error.expect("no LiDAR").to_string();
    assert!(error.contains("ugv/lidar"), "{error}");
}

#[test]
fn what_comes_does_not_depend_on_how_often_it_is_asked_for() {
    let setup = with(&["uav/gnss", "ugv/imu", "ugv/radar"]);
    let scene = Scene::generate(setup.scene, setup.seed);
    let mut rig = Rig::new(&scene, &setup, Duration::from_mins(1)).expect("sensors that there are");
    let asked: Vec<Packet> = (1..=20)
        .flat_map(|i| rig.until(Stamp::from_nanos(i * 50_000_000)))
        .collect();
    assert!(asked == run(&setup, SECOND));
}

#[test]
fn a_rolling_shutter_gives_other_pictures_of_the_same_moments() {
    let pictures = |optics: Optics| {
        let mut setup = with(&["uav/camera"]);
        setup.optics = optics;
        let packets = run(&setup, Stamp::from_nanos(200_000_000));
        let colour = of(&packets, "/uav/camera/color/image_raw");
        colour.map(|p| (p.at, p.bytes.clone())).collect::<Vec<_>>()
    };
    let [ideal, rolling] = [Optics::IDEAL, Optics::ROLLING_SHUTTER].map(pictures);
    assert_eq!(ideal.len(), 3);
    for ((at, ideal), (same, rolling)) in ideal.iter().zip(&rolling) {
        assert_eq!(at, same);
        assert_eq!(ideal.len(), rolling.len());
        assert!(ideal != rolling, "at {at}");
    }
}

#[test]
fn odometry_is_the_truth_of_the_platform() {
    let setup = with(&["ugv/wheels"]);
    let scene = Scene::generate(setup.scene, setup.seed);
    let packets = run(&setup, SECOND);
    for packet in of(&packets, "/ugv/ground_truth/odom") {
        let odometry = Odometry::decode(&packet.bytes)
            .expect("our own")
            .expect("a pose");
        let truth = platform::ugv(&scene, odometry.at);
        let off = truth.raw.inverse()
            * Isometry::<maps::frame::World, maps::frame::Body>::claim(odometry.pose).raw;
        assert!(off.translation.vector.norm() < 1e-9);
    }
}
