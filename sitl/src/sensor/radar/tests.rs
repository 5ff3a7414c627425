use super::*;
use crate::sensor::process::statistics::{check_recovered, mean, spread};

const SCANS: usize = 20_000;

fn still() -> Vector<RadarFrame> {
    Vector::new(0.0, 0.0, 0.0)
}

/// A car at that range and azimuth, on the level of the radar, that comes nearer at 5 m/s.
fn car(range_m: f64, azimuth_deg: f64) -> Target {
    let (sin, cos) = azimuth_deg.to_radians().sin_cos();
    Target {
        position: Point::new(range_m * cos, range_m * sin, 0.0),
        velocity: Vector::new(-5.0 * cos, -5.0 * sin, 0.0),
        rcs_dbsm: 10.0,
    }
}

/// What many scans report of one target.
fn seen(target: Target) -> Vec<Detection> {
    let mut radar = Radar::new(RadarModel::ars408(), 1);
    (0..SCANS)
        .flat_map(|_| radar.scan(&[target], still()))
        .filter(|d| d.source == Source::Target(0))
        .collect()
}

fn share_seen(target: Target) -> f64 {
    seen(target).len() as f64 / SCANS as f64
}

fn column(detections: &[Detection], of: fn(&Detection) -> f64) -> Vec<f64> {
    detections.iter().map(of).collect()
}

#[track_caller]
fn check_noise(target: Target, range_noise_m: f64, azimuth_noise_deg: f64) {
    let seen = seen(target);
    let range = column(&seen, |d| d.range_m);
    let azimuth = column(&seen, |d| d.azimuth_rad);
    let rate = column(&seen, |d| d.range_rate_mps);
    // 20,000 scans: half a per cent at one standard deviation.
    check_recovered("range", spread(&range), range_noise_m, 0.03);
    check_recovered(
        "azimuth",
        spread(&azimuth),
        azimuth_noise_deg.to_radians(),
        0.03,
    );
    check_recovered(
        "range rate",
        spread(&rate),
        RadarModel::ars408().range_rate_noise_mps,
        0.03,
    );
    let sight = Sight::of(&target);
    assert!((mean(&range) - sight.range_m).abs() < 0.03 * range_noise_m);
    assert!((mean(&azimuth) - sight.azimuth_rad).abs() < 0.03 * azimuth_noise_deg.to_radians());
    assert!((mean(&rate) + 5.0).abs() < 0.002, "approaching");
}

#[test]
fn noise_is_that_of_the_beam_and_grows_off_the_axis() {
    check_noise(car(60.0, 3.0), 0.4, 0.1);
    check_noise(car(30.0, 45.0), 0.1, 1.0);
    // Half way from 45 to 60 degrees.
    check_noise(car(15.0, -52.5), 0.1, 3.0);
}

#[test]
fn a_car_at_the_reference_range_is_seen_in_half_of_the_scans() {
    // 13 dB is 19.95: 1e-6 to the power of 1/20.95.
    let share = share_seen(car(200.0, 0.0));
    println!("{share} at the reference range");
    assert!((share - 0.517).abs() < 0.011, "{share}");
    // Ten decibels less at a range shorter by the fourth root of ten: the same.
    let person = Target {
        rcs_dbsm: 0.0,
        ..car(200.0 / 10_f64.powf(0.25), 0.0)
    };
    let share = share_seen(person);
    assert!((share - 0.517).abs() < 0.011, "{share}");
    assert!(share_seen(car(50.0, 0.0)) > 0.99, "near");
}

#[test]
fn nothing_outside_the_field_of_view_or_the_limits_is_seen() {
    let above = |degrees: f64| Target {
        position: Point::new(30.0, 0.0, 30.0 * degrees.to_radians().tan()),
        ..car(30.0, 0.0)
    };
    let fleeing = Target {
        velocity: Vector::new(60.0, 0.0, 0.0),
        ..car(30.0, 0.0)
    };
    let blind = [
        car(251.0, 0.0),
        car(160.0, 9.0),
        car(100.0, 20.0),
        car(30.0, 58.0),
        car(10.0, 61.0),
        car(10.0, 180.0),
        car(0.1, 0.0),
        above(10.5),
        fleeing,
    ];
    for target in blind {
        assert_eq!(seen(target).len(), 0, "{target:?}");
    }
    for target in [car(20.0, 59.0), car(60.0, 44.0), above(8.0), car(0.3, 0.0)] {
        assert!(share_seen(target) > 0.5, "{target:?}");
    }
}

#[test]
fn clutter_is_as_frequent_as_the_model_says_and_stands_still() {
    let mut radar = Radar::new(RadarModel::ars408(), 2);
    let forward = Vector::new(3.0, 0.0, 0.0);
    let clutter: Vec<Detection> = (0..SCANS).flat_map(|_| radar.scan(&[], forward)).collect();
    assert!(clutter.iter().all(|d| d.source == Source::Clutter));
    // Of the near beam's, those beyond its shorter reach at the sides do not count: 25 of 70 m lost on average in a
    // quarter of the azimuths; of the far beam's, 50 of 250 m in five ninths.
    let expected = 1.5 * (1.0 - 0.25 * 25.0 / 69.8) + 0.5 * (1.0 - 5.0 / 9.0 * 50.0 / 249.8);
    let count = clutter.len() as f64 / SCANS as f64;
    println!("{count} false objects a scan, expected {expected}");
    check_recovered("clutter", count, expected, 0.03);
    for detection in clutter {
        let still = -3.0 * detection.azimuth_rad.cos();
        assert!(
            (detection.range_rate_mps - still).abs() < 0.2,
            "{detection:?}"
        );
        let inside = Target {
            rcs_dbsm: 10.0,
            ..car(detection.range_m, detection.azimuth_rad.to_degrees())
        };
        let sight = Sight::of(&inside);
        assert!(
            RadarModel::ars408()
                .beams
                .iter()
                .any(|b| b.edge_at(&sight).is_some())
        );
    }
}

#[test]
fn what_is_not_finite_is_not_seen_and_changes_nothing_else() {
    let sound = car(20.0, 5.0);
    let spoilt = [f64::NAN, f64::INFINITY].map(|bad| {
        [
            Target {
                position: Point::new(bad, 0.0, 0.0),
                ..sound
            },
            Target {
                velocity: Vector::new(bad, 0.0, 0.0),
                ..sound
            },
            Target {
                rcs_dbsm: f64::NAN,
                ..sound
            },
            Target {
                position: Point::origin(),
                ..sound
            },
        ]
    });
    for bad in spoilt.into_iter().flatten() {
        let mut with = Radar::new(RadarModel::ars408(), 3);
        let mut without = with.clone();
        let seen = with.scan(&[bad, sound], Vector::new(f64::NAN, 0.0, 0.0));
        let expected = without.scan(&[car(999.0, 0.0), sound], still());
        assert_eq!(seen, expected, "{bad:?}");
    }
}

#[test]
fn the_same_seed_gives_the_same_scans_and_another_does_not() {
    let run = |seed| {
        let mut radar = Radar::new(RadarModel::ars408(), seed);
        (0..20)
            .map(|_| radar.scan(&[car(20.0, 5.0)], still()))
            .collect::<Vec<_>>()
    };
    assert_eq!(run(1), run(1));
    assert_ne!(run(1), run(2));
}
