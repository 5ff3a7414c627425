//! Both ends over a simulated radio, in simulated time.

use std::collections::BTreeMap;
use std::fs;
use std::time::Duration;

use maps::time::Stamp;
use proptest::prelude::*;
use sitl::link::Profile;

use super::client::{Done, Event, Job, JobError};
use super::*;
use crate::service::Ends;
use crate::simulated::{Air, losing, perfect};

const OWN: Address = Address::new(1, 191);
const STATION: Address = Address::new(255, 190);
const TICK: Duration = Duration::from_millis(10);

/// A served folder, a client and the radio between them.
struct Room {
    folder: tempfile::TempDir,
    now: Stamp,
    server: Server,
    client: Client,
    there: Air,
    back: Air,
    requests: BTreeMap<u8, usize>,
}

impl Room {
    fn new(radio: &Profile, writable: bool) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        fs::create_dir(folder.path().join("maps")).expect("there is room");
        let root = Root::new(folder.path(), writable).expect("it exists");
        let ends = Ends {
            own: STATION,
            peer: OWN,
        };
        Self {
            folder,
            now: Stamp::ZERO,
            server: Server::new(OWN, Some(root), 200_000),
            client: Client::new(ends),
            there: Air::new(STATION, radio, 1),
            back: Air::new(OWN, radio, 2),
            requests: BTreeMap::new(),
        }
    }

    fn write(&self, path: &str, bytes: &[u8]) {
        fs::write(self.folder.path().join(path), bytes).expect("there is room");
    }

    /// Runs a job to its end.
    fn run(&mut self, job: Job) -> Result<Done, JobError> {
        let first = self.client.start(self.now, job)?;
        self.there.send(self.now, [first]);
        for _ in 0..100_000 {
            self.now += TICK;
            for (from, message) in self.there.arrived(self.now) {
                if let Message::FILE_TRANSFER_PROTOCOL(request) = &message {
                    *self.requests.entry(request.payload[3]).or_default() += 1;
                }
                let answers = self.server.handle(self.now, from, &message);
                self.back.send(self.now, answers);
            }
            let pieces = self.server.tick(self.now);
            self.back.send(self.now, pieces);
            let mut events = Vec::new();
            for (from, message) in self.back.arrived(self.now) {
                let step = self.client.handle(self.now, from, &message);
                self.there.send(self.now, step.send);
                events.extend(step.events);
            }
            let step = self.client.tick(self.now);
            self.there.send(self.now, step.send);
            events.extend(step.events);
            for event in events {
                if let Event::Finished(result) = event {
                    return result;
                }
            }
        }
        panic!("it never ends");
    }

    fn download(&mut self, path: &str) -> Result<Done, JobError> {
        let (path, resume) = (path.to_owned(), Vec::new());
        self.run(Job::Download { path, resume })
    }
}

fn content(size: usize) -> Vec<u8> {
    (0..size).map(|i| (i * i / 7 + i) as u8).collect()
}

#[test]
fn files_arrive_whole_over_any_radio() {
    for loss in [0.0, 0.1, 0.3] {
        let mut room = Room::new(&losing(loss), false);
        for size in [0, 1, 239, 240, 50_000] {
            room.write("maps/a", &content(size));
            let got = room.download("/maps/a");
            let whole = got == Ok(Done::Downloaded(content(size)));
            assert!(whole, "{size} bytes at {loss}");
        }
    }
}

#[test]
fn a_burst_saves_a_request_for_each_piece() {
    let mut room = Room::new(&perfect(), false);
    room.write("a", &content(100_000));
    assert_eq!(room.download("a"), Ok(Done::Downloaded(content(100_000))));
    let count = |opcode: Opcode| room.requests.get(&(opcode as u8)).copied().unwrap_or(0);
    assert_eq!(
        (count(Opcode::BurstReadFile), count(Opcode::ReadFile)),
        (1, 0)
    );
}

#[test]
fn a_download_goes_on_where_it_ended_unless_the_file_has_changed() {
    let mut room = Room::new(&perfect(), false);
    room.write("a", &content(100_000));
    let resume = content(90_000);
    let path = "a".to_owned();
    let begun = room.now;
    let got = room.run(Job::Download {
        path: path.clone(),
        resume,
    });
    assert_eq!(got, Ok(Done::Downloaded(content(100_000))));
    assert!(
        room.now.since(begun) < Duration::from_millis(300),
        "10 kB at 200 kB/s"
    );
    let other = vec![9; 90_000];
    let got = room.run(Job::Download {
        path: path.clone(),
        resume: other,
    });
    assert_eq!(got, Ok(Done::Downloaded(content(100_000))));
    let longer = vec![9; 200_000];
    let got = room.run(Job::Download {
        path,
        resume: longer,
    });
    assert_eq!(got, Ok(Done::Downloaded(content(100_000))));
}

