//! What the sensors of a vehicle make of the truth: those that need no picture.
//!
//! - [`imu`], [`barometer`], [`wheel_odometry`]: how the vehicle itself moves. [`allan`] tells their noise apart.
//! - [`gnss`]: where it is, with walls around it.
//! - [`rangefinder`], [`radar`]: what is around it.
//! - [`clock`]: what a platform believes the time is.
//! - [`fault`]: a script of what breaks when.
//!
//! Each sensor is a value with its own random generator. It is stepped with the true state and with time, reads no
//! clock and starts no thread: the same seed and the same calls give the same bits. A number that is not finite never
//! panics and never stays: it spoils or cancels the one reading it was given for, as each sensor says, and draws as
//! many random numbers as any other, so that later readings are what they would have been. A configuration is trusted:
//! one with NaN in it gives readings with NaN in them.

pub mod allan;
pub mod barometer;
pub mod clock;
pub mod fault;
pub mod gnss;
pub mod imu;
mod process;
pub mod radar;
pub mod rangefinder;
pub mod wheel_odometry;

/// The seed of one sensor among those of a run: sensors of other names are independent of it, and none changes when
/// another is added.
///
/// FNV-1a over the name, then the finaliser of `SplitMix64`, so that seeds 1 and 2 have nothing in common.
///
/// - G. Steele, D. Lea, C. Flood, *Fast splittable pseudorandom number generators*, OOPSLA 2014, Fig. 16.
pub fn child_seed(seed: u64, sensor: &str) -> u64 {
    let name = sensor
        .bytes()
        .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
        });
    let mut z = name ^ seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sensors_and_runs_have_seeds_of_their_own() {
        let names = ["imu", "gnss", "gnss-2", "barometer", ""];
        let mut seeds: Vec<u64> = (0..100)
            .flat_map(|seed| names.map(|name| child_seed(seed, name)))
            .collect();
        assert_eq!(
            child_seed(7, "imu"),
            seeds[7 * names.len()],
            "the same each time"
        );
        seeds.sort_unstable();
        seeds.dedup();
        assert_eq!(seeds.len(), 100 * names.len());
    }
}
