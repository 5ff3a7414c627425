//! Debian's liboctomap as a judge of our files and a rival of our insertion, in tests and benches only.

use std::path::Path;

use cxx::UniquePtr;
use maps::frame::{Point, World};
use maps::voxel::Occupancy;

#[cxx::bridge(namespace = "tandem")]
mod ffi {
    unsafe extern "C++" {
        include!("octomap/src/referee.h");

        type Referee;

        fn empty(resolution: f64) -> UniquePtr<Referee>;
        fn read(path: &str) -> Result<UniquePtr<Referee>>;
        fn resolution(&self) -> f64;
        fn nodes(&self) -> usize;
        fn occupied(&self) -> u64;
        fn known(&self) -> u64;
        fn occupancy(&self, x: f64, y: f64, z: f64) -> u8;
        fn write_ot(self: Pin<&mut Referee>, path: &str) -> bool;
        fn write_bt(self: Pin<&mut Referee>, path: &str) -> bool;
        fn insert_scan(self: Pin<&mut Referee>, points: &[f64], x: f64, y: f64, z: f64);
        fn set_cloud(self: Pin<&mut Referee>, points: &[f32]);
        fn insert_cloud(self: Pin<&mut Referee>, origin: &[f32; 3], max_range: f64, mode: u8);
        fn update_inner(self: Pin<&mut Referee>);
        fn count_occupied(&self, keys: &[i32]) -> usize;
        fn occupancies(&self, keys: &[i32], states: &mut [u8]);
        fn cast_rays(
            &self,
            origin: &[f32; 3],
            directions: &[f32],
            max_range: f64,
            distances: &mut [f32],
        );
        fn heap_bytes() -> usize;
        fn trim_heap();
    }
}

/// What liboctomap could not do, in its words.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Refused(pub(crate) String);

/// A map in liboctomap.
pub struct Referee(UniquePtr<ffi::Referee>);

impl Referee {
    /// An empty map.
    pub fn new(resolution_m: f64) -> Self {
        Self(ffi::empty(resolution_m))
    }

    /// Reads a `.bt` or, whatever else its name ends in, a `.ot` file.
    pub fn read(path: &Path) -> Result<Self, Refused> {
        ffi::read(&path.to_string_lossy())
            .map(Self)
            .map_err(|e| Refused(e.what().to_owned()))
    }

    /// The edge of a voxel.
    pub fn resolution_m(&self) -> f64 {
        self.0.resolution()
    }

    /// How many nodes the tree has, inner ones included.
    pub fn nodes(&self) -> usize {
        self.0.nodes()
    }

    /// How many voxels are occupied; a pruned leaf counts as all its voxels.
    pub fn occupied_count(&self) -> u64 {
        self.0.occupied()
    }

    /// How many voxels are free or occupied.
    pub fn known_count(&self) -> u64 {
        self.0.known()
    }

    /// What is known of a place.
    pub fn occupancy(&self, p: Point<World>) -> Occupancy {
        match self.0.occupancy(p.raw.x, p.raw.y, p.raw.z) {
            0 => Occupancy::Unknown,
            1 => Occupancy::Free,
            _ => Occupancy::Occupied,
        }
    }

    /// What is known of many voxels, given by their coordinates, three a voxel.
    pub fn occupancies(&self, keys: &[i32]) -> Vec<Occupancy> {
        let mut states = vec![0; keys.len() / 3];
        self.0.occupancies(keys, &mut states);
        states
            .into_iter()
            .map(|state| match state {
                0 => Occupancy::Unknown,
                1 => Occupancy::Free,
                _ => Occupancy::Occupied,
            })
            .collect()
    }

    /// How many of these voxels are occupied, given by their coordinates, three a voxel.
    pub fn count_occupied(&self, keys: &[i32]) -> usize {
        self.0.count_occupied(keys)
    }

    /// How far rays from one point get, in metres to the centre of the voxel that stops them; negative if nothing does.
    /// Directions have three components a ray.
    pub fn cast_rays(&self, origin: [f32; 3], directions: &[f32], max_range_m: f64) -> Vec<f32> {
        let mut distances = vec![-1.0; directions.len() / 3];
        self.0
            .cast_rays(&origin, directions, max_range_m, &mut distances);
        distances
    }

    /// Writes a `.ot` file.
    pub fn write_ot(&mut self, path: &Path) -> Result<(), Refused> {
        let written = self.0.pin_mut().write_ot(&path.to_string_lossy());
        written
            .then_some(())
            .ok_or_else(|| Refused(format!("liboctomap does not write {}", path.display())))
    }

    /// Writes a `.bt` file. The tree forgets how sure it was.
    pub fn write_bt(&mut self, path: &Path) -> Result<(), Refused> {
        let written = self.0.pin_mut().write_bt(&path.to_string_lossy());
        written
            .then_some(())
            .ok_or_else(|| Refused(format!("liboctomap does not write {}", path.display())))
    }

    /// Inserts points, one ray for each voxel in which any end, of any length.
    pub fn insert_scan(&mut self, origin: Point<World>, hits: &[Point<World>]) {
        let points: Vec<_> = hits
            .iter()
            .flat_map(|p| [p.raw.x, p.raw.y, p.raw.z])
            .collect();
        let [x, y, z] = origin.raw.coords.into();
        self.0.pin_mut().insert_scan(&points, x, y, z);
    }

    /// Hands over points, three coordinates each, for [`Self::insert_cloud`].
    pub fn set_cloud(&mut self, points: &[f32]) {
        self.0.pin_mut().set_cloud(points);
    }

    /// `insertPointCloud` of the points handed over before.
    pub fn insert_cloud(&mut self, origin: [f32; 3], max_range_m: f64, mode: Insertion) {
        let mode = match mode {
            Insertion::Plain => 0,
            Insertion::Discretized => 1,
            Insertion::DiscretizedLazy => 3,
        };
        self.0.pin_mut().insert_cloud(&origin, max_range_m, mode);
    }

    /// Makes the inner nodes right again after lazy insertion.
    pub fn update_inner(&mut self) {
        self.0.pin_mut().update_inner();
    }
}

/// How liboctomap inserts a cloud.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Insertion {
    /// One ray for each point.
    Plain,
    /// One ray for each voxel in which there are points.
    Discretized,
    /// The same, and inner nodes are left alone until [`Referee::update_inner`].
    DiscretizedLazy,
}

/// What malloc has handed out to the process, C++ and Rust, with its own overhead.
pub fn heap_bytes() -> usize {
    ffi::heap_bytes()
}

/// Gives back to the system what malloc keeps for later.
pub fn trim_heap() {
    ffi::trim_heap();
}
