//! How good a link is.

use std::time::Duration;

use maps::time::Stamp;

/// One direction of a link.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// At most so much leaves the sender; `None` for no limit.
    pub bytes_per_second: Option<f64>,
    /// What waits to leave may fill so much; a frame that finds nothing before it always fits.
    pub buffer_bytes: usize,
    /// How long a frame travels at least.
    pub delay: Duration,
    /// Added to the delay, evenly from none to this. Frames stay in order.
    pub jitter: Duration,
    /// Which frames are lost.
    pub loss: Loss,
    /// Probability that a frame arrives twice.
    pub repeat: f64,
    /// Probability that a frame goes another way, up to half as long again: others overtake it, or it them.
    pub overtake: f64,
    /// When nothing gets through.
    pub outages: Vec<Outage>,
}

/// Which frames are lost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Loss {
    /// Each with this probability.
    Even(f64),
    /// All of a burst. It is the channel that fades: a burst passes whether or not anything is sent meanwhile.
    Bursts {
        /// Share of the time, and so of the frames, that is lost in the long run.
        share: f64,
        /// Full frames of MAVLink (280 bytes) that a burst would take, on average; at least 1. Frames of any size, where
        /// the rate has no limit.
        length: f64,
    },
}

impl Loss {
    /// No loss.
    pub const NONE: Self = Self::Even(0.0);

    /// How probable a loss is, so many full frames after one that was lost or not: the two states of Gilbert and Elliott.
    pub(super) fn chance_after(self, frames: f64, was_lost: bool) -> f64 {
        let (share, length) = match self {
            Self::Even(share) => return share,
            Self::Bursts { share, length } => (share.min(1.0 - 1e-9), length.max(1.0)),
        };
        // A burst ends with a frame once in `length` times, and one begins so often that the share comes true.
        let changes = (1.0 / length / (1.0 - share)).min(1.0);
        let remembered = (1.0 - changes).powf(frames);
        share + (f64::from(u8::from(was_lost)) - share) * remembered
    }
}

/// A span in which nothing gets through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outage {
    /// When it begins.
    pub from: Stamp,
    /// How long it lasts.
    pub span: Duration,
}

impl Outage {
    pub(super) fn covers(self, at: Stamp) -> bool {
        at >= self.from && at < self.from + self.span
    }
}

/// What a radio's buffer holds, as a span of its rate.
const BUFFER: Duration = Duration::from_millis(500);
const LEAST_BUFFER_BYTES: usize = 8192;

impl Profile {
    /// No limits, no losses, no delay.
    pub const IDEAL: Self = Self {
        bytes_per_second: None,
        buffer_bytes: usize::MAX,
        delay: Duration::ZERO,
        jitter: Duration::ZERO,
        loss: Loss::NONE,
        repeat: 0.0,
        overtake: 0.0,
        outages: Vec::new(),
    };

    /// The names that [`Self::named`] knows.
    pub const NAMES: [&'static str; 6] = [
        "ideal",
        "mini-homer",
        "10mbit",
        "1mbit",
        "lossy20",
        "outage",
    ];

    /// A link of this rate with a buffer for half a second, as radios have.
    pub fn of_rate(bits_per_second: f64, delay: Duration) -> Self {
        let rate = bits_per_second / 8.0;
        let buffer = (rate * BUFFER.as_secs_f64()) as usize;
        Self {
            bytes_per_second: Some(rate),
            buffer_bytes: buffer.max(LEAST_BUFFER_BYTES),
            delay,
            ..Self::IDEAL
        }
    }

    /// A link by its name, the same in both directions:
    ///
    /// | name | rate | delay | loss |
    /// |---|---|---|---|
    /// | `ideal` | no limit | 0 | 0 |
    /// | `mini-homer` | 20 Mbit/s, one of the figures that its maker gives | 10 ms, jitter 10 ms | 2 %, bursts of 5 |
    /// | `10mbit` | 10 Mbit/s | 20 ms, jitter 5 ms | 1 % |
    /// | `1mbit` | 1 Mbit/s | 50 ms, jitter 10 ms | 1 % |
    /// | `lossy20` | 10 Mbit/s | 50 ms, jitter 20 ms | 20 %, a tenth overtaken, 2 % twice |
    /// | `outage` | 10 Mbit/s | 20 ms, jitter 5 ms | all for 30 s, once a minute, the first after 30 s |
    pub fn named(name: &str) -> Option<Self> {
        let ms = Duration::from_millis;
        let ten = Self {
            jitter: ms(5),
            loss: Loss::Even(0.01),
            ..Self::of_rate(10e6, ms(20))
        };
        Some(match name {
            "ideal" => Self::IDEAL,
            "mini-homer" => Self {
                jitter: ms(10),
                loss: Loss::Bursts {
                    share: 0.02,
                    length: 5.0,
                },
                ..Self::of_rate(20e6, ms(10))
            },
            "10mbit" => ten,
            "1mbit" => Self {
                jitter: ms(10),
                loss: Loss::Even(0.01),
                ..Self::of_rate(1e6, ms(50))
            },
            "lossy20" => Self {
                jitter: ms(20),
                loss: Loss::Even(0.2),
                repeat: 0.02,
                overtake: 0.1,
                ..Self::of_rate(10e6, ms(50))
            },
            "outage" => Self {
                outages: (0..60)
                    .map(|minute| Outage {
                        from: Stamp::ZERO + Duration::from_secs(60 * minute + 30),
                        span: Duration::from_secs(30),
                    })
                    .collect(),
                ..ten
            },
            _ => return None,
        })
    }
}
