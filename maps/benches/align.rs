//! Aligning scans with a map: how far off a guess may be, how accurate and how honest the results are, and how long it
//! takes, beside plain point-to-point ICP on the same scans and guesses.
//!
//! `cargo bench -p maps --bench align` prints tables, then criterion's time of one alignment. The seeds are not those of
//! the tests, and nothing was tuned on them. A success is a pose within 0.3 m and 1.5° of the truth that was not refused.
//!
//! The rival is given the same thinned scan, a k-d tree over the occupied voxels, the guess and 60 iterations with a gate
//! that closes from 4 m to 0.6 m. It knows no refusal and no covariance.

#![expect(clippy::print_stdout, reason = "a bench reports on its output")]

use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{Criterion, criterion_group, criterion_main};
use maps::align::{AlignError, AlignSettings, Alignment, GnssSigmas, Guess, Local, Reference};
use maps::frame::{Body, Isometry, Point, World};
use maps::scan::Scan;
use maps::voxel::{LogOdds, Voxel, VoxelMap};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, UnitQuaternion, Vector3, Vector6};
use rand::RngExt as _;
use rand_pcg::Pcg64;

#[path = "../src/align/recordings.rs"]
mod recordings;
#[path = "../src/align/scenes.rs"]
mod scenes;

use scenes::{Kind, Lidar, Scene, at, normal, random};

const SEED: u64 = 77_000;
const TRIALS: u64 = 40;

/// A map, a scan and where it was taken.
struct Case {
    map: VoxelMap,
    scan: Vec<Point3<f64>>,
    truth: Isometry3<f64>,
}

fn insert(map: &mut VoxelMap, pose: &Isometry3<f64>, points: &[Point3<f64>]) {
    let hits: Vec<Point<World>> = points.iter().map(|p| Point::from_raw(pose * p)).collect();
    map.insert_scan(&Scan {
        max_range_m: 60.0,
        ..Scan::new(Point::from_raw(pose.translation.vector.into()), &hits)
    });
}

/// A map of nine scans, and a scan of the same place after 30 % of what can move has.
fn case(kind: Kind, random: &mut Pcg64) -> Case {
    let scene = Scene::new(kind, random);
    let shift = 5.0 * normal(random);
    let world_from_scene = at(shift, 0.37 * shift, 0.11 * shift, normal(random));
    let mut map = VoxelMap::new(0.1);
    let apart = if kind == Kind::Room { 0.3 } else { 3.0 };
    for step in -4..=4 {
        let pose = at(apart * f64::from(step), 0.5, 1.7, 0.3 * f64::from(step));
        let seen = scene.scan(&pose, &Lidar::default(), random);
        insert(&mut map, &(world_from_scene * pose), &seen);
    }
    let later = scene.after_moves(0.3, random);
    let pose = at(normal(random), 0.4 * normal(random), 1.5, normal(random));
    let scan = later.scan(&pose, &Lidar::default(), random);
    Case {
        map,
        scan,
        truth: world_from_scene * pose,
    }
}

fn local(scan: &[Point3<f64>]) -> Local<Body> {
    let points: Vec<Point<Body>> = scan.iter().map(|p| Point::from_raw(*p)).collect();
    Local::from_points(&points)
}

/// A guess that is off by a distance along the ground and a turn.
fn guess_off(
    truth: &Isometry3<f64>,
    off_m: f64,
    turn_rad: f64,
    random: &mut Pcg64,
) -> Isometry3<f64> {
    let heading = random.random_range(0.0..std::f64::consts::TAU);
    let side = if random.random_range(0.0..1.0) < 0.5 {
        -1.0
    } else {
        1.0
    };
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), side * turn_rad);
    let shift = Vector3::new(
        off_m * heading.cos(),
        off_m * heading.sin(),
        0.3 * off_m * normal(random),
    );
    Isometry3::from_parts(
        (truth.translation.vector + shift).into(),
        turn * truth.rotation,
    )
}

/// A guess drawn from the covariance that it claims.
fn guess_drawn(truth: &Isometry3<f64>, sigmas: &GnssSigmas, random: &mut Pcg64) -> Isometry3<f64> {
    let mut off = |std: f64| std * normal(random);
    let (h, v) = (sigmas.horizontal_m, sigmas.vertical_m);
    let shift = Vector3::new(off(h), off(h), off(v));
    let turn = Vector3::new(
        off(sigmas.tilt_rad),
        off(sigmas.tilt_rad),
        off(sigmas.yaw_rad),
    );
    let turn = UnitQuaternion::from_scaled_axis(turn);
    Isometry3::from_parts(
        (truth.translation.vector + shift).into(),
        turn * truth.rotation,
    )
}

