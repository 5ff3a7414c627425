//! Two other implementations read and write our dialect: pymavlink's generator for Python, and MAVSDK.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use maps::time::Stamp;
use mavlink_ext::dialect::tandem::{MavAutopilot, MavSeverity, MavType, STATUSTEXT_DATA};
use mavlink_ext::dialect::{
    CATALOGUE, MessageExt as _, MessageInfo, TANDEM_IDS, char_array, message_info,
};
use mavlink_ext::wire::WireError;
use mavlink_ext::{Address, Encoder, Message, RawFrame};
use rand::{Rng as _, RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use serde::Deserialize;
use serde_json::{Map, Value};

use super::host::{AUTOPILOT, COMPANION, Host, Service, heartbeat};
use super::python;

/// How the names of our messages begin.
const PREFIX: &str = "TANDEM_";
/// Messages of each kind, of numbers by chance.
const CASES: u64 = 20;

pub(super) fn definition() -> PathBuf {
    PathBuf::from(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../mavlink_ext/dialects/tandem.xml"
    ))
}

fn ours() -> impl Iterator<Item = &'static MessageInfo> {
    CATALOGUE
        .iter()
        .filter(|info| TANDEM_IDS.contains(&info.id))
}

/// The message of these bytes; what they lack is zero.
fn message(info: &MessageInfo, payload: &[u8]) -> Message {
    let frame = RawFrame::new(COMPANION, 0, (info.id, payload));
    frame.decode().expect("numbers are free in our messages")
}

/// Messages of every kind of ours: zeros, largest bytes, bytes by chance, and such that end in zeros. Kinds alternate.
fn messages() -> Vec<Message> {
    let mut random = Pcg64::seed_from_u64(54_100);
    let mut messages = Vec::new();
    for fill in [0, 0xFF] {
        messages.extend(ours().map(|info| message(info, &vec![fill; info.length])));
    }
    for case in 0..CASES {
        for info in ours() {
            let mut payload = vec![0; info.length];
            let end = if case % 2 == 0 {
                info.length
            } else {
                random.random_range(0..info.length)
            };
            random.fill_bytes(&mut payload[..end]);
            messages.push(message(info, &payload));
        }
    }
    messages
}

/// Names and values of a message's fields. There is no other way to ask it than what it prints of itself, which is as JSON but
/// for the names and for what is not finite.
#[track_caller]
fn fields(message: &Message) -> Map<String, Value> {
    let printed = format!("{message:?}");
    let (start, end) = (printed.find('{'), printed.rfind('}'));
    let body = &printed[start.expect("a structure")..=end.expect("a structure")];
    let mut json = String::new();
    let mut word = String::new();
    for letter in body.chars() {
        if letter.is_ascii_alphanumeric() || "_.-".contains(letter) {
            word.push(letter);
            continue;
        }
        let is_text = letter == ':' || ["NaN", "inf", "-inf"].contains(&word.as_str());
        let quote = if is_text { "\"" } else { "" };
        write!(json, "{quote}{word}{quote}{letter}").expect("memory takes it");
        word.clear();
    }
    serde_json::from_str(&json).unwrap_or_else(|error| panic!("{error} in {json}"))
}

/// Whether both are the same: numbers of 64 bits exactly, real ones as the 32 bits in which they travel.
fn same(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::Array(a), Value::Array(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b))
        }
        (Value::Number(x), Value::Number(y)) if x.is_f64() || y.is_f64() => {
            let narrow = |number: &Value| number.as_f64().map(|number| (number as f32).to_bits());
            narrow(a) == narrow(b)
        }
        _ => a == b,
    }
}

#[track_caller]
fn check_same(name: &str, ours: &Map<String, Value>, theirs: &Map<String, Value>) {
    let names = |fields: &Map<String, Value>| {
        let mut names: Vec<String> = fields.keys().cloned().collect();
        names.sort_unstable();
        names
    };
    assert_eq!(names(ours), names(theirs), "{name}");
    for (field, value) in ours {
        let theirs = &theirs[field];
        assert!(
            same(value, theirs),
            "{name}.{field}: ours {value}, theirs {theirs}"
        );
    }
}

