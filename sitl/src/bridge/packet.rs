//! What `ArduPilot` sends: pulse widths for its motors and servos.

/// Of packets with 16 channels.
const MAGIC_16: u16 = 18_458;
/// Of packets with 32 channels, which `SERVO_32_ENABLE` makes of them.
const MAGIC_32: u16 = 29_569;
/// Magic, frame rate and frame count.
const HEADER: usize = 8;
/// `ArduPilot` ignores the time that an answer tells if it is 0.1 s or more after the one before.
const SLOWEST_HZ: u16 = 11;

/// One frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet {
    /// How many frames make a second.
    pub frame_rate_hz: u16,
    /// Counts frames from 0.
    pub frame_count: u32,
    /// Pulse widths in microseconds, 0 for none. Channels that there are not are 0.
    pub pwm_us: [u16; 32],
}

/// Why a packet is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PacketError {
    /// Not even a header.
    #[error("a packet of {found} bytes is too short for one of ArduPilot's")]
    Short {
        /// Its bytes.
        found: usize,
    },
    /// Something else sends to this port.
    #[error(
        "a packet that begins with {found} is none of ArduPilot's, which begin with {MAGIC_16} or {MAGIC_32}"
    )]
    Magic {
        /// Its first two bytes.
        found: u16,
    },
    /// Cut, or of a newer protocol.
    #[error("a packet that begins with {magic} has {found} bytes, not {expected}")]
    Length {
        /// Its first two bytes.
        magic: u16,
        /// Its bytes.
        found: usize,
        /// What that magic promises.
        expected: usize,
    },
    /// Steps that `ArduPilot` itself would not follow.
    #[error("{found} frames a second are too few: set SIM_RATE_HZ to {SLOWEST_HZ} or more")]
    Rate {
        /// Frames a second.
        found: u16,
    },
    /// It was overtaken by others.
    #[error("frame {count} comes after frame {last}")]
    Late {
        /// Its number.
        count: u32,
        /// The last one's.
        last: u32,
    },
}

impl Packet {
    /// Takes a packet apart.
    pub fn parse(bytes: &[u8]) -> Result<Self, PacketError> {
        let Some((header, channels)) = bytes.split_first_chunk::<HEADER>() else {
            return Err(PacketError::Short { found: bytes.len() });
        };
        let [m0, m1, r0, r1, c0, c1, c2, c3] = *header;
        let magic = u16::from_le_bytes([m0, m1]);
        let expected = match magic {
            MAGIC_16 => 16,
            MAGIC_32 => 32,
            found => return Err(PacketError::Magic { found }),
        };
        if channels.len() != 2 * expected {
            return Err(PacketError::Length {
                magic,
                found: bytes.len(),
                expected: HEADER + 2 * expected,
            });
        }
        let frame_rate_hz = u16::from_le_bytes([r0, r1]);
        if frame_rate_hz < SLOWEST_HZ {
            return Err(PacketError::Rate {
                found: frame_rate_hz,
            });
        }
        let mut pwm_us = [0; 32];
        for (to, from) in pwm_us.iter_mut().zip(channels.chunks_exact(2)) {
            *to = u16::from_le_bytes([from[0], from[1]]);
        }
        Ok(Self {
            frame_rate_hz,
            frame_count: u32::from_le_bytes([c0, c1, c2, c3]),
            pwm_us,
        })
    }

    /// The power of the motor at a channel counted from 1: 0 at 1000 µs, 1 at 2000 µs. Without a pulse it stands.
    pub fn power(&self, channel: usize) -> f64 {
        match self.pulse(channel) {
            0 => 0.0,
            pulse_us => ((f64::from(pulse_us) - 1000.0) / 1000.0).clamp(0.0, 1.0),
        }
    }

    /// How far the servo at a channel counted from 1 is from its middle: -1 at 1000 µs, 1 at 2000 µs. Without a pulse it is in
    /// the middle.
    pub fn deflection(&self, channel: usize) -> f64 {
        match self.pulse(channel) {
            0 => 0.0,
            pulse_us => ((f64::from(pulse_us) - 1500.0) / 500.0).clamp(-1.0, 1.0),
        }
    }

    fn pulse(&self, channel: usize) -> u16 {
        self.pwm_us
            .get(channel.wrapping_sub(1))
            .copied()
            .unwrap_or(0)
    }
}
