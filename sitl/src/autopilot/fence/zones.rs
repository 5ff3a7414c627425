//! Uploaded polygons and circles, from mission items.
//!
//! Corners of a polygon follow one another, and each says how many there are (parameter 1); a circle says its radius there.
//! <https://mavlink.io/en/services/mission.html#fence_items>

use maps::frame::Point;
use mavlink_ext::dialect::cmd;
use mavlink_ext::dialect::tandem::MavMissionResult;
use mavlink_ext::mission::{MissionFrame, MissionItem};
use nalgebra::Point2;

use crate::wgs84::{Geodetic, Origin};

/// Something to stay within or out of.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::autopilot) struct Zone {
    side: Side,
    shape: Shape,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    Within,
    OutOf,
}

#[derive(Clone, Debug, PartialEq)]
enum Shape {
    Polygon(Vec<Point2<f64>>),
    Circle { centre: Point2<f64>, radius_m: f64 },
}

impl Zone {
    /// Whether somebody there is where he must not be.
    fn is_breached(&self, at: Point2<f64>) -> bool {
        let inside = match &self.shape {
            Shape::Polygon(corners) => is_inside(corners, at),
            Shape::Circle { centre, radius_m } => (at - centre).norm() < *radius_m,
        };
        match self.side {
            Side::Within => !inside,
            Side::OutOf => inside,
        }
    }
}

/// Whether any of them is breached.
pub(super) fn is_breached(zones: &[Zone], at: Point2<f64>) -> bool {
    zones.iter().any(|zone| zone.is_breached(at))
}

/// The radius of the smallest circle to stay within.
pub(super) fn smallest_inclusion_m(zones: &[Zone]) -> Option<f64> {
    let radii = zones.iter().filter_map(|zone| match zone {
        Zone {
            side: Side::Within,
            shape: Shape::Circle { radius_m, .. },
        } => Some(*radius_m),
        Zone { .. } => None,
    });
    radii.reduce(f64::min)
}

/// Even-odd: a line from there to the east crosses the edges an odd number of times.
fn is_inside(corners: &[Point2<f64>], at: Point2<f64>) -> bool {
    let edges = corners.iter().zip(corners.iter().cycle().skip(1));
    let crossed = edges.filter(|(a, b)| {
        let spans = (a.y > at.y) != (b.y > at.y);
        spans && at.x < a.x + (at.y - a.y) / (b.y - a.y) * (b.x - a.x)
    });
    crossed.count() % 2 == 1
}

/// Whether an item is one of a fence.
pub(in crate::autopilot) fn accepts(item: &MissionItem) -> Result<(), MavMissionResult> {
    let [first, ..] = item.params;
    let ok = match item.command {
        cmd::NAV_FENCE_POLYGON_VERTEX_INCLUSION | cmd::NAV_FENCE_POLYGON_VERTEX_EXCLUSION => {
            (0.0..=255.0).contains(&first)
        }
        cmd::NAV_FENCE_CIRCLE_INCLUSION | cmd::NAV_FENCE_CIRCLE_EXCLUSION => first.is_finite(),
        cmd::NAV_FENCE_RETURN_POINT => true,
        _ => return Err(MavMissionResult::MAV_MISSION_UNSUPPORTED),
    };
    match item.frame {
        MissionFrame::Global | MissionFrame::GlobalRelativeAlt if ok => Ok(()),
        MissionFrame::Global | MissionFrame::GlobalRelativeAlt => {
            Err(MavMissionResult::MAV_MISSION_INVALID_PARAM1)
        }
        MissionFrame::GlobalTerrainAlt | MissionFrame::Command => {
            Err(MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME)
        }
    }
}

/// Whether items make a fence: polygons have all their corners, three at least, and circles have a radius.
pub(in crate::autopilot) fn accepts_all(items: &[MissionItem]) -> Result<(), MavMissionResult> {
    let mut rest = items;
    while let Some(zone) = next(&mut rest) {
        let corners =
            |zone: &[MissionItem]| zone[0].params[0] as usize == zone.len() && zone.len() >= 3;
        let fine = match zone[0].command {
            cmd::NAV_FENCE_POLYGON_VERTEX_INCLUSION | cmd::NAV_FENCE_POLYGON_VERTEX_EXCLUSION => {
                corners(zone)
            }
            cmd::NAV_FENCE_CIRCLE_INCLUSION | cmd::NAV_FENCE_CIRCLE_EXCLUSION => {
                zone[0].params[0] > 0.0
            }
            _ => true,
        };
        if !fine {
            return Err(MavMissionResult::MAV_MISSION_ERROR);
        }
    }
    Ok(())
}

/// The zones of items that were accepted. A point to return to is none: copters and rovers return home.
pub(in crate::autopilot) fn of(items: &[MissionItem], origin: &Origin) -> Vec<Zone> {
    let mut rest = items;
    std::iter::from_fn(|| next(&mut rest))
        .filter_map(|zone| zone_of(zone, origin))
        .collect()
}

fn zone_of(items: &[MissionItem], origin: &Origin) -> Option<Zone> {
    let first = items.first()?;
    let place = |item: &MissionItem| {
        let ground = Geodetic {
            lat_deg: item.lat_deg,
            lon_deg: item.lon_deg,
            alt_m: origin.place().alt_m,
        };
        let place: Point<_> = origin.to_world(ground);
        place.raw.xy()
    };
    let polygon = || Shape::Polygon(items.iter().map(place).collect());
    let circle = || Shape::Circle {
        centre: place(first),
        radius_m: f64::from(first.params[0]),
    };
    let (side, shape) = match first.command {
        cmd::NAV_FENCE_POLYGON_VERTEX_INCLUSION => (Side::Within, polygon()),
        cmd::NAV_FENCE_POLYGON_VERTEX_EXCLUSION => (Side::OutOf, polygon()),
        cmd::NAV_FENCE_CIRCLE_INCLUSION => (Side::Within, circle()),
        cmd::NAV_FENCE_CIRCLE_EXCLUSION => (Side::OutOf, circle()),
        _ => return None,
    };
    Some(Zone { side, shape })
}

/// Takes the items of the next zone: the corners of a polygon, as many as the first says or as there are, or one item.
fn next<'a>(rest: &mut &'a [MissionItem]) -> Option<&'a [MissionItem]> {
    let first = rest.first()?;
    let corner = matches!(
        first.command,
        cmd::NAV_FENCE_POLYGON_VERTEX_INCLUSION | cmd::NAV_FENCE_POLYGON_VERTEX_EXCLUSION
    );
    let alike = |item: &&MissionItem| {
        item.command == first.command && (item.params[0] - first.params[0]).abs() < 0.5
    };
    let count = if corner {
        let wanted = (first.params[0] as usize).max(1);
        rest.iter().take(wanted).take_while(alike).count()
    } else {
        1
    };
    let (zone, later) = rest.split_at(count);
    *rest = later;
    Some(zone)
}
