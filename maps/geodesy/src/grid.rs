//! Places as people write them on maps: UTM and MGRS, and towards the poles UPS.
//!
//! ```
//! use geodesy::grid::{Mgrs, Square, Utm};
//! use geodesy::Geodetic;
//!
//! let zurich = Geodetic { lat_deg: 47.3977, lon_deg: 8.5456, alt_m: 488.0 };
//! assert_eq!(Utm::of(zurich)?.to_string(), "32n 465711.18 5249460.69");
//! assert_eq!(Mgrs::of(zurich, Square::M1)?.to_string(), "32TMT6571149460");
//! let square: Mgrs = "32TMT6549".parse()?;
//! assert_eq!(square.edge_m(), 1000.0);
//! # Ok::<(), geodesy::grid::GridError>(())
//! ```

use std::fmt;
use std::str::FromStr;

use crate::Geodetic;
use crate::bridge::ffi;

/// Why a place has no grid coordinates, or a text is none.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GridError {
    /// NaN, or beyond a pole or more than once around.
    #[error("latitude {lat_deg}, longitude {lon_deg} is no place")]
    NotAPlace {
        /// As given.
        lat_deg: f64,
        /// As given.
        lon_deg: f64,
    },
    /// Not zone, easting and northing.
    #[error("{0:?} is not as \"32n 465711 5249461\": zone and n or s, easting, northing")]
    NotUtm(String),
    /// Such a zone has no such coordinates.
    #[error("{utm} is outside of its zone: {reason}")]
    OutsideZone {
        /// As given.
        utm: Utm,
        /// What `GeographicLib` says.
        reason: String,
    },
    /// Not a square of the military grid.
    #[error("{text:?} is no MGRS square: {reason}")]
    NotMgrs {
        /// As given.
        text: String,
        /// What `GeographicLib` says.
        reason: String,
    },
}

/// Which half of the earth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hemisphere {
    /// Northings count from the equator.
    North,
    /// Northings count from 10 000 km south of the equator.
    South,
}

/// Universal transverse Mercator coordinates; near the poles polar stereographic ones. WGS-84.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Utm {
    /// 1 to 60; 0 near the poles.
    pub zone: u8,
    /// Which half of the earth.
    pub hemisphere: Hemisphere,
    /// Towards grid east.
    pub easting_m: f64,
    /// Towards grid north.
    pub northing_m: f64,
}

impl Utm {
    /// The coordinates of a place, in its standard zone. Its height plays no part.
    pub fn of(place: Geodetic) -> Result<Self, GridError> {
        check_place(place)?;
        let [zone, north, easting_m, northing_m] = ffi::utm_forward(place.lat_deg, place.lon_deg)
            .map_err(|_whole_earth| no_place(place))?;
        Ok(Self {
            zone: zone as u8,
            hemisphere: if north > 0.0 {
                Hemisphere::North
            } else {
                Hemisphere::South
            },
            easting_m,
            northing_m,
        })
    }

    /// The place with these coordinates and a height, to nanometres.
    pub fn to_geodetic(self, alt_m: f64) -> Result<Geodetic, GridError> {
        let north = self.hemisphere == Hemisphere::North;
        let outside = |reason: &str| GridError::OutsideZone {
            utm: self,
            reason: reason.to_owned(),
        };
        if !(self.easting_m.is_finite() && self.northing_m.is_finite()) {
            return Err(outside("coordinates must be numbers"));
        }
        let place = ffi::utm_reverse(self.zone, north, self.easting_m, self.northing_m);
        let [lat_deg, lon_deg] = place.map_err(|e| outside(e.what()))?;
        Ok(Geodetic {
            lat_deg,
            lon_deg,
            alt_m,
        })
    }
}

/// `32n 465711.18 5249460.69`: to centimetres, as `GeoConvert -u -p 2` prints it; the zone is left out near the poles.
impl fmt::Display for Utm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.zone > 0 {
            write!(f, "{:02}", self.zone)?;
        }
        let half = match self.hemisphere {
            Hemisphere::North => 'n',
            Hemisphere::South => 's',
        };
        write!(f, "{half} {:.2} {:.2}", self.easting_m, self.northing_m)
    }
}

/// Zone and `n` or `s` (no latitude band), easting and northing, with spaces between.
impl FromStr for Utm {
    type Err = GridError;

