//! Where the world's origin is on earth: configured, or asked of the autopilot until it answers.
//!
//! Once known it stays: the map is tied to it. A flight controller that has not initialised yet does not answer, so it
//! is asked again and again.

use std::time::Duration;

use geodesy::Geodetic;
use maps::time::Stamp;
use mavlink_ext::Message;
use mavlink_ext::convert::{deg_to_e7, e7_to_deg};
use mavlink_ext::dialect::MessageData as _;
use mavlink_ext::dialect::tandem::{GPS_RAW_INT_DATA, HOME_POSITION_DATA, TANDEM_ORIGIN_DATA};

/// How often the autopilot is asked.
const ASK_EVERY: Duration = Duration::from_secs(2);
/// How often it is asked for the height of the ellipsoid before it is taken to have none.
const ASKS_FOR_GEOID: u8 = 3;

/// Where the world's origin is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Origin {
    /// Known, from now on.
    Known(Geodetic),
    /// The autopilot has not said all of it yet.
    Asking(Search),
}

/// What is known so far of an origin that the autopilot is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Search {
    /// When to ask next.
    due: Stamp,
    /// Its home, with a height above mean sea level.
    home: Option<Geodetic>,
    /// Height of mean sea level above the ellipsoid there, from its satellite receiver.
    geoid_height_m: Option<f64>,
    /// How often that was asked for.
    geoid_asks: u8,
}

/// What to do while the origin is not known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wish {
    /// Ask the autopilot for the message with this id.
    Message(u32),
    /// Tell the operator: the origin is known now, but the autopilot does not say how high sea level is above the ellipsoid.
    HeightIsAboveSeaLevel,
}

impl Origin {
    /// As configured; if it is not, the autopilot is asked.
    pub fn new(configured: Option<Geodetic>) -> Self {
        configured.map_or(
            Self::Asking(Search {
                due: Stamp::ZERO,
                home: None,
                geoid_height_m: None,
                geoid_asks: 0,
            }),
            Self::Known,
        )
    }

    /// Where it is, if that is known.
    pub fn known(&self) -> Option<Geodetic> {
        match *self {
            Self::Known(origin) => Some(origin),
            Self::Asking(_) => None,
        }
    }

    /// Takes what the autopilot says; whether it made the origin known.
    ///
    /// Its home and its own origin have heights above mean sea level, ours is above the ellipsoid: the difference comes with
    /// the raw fix of its satellite receiver (`GPS_RAW_INT.alt_ellipsoid`).
    pub fn hear(&mut self, message: &Message) -> bool {
        let Self::Asking(search) = self else {
            return false;
        };
        match message {
            Message::GPS_GLOBAL_ORIGIN(m) => search.hear_home(m.latitude, m.longitude, m.altitude),
            Message::HOME_POSITION(m) => search.hear_home(m.latitude, m.longitude, m.altitude),
            // 0 is what a receiver without an ellipsoid sends.
            Message::GPS_RAW_INT(m) if m.alt_ellipsoid != 0 => {
                let above_m = (f64::from(m.alt_ellipsoid) - f64::from(m.alt)) * 1e-3;
                // Sea level is nowhere further from the ellipsoid: this is a receiver that has no fix.
                search.geoid_height_m = (above_m.abs() < 150.0).then_some(above_m);
            }
            _ => return false,
        }
        let (Some(home), Some(geoid_height_m)) = (search.home, search.geoid_height_m) else {
            return false;
        };
        *self = Self::Known(Geodetic {
            alt_m: home.alt_m + geoid_height_m,
            ..home
        });
        true
    }

