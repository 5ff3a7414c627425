//! A fake `ArduPilot`: the same frames, the same way to read answers, and simple loops instead of its own.

use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::Duration;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::vehicle::copter::GRAVITY;
use crate::vehicle::quadrotor::Frame;

/// Frames a second, as many as a copter's loops.
const RATE_HZ: u16 = 400;

/// A frame with these first channels; the others are in the middle.
pub(super) fn frame(magic: u16, rate_hz: u16, count: u32, channels: &[u16]) -> Vec<u8> {
    let all = if magic == 29_569 { 32 } else { 16 };
    let mut bytes = magic.to_le_bytes().to_vec();
    bytes.extend(rate_hz.to_le_bytes());
    bytes.extend(count.to_le_bytes());
    let rest = std::iter::repeat_n(&1500, all - channels.len());
    bytes.extend(
        channels
            .iter()
            .chain(rest)
            .flat_map(|pwm| pwm.to_le_bytes()),
    );
    bytes
}

pub(super) fn frame_16(count: u32, channels: &[u16]) -> Vec<u8> {
    frame(18_458, RATE_HZ, count, channels)
}

/// Numbers behind a word in a section, found as `ArduPilot` does: it looks for both words and reads on two characters later.
fn read<const N: usize>(line: &str, section: &str, key: &str) -> [f64; N] {
    let from = line.find(section).expect("the section") + section.len();
    let key_at = from + line[from..].find(key).expect("the key");
    let mut numbers = line[key_at + key.len() + 2..].trim_start_matches('[');
    std::array::from_fn(|_| {
        let end = numbers.find([',', ']', '}']).expect("an end");
        let number = numbers[..end]
            .parse()
            .unwrap_or_else(|_| panic!("{key}: {numbers}"));
        numbers = &numbers[end + 1..];
        number
    })
}

/// What an answer says.
#[derive(Debug)]
pub(super) struct Felt {
    pub(super) time_s: f64,
    pub(super) gyro: Vector3<f64>,
    pub(super) force: Vector3<f64>,
    pub(super) position: Vector3<f64>,
    pub(super) velocity: Vector3<f64>,
    /// Roll, pitch and yaw.
    pub(super) angles: [f64; 3],
    pub(super) range_m: f64,
}

impl Felt {
    pub(super) fn of(answer: &[u8]) -> Self {
        let line = std::str::from_utf8(answer).expect("ASCII");
        assert!(
            line.starts_with('\n') && line.ends_with('\n') && !line.contains(' '),
            "{line:?}"
        );
        let [w, x, y, z] = read(line, "", "quaternion");
        let attitude = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
        let (roll, pitch, yaw) = attitude.euler_angles();
        let [time_s] = read(line, "", "timestamp");
        let [range_m] = read(line, "", "rng_1");
        Self {
            time_s,
            gyro: read(line, "imu", "gyro").into(),
            force: read(line, "imu", "accel_body").into(),
            position: read(line, "", "position").into(),
            velocity: read(line, "", "velocity").into(),
            angles: [roll, pitch, yaw],
            range_m,
        }
    }
}

/// The vector, at most that long.
fn limited(v: Vector3<f64>, most: f64) -> Vector3<f64> {
    if v.norm() > most {
        v.normalize() * most
    } else {
        v
    }
}

