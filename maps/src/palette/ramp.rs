//! A colour ramp in which equal steps look equal, for heights and for how sure a voxel is.
//!
//! ```text
//! L(t) = 0.36 + 0.54 t      h(t) = 292° - 187° t      C = 0.15, less where the screen cannot show it
//! (l, m, s) = (M₂⁻¹ (L, C cos h, C sin h))³           linear rgb = M₁⁻¹ (l, m, s)
//! ```
//!
//! Lightness rises evenly from violet through teal and green to yellow, so the ramp also reads in grey and with any
//! colour blindness.
//!
//! - B. Ottosson, *A perceptual color space for image processing* (Oklab), 2020: the matrices.

/// The colour of `t` in `0..=1`, low to high; outside it is clamped.
pub fn ramp(t: f64) -> [u8; 3] {
    let t = if t.is_finite() {
        t.clamp(0.0, 1.0)
    } else {
        0.0
    };
    let lightness = 0.36 + 0.54 * t;
    let (sin, cos) = (292.0 - 187.0 * t).to_radians().sin_cos();
    let mut chroma = 0.15;
    let mut rgb = linear_from_oklab([lightness, chroma * cos, chroma * sin]);
    while rgb.iter().any(|c| !(0.0..=1.0).contains(c)) && chroma > 0.0 {
        chroma -= 0.005;
        rgb = linear_from_oklab([lightness, chroma * cos, chroma * sin]);
    }
    rgb.map(|linear| (255.0 * gamma_from_linear(linear.clamp(0.0, 1.0))).round() as u8)
}

fn linear_from_oklab([lightness, a, b]: [f64; 3]) -> [f64; 3] {
    let l = (lightness + 0.396_337_777_4 * a + 0.215_803_757_3 * b).powi(3);
    let m = (lightness - 0.105_561_345_8 * a - 0.063_854_172_8 * b).powi(3);
    let s = (lightness - 0.089_484_177_5 * a - 1.291_485_548_0 * b).powi(3);
    [
        4.076_741_662_1 * l - 3.307_711_591_3 * m + 0.230_969_929_2 * s,
        -1.268_438_004_6 * l + 2.609_757_401_1 * m - 0.341_319_396_5 * s,
        -0.004_196_086_3 * l - 0.703_418_614_7 * m + 1.707_614_701_0 * s,
    ]
}

/// IEC 61966-2-1, the transfer of sRGB.
fn gamma_from_linear(linear: f64) -> f64 {
    if linear <= 0.003_130_8 {
        12.92 * linear
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn higher_is_lighter_at_every_step() {
        let luma = |t: f64| {
            let [r, g, b] = ramp(t).map(f64::from);
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        for step in 0..20 {
            let (low, high) = (f64::from(step) / 20.0, f64::from(step + 1) / 20.0);
            assert!(
                luma(low) < luma(high),
                "{low}: {:?}, {high}: {:?}",
                ramp(low),
                ramp(high)
            );
        }
    }

    #[test]
    fn out_of_range_is_the_nearest_end() {
        assert_eq!(ramp(-1.0), ramp(0.0));
        assert_eq!(ramp(7.0), ramp(1.0));
        assert_eq!(ramp(f64::NAN), ramp(0.0));
    }
}
