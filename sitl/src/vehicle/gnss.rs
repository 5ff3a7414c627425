//! What a positioning system says: errors that wander, as those of real receivers do, and a little white noise.
//!
//! ```text
//! e(t + dt) = e(t)·exp(-dt/τ) + σ·√(1 - exp(-2dt/τ))·n        (first-order Gauss-Markov)
//! ```
//!
//! Independent noise at every fix would average out in a second and flatter every filter; the wandering part does not.
//!
//! - R. G. Brown, P. Y. C. Hwang, *Introduction to Random Signals and Applied Kalman Filtering*, 4th ed., §9.3.

use maps::frame::{Point, Vector, World};
use nalgebra::Vector3;
use rand::{Rng, RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

/// How good the receiver is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Standard deviation of the wandering error along east and north.
    pub horizontal_m: f64,
    /// The same upwards.
    pub vertical_m: f64,
    /// How long the error takes to forget itself.
    pub correlation_s: f64,
    /// Standard deviation of the white part along each axis.
    pub white_m: f64,
}

impl Quality {
    /// RTK with a fixed solution, as a vehicle of 0.4 m between furniture needs.
    pub const RTK_FIXED: Self = Self {
        horizontal_m: 0.03,
        vertical_m: 0.05,
        correlation_s: 60.0,
        white_m: 0.005,
    };
}

/// A receiver and its present error.
#[derive(Clone, Debug)]
pub struct Gnss {
    /// How good it is.
    pub quality: Quality,
    wander: Vector3<f64>,
    random: Pcg64,
}

impl Gnss {
    /// A receiver whose error is already what it is on average.
    pub fn new(quality: Quality, seed: u64) -> Self {
        let mut random = Pcg64::seed_from_u64(seed);
        let noise = [(); 3].map(|()| gaussian(&mut random));
        let wander = Vector3::from(noise).component_mul(&spread(quality));
        Self {
            quality,
            wander,
            random,
        }
    }

    /// Lets the error wander on for `dt` seconds and measures where it says `truth` is.
    pub fn measure(&mut self, truth: Point<World>, dt: f64) -> Point<World> {
        let keep = (-dt / self.quality.correlation_s).exp();
        let fresh = (1.0 - keep * keep).sqrt();
        let noise = Vector3::from([(); 3].map(|()| gaussian(&mut self.random)));
        self.wander = self.wander * keep + noise.component_mul(&spread(self.quality)) * fresh;
        let white =
            Vector3::from([(); 3].map(|()| gaussian(&mut self.random))) * self.quality.white_m;
        truth + Vector::from_raw(self.wander + white)
    }
}

fn spread(quality: Quality) -> Vector3<f64> {
    Vector3::new(
        quality.horizontal_m,
        quality.horizontal_m,
        quality.vertical_m,
    )
}

/// A number of zero mean and unit variance (Box and Muller, 1958).
pub(crate) fn gaussian(random: &mut impl Rng) -> f64 {
    let radius: f64 = 1.0 - random.random::<f64>();
    let angle: f64 = random.random::<f64>() * std::f64::consts::TAU;
    (-2.0 * radius.ln()).sqrt() * angle.cos()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_wanders_with_the_stated_spread_and_correlation() {
        let quality = Quality::RTK_FIXED;
        let mut gnss = Gnss::new(quality, 1);
        // Four hours at 5 Hz: 240 correlation times.
        let errors: Vec<f64> = (0..72_000)
            .map(|_| gnss.measure(Point::origin(), 0.2).raw.x)
            .collect();
        let mean_of = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let squares: Vec<f64> = errors.iter().map(|e| e * e).collect();
        let spread = mean_of(&squares).sqrt();
        assert!((0.024..0.036).contains(&spread), "{spread} m");
        let later: Vec<f64> = errors
            .iter()
            .zip(&errors[300..])
            .map(|(a, b)| a * b)
            .collect();
        let kept = mean_of(&later) / mean_of(&squares);
        // exp(-1) after one correlation time.
        assert!((0.22..0.5).contains(&kept), "{kept}");
    }
}
