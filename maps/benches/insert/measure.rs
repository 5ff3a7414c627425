//! Clocks and scales.

use std::process::Command;

use maps::voxel::VoxelMap;
use octomap::referee::{Insertion, Referee, heap_bytes, trim_heap};
use rustix::time::{ClockId, clock_gettime};

use crate::compare::{self, Ours, RESOLUTION_M, Settings};
use crate::scenes::Scene;

/// CPU time this thread has taken so far, in seconds.
pub(crate) fn thread_s() -> f64 {
    seconds(ClockId::ThreadCPUTime)
}

/// Time on the wall, in seconds.
pub(crate) fn wall_s() -> f64 {
    seconds(ClockId::Monotonic)
}

fn seconds(clock: ClockId) -> f64 {
    let time = clock_gettime(clock);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// CPU seconds that `work` takes, and what it gives.
pub(crate) fn timed<T>(work: impl FnOnce() -> T) -> (f64, T) {
    let start = thread_s();
    let value = work();
    (thread_s() - start, value)
}

/// Bytes that stay on the heap with what `build` gives.
pub(crate) fn weighed<T>(build: impl FnOnce() -> T) -> (usize, T) {
    trim_heap();
    let before = heap_bytes();
    let value = build();
    (heap_bytes().saturating_sub(before), value)
}

pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// The peak of the resident memory of a process that loads a scene and builds one map of it, in bytes.
pub(crate) fn peak(who: &str, scene: &Scene, settings: &Settings) -> Option<u64> {
    let output = Command::new(std::env::current_exe().ok()?)
        .args(["--child", who, "--scene", scene.name, "--data"])
        .arg(&settings.data)
        .args(["--sweeps", &settings.sweeps.to_string()])
        .output()
        .ok()?;
    String::from_utf8_lossy(&output.stdout).trim().parse().ok()
}

/// Does what [`peak`] asks for and prints the figure.
pub(crate) fn be_child(who: &str, settings: &Settings) {
    let name = settings.scene.as_deref().unwrap_or_default();
    let Some(scene) = Scene::load(name, &settings.data, settings.sweeps) else {
        return;
    };
    match who {
        "ours" => Ours::ALL[0]
            .0
            .insert(&mut VoxelMap::new(RESOLUTION_M), &scene),
        "octomap" => {
            let mut tree = Referee::new(RESOLUTION_M);
            let _seconds = compare::insert_octomap(&mut tree, &scene, Insertion::Plain);
        }
        _ => {}
    }
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    let kib = peak.and_then(|l| l.trim().trim_end_matches(" kB").parse::<u64>().ok());
    println!("{}", kib.unwrap_or_default() * 1024);
}
