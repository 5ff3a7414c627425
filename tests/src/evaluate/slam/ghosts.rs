//! Ghosts: what a map keeps of those who have moved on.
//!
//! The static points of all keyframes go into a voxel map as the companion does it, in voxels of 0.1 m, but at the camera's
//! *true* pose: what is drawn in the wrong place by drift is no ghost, and the absolute error tells of it. A voxel is hit by a
//! mover if such a point lay within the true box of somebody who can move, as it stood at that moment, and at least 0.3 m above
//! the bottom of that box: lower down, feet and wheels cannot be told from the noise of the ground that is seen beside them. A ghost is a voxel that
//! was hit by a mover, is occupied in the end, and has no surface of the true static world in it or next to it. People, with
//! their bicycles, are counted among all movers and for themselves.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufReader, BufWriter, Read as _, Seek as _, Write as _};
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use maps::frame::{Camera, Isometry, Point, World};
use maps::scan::Scan;
use maps::time::Stamp;
use maps::trajectory::Trajectory;
use maps::voxel::{Occupancy, VoxelKey, VoxelMap};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use sitl::scene::{Class, Name, Scene};
use sitl::truth::voxels;
use slam::DenseUpdate;

use super::job::Shown;
use super::recordings;

/// Edge of a voxel.
const VOXEL_M: f64 = 0.1;
/// So much around a box belongs to it: noise, and limbs that swing.
const MARGIN_M: f64 = 0.1;
/// Lower parts of a box are left to the noise of the ground: three standard deviations of it 8 m away.
const GROUND_M: f64 = 0.3;
/// A person in the room: they have no box of their own.
const PERSON_M: [f64; 3] = [0.7, 0.7, 1.9];

/// What is seen from farther away is not mapped: as the companion's configurations for such scenes have it.
fn max_range_m(name: Name) -> f64 {
    match name {
        Name::Room => 5.0,
        _ => 10.0,
    }
}

/// Keyframes on disk, so that they take no memory while that is measured. The file is removed in the end.
pub(super) struct Keyframes {
    path: PathBuf,
    file: BufWriter<File>,
}

impl Keyframes {
    pub(super) fn create(path: &Path) -> anyhow::Result<Self> {
        let file =
            File::create(path).with_context(|| format!("cannot write {}", path.display()))?;
        Ok(Self {
            path: path.to_owned(),
            file: BufWriter::new(file),
        })
    }

    /// Adds what the SLAM hands out; where it corrects itself, all before is forgotten.
    pub(super) fn add(&mut self, update: &DenseUpdate) -> anyhow::Result<()> {
        let keyframes = update.keyframes.iter();
        // One at a time: all of them take more memory than the SLAM, whose memory is measured.
        self.write(
            update.anew,
            keyframes.map(|k| (k.at, k.points().map(|(p, _)| p).collect())),
        )
    }

    fn write(
        &mut self,
        anew: bool,
        keyframes: impl Iterator<Item = (Stamp, Vec<Point<Camera>>)>,
    ) -> anyhow::Result<()> {
        let write = || -> io::Result<()> {
            if anew {
                self.file.rewind()?;
                self.file.get_ref().set_len(0)?;
            }
            for (at, points) in keyframes {
                self.file.write_all(&at.as_nanos().to_le_bytes())?;
                self.file.write_all(&(points.len() as u64).to_le_bytes())?;
                for p in points {
                    for c in p.raw.iter() {
                        self.file.write_all(&(*c as f32).to_le_bytes())?;
                    }
                }
            }
            Ok(())
        };
        write().with_context(|| format!("cannot write {}", self.path.display()))
    }

    /// Gives each to `take`, in order.
    fn each(mut self, mut take: impl FnMut(Stamp, Vec<Point<Camera>>)) -> anyhow::Result<()> {
        let mut read = || -> io::Result<()> {
            self.file.flush()?;
            let mut file = BufReader::new(File::open(&self.path)?);
            let mut left = fs::metadata(&self.path)?.len();
            while left > 0 {
                let (at, count) = (number(&mut file)?, number(&mut file)?);
                let mut points = Vec::new();
                for _ in 0..count {
                    let [x, y, z] = [
                        coordinate(&mut file)?,
                        coordinate(&mut file)?,
                        coordinate(&mut file)?,
                    ];
                    points.push(Point::new(x, y, z));
                }
                left = left.saturating_sub(16 + 12 * count);
                take(Stamp::from_nanos(at), points);
            }
            Ok(())
        };
        let outcome = read().with_context(|| format!("cannot read {}", self.path.display()));
        fs::remove_file(&self.path)
            .with_context(|| format!("cannot remove {}", self.path.display()))?;
        outcome
    }
}

fn number(file: &mut impl io::Read) -> io::Result<u64> {
    let mut bytes = [0; 8];
    file.read_exact(&mut bytes)?;
    Ok(u64::from_le_bytes(bytes))
}

fn coordinate(file: &mut BufReader<File>) -> io::Result<f64> {
    let mut bytes = [0; 4];
    file.read_exact(&mut bytes)?;
    Ok(f64::from(f32::from_le_bytes(bytes)))
}

