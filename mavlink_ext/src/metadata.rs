//! Component metadata: files that describe a component, for whoever asks for `COMPONENT_METADATA`.
//!
//! The message names one file, `general.json`, by a `mftp://` address and its checksum, and that file the others. They are
//! fetched by MAVLink FTP from the component that sent the message, and kept by their checksums; the checksum is the
//! protocol's ([`Crc32`]), not that of zip files. Nothing may change while the component runs.
//! <https://mavlink.io/en/services/component_metadata.html>

use maps::time::Stamp;

use crate::command::Incoming;
use crate::dialect::tandem::{COMPONENT_METADATA_DATA, MavResult};
use crate::dialect::{Message, MessageData as _, char_array, cmd};
use crate::ftp::{Crc32, Server};
use crate::wire::Address;

/// Where the file is that names the others.
const GENERAL: &str = "general.json";

/// What a file tells (`COMP_METADATA_TYPE`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MetadataKind {
    /// Names, units and ranges of the parameters.
    Parameters = 1,
    /// Which commands are understood.
    Commands = 2,
    /// What is attached that does not speak MAVLink.
    Peripherals = 3,
    /// Texts of events.
    Events = 4,
    /// Motors, servos and their arrangement.
    Actuators = 5,
}

/// Files that describe a component.
#[derive(Clone, Debug, Default)]
pub struct Metadata {
    files: Vec<File>,
}

#[derive(Clone, Debug)]
struct File {
    kind: MetadataKind,
    path: String,
    bytes: Vec<u8>,
    elsewhere: Option<String>,
}

/// What is published, as the message names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Published {
    general_crc: u32,
}

impl Metadata {
    /// Describes nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// With a file, served at this path. It may be compressed with xz; its name ends in `.xz` then. `elsewhere` is where the same file
    /// is to be had if the link is too slow, such as an `https://` address. A file of the same kind is replaced.
    #[must_use]
    pub fn with(
        mut self,
        kind: MetadataKind,
        path: &str,
        bytes: Vec<u8>,
        elsewhere: Option<&str>,
    ) -> Self {
        self.files.retain(|file| file.kind != kind);
        self.files.push(File {
            kind,
            path: path.trim_start_matches('/').to_owned(),
            bytes,
            elsewhere: elsewhere.map(str::to_owned),
        });
        self
    }

    /// `general.json`: version 1 of its schema, as QGroundControl and MAVSDK read it.
    pub fn general_json(&self) -> String {
        let entries: Vec<String> = self.files.iter().map(File::entry).collect();
        let entries = entries.join(",");
        format!("{{\"version\":1,\"metadataTypes\":[{entries}]}}")
    }

    /// Serves all of it.
    pub fn publish(self, server: &mut Server) -> Published {
        let general = self.general_json().into_bytes();
        let general_crc = Crc32::of(&general);
        server.publish(GENERAL, general);
        for file in self.files {
            server.publish(&file.path, file.bytes);
        }
        Published { general_crc }
    }
}

impl File {
    fn entry(&self) -> String {
        let crc = Crc32::of(&self.bytes);
        let uri = json_string(&uri(&self.path));
        let kind = self.kind as u8;
        let fallback = self
            .elsewhere
            .as_ref()
            .map_or_else(String::new, |elsewhere| {
                let uri = json_string(elsewhere);
                format!(",\"uriFallback\":{uri},\"fileCrcFallback\":{crc}")
            });
        format!("{{\"type\":{kind},\"uri\":{uri},\"fileCrc\":{crc}{fallback}}}")
    }
}

impl Published {
    /// The message; the time is since the start of our clock.
    pub fn message(self, now: Stamp) -> Message {
        Message::COMPONENT_METADATA(COMPONENT_METADATA_DATA {
            time_boot_ms: (now.as_nanos() / 1_000_000) as u32,
            file_crc: self.general_crc,
            uri: char_array(&uri(GENERAL)),
        })
    }

    /// Tells it of any message that came in for `own`: what to answer if it asks for the metadata
    /// (`MAV_CMD_REQUEST_MESSAGE`), `None` otherwise.
    pub fn handle(
        self,
        now: Stamp,
        (own, from): (Address, Address),
        message: &Message,
    ) -> Option<[Message; 2]> {
        let command = Incoming::parse(own, from, message)?;
        let [wanted, ..] = command.params;
        let is_ours = command.command == cmd::REQUEST_MESSAGE
            && wanted.to_bits() == (COMPONENT_METADATA_DATA::ID as f32).to_bits();
        let ack = command.ack(MavResult::MAV_RESULT_ACCEPTED);
        is_ours.then(|| [ack, self.message(now)])
    }
}

fn uri(path: &str) -> String {
    format!("mftp://{path}")
}