#[test]
fn a_server_that_falls_silent_leaves_what_can_be_resumed() {
    let mut room = Room::new(&perfect(), false);
    room.write("a", &content(100_000));
    let path = "a".to_owned();
    let first = room.client.start(
        room.now,
        Job::Download {
            path,
            resume: Vec::new(),
        },
    );
    room.there.send(room.now, first.ok());
    let mut result = None;
    for tick in 0..10_000 {
        room.now += TICK;
        if tick < 30 {
            for (from, message) in room.there.arrived(room.now) {
                room.back
                    .send(room.now, room.server.handle(room.now, from, &message));
            }
            room.back.send(room.now, room.server.tick(room.now));
        }
        for (from, message) in room.back.arrived(room.now) {
            let step = room.client.handle(room.now, from, &message);
            room.there.send(room.now, step.send);
        }
        let step = room.client.tick(room.now);
        for event in step.events {
            if let Event::Finished(Err(error)) = event {
                result = Some(error);
            }
        }
    }
    let Some(JobError::NoAnswer { so_far }) = result else {
        panic!("it gives up: {result:?}");
    };
    assert!(so_far.len() > 20_000, "{} bytes", so_far.len());
    assert_eq!(so_far, content(100_000)[..so_far.len()]);
    assert!(room.client.is_idle());
}

#[test]
fn what_is_published_is_read_whatever_is_asked_about_it() {
    let mut room = Room::new(&losing(0.1), false);
    room.server.publish("@PARAM/param.pck", content(3000));
    for path in ["@PARAM/param.pck", "/@PARAM/param.pck?withdefaults=1"] {
        assert_eq!(room.download(path), Ok(Done::Downloaded(content(3000))));
    }
    room.server = Server::new(OWN, None, 200_000);
    let missing = Err(JobError::Refused(FtpError::FileNotFound));
    assert_eq!(room.download("@PARAM/param.pck"), missing);
    assert_eq!(
        room.run(Job::List {
            path: "/".to_owned()
        }),
        Err(JobError::Refused(FtpError::FileNotFound))
    );
}

#[test]
fn what_leaves_the_folder_is_refused() {
    let mut room = Room::new(&perfect(), true);
    let outside = tempfile::tempdir().expect("a folder");
    fs::write(outside.path().join("secret"), "key").expect("there is room");
    std::os::unix::fs::symlink(outside.path(), room.folder.path().join("link")).expect("any name");
    let secret = outside.path().join("secret");
    let refused = Err(JobError::Refused(FtpError::FileProtected));
    for path in [
        "../secret",
        "maps/../../secret",
        "link/secret",
        "/link/secret",
        "link/new",
    ] {
        assert_eq!(room.download(path), refused, "{path}");
        let upload = Job::Upload {
            path: path.to_owned(),
            bytes: vec![1],
        };
        assert_eq!(room.run(upload), refused, "{path}");
        assert_eq!(
            room.run(Job::Checksum {
                path: path.to_owned()
            }),
            refused,
            "{path}"
        );
    }
    let absolute = secret.to_str().expect("a plain name");
    let missing = Err(JobError::Refused(FtpError::FileNotFound));
    assert_eq!(room.download(absolute), missing, "it is looked for inside");
    assert_eq!(room.download("nothing"), missing);
    assert_eq!(room.download("maps"), missing, "a folder");
}

#[test]
fn a_folder_that_is_not_writable_is_not_written() {
    let mut room = Room::new(&perfect(), false);
    let upload = Job::Upload {
        path: "a".to_owned(),
        bytes: vec![1],
    };
    let refused = Err(JobError::Refused(FtpError::FileProtected));
    assert_eq!(room.run(upload), refused);
    assert!(!room.folder.path().join("a").exists());
}

#[test]
fn files_are_written_and_verified_over_a_bad_radio() {
    let mut room = Room::new(&losing(0.2), true);
    let bytes = content(5_000);
    let path = "maps/b".to_owned();
    let upload = Job::Upload {
        path: path.clone(),
        bytes: bytes.clone(),
    };
    assert_eq!(room.run(upload), Ok(Done::Uploaded));
    let written = fs::read(room.folder.path().join("maps/b")).expect("it is there");
    assert_eq!(written, bytes);
    assert_eq!(
        room.run(Job::Checksum { path }),
        Ok(Done::Checksum(Crc32::of(&bytes)))
    );
}

#[test]
fn long_folders_are_listed_in_pages() {
    let mut room = Room::new(&losing(0.1), false);
    for number in 0..100 {
        room.write(&format!("maps/file_{number:03}"), &content(number));
    }
    let path = "maps".to_owned();
    let Ok(Done::Listed(entries)) = room.run(Job::List { path }) else {
        panic!("it is a folder");
    };
    assert_eq!(entries.len(), 100);
    assert_eq!(entries[99], ("file_099".to_owned(), Some(99)));
    let root = room.run(Job::List {
        path: "/".to_owned(),
    });
    assert_eq!(root, Ok(Done::Listed(vec![("maps/".to_owned(), None)])));
}

#[test]
fn the_checksum_is_the_one_of_autopilots() {
    // CRC-32 over "123456789" with the register 0 at first and not inverted at the end, computed bit by bit.
    let mut register = 0_u32;
    for byte in b"123456789" {
        register ^= u32::from(*byte);
        for _ in 0..8 {
            register = if register & 1 == 1 {
                register >> 1 ^ 0xEDB8_8320
            } else {
                register >> 1
            };
        }
    }
    assert_eq!(Crc32::of(b"123456789"), register);
    assert_eq!(Crc32::of(b""), 0);
}

