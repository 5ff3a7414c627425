//! Sites of 100 m × 100 m, made of voxels from a seed: uneven ground, buildings, walls with gaps, parked cars, trees to
//! drive under, a ditch with crossings, a bridge to drive under, and places that nobody has seen.

use maps::voxel::{LogOdds, Voxel, VoxelKey, VoxelMap};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

/// Edge of a voxel.
pub(super) const RESOLUTION_M: f64 = 0.2;
/// Edge of a site, in voxels.
pub(super) const EDGE: i32 = 500;

const OCCUPIED: Voxel = Voxel::new(LogOdds::MAX);

/// The site of a seed.
pub(super) fn site(seed: u64) -> VoxelMap {
    let mut site = Site::new(seed);
    site.ditch();
    for _ in 0..9 {
        site.building();
    }
    for _ in 0..8 {
        site.wall();
    }
    for _ in 0..12 {
        site.parked_cars();
    }
    for _ in 0..40 {
        site.tree();
    }
    site.bridge();
    site.build()
}

struct Site {
    random: Pcg64,
    /// Height of the ground, in voxels; none where nobody has seen it.
    ground: Vec<Option<i32>>,
    /// Boxes over the ground: x, y, width, depth, and from which to which voxel over it.
    boxes: Vec<([i32; 4], [i32; 2])>,
}

impl Site {
    fn new(seed: u64) -> Self {
        let mut random = Pcg64::seed_from_u64(seed);
        let waves: [[f64; 4]; 4] = std::array::from_fn(|_| {
            [
                random.random_range(0.05..0.14),
                random.random_range(0.05..0.14),
                random.random_range(0.0..6.3),
                random.random_range(0.1..0.5),
            ]
        });
        let height = |x: i32, y: i32| {
            let (x, y) = (f64::from(x) * RESOLUTION_M, f64::from(y) * RESOLUTION_M);
            let metres: f64 = waves
                .iter()
                .map(|[u, v, phase, high]| high * (u * x + v * y + phase).sin())
                .sum();
            (metres / RESOLUTION_M).round() as i32
        };
        let unseen: [[i32; 3]; 5] = std::array::from_fn(|_| {
            [
                random.random_range(0..EDGE),
                random.random_range(0..EDGE),
                random.random_range(8..25),
            ]
        });
        let seen = |x: i32, y: i32| {
            unseen
                .iter()
                .all(|[u, v, r]| (x - u).pow(2) + (y - v).pow(2) > r * r)
        };
        Self {
            ground: (0..EDGE * EDGE)
                .map(|i| (i % EDGE, i / EDGE))
                .map(|(x, y)| seen(x, y).then(|| height(x, y)))
                .collect(),
            boxes: Vec::new(),
            random,
        }
    }

    fn place(&mut self, width: i32, depth: i32) -> [i32; 2] {
        [
            self.random.random_range(5..EDGE - width - 5),
            self.random.random_range(5..EDGE - depth - 5),
        ]
    }

    /// 1.4 m deep and 3 m wide across the whole site, with three crossings 5 m wide.
    fn ditch(&mut self) {
        let at = self.random.random_range(150..350);
        let crossings: [i32; 3] = [0, 160, 320].map(|from| self.random.random_range(0..120) + from);
        for y in at..at + 15 {
            for x in 0..EDGE {
                let crosses = crossings.iter().any(|c| (c..&(c + 25)).contains(&&x));
                let cell = &mut self.ground[(y * EDGE + x) as usize];
                *cell = cell.map(|height| if crosses { height } else { height - 7 });
            }
        }
    }

    fn building(&mut self) {
        let (width, depth) = (
            self.random.random_range(30..90),
            self.random.random_range(30..90),
        );
        let [x, y] = self.place(width, depth);
        let height = self.random.random_range(15..30);
        self.boxes.push(([x, y, width, depth], [1, height]));
    }

    /// 0.6 m high and 20 m long with a gap of 3 to 4.4 m.
    fn wall(&mut self) {
        let gap = self.random.random_range(15..22);
        let first = self.random.random_range(15..70);
        let along_x = self.random.random_range(0..2) == 0;
        let [x, y] = self.place(105, 105);
        for (from, to) in [(0, first), (first + gap, 100)] {
            let area = if along_x {
                [x + from, y, to - from, 2]
            } else {
                [x, y + from, 2, to - from]
            };
            self.boxes.push((area, [1, 3]));
        }
    }

    /// Two to six of 4.4 m × 1.8 m side by side.
    fn parked_cars(&mut self) {
        let count = self.random.random_range(2..6);
        let [x, y] = self.place(22, 15 * count);
        for i in 0..count {
            if self.random.random_range(0..4) > 0 {
                self.boxes.push(([x, y + 15 * i, 22, 9], [1, 7]));
            }
        }
    }

    /// A trunk of 0.4 m and a crown whose underside is 2.4 to 4 m over the ground.
    fn tree(&mut self) {
        let [x, y] = self.place(21, 21);
        let under = self.random.random_range(12..20);
        self.boxes.push(([x + 10, y + 10, 2, 2], [1, under]));
        self.boxes
            .push(([x + 2, y + 2, 18, 18], [under, under + 8]));
    }

    /// A deck 8 m wide and 30 m long, 4.6 m over the ground, on two rows of pillars.
    fn bridge(&mut self) {
        let [x, y] = self.place(150, 40);
        self.boxes.push(([x, y, 150, 40], [23, 25]));
        for i in 0..6 {
            for side in [0, 38] {
                self.boxes.push(([x + 28 * i, y + side, 3, 2], [1, 23]));
            }
        }
    }

    fn build(self) -> VoxelMap {
        let mut map = VoxelMap::new(RESOLUTION_M);
        for y in 0..EDGE {
            for x in 0..EDGE {
                let Some(height) = self.ground[(y * EDGE + x) as usize] else {
                    continue;
                };
                // As thick as hides the sides of the ditch.
                for z in height - 1..=height {
                    map.set_voxel(VoxelKey::new(x, y, z), OCCUPIED);
                }
            }
        }
        for ([x, y, width, depth], [from, to]) in &self.boxes {
            let middle = (y + depth / 2) * EDGE + x + width / 2;
            let base = self.ground[middle as usize].unwrap_or(0);
            for v in *y..(y + depth).min(EDGE) {
                for u in *x..(x + width).min(EDGE) {
                    for z in base + from..base + to {
                        map.set_voxel(VoxelKey::new(u, v, z), OCCUPIED);
                    }
                }
            }
        }
        map
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_makes_one_site_and_another_seed_another() {
        let digest = |seed| site(seed).digest();
        assert_eq!(digest(1), digest(1));
        assert_ne!(digest(1), digest(2));
    }
}
