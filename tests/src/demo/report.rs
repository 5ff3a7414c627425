//! What a mission measured, gathered from the reports of its three programs, and what must hold of it.

use anyhow::Context as _;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Figures of one mission, all measured in that run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Name of the recording that the companion saw.
    pub recording: String,
    /// RGB-D images in it.
    pub frames: u64,
    /// Share of the images whose pose was tracked.
    pub tracked_share: f64,
    /// Absolute trajectory error against the recording's truth, SE(3)-aligned, root mean square over the tracked images.
    pub ate_rmse_m: f64,
    /// Images per second of time that tracking and mapping took, waiting and decoding left out.
    pub slam_fps: f64,
    /// Occupied voxels in the companion's final map.
    pub map_voxels_occupied: u64,
    /// Versions of tiles that the companion gave to the object transport.
    pub tiles_sent: u64,
    /// Tile versions that the ground station received whole.
    pub tiles_received: u64,
    /// Digest of the companion's final map.
    pub map_digest_companion: String,
    /// Digest of the map that the ground station holds at the end.
    pub map_digest_groundstation: String,
    /// Bytes of MAVLink frames with Tandem's own messages that the companion put on its link to the ground station.
    pub bytes_on_wire: u64,
    /// Length of the rover's planned path.
    pub path_length_m: f64,
    /// Smallest distance from the rover's path to anything not drivable.
    pub path_min_clearance_m: f64,
    /// Items of all missions that were uploaded.
    pub mission_items: u64,
    /// Whether every uploaded mission read back equal.
    pub mission_readback_equal: bool,
    /// Distance in truth from where the rover stopped to the last place of its mission (the goal, moved to where a path ends).
    pub rover_final_error_m: f64,
    /// Whether the copter, in truth, reached every item of its survey.
    pub copter_survey_completed: bool,
    /// Duration of the whole mission.
    pub wall_s: f64,
}

/// The reports of the three programs, as they wrote them.
pub struct Parts {
    /// The companion's.
    pub companion: Value,
    /// The ground station's.
    pub groundstation: Value,
    /// The simulator's: truth.
    pub sitl: Value,
}

impl Report {
    /// Puts the parts together; a missing figure is an error that names it.
    pub fn gather(parts: &Parts, wall_s: f64) -> anyhow::Result<Self> {
        let Parts {
            companion,
            groundstation,
            sitl,
        } = parts;
        Ok(Self {
            recording: figure(companion, "companion", "/recording")?,
            frames: figure(companion, "companion", "/frames")?,
            tracked_share: figure(companion, "companion", "/tracked_share")?,
            ate_rmse_m: figure(companion, "companion", "/ate_rmse_m")?,
            slam_fps: figure(companion, "companion", "/slam_fps")?,
            map_voxels_occupied: figure(companion, "companion", "/map_voxels_occupied")?,
            tiles_sent: figure(companion, "companion", "/tiles_sent")?,
            tiles_received: figure(groundstation, "ground station", "/tiles_received")?,
            map_digest_companion: figure(companion, "companion", "/map_digest")?,
            map_digest_groundstation: figure(groundstation, "ground station", "/map_digest")?,
            bytes_on_wire: figure(companion, "companion", "/bytes_on_wire")?,
            path_length_m: figure(groundstation, "ground station", "/path_length_m")?,
            path_min_clearance_m: figure(groundstation, "ground station", "/path_min_clearance_m")?,
            mission_items: figure(groundstation, "ground station", "/mission_items")?,
            mission_readback_equal: figure(
                groundstation,
                "ground station",
                "/mission_readback_equal",
            )?,
            rover_final_error_m: figure(sitl, "simulator", "/rover/final_error_m")?,
            copter_survey_completed: figure(sitl, "simulator", "/copter/survey_completed")?,
            wall_s,
        })
    }

