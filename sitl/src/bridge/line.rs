//! What `ArduPilot` gets: one line of JSON.
//!
//! Its parser looks for words and reads the numbers behind them, so that the line has no spaces, and no word comes twice.

use serde::Serialize;

use super::plant::Senses;

/// The names and their order are `ArduPilot`'s.
#[derive(Serialize)]
struct Line<'a> {
    timestamp: f64,
    imu: Imu<'a>,
    position: &'a [f64; 3],
    velocity: &'a [f64; 3],
    quaternion: &'a [f64; 4],
    rng_1: f64,
}

#[derive(Serialize)]
struct Imu<'a> {
    gyro: &'a [f64; 3],
    accel_body: &'a [f64; 3],
}

/// The line at a time in seconds, with the line feeds about it that `ArduPilot` takes lines apart by.
pub fn of(timestamp_s: f64, senses: &Senses) -> Vec<u8> {
    let line = Line {
        timestamp: timestamp_s,
        imu: Imu {
            gyro: &senses.gyro_frd_radps,
            accel_body: &senses.force_frd_mps2,
        },
        position: &senses.position_ned_m,
        velocity: &senses.velocity_ned_mps,
        quaternion: &senses.ned_from_frd_wxyz,
        rng_1: senses.range_m,
    };
    let mut bytes = vec![b'\n'];
    bytes.extend(serde_json::to_vec(&line).expect("numbers and arrays of them can be written"));
    bytes.push(b'\n');
    bytes
}
