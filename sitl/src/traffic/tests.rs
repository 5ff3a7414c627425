mod plans;
mod shapes;

use maps::time::Stamp;
use nalgebra::Vector2;

use super::path::{angle, wrapped};
use super::*;
use plans::{LIMIT_MPS, MANY, block, corner, junction, plans, street};
use shapes::{BODY_M, overlap};

/// Every so often until the end of the plan.
fn times(plan: &Plan, step_ms: u64) -> impl Iterator<Item = Stamp> + use<> {
    let end_ms = plan.duration.as_millis() as u64;
    (0..end_ms)
        .step_by(usize::try_from(step_ms).unwrap())
        .map(|ms| Stamp::from_nanos(ms * 1_000_000))
}

#[track_caller]
fn check_nothing_overlaps(name: &str, plan: &Plan, seed: u64) {
    let traffic = Traffic::generate(plan, seed);
    for now in times(plan, 150) {
        let present: Vec<(&Track, State)> = traffic
            .tracks
            .iter()
            .filter_map(|track| Some((track, track.state(now)?)))
            .collect();
        for (i, &a) in present.iter().enumerate() {
            for &b in &present[i + 1..] {
                assert!(
                    !overlap(a, b),
                    "{name}, seed {seed}, {} s: {:?} {:?} and {:?} {:?}",
                    now.as_secs_f64(),
                    a.0.kind,
                    a.1,
                    b.0.kind,
                    b.1
                );
            }
        }
    }
}

#[test]
fn nothing_ever_overlaps() {
    for (name, plan) in plans() {
        for seed in 0..3 {
            check_nothing_overlaps(name, &plan, seed);
        }
    }
}

#[test]
fn speeds_are_within_limits_and_agree_with_positions() {
    let step = Duration::from_millis(20);
    for (name, plan) in plans() {
        for track in Traffic::generate(&plan, 3).tracks {
            let most_mps = match track.kind {
                // A brisk walker, in a hurry on a crossing.
                Kind::Pedestrian => 2.2,
                _ => LIMIT_MPS,
            };
            for now in times(&plan, 330) {
                let Some((a, b)) = track.state(now).zip(track.state(now + step)) else {
                    continue;
                };
                let moved = Vector2::from(b.position) - Vector2::from(a.position);
                let speed_mps = moved.norm() / step.as_secs_f64();
                assert!(
                    speed_mps < most_mps * 1.02 + 0.05,
                    "{name}: {:?} {a:?}",
                    track.kind
                );
                let mean_mps = f64::midpoint(a.speed_mps, b.speed_mps);
                // 8 m/s² over 20 ms.
                assert!((speed_mps - mean_mps).abs() < 0.16, "{name}: {a:?} {b:?}");
                let travelled_m = b.travelled_m - a.travelled_m;
                assert!(travelled_m >= 0.0 && (travelled_m - moved.norm()).abs() < 0.06);
                let turned_rad = b.heading_rad - a.heading_rad;
                assert!(turned_rad.abs() < 0.1, "{name}: turns by {turned_rad} rad");
            }
        }
    }
}

#[test]
fn vehicles_drive_forwards_and_gently() {
    let step = Duration::from_millis(100);
    for (name, plan) in plans() {
        for track in Traffic::generate(&plan, 5).tracks {
            if track.kind == Kind::Pedestrian {
                continue;
            }
            for now in times(&plan, 100) {
                let Some((a, b)) = track.state(now).zip(track.state(now + step)) else {
                    continue;
                };
                let speed_mps = f64::midpoint(a.speed_mps, b.speed_mps);
                let turn_radps = (b.heading_rad - a.heading_rad) / step.as_secs_f64();
                let aside_mps2 = (speed_mps * turn_radps).abs();
                assert!(aside_mps2 < 2.6, "{name}: {aside_mps2} m/s², {a:?}");
                let pull_mps2 = (b.speed_mps - a.speed_mps) / step.as_secs_f64();
                assert!(
                    (-8.5..2.5).contains(&pull_mps2),
                    "{name}: {pull_mps2} m/s², {a:?}"
                );
                let moved = Vector2::from(b.position) - Vector2::from(a.position);
                if speed_mps > 1.0 {
                    let middle_rad = f64::midpoint(a.heading_rad, b.heading_rad);
                    let slip_rad = wrapped(angle(moved) - middle_rad);
                    assert!(slip_rad.abs() < 0.15, "{name}: {slip_rad} rad, {a:?}");
                }
            }
        }
    }
}