fn errors(found: &Isometry3<f64>, truth: &Isometry3<f64>) -> (f64, f64) {
    let error = found.inverse() * truth;
    (
        error.translation.vector.norm(),
        error.rotation.angle().to_degrees(),
    )
}

fn is_right((metres, degrees): (f64, f64)) -> bool {
    metres < 0.3 && degrees < 1.5
}

#[expect(clippy::disallowed_methods, reason = "a bench measures the clock")]
fn timed<T>(work: impl FnOnce() -> T) -> (T, Duration) {
    let begun = Instant::now();
    let result = work();
    (result, begun.elapsed())
}

/// What one method did in a row of trials.
#[derive(Default)]
struct Record {
    trials: usize,
    right: usize,
    wrong: usize,
    refused: usize,
    metres: Vec<f64>,
    degrees: Vec<f64>,
    times: Vec<Duration>,
}

impl Record {
    fn note(&mut self, errors: Option<(f64, f64)>, time: Duration) {
        self.trials += 1;
        self.times.push(time);
        match errors {
            None => self.refused += 1,
            Some(errors) if is_right(errors) => {
                self.right += 1;
                self.metres.push(errors.0);
                self.degrees.push(errors.1);
            }
            Some(_) => self.wrong += 1,
        }
    }

    fn print(&mut self, name: &str) {
        let at = |values: &mut Vec<f64>, share: f64| {
            values.sort_by(f64::total_cmp);
            let last = values.len().saturating_sub(1) as f64;
            values
                .get((last * share).round() as usize)
                .copied()
                .unwrap_or(f64::NAN)
        };
        let [m50, m95] = [0.5, 0.95].map(|s| at(&mut self.metres, s));
        let [d50, d95] = [0.5, 0.95].map(|s| at(&mut self.degrees, s));
        self.times.sort_unstable();
        let [t50, t99] =
            [0.5, 0.99].map(|s| self.times[((self.times.len() - 1) as f64 * s).round() as usize]);
        println!(
            "{name:<34} right {:>3} wrong {:>3} refused {:>3} of {:>3} | m {m50:.3} p95 {m95:.3} | ° {d50:.3} p95 {d95:.3} | {t50:.1?} p99 {t99:.1?}",
            self.right, self.wrong, self.refused, self.trials
        );
    }
}

/// A k-d tree over points, exact.
struct Tree {
    points: Vec<Point3<f64>>,
}

impl Tree {
    fn new(mut points: Vec<Point3<f64>>) -> Self {
        fn split(points: &mut [Point3<f64>], axis: usize) {
            if points.len() > 1 {
                let middle = points.len() / 2;
                points.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis]));
                let (low, rest) = points.split_at_mut(middle);
                split(low, (axis + 1) % 3);
                split(&mut rest[1..], (axis + 1) % 3);
            }
        }
        split(&mut points, 0);
        Self { points }
    }

    /// The nearest point within a distance, and that distance squared.
    fn nearest(&self, p: &Point3<f64>, within_m: f64) -> Option<(Point3<f64>, f64)> {
        fn look(
            points: &[Point3<f64>],
            axis: usize,
            p: &Point3<f64>,
            best: &mut (Option<Point3<f64>>, f64),
        ) {
            if points.is_empty() {
                return;
            }
            let middle = points.len() / 2;
            let node = &points[middle];
            let squared = (node - p).norm_squared();
            if squared < best.1 {
                *best = (Some(*node), squared);
            }
            let d = p[axis] - node[axis];
            let (low, high) = (&points[..middle], &points[middle + 1..]);
            let (near, far) = if d < 0.0 { (low, high) } else { (high, low) };
            look(near, (axis + 1) % 3, p, best);
            if d * d < best.1 {
                look(far, (axis + 1) % 3, p, best);
            }
        }
        let mut best = (None, within_m * within_m);
        look(&self.points, 0, p, &mut best);
        best.0.map(|q| (q, best.1))
    }
}