/// An occupied voxel in which somebody was hit who can move.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Hit {
    /// Index along x, y and z in the simulator's world.
    pub(super) key: [i32; 3],
    /// On foot or on a bicycle.
    pub(super) is_person: bool,
}

/// A box in which somebody who can move is.
struct Occupied {
    from_world: Isometry3<f64>,
    half: Vector3<f64>,
    is_person: bool,
}

impl Occupied {
    /// Its place is in the middle of its bottom.
    fn new(place: Isometry3<f64>, size: Vector3<f64>, class: Class) -> Self {
        let (low_m, high_m) = (GROUND_M, size.z + MARGIN_M);
        let middle = place * Translation3::new(0.0, 0.0, f64::midpoint(low_m, high_m));
        let [x, y] = [size.x, size.y].map(|side| side / 2.0 + MARGIN_M);
        Self {
            from_world: middle.inverse(),
            half: Vector3::new(x, y, (high_m - low_m) / 2.0),
            is_person: matches!(class, Class::Pedestrian | Class::Cyclist),
        }
    }

    fn holds(&self, p: Point<World>) -> bool {
        let local = self.from_world * p.raw;
        (0..3).all(|i| local[i].abs() <= self.half[i])
    }
}

/// Everybody on their way at that moment.
fn movers(scene: &Scene, at: Stamp) -> Vec<Occupied> {
    let users = scene.movers(at).into_iter();
    let users =
        users.map(|user| Occupied::new(user.thing.place, user.thing.size, user.thing.class));
    let people = scene.walkers().iter().map(|walker| {
        let place = Translation3::from(walker.position(at).raw.coords);
        let place = Isometry3::from_parts(place, UnitQuaternion::identity());
        Occupied::new(place, PERSON_M.into(), Class::Pedestrian)
    });
    users.chain(people).collect()
}

/// The occupied voxels of the map of these keyframes that were hit by movers. The keyframes' file is removed.
pub(super) fn hit_by_movers(
    keyframes: Keyframes,
    shown: &Shown,
    recording: &Path,
) -> anyhow::Result<Vec<Hit>> {
    let scene = shown.build()?;
    let truth = recordings::truth(recording)?.context("a simulated recording has its truth")?;
    let mut map = Marked::new(&scene, max_range_m(shown.name()?));
    keyframes.each(|at, points| {
        if let Some(pose) = pose_at(&truth, at) {
            map.insert(at, pose, &points);
        }
    })?;
    Ok(map.occupied_marks())
}

fn pose_at(truth: &Trajectory<Camera>, at: Stamp) -> Option<Isometry<World, Camera>> {
    let poses = truth.poses();
    let index = poses.binary_search_by_key(&at, |(stamp, _)| *stamp).ok()?;
    Some(poses[index].1)
}

/// A map that knows where movers were hit.
struct Marked<'a> {
    scene: &'a Scene,
    map: VoxelMap,
    max_range_m: f64,
    /// Whether it was a person.
    marks: BTreeMap<[i32; 3], bool>,
}

impl<'a> Marked<'a> {
    fn new(scene: &'a Scene, max_range_m: f64) -> Self {
        Self {
            scene,
            map: VoxelMap::new(VOXEL_M),
            max_range_m,
            marks: BTreeMap::new(),
        }
    }

    fn insert(&mut self, at: Stamp, pose: Isometry<World, Camera>, points: &[Point<Camera>]) {
        let (movers, origin) = (movers(self.scene, at), pose.translation());
        let hits: Vec<Point<World>> = points.iter().map(|p| pose * *p).collect();
        for hit in &hits {
            let is_near = (*hit - origin).norm() <= self.max_range_m;
            let mover = movers.iter().find(|mover| is_near && mover.holds(*hit));
            if let Some(mover) = mover {
                let key = self.map.key_of(*hit);
                *self.marks.entry([key.x, key.y, key.z]).or_default() |= mover.is_person;
            }
        }
        self.map.insert_scan(&Scan {
            max_range_m: self.max_range_m,
            at,
            ..Scan::new(origin, &hits)
        });
    }

    fn occupied_marks(&self) -> Vec<Hit> {
        let marks = self.marks.iter();
        let marks = marks.map(|(key, is_person)| Hit {
            key: *key,
            is_person: *is_person,
        });
        let is_occupied = |hit: &Hit| {
            let [x, y, z] = hit.key;
            self.map.occupancy(VoxelKey { x, y, z }) == Occupancy::Occupied
        };
        marks.filter(is_occupied).collect()
    }
}

/// Ghosts in a map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Ghosts {
    /// Voxels.
    pub(super) all: usize,
    /// Of these, those of people.
    pub(super) of_people: usize,
}

