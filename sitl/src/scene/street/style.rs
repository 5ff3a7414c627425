//! What makes an alley an alley: widths, densities, light.

use std::ops::Range;

use crate::scene::{Name, Sun};

/// Houses along one side of a street.
#[derive(Clone, Copy, Debug)]
pub(super) struct Houses {
    /// Along the street, in metres.
    pub(super) width_m: [f64; 2],
    pub(super) depth_m: [f64; 2],
    pub(super) storeys: [f64; 2],
    /// Between one and the next.
    pub(super) gap_m: [f64; 2],
    /// From the pavement.
    pub(super) setback_m: [f64; 2],
    /// Share with a gabled roof; the others are flat.
    pub(super) gabled: f64,
    /// Share with shops in the ground floor.
    pub(super) shops: f64,
    /// Halls of sheet metal, not houses.
    pub(super) are_halls: bool,
}

/// How many of each kind take part in the traffic.
#[derive(Clone, Copy, Debug)]
pub(super) struct Movers {
    pub(super) cars: usize,
    pub(super) trucks: usize,
    pub(super) buses: usize,
    pub(super) cyclists: usize,
    pub(super) pedestrians: usize,
}

/// A kind of street.
#[derive(Clone, Copy, Debug)]
pub(super) struct Style {
    /// Lanes in each direction.
    pub(super) lanes: usize,
    pub(super) lane_m: f64,
    pub(super) speed_mps: f64,
    pub(super) is_marked: bool,
    /// Width of a strip for parked vehicles, at the left and at the right; 0 for none.
    pub(super) parking_m: [f64; 2],
    /// Share of places there that are taken, and share of those by trucks.
    pub(super) parked: f64,
    pub(super) parked_trucks: f64,
    pub(super) pavement_m: [f64; 2],
    /// Half the width of its bends, and how long one is.
    pub(super) bend_m: [f64; 2],
    pub(super) houses: Houses,
    /// Metres between trees, lamps and smaller things.
    pub(super) trees_m: f64,
    pub(super) lamps_m: f64,
    pub(super) things_m: f64,
    /// Whether gardens, with hedges and fences, lie before the houses.
    pub(super) has_gardens: bool,
    /// Whether goods stand in the yards.
    pub(super) has_yards: bool,
    /// Where a bridge crosses, along the street.
    pub(super) bridge: Option<[f64; 2]>,
    /// Where the street is roofed.
    pub(super) roof: Option<[f64; 2]>,
    pub(super) movers: Movers,
    /// How high the drone flies: low, for its depth camera, where nothing is in its way.
    pub(super) flight_m: f64,
    pub(super) light: Sun,
}

const HOUSES: Houses = Houses {
    width_m: [8.0, 15.0],
    depth_m: [9.0, 13.0],
    storeys: [2.0, 4.0],
    gap_m: [0.0, 0.4],
    setback_m: [0.0, 0.3],
    gabled: 0.6,
    shops: 0.1,
    are_halls: false,
};

const DAY: Sun = Sun {
    elevation_rad: 0.85,
    azimuth_rad: -2.2,
    direct: [0.92, 0.88, 0.80],
    sky: [0.34, 0.38, 0.44],
    exposure: 1.1,
    haze: 0.03,
    seed: 0,
};

const ALLEY: Style = Style {
    lanes: 1,
    lane_m: 3.0,
    speed_mps: 6.0,
    is_marked: false,
    parking_m: [2.1, 2.1],
    parked: 0.5,
    parked_trucks: 0.1,
    pavement_m: [1.8, 1.6],
    bend_m: [0.0, 1.0],
    houses: HOUSES,
    trees_m: 13.0,
    lamps_m: 24.0,
    things_m: 5.0,
    has_gardens: false,
    has_yards: false,
    bridge: None,
    roof: None,
    movers: Movers {
        cars: 4,
        trucks: 1,
        buses: 0,
        cyclists: 5,
        pedestrians: 18,
    },
    flight_m: 5.5,
    light: DAY,
};

/// The style of a street; `None` for the room.
pub(super) fn style(name: Name) -> Option<Style> {
    match name {
        Name::Room => None,
        Name::ResidentialAlley => Some(ALLEY),
        Name::UrbanArterial => Some(arterial()),
        Name::IndustrialPark => Some(industrial()),
        Name::SuburbanRoad => Some(suburban()),
        Name::UnderBridge => Some(under_bridge()),
    }
}

