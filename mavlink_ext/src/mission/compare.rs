//! Is what the vehicle says it has what we sent?

use super::{MissionFrame, MissionItem};

/// One unit of the wire: sender and vehicle may each round by half of it.
const ANGLE_TOLERANCE_DEG: f64 = 1.01e-7;
/// Flight controllers store centimetres, in single precision on the wire.
const ALTITUDE_TOLERANCE_M: f64 = 0.0101;

/// Something in the mission read back that is not as it was sent.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Difference {
    /// Items are missing or too many.
    #[error("{sent} mission items were sent, {read} read back")]
    Length {
        /// How many were sent.
        sent: usize,
        /// How many came back.
        read: usize,
    },
    /// An item has another command, frame or continuation.
    #[error("mission item {item}: sent {sent:?}, read back {read:?}")]
    Kind {
        /// Its number.
        item: usize,
        /// What was sent.
        sent: (u16, MissionFrame, bool),
        /// What came back.
        read: (u16, MissionFrame, bool),
    },
    /// An item is elsewhere.
    #[error("mission item {item}: sent to {sent:?}, read back {read:?}")]
    Position {
        /// Its number.
        item: usize,
        /// Latitude, longitude in degrees and altitude in metres as sent.
        sent: [f64; 3],
        /// As read back.
        read: [f64; 3],
    },
    /// A parameter is another.
    #[error("mission item {item}: parameter {parameter} sent {sent}, read back {read}")]
    Parameter {
        /// Its number.
        item: usize,
        /// 1 to 4.
        parameter: usize,
        /// What was sent.
        sent: f32,
        /// What came back.
        read: f32,
    },
}

/// Everything in which the mission read back differs from the one sent by more than the rounding of the wire.
///
/// NaN and 0 are the same parameter: vehicles that know no NaN store 0.
pub fn differences(sent: &[MissionItem], read: &[MissionItem]) -> Vec<Difference> {
    let mut found = Vec::new();
    if sent.len() != read.len() {
        found.push(Difference::Length {
            sent: sent.len(),
            read: read.len(),
        });
    }
    for (item, (sent, read)) in sent.iter().zip(read).enumerate() {
        compare_items(item, sent, read, &mut found);
    }
    found
}

fn compare_items(item: usize, sent: &MissionItem, read: &MissionItem, found: &mut Vec<Difference>) {
    let kind = |item: &MissionItem| (item.command, item.frame, item.autocontinue);
    if kind(sent) != kind(read) {
        found.push(Difference::Kind {
            item,
            sent: kind(sent),
            read: kind(read),
        });
    }
    let position = |item: &MissionItem| [item.lat_deg, item.lon_deg, item.alt_m];
    let tolerances = [
        ANGLE_TOLERANCE_DEG,
        ANGLE_TOLERANCE_DEG,
        ALTITUDE_TOLERANCE_M,
    ];
    let near = position(sent)
        .into_iter()
        .zip(position(read))
        .zip(tolerances)
        .all(|((sent, read), tolerance)| {
            (sent - read).abs() <= tolerance || (is_unset(sent) && is_unset(read))
        });
    if !near {
        found.push(Difference::Position {
            item,
            sent: position(sent),
            read: position(read),
        });
    }
    for (index, (&sent, &read)) in sent.params.iter().zip(&read.params).enumerate() {
        let same = sent.to_bits() == read.to_bits()
            || (is_unset(f64::from(sent)) && is_unset(f64::from(read)));
        if !same {
            found.push(Difference::Parameter {
                item,
                parameter: index + 1,
                sent,
                read,
            });
        }
    }
}

fn is_unset(value: f64) -> bool {
    value.is_nan() || value == 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    const WAYPOINT: fn() -> MissionItem = || MissionItem::waypoint(52.0, 13.0, 10.0);

    #[track_caller]
    fn check(read: MissionItem, expected: usize) {
        let found = differences(&[WAYPOINT()], &[read]);
        assert_eq!(found.len(), expected, "{found:?}");
    }

    #[test]
    fn one_unit_of_the_wire_is_no_difference_and_two_are() {
        let moved = |deg: f64| MissionItem {
            lat_deg: 52.0 + deg,
            ..WAYPOINT()
        };
        check(moved(1e-7), 0);
        check(moved(2e-7), 1);
        let raised = |m: f64| MissionItem {
            alt_m: 10.0 + m,
            ..WAYPOINT()
        };
        check(raised(0.01), 0);
        check(raised(-0.02), 1);
    }

    #[test]
    fn an_unset_parameter_may_come_back_as_zero_and_nothing_else() {
        let with = |value: f32| MissionItem {
            params: [0.0, 0.0, 0.0, value],
            ..WAYPOINT()
        };
        check(with(f32::NAN), 0);
        check(with(-0.0), 0);
        check(with(1.0), 1);
    }

    #[test]
    fn another_command_frame_or_length_is_told() {
        let land = MissionItem {
            command: crate::dialect::cmd::NAV_LAND,
            ..WAYPOINT()
        };
        check(land, 1);
        let found = differences(&[WAYPOINT()], &[]);
        assert_eq!(found, [Difference::Length { sent: 1, read: 0 }]);
        assert_eq!(
            found[0].to_string(),
            "1 mission items were sent, 0 read back"
        );
    }
}
