//! The rays of a scan by direction, and which of several threads casts which.
//!
//! Rays share the voxels near the sensor, and those of their neighbours. So they are cast sector by sector, which keeps in
//! the cache what they mark; and each thread has sectors that lie side by side, so that only where two shares meet is a block
//! marked twice. A thread that is done takes over from the far end of the longest share that is left.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

use nalgebra::Vector3;

/// Around the vertical axis of the sensor. A camera sees through a sixth of them, which is still some for each thread.
const SECTORS: usize = 128;

/// The sector of a ray; always the same, whichever that is, for one that points straight up.
pub(super) fn sector(ray: Vector3<f64>) -> u8 {
    // The way around a square, which is cheaper than that around a circle.
    let up = ray.y / (ray.x.abs() + ray.y.abs());
    let around = if ray.x < 0.0 { 3.0 - up } else { 1.0 + up };
    (around * (SECTORS as f64 / 4.0)) as u8 % SECTORS as u8
}

/// Points by sector, and in each as they come in the scan, of a part of it.
#[derive(Clone, Debug, Default)]
pub(super) struct Sectors {
    /// As they come, with their sectors.
    unsorted: Vec<(u32, u8)>,
    points: Vec<u32>,
    /// Where each sector ends.
    ends: Vec<usize>,
}

impl Sectors {
    /// Takes these points, each with the sector of its ray, for those before.
    pub(super) fn sort(&mut self, rays: impl Iterator<Item = (u32, u8)>) {
        self.unsorted.clear();
        self.unsorted.extend(rays);
        let mut counts = [0_usize; SECTORS];
        for (_, sector) in &self.unsorted {
            counts[usize::from(*sector)] += 1;
        }
        self.ends.clear();
        self.ends.extend(counts.iter().scan(0, |sum, count| {
            *sum += count;
            Some(*sum - count)
        }));
        self.points.clear();
        self.points.resize(self.unsorted.len(), 0);
        for (point, sector) in &self.unsorted {
            let end = &mut self.ends[usize::from(*sector)];
            self.points[*end] = *point;
            *end += 1;
        }
    }

    pub(super) fn points(&self, sector: usize) -> &[u32] {
        let start = sector.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.points[start..self.ends[sector]]
    }
}

/// The sectors that are left to each thread.
#[derive(Debug)]
pub(super) struct Shares(Vec<AtomicU64>);

impl Shares {
    /// Sectors side by side for each thread, with about as many rays.
    pub(super) fn new(parts: &[Sectors], threads: usize) -> Self {
        let end = |sector| parts.iter().map(|part| part.ends[sector]).sum::<usize>();
        let ends: Vec<_> = (0..SECTORS).map(end).collect();
        let rays = ends[SECTORS - 1];
        let cut = |thread: usize| ends.partition_point(|end| *end <= rays * thread / threads);
        let share = |thread| AtomicU64::new(packed(cut(thread)..cut(thread + 1)));
        Self((0..threads).map(share).collect())
    }

    /// The sector that a thread is to do next; `None` if none is left.
    pub(super) fn next(&self, thread: usize) -> Option<usize> {
        let own = take(&self.0[thread], Iterator::next);
        own.or_else(|| {
            loop {
                let left = |share: &&AtomicU64| unpacked(share.load(Ordering::Relaxed)).len();
                let longest = self.0.iter().max_by_key(left)?;
                if left(&longest) == 0 {
                    return None;
                }
                // If others were faster, there may be a share left elsewhere.
                let taken = take(longest, DoubleEndedIterator::next_back);
                if taken.is_some() {
                    return taken;
                }
            }
        })
    }
}

/// Takes a sector out of a share, which others may be doing too. Nothing but the number of the sector passes between threads.
fn take(share: &AtomicU64, which: impl Fn(&mut Range<usize>) -> Option<usize>) -> Option<usize> {
    let before = share
        .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |share| {
            let mut left = unpacked(share);
            which(&mut left).map(|_| packed(left))
        })
        .ok()?;
    which(&mut unpacked(before))
}

