//! The names under which `rmw_zenoh` publishes, and by which its nodes find one another.
//!
//! ```text
//! messages     <domain>/<topic>/<type>/<hash>
//! a node       @ros2_lv/<domain>/<session>/<node>/<node>/NN/%/%/<node name>
//! a publisher  @ros2_lv/<domain>/<session>/<node>/<entity>/MP/%/%/<node name>/<topic>/<type>/<hash>/<quality>
//! ```
//!
//! The last two are liveliness tokens: what `ros2 topic list` shows is who holds one. In tokens each `/` of a name is a
//! `%`; `%/%` are the enclave and the namespace, which we have none of.
//!
//! - `rmw_zenoh`, *Design*, "Topic and Service name mapping", "Graph Cache"; `liveliness_utils.cpp`,
//!   `attachment_helpers.cpp` (Jazzy and later).

use maps::time::Stamp;
use xxhash_rust::xxh3::xxh3_128;

use super::type_hash::type_hash;
use super::{Qos, ZenohError};
use crate::ros::Schema;

/// What a token is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Entity {
    Node,
    Publisher,
    Subscription,
}

impl Entity {
    fn code(self) -> &'static str {
        match self {
            Self::Node => "NN",
            Self::Publisher => "MP",
            Self::Subscription => "MS",
        }
    }
}

/// A topic's name and type, as they stand in keys.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Topic {
    /// With its leading slash.
    name: String,
    /// As DDS has it: `sensor_msgs::msg::dds_::Image_`.
    kind: String,
    hash: String,
}

impl Topic {
    /// Looks at the name and hashes the type.
    pub(super) fn new(name: &str, schema: &Schema) -> Result<Self, ZenohError> {
        let parts = name.strip_prefix('/').map(|rest| rest.split('/'));
        if !parts.is_some_and(|mut parts| parts.all(is_name)) {
            return Err(ZenohError::Topic {
                topic: name.to_owned(),
            });
        }
        let hash = type_hash(schema).map_err(|reason| ZenohError::Schema {
            name: schema.name,
            reason,
        })?;
        let (package, kind) = schema.name.rsplit_once('/').unwrap_or(("", schema.name));
        Ok(Self {
            name: name.to_owned(),
            kind: format!("{}::dds_::{kind}_", package.replace('/', "::")),
            hash,
        })
    }

    /// Where its messages go.
    pub(super) fn key(&self, domain: u32) -> String {
        let Self { name, kind, hash } = self;
        format!("{domain}{name}/{kind}/{hash}")
    }
}

/// A part of a topic's name, or a node's.
pub(super) fn is_name(part: &str) -> bool {
    let mut bytes = part.bytes();
    let starts = (bytes.next()).is_some_and(|b| b.is_ascii_alphabetic() || b == b'_');
    starts && bytes.all(|b| b.is_ascii_alphanumeric() || b == b'_')
}

/// Our node in the graph.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Node {
    pub(super) domain: u32,
    /// The session's id.
    pub(super) session: String,
    pub(super) name: String,
}

impl Node {
    /// The token of the node itself.
    pub(super) fn token(&self) -> String {
        self.prefix(Entity::Node, 0)
    }

    /// The token of a publisher or subscription; no two of a session have the same `id`.
    pub(super) fn endpoint_token(
        &self,
        entity: Entity,
        id: u64,
        topic: &Topic,
        qos: Qos,
    ) -> String {
        let Topic { name, kind, hash } = topic;
        format!(
            "{}/{}/{kind}/{hash}/{}",
            self.prefix(entity, id),
            name.replace('/', "%"),
            quality(qos)
        )
    }

    fn prefix(&self, entity: Entity, id: u64) -> String {
        let Self {
            domain,
            session,
            name,
        } = self;
        // A session has one node, and its number is 0.
        format!(
            "@ros2_lv/{domain}/{session}/0/{id}/{}/%/%/{name}",
            entity.code()
        )
    }
}

/// What is not `rmw_zenoh`'s default: reliable, volatile, the last 42, forever.
fn quality(qos: Qos) -> String {
    let reliability = match qos.reliability {
        super::Reliability::Reliable => "",
        super::Reliability::BestEffort => "2",
    };
    let history = match qos.history {
        super::History::KeepLast(42) => ",".to_owned(),
        super::History::KeepLast(depth) => format!(",{depth}"),
        super::History::KeepAll => "2,".to_owned(),
    };
    format!("{reliability}::{history}:,:,:,,")
}

/// Which tokens the publishers of a topic hold, whatever its type.
pub(super) fn publishers_of(domain: u32, topic: &str) -> String {
    let topic = topic.replace('/', "%");
    format!("@ros2_lv/{domain}/*/*/*/MP/*/*/*/{topic}/*/*/*")
}

/// Who publishes on a topic, and what.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct PublisherInfo {
    /// The node's name.
    pub node: String,
    /// The type of its messages, as `sensor_msgs/msg/Image`.
    pub kind: String,
    /// The hash of the type's definition.
    pub hash: String,
}

impl PublisherInfo {
    /// Reads a publisher's token.
    pub(super) fn parse(token: &str) -> Option<Self> {
        let parts: Vec<&str> = token.split('/').collect();
        let [
            "@ros2_lv",
            _,
            _,
            _,
            _,
            "MP",
            _,
            _,
            node,
            _,
            kind,
            hash,
            _quality,
        ] = parts[..]
        else {
            return None;
        };
        let kind = kind.strip_suffix('_').unwrap_or(kind);
        Some(Self {
            node: node.to_owned(),
            kind: kind.replace("::dds_::", "::").replace("::", "/"),
            hash: hash.to_owned(),
        })
    }

