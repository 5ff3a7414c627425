//! The fence: a ceiling, a circle about home, and uploaded polygons and circles to stay within or out of.
//!
//! A breach is new once; it is new again 20 m further up or out. The fence that is on now and the parameter that switches it on
//! are two things: `DO_FENCE_ENABLE` changes the former and leaves the latter.
//!
//! Source: `ArduPilot` 4.6, `AC_Fence` (rules and words).

pub(super) mod zones;

use std::time::Duration;

use maps::time::Stamp;
use nalgebra::Point2;

use super::mode::Kind;
use super::parameters::{Parameter, Parameters};
use zones::Zone;

/// A breach is new again this much further up or out.
const BACKUP_M: f64 = 20.0;
/// How long a change of mode keeps the fence from acting again.
const RECOVERY: Duration = Duration::from_secs(10);

/// A set of the parts of a fence, with `ArduPilot`'s bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Parts(u8);

impl Parts {
    pub(super) const NONE: Self = Self(0);
    pub(super) const CEILING: Self = Self(1);
    pub(super) const CIRCLE: Self = Self(2);
    pub(super) const ZONES: Self = Self(4);
    pub(super) const ALL: Self = Self(7);

    pub(super) fn from_bits(bits: u32) -> Self {
        Self(bits as u8 & Self::ALL.0)
    }

    pub(super) fn is_empty(self) -> bool {
        self == Self::NONE
    }

    pub(super) fn has(self, part: Self) -> bool {
        self.0 & part.0 != 0
    }

    pub(super) fn and(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    pub(super) fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    pub(super) fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// Such as `Max Alt, Circle and Polygon fences`.
    pub(super) fn names(self) -> String {
        let named = [
            (Self::CEILING, "Max Alt"),
            (Self::CIRCLE, "Circle"),
            (Self::ZONES, "Polygon"),
        ];
        let mut names: Vec<&str> = named
            .iter()
            .filter(|(part, _)| self.has(*part))
            .map(|(_, name)| *name)
            .collect();
        let last = names.pop().unwrap_or_default();
        if names.is_empty() {
            format!("{last} fence")
        } else {
            format!("{} and {last} fences", names.join(", "))
        }
    }
}

/// What parameters say of the fence.
#[derive(Clone, Copy, Debug)]
pub(super) struct Settings {
    switch: bool,
    configured: Parts,
    ceiling_m: f64,
    radius_m: f64,
    margin_m: f64,
    kind: Kind,
}

impl Settings {
    pub(super) fn of(parameters: &Parameters, kind: Kind) -> Self {
        let parts = match kind {
            Kind::Copter => Parameter::CopterFenceType,
            Kind::Rover => Parameter::RoverFenceType,
        };
        Self {
            switch: parameters.is_on(Parameter::FenceEnable),
            configured: Parts::from_bits(parameters.bits(parts)),
            ceiling_m: parameters.get(Parameter::FenceCeiling),
            radius_m: parameters.get(Parameter::FenceRadius),
            margin_m: parameters.get(Parameter::FenceMargin),
            kind,
        }
    }

    /// The highest that a copter is to return at, m above home.
    pub(super) fn safe_ceiling_m(&self) -> f64 {
        self.ceiling_m - self.margin_m
    }
}

/// A place as a fence sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    /// In the world, east and north.
    pub(super) at: Point2<f64>,
    /// Over ground, m.
    pub(super) from_home_m: f64,
    pub(super) above_home_m: f64,
}

/// The breaches of a moment.
#[derive(Clone, Copy, Debug, Default)]
struct Breaches {
    now: Parts,
    count: u16,
    at: Stamp,
}

