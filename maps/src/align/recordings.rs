//! Recordings beside the repository, for tests and benches, which have it by `#[path]`.

use std::path::PathBuf;

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};

/// A lidar sweep in its own frame, and where it was taken.
pub(crate) struct Sweep {
    pub(crate) pose: Isometry3<f64>,
    pub(crate) points: Vec<Point3<f64>>,
}

/// A folder of data beside the repository.
pub(crate) fn folder(name: &str) -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data")).join(name)
}

/// The sweeps of KITTI with their poses as KISS-ICP estimated them; `None` where they are not.
pub(crate) fn kitti() -> Option<Vec<Sweep>> {
    let folder = folder("lidar/kitti_0926");
    let poses = std::fs::read_to_string(folder.join("poses.txt")).ok()?;
    poses
        .lines()
        .enumerate()
        .map(|(index, line)| {
            let numbers: Vec<f64> = line
                .split_whitespace()
                .map_while(|n| n.parse().ok())
                .collect();
            let rows = nalgebra::Matrix3x4::from_row_slice(numbers.get(..12)?);
            let rotation: Matrix3<f64> = rows.fixed_columns::<3>(0).into();
            let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&rotation));
            let place: Vector3<f64> = rows.column(3).into();
            let bytes = std::fs::read(folder.join(format!("{:010}.bin", 5 * index))).ok()?;
            Some(Sweep {
                pose: Isometry3::from_parts(place.into(), turn),
                points: floats(&bytes, 4).collect(),
            })
        })
        .collect()
}

/// Points of `stride` floats each.
pub(crate) fn floats(bytes: &[u8], stride: usize) -> impl Iterator<Item = Point3<f64>> {
    bytes.chunks_exact(4 * stride).map(|point| {
        let at = |i: usize| {
            let word = [
                point[4 * i],
                point[4 * i + 1],
                point[4 * i + 2],
                point[4 * i + 3],
            ];
            f64::from(f32::from_le_bytes(word))
        };
        Point3::new(at(0), at(1), at(2))
    })
}
