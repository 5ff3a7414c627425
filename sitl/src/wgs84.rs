//! The world's local tangent plane on the WGS-84 ellipsoid, through Earth-centred coordinates.
//!
//! ```text
//! N(φ) = a / √(1 - e²sin²φ)        X = (N + h) cos φ cos λ,  Y = (N + h) cos φ sin λ,  Z = (N(1 - e²) + h) sin φ
//! (e, n, u) = R(φ₀, λ₀) · (X - X₀)
//! ```
//!
//! The way back finds the latitude by Bowring's iteration, which is exact to rounding after a few steps. Written here
//! on purpose and not shared with the maps: truth has no code in common with estimates.
//!
//! - NGA, *Department of Defense World Geodetic System 1984*, NGA.STND.0036, 2014, Eqs. (4-14), (4-15).
//! - B. R. Bowring, *Transformation from spatial to geographical coordinates*, Survey Review 23, 1976.

use maps::frame::{Point, World};
use nalgebra::{Matrix3, Vector3};

/// Semi-major axis in metres.
const A: f64 = 6_378_137.0;
/// Flattening.
const F: f64 = 1.0 / 298.257_223_563;
/// First eccentricity squared.
const E2: f64 = F * (2.0 - F);

/// A place on Earth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geodetic {
    /// Latitude, north positive.
    pub lat_deg: f64,
    /// Longitude, east positive.
    pub lon_deg: f64,
    /// Height above the ellipsoid, which stands for sea level here.
    pub alt_m: f64,
}

/// `LAT,LON,ALT` that is no place on Earth.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "{text:?} is no origin, expected LAT,LON,ALT in degrees and metres, such as 50.7268,7.0865,60"
)]
pub struct OriginError {
    text: String,
}

/// Where the world's axes touch the ground.
#[derive(Clone, Debug)]
pub struct Origin {
    place: Geodetic,
    centre: Vector3<f64>,
    /// Rows: east, north, up.
    enu_from_ecef: Matrix3<f64>,
}

impl std::str::FromStr for Origin {
    type Err = OriginError;

    fn from_str(text: &str) -> Result<Self, OriginError> {
        let wrong = || OriginError {
            text: text.to_owned(),
        };
        let numbers: Vec<f64> = text
            .split(',')
            .map_while(|part| part.trim().parse().ok())
            .collect();
        let &[lat_deg, lon_deg, alt_m] = numbers.as_slice() else {
            return Err(wrong());
        };
        let place = Geodetic {
            lat_deg,
            lon_deg,
            alt_m,
        };
        let valid =
            lat_deg.abs() < 89.9 && lon_deg.abs() <= 180.0 && (-1000.0..20_000.0).contains(&alt_m);
        if valid {
            Ok(Self::new(place))
        } else {
            Err(wrong())
        }
    }
}

impl Origin {
    /// The tangent plane at that place.
    pub fn new(place: Geodetic) -> Self {
        let (lat, lon) = (place.lat_deg.to_radians(), place.lon_deg.to_radians());
        let ((sin_lat, cos_lat), (sin_lon, cos_lon)) = (lat.sin_cos(), lon.sin_cos());
        Self {
            place,
            centre: ecef(place),
            enu_from_ecef: Matrix3::new(
                -sin_lon,
                cos_lon,
                0.0,
                -sin_lat * cos_lon,
                -sin_lat * sin_lon,
                cos_lat,
                cos_lat * cos_lon,
                cos_lat * sin_lon,
                sin_lat,
            ),
        }
    }

    /// The place.
    pub fn place(&self) -> Geodetic {
        self.place
    }

    /// Where a place is in the world.
    pub fn to_world(&self, place: Geodetic) -> Point<World> {
        Point::from_raw((self.enu_from_ecef * (ecef(place) - self.centre)).into())
    }

    /// Which place a point of the world is.
    pub fn to_geodetic(&self, p: Point<World>) -> Geodetic {
        geodetic(self.centre + self.enu_from_ecef.transpose() * p.raw.coords)
    }
}

