//! WGS-84 to local east-north-up and back, through Debian's `GeographicLib`.
//!
//! The world of a mission is the plane that touches the ellipsoid below its [`Origin`]: x east, y north, z up from the
//! origin's height. It is no map projection: a place 1 km away is 0.08 m below the plane, one 10 km away 7.8 m.
//!
//! Heights are above the ellipsoid; autopilots report height above mean sea level, which differs by up to 100 m:
//! [`geoid`] tells by how much. [`grid`] writes places as UTM and MGRS, and reads them.
//!
//! ```
//! use geodesy::{Geodetic, Origin};
//!
//! let origin = Origin::new(47.3977, 8.5456, 488.0)?;
//! let p = origin.to_world(Geodetic { lat_deg: 47.3986, lon_deg: 8.5456, alt_m: 488.0 });
//! assert!((p.raw.y - 100.0).abs() < 0.1, "a thousandth of a degree of latitude is 111 m");
//! # Ok::<(), geodesy::OriginError>(())
//! ```
//!
//! - C. F. F. Karney, *Geodesics on an ellipsoid of revolution*, 2011, and `GeographicLib::LocalCartesian` for the inverse,
//!   accurate to nanometres within thousands of kilometres.

#[expect(
    unsafe_code,
    unreachable_pub,
    reason = "cxx generates both for the C++ side"
)]
mod bridge;
pub mod geoid;
pub mod grid;

use maps::frame::{Point, World};

/// A place on or above the earth, WGS-84.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geodetic {
    /// Latitude, north positive, within 90 degrees of the equator.
    pub lat_deg: f64,
    /// Longitude, east positive, -180 to 180.
    pub lon_deg: f64,
    /// Height above the ellipsoid.
    pub alt_m: f64,
}

/// Why a place cannot be the origin of a world.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum OriginError {
    /// NaN, or beyond a pole.
    #[error("latitude {0} is not within -90 to 90 degrees")]
    Latitude(f64),
    /// NaN, or more than once around.
    #[error("longitude {0} is not within -180 to 180 degrees")]
    Longitude(f64),
    /// NaN, or nowhere near the earth.
    #[error("height {0} m is not within -10 km to 100 km")]
    Height(f64),
}

/// Where the local world touches the earth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Origin(Geodetic);

impl Origin {
    /// The world whose origin is this place; refused unless it is one.
    pub fn new(lat_deg: f64, lon_deg: f64, alt_m: f64) -> Result<Self, OriginError> {
        if !(-90.0..=90.0).contains(&lat_deg) {
            return Err(OriginError::Latitude(lat_deg));
        }
        if !(-180.0..=180.0).contains(&lon_deg) {
            return Err(OriginError::Longitude(lon_deg));
        }
        if !(-10_000.0..=100_000.0).contains(&alt_m) {
            return Err(OriginError::Height(alt_m));
        }
        Ok(Self(Geodetic {
            lat_deg,
            lon_deg,
            alt_m,
        }))
    }

    /// The place itself.
    pub fn geodetic(self) -> Geodetic {
        self.0
    }

    /// A place in the world. NaN stays NaN, as does a latitude beyond a pole.
    pub fn to_world(self, place: Geodetic) -> Point<World> {
        let [x, y, z] = bridge::ffi::forward(&self.0.into(), &place.into());
        Point::new(x, y, z)
    }

    /// The place of a point in the world. NaN stays NaN.
    pub fn to_geodetic(self, p: Point<World>) -> Geodetic {
        let [lat_deg, lon_deg, alt_m] = bridge::ffi::reverse(&self.0.into(), &p.raw.coords.into());
        Geodetic {
            lat_deg,
            lon_deg,
            alt_m,
        }
    }
}

