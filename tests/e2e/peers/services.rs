//! Files and signatures, with pymavlink and MAVSDK at the other end of a socket.

use std::ffi::OsStr;
use std::fs;
use std::path::Path;
use std::time::Duration;

use maps::time::Stamp;
use mavlink_ext::dialect::tandem::{MavAutopilot, MavType};
use mavlink_ext::ftp::{Crc32, Root, Server};
use mavlink_ext::signing::{Policy, Signing, SigningKey, SigningStats, Timestamp};
use mavlink_ext::{Encoder, RawFrame};

use super::host::{AUTOPILOT, COMPANION, Host, Service, clock, heartbeat};
use super::python;

const KEY: [u8; 32] = [0x42; 32];

/// A vehicle whose companion serves a folder.
struct Files {
    server: Server,
    autopilot: Encoder,
    companion: Encoder,
    heartbeat_due: Stamp,
}

impl Files {
    fn new(folder: &Path) -> Self {
        let root = Root::new(folder, true).expect("it exists");
        Self {
            server: Server::new(COMPANION, Some(root), 1_000_000),
            autopilot: Encoder::new(AUTOPILOT),
            companion: Encoder::new(COMPANION),
            heartbeat_due: Stamp::ZERO,
        }
    }
}

impl Service for Files {
    fn handle(&mut self, now: Stamp, frame: &RawFrame) -> Vec<RawFrame> {
        let Ok(message) = frame.decode() else {
            return Vec::new();
        };
        let answers = self.server.handle(now, frame.from(), &message);
        answers
            .iter()
            .map(|answer| self.companion.encode(answer))
            .collect()
    }

    fn tick(&mut self, now: Stamp) -> Vec<RawFrame> {
        let pieces = self.server.tick(now);
        let mut frames: Vec<RawFrame> = pieces
            .iter()
            .map(|piece| self.companion.encode(piece))
            .collect();
        if now >= self.heartbeat_due {
            self.heartbeat_due = now + Duration::from_millis(500);
            let copter = heartbeat(MavType::MAV_TYPE_QUADROTOR, MavAutopilot::MAV_AUTOPILOT_PX4);
            let computer = heartbeat(
                MavType::MAV_TYPE_ONBOARD_CONTROLLER,
                MavAutopilot::MAV_AUTOPILOT_INVALID,
            );
            frames.push(self.autopilot.encode(&copter));
            frames.push(self.companion.encode(&computer));
        }
        frames
    }
}

/// A served folder with one large file, one file beside the folder, and a place for what is fetched.
struct Folders {
    all: tempfile::TempDir,
    large: Vec<u8>,
}

impl Folders {
    fn new() -> Self {
        let all = tempfile::tempdir().expect("a folder");
        let large: Vec<u8> = (0..30_000_u32).map(|i| (i * i / 5) as u8).collect();
        fs::create_dir_all(all.path().join("served/files")).expect("there is room");
        fs::create_dir(all.path().join("fetched")).expect("there is room");
        fs::write(all.path().join("outside"), "secret").expect("there is room");
        fs::write(all.path().join("served/files/large"), &large).expect("there is room");
        Self { all, large }
    }

    fn check_untouched(&self) {
        let outside = fs::read(self.all.path().join("outside")).expect("it is still there");
        assert_eq!(outside, b"secret");
    }
}

#[test]
fn pymavlink_lists_and_fetches_our_files() {
    let folders = Folders::new();
    let host = Host::start(Files::new(&folders.all.path().join("served")));
    let endpoint = format!("udpin:127.0.0.1:{}", host.port);
    let fetched = folders.all.path().join("fetched");
    let told = python(
        "pymavlink_services.py",
        &["ftp".as_ref(), endpoint.as_ref(), fetched.as_ref()],
    );
    assert!(told.contains("listed [('large', 30000)]"), "{told}");
    assert!(told.contains("refused FileProtected"), "{told}");
    let bytes = fs::read(fetched.join("by_pymavlink")).expect("it was fetched");
    assert_eq!(Crc32::of(&bytes), Crc32::of(&folders.large));
    folders.check_untouched();
    host.stop();
}

#[test]
fn mavsdk_fetches_and_writes_our_files() {
    let folders = Folders::new();
    let host = Host::start(Files::new(&folders.all.path().join("served")));
    let uri = format!("udpin://127.0.0.1:{}", host.port);
    let fetched = folders.all.path().join("fetched");
    let told = python("mavsdk_ftp.py", &[uri.as_ref(), fetched.as_ref()]);
    assert!(told.contains("all equal"), "{told}");
    for name in ["burst/large", "plain/large"] {
        let bytes = fs::read(fetched.join(name)).expect("it was fetched");
        assert!(bytes == folders.large, "{name} differs");
    }
    let written = fs::read(folders.all.path().join("served/files/written"));
    assert_eq!(written.expect("it was written").len(), 256 * 20);
    folders.check_untouched();
    host.stop();
}

/// Beats with a signature, and counts what comes.
struct Signed {
    signing: Signing,
    encoder: Encoder,
    heartbeat_due: Stamp,
}

impl Signed {
    fn beat(&mut self) -> Vec<RawFrame> {
        let message = heartbeat(
            MavType::MAV_TYPE_ONBOARD_CONTROLLER,
            MavAutopilot::MAV_AUTOPILOT_INVALID,
        );
        let frame = self.encoder.encode(&message);
        self.signing
            .sign(Timestamp::from_unix(clock()), frame)
            .into_iter()
            .collect()
    }
}

impl Service for Signed {
    fn handle(&mut self, _now: Stamp, frame: &RawFrame) -> Vec<RawFrame> {
        // All four have come when the last does, taken or not.
        let _taken = self.signing.check(Timestamp::from_unix(clock()), frame);
        Vec::new()
    }

    fn tick(&mut self, now: Stamp) -> Vec<RawFrame> {
        if now < self.heartbeat_due {
            return Vec::new();
        }
        self.heartbeat_due = now + Duration::from_millis(300);
        self.beat()
    }
}

#[test]
fn pymavlink_and_we_check_each_others_signatures() {
    let key = SigningKey::new(KEY);
    let host = Host::start(Signed {
        signing: Signing::new(Policy::Required, key, 3, Timestamp::default()),
        encoder: Encoder::new(COMPANION),
        heartbeat_due: Stamp::ZERO,
    });
    let digits = "42".repeat(KEY.len());
    let endpoint = format!("udpin:127.0.0.1:{}", host.port);
    let arguments: [&OsStr; 3] = ["signing".as_ref(), endpoint.as_ref(), digits.as_ref()];
    let told = python("pymavlink_services.py", &arguments);
    assert!(told.contains("signed both ways"), "{told}");
    let stats = host.stop().signing.stats();
    let expected = SigningStats {
        signed: 1,
        rejected_unsigned: 1,
        rejected_wrong_key: 1,
        rejected_replayed: 1,
        ..SigningStats::default()
    };
    assert_eq!(stats, expected);
}
