//! What other sensors of the vehicle measured beside a frame: how it has turned and was pushed, by its inertial unit, and
//! where it was, by its satellite receiver. None is needed; a source that has none gives frames all the same.

use std::collections::VecDeque;
use std::time::Duration;

use maps::time::Stamp;
use nalgebra::{UnitQuaternion, Vector3};

use crate::ros::vehicle::{Imu, NavSatFix};

/// What was measured between one frame and the next.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Beside {
    /// How the vehicle has turned since the frame before, in the axes of its gyroscope: the later attitude seen from the
    /// earlier one. `None` without a gyroscope, or where it was silent.
    pub turned: Option<UnitQuaternion<f64>>,
    /// The mean specific force since the frame before, in m/s² and in the axes that the unit had midway: at rest, gravity
    /// upwards. `None` where `turned` is, or without an accelerometer.
    pub specific_force: Option<Vector3<f64>>,
    /// The newest position that has come since the frame before.
    pub fix: Option<SatelliteFix>,
}

/// A position by satellites.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SatelliteFix {
    /// The moment that it is of; it may have come much later.
    pub at: Stamp,
    /// Degrees north, WGS 84.
    pub latitude_deg: f64,
    /// Degrees east.
    pub longitude_deg: f64,
    /// Metres above the ellipsoid.
    pub altitude_m: f64,
    /// Variances east, north and up in m².
    pub variances_m2: [f64; 3],
}

/// A gyroscope that is silent for longer has not told the turn: four samples of 200 Hz.
const LONGEST_GAP: Duration = Duration::from_millis(20);
/// Samples kept: a second at 2 kHz. A frame that takes longer has no turn.
const MOST_SAMPLES: usize = 2048;
/// No vehicle turns faster than the range of its gyroscope: 2000°/s and some.
const FASTEST_RAD_S: f64 = 40.0;
/// Nor is it pushed harder than the range of its accelerometer: 32 g.
const HARDEST_MPS2: f64 = 314.0;

/// A sample of an inertial unit, or what several come to.
#[derive(Clone, Copy, Debug)]
struct Sample {
    at: Stamp,
    rates: Vector3<f64>,
    /// NaN where there is none.
    specific_force: Vector3<f64>,
}

impl Sample {
    fn mean(&self, other: &Self) -> Self {
        Self {
            at: self.at,
            rates: (self.rates + other.rates) / 2.0,
            specific_force: (self.specific_force + other.specific_force) / 2.0,
        }
    }
}

/// What the samples between two frames add up to.
#[derive(Clone, Copy, Debug)]
struct Sum {
    turned: UnitQuaternion<f64>,
    /// m/s.
    pushed: Vector3<f64>,
}

impl Sum {
    fn add(&mut self, mean: &Sample, lasting: Duration) {
        let dt = lasting.as_secs_f64();
        self.turned *= UnitQuaternion::from_scaled_axis(mean.rates * dt);
        self.pushed += mean.specific_force * dt;
    }
}

/// Collects messages until a frame is whole.
#[derive(Debug, Default)]
pub struct Collector {
    /// In order of time.
    samples: VecDeque<Sample>,
    fix: Option<SatelliteFix>,
    last_frame: Option<Stamp>,
}

impl Collector {
    /// A sample of the inertial unit; what is no measurement, or comes late, is left out.
    pub fn add_imu(&mut self, imu: &Imu<'_>) {
        let is_rate = imu.rates.norm() < FASTEST_RAD_S;
        let is_next = self.samples.back().is_none_or(|last| last.at < imu.at);
        let force_mps2 = imu.specific_force.norm();
        // A unit without an accelerometer says nought.
        let is_force = force_mps2 > 0.0 && force_mps2 < HARDEST_MPS2;
        if is_rate && is_next {
            self.samples.push_back(Sample {
                at: imu.at,
                rates: imu.rates,
                specific_force: if is_force {
                    imu.specific_force
                } else {
                    Vector3::repeat(f64::NAN)
                },
            });
            if self.samples.len() > MOST_SAMPLES {
                self.samples.pop_front();
            }
        }
    }

    /// A position; one without a fix is left out.
    pub(crate) fn add_fix(&mut self, fix: &NavSatFix<'_>) {
        let variances = fix.variances_m2;
        let numbers = [fix.latitude_deg, fix.longitude_deg, fix.altitude_m];
        let is_place = numbers.iter().all(|n| n.is_finite())
            && fix.latitude_deg.abs() <= 90.0
            && fix.longitude_deg.abs() <= 180.0;
        let is_known = variances.iter().all(|v| v.is_finite() && *v > 0.0);
        if fix.status >= 0 && is_place && is_known {
            self.fix = Some(SatelliteFix {
                at: fix.at,
                latitude_deg: fix.latitude_deg,
                longitude_deg: fix.longitude_deg,
                altitude_m: fix.altitude_m,
                variances_m2: variances,
            });
        }
    }

    /// A frame of that time is whole: what was measured since the one before.
    pub fn until(&mut self, frame: Stamp) -> Beside {
        let before = self.last_frame.replace(frame);
        let measured = before.and_then(|before| Some((before, self.sum(before, frame)?)));
        // The last sample before the frame is the first of the next one's.
        while self.samples.get(1).is_some_and(|s| s.at <= frame) {
            self.samples.pop_front();
        }
        let mean = |(before, sum): (Stamp, Sum)| sum.pushed / frame.since(before).as_secs_f64();
        Beside {
            turned: measured.map(|(_, sum)| sum.turned),
            specific_force: measured
                .map(mean)
                .filter(|force| force.iter().all(|c| c.is_finite())),
            fix: self.fix.take(),
        }
    }

