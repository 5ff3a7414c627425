//! Where a link leads, as text.

use std::fmt;
use std::str::FromStr;

use super::LinkError;

/// Where a link leads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LinkUri {
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
        match self {
            Self::UdpIn(place)
            | Self::UdpOut(place)
            | Self::UdpBroadcast(place)
            | Self::TcpIn(place)
            | Self::TcpOut(place) => Some(place),
            Self::Serial { .. } => None,
        }
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
    let (scheme, place) = uri.split_once(':')?;
    let (name, number) = place.rsplit_once(':')?;
    if name.is_empty() {
        return None;
    }
    if scheme == "serial" {
        let baud = number.parse().ok().filter(|baud| *baud > 0)?;
        let device = name.to_owned();
        return Some(LinkUri::Serial { device, baud });
    }
    number.parse::<u16>().ok()?;
    let place = place.to_owned();
    match scheme {
        "udpin" => Some(LinkUri::UdpIn(place)),
        "udpout" => Some(LinkUri::UdpOut(place)),
        "udpbcast" => Some(LinkUri::UdpBroadcast(place)),
        "tcpin" => Some(LinkUri::TcpIn(place)),
        "tcpout" => Some(LinkUri::TcpOut(place)),
        _ => None,
    }
}

impl fmt::Display for LinkUri {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UdpIn(place) => write!(f, "udpin:{place}"),
            Self::UdpOut(place) => write!(f, "udpout:{place}"),
            Self::UdpBroadcast(place) => write!(f, "udpbcast:{place}"),
            Self::TcpIn(place) => write!(f, "tcpin:{place}"),
            Self::TcpOut(place) => write!(f, "tcpout:{place}"),
            Self::Serial { device, baud } => write!(f, "serial:{device}:{baud}"),
        }
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
        ] {
            let error = uri.parse::<LinkUri>().expect_err(uri);
            assert!(matches!(error, LinkError::Uri { .. }), "{error}");
        }
    }
}