/// In quotes, with what JSON does not allow in them escaped (RFC 8259, section 7).
fn json_string(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            // All of them are below U+00A0, so four digits do.
            c if c.is_control() => quoted.extend(format!("\\u{:04x}", u32::from(c)).chars()),
            c => quoted.push(c),
        }
    }
    quoted.push('"');
    quoted
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::command::{Client, Request};
    use crate::ftp;
    use crate::ftp::client::{Done, Event, Job};
    use crate::service::Ends;

    const OWN: Address = Address::new(1, 191);
    const STATION: Address = Address::new(255, 190);

    fn metadata() -> Metadata {
        let parameters = b"{\"version\":1,\"parameters\":[]}".to_vec();
        let kind = MetadataKind::Parameters;
        Metadata::new().with(kind, "/parameters.json", parameters, None)
    }

    #[test]
    fn the_general_file_names_the_others_with_their_checksums() {
        let crc = Crc32::of(b"{\"version\":1,\"parameters\":[]}");
        let expected = format!(
            "{{\"version\":1,\"metadataTypes\":[{{\"type\":1,\"uri\":\"mftp://parameters.json\",\"fileCrc\":{crc}}}]}}"
        );
        assert_eq!(metadata().general_json(), expected);
        let empty = "{\"version\":1,\"metadataTypes\":[]}";
        assert_eq!(Metadata::new().general_json(), empty);
    }

    #[test]
    fn a_file_may_be_elsewhere_too_and_is_replaced_by_another_of_its_kind() {
        let (kind, elsewhere) = (MetadataKind::Parameters, "https://example.org/a\"b");
        let general = metadata().with(kind, "p.json.xz", vec![1, 2, 3], Some(elsewhere));
        let general = general.general_json();
        assert!(!general.contains("parameters.json"), "{general}");
        let crc = Crc32::of(&[1, 2, 3]);
        let fallback = format!(
            "\"uriFallback\":\"https://example.org/a\\\"b\",\"fileCrcFallback\":{crc}}}]}}"
        );
        assert!(general.ends_with(&fallback), "{general}");
    }

    #[test]
    fn strings_are_escaped() {
        assert_eq!(json_string("a\\b\"c\nü"), "\"a\\\\b\\\"c\\u000aü\"");
    }

    /// What a client downloads, over a link that neither loses nor delays.
    fn fetch(server: &mut Server, path: &str) -> Vec<u8> {
        let mut client = ftp::Client::new(Ends {
            own: STATION,
            peer: OWN,
        });
        let (path, resume) = (path.to_owned(), Vec::new());
        let job = Job::Download { path, resume };
        let mut now = Stamp::ZERO;
        let mut there = vec![client.start(now, job).expect("it is idle")];
        for _ in 0..1000 {
            now += Duration::from_millis(10);
            let mut back = server.tick(now);
            for message in there.drain(..) {
                back.extend(server.handle(now, STATION, &message));
            }
            let mut step = client.tick(now);
            for message in back {
                step.extend(client.handle(now, OWN, &message));
            }
            there = step.send;
            for event in step.events {
                if let Event::Finished(done) = event {
                    let Ok(Done::Downloaded(bytes)) = done else {
                        panic!("{done:?}");
                    };
                    return bytes;
                }
            }
        }
        panic!("it never ends");
    }

    #[test]
    fn who_asks_is_told_where_the_file_is_and_can_fetch_it() {
        let mut server = Server::new(OWN, None, 1_000_000);
        let general = metadata().general_json();
        let published = metadata().publish(&mut server);
        let now = Stamp::ZERO + Duration::from_secs(2);
        let ask = |wanted: f32| {
            Client::new(STATION)
                .start(now, OWN, Request::long(cmd::REQUEST_MESSAGE, &[wanted]))
                .expect("nothing is under way")
        };
        let answers = published.handle(now, (OWN, STATION), &ask(397.0));
        let Some([Message::COMMAND_ACK(ack), Message::COMPONENT_METADATA(told)]) = answers else {
            panic!("{answers:?}");
        };
        assert_eq!(ack.result, MavResult::MAV_RESULT_ACCEPTED);
        assert_eq!(told.uri.to_str(), Ok("mftp://general.json"));
        assert_eq!(told.file_crc, Crc32::of(general.as_bytes()));
        assert_eq!(told.time_boot_ms, 2000);
        for other in [148.0, f32::NAN, 397.5] {
            let answers = published.handle(now, (OWN, STATION), &ask(other));
            assert_eq!(answers, None, "{other}");
        }
        assert_eq!(fetch(&mut server, "general.json"), general.into_bytes());
        let parameters = fetch(&mut server, "parameters.json");
        assert_eq!(parameters, b"{\"version\":1,\"parameters\":[]}");
        let stranger = Address::new(2, 1);
        let asked = ask(397.0);
        assert_eq!(published.handle(now, (stranger, STATION), &asked), None);
    }
}
