//! Ours against Debian's liboctomap, on the same scans in one run: insertion, memory, queries, ray casts, files.
//!
//! `cargo bench -p maps --bench insert` prints one table a scene. Times are CPU times of one thread, medians over repeats
//! in which the libraries take turns; memory is what malloc has handed out for a map, and the peak of a process that does
//! nothing but build it. Where rays are cut at the greatest range, free space differs in the modes with one ray a voxel: ours
//! is to the voxel in which the cut ray ends, liboctomap's to the one of the point beyond. Two threads are timed on the wall,
//! in turns with one: the median of the ratios. `--help`, after `--`, lists the options.

#![expect(clippy::print_stdout, reason = "a bench reports on its output")]

mod compare;
mod measure;
mod scenes;

use std::path::PathBuf;

use compare::Settings;
use scenes::Scene;

const OPTIONS: &str = "\
--scene NAME    only kitti, street, uav or rgbd
--sweeps N      how many sweeps a scene (5)
--repeats N     how often everything is timed (3)
--data DIR      where the recordings are
--test          one small scene, to see that it works
--ours          without liboctomap: to profile";

fn main() {
    if std::env::args().any(|arg| arg == "--help") {
        println!("{OPTIONS}");
        return;
    }
    let settings = settings(std::env::args().skip(1));
    if let Some(child) = &settings.child {
        measure::be_child(child, &settings);
        return;
    }
    for name in Scene::NAMES {
        if settings.scene.as_deref().is_some_and(|only| only != name) {
            continue;
        }
        match Scene::load(name, &settings.data, settings.sweeps) {
            Some(scene) => compare::run(&scene, &settings),
            None => println!(
                "{name}: left out, no recording in {}",
                settings.data.display()
            ),
        }
    }
}

/// Unknown options are cargo's own and criterion's: they are passed over.
fn settings(mut args: impl Iterator<Item = String>) -> Settings {
    let mut settings = Settings {
        scene: None,
        sweeps: 5,
        repeats: 3,
        data: scenes::default_data(),
        rivals: true,
        child: None,
    };
    while let Some(arg) = args.next() {
        let mut number = || args.next().and_then(|n| n.parse().ok());
        match arg.as_str() {
            "--sweeps" => settings.sweeps = number().unwrap_or(settings.sweeps),
            "--repeats" => settings.repeats = number().unwrap_or(settings.repeats),
            "--scene" => settings.scene = args.next(),
            "--data" => settings.data = args.next().map_or(settings.data, PathBuf::from),
            "--child" => settings.child = args.next(),
            "--ours" => settings.rivals = false,
            "--test" => {
                settings.scene = Some("street".to_owned());
                (settings.sweeps, settings.repeats) = (1, 1);
            }
            _ => {}
        }
    }
    settings
}
