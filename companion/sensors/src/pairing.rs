//! Which colour and which depth image belong together: those that are each other's nearest in time.

use std::time::Duration;

use maps::time::Stamp;

/// Pairs of indices into `colors` and `depths`, both in order of time. No image is in two pairs; those of equal stamps
/// count once. `n log n`, whatever the stamps.
pub(crate) fn mutual_nearest(
    colors: &[Stamp],
    depths: &[Stamp],
    max_difference: Duration,
) -> Vec<(usize, usize)> {
    let partner = |(color, &at): (usize, &Stamp)| {
        let depth = nearest(depths, at)?;
        let close = at.distance(depths[depth]) <= max_difference;
        (close && nearest(colors, depths[depth]) == Some(color)).then_some((color, depth))
    };
    colors.iter().enumerate().filter_map(partner).collect()
}

/// Which image was taken nearest to `at`; the earlier of two.
fn nearest(images: &[Stamp], at: Stamp) -> Option<usize> {
    let after = images.partition_point(|&stamp| stamp < at);
    let earlier = after.checked_sub(1);
    // The first of those with the same stamp.
    let earlier = earlier.map(|index| images.partition_point(|&stamp| stamp < images[index]));
    let later = (after < images.len()).then_some(after);
    [earlier, later]
        .into_iter()
        .flatten()
        .min_by_key(|&index| images[index].distance(at))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(colors_ms: &[u64], depths_ms: &[u64], expected: &[(usize, usize)]) {
        let stamps = |ms: &[u64]| {
            ms.iter()
                .map(|ms| Stamp::from_nanos(ms * 1_000_000))
                .collect()
        };
        let (colors, depths): (Vec<Stamp>, Vec<Stamp>) = (stamps(colors_ms), stamps(depths_ms));
        let found = mutual_nearest(&colors, &depths, Duration::from_millis(20));
        assert_eq!(found, expected, "{colors_ms:?} with {depths_ms:?}");
    }

    #[test]
    fn images_are_paired_with_their_nearest_and_never_twice() {
        check(&[0, 33, 67], &[14, 48, 81], &[(0, 0), (1, 1), (2, 2)]);
        check(&[0, 33, 67], &[30], &[(1, 0)]);
        check(&[100, 110], &[106], &[(1, 0)]);
        check(&[100], &[], &[]);
        check(&[], &[100], &[]);
    }

    #[test]
    fn images_more_than_the_window_apart_are_not_paired() {
        check(&[100], &[120], &[(0, 0)]);
        check(&[100], &[121], &[]);
    }

    #[test]
    fn an_image_listed_twice_is_taken_once() {
        check(&[100, 100], &[101, 101, 101], &[(0, 0)]);
    }
}