#[test]
fn people_stay_on_walkways_and_crossings() {
    for (name, plan) in plans() {
        for track in Traffic::generate(&plan, 1).tracks {
            if track.kind != Kind::Pedestrian {
                continue;
            }
            for now in times(&plan, 100) {
                let place = track.state(now).unwrap().position;
                let on_walkway = plan
                    .walkways
                    .iter()
                    .any(|walkway| walkway.path.nearest(place).distance_m < walkway.width_m / 2.0);
                let on_crossing = plan.crossings.iter().any(|crossing| {
                    let nearest = Path::open(&crossing.ends, 0.0).nearest(place);
                    nearest.distance_m < crossing.width_m.max(1.6) / 2.0
                });
                assert!(on_walkway || on_crossing, "{name}: {place:?} at {now:?}");
            }
        }
    }
}

#[test]
fn people_walk_round_obstacles_and_face_their_way() {
    let plan = street(MANY);
    let (mut passed, mut moving, mut facing) = (0, 0, 0);
    for track in Traffic::generate(&plan, 4).tracks {
        if track.kind != Kind::Pedestrian {
            continue;
        }
        for now in times(&plan, 100) {
            let Some((a, b)) = track
                .state(now)
                .zip(track.state(now + Duration::from_millis(50)))
            else {
                continue;
            };
            for obstacle in &plan.obstacles {
                let distance_m = obstacle.distance_m(a.position);
                assert!(distance_m > BODY_M, "{distance_m} m from {obstacle:?}");
                passed += usize::from(distance_m < 1.0);
            }
            let moved = Vector2::from(b.position) - Vector2::from(a.position);
            if a.speed_mps > 0.5 {
                let aside_rad = wrapped(angle(moved) - a.heading_rad).abs();
                moving += 1;
                facing += usize::from(aside_rad < 0.3);
            }
        }
    }
    assert!(
        passed > 1000,
        "{passed} samples within a metre of an obstacle"
    );
    assert!(facing * 100 > moving * 95, "{facing} of {moving}");
}

/// How many of the people on foot change the side of the street.
fn crossers(plan: &Plan, traffic: &Traffic) -> usize {
    let people = traffic.tracks.iter().filter(|t| t.kind == Kind::Pedestrian);
    people
        .filter(|track| {
            let sides: Vec<f64> = times(plan, 500)
                .filter_map(|now| Some(track.state(now)?.position[1]))
                .collect();
            sides.iter().any(|&y| y > 4.0) && sides.iter().any(|&y| y < -4.0)
        })
        .count()
}

#[test]
fn people_cross_and_cars_stop_for_them() {
    let mut stops = 0;
    for seed in 0..4 {
        let plan = street(MANY);
        let traffic = Traffic::generate(&plan, seed);
        assert!(crossers(&plan, &traffic) >= 5, "seed {seed}");
        for now in times(&plan, 100) {
            let states = |kind: Kind| {
                let tracks = traffic
                    .tracks
                    .iter()
                    .filter(move |track| track.kind == kind);
                tracks.filter_map(move |track| track.state(now))
            };
            let someone_crosses = states(Kind::Pedestrian)
                .any(|s| (s.position[0] - 60.0).abs() < 3.0 && s.position[1].abs() < 2.0);
            if someone_crosses {
                // Within ten metres of the line on the lane that leads east.
                stops += states(Kind::Car)
                    .filter(|s| s.position[1] < 0.0 && (45.0..58.0).contains(&s.position[0]))
                    .filter(|s| s.speed_mps < 0.3)
                    .count();
            }
        }
    }
    assert!(stops > 20, "cars stood for {stops} tenths of a second");
}