fn ecef(place: Geodetic) -> Vector3<f64> {
    let (sin_lat, cos_lat) = place.lat_deg.to_radians().sin_cos();
    let (sin_lon, cos_lon) = place.lon_deg.to_radians().sin_cos();
    let normal = A / (1.0 - E2 * sin_lat * sin_lat).sqrt();
    let across = (normal + place.alt_m) * cos_lat;
    Vector3::new(
        across * cos_lon,
        across * sin_lon,
        (normal * (1.0 - E2) + place.alt_m) * sin_lat,
    )
}

fn geodetic(p: Vector3<f64>) -> Geodetic {
    let across = p.x.hypot(p.y);
    let (b, second_e2) = (A * (1.0 - F), E2 / (1.0 - E2));
    // Bowring's parametric latitude; near the ground one step is good to 1e-9 m, and it converges elsewhere.
    let mut parametric = (p.z * A).atan2(across * b);
    let mut lat = 0.0;
    for _ in 0..5 {
        let (sin, cos) = parametric.sin_cos();
        lat = (p.z + second_e2 * b * sin.powi(3)).atan2(across - E2 * A * cos.powi(3));
        parametric = ((1.0 - F) * lat.sin()).atan2(lat.cos());
    }
    let (sin_lat, cos_lat) = lat.sin_cos();
    let normal = A / (1.0 - E2 * sin_lat * sin_lat).sqrt();
    Geodetic {
        lat_deg: lat.to_degrees(),
        lon_deg: p.y.atan2(p.x).to_degrees(),
        // Well conditioned at every latitude, unlike p/cos φ - N at the poles.
        alt_m: across * cos_lat + p.z * sin_lat - A * A / normal,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn at(lat_deg: f64, lon_deg: f64, alt_m: f64) -> Geodetic {
        Geodetic {
            lat_deg,
            lon_deg,
            alt_m,
        }
    }

    proptest! {
        #[test]
        fn a_point_and_its_place_bring_each_other_back(
            lat in -89.0..89.0, lon in -180.0..180.0, p in prop::array::uniform3(-2000.0..2000.0)
        ) {
            let origin = Origin::new(at(lat, lon, 60.0));
            let point = Point::from_raw(p.into());
            let back = origin.to_world(origin.to_geodetic(point));
            prop_assert!((back - point).norm() < 1e-7, "rounding of numbers the size of Earth: {}", (back - point).norm());
        }
    }

    #[test]
    fn known_places_have_their_known_earth_centred_coordinates() {
        // The equator, the pole, and a degree of latitude in Bonn as tabulated (111,229 m at 50.5 degrees).
        assert!((ecef(at(0.0, 0.0, 0.0)) - Vector3::new(A, 0.0, 0.0)).norm() < 1e-9);
        assert!(
            (ecef(at(90.0, 0.0, 0.0)) - Vector3::new(0.0, 0.0, 6_356_752.314_245)).norm() < 1e-6
        );
        let degree = (ecef(at(50.0, 7.0, 0.0)) - ecef(at(51.0, 7.0, 0.0))).norm();
        assert!((degree - 111_238.0).abs() < 20.0, "{degree}");
    }

    #[test]
    fn north_is_y_east_is_x_and_up_is_z() {
        let origin = Origin::new(at(50.7268, 7.0865, 60.0));
        let north = origin.to_world(at(50.7269, 7.0865, 60.0)).raw;
        let east = origin.to_world(at(50.7268, 7.0866, 60.0)).raw;
        let up = origin.to_world(at(50.7268, 7.0865, 61.0)).raw;
        assert!(north.y > 11.0 && north.x.abs() < 1e-6, "{north}");
        assert!(east.x > 7.0 && east.y.abs() < 1e-4, "{east}");
        assert!((up.coords - Vector3::z()).norm() < 1e-8, "{up}");
    }

    #[test]
    fn text_that_is_no_place_is_refused() {
        for text in [
            "", "1,2", "1,2,3,4", "91,0,0", "NaN,0,0", "1,181,0", "1,2,x",
        ] {
            assert!(text.parse::<Origin>().is_err(), "{text}");
        }
        let origin: Origin = "50.7268, 7.0865, 60".parse().expect("a place");
        assert_eq!(origin.place(), at(50.7268, 7.0865, 60.0));
    }
}