    fn from_str(text: &str) -> Result<Self, GridError> {
        let error = || GridError::NotUtm(text.to_owned());
        let mut parts = text.split_whitespace();
        let mut next = || parts.next().ok_or_else(error);
        let (zone, easting, northing) = (next()?, next()?, next()?);
        if parts.next().is_some() {
            return Err(error());
        }
        let (number, hemisphere) = match zone.strip_suffix('n') {
            Some(number) => (number, Hemisphere::North),
            None => (zone.strip_suffix('s').ok_or_else(error)?, Hemisphere::South),
        };
        let is_number = !number.is_empty() && number.bytes().all(|b| b.is_ascii_digit());
        let zone = match number {
            "" => 0,
            number if is_number => number.parse().map_err(|_too_large| error())?,
            _ => return Err(error()),
        };
        if zone > 60 || (zone == 0 && !number.is_empty()) {
            return Err(error());
        }
        let metres = |text: &str| text.parse().ok().filter(|m: &f64| m.is_finite());
        let utm = Self {
            zone,
            hemisphere,
            easting_m: metres(easting).ok_or_else(error)?,
            northing_m: metres(northing).ok_or_else(error)?,
        };
        utm.to_geodetic(0.0).map(|_place| utm)
    }
}

/// How large a square of the military grid is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Square {
    /// 100 km.
    Km100,
    /// 10 km.
    Km10,
    /// 1 km.
    Km1,
    /// 100 m.
    M100,
    /// 10 m.
    M10,
    /// 1 m.
    M1,
}

impl Square {
    /// Digits of each of easting and northing.
    fn digits(self) -> i32 {
        match self {
            Self::Km100 => 0,
            Self::Km10 => 1,
            Self::Km1 => 2,
            Self::M100 => 3,
            Self::M10 => 4,
            Self::M1 => 5,
        }
    }
}

/// A square of the military grid reference system.
#[derive(Clone, Debug, PartialEq)]
pub struct Mgrs {
    text: String,
    digits: i32,
    middle: [f64; 2],
}

impl Mgrs {
    /// The square in which a place is. Its height plays no part.
    pub fn of(place: Geodetic, square: Square) -> Result<Self, GridError> {
        check_place(place)?;
        ffi::mgrs_forward(place.lat_deg, place.lon_deg, square.digits())
            .map_err(|_whole_earth| no_place(place))?
            .parse()
    }

    /// The middle of the square, at a height.
    pub fn to_geodetic(&self, alt_m: f64) -> Geodetic {
        let [lat_deg, lon_deg] = self.middle;
        Geodetic {
            lat_deg,
            lon_deg,
            alt_m,
        }
    }

    /// The edge of the square.
    pub fn edge_m(&self) -> f64 {
        10.0_f64.powi(5 - self.digits)
    }
}

/// `32TMT6571149460`, without spaces.
impl fmt::Display for Mgrs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// Zone, band, square and digits, in any case and with any spaces.
impl FromStr for Mgrs {
    type Err = GridError;

    fn from_str(text: &str) -> Result<Self, GridError> {
        let error = |reason: &str| GridError::NotMgrs {
            text: text.to_owned(),
            reason: reason.to_owned(),
        };
        let dense: String = text.split_whitespace().collect::<String>().to_uppercase();
        let [lat_deg, lon_deg, digits] = ffi::mgrs_reverse(&dense).map_err(|e| error(e.what()))?;
        // A zone and a band alone are read too, and "INVALID" as NaN.
        if !(lat_deg.is_finite() && lon_deg.is_finite() && digits >= 0.0) {
            return Err(error("the letters of the 100 km square are missing"));
        }
        Ok(Self {
            text: dense,
            digits: digits as i32,
            middle: [lat_deg, lon_deg],
        })
    }
}

fn check_place(place: Geodetic) -> Result<(), GridError> {
    let is_place =
        (-90.0..=90.0).contains(&place.lat_deg) && (-180.0..=180.0).contains(&place.lon_deg);
    is_place.then_some(()).ok_or_else(|| no_place(place))
}

fn no_place(
    Geodetic {
        lat_deg, lon_deg, ..
    }: Geodetic,
) -> GridError {
    GridError::NotAPlace { lat_deg, lon_deg }
}

#[cfg(test)]
mod tests;
