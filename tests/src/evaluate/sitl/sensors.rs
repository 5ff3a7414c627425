//! Whether sensors err as they are set to: parameters recovered from what they report, beside those configured.

use ::sitl::depth_camera::{BASELINE_M, DISPARITY_NOISE, OUTDOORS_M, d455, expose};
use ::sitl::lidar::Lidar;
use ::sitl::platform;
use ::sitl::rays::Rays;
use ::sitl::render::Stage;
use ::sitl::scene::{Name, Scene};
use ::sitl::sensor::allan;
use ::sitl::sensor::gnss::{Receiver, ReceiverModel, Sky};
use ::sitl::sensor::imu::{GRAVITY_MPS2, Imu, ImuModel};
use ::sitl::vehicle::Motion;
use maps::frame::{Isometry, Vector};
use maps::time::Stamp;
use nalgebra::{Isometry3, Vector3};
use rayon::prelude::*;

/// Four hours at rest.
const IMU_SAMPLES: usize = 4 * 3600 * 200;
const IMU_STEP_S: f64 = 1.0 / 200.0;
/// Surfaces that face the camera.
const LEAST_FACING: f32 = 0.9;
const RECEIVERS: u64 = 64;
const GNSS_SECONDS: u64 = 1800;

/// A parameter, as it comes out and as it was put in.
pub(super) struct Recovered {
    pub(super) name: String,
    pub(super) measured: f64,
    pub(super) configured: f64,
}

fn recovered(name: impl Into<String>, measured: f64, configured: f64) -> Recovered {
    let name = name.into();
    Recovered {
        name,
        measured,
        configured,
    }
}

/// All of them.
pub(super) fn all(seed: u64) -> Vec<Recovered> {
    let mut all = depth(seed);
    all.push(lidar(seed));
    all.extend(imu(seed));
    all.push(gnss(seed));
    all
}

/// The depth camera's noise of disparity, which grows with range squared if it is the same in each band of ranges.
fn depth(seed: u64) -> Vec<Recovered> {
    let scene = Scene::generate(Name::UrbanArterial, seed);
    let camera = d455();
    let at = Stamp::from_nanos(4_000_000_000);
    let picture = Stage::new(&scene)
        .at(at)
        .picture(&camera, platform::uav_camera(&scene, at, seed));
    let frame = expose(&picture, &camera, OUTDOORS_M, seed);
    let bands = [[3.0, 5.0], [5.0, 8.0], [8.0, 12.0], [12.0, 18.0]];
    bands
        .into_iter()
        .filter_map(|[from, to]| {
            let pairs = picture
                .depth_m
                .iter()
                .zip(&frame.depth_m)
                .zip(&picture.facing);
            // On a slanted surface, what frays edges adds to it.
            let seen = pairs.filter(|((z, seen), facing)| {
                (from..to).contains(*z) && **seen > 0.0 && **facing > LEAST_FACING
            });
            let to_disparity = |z: f32| camera.fx / f64::from(z) * f64::from(BASELINE_M);
            let errors = seen.map(|((z, seen), _)| (to_disparity(*seen) - to_disparity(*z)).abs());
            // The median does not mind frayed edges.
            let spread = median(errors.collect())? * 1.4826;
            let name = format!("depth/disparity_{from:.0}_to_{to:.0}_m_px");
            Some(recovered(name, spread, f64::from(DISPARITY_NOISE)))
        })
        .collect()
}

fn lidar(seed: u64) -> Recovered {
    let scene = Scene::generate(Name::UrbanArterial, seed);
    let lidar = Lidar::rs_32();
    let at = Stamp::from_nanos(4_000_000_000);
    let returns = lidar.sweep(&Rays::new(&scene), at, |at| platform::ugv(&scene, at), seed);
    let squares: f64 = returns
        .iter()
        .map(|seen| f64::from(Vector3::from(seen.point).norm() - seen.true_range_m).powi(2))
        .sum();
    let measured = (squares / returns.len() as f64).sqrt();
    recovered("lidar/range_m", measured, lidar.noise_m)
}

/// Noise density, from the Allan deviation around 1 s; its slope there, -1/2 for white noise; and the floor.
fn imu(seed: u64) -> Vec<Recovered> {
    let model = ImuModel::ICM_42688_P;
    let mut imu = Imu::new(model, seed);
    let force = Vector::new(0.0, 0.0, GRAVITY_MPS2);
    let mut axes = [
        Vec::with_capacity(IMU_SAMPLES),
        Vec::with_capacity(IMU_SAMPLES),
    ];
    for _ in 0..IMU_SAMPLES {
        let sample = imu.measure(Vector::new(0.0, 0.0, 0.0), force, IMU_STEP_S);
        axes[0].push(sample.rates.raw.x);
        axes[1].push(sample.specific_force.raw.x);
    }
    let configured = [
        (
            "gyroscope",
            "radps",
            model.gyroscope.noise_density_radps_per_rthz,
            model.gyroscope.bias_instability_radps,
        ),
        (
            "accelerometer",
            "mps2",
            model.accelerometer.noise_density_mps2_per_rthz,
            model.accelerometer.bias_instability_mps2,
        ),
    ];
    let mut all = Vec::new();
    for (samples, (name, unit, density, instability)) in axes.iter().zip(configured) {
        let curve = allan::curve(samples, IMU_STEP_S, 4);
        let measured = allan::white_noise_density(&curve, 0.1, 1.0);
        all.extend(
            measured
                .map(|n| recovered(format!("{name}/noise_density_{unit}_per_rthz"), n, density)),
        );
        let slope = allan::slope(&curve, 0.02, 0.5);
        all.extend(slope.map(|slope| recovered(format!("{name}/allan_slope"), slope, -0.5)));
        let floor = allan::floor(&curve).map(|floor| floor.deviation);
        all.extend(floor.map(|floor| {
            recovered(
                format!("{name}/bias_instability_{unit}"),
                floor,
                instability,
            )
        }));
    }
    all
}

/// The radius within which half the fixes of many receivers lie, under an open sky.
fn gnss(seed: u64) -> Recovered {
    let still = Motion {
        world_from_body: Isometry::claim(Isometry3::identity()),
        velocity: Vector::new(0.0, 0.0, 0.0),
        rates: Vector::new(0.0, 0.0, 0.0),
    };
    let errors: Vec<f64> = (0..RECEIVERS)
        .into_par_iter()
        .flat_map_iter(|receiver| {
            let mut receiver =
                Receiver::new(ReceiverModel::m8n(), seed.wrapping_add(receiver << 32));
            (0..GNSS_SECONDS * 10).filter_map(move |step| {
                let now = Stamp::from_nanos(step * 100_000_000);
                let solution = receiver.step(now, &still, Sky::OPEN)?.solution?;
                Some(solution.position.raw.coords.xy().norm())
            })
        })
        .collect();
    // u-blox states 2.5 m for the M8N.
    recovered("gnss/m8n_cep_m", median(errors).unwrap_or(f64::NAN), 2.5)
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}
