//! Points, vectors and transforms that carry their coordinate frame in the type.
//!
//! A transform is named for what it yields and a chain cancels by reading:
//! `world_from_body * body_from_camera * p_in_camera`. The wrong chain does not compile:
//!
//! ```compile_fail,E0277
//! use maps::frame::{Body, Camera, Isometry, Point, World};
//! fn wrong(world_from_body: Isometry<World, Body>, p_in_camera: Point<Camera>) -> Point<World> {
//!     world_from_body * p_in_camera
//! }
//! ```
//!
//! Perturbations and covariances are on the right, `T ⊞ ξ = T · exp(ξ)`, translation before rotation.
//! Distances are metres, angles radians, as in REP-103; NED and FRD exist only in `mavlink_ext::convert`.

use std::fmt;
use std::marker::PhantomData;
use std::ops::{Add, Mul, Neg, Sub};

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

macro_rules! frames {
    ($($(#[$doc:meta])* $name:ident;)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub struct $name;
    )*};
}

frames! {
    /// Local tangent plane at the mission origin (`TANDEM_ORIGIN`): x east, y north, z up, right-handed.
    /// MAVLink: `MAV_FRAME_LOCAL_ENU`; its `MAV_FRAME_LOCAL_NED` is converted at the edge.
    World;
    /// A vehicle at its reference point: x forward, y left, z up, right-handed (REP-103 FLU).
    /// MAVLink: `MAV_FRAME_BODY_FRD` is converted at the edge.
    Body;
    /// A camera at its centre of projection: x right and y down in the image, z along the view ray, right-handed.
    Camera;
    /// The bird's-eye-view grid: origin at the UGV, x forward, y left, z up, right-handed.
    Bev;
}

/// A position in frame `F`, in metres.
pub struct Point<F> {
    /// The coordinates.
    pub raw: Point3<f64>,
    frame: PhantomData<fn() -> F>,
}

/// A displacement or direction in frame `F`, in metres unless its name says otherwise.
pub struct Vector<F> {
    /// The components.
    pub raw: Vector3<f64>,
    frame: PhantomData<fn() -> F>,
}

/// The rigid transform that takes coordinates in `From` to coordinates in `To`: the pose of `From` in `To`.
pub struct Isometry<To, From> {
    /// The transform without its frames.
    pub raw: Isometry3<f64>,
    frames: PhantomData<fn(From) -> To>,
}

impl<F> Point<F> {
    /// The point at these coordinates.
    pub fn new(x: f64, y: f64, z: f64) -> Self {
        Self::from_raw(Point3::new(x, y, z))
    }

    /// The point whose coordinates in `F` are `raw`.
    pub fn from_raw(raw: Point3<f64>) -> Self {
        Self {
            raw,
            frame: PhantomData,
        }
    }

    /// The origin of the frame.
    pub fn origin() -> Self {
        Self::from_raw(Point3::origin())
    }

    /// Whether no coordinate is NaN or infinite.
    pub fn is_finite(&self) -> bool {
        self.raw.iter().all(|c| c.is_finite())
    }
}

impl<F> Vector<F> {
    /// The vector with these components.
    pub fn new(x: f64, y: f64, z: f64) -> Self {
        Self::from_raw(Vector3::new(x, y, z))
    }

    /// The vector whose components in `F` are `raw`.
    pub fn from_raw(raw: Vector3<f64>) -> Self {
        Self {
            raw,
            frame: PhantomData,
        }
    }

    /// Its length.
    pub fn norm(&self) -> f64 {
        self.raw.norm()
    }
}

impl<To, From> Isometry<To, From> {
    /// Asserts that `raw` takes coordinates in `From` to coordinates in `To`. The only way to get a frame wrong: it
    /// stands in conversions, drivers and solvers, nowhere else.
    pub fn claim(raw: Isometry3<f64>) -> Self {
        Self {
            raw,
            frames: PhantomData,
        }
    }

    /// Two frames that coincide.
    pub fn identity() -> Self {
        Self::claim(Isometry3::identity())
    }

    /// The transform the other way.
    pub fn inverse(&self) -> Isometry<From, To> {
        Isometry::claim(self.raw.inverse())
    }

    /// Where the origin of `From` is in `To`.
    pub fn translation(&self) -> Point<To> {
        Point::from_raw(self.raw.translation.vector.into())
    }

    /// How `From` is turned in `To`.
    pub fn rotation(&self) -> UnitQuaternion<f64> {
        self.raw.rotation
    }

    /// Whether no component is NaN or infinite.
    pub fn is_finite(&self) -> bool {
        self.raw
            .translation
            .vector
            .iter()
            .chain(self.raw.rotation.coords.iter())
            .all(|c| c.is_finite())
    }
}

impl<To, Via, From> Mul<Isometry<Via, From>> for Isometry<To, Via> {
    type Output = Isometry<To, From>;

    fn mul(self, rhs: Isometry<Via, From>) -> Self::Output {
        Isometry::claim(self.raw * rhs.raw)
    }
}

impl<To, From> Mul<Point<From>> for Isometry<To, From> {
    type Output = Point<To>;

    fn mul(self, rhs: Point<From>) -> Self::Output {
        Point::from_raw(self.raw * rhs.raw)
    }
}

impl<To, From> Mul<Vector<From>> for Isometry<To, From> {
    type Output = Vector<To>;

    /// Turns the vector; a displacement does not move with the origin.
    fn mul(self, rhs: Vector<From>) -> Self::Output {
        Vector::from_raw(self.raw.rotation * rhs.raw)
    }
}

impl<F> Sub for Point<F> {
    type Output = Vector<F>;

    fn sub(self, rhs: Self) -> Vector<F> {
        Vector::from_raw(self.raw - rhs.raw)
    }
}

impl<F> Add<Vector<F>> for Point<F> {
    type Output = Self;

    fn add(self, rhs: Vector<F>) -> Self {
        Self::from_raw(self.raw + rhs.raw)
    }
}

impl<F> Add for Vector<F> {
    type Output = Self;

    fn add(self, rhs: Self) -> Self {
        Self::from_raw(self.raw + rhs.raw)
    }
}

impl<F> Mul<f64> for Vector<F> {
    type Output = Self;

    fn mul(self, factor: f64) -> Self {
        Self::from_raw(self.raw * factor)
    }
}

impl<F> Neg for Vector<F> {
    type Output = Self;

    fn neg(self) -> Self {
        Self::from_raw(-self.raw)
    }
}

// Derives would ask the same of the frame, which is only a name.
macro_rules! value_traits {
    ($($name:ident<$($frame:ident),+>),+) => {$(
        impl<$($frame),+> Clone for $name<$($frame),+> {
            fn clone(&self) -> Self {
                *self
            }
        }
        impl<$($frame),+> Copy for $name<$($frame),+> {}
        impl<$($frame),+> PartialEq for $name<$($frame),+> {
            fn eq(&self, other: &Self) -> bool {
                self.raw == other.raw
            }
        }
        impl<$($frame),+> fmt::Debug for $name<$($frame),+> {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.raw.fmt(f)
            }
        }
    )+};
}

