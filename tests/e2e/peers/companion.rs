//! Ground stations of others at the ground link of a companion.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use serde_json::Value;
use tests::program::{Program, Show};

use super::autopilot::mavproxy;
use super::{dialect, free_port, python, start_vehicle, stop};
use crate::programs;

/// `TANDEM_STATUS_FLAGS`: the source is finished, all is delivered, the autopilot is heard.
const FINISHED: u64 = 1;
const DELIVERED: u64 = 2;
const HEARD: u64 = 4;

/// A companion that maps two seconds of the simulated room, perhaps with an autopilot.
struct OnBoard {
    folder: tempfile::TempDir,
    companion: Program,
    autopilot: Option<Program>,
    /// Where the companion's ground link sends to.
    ground: u16,
}

impl OnBoard {
    fn start(with_autopilot: bool) -> Self {
        let folder = tempfile::tempdir().expect("a folder for all of it");
        let path = folder.path();
        let room = path.join("room.mcap");
        let mut record = Command::new(programs::folder().join("sitl"));
        record.args(["run", "--scene", "room", "--seed", "1", "--headless"]);
        record.args(["--duration", "2", "--record"]).arg(&room);
        Program::start("record", record, &path.join("record.log"), Show::Nothing)
            .and_then(|mut record| record.wait(Duration::from_mins(1)))
            .expect("the simulator records");
        let (ground, autopilot) = (free_port(), free_port());
        let config = path.join("companion.toml");
        fs::write(&config, configuration(ground, autopilot)).expect("there is room");
        let mut companion = Command::new(programs::folder().join("companion"));
        companion.arg("run").arg("-c").arg(config);
        companion.arg("--source").arg(room);
        companion.arg("--out").arg(path.join("out"));
        let log = path.join("companion.log");
        Self {
            companion: Program::start("companion", companion, &log, Show::Nothing)
                .expect("the companion starts"),
            autopilot: with_autopilot
                .then(|| start_vehicle(autopilot, &["--copter"], &path.join("sitl.log"))),
            folder,
            ground,
        }
    }

    fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Ends all of it; returns the companion's report.
    fn stop(self) -> Value {
        stop(self.companion);
        if let Some(autopilot) = self.autopilot {
            stop(autopilot);
        }
        let report = fs::read_to_string(self.folder.path().join("out/report.json"));
        serde_json::from_str(&report.expect("the companion leaves a report")).expect("JSON")
    }
}

fn configuration(ground: u16, autopilot: u16) -> String {
    format!(
        "[source]\npace = \"fast\"\n\
         [mount]\ntilted_down_deg = 20.6265\n\
         [links]\nground = \"udpout:127.0.0.1:{ground}\"\nautopilot = \"udpin:127.0.0.1:{autopilot}\"\n\
         [origin]\nlat_deg = -33.8568\nlon_deg = -70.6693\nalt_m = 520.5\n"
    )
}

#[test]
fn mavproxy_hears_a_companion_without_an_autopilot() {
    let on_board = OnBoard::start(false);
    let told = mavproxy(on_board.ground, on_board.folder(), "companion");
    assert_eq!(told, "companion heard\n");
    on_board.stop();
}

#[test]
fn mavproxy_uses_the_autopilot_behind_the_companion_without_a_complaint() {
    let on_board = OnBoard::start(true);
    let told = mavproxy(on_board.ground, on_board.folder(), "both");
    let expected = "companion heard\n41 parameters by file\nmission of 3 items\n\
                    impossible mission refused\n";
    assert_eq!(told, expected);
    on_board.stop();
}

#[test]
fn mavsdk_reads_what_the_companion_says_of_its_map() {
    let on_board = OnBoard::start(true);
    let uri = format!("udpin://127.0.0.1:{}", on_board.ground);
    let dialect = dialect::definition();
    let flags = (FINISHED | HEARD).to_string();
    let told = python(
        "mavsdk_dialect.py",
        &[
            "listen".as_ref(),
            uri.as_ref(),
            dialect.as_ref(),
            "TANDEM_".as_ref(),
            "TANDEM_STATUS".as_ref(),
            "flags".as_ref(),
            flags.as_ref(),
            // Known once the autopilot has said where it is, which may be after the last image.
            "TANDEM_ORIGIN".as_ref(),
        ],
    );
    let report = on_board.stop();
    let messages: Vec<Value> = told
        .lines()
        .map(|line| serde_json::from_str(line).expect("one JSON object a line"))
        .collect();
    let from_us = serde_json::json!([1, 191]);
    assert!(messages.iter().all(|message| message["from"] == from_us));
    let last = |name: &str| {
        let mut newest_first = messages.iter().rev();
        let found = newest_first.find(|message| message["name"] == name);
        let fields = found.and_then(|message| message["fields"].as_object());
        fields.unwrap_or_else(|| panic!("no {name} in {told}"))
    };

    let status = last("TANDEM_STATUS");
    for (field, figure) in [
        ("frames", "frames"),
        ("frames_tracked", "frames_tracked"),
        ("voxels_occupied", "map_voxels_occupied"),
        ("tiles_known", "map_tiles"),
        ("tiles_delivered", "tiles_delivered"),
    ] {
        assert_eq!(status[field], report[figure], "{field} in {status:?}");
    }
    let digest = status["map_digest"].as_u64().expect("64 bits");
    assert_eq!(format!("{digest:016x}"), report["map_digest"]);
    assert!(
        status["voxels_occupied"].as_u64() > Some(1000),
        "{status:?}"
    );
    // MAVSDK takes no objects.
    let flags = status["flags"].as_u64().expect("a number");
    assert_eq!(flags & DELIVERED, 0, "{status:?}");

    let origin = last("TANDEM_ORIGIN");
    let degrees_e7_and_millimetres = ["lat", "lon", "alt"].map(|field| origin[field].as_i64());
    let expected = [-338_568_000, -706_693_000, 520_500].map(Some);
    assert_eq!(degrees_e7_and_millimetres, expected);
}