    /// What to do about it now.
    pub fn tick(&mut self, now: Stamp) -> Option<Wish> {
        let Self::Asking(search) = self else {
            return None;
        };
        if now < search.due {
            return None;
        }
        search.due = now + ASK_EVERY;
        let Some(home) = search.home else {
            return Some(Wish::Message(HOME_POSITION_DATA::ID));
        };
        if search.geoid_asks < ASKS_FOR_GEOID {
            search.geoid_asks += 1;
            return Some(Wish::Message(GPS_RAW_INT_DATA::ID));
        }
        *self = Self::Known(home);
        Some(Wish::HeightIsAboveSeaLevel)
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

impl Search {
    /// Positions of all zero are what an autopilot says before it has one.
    fn hear_home(&mut self, lat: i32, lon: i32, alt_mm: i32) {
        let heard = Geodetic {
            lat_deg: e7_to_deg(lat),
            lon_deg: e7_to_deg(lon),
            alt_m: f64::from(alt_mm) * 1e-3,
        };
        let on_earth = heard.lat_deg.abs() <= 90.0 && heard.lon_deg.abs() <= 180.0;
        if self.home.is_none() && on_earth && (lat, lon) != (0, 0) {
            self.home = Some(heard);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink_ext::dialect::tandem::GPS_GLOBAL_ORIGIN_DATA;

    fn home(lat: i32) -> Message {
        Message::HOME_POSITION(HOME_POSITION_DATA {
            latitude: lat,
            longitude: 80_000_000,
            altitude: 12_500,
            ..HOME_POSITION_DATA::default()
        })
    }

    fn fix(alt: i32, alt_ellipsoid: i32) -> Message {
        Message::GPS_RAW_INT(GPS_RAW_INT_DATA {
            alt,
            alt_ellipsoid,
            ..GPS_RAW_INT_DATA::default()
        })
    }

    fn at(ms: u64) -> Stamp {
        Stamp::from_nanos(ms * 1_000_000)
    }

    #[test]
    fn the_first_home_is_taken_with_its_height_above_the_ellipsoid_and_kept() {
        let mut origin = Origin::new(None);
        let nothing = Message::GPS_GLOBAL_ORIGIN(GPS_GLOBAL_ORIGIN_DATA::default());
        assert!(!origin.hear(&nothing), "all zero is no position");
        assert!(!origin.hear(&home(1_000_000_000)), "not on earth");
        assert!(!origin.hear(&home(470_000_000)), "above sea level only");
        assert!(!origin.hear(&fix(13_000, 0)), "no ellipsoid");
        assert!(!origin.hear(&fix(0, 480_000)), "no fix");
        assert!(origin.hear(&fix(13_000, 60_000)));
        assert!(!origin.hear(&home(480_000_000)));
        let Some(Message::TANDEM_ORIGIN(message)) = origin.message() else {
            panic!("known by now");
        };
        assert_eq!(
            (message.lat, message.lon, message.alt),
            (470_000_000, 80_000_000, 59_500)
        );
    }

    #[test]
    fn the_autopilot_is_asked_every_two_seconds_until_it_answers() {
        let mut origin = Origin::new(None);
        let for_home = Some(Wish::Message(HOME_POSITION_DATA::ID));
        assert_eq!(origin.tick(at(100)), for_home);
        assert_eq!(origin.tick(at(2_099)), None);
        assert_eq!(origin.tick(at(2_100)), for_home);
        assert!(!origin.hear(&home(470_000_000)));
        let for_fix = Some(Wish::Message(GPS_RAW_INT_DATA::ID));
        assert_eq!(origin.tick(at(4_100)), for_fix);
        assert!(origin.hear(&fix(13_000, 60_000)));
        assert_eq!(origin.tick(at(60_000)), None);
    }

    #[test]
    fn a_receiver_without_an_ellipsoid_leaves_the_height_above_sea_level_and_that_is_told() {
        let mut origin = Origin::new(None);
        origin.hear(&home(470_000_000));
        for ask in 0..3 {
            let wish = origin.tick(at(2_000 * ask));
            assert_eq!(wish, Some(Wish::Message(GPS_RAW_INT_DATA::ID)), "{ask}");
        }
        assert_eq!(origin.tick(at(6_000)), Some(Wish::HeightIsAboveSeaLevel));
        assert_eq!(origin.known().map(|origin| origin.alt_m), Some(12.5));
        assert_eq!(origin.tick(at(60_000)), None);
    }

    #[test]
    fn a_configured_origin_is_never_asked_for() {
        let configured = Geodetic {
            lat_deg: 1.0,
            lon_deg: 2.0,
            alt_m: 3.0,
        };
        let mut origin = Origin::new(Some(configured));
        assert_eq!(origin.tick(Stamp::ZERO), None);
        assert!(!origin.hear(&home(470_000_000)));
        assert_eq!(origin.known(), Some(configured));
    }
}
