//! Live ROS 2 messages over Zenoh, as nodes with `rmw_zenoh` publish and read them.
//!
//! A [`Session`] is a node of the ROS 2 graph: `ros2 topic list` shows its [`Publisher`]s, `ros2 topic echo` prints what
//! they say, and its [`Subscriber`]s receive from any driver. [`ZenohSource`] makes frames of a camera's topics. The
//! messages are CDR as in files: what is recorded and what is sent are the same bytes.
//!
//! Like ROS 2 nodes a session is by default a peer of the router at `tcp/localhost:7447`, from which it learns of the
//! others, and it looks for nobody by multicast. In its place a session can be the router itself.
//!
//! This is `zenoh` itself and not `hiroz` 0.2: `hiroz` brings services, parameters, shared memory and a code generator, its
//! publishers are typed where ours have bytes, and its publishers' ids are not those of `rmw_zenoh`.
//! Zenoh's own threads are an async runtime; nothing of it is seen outside this module.
//!
//! - `rmw_zenoh`, *Design*, <https://github.com/ros2/rmw_zenoh/blob/rolling/docs/design.md>.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use ::zenoh::Wait as _;
use ::zenoh::liveliness::LivelinessToken;
use ::zenoh::qos::CongestionControl;
use ::zenoh::sample::Sample;
use maps::time::Stamp;

use crate::live::{Inbox, Received, Taken};
use crate::ros::Schema;

mod names;
mod pairs;
mod settings;
mod source;
mod type_hash;

pub use names::PublisherInfo;
pub use settings::{Mode, Settings};
pub use source::{Patience, ZenohSource};

use names::{Attachment, Entity, Node, Topic};

/// Why nothing can be sent or received.
#[derive(Debug, thiserror::Error)]
pub enum ZenohError {
    /// An endpoint that is none.
    #[error(
        "`{endpoint}` is no Zenoh endpoint: expected tcp/HOST:PORT, where a router is, or listen:tcp/HOST:PORT to be the router"
    )]
    Endpoint {
        /// As it was given.
        endpoint: String,
    },
    /// A node's name that ROS 2 does not allow.
    #[error("`{node}` is no name of a node: expected letters, digits and _, not a digit first")]
    Node {
        /// As it was given.
        node: String,
    },
    /// The session cannot be opened.
    #[error(
        "cannot open a Zenoh session at {endpoint}: is another program on this port, or nobody there?"
    )]
    Open {
        /// The settings' endpoints.
        endpoint: String,
        /// What Zenoh says.
        source: ::zenoh::Error,
    },
    /// A topic's name that ROS 2 does not allow.
    #[error("`{topic}` is no name of a topic: expected one such as /uav/camera/color/image_raw")]
    Topic {
        /// As it was given.
        topic: String,
    },
    /// A definition from which no hash can be made.
    #[error("the definition of {name} cannot be hashed: {reason}")]
    Schema {
        /// The message type.
        name: &'static str,
        /// What is not understood.
        reason: String,
    },
    /// A publisher, subscription or their token is refused.
    #[error("cannot announce {topic} over Zenoh")]
    Announce {
        /// The topic, or the node.
        topic: String,
        /// What Zenoh says.
        source: ::zenoh::Error,
    },
    /// A message that could not be sent.
    #[error("cannot publish on {topic}: is the session closed?")]
    Publish {
        /// The topic.
        topic: String,
        /// What Zenoh says.
        source: ::zenoh::Error,
    },
    /// The graph cannot be asked.
    #[error("cannot ask who publishes on {topic}")]
    Ask {
        /// The topic.
        topic: String,
        /// What Zenoh says.
        source: ::zenoh::Error,
    },
}

/// What ROS 2 calls quality of service, as far as it is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Qos {
    /// What is announced; over TCP nothing is lost on the way either way.
    pub reliability: Reliability,
    /// What happens to messages faster than the link.
    pub history: History,
}

/// Whether subscribers may count on every message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reliability {
    /// They may.
    Reliable,
    /// They may not.
    BestEffort,
}

/// How many messages are kept for a slow link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum History {
    /// The last ones: a full link drops messages. `rmw_zenoh` announces the number, the link has a buffer of its own.
    KeepLast(u32),
    /// All: a full link makes the publisher wait.
    KeepAll,
}

impl Qos {
    /// Of sensors: the newest matters most.
    pub const SENSOR: Self = Self {
        reliability: Reliability::BestEffort,
        history: History::KeepLast(5),
    };