fn packed(share: Range<usize>) -> u64 {
    (share.start as u64) << 32 | share.end as u64
}

fn unpacked(share: u64) -> Range<usize> {
    (share >> 32) as usize..(share & u64::from(u32::MAX)) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rays to these sectors, sorted.
    fn sorted(sectors: &[u8]) -> Sectors {
        let mut sorted = Sectors::default();
        sorted.sort((0..).zip(sectors.iter().copied()));
        sorted
    }

    #[test]
    fn sectors_go_around_and_rays_that_are_near_are_in_the_same_or_the_next() {
        let of = |degrees: f64| {
            let angle = degrees.to_radians();
            i32::from(sector(Vector3::new(angle.cos(), angle.sin(), 0.7) * 9.0))
        };
        for step in 0..720 {
            let degrees = f64::from(step) / 2.0;
            let way = of(degrees + 0.5) - of(degrees);
            assert!([0, 1, -127].contains(&way), "{way} at {degrees}");
        }
        let quarters = [-89.0, 1.0, 91.0, 181.0].map(of);
        assert_eq!(quarters, [0, 32, 64, 96]);
        assert!(usize::from(sector(Vector3::z())) < SECTORS);
    }

    #[test]
    fn sorting_keeps_the_order_of_the_scan_within_a_sector() {
        let mut sectors = Sectors::default();
        for _ in 0..2 {
            sectors.sort((0..).zip([5, 0, 127, 5, 0, 5]));
            assert_eq!(sectors.points(0), [1, 4]);
            assert_eq!(sectors.points(1), []);
            assert_eq!(sectors.points(5), [0, 3, 5]);
            assert_eq!(sectors.points(127), [2]);
        }
    }

    #[test]
    fn each_sector_with_rays_is_done_once_by_whichever_thread_is_free() {
        let some: Vec<u8> = (0..100).flat_map(|i| [20 + i / 4, 20 + i / 4]).collect();
        let parts = [sorted(&some[..90]), sorted(&some[90..])];
        for threads in [1, 2, 3, 7] {
            let shares = Shares::new(&parts, threads);
            // The first does two, then each of the others one, until nothing is left.
            let mut order = [0].into_iter().chain(0..threads).cycle();
            let mut done = Vec::new();
            while let Some(sector) = shares.next(order.next().unwrap_or_default()) {
                done.push(sector);
            }
            assert!((0..threads).all(|thread| shares.next(thread).is_none()));
            done.sort_unstable();
            let with_rays: Vec<_> = (20..45).collect();
            done.retain(|sector| parts.iter().any(|part| !part.points(*sector).is_empty()));
            assert_eq!(done, with_rays, "{threads} threads");
        }
    }

    #[test]
    fn what_is_left_is_taken_from_the_far_end_of_the_longest_share() {
        let around: Vec<u8> = (0..128).collect();
        let shares = Shares::new(&[sorted(&around)], 2);
        let next = |thread, count| {
            (0..count)
                .filter_map(|_| shares.next(thread))
                .collect::<Vec<_>>()
        };
        assert_eq!(next(0, 2), [0, 1]);
        assert_eq!(next(1, 64), (64..128).collect::<Vec<_>>());
        assert_eq!(next(1, 2), [63, 62]);
        assert_eq!(next(0, 61), (2..62).collect::<Vec<_>>());
        assert_eq!(next(1, 1), []);
    }

    #[test]
    fn no_rays_are_no_work() {
        let sectors = sorted(&[]);
        let shares = Shares::new(std::slice::from_ref(&sectors), 3);
        let done: usize = std::iter::from_fn(|| shares.next(1))
            .map(|s| sectors.points(s).len())
            .sum();
        assert_eq!(done, 0);
    }
}