impl From<Geodetic> for [f64; 3] {
    fn from(place: Geodetic) -> Self {
        [place.lat_deg, place.lon_deg, place.alt_m]
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_point_comes_back_from_the_globe_to_a_micrometre(
            lat_deg in -90.0..90.0, lon_deg in -180.0..180.0, alt_m in -100.0..5000.0,
            p in prop::array::uniform3(-20_000.0..20_000.0)
        ) {
            let origin = Origin::new(lat_deg, lon_deg, alt_m).expect("a place");
            let p = Point::new(p[0], p[1], p[2]);
            let back = origin.to_world(origin.to_geodetic(p));
            prop_assert!((back - p).norm() < 1e-6, "{} m off", (back - p).norm());
        }

        #[test]
        fn the_local_world_agrees_with_the_textbook(
            lat_deg in -89.0..89.0, lon_deg in -180.0..180.0, near in prop::array::uniform2(-0.2..0.2), alt_m in 0.0..500.0
        ) {
            let origin = Origin::new(lat_deg, lon_deg, 100.0).expect("a place");
            let place = Geodetic { lat_deg: lat_deg + near[0], lon_deg: lon_deg + near[1], alt_m };
            let expected = textbook(origin.geodetic(), place);
            let off = (origin.to_world(place) - expected).norm();
            prop_assert!(off < 1e-6, "{off} m off");
        }
    }

    /// Geodetic to geocentric and turned: B. Hofmann-Wellenhof et al., *GNSS*, 2008, Eq. (8.4) and (8.8).
    fn textbook(origin: Geodetic, place: Geodetic) -> Point<World> {
        let geocentric = |g: Geodetic| {
            let (a, f) = (6_378_137.0, 1.0 / 298.257_223_563);
            let e2 = f * (2.0 - f);
            let (lat, lon) = (g.lat_deg.to_radians(), g.lon_deg.to_radians());
            let n = a / (1.0 - e2 * lat.sin().powi(2)).sqrt();
            [
                (n + g.alt_m) * lat.cos() * lon.cos(),
                (n + g.alt_m) * lat.cos() * lon.sin(),
                (n * (1.0 - e2) + g.alt_m) * lat.sin(),
            ]
        };
        let (from, to) = (geocentric(origin), geocentric(place));
        let [dx, dy, dz] = [0, 1, 2].map(|i| to[i] - from[i]);
        let (lat, lon) = (origin.lat_deg.to_radians(), origin.lon_deg.to_radians());
        let outwards = lon.cos() * dx + lon.sin() * dy;
        Point::new(
            lon.cos() * dy - lon.sin() * dx,
            lat.cos() * dz - lat.sin() * outwards,
            lat.sin() * dz + lat.cos() * outwards,
        )
    }

    #[test]
    fn a_place_is_where_the_manual_of_geographiclib_puts_it() {
        // CartConvert(1): `echo 33.3 44.4 6000 | CartConvert -l 33 44 20` prints 37288.97 33374.29 5783.64.
        let origin = Origin::new(33.0, 44.0, 20.0).expect("a place");
        let place = Geodetic {
            lat_deg: 33.3,
            lon_deg: 44.4,
            alt_m: 6000.0,
        };
        let printed = Point::new(37_288.97, 33_374.29, 5_783.64);
        let off = (origin.to_world(place) - printed).raw.abs().max();
        assert!(off < 0.01, "{off} m off, the manual cuts to centimetres");
    }

    #[test]
    fn what_is_no_place_is_no_origin() {
        let refused = |lat, lon, alt| Origin::new(lat, lon, alt).map_err(|e| e.to_string());
        assert_eq!(
            refused(90.1, 0.0, 0.0),
            Err("latitude 90.1 is not within -90 to 90 degrees".to_owned())
        );
        assert_eq!(
            refused(0.0, -180.5, 0.0),
            Err("longitude -180.5 is not within -180 to 180 degrees".to_owned())
        );
        assert_eq!(
            refused(0.0, 0.0, 1e6),
            Err("height 1000000 m is not within -10 km to 100 km".to_owned())
        );
        assert!(refused(f64::NAN, 0.0, 0.0).is_err());
        assert!(refused(90.0, 180.0, -10.0).is_ok(), "a pole is a place");
    }

    #[test]
    fn nan_comes_back_as_nan() {
        let origin = Origin::new(47.0, 8.0, 400.0).expect("a place");
        let place = Geodetic {
            lat_deg: f64::NAN,
            lon_deg: 8.0,
            alt_m: 400.0,
        };
        assert!(!origin.to_world(place).is_finite());
        assert!(
            origin
                .to_geodetic(Point::new(f64::NAN, 0.0, 0.0))
                .lat_deg
                .is_nan()
        );
    }
}
