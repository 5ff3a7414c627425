//! Where a session is, and who it says it is.

use ::zenoh::Config;

use super::{LARGEST_MESSAGE, ZenohError};

/// Where a session is, and who it says it is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Its part in the network.
    pub mode: Mode,
    /// Endpoints `tcp/HOST:PORT` to connect to.
    pub connect: Vec<String>,
    /// Endpoints `tcp/HOST:PORT` to listen at; port 0 takes a free one.
    pub listen: Vec<String>,
    /// `ROS_DOMAIN_ID`: nodes of other domains are not seen.
    pub domain: u32,
    /// The node's name, as `ros2 node list` shows it.
    pub node: String,
}

/// A session's part in the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// As ROS 2 nodes are: learns of others from the router and connects to them.
    Peer,
    /// Sends and receives through the router only; cannot be opened where there is none.
    Client,
    /// Is what others connect to: in the place of `rmw_zenohd`.
    Router,
}

impl Mode {
    fn name(self) -> &'static str {
        match self {
            Self::Peer => "peer",
            Self::Client => "client",
            Self::Router => "router",
        }
    }
}

/// As ROS 2 nodes are without settings of their own.
impl Default for Settings {
    fn default() -> Self {
        Self {
            mode: Mode::Peer,
            connect: vec!["tcp/localhost:7447".into()],
            // Others on this machine connect here; those on other machines go through the router.
            listen: vec!["tcp/localhost:0".into()],
            domain: 0,
            node: "tandem".into(),
        }
    }
}

impl Settings {
    /// `tcp/HOST:PORT`: as a ROS 2 node whose router is there. `listen:tcp/HOST:PORT`: as the router itself.
    pub fn at(endpoint: &str) -> Result<Self, ZenohError> {
        let (address, is_router) = match endpoint.strip_prefix("listen:") {
            Some(address) => (address, true),
            None => (endpoint, false),
        };
        if !is_endpoint(address) {
            return Err(ZenohError::Endpoint {
                endpoint: endpoint.to_owned(),
            });
        }
        let address = vec![address.to_owned()];
        Ok(if is_router {
            Self {
                mode: Mode::Router,
                connect: Vec::new(),
                listen: address,
                ..Self::default()
            }
        } else {
            Self {
                connect: address,
                ..Self::default()
            }
        })
    }

    /// The endpoints, for messages to people.
    pub(super) fn endpoint(&self) -> String {
        let endpoints = match self.mode {
            Mode::Router => &self.listen,
            Mode::Peer | Mode::Client => &self.connect,
        };
        endpoints.join(", ")
    }

    /// What Zenoh makes of it.
    pub(super) fn config(&self) -> Result<Config, ::zenoh::Error> {
        let quoted = |endpoints: &[String]| format!("{endpoints:?}");
        let mut config = Config::default();
        for (key, value) in [
            ("mode", format!("{:?}", self.mode.name())),
            ("connect/endpoints", quoted(&self.connect)),
            ("listen/endpoints", quoted(&self.listen)),
            ("scouting/multicast/enabled", "false".to_owned()),
            // As in `rmw_zenoh`, for those who keep the last message for late subscribers.
            ("timestamping/enabled", "true".to_owned()),
            (
                "transport/link/rx/max_message_size",
                LARGEST_MESSAGE.to_string(),
            ),
        ] {
            config.insert_json5(key, &value)?;
        }
        Ok(config)
    }
}

/// `tcp/HOST:PORT`. Only TCP is built in, as in `rmw_zenoh`'s own settings.
fn is_endpoint(text: &str) -> bool {
    let address = text.strip_prefix("tcp/").and_then(|a| a.rsplit_once(':'));
    address.is_some_and(|(host, port)| {
        let is_plain = |b: u8| b.is_ascii_alphanumeric() || b"-._:[]%".contains(&b);
        !host.is_empty() && host.bytes().all(is_plain) && port.parse::<u16>().is_ok_and(|p| p > 0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_endpoint_is_a_router_to_connect_to_or_to_be() {
        let peer = Settings::at("tcp/10.0.0.7:7447").expect("sound");
        assert_eq!(peer.mode, Mode::Peer);
        assert_eq!(peer.connect, ["tcp/10.0.0.7:7447"]);
        assert_eq!(peer.listen, ["tcp/localhost:0"]);
        let router = Settings::at("listen:tcp/[::]:7447").expect("sound");
        assert_eq!(router.mode, Mode::Router);
        assert_eq!(router.listen, ["tcp/[::]:7447"]);
        assert!(router.connect.is_empty());
    }

    #[test]
    fn what_is_no_endpoint_is_refused_with_what_is() {
        for endpoint in [
            "",
            "tcp/",
            "tcp/host",
            "tcp/:7447",
            "tcp/host:0",
            "tcp/host:70000",
            "udp/host:7447",
            "host:7447",
            "listen:host:7447",
            "tcp/a\"b:7447",
            "tcp/a#b:7447",
        ] {
            let error = Settings::at(endpoint).expect_err("none").to_string();
            assert!(error.contains(&format!("`{endpoint}`")), "{error}");
            assert!(error.contains("tcp/HOST:PORT"), "{error}");
        }
    }

    #[test]
    fn zenoh_takes_every_setting() {
        for endpoint in ["tcp/localhost:7447", "listen:tcp/0.0.0.0:7447"] {
            let settings = Settings::at(endpoint).expect("sound");
            assert!(settings.config().is_ok(), "{endpoint}");
        }
    }
}
