//! The geoid: how far mean sea level lies above the ellipsoid.
//!
//! ```text
//! height above the ellipsoid = height above mean sea level + N(latitude, longitude)
//! ```
//!
//! Autopilots and paper maps tell the second, GNSS receivers and [`crate::Origin`] the first; `N` is between -107 m and
//! 86 m. The models are large files that `GeographicLib` does not bring along: without one, [`Geoid::open`] says how to
//! get it.

use std::fmt;
use std::path::{Path, PathBuf};

use cxx::UniquePtr;

use crate::Geodetic;
use crate::bridge::ffi;

/// A model of the geoid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GeoidModel {
    /// EGM84 every 30′, 0.6 MB.
    Egm84At30,
    /// EGM96 every 5′, 19 MB: what most autopilots and MAVLink mean by mean sea level.
    #[default]
    Egm96At5,
    /// EGM2008 every 5′, 19 MB.
    Egm2008At5,
}

impl GeoidModel {
    /// The name of its file, without the ending.
    pub fn name(self) -> &'static str {
        match self {
            Self::Egm84At30 => "egm84-30",
            Self::Egm96At5 => "egm96-5",
            Self::Egm2008At5 => "egm2008-5",
        }
    }
}

/// As its file.
impl fmt::Display for GeoidModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Why there is no geoid, or no height of it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GeoidError {
    /// The file is not there.
    #[error(
        "the geoid {model} is not installed in {}: run `geographiclib-get-geoids {model}` as root (Debian: geographiclib-tools)",
        folder.display()
    )]
    NotInstalled {
        /// Which model.
        model: GeoidModel,
        /// Where it was looked for.
        folder: PathBuf,
    },
    /// The file is there but is none.
    #[error("the geoid {model} in {} is damaged, fetch it again: {reason}", folder.display())]
    Damaged {
        /// Which model.
        model: GeoidModel,
        /// Where it is.
        folder: PathBuf,
        /// What `GeographicLib` says.
        reason: String,
    },
    /// NaN, or beyond a pole.
    #[error("latitude {lat_deg}, longitude {lon_deg} is no place")]
    NotAPlace {
        /// As given.
        lat_deg: f64,
        /// As given.
        lon_deg: f64,
    },
}

/// A geoid whose file is open.
pub struct Geoid {
    inner: UniquePtr<ffi::GeoidModel>,
    model: GeoidModel,
    folder: PathBuf,
}

impl Geoid {
    /// Opens a model where `GeographicLib` keeps its data: by default `/usr/share/GeographicLib/geoids`.
    pub fn open(model: GeoidModel) -> Result<Self, GeoidError> {
        Self::open_in(model, Path::new(&ffi::geoid_folder()))
    }

    /// Opens a model whose `.pgm` file is in this folder.
    pub fn open_in(model: GeoidModel, folder: &Path) -> Result<Self, GeoidError> {
        let file = folder.join(format!("{model}.pgm"));
        let folder = folder.to_owned();
        if !file.is_file() {
            return Err(GeoidError::NotInstalled { model, folder });
        }
        match ffi::open_geoid(model.name(), &folder.to_string_lossy()) {
            Ok(inner) => Ok(Self {
                inner,
                model,
                folder,
            }),
            Err(error) => Err(GeoidError::Damaged {
                model,
                folder,
                reason: error.what().to_owned(),
            }),
        }
    }

    /// How far mean sea level is above the ellipsoid.
    pub fn undulation_m(&self, lat_deg: f64, lon_deg: f64) -> Result<f64, GeoidError> {
        if !(-90.0..=90.0).contains(&lat_deg) || !(-180.0..=180.0).contains(&lon_deg) {
            return Err(GeoidError::NotAPlace { lat_deg, lon_deg });
        }
        self.inner
            .height(lat_deg, lon_deg)
            .map_err(|error| GeoidError::Damaged {
                model: self.model,
                folder: self.folder.clone(),
                reason: error.what().to_owned(),
            })
    }

    /// The place at a height above mean sea level.
    pub fn at_sea_level_height(
        &self,
        lat_deg: f64,
        lon_deg: f64,
        msl_m: f64,
    ) -> Result<Geodetic, GeoidError> {
        let alt_m = msl_m + self.undulation_m(lat_deg, lon_deg)?;
        Ok(Geodetic {
            lat_deg,
            lon_deg,
            alt_m,
        })
    }

