//! The methods that are compared: each is a set of SLAM settings, and whether it is told what a detector sees.

use slam::{Mapping, Moving, Settings};

/// Whether a method is given the inertial unit of a recording that has one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Inertial {
    Given,
    /// Not even where there is one.
    Withheld,
    /// Withheld, and nothing else is different from a method that is given it: run where there is one.
    Missed,
}

/// One method.
pub(super) struct Method {
    /// As figures have it.
    pub(super) name: &'static str,
    /// What it does about people and vehicles in view.
    moving: Moving,
    /// What it makes of the frames it keeps.
    mapping: Mapping,
    /// Whether it is given the objects of a recording that has some; it does not run on others.
    pub(super) takes_objects: bool,
    pub(super) inertial: Inertial,
    /// The satellite receiver it is given; it does not run on recordings that have none.
    pub(super) receiver: Option<&'static str>,
}

/// Ours, by geometry alone, without an inertial unit, with a detector, and with satellites; ours that takes everything for static; the paper's scheme; and frame-to-keyframe
/// odometry.
pub(super) const METHODS: &[Method] = &[
    Method {
        name: "tandem",
        moving: Moving::Reject,
        mapping: Mapping::Full,
        takes_objects: false,
        inertial: Inertial::Given,
        receiver: None,
    },
    Method {
        name: "tandem-vision",
        moving: Moving::Reject,
        mapping: Mapping::Full,
        takes_objects: false,
        inertial: Inertial::Missed,
        receiver: None,
    },
    Method {
        name: "no-dynamics",
        moving: Moving::Ignore,
        mapping: Mapping::Full,
        takes_objects: false,
        inertial: Inertial::Given,
        receiver: None,
    },
    Method {
        name: "tandem-objects",
        moving: Moving::Reject,
        mapping: Mapping::Full,
        takes_objects: true,
        inertial: Inertial::Given,
        receiver: None,
    },
    Method {
        name: "paper",
        moving: Moving::Paper,
        mapping: Mapping::Full,
        takes_objects: true,
        inertial: Inertial::Withheld,
        receiver: None,
    },
    Method {
        name: "baseline",
        moving: Moving::Ignore,
        mapping: Mapping::LastKeyframe,
        takes_objects: false,
        inertial: Inertial::Withheld,
        receiver: None,
    },
    Method {
        name: "tandem-m8n",
        moving: Moving::Reject,
        mapping: Mapping::Full,
        takes_objects: false,
        inertial: Inertial::Given,
        receiver: Some("m8n"),
    },
    Method {
        name: "tandem-rtk",
        moving: Moving::Reject,
        mapping: Mapping::Full,
        takes_objects: false,
        inertial: Inertial::Given,
        receiver: Some("rtk"),
    },
];

/// The method against which ghosts are counted.
pub(super) const STATIC: &str = "no-dynamics";

impl Method {
    /// The method of that name.
    pub(super) fn named(name: &str) -> anyhow::Result<&'static Self> {
        let method = METHODS.iter().find(|method| method.name == name);
        method.ok_or_else(|| {
            let known: Vec<_> = METHODS.iter().map(|method| method.name).collect();
            anyhow::anyhow!("there is no method {name:?}, only {}", known.join(", "))
        })
    }

    /// The default settings with what this method does otherwise, for a camera that sees so far.
    pub(super) fn settings(&self, max_depth_m: f64) -> Settings {
        Settings {
            moving: self.moving,
            mapping: self.mapping,
            max_depth_m,
            ..Settings::default()
        }
    }
}