/// Pulse widths that fly a quad X to a place in north, east and down, as a cascade of proportional loops.
pub(super) fn fly(felt: &Felt, to: Vector3<f64>) -> Vec<u16> {
    let velocity = limited((to - felt.position) * 0.8, 1.5);
    let wanted = limited((velocity - felt.velocity) * 1.5, 4.0);
    let [roll, pitch, yaw] = felt.angles;
    let (sin, cos) = yaw.sin_cos();
    let lean = [
        (wanted.y * cos - wanted.x * sin) / GRAVITY,
        -(wanted.x * cos + wanted.y * sin) / GRAVITY,
    ];
    let angles = Vector3::new(5.0 * (lean[0] - roll), 5.0 * (lean[1] - pitch), -yaw);
    let turn = (angles - felt.gyro).component_mul(&Vector3::new(0.1, 0.1, 0.2));
    let thrust = 0.39 * (GRAVITY - wanted.z) / GRAVITY / (roll.cos() * pitch.cos());
    // Front right, rear left, front left, rear right.
    let mix = [
        [-1.0, 1.0, 1.0],
        [1.0, -1.0, 1.0],
        [1.0, 1.0, -1.0],
        [-1.0, -1.0, -1.0],
    ];
    let pulse = |signs: [f64; 3]| {
        let share = thrust + 0.5 * Vector3::from(signs).dot(&turn);
        let exponent = Frame::default().exponent;
        let linear = 1.0 - exponent;
        let root = (linear * linear + 4.0 * exponent * share.max(0.0)).sqrt();
        (1000.0 + 1000.0 * ((root - linear) / (2.0 * exponent)).clamp(0.0, 1.0)) as u16
    };
    mix.map(pulse).to_vec()
}

/// Pulse widths that drive a car to a place and stop there.
pub(super) fn drive(felt: &Felt, to: Vector3<f64>) -> Vec<u16> {
    let way = to - felt.position;
    let error = way.y.atan2(way.x) - felt.angles[2];
    let error = error.sin().atan2(error.cos());
    let throttle = if way.xy().norm() < 0.3 { 0.0 } else { 0.5 };
    let pulse = |deflection: f64| (1500.0 + 500.0 * deflection.clamp(-1.0, 1.0)) as u16;
    vec![pulse(1.5 * error), 1500, pulse(throttle)]
}

/// The other end of a socket.
pub(super) struct Fake {
    /// Not connected: what nobody hears is lost without an error, as it is between machines.
    pub(super) socket: UdpSocket,
    bridge: SocketAddr,
    pub(super) count: u32,
}

impl Fake {
    pub(super) fn new(bridge: &UdpSocket) -> Self {
        Self::to(bridge.local_addr().expect("bound"))
    }

    pub(super) fn to(bridge: SocketAddr) -> Self {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a free port");
        let fake = Self {
            socket,
            bridge,
            count: 0,
        };
        fake.wait_at_most(20_000);
        fake
    }

    fn wait_at_most(&self, millis: u64) {
        let patience = Some(Duration::from_millis(millis));
        self.socket.set_read_timeout(patience).expect("possible");
    }

    pub(super) fn send(&self, bytes: &[u8]) {
        self.socket.send_to(bytes, self.bridge).expect("loopback");
    }

    fn hear(&self) -> Option<Felt> {
        let mut answer = [0; 2048];
        let length = self.socket.recv(&mut answer).ok()?;
        Some(Felt::of(&answer[..length]))
    }

    /// One lock-stepped frame.
    pub(super) fn exchange(&mut self, channels: &[u16]) -> Felt {
        self.send(&frame_16(self.count, channels));
        self.count += 1;
        self.hear().expect("an answer within 20 s")
    }

    /// Sends a frame again and again, as `ArduPilot` does, until it is answered.
    pub(super) fn insist(&mut self, channels: &[u16]) -> Felt {
        self.wait_at_most(100);
        for _ in 0..200 {
            self.send(&frame_16(self.count, channels));
            if let Some(felt) = self.hear() {
                self.count += 1;
                self.wait_at_most(20_000);
                return felt;
            }
        }
        panic!("no answer in 200 attempts");
    }

    /// Flies or drives until it has been so for a second; returns the last answer.
    pub(super) fn go(
        &mut self,
        to: Vector3<f64>,
        seconds: u32,
        pilot: fn(&Felt, Vector3<f64>) -> Vec<u16>,
    ) -> Felt {
        let mut felt = self.exchange(&[0; 16]);
        for _ in 0..seconds * u32::from(RATE_HZ) {
            let channels = pilot(&felt, to);
            felt = self.exchange(&channels);
        }
        felt
    }
}