/// What `dialect_frames.py` prints.
#[derive(Deserialize)]
struct Told {
    messages: Vec<Definition>,
    read: Vec<Read>,
    read_newer: Vec<Read>,
    built: Vec<Built>,
    built_newer: Vec<Built>,
    built_extended: Vec<Frame>,
    refused: Vec<Frame>,
}

#[derive(Deserialize)]
struct Definition {
    id: u32,
    name: String,
    crc_extra: u8,
    length: usize,
}

#[derive(Deserialize)]
struct Read {
    name: String,
    fields: Map<String, Value>,
}

#[derive(Deserialize)]
struct Built {
    name: String,
    fields: Map<String, Value>,
    frame: String,
}

#[derive(Deserialize)]
struct Frame {
    name: String,
    frame: String,
}

fn digits(frame: &RawFrame) -> String {
    frame
        .bytes()
        .iter()
        .fold(String::new(), |mut digits, byte| {
            write!(digits, "{byte:02x}").expect("memory takes it");
            digits
        })
}

fn parse(digits: &str) -> Result<RawFrame, WireError> {
    let bytes = digits.as_bytes().chunks(2).map(|pair| {
        let pair = std::str::from_utf8(pair).expect("hexadecimal digits");
        u8::from_str_radix(pair, 16).expect("hexadecimal digits")
    });
    RawFrame::from_bytes(&bytes.collect::<Vec<u8>>())
}

/// Everything that the generated Python has to say, of these frames of ours among others.
fn ask_pymavlink(messages: &[Message]) -> Told {
    let folder = tempfile::tempdir().expect("a folder for the frames");
    let file = folder.path().join("frames");
    let mut encoder = Encoder::new(COMPANION);
    let frames: Vec<String> = messages
        .iter()
        .map(|message| digits(&encoder.encode(message)))
        .collect();
    fs::write(&file, frames.join("\n")).expect("there is room");
    let dialect = definition();
    let told = python(
        "dialect_frames.py",
        &[dialect.as_ref(), PREFIX.as_ref(), file.as_ref()],
    );
    serde_json::from_str(&told).expect("what the script is documented to print")
}

#[test]
fn the_generated_python_and_we_agree_on_the_dialect() {
    let sent = messages();
    let told = ask_pymavlink(&sent);
    definitions_agree(&told.messages);
    for read in [&told.read, &told.read_newer] {
        assert_eq!(read.len(), sent.len());
        for (ours, theirs) in sent.iter().zip(read) {
            assert_eq!(ours.message_name(), theirs.name);
            check_same(&theirs.name, &fields(ours), &theirs.fields);
        }
    }
    we_read_what_it_built(&told);
    for Frame { name, frame } in &told.refused {
        let refused = parse(frame).map(|_| ());
        assert!(
            matches!(refused, Err(WireError::Checksum { .. })),
            "{name} of another definition: {refused:?}"
        );
    }
    assert_eq!(told.refused.len(), ours().count());
}

fn definitions_agree(theirs: &[Definition]) {
    let theirs: BTreeMap<u32, (&str, u8, usize)> = theirs
        .iter()
        .map(|m| (m.id, (m.name.as_str(), m.crc_extra, m.length)))
        .collect();
    for ours in CATALOGUE {
        let known = theirs.get(&ours.id).copied();
        assert_eq!(known, Some((ours.name, ours.crc_extra, ours.length)));
    }
    assert_eq!(CATALOGUE.len(), theirs.len());
}

fn we_read_what_it_built(told: &Told) {
    for built in told.built.iter().chain(&told.built_newer) {
        let frame = parse(&built.frame).unwrap_or_else(|error| panic!("{}: {error}", built.name));
        let message = frame.decode().expect("numbers are free in our messages");
        assert_eq!(message.message_name(), built.name);
        check_same(&built.name, &fields(&message), &built.fields);
    }
    // The other way round: what we make of it again is what came, byte for byte, zeros dropped alike.
    let built = told.built.iter().map(|built| (&built.name, &built.frame));
    let extended = told.built_extended.iter().map(|b| (&b.name, &b.frame));
    for (name, frame) in built.chain(extended) {
        let read = parse(frame).unwrap_or_else(|error| panic!("{name}: {error}"));
        let message = read.decode().unwrap_or_else(|error| panic!("{error}"));
        let again = Encoder::new(COMPANION).encode(&message);
        assert_eq!(digits(&again), *frame, "{name}: {message:?}");
    }
    let kinds = |frames: &[Built]| {
        let mut names: Vec<&str> = frames.iter().map(|built| built.name.as_str()).collect();
        names.dedup();
        names.len()
    };
    assert_eq!(kinds(&told.built), ours().count());
    assert!(kinds(&told.built_newer) > 0);
    let with_extensions = told.built_extended.iter().filter(|built| {
        let known = CATALOGUE.iter().find(|info| info.name == built.name);
        known.is_some_and(|info| info.length > info.length_without_extensions)
    });
    assert!(with_extensions.count() > 0);
}

