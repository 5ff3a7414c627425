use maps::frame::Isometry;

use super::*;
use crate::sensor::process::statistics::{check_recovered, correlation, mean, spread as deviation};

fn at_origin() -> Motion {
    Motion {
        world_from_body: Isometry::identity(),
        velocity: Vector::new(1.0, 2.0, 3.0),
        rates: Vector::new(0.0, 0.0, 0.0),
    }
}

fn ms(milliseconds: u64) -> Stamp {
    Stamp::ZERO + Duration::from_millis(milliseconds)
}

/// All readings of so many seconds at the origin, stepped at 50 Hz.
fn readings(model: ReceiverModel, sky: Sky, seconds: u64) -> Vec<GnssReading> {
    let mut receiver = Receiver::new(model, 1);
    (0..seconds * 50)
        .filter_map(|i| receiver.step(ms(20 * i), &at_origin(), sky))
        .collect()
}

fn fixes(model: ReceiverModel, sky: Sky, seconds: u64) -> Vec<FixType> {
    let all = readings(model, sky, seconds);
    all.iter().map(|r| r.fix).collect()
}

/// The first errors of many receivers, which have nothing to do with one another.
fn errors(model: &ReceiverModel, sky: Sky, count: u64) -> Vec<Vector3<f64>> {
    let model = ReceiverModel {
        latency: Duration::ZERO,
        ..model.clone()
    };
    (0..count)
        .filter_map(|seed| {
            Receiver::new(model.clone(), seed)
                .step(Stamp::ZERO, &at_origin(), sky)?
                .solution
        })
        .map(|s| s.position.raw.coords)
        .collect()
}

/// Half of all errors are within this, horizontally.
fn circular_error_probable_m(errors: &[Vector3<f64>]) -> f64 {
    let mut far: Vec<f64> = errors.iter().map(|e| e.xy().norm()).collect();
    far.sort_by(f64::total_cmp);
    far[far.len() / 2]
}

#[test]
fn half_of_all_fixes_are_within_what_the_data_sheets_say() {
    for (model, expected) in [
        (ReceiverModel::m8n(), 2.5),
        (ReceiverModel::rtk(), 0.01),
        // 1.1774 times the root of the parts' squares.
        (ReceiverModel::rtk_float(), 0.425),
    ] {
        let found = circular_error_probable_m(&errors(&model, Sky::OPEN, 10_000));
        println!("circular error probable {found} m, expected {expected} m");
        // 10,000 receivers: 0.8 % at one standard deviation.
        check_recovered("circular error probable", found, expected, 0.04);
    }
}

#[test]
fn the_accuracy_it_believes_is_the_true_one_under_an_open_sky() {
    let model = ReceiverModel::m8n();
    let all = errors(&model, Sky::OPEN, 10_000);
    let solution = readings(model, Sky::OPEN, 1)[0].solution.expect("a fix");
    let [east, up] = [0, 2].map(|i| deviation(&all.iter().map(|e| e[i]).collect::<Vec<_>>()));
    check_recovered("horizontal", east, solution.horizontal_accuracy_m, 0.03);
    check_recovered("vertical", up, solution.vertical_accuracy_m, 0.03);
}

#[test]
fn the_error_wanders_with_the_stated_spread_correlation_and_white_noise() {
    let mut model = ReceiverModel::m8n();
    model.grades[0].walk = spread(0.0, 0.0);
    let wander = model.grades[0].wander.horizontal_m;
    let white = model.grades[0].white.horizontal_m;
    let all = readings(model, Sky::OPEN, 40_000);
    let east: Vec<f64> = all
        .iter()
        .filter_map(|r| Some(r.solution?.position.raw.x))
        .collect();
    // 40,000 s are 330 independent values: 4 % at one standard deviation.
    check_recovered("spread", deviation(&east), wander.hypot(white), 0.12);
    let kept = correlation(&east, 300) * (1.0 + (white / wander).powi(2));
    check_recovered("kept after a minute", kept, (-1.0_f64).exp(), 0.35);
    let steps: Vec<f64> = east.windows(2).map(|w| w[1] - w[0]).collect();
    // Two whites, and what the rest moves in 0.2 s.
    let moved = wander * (2.0 * (1.0 - (-0.2_f64 / 60.0).exp())).sqrt();
    check_recovered(
        "steps",
        deviation(&steps),
        (white * 2_f64.sqrt()).hypot(moved),
        0.02,
    );
    let speeds: Vec<f64> = all
        .iter()
        .filter_map(|r| Some(r.solution?.velocity.raw.y))
        .collect();
    check_recovered("velocity", deviation(&speeds), 0.074, 0.02);
    assert!((mean(&speeds) - 2.0).abs() < 0.002, "{}", mean(&speeds));
}

#[test]
fn fixes_come_at_their_rate_and_late() {
    let mut receiver = Receiver::new(ReceiverModel::m8n(), 1);
    let mut came = Vec::new();
    for i in 0..500 {
        if let Some(reading) = receiver.step(ms(20 * i), &at_origin(), Sky::OPEN) {
            came.push((ms(20 * i), reading.at));
        }
    }
    assert_eq!(came.len(), 50, "10 s at 5 Hz");
    for (i, (came, at)) in (0_u64..).zip(came) {
        assert_eq!(at, ms(200 * i));
        assert_eq!(came.since(at), Duration::from_millis(120));
    }
}

