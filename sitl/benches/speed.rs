//! How many frames a second: the drone's RGB-D with masks, the ground vehicle's four cameras with its `LiDAR`, and the
//! vehicles alone.
//!
//! `cargo bench -p sitl --bench speed` prints two lines for each street: frames a second on the wall with all cores, and
//! what the time of one goes into; then the same in processor time of all threads together, which says what the work costs
//! when others load the machine, too. Goals on two cores: 30 drone frames and 5 ground frames a second, vehicles 200 times as fast
//! as real time. `--test`, as `cargo test` passes it, draws one frame of each.

#![expect(clippy::print_stdout, reason = "a bench reports on its output")]

use std::hint::black_box;
use std::time::Duration;

use maps::time::Stamp;
use rustix::time::{ClockId, clock_gettime};
use sitl::depth_camera::{OUTDOORS_M, d455, expose};
use sitl::lidar::Lidar;
use sitl::platform;
use sitl::rays::Rays;
use sitl::render::Stage;
use sitl::scene::{Name, Scene};
use sitl::simulation::{Event, STEP, Simulation, Start, copter, rover};

const SEED: u64 = 1100;

fn main() {
    let is_test = std::env::args().any(|arg| arg == "--test");
    let frames = if is_test { 1 } else { 30 };
    println!(
        "scene               faces clock  drone/s  ground/s   ms: moment  picture  expose  4 pictures  LiDAR"
    );
    for name in Name::STREETS {
        street(name, frames);
    }
    vehicles(if is_test { 1.0 } else { 600.0 });
}

fn street(name: Name, frames: u64) {
    let scene = Scene::generate(name, SEED);
    let stage = Stage::new(&scene);
    let rays = Rays::new(&scene);
    let (camera, lens, lidar) = (d455(), platform::ugv_lens(), Lidar::rs_32());
    let mut spent = [[Duration::ZERO; 5]; 2];
    let mut faces = 0;
    for frame in 0..frames {
        let at = Stamp::from_nanos((1 + frame) * 700_000_000);
        let mut time = |part: usize, since: [Duration; 2]| {
            let until = now();
            for clock in [0, 1] {
                spent[clock][part] += until[clock].saturating_sub(since[clock]);
            }
        };
        let start = now();
        let moment = stage.at(at);
        time(0, start);
        faces = moment.faces().count();
        let start = now();
        let picture = moment.picture(&camera, platform::uav_camera(&scene, at, SEED));
        time(1, start);
        let start = now();
        black_box(expose(&picture, &camera, OUTDOORS_M, SEED));
        time(2, start);
        let start = now();
        let body = platform::ugv(&scene, at);
        for index in 0..platform::UGV_CAMERAS.len() {
            black_box(moment.picture(&lens, body * platform::body_from_ugv_camera(index)));
        }
        time(3, start);
        let start = now();
        black_box(lidar.sweep(&rays, at, |at| platform::ugv(&scene, at), SEED));
        time(4, start);
    }
    for (spent, clock) in spent.iter().zip(["wall", "cpu"]) {
        let ms = spent.map(|spent| spent.as_secs_f64() * 1e3 / frames as f64);
        let [moment, picture, exposed, four, sweep] = ms;
        println!(
            "{:<18} {faces:>6} {clock:>5} {:>8.1} {:>9.1} {moment:>12.1} {picture:>8.1} {exposed:>7.1} {four:>11.1} {sweep:>6.1}",
            name.to_string(),
            1e3 / (moment + picture + exposed),
            1e3 / (moment + four + sweep),
        );
    }
}

/// Both vehicles and their autopilots, without a radio.
fn vehicles(seconds: f64) {
    let Ok(origin) = "50.7268,7.0865,60".parse() else {
        return;
    };
    let start = Start {
        x_m: 0.0,
        y_m: 0.0,
        heading_deg: 0.0,
    };
    let mut simulation = Simulation::new([copter(&origin, None, 1), rover(&origin, start, 1)]);
    let steps = (seconds / STEP.as_secs_f64()).ceil() as u64;
    let began = now();
    let frames: usize = (0..steps)
        .map(|_| simulation.step(&Event::Tick).len())
        .sum();
    let ratio = steps as f64 * STEP.as_secs_f64() / now()[0].saturating_sub(began[0]).as_secs_f64();
    println!("vehicles alone: {ratio:.0} times real time ({frames} telemetry frames)");
}

/// The wall's time, and the processor time of all threads together.
fn now() -> [Duration; 2] {
    let of = |clock| Duration::try_from(clock_gettime(clock)).unwrap_or_default();
    [of(ClockId::Monotonic), of(ClockId::ProcessCPUTime)]
}