    /// Of what must arrive whole: a full link makes the publisher wait.
    pub const EVERY_MESSAGE: Self = Self {
        reliability: Reliability::Reliable,
        history: History::KeepAll,
    };
}

/// No message is larger, and no queue holds more bytes: a few images of the largest camera.
const LARGEST_MESSAGE: usize = 256 << 20;

/// How long an answer about the graph may take; it comes from neighbours.
const ANSWER_WITHIN: Duration = Duration::from_secs(2);

/// A node of the ROS 2 graph. It leaves when it and all its publishers and subscribers are dropped.
pub struct Session {
    zenoh: ::zenoh::Session,
    node: Node,
    endpoint: String,
    mode: Mode,
    /// The id of the next publisher or subscriber; the node's own is 0.
    next_id: AtomicU64,
    _token: LivelinessToken,
}

impl Session {
    /// Opens a session. As in ROS 2 a peer whose router is not there yet goes on looking for it.
    pub fn open(settings: &Settings) -> Result<Self, ZenohError> {
        if !names::is_name(&settings.node) {
            return Err(ZenohError::Node {
                node: settings.node.clone(),
            });
        }
        let endpoint = settings.endpoint();
        let error = |source| ZenohError::Open {
            endpoint: endpoint.clone(),
            source,
        };
        let config = settings.config().map_err(error)?;
        let zenoh = ::zenoh::open(config).wait().map_err(error)?;
        let node = Node {
            domain: settings.domain,
            session: zenoh.zid().to_string(),
            name: settings.node.clone(),
        };
        let token = announce(&zenoh, &node.token(), &settings.node)?;
        Ok(Self {
            zenoh,
            node,
            endpoint,
            mode: settings.mode,
            next_id: AtomicU64::new(1),
            _token: token,
        })
    }

    /// Announces messages of this type on a topic such as `/uav/camera/color/image_raw`.
    pub fn publisher(
        &self,
        topic: &str,
        schema: &Schema,
        qos: Qos,
    ) -> Result<Publisher, ZenohError> {
        let named = Topic::new(topic, schema)?;
        let congestion = match qos.history {
            History::KeepLast(_) => CongestionControl::Drop,
            History::KeepAll => CongestionControl::Block,
        };
        let publisher = self
            .zenoh
            .declare_publisher(named.key(self.node.domain))
            .congestion_control(congestion)
            .wait()
            .map_err(|source| ZenohError::Announce {
                topic: topic.to_owned(),
                source,
            })?;
        let (token, held) = self.join(Entity::Publisher, &named, topic, qos)?;
        Ok(Publisher {
            topic: topic.to_owned(),
            id: names::publisher_id(&token),
            sent: 0,
            zenoh: publisher,
            _session: self.zenoh.clone(),
            _token: held,
        })
    }

    /// Receives messages of this type on a topic; the newest `depth` (at least one) wait to be taken.
    pub fn subscriber(
        &self,
        topic: &str,
        schema: &Schema,
        depth: usize,
    ) -> Result<Subscriber, ZenohError> {
        let inbox = Arc::new(Inbox::new(&[depth], LARGEST_MESSAGE));
        let subscription = self.subscribe(topic, schema, depth, (&inbox, 0))?;
        Ok(Subscriber {
            inbox,
            _subscription: subscription,
        })
    }

    /// Puts what comes on a topic into a queue of an inbox.
    fn subscribe(
        &self,
        topic: &str,
        schema: &Schema,
        depth: usize,
        (inbox, queue): (&Arc<Inbox>, usize),
    ) -> Result<Subscription, ZenohError> {
        let named = Topic::new(topic, schema)?;
        let into = Arc::clone(inbox);
        let subscriber = self
            .zenoh
            .declare_subscriber(named.key(self.node.domain))
            .callback(move |sample| receive(&sample, &into, queue))
            .wait()
            .map_err(|source| ZenohError::Announce {
                topic: topic.to_owned(),
                source,
            })?;
        let qos = Qos {
            history: History::KeepLast(u32::try_from(depth).unwrap_or(u32::MAX)),
            ..Qos::SENSOR
        };
        let (_token, held) = self.join(Entity::Subscription, &named, topic, qos)?;
        Ok(Subscription {
            _subscriber: subscriber,
            _session: self.zenoh.clone(),
            _token: held,
        })
    }

