//! Sixteen pixels at once: loops over arrays of one length, which the compiler turns into vector instructions.
//!
//! Such a loop has no branches and calls nothing that is not inlined. [`vectorised!`] compiles it twice: for any processor, and for
//! those with AVX2, where it takes half the time. Both do the same operations in the same order (none is fused with another), so
//! that the result has the same bits.

/// How many pixels are worked on together.
pub(crate) const LANES: usize = 16;

/// One number for each of them.
pub(crate) type Lanes<T = f32> = [T; LANES];

/// `lanes!(k => value)`: the value for each lane `k`.
///
/// A macro, because the compiler may leave a closure where it is, and then calls it once for each lane.
macro_rules! lanes {
    ($k:ident => $value:expr) => {{
        let mut all = [Default::default(); $crate::lanes::LANES];
        for ($k, lane) in all.iter_mut().enumerate() {
            *lane = $value;
        }
        all
    }};
}

/// Compiles a function also for AVX2, and calls that version where the processor has it.
macro_rules! vectorised {
    ($(#[$meta:meta])* $visible:vis fn $name:ident($($argument:ident: $kind:ty),* $(,)?) $(-> $out:ty)? $body:block) => {
        $(#[$meta])*
        $visible fn $name($($argument: $kind),*) $(-> $out)? {
            // So that it is compiled for AVX2, too.
            #[inline(always)]
            fn plain($($argument: $kind),*) $(-> $out)? $body

            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2")]
                fn with_avx2($($argument: $kind),*) $(-> $out)? {
                    plain($($argument),*)
                }
                if std::arch::is_x86_feature_detected!("avx2") {
                    #[expect(unsafe_code, reason = "nothing safe calls what only some processors can do")]
                    // SAFETY: the processor has AVX2, which was asked for in the line above; nothing else is required.
                    return unsafe { with_avx2($($argument),*) };
                }
            }
            plain($($argument),*)
        }
    };
}

pub(crate) use {lanes, vectorised};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::{at_cell, octaves, octaves_at, unit};

    vectorised! {
    fn noise(x: &Lanes, y: &Lanes, footprint: &Lanes) -> Lanes {
        octaves_at([x, y, footprint], 0.0, 4, 9)
    }
    }

    #[test]
    fn many_places_at_once_get_the_bits_that_one_at_a_time_gets() {
        for block in 0..500 {
            let random = |what: i32| lanes!(k => unit(at_cell(block * 16 + (k as u32).cast_signed(), what, 3)));
            let [x, y, size] = [1, 2, 3].map(random);
            let x = lanes!(k => (x[k] - 0.5) * 400.0);
            let y = lanes!(k => (y[k] - 0.5) * 400.0);
            let all = noise(&x, &y, &size);
            for k in 0..LANES {
                let one = octaves(x[k], y[k], 4, size[k], 9);
                assert_eq!(all[k].to_bits(), one.to_bits(), "at {}, {}", x[k], y[k]);
            }
        }
    }
}