/// Point-to-point ICP.
fn icp(tree: &Tree, scan: &[Point3<f64>], guess: &Isometry3<f64>) -> Isometry3<f64> {
    const ITERATIONS: i32 = 60;
    let mut pose = *guess;
    for iteration in 0..ITERATIONS {
        let gate = (4.0 * 0.93_f64.powi(iteration)).max(0.6);
        let pairs: Vec<_> = scan
            .iter()
            .filter_map(|p| Some((*p, tree.nearest(&(pose * p), gate)?.0)))
            .collect();
        if pairs.len() < 10 {
            return pose;
        }
        pose = best_fit(&pairs);
    }
    pose
}

/// The motion that brings the first of each pair closest to the second (Kabsch).
fn best_fit(pairs: &[(Point3<f64>, Point3<f64>)]) -> Isometry3<f64> {
    let count = pairs.len() as f64;
    let from = pairs.iter().map(|p| p.0.coords).sum::<Vector3<f64>>() / count;
    let to = pairs.iter().map(|p| p.1.coords).sum::<Vector3<f64>>() / count;
    let cross: Matrix3<f64> = pairs
        .iter()
        .map(|(p, q)| (q.coords - to) * (p.coords - from).transpose())
        .sum();
    let svd = cross.svd(true, true);
    let (u, v_t) = (svd.u.expect("asked for"), svd.v_t.expect("asked for"));
    let flip = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant().signum()));
    let turn =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * flip * v_t));
    Isometry3::from_parts((to - turn * from).into(), turn)
}

/// One point of each cube of 0.3 m, as ours is thinned.
fn thinned(scan: &[Point3<f64>]) -> Vec<Point3<f64>> {
    let mut keyed: Vec<([i32; 3], usize)> = scan
        .iter()
        .enumerate()
        .map(|(at, p)| (p.coords.map(|c| (c / 0.3).floor() as i32).into(), at))
        .collect();
    keyed.sort_unstable();
    keyed.dedup_by_key(|(key, _)| *key);
    keyed.into_iter().map(|(_, at)| scan[at]).collect()
}

fn tree_of(map: &VoxelMap) -> Tree {
    Tree::new(
        map.occupied()
            .map(|(key, _)| map.center_of(key).raw)
            .collect(),
    )
}

/// The synthetic maps are made with true poses; for the recorded ones the default stands.
fn true_map() -> AlignSettings {
    AlignSettings {
        map_std_m: 0.0,
        ..AlignSettings::default()
    }
}

fn align(
    reference: &Reference,
    scan: &[Point3<f64>],
    (guess, sigmas): (&Isometry3<f64>, &GnssSigmas),
    settings: &AlignSettings,
) -> Result<Alignment<Body>, AlignError> {
    let guess = Guess::gnss(Isometry::claim(*guess), sigmas);
    reference.align(&local(scan), &guess, settings)
}

/// How often each method is right, by how far off the guess is.
fn capture_range() {
    let sigmas = GnssSigmas {
        yaw_rad: 5.0_f64.to_radians(),
        ..GnssSigmas::default()
    };
    for kind in [Kind::Street, Kind::Room] {
        for (off_m, turn_deg) in [(0.5, 2.0), (1.0, 4.0), (2.0, 7.0), (3.0, 10.0), (4.0, 14.0)] {
            let (mut ours, mut rival) = (Record::default(), Record::default());
            for seed in 0..TRIALS {
                let random = &mut random(SEED + seed);
                let case = case(kind, random);
                let guess = guess_off(&case.truth, off_m, f64::to_radians(turn_deg), random);
                let reference = Reference::new(&case.map);
                let (found, time) =
                    timed(|| align(&reference, &case.scan, (&guess, &sigmas), &true_map()));
                let found = found
                    .ok()
                    .map(|a| errors(&a.world_from_local.raw, &case.truth));
                ours.note(found, time);
                let tree = tree_of(&case.map);
                let (found, time) = timed(|| icp(&tree, &thinned(&case.scan), &guess));
                rival.note(Some(errors(&found, &case.truth)), time);
            }
            let name = format!("{kind:?} off {off_m} m {turn_deg}°");
            ours.print(&format!("{name}, ours"));
            rival.print(&format!("{name}, ICP"));
        }
    }
}