    /// Who publishes on a topic, whatever its type, as far as our neighbours know; in order of their names.
    pub fn publishers(&self, topic: &str) -> Result<Vec<PublisherInfo>, ZenohError> {
        let tokens = self
            .zenoh
            .liveliness()
            .get(names::publishers_of(self.node.domain, topic))
            .timeout(ANSWER_WITHIN)
            .wait()
            .map_err(|source| ZenohError::Ask {
                topic: topic.to_owned(),
                source,
            })?;
        let mut found = BTreeSet::new();
        // Ends when all have answered, or with the timeout.
        while let Ok(reply) = tokens.recv() {
            if let Ok(token) = reply.result() {
                found.extend(PublisherInfo::parse(token.key_expr().as_str()));
            }
        }
        Ok(found.into_iter().collect())
    }

    /// Whether there is a router or another peer at the other end; a router needs none.
    pub fn is_connected(&self) -> bool {
        let info = self.zenoh.info();
        self.mode == Mode::Router
            || info.routers_zid().wait().next().is_some()
            || info.peers_zid().wait().next().is_some()
    }

    /// Where it connects to or listens at, for messages to people.
    pub fn endpoint(&self) -> &str {
        &self.endpoint
    }

    /// Tells the graph of a publisher or subscription; its token's text, and the token.
    fn join(
        &self,
        entity: Entity,
        named: &Topic,
        topic: &str,
        qos: Qos,
    ) -> Result<(String, LivelinessToken), ZenohError> {
        let id = self.next_id.fetch_add(1, Ordering::Relaxed);
        let token = self.node.endpoint_token(entity, id, named, qos);
        let held = announce(&self.zenoh, &token, topic)?;
        Ok((token, held))
    }
}

fn announce(
    zenoh: &::zenoh::Session,
    token: &str,
    what: &str,
) -> Result<LivelinessToken, ZenohError> {
    let declared = zenoh.liveliness().declare_token(token.to_owned()).wait();
    declared.map_err(|source| ZenohError::Announce {
        topic: what.to_owned(),
        source,
    })
}

fn receive(sample: &Sample, inbox: &Inbox, queue: usize) {
    let attachment = sample.attachment().map(|bytes| bytes.to_bytes());
    let attachment = attachment.and_then(|bytes| Attachment::decode(&bytes));
    let (Some(Attachment { sequence, at, .. }), true) =
        (attachment, sample.payload().len() <= LARGEST_MESSAGE)
    else {
        // As `rmw_zenoh` does: without it nobody knows when the message was made.
        inbox.lose(|losses| losses.damaged += 1);
        return;
    };
    let bytes = sample.payload().to_bytes().into_owned();
    inbox.put(
        queue,
        Received {
            at,
            sequence,
            bytes,
        },
    );
}

/// Publishes messages of one type on one topic.
pub struct Publisher {
    topic: String,
    id: [u8; 16],
    sent: i64,
    zenoh: ::zenoh::pubsub::Publisher<'static>,
    _session: ::zenoh::Session,
    _token: LivelinessToken,
}

impl Publisher {
    /// Sends a message that was made at `at`: CDR with its header. Waits only with [`History::KeepAll`].
    pub fn publish(&mut self, at: Stamp, message: &[u8]) -> Result<(), ZenohError> {
        self.sent += 1;
        let attachment = Attachment {
            sequence: self.sent,
            at,
            publisher: self.id,
        };
        self.zenoh
            .put(message)
            .attachment(attachment.encode().as_slice())
            .wait()
            .map_err(|source| ZenohError::Publish {
                topic: self.topic.clone(),
                source,
            })
    }

    /// Whether anybody has subscribed, as far as is known.
    pub fn has_subscribers(&self) -> bool {
        let status = self.zenoh.matching_status().wait();
        status.is_ok_and(|status| status.matching())
    }
}

/// Holds a subscription as long as it lives.
struct Subscription {
    _subscriber: ::zenoh::pubsub::Subscriber<()>,
    _session: ::zenoh::Session,
    _token: LivelinessToken,
}

/// Receives messages of one type on one topic. A slow reader gets the newest ones.
pub struct Subscriber {
    inbox: Arc<Inbox>,
    _subscription: Subscription,
}

impl Subscriber {
    /// The next message; `None` if none comes in time.
    pub fn receive(&self, patience: Duration) -> Option<Received> {
        match self.inbox.take(|_queue| true, patience) {
            Taken::Message(_queue, message) => Some(message),
            Taken::Nothing | Taken::Stopped => None,
        }
    }

    /// How many messages were pushed out by newer ones before they were taken.
    pub fn overflowed(&self) -> u64 {
        self.inbox.losses().overflowed
    }

    /// How many messages came without what `rmw_zenoh` sends beside each; they are left out.
    pub fn damaged(&self) -> u64 {
        self.inbox.losses().damaged
    }
}
