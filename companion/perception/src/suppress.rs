//! Of several boxes of one object, the surest is kept.
//!
//! - Greedy non-maximum suppression, as in P. Felzenszwalb et al., *Object Detection with Discriminatively Trained
//!   Part-Based Models*, PAMI 2010, section 6.2; by class.

use crate::detection::{Detection, MOST_DETECTIONS};

/// Boxes of one class that share this much of their union are of one object.
const SAME: f32 = 0.45;
/// Only so many of the surest boxes are compared: a network that finds something everywhere must not take for ever.
const COMPARED: usize = 1000;

/// The detections without doubles, surest first.
pub(crate) fn suppress(mut found: Vec<Detection>) -> Vec<Detection> {
    // Stable, so that equally sure ones stay in the network's order.
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut kept: Vec<Detection> = Vec::new();
    for candidate in found.into_iter().take(COMPARED) {
        let double = |other: &Detection| {
            other.class == candidate.class && overlap(&other.bounds_px, &candidate.bounds_px) > SAME
        };
        if !kept.iter().any(double) {
            kept.push(candidate);
        }
        if kept.len() == MOST_DETECTIONS {
            break;
        }
    }
    kept
}

/// Intersection over union.
fn overlap(a: &[f32; 4], b: &[f32; 4]) -> f32 {
    let side = |low: f32, high: f32| (high - low).max(0.0);
    let area = |r: &[f32; 4]| side(r[0], r[2]) * side(r[1], r[3]);
    let common = side(a[0].max(b[0]), a[2].min(b[2])) * side(a[1].max(b[1]), a[3].min(b[3]));
    let union = area(a) + area(b) - common;
    if union > 0.0 { common / union } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::class::Class;

    fn found(class: usize, score: f32, left: f32) -> Detection {
        Detection {
            class: Class::from_index(class).expect("a class"),
            score,
            bounds_px: [left, 0.0, left + 10.0, 20.0],
        }
    }

    #[test]
    fn of_two_boxes_on_one_object_the_surer_stays_and_neighbours_stay_too() {
        let kept = suppress(vec![
            found(0, 0.6, 1.0),
            found(0, 0.9, 0.0),
            found(0, 0.5, 8.0),
            found(2, 0.7, 0.0),
        ]);
        assert_eq!(
            kept,
            [found(0, 0.9, 0.0), found(2, 0.7, 0.0), found(0, 0.5, 8.0)]
        );
    }

    #[test]
    fn no_more_are_reported_than_promised() {
        let many = (0..3000).map(|i| found(0, 0.5, 11.0 * i as f32)).collect();
        assert_eq!(suppress(many).len(), MOST_DETECTIONS);
    }

    #[test]
    fn half_of_a_box_is_a_third_of_the_union() {
        let third = overlap(&[0.0, 0.0, 10.0, 20.0], &[5.0, 0.0, 15.0, 20.0]);
        assert!((third - 1.0 / 3.0).abs() < 1e-6);
        assert!(overlap(&[0.0; 4], &[0.0; 4]).abs() < 1e-9, "not NaN");
    }
}
