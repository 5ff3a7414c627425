//! Where a link leads, as text.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use super::LinkError;
use crate::signing::Policy;
use crate::wire::SIGNATURE_BYTES;

/// Where a link leads, and whether its frames are signed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LinkUri {
    /// Where it leads.
    pub way: Way,
    /// `?signing=required&key=FILE`: frames are signed with the key in that file. `accepted`: unsigned ones are taken, too.
    pub signing: Option<LinkSigning>,
}

/// How the frames of a link are signed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LinkSigning {
    /// What is asked of frames that come.
    pub policy: Policy,
    /// File of the key, see [`crate::signing::KeyFile`].
    pub key: PathBuf,
}

/// Where a link leads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Way {
    /// `udpin:HOST:PORT`: listens there.
    UdpIn(String),
    /// `udpout:HOST:PORT`: sends there.
    UdpOut(String),
    /// `udpbcast:ADDRESS:PORT`: sends to a whole network until somebody answers.
    UdpBroadcast(String),
    /// `tcpin:HOST:PORT`: listens there.
    TcpIn(String),
    /// `tcpout:HOST:PORT`: connects there.
    TcpOut(String),
    /// `serial:DEVICE:BAUD`.
    Serial {
        /// `/dev/ttyUSB0`.
        device: String,
        /// Bits per second.
        baud: u32,
    },
}

impl LinkUri {
    /// `HOST:PORT`, as written; `None` of a serial port.
    pub fn host_and_port(&self) -> Option<&str> {
        match &self.way {
            Way::UdpIn(place)
            | Way::UdpOut(place)
            | Way::UdpBroadcast(place)
            | Way::TcpIn(place)
            | Way::TcpOut(place) => Some(place),
            Way::Serial { .. } => None,
        }
    }
}

impl LinkUri {
    /// By how much signing makes each frame longer.
    pub fn signature_bytes(&self) -> u64 {
        self.signing.as_ref().map_or(0, |_| SIGNATURE_BYTES as u64)
    }
}

impl FromStr for LinkUri {
    type Err = LinkError;

    fn from_str(uri: &str) -> Result<Self, LinkError> {
        parse(uri).ok_or_else(|| LinkError::Uri {
            uri: uri.to_owned(),
        })
    }
}

fn parse(uri: &str) -> Option<LinkUri> {
    let (way, signing) = match uri.split_once('?') {
        Some((way, query)) => (way, Some(parse_signing(query)?)),
        None => (uri, None),
    };
    let way = parse_way(way)?;
    Some(LinkUri { way, signing })
}

fn parse_signing(query: &str) -> Option<LinkSigning> {
    let (mut policy, mut key) = (None, None);
    for pair in query.split('&') {
        match pair.split_once('=')? {
            ("signing", "required") => policy = Some(Policy::Required),
            ("signing", "accepted") => policy = Some(Policy::Accepted),
            ("key", path) if !path.is_empty() => key = Some(PathBuf::from(path)),
            _ => return None,
        }
    }
    Some(LinkSigning {
        policy: policy?,
        key: key?,
    })
}

fn parse_way(uri: &str) -> Option<Way> {
    let (scheme, place) = uri.split_once(':')?;
    let (name, number) = place.rsplit_once(':')?;
    if name.is_empty() {
        return None;
    }
    if scheme == "serial" {
        let baud = number.parse().ok().filter(|baud| *baud > 0)?;
        let device = name.to_owned();
        return Some(Way::Serial { device, baud });
    }
    number.parse::<u16>().ok()?;
    let place = place.to_owned();
    match scheme {
        "udpin" => Some(Way::UdpIn(place)),
        "udpout" => Some(Way::UdpOut(place)),
        "udpbcast" => Some(Way::UdpBroadcast(place)),
        "tcpin" => Some(Way::TcpIn(place)),
        "tcpout" => Some(Way::TcpOut(place)),
        _ => None,
    }
}

impl fmt::Display for LinkUri {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.way {
            Way::UdpIn(place) => write!(f, "udpin:{place}"),
            Way::UdpOut(place) => write!(f, "udpout:{place}"),
            Way::UdpBroadcast(place) => write!(f, "udpbcast:{place}"),
            Way::TcpIn(place) => write!(f, "tcpin:{place}"),
            Way::TcpOut(place) => write!(f, "tcpout:{place}"),
            Way::Serial { device, baud } => write!(f, "serial:{device}:{baud}"),
        }?;
        let Some(signing) = &self.signing else {
            return Ok(());
        };
        let policy = match signing.policy {
            Policy::Required => "required",
            Policy::Accepted | Policy::Off => "accepted",
        };
        write!(f, "?signing={policy}&key={}", signing.key.display())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_are_read_as_they_are_written() {
        for uri in [
            "udpin:0.0.0.0:14550",
            "udpout:ground.local:14550",
            "udpbcast:192.168.1.255:14550",
            "tcpin:[::]:5760",
            "tcpout:127.0.0.1:5760",
            "serial:/dev/ttyUSB0:57600",
            "udpin:0.0.0.0:14550?signing=required&key=/etc/tandem/link.key",
            "serial:/dev/ttyUSB0:57600?signing=accepted&key=link.key",
        ] {
            let parsed: LinkUri = uri.parse().expect(uri);
            assert_eq!(parsed.to_string(), uri);
        }
    }

    #[test]
    fn what_is_no_link_is_refused_with_what_was_expected() {
        for uri in [
            "",
            "udpin",
            "udpin:host",
            "tcp:host:1",
            "udpin::1",
            "udpout:h:70000",
            "serial:/dev/ttyS0",
            "serial:/dev/ttyS0:0",
            "serial::57600",
            "udpin:h:1?",
            "udpin:h:1?signing=required",
            "udpin:h:1?key=link.key",
            "udpin:h:1?signing=off&key=link.key",
            "udpin:h:1?signing=required&key=",
            "udpin:h:1?signing=required&key=link.key&more=1",
        ] {
            let error = uri.parse::<LinkUri>().expect_err(uri);
            assert!(matches!(error, LinkError::Uri { .. }), "{error}");
        }
    }
}
