//! What is configured: a TOML file whose every key has a default. Unknown keys are refused, so that a typo shows.

use std::path::{Path, PathBuf};

use maps::plan::PlanLimits;
use maps::traversability;
use mavlink_ext::{Address, ComponentId, SystemId};
use serde::{Deserialize, Serialize};

/// The whole file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// MAVLink system id of this station.
    pub system_id: u8,
    /// MAVLink component id of this station.
    pub component_id: u8,
    /// Links to open at the start, besides those of `--connect`.
    pub links: Vec<String>,
    /// The ground vehicle that paths are planned for.
    pub ugv: Ugv,
    /// What survey plans are made of.
    pub survey: Survey,
}

/// `[ugv]`: the size of the ground vehicle and what it can do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Ugv {
    /// Along the direction of travel.
    pub length_m: f64,
    /// Across it.
    pub width_m: f64,
    /// What it must fit under.
    pub height_m: f64,
    /// Between the axles.
    pub wheelbase_m: f64,
    /// Of the reference point.
    pub min_turning_radius_m: f64,
    /// The highest edge it climbs.
    pub max_step_m: f64,
    /// The steepest slope it climbs.
    pub max_slope_deg: f64,
    /// Least distance that a planned path keeps from obstacles, measured from the sides of the vehicle.
    pub clearance_m: f64,
    /// Speed on a planned path.
    pub cruise_mps: f64,
}

/// `[survey]`: how surveys are flown, unless asked otherwise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Survey {
    /// Height above the take-off point.
    pub altitude_m: f64,
    /// Distance between lines.
    pub spacing_m: f64,
    /// Speed along the lines.
    pub speed_mps: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            system_id: 255,
            component_id: 190,
            links: Vec::new(),
            ugv: Ugv::default(),
            survey: Survey::default(),
        }
    }
}

impl Default for Ugv {
    fn default() -> Self {
        Self {
            length_m: 0.42,
            width_m: 0.30,
            height_m: 0.30,
            wheelbase_m: 0.26,
            min_turning_radius_m: 0.45,
            max_step_m: 0.08,
            max_slope_deg: 20.0,
            clearance_m: PlanLimits::default().clearance_m,
            cruise_mps: 0.5,
        }
    }
}

impl Default for Survey {
    fn default() -> Self {
        Self {
            altitude_m: 2.0,
            spacing_m: 1.0,
            speed_mps: 1.0,
        }
    }
}

/// Why the configuration cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("cannot read the configuration {}: {source}", path.display())]
    Read {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It is no TOML, or has an unknown key.
    #[error("in the configuration {}: {source}", path.display())]
    Parse {
        /// Which file.
        path: PathBuf,
        /// Where and what.
        source: Box<toml::de::Error>,
    },
    /// A value is out of its range.
    #[error("configuration: {key} = {value} must be greater than 0 and finite")]
    NotPositive {
        /// Section and key.
        key: &'static str,
        /// What it is.
        value: f64,
    },
    /// System id 0 is a broadcast.
    #[error("configuration: system_id and component_id must not be 0, which means everybody")]
    Broadcast,
}

impl Config {
    /// Reads and checks a file.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let text = std::fs::read_to_string(path).map_err(|source| ConfigError::Read {
            path: path.to_owned(),
            source,
        })?;
        let config: Self = toml::from_str(&text).map_err(|source| ConfigError::Parse {
            path: path.to_owned(),
            source: Box::new(source),
        })?;
        config.check()?;
        Ok(config)
    }

    /// Whether every value is in its range.
    pub fn check(&self) -> Result<(), ConfigError> {
        if self.system_id == 0 || self.component_id == 0 {
            return Err(ConfigError::Broadcast);
        }
        let positive = [
            ("ugv.length_m", self.ugv.length_m),
            ("ugv.width_m", self.ugv.width_m),
            ("ugv.height_m", self.ugv.height_m),
            ("ugv.wheelbase_m", self.ugv.wheelbase_m),
            ("ugv.min_turning_radius_m", self.ugv.min_turning_radius_m),
            ("ugv.max_step_m", self.ugv.max_step_m),
            ("ugv.max_slope_deg", self.ugv.max_slope_deg),
            ("ugv.clearance_m", self.ugv.clearance_m),
            ("ugv.cruise_mps", self.ugv.cruise_mps),
            ("survey.altitude_m", self.survey.altitude_m),
            ("survey.spacing_m", self.survey.spacing_m),
            ("survey.speed_mps", self.survey.speed_mps),
        ];
        match positive
            .into_iter()
            .find(|(_, value)| !(*value > 0.0 && value.is_finite()))
        {
            Some((key, value)) => Err(ConfigError::NotPositive { key, value }),
            None => Ok(()),
        }
    }

    /// This station's address.
    pub fn address(&self) -> Address {
        Address {
            system: SystemId(self.system_id),
            component: ComponentId(self.component_id),
        }
    }

    /// The ground vehicle as the planner wants it.
    pub fn vehicle(&self) -> traversability::Vehicle {
        traversability::Vehicle {
            length_m: self.ugv.length_m,
            width_m: self.ugv.width_m,
            height_m: self.ugv.height_m,
            wheelbase_m: self.ugv.wheelbase_m,
            min_turning_radius_m: self.ugv.min_turning_radius_m,
            max_step_m: self.ugv.max_step_m,
            max_slope_rad: self.ugv.max_slope_deg.to_radians(),
        }
    }

    /// What its paths must keep to.
    pub fn plan_limits(&self) -> PlanLimits {
        PlanLimits {
            clearance_m: self.ugv.clearance_m,
            ..PlanLimits::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_file_is_the_default_and_a_typo_is_refused() {
        assert_eq!(
            toml::from_str::<Config>("").expect("valid"),
            Config::default()
        );
        let typo = toml::from_str::<Config>("[ugv]\nlenght_m = 1.0\n").expect_err("a typo");
        assert!(
            typo.to_string().contains("unknown field `lenght_m`"),
            "{typo}"
        );
    }

    #[test]
    fn a_vehicle_without_width_is_refused_by_name() {
        let mut config = Config::default();
        assert!(config.check().is_ok());
        config.ugv.width_m = 0.0;
        assert!(
            config
                .check()
                .expect_err("no width")
                .to_string()
                .contains("ugv.width_m")
        );
    }

    #[test]
    fn what_is_printed_is_read_back() {
        let text = toml::to_string(&Config::default()).expect("plain values");
        assert_eq!(
            toml::from_str::<Config>(&text).expect("own text"),
            Config::default()
        );
    }
}
