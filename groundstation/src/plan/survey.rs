//! Lawn-mower lines over a rectangle.
//!
//! ```text
//! n = ⌈short / spacing⌉ lines along the long side, short / n apart, half a step inside the edges;
//! the first corner is the one nearest to where the vehicle is
//! ```
//!
//! so the strips of width `spacing` about the lines cover the whole rectangle, with the fewest turns.

use crate::command::SurveyArea;

/// More lines than this are surely a typing error.
pub const MAX_LINES: usize = 200;

/// Why no survey can be laid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SurveyError {
    /// A side of the rectangle has no length.
    #[error(
        "the survey area is {width_m:.1} m x {height_m:.1} m: it needs two corners that differ in both directions"
    )]
    Empty {
        /// East to west.
        width_m: f64,
        /// North to south.
        height_m: f64,
    },
    /// The lines are too close together for so large an area.
    #[error(
        "the survey would have {lines} lines, more than {MAX_LINES}: choose a larger spacing or a smaller area"
    )]
    TooManyLines {
        /// How many.
        lines: usize,
    },
    /// A number is missing or makes no sense.
    #[error(
        "the survey's corners, altitude and spacing must be finite, the last two greater than 0"
    )]
    NotANumber,
}

/// The corners of the flight over `area`, east and north, for a vehicle that is at `from`.
pub fn lines(area: &SurveyArea, from: [f64; 2]) -> Result<Vec<[f64; 2]>, SurveyError> {
    let numbers = [area.from_m, area.to_m, from].concat();
    let positive = |value: f64| value > 0.0 && value.is_finite();
    if !(numbers.iter().all(|n| n.is_finite())
        && positive(area.altitude_m)
        && positive(area.spacing_m))
    {
        return Err(SurveyError::NotANumber);
    }
    let low = [
        area.from_m[0].min(area.to_m[0]),
        area.from_m[1].min(area.to_m[1]),
    ];
    let high = [
        area.from_m[0].max(area.to_m[0]),
        area.from_m[1].max(area.to_m[1]),
    ];
    let size = [high[0] - low[0], high[1] - low[1]];
    if size.iter().any(|&side| side < 1e-3) {
        return Err(SurveyError::Empty {
            width_m: size[0],
            height_m: size[1],
        });
    }
    let (along, across) = if size[0] >= size[1] { (0, 1) } else { (1, 0) };
    // A hair less, so that 4 m at 1 m are 4 lines whatever the rounding.
    let wanted = (size[across] / area.spacing_m - 1e-9).ceil().max(1.0);
    if wanted > MAX_LINES as f64 {
        return Err(SurveyError::TooManyLines {
            lines: wanted.min(1e9) as usize,
        });
    }
    let step = size[across] / wanted;
    let nearer_high = |axis: usize| high[axis] - from[axis] < from[axis] - low[axis];
    let (mut forward, reverse_order) = (!nearer_high(along), nearer_high(across));
    let mut corners = Vec::with_capacity(2 * wanted as usize);
    for i in 0..wanted as usize {
        let i = if reverse_order {
            wanted as usize - 1 - i
        } else {
            i
        };
        let aside = low[across] + step * (i as f64 + 0.5);
        let ends = if forward {
            [low[along], high[along]]
        } else {
            [high[along], low[along]]
        };
        for end in ends {
            let mut corner = [0.0; 2];
            (corner[along], corner[across]) = (end, aside);
            corners.push(corner);
        }
        forward = !forward;
    }
    Ok(corners)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn area(from_m: [f64; 2], to_m: [f64; 2], spacing_m: f64) -> SurveyArea {
        SurveyArea {
            from_m,
            to_m,
            altitude_m: 2.0,
            spacing_m,
        }
    }

    #[test]
    fn the_lines_run_along_the_long_side_and_start_near_the_vehicle() {
        let corners = lines(&area([0.0, 0.0], [4.0, 2.0], 1.0), [4.5, 2.5]).expect("a survey");
        assert_eq!(corners, [[4.0, 1.5], [0.0, 1.5], [0.0, 0.5], [4.0, 0.5]]);
    }

    #[test]
    fn an_area_without_extent_and_too_many_lines_are_refused() {
        let flat = lines(&area([0.0, 0.0], [4.0, 0.0], 1.0), [0.0; 2]);
        assert_eq!(
            flat,
            Err(SurveyError::Empty {
                width_m: 4.0,
                height_m: 0.0
            })
        );
        let dense = lines(&area([0.0, 0.0], [400.0, 300.0], 1.0), [0.0; 2]);
        assert_eq!(dense, Err(SurveyError::TooManyLines { lines: 300 }));
        assert_eq!(
            lines(&area([f64::NAN, 0.0], [4.0, 4.0], 1.0), [0.0; 2]),
            Err(SurveyError::NotANumber)
        );
    }

    proptest! {
        #[test]
        fn every_place_is_within_half_a_spacing_of_a_line(
            a in prop::array::uniform2(-50.0..50.0), size in prop::array::uniform2(0.5..40.0),
            spacing in 0.5..10.0, at in prop::array::uniform2(0.0..1.0), from in prop::array::uniform2(-90.0..90.0),
        ) {
            let far = [a[0] + size[0], a[1] + size[1]];
            let corners = lines(&area(a, far, spacing), from).expect("a survey");
            let place = [a[0] + at[0] * size[0], a[1] + at[1] * size[1]];
            let nearest = corners.chunks_exact(2).map(|line| {
                let across = usize::from((line[0][1] - line[1][1]).abs() < 1e-9);
                f64::abs(line[0][across] - place[across])
            }).fold(f64::INFINITY, f64::min);
            prop_assert!(nearest <= spacing / 2.0 + 1e-9, "{nearest} m");
        }
    }
}