    /// What a good mission must reach and this one did not; empty if it is good.
    pub fn failures(&self) -> Vec<String> {
        let claims = [
            (
                self.tracked_share >= 0.95,
                format!("tracked_share {:.3} is below 0.95", self.tracked_share),
            ),
            (
                self.ate_rmse_m <= 0.35,
                format!("ate_rmse_m {:.3} is above 0.35", self.ate_rmse_m),
            ),
            (
                self.slam_fps >= 10.0,
                format!("slam_fps {:.1} is below 10", self.slam_fps),
            ),
            (self.map_voxels_occupied > 0, "the map is empty".to_owned()),
            (self.tiles_received > 0, "no tile was received".to_owned()),
            (
                self.map_digest_companion == self.map_digest_groundstation,
                format!(
                    "the maps differ: {} and {}",
                    self.map_digest_companion, self.map_digest_groundstation
                ),
            ),
            (self.path_length_m > 0.0, "no path was planned".to_owned()),
            (
                self.path_min_clearance_m > 0.0,
                format!("path_min_clearance_m is {:.3}", self.path_min_clearance_m),
            ),
            (
                self.mission_items > 1,
                format!("the mission has {} items", self.mission_items),
            ),
            (
                self.mission_readback_equal,
                "the mission did not read back equal".to_owned(),
            ),
            (
                self.rover_final_error_m <= 1.0,
                format!(
                    "rover_final_error_m {:.2} is above 1.0",
                    self.rover_final_error_m
                ),
            ),
            (
                self.copter_survey_completed,
                "the copter did not complete its survey".to_owned(),
            ),
        ];
        claims
            .into_iter()
            .filter(|(holds, _)| !holds)
            .map(|(_, text)| text)
            .collect()
    }
}

fn figure<T: serde::de::DeserializeOwned>(
    report: &Value,
    program: &str,
    key: &str,
) -> anyhow::Result<T> {
    let value = report
        .pointer(key)
        .with_context(|| format!("the {program}'s report has no figure {key}"))?;
    serde_json::from_value(value.clone())
        .with_context(|| format!("the {program}'s {key} is {value}"))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn good_parts() -> Parts {
        Parts {
            companion: json!({
                "recording": "room", "frames": 100, "tracked_share": 1.0, "ate_rmse_m": 0.02, "slam_fps": 30.0,
                "map_voxels_occupied": 1000, "tiles_sent": 9, "map_digest": "00aa", "bytes_on_wire": 12345
            }),
            groundstation: json!({
                "tiles_received": 9, "map_digest": "00aa", "path_length_m": 3.0, "path_min_clearance_m": 0.2,
                "mission_items": 12, "mission_readback_equal": true
            }),
            sitl: json!({ "rover": { "final_error_m": 0.1 }, "copter": { "survey_completed": true } }),
        }
    }

    #[test]
    fn a_good_mission_has_no_failures() {
        let report = Report::gather(&good_parts(), 60.0).expect("complete");
        assert_eq!(report.failures(), Vec::<String>::new());
    }

    #[test]
    fn each_figure_out_of_bounds_is_named() {
        let mut parts = good_parts();
        parts.companion["tracked_share"] = json!(0.94);
        parts.groundstation["map_digest"] = json!("00ab");
        parts.sitl["rover"]["final_error_m"] = json!(1.01);
        let failures = Report::gather(&parts, 60.0).expect("complete").failures();
        assert_eq!(
            failures,
            [
                "tracked_share 0.940 is below 0.95",
                "the maps differ: 00aa and 00ab",
                "rover_final_error_m 1.01 is above 1.0"
            ]
        );
    }

    #[test]
    fn a_missing_figure_is_named_with_its_program() {
        let mut parts = good_parts();
        parts.companion["ate_rmse_m"].take();
        let error = Report::gather(&parts, 60.0).expect_err("null is no error in metres");
        assert_eq!(error.to_string(), "the companion's /ate_rmse_m is null");
        parts.sitl = json!({});
        parts.companion["ate_rmse_m"] = json!(0.1);
        let error = Report::gather(&parts, 60.0).expect_err("the truth is missing");
        assert_eq!(
            error.to_string(),
            "the simulator's report has no figure /rover/final_error_m"
        );
    }
}
