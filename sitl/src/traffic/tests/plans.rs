//! Scenes to try.

use crate::traffic::{Agents, Crossing, Lane, Obstacle, Path, Plan, Priority, Signal, Walkway};

/// Nobody drives faster.
pub(super) const LIMIT_MPS: f64 = 13.9;

fn lane(points: &[[f64; 2]], width_m: f64) -> Lane {
    Lane {
        path: Path::open(points, 10.0),
        width_m,
        speed_limit_mps: LIMIT_MPS,
    }
}

/// A street of 200 m with a lane, a walkway and poles on each side, a zebra crossing, a place to cross between parked
/// cars, and a signal.
pub(super) fn street(agents: Agents) -> Plan {
    let side = |y: f64| Walkway {
        path: Path::open(&[[0.0, y], [200.0, y]], 1.0),
        width_m: 3.0,
    };
    let crossing = |x: f64, width_m: f64, priority: Priority| Crossing {
        ends: [[x, -3.5], [x, 3.5]],
        width_m,
        priority,
    };
    let pole = |i: u32| Obstacle::Circle {
        centre: [
            f64::from(i) * 20.0 + 5.0,
            if i.is_multiple_of(2) { 4.1 } else { -4.1 },
        ],
        radius_m: 0.12,
    };
    let bench = Obstacle::Box {
        centre: [90.0, 5.6],
        heading_rad: 0.1,
        size_m: [1.8, 0.6],
    };
    Plan {
        lanes: vec![
            lane(&[[0.0, -1.75], [200.0, -1.75]], 3.5),
            lane(&[[200.0, 1.75], [0.0, 1.75]], 3.5),
        ],
        walkways: vec![side(-5.0), side(5.0)],
        crossings: vec![
            crossing(60.0, 4.0, Priority::Pedestrians),
            crossing(130.0, 1.5, Priority::Vehicles),
        ],
        signals: vec![Signal {
            lane: 0,
            at_m: 100.0,
            cycle_s: 40.0,
            green_from_s: 5.0,
            green_for_s: 22.0,
        }],
        obstacles: (0..10).map(pole).chain([bench]).collect(),
        agents,
        ..Plan::default()
    }
}

/// Two streets that cross, and a lane that comes in from the side and joins one.
pub(super) fn junction() -> Plan {
    Plan {
        lanes: vec![
            lane(&[[-100.0, -1.75], [100.0, -1.75]], 3.5),
            lane(&[[100.0, 1.75], [-100.0, 1.75]], 3.5),
            lane(&[[1.75, -100.0], [1.75, 100.0]], 3.5),
            lane(&[[-1.75, 100.0], [-1.75, -100.0]], 3.5),
            lane(&[[50.0, -80.0], [50.0, -1.75], [100.0, -1.75]], 3.5),
        ],
        agents: Agents {
            cars: 18,
            trucks: 4,
            buses: 2,
            cyclists: 6,
            pedestrians: 0,
        },
        ..Plan::default()
    }
}

/// Two closed lanes round a block, in opposite directions, with a pavement round the block and a zebra crossing.
pub(super) fn block(cars: u16) -> Plan {
    let square = |half: f64| [[-half, -half], [half, -half], [half, half], [-half, half]];
    let mut back = square(38.5);
    back.reverse();
    let round = |points: &[[f64; 2]], radius_m: f64| Lane {
        path: Path::closed(points, radius_m),
        width_m: 3.5,
        speed_limit_mps: LIMIT_MPS,
    };
    let walkway = |half: f64, radius_m: f64| Walkway {
        path: Path::closed(&square(half), radius_m),
        width_m: 2.6,
    };
    Plan {
        lanes: vec![round(&square(42.0), 12.0), round(&back, 8.5)],
        walkways: vec![walkway(34.0, 4.0), walkway(46.5, 16.5)],
        crossings: vec![Crossing {
            ends: [[3.0, 35.3], [3.0, 45.2]],
            width_m: 4.0,
            priority: Priority::Pedestrians,
        }],
        agents: Agents {
            cars,
            trucks: 2,
            pedestrians: 24,
            ..Agents::default()
        },
        ..Plan::default()
    }
}

/// A street that people cross beside a side street: one lane comes out of it and turns into the street, one leads into
/// it.
pub(super) fn corner() -> Plan {
    let walkway = |y: f64, from: f64, to: f64| Walkway {
        path: Path::open(&[[from, y], [to, y]], 1.0),
        width_m: 3.0,
    };
    let crossing = |ends: [[f64; 2]; 2], width_m: f64| Crossing {
        ends,
        width_m,
        priority: Priority::Pedestrians,
    };
    Plan {
        lanes: vec![
            lane(&[[-100.0, -1.75], [100.0, -1.75]], 3.5),
            lane(&[[100.0, 1.75], [-100.0, 1.75]], 3.5),
            lane(&[[1.75, -80.0], [1.75, -1.75], [100.0, -1.75]], 3.5),
            lane(&[[-1.75, -3.5], [-1.75, -80.0]], 3.5),
        ],
        walkways: vec![
            walkway(5.0, -90.0, 90.0),
            walkway(-5.0, -90.0, -8.0),
            walkway(-5.0, 14.0, 90.0),
        ],
        crossings: vec![
            crossing([[-8.0, -5.0], [14.0, -5.0]], 2.5),
            crossing([[-12.0, -3.5], [-12.0, 3.5]], 4.0),
        ],
        agents: Agents {
            cars: 16,
            trucks: 2,
            buses: 1,
            cyclists: 3,
            pedestrians: 30,
        },
        ..Plan::default()
    }
}

/// As many as on a busy street.
pub(super) const MANY: Agents = Agents {
    cars: 22,
    trucks: 2,
    buses: 2,
    cyclists: 4,
    pedestrians: 30,
};

pub(super) fn plans() -> [(&'static str, Plan); 4] {
    [
        ("street", street(MANY)),
        ("junction", junction()),
        ("block", block(12)),
        ("corner", corner()),
    ]
}
