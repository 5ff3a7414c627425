use super::*;
use crate::sensor::allan::{self, AllanPoint};
use crate::sensor::process::statistics::{check_recovered, mean, spread};

const STILL: [f64; 3] = [0.0, 0.0, GRAVITY_MPS2];

fn still(imu: &mut Imu, dt: f64) -> ImuSample {
    imu.measure(
        Vector::new(0.0, 0.0, 0.0),
        Vector::from_raw(STILL.into()),
        dt,
    )
}

/// The six Allan curves of a unit at rest for so many seconds: three gyroscopes, three accelerometers. Sampled at 200
/// Hz and averaged over a second, which leaves every span of whole seconds as it was.
fn curves_at_rest(model: ImuModel, seconds: usize, seed: u64) -> [Vec<AllanPoint>; 6] {
    let mut imu = Imu::new(model, seed);
    let mut averages = [(); 6].map(|()| Vec::with_capacity(seconds));
    for _ in 0..seconds {
        let mut sums = [0.0; 6];
        for _ in 0..200 {
            let sample = still(&mut imu, 0.005);
            let values = sample.rates.raw.iter().chain(&sample.specific_force.raw);
            sums.iter_mut().zip(values).for_each(|(sum, v)| *sum += v);
        }
        averages
            .iter_mut()
            .zip(sums)
            .for_each(|(all, sum)| all.push(sum / 200.0));
    }
    averages.map(|values| allan::curve(&values, 1.0, 3))
}

/// Root of the mean square of three axes at the point of the curves nearest to `tau_s`.
fn joint(curves: &[Vec<AllanPoint>], tau_s: f64) -> AllanPoint {
    let nearest = curves[0]
        .iter()
        .enumerate()
        .min_by(|a, b| {
            (a.1.tau_s - tau_s)
                .abs()
                .total_cmp(&(b.1.tau_s - tau_s).abs())
        })
        .expect("a curve")
        .0;
    let squares: Vec<f64> = curves
        .iter()
        .map(|curve| curve[nearest].deviation.powi(2))
        .collect();
    AllanPoint {
        tau_s: curves[0][nearest].tau_s,
        deviation: mean(&squares).sqrt(),
    }
}

/// What the terms of the model add up to.
fn predicted(errors: &Errors, tau_s: f64) -> f64 {
    let wander = errors.instability / GAUSS_MARKOV_PEAK;
    let terms = [
        errors.density / tau_s.sqrt(),
        allan::gauss_markov(wander, errors.correlation_s, tau_s),
        errors.walk * (tau_s / 3.0).sqrt(),
    ];
    terms.iter().map(|term| term * term).sum::<f64>().sqrt()
}

#[track_caller]
fn check_allan_recovers(name: &str, errors: Errors, curves: &[Vec<AllanPoint>]) {
    // 14,400 averages of a second: 1 % per axis at 1 s.
    let density = joint(curves, 1.0).deviation;
    println!("{name}: N {density:e}, configured {:e}", errors.density);
    check_recovered(name, density, predicted(&errors, 1.0), 0.02);
    check_recovered(name, density, errors.density, 0.03);
    // The middle of the floor; 1.89 T holds 76 pairs for each of three axes: 7 % at one standard deviation.
    let peak = joint(curves, 1.89 * errors.correlation_s);
    println!(
        "{name}: {peak:?}, predicted {:e}",
        predicted(&errors, peak.tau_s)
    );
    check_recovered(name, peak.deviation, predicted(&errors, peak.tau_s), 0.2);
    let together: Vec<AllanPoint> = curves[0].iter().map(|p| joint(curves, p.tau_s)).collect();
    let floor = allan::floor(&together).expect("a curve");
    println!(
        "{name}: floor {floor:?}, configured {:e}",
        errors.instability
    );
    check_recovered(name, floor.deviation, errors.instability, 0.15);
}

#[test]
fn four_hours_at_rest_give_back_noise_density_and_bias_instability() {
    let model = ImuModel::ICM_42688_P;
    let curves = curves_at_rest(model, 14_400, 1);
    check_allan_recovers("gyroscope", model.gyroscope.into(), &curves[..3]);
    check_allan_recovers("accelerometer", model.accelerometer.into(), &curves[3..]);
}

#[test]
fn the_curves_of_all_presets_are_flat_where_their_data_sheets_have_a_floor() {
    for model in [
        ImuModel::ICM_42688_P,
        ImuModel::BMI088,
        ImuModel::ADIS16495_1,
    ] {
        for errors in [Errors::from(model.gyroscope), model.accelerometer.into()] {
            let share = |tau_s: f64| predicted(&errors, tau_s) / errors.instability;
            let lowest = (0..400)
                .map(|i| share(1.05_f64.powi(i)))
                .fold(f64::INFINITY, f64::min);
            assert!((0.9..1.1).contains(&lowest), "{lowest} for {errors:?}");
            for i in 0..=20 {
                let times = 0.2 * 50_f64.powf(f64::from(i) / 20.0);
                let height = share(times * errors.correlation_s);
                assert!((0.85..1.2).contains(&height), "{height} at {times} T");
            }
        }
    }
}

#[test]
fn below_a_second_the_allan_curve_falls_with_slope_a_half() {
    let mut imu = Imu::new(ImuModel::ICM_42688_P, 2);
    let rates: Vec<f64> = (0..120_000)
        .map(|_| still(&mut imu, 0.005).rates.raw.z)
        .collect();
    let curve = allan::curve(&rates, 0.005, 3);
    let slope = allan::slope(&curve, 0.0, 1.0).expect("points");
    println!("slope {slope}");
    assert!((slope + 0.5).abs() < 0.01, "{slope}");
    let density = allan::white_noise_density(&curve, 0.0, 1.0).expect("points");
    let configured = ImuModel::ICM_42688_P.gyroscope.noise_density_radps_per_rthz;
    check_recovered("N", density, configured, 0.02);
}