/// A fence and its breaches.
#[derive(Clone, Debug, Default)]
pub(super) struct Fence {
    zones: Vec<Zone>,
    /// What is on.
    on: Parts,
    /// `FENCE_ENABLE` when it was last looked at.
    switch: bool,
    breaches: Breaches,
    /// How far outside of the ceiling and the circle it is, and where a breach is new again.
    beyond: [Beyond; 2],
    recovery_since: Option<Stamp>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Beyond {
    by_m: f64,
    again_at_m: Option<f64>,
}

impl Beyond {
    /// Whether a breach of that part is new, at a distance that may be beyond its limit.
    fn check(&mut self, distance_m: f64, limit_m: f64) -> Crossing {
        if distance_m < limit_m {
            *self = Self::default();
            return Crossing::Inside;
        }
        self.by_m = distance_m - limit_m;
        if self
            .again_at_m
            .is_some_and(|again_at_m| distance_m < again_at_m)
        {
            return Crossing::Known;
        }
        self.again_at_m = Some(distance_m + BACKUP_M);
        Crossing::New
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Crossing {
    Inside,
    Known,
    New,
}

impl Fence {
    /// There are new polygons and circles.
    pub(super) fn set_zones(&mut self, zones: Vec<Zone>) {
        self.zones = zones;
    }

    /// Parts that have something to check.
    pub(super) fn present(&self, settings: &Settings) -> Parts {
        if self.zones.is_empty() {
            settings.configured.without(Parts::ZONES)
        } else {
            settings.configured
        }
    }

    /// Whether any part is on.
    pub(super) fn is_on(&self) -> bool {
        !self.on.is_empty()
    }

    /// Parts that are on and have something to check.
    pub(super) fn active(&self, settings: &Settings) -> Parts {
        self.on.and(self.present(settings))
    }

    /// What is breached now.
    pub(super) fn breached(&self) -> Parts {
        self.breaches.now
    }

    /// How often it was breached, and when first of what is breached now.
    pub(super) fn history(&self) -> (u16, Stamp) {
        (self.breaches.count, self.breaches.at)
    }

    /// How far it is outside of these parts, m. Polygons do not count.
    pub(super) fn beyond_m(&self, parts: Parts) -> f64 {
        let of = |part, beyond: &Beyond| if parts.has(part) { beyond.by_m } else { 0.0 };
        let [ceiling, circle] = &self.beyond;
        of(Parts::CEILING, ceiling).max(of(Parts::CIRCLE, circle))
    }

    /// Switches configured parts; returns those that it has changed.
    pub(super) fn switch(&mut self, settings: &Settings, on: bool, parts: Parts) -> Parts {
        let parts = settings.configured.and(parts);
        let before = self.on;
        self.on = if on {
            before.with(parts)
        } else {
            before.without(parts)
        };
        let changed = before.without(self.on).with(self.on.without(before));
        if !on {
            self.breaches.now = self.breaches.now.without(changed);
        }
        changed
    }

    /// Somebody, or the fence itself, changes the mode: for a while nothing more is done. False if nothing is breached.
    pub(super) fn begin_recovery(&mut self, now: Stamp) -> bool {
        if self.breaches.now.is_empty() {
            return false;
        }
        self.recovery_since = Some(now);
        true
    }

    /// Looks at where the vehicle is; returns breaches that are new and to be acted on.
    pub(super) fn check(&mut self, now: Stamp, settings: &Settings, here: Option<&Place>) -> Parts {
        if self.switch != settings.switch {
            self.switch = settings.switch;
            self.on = if settings.switch {
                settings.configured
            } else {
                Parts::NONE
            };
        }
        let active = self.active(settings);
        self.breaches.now = self.breaches.now.and(active);
        let Some(here) = here else {
            return Parts::NONE;
        };
        let was_in_zones = self.breaches.now.has(Parts::ZONES);
        let outside = |part| active.has(part);
        let [ceiling, circle] = &mut self.beyond;
        let crossings = [
            (
                Parts::CEILING,
                outside(Parts::CEILING)
                    .then(|| ceiling.check(here.above_home_m, settings.ceiling_m)),
            ),
            (
                Parts::CIRCLE,
                outside(Parts::CIRCLE).then(|| circle.check(here.from_home_m, settings.radius_m)),
            ),
            (
                Parts::ZONES,
                outside(Parts::ZONES).then(|| {
                    match (zones::is_breached(&self.zones, here.at), was_in_zones) {
                        (false, _) => Crossing::Inside,
                        (true, true) => Crossing::Known,
                        (true, false) => Crossing::New,
                    }
                }),
            ),
        ];
        let mut new = Parts::NONE;
        for (part, crossing) in crossings {
            match crossing {
                Some(Crossing::New) => {
                    self.record(now, part);
                    new = new.with(part);
                }
                Some(Crossing::Known) => {}
                Some(Crossing::Inside) | None => {
                    self.breaches.now = self.breaches.now.without(part);
                }
            }
        }
        match self.recovery_since {
            Some(since) if now.since(since) < RECOVERY => Parts::NONE,
            _ => {
                self.recovery_since = None;
                new
            }
        }
    }

    fn record(&mut self, now: Stamp, part: Parts) {
        if self.breaches.now.is_empty() {
            self.breaches.at = now;
        }
        self.breaches.count = (self.breaches.count + 1).min(65_500);
        self.breaches.now = self.breaches.now.with(part);
    }

    /// Whether a place to go to is inside.
    pub(super) fn allows(&self, settings: &Settings, place: &Place) -> bool {
        let active = self.active(settings);
        let above = active.has(Parts::CEILING) && place.above_home_m > settings.ceiling_m;
        let away = active.has(Parts::CIRCLE) && place.from_home_m > settings.radius_m;
        let within = active.has(Parts::ZONES) && zones::is_breached(&self.zones, place.at);
        !above && !away && !within
    }

    /// What stands against arming.
    pub(super) fn arming_failure(&self, settings: &Settings, has_position: bool) -> Option<String> {
        let configured = settings.configured;
        if settings.switch && self.present(settings).is_empty() {
            return Some("Fences enabled, but none selected".to_owned());
        }
        if !self.is_on() || configured.is_empty() {
            return None;
        }
        let level = configured.has(Parts::CIRCLE) || configured.has(Parts::ZONES);
        let inclusion_m = zones::smallest_inclusion_m(&self.zones);
        let copter = settings.kind == Kind::Copter;
        let checks = [
            (level && !has_position, "Fence requires position"),
            (
                configured.has(Parts::ZONES)
                    && inclusion_m.is_some_and(|radius_m| radius_m < settings.margin_m),
                "Polygon fence margin is less than inclusion circle radius",
            ),
            (settings.radius_m < 0.0, "Invalid Circle FENCE_RADIUS value"),
            (
                settings.radius_m < settings.margin_m,
                "Circle FENCE_MARGIN is less than FENCE_RADIUS",
            ),
            (
                copter && settings.ceiling_m < 0.0,
                "Invalid FENCE_ALT_MAX value",
            ),
        ];
        if let Some((_, why)) = checks.iter().find(|(fails, _)| *fails) {
            return Some((*why).to_owned());
        }
        if !self.breaches.now.is_empty() {
            return Some(format!("Vehicle breaching {}", self.breaches.now.names()));
        }
        let checks = [
            (settings.margin_m < 0.0, "Invalid FENCE_MARGIN value"),
            // Above a floor 10 m below home, which nobody can see.
            (
                copter && settings.ceiling_m + 10.0 <= 2.0 * settings.margin_m,
                "FENCE_MARGIN too big",
            ),
        ];
        checks
            .iter()
            .find(|(fails, _)| *fails)
            .map(|(_, why)| (*why).to_owned())
    }
}

#[cfg(test)]
mod tests;