    /// Whether it is published as this topic of ours.
    pub(super) fn is_of(&self, topic: &Topic) -> bool {
        self.hash == topic.hash
    }
}

/// What goes beside each message: 33 bytes, numbers little-endian, the publisher's id after its length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Attachment {
    /// Counts a publisher's messages from 1.
    pub(super) sequence: i64,
    /// When the message was made.
    pub(super) at: Stamp,
    pub(super) publisher: [u8; 16],
}

impl Attachment {
    pub(super) fn encode(&self) -> [u8; 33] {
        let mut bytes = [0; 33];
        bytes[..8].copy_from_slice(&self.sequence.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.at.as_nanos().cast_signed().to_le_bytes());
        bytes[16] = 16;
        bytes[17..].copy_from_slice(&self.publisher);
        bytes
    }

    /// `None` for what is not 33 bytes as above, or of before 1970.
    pub(super) fn decode(bytes: &[u8]) -> Option<Self> {
        let (sequence, rest) = bytes.split_first_chunk()?;
        let (at, rest) = rest.split_first_chunk()?;
        let (16, publisher) = rest.split_first()? else {
            return None;
        };
        let nanos = u64::try_from(i64::from_le_bytes(*at)).ok()?;
        Some(Self {
            sequence: i64::from_le_bytes(*sequence),
            at: Stamp::from_nanos(nanos),
            publisher: publisher.try_into().ok()?,
        })
    }
}

/// A publisher's id: its token's XXH3, the lower half first.
pub(super) fn publisher_id(token: &str) -> [u8; 16] {
    xxh3_128(token.as_bytes()).to_le_bytes()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::{History, Reliability};
    use super::*;

    const STRING: Schema = Schema {
        name: "std_msgs/msg/String",
        text: "string data",
    };

    /// The example of `rmw_zenoh`'s design document.
    const TALKER: &str = "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/\
                          std_msgs::msg::dds_::String_/\
                          RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18/::,7:,:,:,,";

    fn talker() -> Node {
        Node {
            domain: 2,
            session: "8b20917502ee955ac4476e0266340d5c".into(),
            name: "talker".into(),
        }
    }

    #[test]
    fn keys_and_tokens_are_those_of_the_design_document() {
        let topic = Topic::new("/robot1/chatter", &STRING).expect("sound");
        assert_eq!(
            topic.key(0),
            "0/robot1/chatter/std_msgs::msg::dds_::String_/\
             RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
        );
        let topic = Topic::new("/chatter", &STRING).expect("sound");
        let qos = Qos {
            reliability: Reliability::Reliable,
            history: History::KeepLast(7),
        };
        let token = talker().endpoint_token(Entity::Publisher, 10, &topic, qos);
        assert_eq!(token, TALKER);
        assert_eq!(
            talker().token(),
            "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/0/NN/%/%/talker"
        );
    }

    #[test]
    fn a_token_says_who_publishes_what() {
        let info = PublisherInfo::parse(TALKER).expect("a publisher");
        assert_eq!(
            (info.node.as_str(), info.kind.as_str()),
            ("talker", STRING.name)
        );
        assert!(info.is_of(&Topic::new("/chatter", &STRING).expect("sound")));
        assert_eq!(PublisherInfo::parse(&talker().token()), None, "a node");
    }

    #[track_caller]
    fn check_quality(reliability: Reliability, history: History, expected: &str) {
        let found = quality(Qos {
            reliability,
            history,
        });
        assert_eq!(found, expected);
    }

    #[test]
    fn only_what_differs_from_the_defaults_stands_in_a_token() {
        check_quality(Reliability::Reliable, History::KeepLast(42), "::,:,:,:,,");
        check_quality(
            Reliability::BestEffort,
            History::KeepLast(5),
            "2::,5:,:,:,,",
        );
        check_quality(Reliability::Reliable, History::KeepAll, "::2,:,:,:,,");
    }

    #[track_caller]
    fn check_refused(topic: &str) {
        let error = Topic::new(topic, &STRING).expect_err("no name").to_string();
        assert!(error.contains(&format!("`{topic}`")), "{error}");
    }

    #[test]
    fn names_that_ros_does_not_allow_are_refused() {
        for topic in [
            "", "/", "chatter", "/a//b", "/a/", "/*", "/a/**", "/1a", "/a b", "/a$", "/ä",
        ] {
            check_refused(topic);
        }
    }

    #[test]
    fn an_attachment_has_the_bytes_that_rmw_zenoh_writes() {
        let attachment = Attachment {
            sequence: 0x0102,
            at: Stamp::from_nanos(0x0304_0506),
            publisher: *b"0123456789abcdef",
        };
        let mut expected = vec![2, 1, 0, 0, 0, 0, 0, 0, 6, 5, 4, 3, 0, 0, 0, 0, 16];
        expected.extend(b"0123456789abcdef");
        assert_eq!(attachment.encode().as_slice(), expected);
        assert_eq!(Attachment::decode(&expected), Some(attachment));
        assert_eq!(Attachment::decode(&expected[..32]), None, "cut");
        expected[15] = 0x80;
        assert_eq!(Attachment::decode(&expected), None, "before 1970");
    }

    proptest! {
        #[test]
        fn any_bytes_are_an_attachment_or_none(bytes: Vec<u8>) {
            let _outcome = Attachment::decode(&bytes);
        }

        #[test]
        fn any_text_is_a_token_or_none(token: String) {
            let _outcome = PublisherInfo::parse(&token);
        }
    }
}