    /// How high a place is above mean sea level.
    pub fn sea_level_height_m(&self, place: Geodetic) -> Result<f64, GeoidError> {
        Ok(place.alt_m - self.undulation_m(place.lat_deg, place.lon_deg)?)
    }
}

/// Which model.
impl fmt::Debug for Geoid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Geoid").field(&self.model).finish()
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    /// A geoid as `GeographicLib` reads it, every 45°, of which `height_m` says the height at a row (from north) and
    /// column.
    fn write_geoid(folder: &Path, height_m: impl Fn(usize, usize) -> f64) {
        let header = "P5\n# Description made up\n# DateTime 2026-01-01 00:00:00\n# Offset -100\n# Scale 0.01\n\
                      # Origin 90N 0E\n# AREA_OR_POINT Point\n8 5\n65535\n";
        let pixels = (0..5).flat_map(|row| (0..8).map(move |column| (row, column)));
        let data = pixels.flat_map(|(row, column)| {
            let steps = ((height_m(row, column) + 100.0) / 0.01).round() as u16;
            steps.to_be_bytes()
        });
        let file: Vec<_> = header.bytes().chain(data).collect();
        fs::write(folder.join("egm96-5.pgm"), file).expect("written");
    }

    #[test]
    fn heights_above_the_sea_and_the_ellipsoid_differ_by_the_undulation() {
        let folder = tempfile::tempdir().expect("a folder");
        write_geoid(folder.path(), |_, _| 47.25);
        let geoid = Geoid::open_in(GeoidModel::Egm96At5, folder.path()).expect("a geoid");
        let place = geoid
            .at_sea_level_height(47.4, 8.5, 400.0)
            .expect("a place");
        assert!((place.alt_m - 447.25).abs() < 1e-6, "{}", place.alt_m);
        let msl_m = geoid.sea_level_height_m(place).expect("a place");
        assert!((msl_m - 400.0).abs() < 1e-9, "{msl_m}");
    }

    #[test]
    fn a_geoid_that_is_missing_says_how_to_get_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let error =
            Geoid::open_in(GeoidModel::Egm96At5, folder.path()).expect_err("an empty folder");
        let expected = format!(
            "the geoid egm96-5 is not installed in {}: run `geographiclib-get-geoids egm96-5` as root (Debian: geographiclib-tools)",
            folder.path().display()
        );
        assert_eq!(error.to_string(), expected);
    }

    #[test]
    fn a_geoid_that_is_cut_off_is_damaged() {
        let folder = tempfile::tempdir().expect("a folder");
        write_geoid(folder.path(), |_, _| 0.0);
        let path = folder.path().join("egm96-5.pgm");
        let whole = fs::read(&path).expect("written");
        fs::write(&path, &whole[..whole.len() - 1]).expect("written");
        let error =
            Geoid::open_in(GeoidModel::Egm96At5, folder.path()).expect_err("a byte is missing");
        assert!(matches!(error, GeoidError::Damaged { .. }), "{error}");
    }

    #[test]
    fn no_place_has_no_undulation() {
        let folder = tempfile::tempdir().expect("a folder");
        write_geoid(folder.path(), |_, _| 0.0);
        let geoid = Geoid::open_in(GeoidModel::Egm96At5, folder.path()).expect("a geoid");
        for (lat, lon) in [(f64::NAN, 0.0), (91.0, 0.0), (0.0, f64::INFINITY)] {
            assert!(geoid.undulation_m(lat, lon).is_err(), "{lat} {lon}");
        }
    }

    #[test]
    fn the_installed_geoid_is_where_the_manual_puts_it() {
        // GeoidEval(1): `echo 16:46:33N 3:00:34W | GeoidEval` prints 28.7068, by EGM96.
        match Geoid::open(GeoidModel::Egm96At5) {
            Ok(geoid) => {
                let (lat, lon) = (16.0 + 46.0 / 60.0 + 33.0 / 3600.0, -(3.0 + 34.0 / 3600.0));
                let undulation_m = geoid.undulation_m(lat, lon).expect("a place");
                assert!((undulation_m - 28.7068).abs() < 1e-3, "{undulation_m}");
            }
            Err(error) => println!("{error}: nothing to compare"),
        }
    }
}