value_traits!(Point<F>, Vector<F>, Isometry<To, From>);

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use proptest::prelude::*;

    use super::*;

    fn any_isometry<To, From>() -> impl Strategy<Value = Isometry<To, From>> {
        (
            prop::array::uniform3(-100.0..100.0),
            prop::array::uniform3(-3.0..3.0),
        )
            .prop_map(|(t, r): ([f64; 3], [f64; 3])| {
                Isometry::claim(Isometry3::new(t.into(), r.into()))
            })
    }

    proptest! {
        #[test]
        fn a_transform_and_its_inverse_bring_a_point_back(
            world_from_body in any_isometry::<World, Body>(), p in prop::array::uniform3(-100.0..100.0)
        ) {
            let [x, y, z] = p;
            let p_in_body = Point::<Body>::new(x, y, z);
            let back = world_from_body.inverse() * (world_from_body * p_in_body);
            prop_assert!((back - p_in_body).norm() < 1e-11, "rounding of values up to 200 m");
        }

        #[test]
        fn a_chain_of_transforms_is_one_after_the_other(
            world_from_body in any_isometry::<World, Body>(), body_from_camera in any_isometry::<Body, Camera>()
        ) {
            let p_in_camera = Point::<Camera>::new(1.0, 2.0, 3.0);
            let chained = (world_from_body * body_from_camera) * p_in_camera;
            prop_assert!((chained - world_from_body * (body_from_camera * p_in_camera)).norm() < 1e-11);
        }
    }

    #[test]
    fn a_body_that_heads_north_has_its_left_in_the_west() {
        let heading_north = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), FRAC_PI_2);
        let world_from_body = Isometry::<World, Body>::claim(Isometry3::from_parts(
            Vector3::new(10.0, 0.0, 0.0).into(),
            heading_north,
        ));
        let left = world_from_body * Point::<Body>::new(0.0, 1.0, 0.0);
        assert!((left - Point::new(9.0, 0.0, 0.0)).norm() < 1e-12);
    }
}