#[test]
fn a_rate_random_walk_climbs_with_slope_a_half_and_gives_back_its_density() {
    let mut model = ImuModel::ICM_42688_P;
    model.gyroscope.noise_density_radps_per_rthz = 0.0;
    model.gyroscope.bias_instability_radps = 0.0;
    model.gyroscope.rate_random_walk_radps_per_rts = 1e-5;
    let mut imu = Imu::new(model, 3);
    let rates: Vec<f64> = (0..100_000)
        .map(|_| still(&mut imu, 1.0).rates.raw.x)
        .collect();
    let curve = allan::curve(&rates, 1.0, 3);
    let slope = allan::slope(&curve, 10.0, 1000.0).expect("points");
    assert!((slope - 0.5).abs() < 0.03, "{slope}");
    let point = joint(&[curve], 100.0);
    let density = point.deviation * (3.0 / point.tau_s).sqrt();
    check_recovered("K", density, 1e-5, 0.05);
}

#[test]
fn each_time_it_is_switched_on_bias_and_scale_differ_by_what_the_model_says() {
    let model = ImuModel {
        gyroscope: GyroscopeModel {
            noise_density_radps_per_rthz: 0.0,
            bias_instability_radps: 0.0,
            rate_random_walk_radps_per_rts: 0.0,
            ..ImuModel::BMI088.gyroscope
        },
        ..ImuModel::BMI088
    };
    let (mut biases, mut scales) = (Vec::new(), Vec::new());
    for seed in 0..4000 {
        let mut imu = Imu::new(model, seed);
        let bias = imu.biases()[0].raw.y;
        let turning = Vector::new(0.0, 10.0, 0.0);
        let sample = imu.measure(turning, Vector::from_raw(STILL.into()), 0.005);
        biases.push(bias);
        scales.push((sample.rates.raw.y - bias) / 10.0 - 1.0);
    }
    // 4,000 draws: 1.1 % at one standard deviation.
    check_recovered(
        "bias",
        spread(&biases),
        model.gyroscope.turn_on_bias_radps,
        0.05,
    );
    check_recovered("scale", spread(&scales), model.gyroscope.scale_error, 0.05);
}

#[test]
fn nothing_beyond_the_range_is_reported() {
    let model = ImuModel::ADIS16495_1;
    let mut imu = Imu::new(model, 1);
    let sample = imu.measure(
        Vector::new(100.0, -100.0, 0.0),
        Vector::new(1000.0, f64::NEG_INFINITY, 0.0),
        0.005,
    );
    let (turn, push) = (model.gyroscope.range_radps, model.accelerometer.range_mps2);
    assert!((sample.rates.raw.xy() - nalgebra::Vector2::new(turn, -turn)).norm() < 1e-12);
    assert!((sample.specific_force.raw.xy() - nalgebra::Vector2::new(push, -push)).norm() < 1e-12);
}

#[test]
fn nan_spoils_one_axis_of_one_sample_and_nothing_after_it() {
    let mut spoilt = Imu::new(ImuModel::BMI088, 5);
    let mut clean = spoilt.clone();
    let nan = Vector::new(f64::NAN, 0.0, 0.0);
    let sample = spoilt.measure(nan, Vector::from_raw(STILL.into()), 0.005);
    let expected = still(&mut clean, 0.005);
    assert!(sample.rates.raw.x.is_nan());
    assert_eq!(sample.specific_force, expected.specific_force);
    assert_eq!(still(&mut spoilt, 0.005), still(&mut clean, 0.005));
    for dt in [f64::NAN, -1.0, 0.0, f64::INFINITY] {
        let before = spoilt.biases();
        let sample = still(&mut spoilt, dt);
        assert_eq!(spoilt.biases(), before, "{dt} s");
        assert!(sample.rates.raw.iter().all(|v| v.is_finite()), "{dt} s");
    }
}

#[test]
fn the_same_seed_gives_the_same_bits_and_another_does_not() {
    let run = |seed| {
        let mut imu = Imu::new(ImuModel::ICM_42688_P, seed);
        (0..100)
            .map(|_| still(&mut imu, 0.0025))
            .collect::<Vec<_>>()
    };
    assert_eq!(run(1), run(1));
    assert_ne!(run(1), run(2));
}

#[test]
fn at_rest_gravity_pushes_up_and_in_free_fall_nothing_does() {
    let level = UnitQuaternion::identity();
    let at_rest = specific_force(&level, Vector::new(0.0, 0.0, 0.0));
    assert!((at_rest.raw - Vector3::from(STILL)).norm() < 1e-12);
    let falling = specific_force(&level, Vector::new(0.0, 0.0, -GRAVITY_MPS2));
    assert!(falling.norm() < 1e-12);
    // Rolled to the right by 90 degrees, its left side is up.
    let rolled = UnitQuaternion::from_euler_angles(std::f64::consts::FRAC_PI_2, 0.0, 0.0);
    let sideways = specific_force(&rolled, Vector::new(0.0, 0.0, 0.0));
    assert!(
        (sideways.raw - Vector3::new(0.0, GRAVITY_MPS2, 0.0)).norm() < 1e-9,
        "{sideways:?}"
    );
}