/// The normalised estimation error squared over guesses drawn from the covariance they claim.
fn honesty() {
    for kind in [Kind::Street, Kind::Room] {
        let sigmas = GnssSigmas::default();
        let mut squares = Vec::new();
        let mut refused = 0;
        for seed in 0..2 * TRIALS {
            let random = &mut random(SEED + 1000 + seed);
            let case = case(kind, random);
            let guess = guess_drawn(&case.truth, &sigmas, random);
            match align(
                &Reference::new(&case.map),
                &case.scan,
                (&guess, &sigmas),
                &true_map(),
            ) {
                Ok(found) => squares.push(nees(&found, &case.truth)),
                Err(_) => refused += 1,
            }
        }
        let count = squares.len() as f64;
        let mean = squares.iter().sum::<f64>() / count;
        // χ² with 6n degrees of freedom is close to normal for large n: variance 12n.
        let half = 1.96 * (12.0 / count).sqrt();
        let outside = squares.iter().filter(|s| **s > 16.81).count();
        println!(
            "{kind:?}: mean NEES {mean:.2} of 6 over {count} (95 % of consistent filters: {:.2} to {:.2}), {outside} beyond the 99th percentile, {refused} refused",
            6.0 - half,
            6.0 + half
        );
    }
}

fn nees(found: &Alignment<Body>, truth: &Isometry3<f64>) -> f64 {
    let error = found.world_from_local.raw.inverse() * truth;
    // Errors are centimetres: to first order the vector of the motion is its translation and its turn.
    let (t, r) = (error.translation.vector, error.rotation.scaled_axis());
    let t = t - r.cross(&t) * 0.5;
    let vector = Vector6::new(t.x, t.y, t.z, r.x, r.y, r.z);
    let inverse = found.covariance.try_inverse().expect("positive definite");
    vector.dot(&(inverse * vector))
}

/// What happens where there is no answer.
fn refusals() {
    for kind in [Kind::Wall, Kind::Corridor, Kind::Floor, Kind::Columns] {
        let (mut unobservable, mut ambiguous, mut other, mut right, mut wrong) = (0, 0, 0, 0, 0);
        let sigmas = GnssSigmas::default();
        for seed in 0..TRIALS {
            let random = &mut random(SEED + 2000 + seed);
            let case = case(kind, random);
            let guess = guess_drawn(&case.truth, &sigmas, random);
            match align(
                &Reference::new(&case.map),
                &case.scan,
                (&guess, &sigmas),
                &true_map(),
            ) {
                Err(AlignError::Unobservable { .. }) => unobservable += 1,
                Err(AlignError::Ambiguous { .. }) => ambiguous += 1,
                Err(_) => other += 1,
                Ok(a) if is_right(errors(&a.world_from_local.raw, &case.truth)) => right += 1,
                Ok(_) => wrong += 1,
            }
        }
        println!(
            "{kind:?}: unobservable {unobservable}, ambiguous {ambiguous}, other refusals {other}, answered right {right}, answered wrong {wrong} of {TRIALS}"
        );
    }
}

/// Each KITTI sweep against the map of the others, from GNSS-like guesses.
fn kitti() {
    let Some(sweeps) = recordings::kitti() else {
        println!("KITTI: skipped, ../shared/data/lidar/kitti_0926 is not there");
        return;
    };
    let sigmas = GnssSigmas::default();
    let (mut ours, mut rival, mut squares) = (Record::default(), Record::default(), Vec::new());
    let mut building = Duration::ZERO;
    for (index, sweep) in sweeps.iter().enumerate() {
        let mut map = VoxelMap::new(0.1);
        for (_, other) in sweeps.iter().enumerate().filter(|(at, _)| *at != index) {
            insert(&mut map, &other.pose, &other.points);
        }
        let (reference, time) = timed(|| Reference::new(&map));
        building += time;
        let tree = tree_of(&map);
        for trial in 0..4 {
            let random = &mut random(SEED + 3000 + 10 * index as u64 + trial);
            let guess = guess_drawn(&sweep.pose, &sigmas, random);
            let (found, time) = timed(|| {
                align(
                    &reference,
                    &sweep.points,
                    (&guess, &sigmas),
                    &AlignSettings::default(),
                )
            });
            if let Ok(found) = &found {
                squares.push(nees(found, &sweep.pose));
            }
            ours.note(
                found
                    .ok()
                    .map(|a| errors(&a.world_from_local.raw, &sweep.pose)),
                time,
            );
            let (found, time) = timed(|| icp(&tree, &thinned(&sweep.points), &guess));
            rival.note(Some(errors(&found, &sweep.pose)), time);
        }
    }
    println!("KITTI, against poses that KISS-ICP estimated, which are not the truth:");
    ours.print("KITTI, ours");
    rival.print("KITTI, ICP");
    let mean = squares.iter().sum::<f64>() / squares.len().max(1) as f64;
    println!(
        "KITTI: mean NEES {mean:.2} of 6 against those poses; the surfaces of a map take {:.0?}",
        building / sweeps.len() as u32
    );
}