#[test]
fn vehicles_do_not_pass_a_red_light() {
    let plan = street(MANY);
    let signal = plan.signals[0];
    for track in Traffic::generate(&plan, 2).tracks {
        if track.kind == Kind::Pedestrian {
            continue;
        }
        let nose = |now: Stamp| {
            let state = track.state(now).filter(|s| s.position[1] < 0.0)?;
            Some(state.position[0] + track.size_m[0] / 2.0)
        };
        for now in times(&plan, 100) {
            let (Some(x), Some(next)) = (nose(now), nose(now + Duration::from_millis(100))) else {
                continue;
            };
            if x <= signal.at_m && next > signal.at_m {
                // Who could not stop in comfort when it turned red has four seconds to pass.
                let green = (0..5).any(|s| signal.is_green(now.as_secs_f64() - f64::from(s)));
                assert!(green, "passed at {} s", now.as_secs_f64());
            }
        }
    }
}

#[test]
fn traffic_keeps_flowing() {
    for (name, plan) in [
        ("street", street(MANY)),
        ("junction", junction()),
        ("block", block(12)),
        ("corner", corner()),
        ("full block", block(400)),
    ] {
        for seed in 0..3 {
            let traffic = Traffic::generate(&plan, seed);
            let travelled = |track: &Track, from_s: u64| {
                times(&plan, 1000)
                    .skip_while(|now| *now < Stamp::from_nanos(from_s * 1_000_000_000))
                    .filter_map(|now| Some(track.state(now)?.travelled_m))
                    .fold([f64::INFINITY, 0.0_f64], |[low, high], m| {
                        [low.min(m), high.max(m)]
                    })
            };
            let mut seen = 0;
            for track in &traffic.tracks {
                let [low, high] = travelled(track, 90);
                let moved_m = if low.is_finite() {
                    high - low
                } else {
                    continue;
                };
                assert!(
                    moved_m > 4.0,
                    "{name}, seed {seed}: {:?} {moved_m} m",
                    track.kind
                );
                seen += 1;
            }
            assert!(seen > 20, "{name}, seed {seed}: {seen} seen");
        }
    }
}

#[test]
fn a_full_lane_holds_no_more_than_it_can() {
    let traffic = Traffic::generate(&block(400), 1);
    let vehicles = traffic
        .tracks
        .iter()
        .filter(|t| t.kind == Kind::Car)
        .count();
    // 2 lanes, 612 m in all, 6.4 m for each and some room to move.
    assert!((60..96).contains(&vehicles), "{vehicles} cars");
    check_nothing_overlaps("full block", &block(400), 1);
}

#[test]
fn cars_pass_cyclists_where_there_is_room_and_follow_them_where_there_is_none() {
    let fastest_mps = |width_m: f64| {
        let plan = Plan {
            lanes: vec![Lane {
                path: Path::closed(
                    &[[-60.0, -60.0], [60.0, -60.0], [60.0, 60.0], [-60.0, 60.0]],
                    30.0,
                ),
                width_m,
                speed_limit_mps: LIMIT_MPS,
            }],
            agents: Agents {
                cars: 4,
                cyclists: 4,
                ..Agents::default()
            },
            ..Plan::default()
        };
        check_nothing_overlaps("cyclists", &plan, 1);
        let traffic = Traffic::generate(&plan, 1);
        let late = Stamp::from_nanos(170_000_000_000);
        let cars = traffic.tracks.iter().filter(|t| t.kind == Kind::Car);
        cars.filter_map(|t| Some(t.state(late)?.speed_mps))
            .fold(0.0, f64::max)
    };
    assert!(fastest_mps(3.5) < 7.0);
    assert!(fastest_mps(5.5) > 8.0);
}