fn arterial() -> Style {
    Style {
        lanes: 2,
        lane_m: 3.25,
        speed_mps: 13.0,
        is_marked: true,
        parking_m: [0.0, 2.9],
        parked: 0.4,
        parked_trucks: 0.2,
        pavement_m: [4.0, 4.0],
        bend_m: [2.0, 160.0],
        houses: Houses {
            width_m: [14.0, 26.0],
            depth_m: [12.0, 18.0],
            storeys: [4.0, 8.0],
            gap_m: [0.0, 5.0],
            setback_m: [0.0, 1.0],
            gabled: 0.1,
            shops: 0.75,
            are_halls: false,
        },
        trees_m: 11.0,
        lamps_m: 26.0,
        things_m: 6.0,
        movers: Movers {
            cars: 14,
            trucks: 3,
            buses: 2,
            cyclists: 8,
            pedestrians: 26,
        },
        light: Sun {
            elevation_rad: 0.95,
            azimuth_rad: -1.2,
            ..DAY
        },
        ..ALLEY
    }
}

fn industrial() -> Style {
    Style {
        lane_m: 3.75,
        speed_mps: 8.0,
        is_marked: true,
        parking_m: [3.1, 2.9],
        parked: 0.24,
        parked_trucks: 0.55,
        pavement_m: [1.5, 2.0],
        houses: Houses {
            width_m: [22.0, 42.0],
            depth_m: [18.0, 30.0],
            storeys: [2.0, 3.6],
            gap_m: [6.0, 14.0],
            setback_m: [5.0, 11.0],
            gabled: 0.4,
            shops: 0.0,
            are_halls: true,
        },
        trees_m: 38.0,
        lamps_m: 34.0,
        things_m: 8.0,
        has_yards: true,
        movers: Movers {
            cars: 5,
            trucks: 4,
            buses: 0,
            cyclists: 2,
            pedestrians: 12,
        },
        // Complex: a low sun across the street, deep shadows beside glaring sheet metal.
        light: Sun {
            elevation_rad: 0.32,
            azimuth_rad: -2.6,
            direct: [1.25, 1.02, 0.74],
            sky: [0.20, 0.25, 0.33],
            exposure: 0.95,
            haze: 0.07,
            seed: 0,
        },
        ..ALLEY
    }
}

fn suburban() -> Style {
    Style {
        lane_m: 3.2,
        speed_mps: 11.0,
        is_marked: true,
        parking_m: [0.0, 0.0],
        parked: 0.0,
        pavement_m: [1.7, 0.0],
        bend_m: [9.0, 190.0],
        houses: Houses {
            width_m: [9.0, 13.0],
            depth_m: [8.0, 11.0],
            storeys: [1.0, 2.3],
            gap_m: [6.0, 16.0],
            setback_m: [5.0, 9.0],
            gabled: 0.9,
            shops: 0.0,
            are_halls: false,
        },
        trees_m: 16.0,
        lamps_m: 40.0,
        things_m: 14.0,
        has_gardens: true,
        movers: Movers {
            cars: 4,
            trucks: 1,
            buses: 1,
            cyclists: 3,
            pedestrians: 6,
        },
        // Against the sun, shortly before it sets.
        light: Sun {
            elevation_rad: 0.13,
            azimuth_rad: 0.12,
            direct: [0.62, 0.36, 0.16],
            sky: [0.13, 0.14, 0.18],
            exposure: 1.6,
            haze: 0.12,
            seed: 0,
        },
        ..ALLEY
    }
}

fn under_bridge() -> Style {
    Style {
        lane_m: 3.2,
        speed_mps: 8.0,
        is_marked: true,
        parking_m: [2.2, 0.0],
        parked: 0.6,
        pavement_m: [2.2, 2.2],
        houses: Houses {
            gap_m: [0.0, 6.0],
            setback_m: [0.5, 3.0],
            gabled: 0.2,
            ..HOUSES
        },
        trees_m: 18.0,
        bridge: Some([25.0, 52.0]),
        roof: Some([72.0, 104.0]),
        movers: Movers {
            cars: 6,
            trucks: 1,
            buses: 1,
            cyclists: 3,
            pedestrians: 14,
        },
        flight_m: 10.0,
        ..ALLEY
    }
}

impl Style {
    /// From the middle to the kerb, at the left (1) or right (-1).
    pub(super) fn kerb_m(&self, side: f64) -> f64 {
        self.lanes as f64 * self.lane_m + self.parking_m[index(side)]
    }

    /// From the middle to where the pavement ends.
    pub(super) fn edge_m(&self, side: f64) -> f64 {
        self.kerb_m(side) + self.pavement_m[index(side)]
    }

    /// Whether a bridge or roof is above that part of the street.
    pub(super) fn is_covered(&self, along: Range<f64>) -> bool {
        let covers = |[from, to]: [f64; 2]| along.start < to + 2.0 && along.end > from - 2.0;
        self.bridge.into_iter().chain(self.roof).any(covers)
    }
}

/// The place of a side in what is listed left, right.
pub(super) fn index(side: f64) -> usize {
    usize::from(side < 0.0)
}