/// A binary point cloud of the Point Cloud Library whose fields are all floats, x, y, z first; `None` where it is not.
fn cloud(name: &str) -> Option<Vec<Point3<f64>>> {
    let bytes = std::fs::read(recordings::folder("perception/agc-drive").join(name)).ok()?;
    let marker = b"DATA binary\n";
    let body = marker.len() + bytes.windows(marker.len()).position(|w| w == marker)?;
    let header = String::from_utf8_lossy(&bytes[..body]);
    let fields = header.lines().find(|l| l.starts_with("FIELDS "))?;
    Some(recordings::floats(&bytes[body..], fields.split_whitespace().count() - 1).collect())
}

/// The cloud of a drone against that of a car, which see roofs and facades: AGC-Drive publishes the two laid over one
/// another, by its own ICP, which stands in for the truth.
fn air_to_ground() {
    for name in ["CA", "CB"] {
        let clouds = [
            format!("{name}.pcd"),
            format!("{name}_UAV.pcd"),
            "UAV.pcd".into(),
        ];
        let [Some(car), Some(both), Some(drone)] = clouds.map(|c| cloud(&c)) else {
            println!("AGC-Drive {name}: skipped, ../shared/data/perception/agc-drive is not there");
            continue;
        };
        // The published cloud is the drone's followed by the car's, moved.
        let pairs: Vec<_> = both[drone.len()..]
            .iter()
            .copied()
            .zip(car.iter().copied())
            .collect();
        let world_from_drone = best_fit(&pairs);
        let worst = pairs
            .iter()
            .map(|(p, q)| (world_from_drone * p - q).norm())
            .fold(0.0, f64::max);
        println!(
            "AGC-Drive {name}: the published motion, {:.1?}, explains the published cloud to {worst:.3} m",
            world_from_drone.translation.vector.as_slice()
        );
        for resolution_m in [0.2, 0.5, 1.0] {
            let mut map = VoxelMap::new(resolution_m);
            // No rays: the car's cloud is of many places.
            let occupied = Voxel::new(LogOdds::MAX);
            for p in &car {
                map.set_voxel(map.key_of(Point::from_raw(*p)), occupied);
            }
            let reference = Reference::new(&map);
            let sigmas = GnssSigmas::default();
            for trial in 0..4 {
                let random = &mut random(SEED + 5000 + trial);
                let guess = guess_drawn(&world_from_drone, &sigmas, random);
                let (found, time) = timed(|| {
                    align(
                        &reference,
                        &drone,
                        (&guess, &sigmas),
                        &AlignSettings::default(),
                    )
                });
                let said = match found {
                    Ok(found) => {
                        let (m, deg) = errors(&found.world_from_local.raw, &world_from_drone);
                        format!(
                            "{m:.2} m and {deg:.2}° off it, {:.0} % inliers",
                            100.0 * found.inlier_share
                        )
                    }
                    Err(error) => format!("refused: {error}"),
                };
                let (m, deg) = errors(
                    &icp(&tree_of(&map), &thinned(&drone), &guess),
                    &world_from_drone,
                );
                println!(
                    "AGC-Drive {name} at {resolution_m} m: {said} ({time:.0?}); ICP {m:.2} m and {deg:.2}° off it"
                );
            }
        }
    }
}

fn benches(criterion: &mut Criterion) {
    capture_range();
    honesty();
    refusals();
    kitti();
    air_to_ground();
    let sigmas = GnssSigmas::default();
    for kind in [Kind::Street, Kind::Room] {
        let random = &mut random(SEED + 4000);
        let case = case(kind, random);
        let guess = guess_drawn(&case.truth, &sigmas, random);
        let reference = Reference::new(&case.map);
        criterion.bench_function(&format!("align/{kind:?}"), |bencher| {
            bencher.iter(|| {
                align(
                    black_box(&reference),
                    &case.scan,
                    (&guess, &sigmas),
                    &true_map(),
                )
            });
        });
        criterion.bench_function(&format!("align/{kind:?}/surfaces"), |bencher| {
            bencher.iter(|| Reference::new(black_box(&case.map)));
        });
    }
}

criterion_group! {
    name = group;
    config = Criterion::default().sample_size(20);
    targets = benches
}
criterion_main!(group);
