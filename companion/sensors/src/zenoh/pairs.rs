//! Puts colour and depth images together as they come.
//!
//! A pair is given as soon as no later image could be a nearer partner of either: at once where the stamps are equal,
//! else when the older one's kind has gone on. Images come in order of time on each topic.

use std::collections::BTreeMap;
use std::time::Duration;

use maps::time::Stamp;

use crate::pairing::mutual_nearest;

/// How many images of each kind wait for partners.
const MOST_WAITING: usize = 8;

/// Images whose partners have not come yet.
pub(super) struct Pairs<T> {
    colors: BTreeMap<Stamp, T>,
    depths: BTreeMap<Stamp, T>,
    /// The stamps of the last pair.
    last: Option<(Stamp, Stamp)>,
    window: Duration,
    pub(super) unused: Unused,
}

/// How many images are in no pair.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Unused {
    /// Those that got no partner.
    pub(super) unpaired: u64,
    /// Those not newer than the last pair's, or the same again.
    pub(super) late: u64,
}

/// Which of the two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Color,
    Depth,
}

/// Whether more images are to come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum More {
    Yes,
    No,
}

impl<T> Pairs<T> {
    /// Pairs images at most this far apart.
    pub(super) fn new(window: Duration) -> Self {
        Self {
            colors: BTreeMap::new(),
            depths: BTreeMap::new(),
            last: None,
            window,
            unused: Unused::default(),
        }
    }

    /// One more image.
    pub(super) fn add(&mut self, kind: Kind, at: Stamp, image: T) {
        let (images, last) = match kind {
            Kind::Color => (&mut self.colors, self.last.map(|(color, _)| color)),
            Kind::Depth => (&mut self.depths, self.last.map(|(_, depth)| depth)),
        };
        if last.is_some_and(|last| at <= last) || images.insert(at, image).is_some() {
            self.unused.late += 1;
        }
        if images.len() > MOST_WAITING && images.pop_first().is_some() {
            self.unused.unpaired += 1;
        }
    }

    /// The earliest pair that is certain, if there is one.
    pub(super) fn next(&mut self, more: More) -> Option<(T, T)> {
        let colors: Vec<Stamp> = self.colors.keys().copied().collect();
        let depths: Vec<Stamp> = self.depths.keys().copied().collect();
        let pairs = mutual_nearest(&colors, &depths, self.window);
        let &(color, depth) = pairs.first()?;
        let (color_at, depth_at) = (colors[color], depths[depth]);
        let has_later = |images: &[Stamp], at| images.last().is_some_and(|&last| last > at);
        let is_certain = (depth_at >= color_at || has_later(&depths, depth_at))
            && (color_at >= depth_at || has_later(&colors, color_at));
        if more == More::Yes && !is_certain {
            return None;
        }
        self.last = Some((color_at, depth_at));
        self.unused.unpaired += (color + depth) as u64;
        Some((
            take_with_those_before(&mut self.colors, color_at)?,
            take_with_those_before(&mut self.depths, depth_at)?,
        ))
    }
}

/// The image of that stamp; those before it are dropped.
fn take_with_those_before<T>(images: &mut BTreeMap<Stamp, T>, at: Stamp) -> Option<T> {
    let mut later = images.split_off(&at);
    let image = later.remove(&at);
    *images = later;
    image
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Colour (`c`) and depth (`d`) images of these milliseconds, in this order; which pairs are given after which image.
    #[track_caller]
    fn check(images: &[(char, u64)], expected: &[(usize, u64, u64)], losses: [u64; 2]) {
        let mut pairs = Pairs::new(Duration::from_millis(20));
        let mut found = Vec::new();
        for (number, &(kind, ms)) in images.iter().enumerate() {
            let kind = if kind == 'c' {
                Kind::Color
            } else {
                Kind::Depth
            };
            pairs.add(kind, Stamp::from_nanos(ms * 1_000_000), ms);
            while let Some((color, depth)) = pairs.next(More::Yes) {
                found.push((number + 1, color, depth));
            }
        }
        while let Some((color, depth)) = pairs.next(More::No) {
            found.push((images.len() + 1, color, depth));
        }
        assert_eq!(found, expected, "{images:?}");
        assert_eq!(
            [pairs.unused.unpaired, pairs.unused.late],
            losses,
            "{images:?}"
        );
    }

    #[test]
    fn images_of_one_instant_are_paired_at_once() {
        check(
            &[('c', 0), ('d', 0), ('d', 33), ('c', 33)],
            &[(2, 0, 0), (4, 33, 33)],
            [0, 0],
        );
    }

    #[test]
    fn other_images_are_paired_when_no_nearer_one_can_come() {
        // The depth image of 25 ms is nearer to the colour image of 33 ms than to that of 10 ms.
        check(
            &[
                ('c', 10),
                ('d', 25),
                ('c', 33),
                ('d', 58),
                ('c', 66),
                ('d', 90),
            ],
            &[(4, 33, 25), (6, 66, 58)],
            [1, 0],
        );
        // The last one waits for its end.
        check(&[('c', 10), ('d', 15)], &[(3, 10, 15)], [0, 0]);
    }

    #[test]
    fn images_without_a_partner_are_counted_and_never_more_than_a_few_wait() {
        let lonely: Vec<(char, u64)> = (0..100).map(|n| ('c', 33 * n)).collect();
        check(&lonely, &[], [92, 0]);
        check(
            &[('c', 0), ('d', 100), ('c', 100)],
            &[(3, 100, 100)],
            [1, 0],
        );
    }

    #[test]
    fn images_of_before_the_last_pair_are_late() {
        let mut pairs = Pairs::new(Duration::from_millis(20));
        for (kind, ms) in [(Kind::Color, 50), (Kind::Depth, 50)] {
            pairs.add(kind, Stamp::from_nanos(ms), ms);
        }
        assert_eq!(pairs.next(More::Yes), Some((50, 50)));
        for (kind, ms) in [(Kind::Color, 40), (Kind::Depth, 40), (Kind::Color, 50)] {
            pairs.add(kind, Stamp::from_nanos(ms), ms);
        }
        assert_eq!(pairs.unused.late, 3);
        assert_eq!(pairs.next(More::No), None, "time does not go back");
    }
}