#[test]
fn sessions_are_bounded_and_belong_to_their_client() {
    let mut room = Room::new(&perfect(), false);
    room.write("a", &content(10));
    let mut open = |number: u16, from: Address| {
        let mut request = Packet::request(Opcode::OpenFileRo, 0, 0, b"a");
        request.sequence = number;
        let answers = room
            .server
            .handle(Stamp::ZERO, from, &request.to_message(OWN));
        let Some(Message::FILE_TRANSFER_PROTOCOL(answer)) = answers.first() else {
            panic!("it is answered");
        };
        Packet::read(answer)
    };
    for number in 0..8 {
        assert_eq!(open(number, STATION).opcode, Opcode::Ack as u8);
    }
    let ninth = open(9, STATION);
    assert_eq!(
        FtpError::from_wire(&ninth.data),
        FtpError::NoSessionsAvailable
    );
    let mut read = Packet::request(Opcode::ReadFile, 3, 0, &[]);
    (read.size, read.sequence) = (10, 20);
    let other = Address::new(254, 190);
    let answers = room
        .server
        .handle(Stamp::ZERO, other, &read.to_message(OWN));
    let Some(Message::FILE_TRANSFER_PROTOCOL(answer)) = answers.first() else {
        panic!("it is answered");
    };
    let answer = Packet::read(answer);
    assert_eq!(FtpError::from_wire(&answer.data), FtpError::InvalidSession);
}

#[test]
fn what_comes_late_for_a_closed_session_does_not_touch_the_next_of_its_number() {
    let mut room = Room::new(&perfect(), false);
    room.write("a", &content(10));
    let mut ask = |sequence: u16, mut packet: Packet| {
        packet.sequence = sequence;
        let answers = room
            .server
            .handle(Stamp::ZERO, STATION, &packet.to_message(OWN));
        let Some(Message::FILE_TRANSFER_PROTOCOL(answer)) = answers.first() else {
            panic!("it is answered");
        };
        Packet::read(answer).opcode == Opcode::Ack as u8
    };
    let open = || Packet::request(Opcode::OpenFileRo, 0, 0, b"a");
    let close = || Packet::request(Opcode::TerminateSession, 0, 0, &[]);
    let mut read = Packet::request(Opcode::ReadFile, 0, 0, &[]);
    read.size = 10;
    assert!(ask(65_534, open()) && ask(65_535, close()) && ask(0, open()));
    assert!(!ask(65_535, close()), "a copy that was overtaken");
    assert!(ask(1, read));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn hostile_requests_never_panic_nor_leave_the_folder(
        requests in prop::collection::vec(
            (0u8..20, any::<u8>(), any::<u32>(), any::<u8>(), prop::collection::vec(any::<u8>(), 0..30)), 0..60
        )
    ) {
        let mut room = Room::new(&perfect(), true);
        let parent = room.folder.path().parent().expect("it has one");
        let beside = parent.join("written-by-nobody");
        for (number, (opcode, session, offset, size, mut data)) in (0u16..).zip(requests) {
            if opcode % 3 == 0 {
                data = b"../written-by-nobody\0x".to_vec();
            }
            let mut packet = Packet::request(Opcode::Ack, session % 9, offset >> (size % 32), &data);
            (packet.opcode, packet.size, packet.sequence) = (opcode, size, number);
            let message = packet.to_message(OWN);
            prop_assert!(room.server.handle(Stamp::ZERO, STATION, &message).len() <= 1);
            room.server.tick(Stamp::ZERO + Duration::from_millis(u64::from(number)));
        }
        prop_assert!(!beside.exists());
        let total: u64 = fs::read_dir(room.folder.path()).expect("it is there")
            .map(|entry| entry.expect("it is there").metadata().expect("it is there").len()).sum();
        prop_assert!(total < 100 << 20, "{total} bytes");
    }

    #[test]
    fn hostile_answers_never_panic_and_take_bounded_memory(
        answers in prop::collection::vec((any::<u8>(), any::<u8>(), any::<u32>(), any::<[u8; 6]>()), 0..60)
    ) {
        let mut room = Room::new(&perfect(), false);
        let job = Job::Download { path: "a".to_owned(), resume: Vec::new() };
        room.client.start(room.now, job).expect("it is idle");
        for (kind, asked, offset, data) in answers {
            let opcode = if kind % 4 == 0 { Opcode::Nak } else { Opcode::Ack };
            let mut packet = Packet::request(opcode, 0, offset >> (kind % 32), &data);
            packet.asked = [4, 5, 15, 14, asked][usize::from(kind % 5)];
            packet.sequence = room.client.sequence_expected();
            packet.burst_complete = kind % 7 == 0;
            room.now += Duration::from_millis(u64::from(kind));
            room.client.handle(room.now, OWN, &packet.to_message(STATION));
            room.client.tick(room.now);
        }
    }
}
