//! Where the world's origin is on earth: configured, or asked of the autopilot until it answers.
//!
//! Once known it stays: the map is tied to it. A flight controller that has not initialised yet does not answer, so it
//! is asked again and again.

use std::time::Duration;

use geodesy::Geodetic;
use maps::time::Stamp;
use mavlink_ext::Message;
use mavlink_ext::convert::{deg_to_e7, e7_to_deg};
use mavlink_ext::dialect::tandem::TANDEM_ORIGIN_DATA;

/// How often the autopilot is asked.
const ASK_EVERY: Duration = Duration::from_secs(2);

/// Where the world's origin is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Origin {
    /// Known, from now on.
    Known(Geodetic),
    /// The autopilot is asked next at this time.
    Asking(Stamp),
}

impl Origin {
    /// As configured; if it is not, the autopilot is asked.
    pub fn new(configured: Option<Geodetic>) -> Self {
        configured.map_or(Self::Asking(Stamp::ZERO), Self::Known)
    }

    /// Where it is, if that is known.
    pub fn known(&self) -> Option<Geodetic> {
        match *self {
            Self::Known(origin) => Some(origin),
            Self::Asking(_) => None,
        }
    }

    /// Takes what the autopilot says; whether it made the origin known. Positions of all zero are what an autopilot
    /// says before it has one.
    pub fn hear(&mut self, message: &Message) -> bool {
        let (lat, lon, alt_mm) = match message {
            Message::GPS_GLOBAL_ORIGIN(m) => (m.latitude, m.longitude, m.altitude),
            Message::HOME_POSITION(m) => (m.latitude, m.longitude, m.altitude),
            _ => return false,
        };
        let heard = Geodetic {
            lat_deg: e7_to_deg(lat),
            lon_deg: e7_to_deg(lon),
            alt_m: f64::from(alt_mm) * 1e-3,
        };
        let on_earth = heard.lat_deg.abs() <= 90.0 && heard.lon_deg.abs() <= 180.0;
        let news = self.known().is_none() && on_earth && (lat, lon) != (0, 0);
        if news {
            *self = Self::Known(heard);
        }
        news
    }

    /// Whether to ask the autopilot now.
    pub fn ask(&mut self, now: Stamp) -> bool {
        match self {
            Self::Asking(due) if now >= *due => {
                *due = now + ASK_EVERY;
                true
            }
            Self::Asking(_) | Self::Known(_) => false,
        }
    }

    /// `TANDEM_ORIGIN`, once it is known.
    pub fn message(&self) -> Option<Message> {
        self.known().map(|origin| {
            Message::TANDEM_ORIGIN(TANDEM_ORIGIN_DATA {
                lat: deg_to_e7(origin.lat_deg),
                lon: deg_to_e7(origin.lon_deg),
                alt: (origin.alt_m * 1e3).round() as i32,
                epoch: 1,
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink_ext::dialect::tandem::{GPS_GLOBAL_ORIGIN_DATA, HOME_POSITION_DATA};

    fn home(lat: i32) -> Message {
        Message::HOME_POSITION(HOME_POSITION_DATA {
            latitude: lat,
            longitude: 80_000_000,
            altitude: 12_500,
            ..HOME_POSITION_DATA::default()
        })
    }

    #[test]
    fn the_first_answer_is_taken_and_kept() {
        let mut origin = Origin::new(None);
        let nothing = Message::GPS_GLOBAL_ORIGIN(GPS_GLOBAL_ORIGIN_DATA::default());
        assert!(!origin.hear(&nothing), "all zero is no position");
        assert!(!origin.hear(&home(1_000_000_000)), "not on earth");
        assert!(origin.hear(&home(470_000_000)));
        assert!(!origin.hear(&home(480_000_000)));
        let Some(Message::TANDEM_ORIGIN(message)) = origin.message() else {
            panic!("known by now");
        };
        assert_eq!(
            (message.lat, message.lon, message.alt),
            (470_000_000, 80_000_000, 12_500)
        );
    }

    #[test]
    fn the_autopilot_is_asked_every_two_seconds_until_it_answers() {
        let at = |ms: u64| Stamp::from_nanos(ms * 1_000_000);
        let mut origin = Origin::new(None);
        assert!(origin.ask(at(100)));
        assert!(!origin.ask(at(2_099)));
        assert!(origin.ask(at(2_100)));
        assert!(origin.hear(&home(470_000_000)));
        assert!(!origin.ask(at(60_000)));
    }

    #[test]
    fn a_configured_origin_is_never_asked_for() {
        let configured = Geodetic {
            lat_deg: 1.0,
            lon_deg: 2.0,
            alt_m: 3.0,
        };
        let mut origin = Origin::new(Some(configured));
        assert!(!origin.ask(Stamp::ZERO));
        assert!(!origin.hear(&home(470_000_000)));
        assert_eq!(origin.known(), Some(configured));
    }
}
