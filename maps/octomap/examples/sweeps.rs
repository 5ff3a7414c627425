//! Sweeps of a laser scanner as an `OctoMap` file: `cargo run --release -p octomap --example sweeps -- FOLDER MAP.ot`
//!
//! The folder has sweeps as KITTI keeps them (`*.bin`: x, y, z and reflectance as f32) and `poses.txt`, in which line `n` is
//! the pose of the `n`th sweep, the first three rows of its matrix. The first sweep's sensor is taken to be level and 1.73 m
//! above the ground.

use std::error::Error;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::Path;

use maps::frame::{Point, World};
use maps::scan::Scan;
use maps::voxel::VoxelMap;

fn main() -> Result<(), Box<dyn Error>> {
    let [folder, out] = std::env::args()
        .skip(1)
        .collect::<Vec<_>>()
        .try_into()
        .map_err(|_others| "usage: sweeps FOLDER MAP.ot")?;
    let folder = Path::new(&folder);
    let mut sweeps = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.extension().is_some_and(|ending| ending == "bin") {
            sweeps.push(path);
        }
    }
    sweeps.sort();
    let poses = fs::read_to_string(folder.join("poses.txt"))?;
    let mut map = VoxelMap::new(0.2);
    for (sweep, pose) in sweeps.iter().zip(poses.lines()) {
        let pose: Vec<f64> = pose
            .split_whitespace()
            .map(str::parse)
            .collect::<Result<_, _>>()?;
        insert(&mut map, &fs::read(sweep)?, &pose).ok_or("a pose has twelve numbers")?;
    }
    octomap::write_ot(&map, BufWriter::new(File::create(out)?))?;
    Ok(())
}

/// Inserts a sweep; `None` if the pose is none.
fn insert(map: &mut VoxelMap, sweep: &[u8], pose: &[f64]) -> Option<()> {
    let [x, y, z] = [0, 1, 2].map(|row| pose.get(4 * row..4 * row + 4));
    let rows = [x?, y?, z?];
    let in_world = |p: [f64; 3]| -> Point<World> {
        let [x, y, z] = rows.map(|row| row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3]);
        Point::new(x, y, z + 1.73)
    };
    let (points, _rest) = sweep.as_chunks::<16>();
    let hits: Vec<_> = points
        .iter()
        .map(|point| {
            let (numbers, _rest) = point.as_chunks::<4>();
            in_world([0, 1, 2].map(|i| f32::from_le_bytes(numbers[i]).into()))
        })
        .collect();
    map.insert_scan(&Scan {
        max_range_m: 60.0,
        ..Scan::new(in_world([0.0; 3]), &hits)
    });
    Some(())
}