/// Of each method's occupied voxels that were hit by movers, those that have no true static surface in them or next to them.
pub(super) fn count(shown: &Shown, hit: &[&[Hit]]) -> anyhow::Result<Vec<Ghosts>> {
    let all = || hit.iter().flat_map(|hits| hits.iter().map(|hit| hit.key));
    let Some(first) = all().next() else {
        return Ok(vec![Ghosts::default(); hit.len()]);
    };
    let (mut low, mut high) = (first, first);
    for key in all() {
        for i in 0..3 {
            low[i] = low[i].min(key[i]);
            high[i] = high[i].max(key[i]);
        }
    }
    let corner = |key: [i32; 3], by: i32| Point3::from(key.map(|c| f64::from(c + by) * VOXEL_M));
    let truth = voxels(&shown.build()?, VOXEL_M, [corner(low, -1), corner(high, 2)]);
    let is_ghost = |hit: &&Hit| {
        let [x, y, z] = hit.key;
        !neighbours().any(|[dx, dy, dz]| truth.classes.contains_key(&[x + dx, y + dy, z + dz]))
    };
    let ghosts = |hits: &&[Hit]| {
        let ghosts = hits.iter().filter(is_ghost);
        ghosts.fold(Ghosts::default(), |sum, hit| Ghosts {
            all: sum.all + 1,
            of_people: sum.of_people + usize::from(hit.is_person),
        })
    };
    Ok(hit.iter().map(ghosts).collect())
}

/// A voxel and the 26 around it.
fn neighbours() -> impl Iterator<Item = [i32; 3]> {
    (0..27).map(|i| [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown() -> Shown {
        Shown {
            scene: "room".to_owned(),
            seed: 1100,
        }
    }

    /// A camera 1.5 m from the first person of the room looks at their chest, and at the air above and at the floor.
    fn look(at: Stamp) -> (Scene, Isometry<World, Camera>, Vec<Point<Camera>>) {
        let scene = shown().build().expect("the room");
        let person = scene.walkers()[0].position(at).raw;
        let eye = Point3::new(person.x - 1.5, person.y, 1.2);
        let turn = UnitQuaternion::from_euler_angles(
            -std::f64::consts::FRAC_PI_2,
            0.0,
            -std::f64::consts::FRAC_PI_2,
        );
        let pose = Isometry::claim(Isometry3::from_parts(eye.coords.into(), turn));
        let chest = (0..40).map(|i| {
            Point::new(
                0.01 * f64::from(i % 8) - 0.04,
                0.05 * f64::from(i / 8),
                1.45,
            )
        });
        (scene, pose, chest.collect())
    }

    #[test]
    fn a_person_in_the_map_is_a_ghost_until_the_place_is_seen_to_be_free() {
        let at = Stamp::from_nanos(1_000_000_000);
        let (scene, pose, points) = look(at);
        let mut map = Marked::new(&scene, 5.0);
        map.insert(at, pose, &points);
        let marks = map.occupied_marks();
        assert!(marks.len() > 5, "{marks:?}");
        let ghosts = count(&shown(), &[&marks, &[]]).expect("the room");
        assert!(ghosts[0].all > 5 && ghosts[1].all == 0, "{ghosts:?}");
        assert_eq!(ghosts[0].of_people, ghosts[0].all);
        // Two looks through where they stood, at a moment when they stand elsewhere.
        let beyond: Vec<_> = points
            .iter()
            .map(|p| Point::from_raw(p.raw * 2.0))
            .collect();
        for seconds in 20..26 {
            map.insert(Stamp::from_nanos(seconds * 1_000_000_000), pose, &beyond);
        }
        let left = map.occupied_marks();
        let ghosts = count(&shown(), &[&left]).expect("the room");
        assert!(
            ghosts[0].all < marks.len() / 5,
            "{ghosts:?} of {}",
            marks.len()
        );
    }

    #[test]
    fn a_true_surface_is_no_ghost() {
        let hits = |z: i32| -> Vec<Hit> {
            let hit = |x| Hit {
                key: [x, 0, z],
                is_person: x < 4,
            };
            (0..10).map(hit).collect()
        };
        let (floor, above) = (hits(0), hits(12));
        let ghosts = count(&shown(), &[&floor, &above]).expect("the room");
        assert_eq!(ghosts[0], Ghosts::default(), "the floor");
        assert!(ghosts[1].all > 4, "the air above it: {ghosts:?}");
        assert!(ghosts[1].of_people < ghosts[1].all, "{ghosts:?}");
    }

    #[test]
    fn keyframes_come_back_from_disk_in_order_and_leave_nothing() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("keyframes");
        let mut keyframes = Keyframes::create(&path).expect("created");
        let keyframe = |nanos, count: u32| {
            let point = |i| Point::new(f64::from(i), 0.5, 2.0);
            (Stamp::from_nanos(nanos), (0..count).map(point).collect())
        };
        keyframes
            .write(false, [keyframe(4, 9)].into_iter())
            .expect("written");
        keyframes
            .write(true, [keyframe(5, 3), keyframe(9, 0)].into_iter())
            .expect("written anew");
        keyframes
            .write(false, [keyframe(11, 1)].into_iter())
            .expect("written");
        let mut read = Vec::new();
        keyframes
            .each(|at, points| read.push((at.as_nanos(), points.len())))
            .expect("read");
        assert_eq!(read, [(5, 3), (9, 0), (11, 1)]);
        assert!(!path.exists(), "it is removed");
    }
}