/// A vehicle whose companion says one message after the other, each until it has come back.
struct Talk {
    autopilot: Encoder,
    companion: Encoder,
    say: Vec<Message>,
    came_back: Vec<Message>,
    heartbeat_due: Stamp,
    say_due: Stamp,
}

impl Talk {
    fn new(say: Vec<Message>) -> Self {
        Self {
            autopilot: Encoder::new(AUTOPILOT),
            companion: Encoder::new(COMPANION),
            say,
            came_back: Vec::new(),
            heartbeat_due: Stamp::ZERO,
            say_due: Stamp::ZERO,
        }
    }
}

impl Service for Talk {
    fn handle(&mut self, now: Stamp, frame: &RawFrame) -> Vec<RawFrame> {
        let said = self.say.get(self.came_back.len());
        if let (Some(said), Ok(message)) = (said, frame.decode())
            && said.message_id() == message.message_id()
        {
            self.came_back.push(message);
            self.say_due = now;
        }
        Vec::new()
    }

    fn tick(&mut self, now: Stamp) -> Vec<RawFrame> {
        let mut frames = Vec::new();
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
        if now >= self.say_due {
            self.say_due = now + Duration::from_millis(200);
            let end = Message::STATUSTEXT(STATUSTEXT_DATA {
                severity: MavSeverity::MAV_SEVERITY_INFO,
                text: char_array("all came back"),
                id: 0,
                chunk_seq: 0,
            });
            let said = self.say.get(self.came_back.len());
            frames.push(self.companion.encode(said.unwrap_or(&end)));
        }
        frames
    }
}

/// What MAVSDK calls itself.
const MAVSDK: Address = Address::new(245, 190);

/// Messages for MAVSDK, which leaves those for others alone, and whose numbers have a text in JSON, which NaN has not.
fn messages_for_mavsdk() -> Vec<Message> {
    let mut messages = messages();
    for message in &mut messages {
        if let Some(system) = message.target_system_id_mut() {
            *system = MAVSDK.system.0;
        }
        if let Some(component) = message.target_component_id_mut() {
            *component = MAVSDK.component.0;
        }
    }
    messages.retain(|message| {
        let fields = fields(message);
        let numbers = fields.values().flat_map(|value| match value {
            Value::Array(values) => values.as_slice(),
            single => std::slice::from_ref(single),
        });
        numbers.clone().all(Value::is_number)
    });
    messages
}

#[test]
fn mavsdk_reads_and_writes_every_message_of_our_dialect() {
    let said = messages_for_mavsdk();
    for info in ours() {
        let of_it = said.iter().filter(|said| said.message_id() == info.id);
        assert!(of_it.count() > 1, "nothing but zeros of {}", info.name);
    }
    let host = Host::start(Talk::new(said.clone()));
    let uri = format!("udpin://127.0.0.1:{}", host.port);
    let dialect = definition();
    let told = python(
        "mavsdk_dialect.py",
        &[
            "echo".as_ref(),
            uri.as_ref(),
            dialect.as_ref(),
            PREFIX.as_ref(),
        ],
    );
    let came_back = host.stop().came_back;
    assert_eq!(came_back.len(), said.len());
    for (back, said) in came_back.iter().zip(&said) {
        assert_eq!(back, said);
    }
    let mut read = told.lines().map(|line| {
        let read: Read = serde_json::from_str(line).expect("one JSON object a line");
        read
    });
    for said in &said {
        // What was said again because its echo was late is read twice.
        let info = message_info(said.message_id()).expect("ours");
        let read = read.find(|read| read.name == info.name);
        let read = read.unwrap_or_else(|| panic!("{} was not read", info.name));
        check_same(info.name, &fields(said), &read.fields);
    }
}