    /// What was measured between two moments, added up; between two samples their mean holds, before the first and after
    /// the last the nearest.
    fn sum(&self, from: Stamp, to: Stamp) -> Option<Sum> {
        let mut sum = Sum {
            turned: UnitQuaternion::identity(),
            pushed: Vector3::zeros(),
        };
        let mut done = from;
        let mut last: Option<&Sample> = None;
        for sample in &self.samples {
            let mean = last.map_or(*sample, |last| last.mean(sample));
            let start = last.map_or(done, |last| last.at);
            let end = sample.at.min(to);
            if end > done {
                if sample.at.since(start) > LONGEST_GAP {
                    return None;
                }
                sum.add(&mean, end.since(done));
                done = end;
            }
            last = Some(sample);
        }
        let last = last?;
        if to.since(last.at) > LONGEST_GAP {
            return None;
        }
        sum.add(last, to.since(done));
        Some(sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: u64) -> Stamp {
        Stamp::from_nanos(1_000_000 * ms)
    }

    fn imu(at_ms: u64, rate: f64) -> Imu<'static> {
        Imu {
            at: ms(at_ms),
            frame_id: "imu",
            rates: Vector3::new(0.0, 0.0, rate),
            rates_variance: 0.0,
            specific_force: Vector3::zeros(),
            specific_force_variance: 0.0,
        }
    }

    /// Turned about z from the frame of 1000 ms to that of 1033 ms, with samples at these times that rise 1 rad/s each ms.
    fn turned(samples: impl IntoIterator<Item = u64>) -> Option<f64> {
        let mut collector = Collector::default();
        let mut samples = samples.into_iter().peekable();
        while let Some(at) = samples.next_if(|&at| at <= 1000) {
            collector.add_imu(&imu(at, (at as f64 - 1000.0) / 10.0));
        }
        assert_eq!(
            collector.until(ms(1000)).turned,
            None,
            "nothing before the first"
        );
        for at in samples {
            collector.add_imu(&imu(at, (at as f64 - 1000.0) / 10.0));
        }
        let turned = collector.until(ms(1033)).turned?;
        Some(turned.scaled_axis().z)
    }

    #[test]
    fn rates_add_up_between_two_frames_wherever_the_samples_lie() {
        // ∫ t/10 dt with t in ms, from 0 to 33 ms.
        let exact = 0.033 * 1.65;
        let all = turned((990..1040).step_by(1)).expect("samples");
        assert!((all - exact).abs() < 1e-4, "{all}");
        let coarse = turned((992..1040).step_by(5)).expect("samples");
        assert!((coarse - exact).abs() < 2e-3, "{coarse}");
        let late = turned((1002..=1032).step_by(5)).expect("within the gap at both ends");
        assert!((late - exact).abs() < 4e-3, "{late}");
    }

    #[test]
    fn the_specific_force_is_the_mean_over_the_time_between_frames() {
        let mean = |force: &dyn Fn(u64) -> f64| {
            let mut collector = Collector::default();
            for at in (990..1040).step_by(3) {
                collector.add_imu(&Imu {
                    specific_force: Vector3::new(0.0, 0.0, force(at)),
                    ..imu(at, 0.0)
                });
                if (1000..1003).contains(&at) {
                    collector.until(ms(1000));
                }
            }
            collector.until(ms(1033)).specific_force.map(|f| f.z)
        };
        let rising = mean(&|at| 9.8 + (at as f64 - 1000.0) / 10.0).expect("samples");
        assert!((rising - 9.8 - 1.65).abs() < 1e-3, "{rising}");
        assert_eq!(mean(&|_| 0.0), None, "no accelerometer");
        let broken = mean(&|at| if at == 1020 { f64::NAN } else { 9.8 });
        assert_eq!(broken, None);
    }

    #[test]
    fn a_silent_gyroscope_tells_no_turn() {
        assert_eq!(turned([]), None);
        assert_eq!(turned([995, 1000, 1005]), None, "nothing to the end");
        assert_eq!(turned([995, 1000, 1029, 1034]), None, "a gap in the middle");
        assert_eq!(turned([1025, 1030, 1035]), None, "nothing at the start");
    }

    #[test]
    fn numbers_that_are_no_measurement_are_left_out() {
        let mut collector = Collector::default();
        for (at, rate) in [
            (0, f64::NAN),
            (1, f64::INFINITY),
            (2, 1e9),
            (3, 1.0),
            (3, 2.0),
            (1, 3.0),
        ] {
            collector.add_imu(&imu(at, rate));
        }
        assert_eq!(collector.samples.len(), 1);
        for i in 0..3 * MOST_SAMPLES as u64 {
            collector.add_imu(&imu(10 + i, 0.0));
        }
        assert_eq!(collector.samples.len(), MOST_SAMPLES);
        let fix = NavSatFix {
            at: ms(1),
            frame_id: "gnss",
            status: 0,
            latitude_deg: 48.0,
            longitude_deg: 11.0,
            altitude_m: 500.0,
            variances_m2: [1.0; 3],
        };
        for bad in [
            NavSatFix {
                status: -1,
                ..fix.clone()
            },
            NavSatFix {
                latitude_deg: f64::NAN,
                ..fix.clone()
            },
            NavSatFix {
                longitude_deg: 181.0,
                ..fix.clone()
            },
            NavSatFix {
                variances_m2: [1.0, 0.0, 1.0],
                ..fix.clone()
            },
        ] {
            collector.add_fix(&bad);
            assert_eq!(collector.until(ms(5)).fix, None, "{bad:?}");
        }
        collector.add_fix(&fix);
        assert_eq!(
            collector.until(ms(6)).fix.map(|f| f.altitude_m),
            Some(500.0)
        );
        assert_eq!(collector.until(ms(7)).fix, None, "each is told once");
    }
}