#[test]
fn less_sky_means_a_worse_kind_of_fix_and_at_last_none() {
    let kind = |open| fixes(ReceiverModel::rtk(), Sky { open, wall: None }, 1)[0];
    assert_eq!(kind(1.0), FixType::RtkFixed);
    assert_eq!(kind(0.6), FixType::RtkFloat);
    assert_eq!(kind(0.3), FixType::ThreeD);
    assert_eq!(kind(0.2), FixType::TwoD);
    assert_eq!(kind(0.1), FixType::None);
    assert_eq!(kind(f64::NAN), FixType::None);
    let none = readings(
        ReceiverModel::m8n(),
        Sky {
            open: 0.05,
            wall: None,
        },
        1,
    )[0];
    assert_eq!((none.solution, none.satellites), (None, 1));
}

#[test]
fn the_error_grows_with_the_share_of_the_sky_that_is_hidden() {
    let model = ReceiverModel::m8n();
    let mut before = 0.0;
    for open in [1.0, 0.8, 0.6, 0.4, 0.3] {
        let found = errors(&model, Sky { open, wall: None }, 5000);
        let far = circular_error_probable_m(&found);
        let grade = &model.grades[0];
        let parts = [
            grade.wander.horizontal_m / open,
            grade.walk.horizontal_m / open,
            grade.white.horizontal_m / open,
            grade.multipath_m * (1.0 - open) / 2.0,
        ];
        let expected = 1.1774 * parts.iter().map(|p| p * p).sum::<f64>().sqrt();
        check_recovered("circular error probable", far, expected, 0.05);
        assert!(far > before, "{far} m at {open}");
        before = far;
        let reading = readings(model.clone(), Sky { open, wall: None }, 1)[0];
        check_recovered("hdop", reading.hdop, model.hdop / open, 1e-9);
    }
}

#[test]
fn a_wall_pushes_fixes_towards_it() {
    let sky = Sky {
        open: 0.5,
        wall: Some(Vector::new(0.0, -7.0, 0.0)),
    };
    let found = errors(&ReceiverModel::m8n(), sky, 10_000);
    let [east, north] = [0, 1].map(|i| mean(&found.iter().map(|e| e[i]).collect::<Vec<_>>()));
    // The mean of |x''| is √(2/π).
    let expected = -6.0 * 0.5 * (2.0 / std::f64::consts::PI).sqrt();
    println!("{north} m towards the wall, expected {expected} m");
    // 4.7 m of spread: 5 cm at one standard deviation.
    assert!((north - expected).abs() < 0.15, "{north} m");
    assert!(east.abs() < 0.15, "{east} m along the wall");
}

#[test]
fn after_an_outage_the_fix_comes_back_by_degrees() {
    let outage = Outage {
        from: ms(5000),
        span: Duration::from_secs(3),
    };
    let model = ReceiverModel {
        outages: vec![outage],
        latency: Duration::ZERO,
        ..ReceiverModel::rtk()
    };
    let all = readings(model, Sky::OPEN, 30);
    let kind = |s: u64| all.iter().find(|r| r.at == ms(s * 1000)).map(|r| r.fix);
    assert_eq!(kind(4), Some(FixType::RtkFixed));
    assert_eq!(kind(5), Some(FixType::None));
    assert_eq!(kind(7), Some(FixType::None));
    // Settling takes 1 s each for two and three dimensions, 2 s for a float solution, 10 s for a fixed one.
    let first = |fix| {
        let after = all.iter().filter(|r| r.at > outage.from + outage.span);
        after
            .clone()
            .find(|r| r.fix >= fix)
            .map(|r| r.at.as_secs_f64().round())
    };
    assert_eq!(first(FixType::TwoD), Some(9.0));
    assert_eq!(first(FixType::ThreeD), Some(10.0));
    assert_eq!(first(FixType::RtkFloat), Some(12.0));
    assert_eq!(first(FixType::RtkFixed), Some(22.0));
}

#[test]
fn a_truth_that_is_not_finite_has_no_fix_and_changes_no_later_error() {
    let nowhere = Motion {
        velocity: Vector::new(f64::NAN, 0.0, 0.0),
        ..at_origin()
    };
    let model = ReceiverModel {
        latency: Duration::ZERO,
        ..ReceiverModel::m8n()
    };
    let mut spoilt = Receiver::new(model, 1);
    let mut clean = spoilt.clone();
    let reading = spoilt.step(ms(0), &nowhere, Sky::OPEN).expect("a reading");
    assert_eq!((reading.fix, reading.solution), (FixType::None, None));
    clean.step(ms(0), &at_origin(), Sky::OPEN);
    let mut last = [None, None];
    for i in 1..30 {
        last = [&mut spoilt, &mut clean].map(|r| r.step(ms(200 * i), &at_origin(), Sky::OPEN));
    }
    assert_eq!(last[0], last[1], "once it has a fix again");
    let wall = Some(Vector::new(f64::NAN, 1.0, 0.0));
    let reading = clean.step(ms(9000), &at_origin(), Sky { open: 0.5, wall });
    let solution = reading.and_then(|r| r.solution).expect("a fix");
    assert!(solution.position.is_finite(), "a wall without a direction");
}

#[test]
fn the_same_seed_gives_the_same_readings_and_another_does_not() {
    let run = |seed| {
        let mut receiver = Receiver::new(ReceiverModel::m8n(), seed);
        (0..100)
            .filter_map(|i| receiver.step(ms(20 * i), &at_origin(), Sky::OPEN))
            .collect::<Vec<_>>()
    };
    assert_eq!(run(1), run(1));
    assert_ne!(run(1), run(2));
}