#[test]
fn the_same_seed_gives_the_same_traffic_and_another_seed_another() {
    let plan = street(MANY);
    let bits = |seed: u64| -> Vec<u64> {
        let traffic = Traffic::generate(&plan, seed);
        let now = Stamp::from_nanos(97_654_321_000);
        let states = traffic.tracks.iter().filter_map(|track| track.state(now));
        states
            .flat_map(|s| {
                [
                    s.position[0],
                    s.position[1],
                    s.heading_rad,
                    s.speed_mps,
                    s.travelled_m,
                ]
            })
            .map(f64::to_bits)
            .collect()
    };
    assert_eq!(bits(1), bits(1));
    assert_ne!(bits(1), bits(2));
}

#[test]
fn plans_without_sense_give_little_traffic_and_no_panic() {
    assert!(Traffic::generate(&Plan::default(), 1).tracks.is_empty());
    let nothing = Path::open(&[], 1.0);
    let odd = [
        Path::closed(&[[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]], 5.0),
        Path::open(&[[0.0, 0.0], [f64::NAN, 3.0]], f64::NAN),
        Path::open(&[[0.0, 0.0], [1e12, 0.0]], 1.0),
        Path::open(&[[0.0, 0.0], [60.0, 0.0], [0.0, 0.1]], 3.0),
        Path::closed(&[[0.0, 0.0], [50.0, 0.0], [50.0, 50.0], [25.0, -25.0]], 3.0),
        nothing,
    ];
    for path in odd {
        let plan = Plan {
            lanes: vec![Lane {
                path: path.clone(),
                width_m: f64::NAN,
                speed_limit_mps: 10.0,
            }],
            walkways: vec![Walkway {
                path,
                width_m: -1.0,
            }],
            crossings: vec![Crossing {
                ends: [[0.0, f64::NAN], [0.0, 0.0]],
                width_m: f64::NAN,
                priority: Priority::Pedestrians,
            }],
            signals: vec![Signal {
                lane: 7,
                at_m: f64::NAN,
                cycle_s: 0.0,
                green_from_s: 0.0,
                green_for_s: 0.0,
            }],
            obstacles: vec![Obstacle::Circle {
                centre: [f64::NAN; 2],
                radius_m: -1.0,
            }],
            guest: Some(Guest {
                lane: 0,
                at_m: f64::NAN,
            }),
            agents: Agents {
                cars: 3,
                buses: 2,
                cyclists: 2,
                pedestrians: 5,
                ..Agents::default()
            },
            duration: Duration::from_secs(20),
        };
        for track in Traffic::generate(&plan, 1).tracks {
            if let Some(state) = track.state(Stamp::from_nanos(10_000_000_000)) {
                assert!(state.position.iter().all(|x| x.is_finite()), "{state:?}");
            }
        }
    }
}

#[test]
fn a_guest_starts_at_rest_where_it_is_asked_and_stays_at_the_end_of_its_lane() {
    let lane = 0;
    let at_m = 40.0;
    let plan = Plan {
        guest: Some(Guest { lane, at_m }),
        ..street(MANY)
    };
    for seed in 0..3 {
        check_nothing_overlaps("street with a guest", &plan, seed);
        let traffic = Traffic::generate(&plan, seed);
        let guest = &traffic.tracks[0];
        assert_eq!(guest.kind, Kind::Robot);
        let path = &plan.lanes[lane].path;
        let start = guest.state(Stamp::ZERO).expect("there from the start");
        assert!((path.nearest(start.position).along_m - at_m).abs() < 0.01);
        let places: Vec<f64> = times(&plan, 1000)
            .map_while(|at| guest.state(at))
            .map(|state| path.nearest(state.position).along_m)
            .collect();
        assert!(places.len() > 170, "never away: {}", places.len());
        assert!(places.is_sorted_by(|a, b| a <= &(b + 1e-3)));
        let last = places.last().expect("places");
        assert!(
            path.length_m() - last < 3.0,
            "seed {seed}: {last} m of {}",
            path.length_m()
        );
    }
}
