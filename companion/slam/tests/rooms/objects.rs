//! What a detector and features add to the depth image: claims about people who stand, things that stand, and what
//! slides.

use super::*;
use crate::scene::taken_at;
use slam::{Aid, Mapping, Mobility, Object, Overlay, PixelMask, Seen};

/// A person, about, who stands still from the first frame on.
const STANDING: Block = Block {
    min: [1.9, -0.2, 0.0],
    max: [2.2, 0.3, 1.7],
};

/// The smallest box around a block in the image of frame `i`, and this much more on each side.
fn bounds(block: &Block, i: u64, more: f32) -> [f32; 4] {
    let camera_from_world = walk(i).inverse();
    let mut bounds = [f32::MAX, f32::MAX, f32::MIN, f32::MIN];
    for corner in 0..8 {
        let pick = |axis: usize| {
            if corner >> axis & 1 == 0 {
                block.min[axis]
            } else {
                block.max[axis]
            }
        };
        let p = camera_from_world * point(pick(0), pick(1), pick(2));
        let [u, v] = CAMERA
            .project(p)
            .expect("in front of the camera")
            .map(|v| v as f32);
        bounds = [
            bounds[0].min(u - more),
            bounds[1].min(v - more),
            bounds[2].max(u + more),
            bounds[3].max(v + more),
        ];
    }
    bounds
}

fn object(mobility: Mobility, bounds_px: [f32; 4]) -> Object {
    Object {
        mobility,
        score: 0.9,
        bounds_px,
        mask: None,
    }
}

/// Runs through frames in which a detector sees, every `every`th time, what `seen` says.
fn run_with(
    slam: &mut Slam,
    (frames, every): (u64, u64),
    blocks: impl Fn(u64) -> Vec<Block>,
    seen: impl Fn(u64) -> Vec<Object>,
) -> Vec<Tracked> {
    run_late(slam, (frames, every, 0), blocks, seen)
}

/// The same with a detector that answers `late` frames later.
fn run_late(
    slam: &mut Slam,
    (frames, every, late): (u64, u64, u64),
    blocks: impl Fn(u64) -> Vec<Block>,
    seen: impl Fn(u64) -> Vec<Object>,
) -> Vec<Tracked> {
    let track = |i: u64| {
        let of = i.checked_sub(late).filter(|of| of.is_multiple_of(every));
        let objects = of.map(&seen).unwrap_or_default();
        let aid = Aid {
            objects: of.map(|of| Seen {
                of: taken_at(of),
                objects: &objects,
            }),
            ..Aid::default()
        };
        slam.track_aided(&render(i, walk(i), &blocks(i)), &aid)
            .expect("a good frame")
    };
    (0..frames).map(track).collect()
}

fn dense(slam: &mut Slam) -> Vec<DenseKeyframe> {
    let mut dense = slam.take_keyframes().keyframes;
    let last = slam.finish();
    if last.anew {
        dense.clear();
    }
    dense.extend(last.keyframes);
    dense
}

/// Dense points on a block, clear of the floor.
fn points_on(block: &Block, dense: &[DenseKeyframe]) -> usize {
    let clear = Block {
        min: [block.min[0], block.min[1], 0.15],
        max: block.max,
    };
    let points = dense
        .iter()
        .flat_map(|k| k.points().map(|(p, _)| k.world_from_camera * p));
    points.filter(|p| clear.contains(*p, 0.05)).count()
}

/// Whether the overlay says that the pixel moves.
fn moves(overlay: &Overlay, [x, y]: [f32; 2]) -> bool {
    let (column, row) = (x as usize / overlay.cell_px, y as usize / overlay.cell_px);
    overlay.moving[row * overlay.cells_across + column]
}

#[test]
fn somebody_who_stands_still_from_the_start_is_kept_out_by_a_detector_at_ten_frames_a_second() {
    let person = |i| vec![object(Mobility::Dynamic, bounds(&STANDING, i, 4.0))];
    let mut slam = slam();
    let outcomes = run_with(&mut slam, (60, 3), |_| vec![TABLE, STANDING], person);
    for (i, outcome) in (0..).zip(&outcomes) {
        assert_eq!(outcome.state, State::Tracking, "frame {i}");
        assert!(
            outcome.moving_share > 0.02,
            "frame {i}: {} of it moves",
            outcome.moving_share
        );
        assert!(
            apart(outcome.world_from_camera, truth(i)).0 < 0.03,
            "frame {i}"
        );
    }
    assert_eq!(points_on(&STANDING, &dense(&mut slam)), 0);
}

#[test]
fn somebody_who_stands_still_is_kept_out_by_a_detector_that_answers_three_frames_late() {
    let person = |i| vec![object(Mobility::Dynamic, bounds(&STANDING, i, 4.0))];
    let mut slam = slam();
    let outcomes = run_late(&mut slam, (60, 3, 3), |_| vec![TABLE, STANDING], person);
    for (i, outcome) in (0..).zip(&outcomes) {
        assert_eq!(outcome.state, State::Tracking, "frame {i}");
        assert_eq!(
            outcome.moving_share > 0.02,
            i >= 3,
            "frame {i}: {} of it moves",
            outcome.moving_share
        );
    }
    assert_eq!(slam.unheard(), 0);
    assert!(outcomes[0].keyframe, "which had no answer when it was made");
    assert_eq!(points_on(&STANDING, &dense(&mut slam)), 0);
}

#[test]
fn an_answer_is_heard_as_long_as_its_frame_is_kept_and_then_counted_as_unheard() {
    let person = |i| vec![object(Mobility::Dynamic, bounds(&STANDING, i, 4.0))];
    let kept = Seen::KEPT as u64;
    for (late, unheard) in [(kept, 0), (kept + 1, 1)] {
        let mut slam = slam();
        let frames = (late + 1, 100, late);
        let outcomes = run_late(&mut slam, frames, |_| vec![TABLE, STANDING], person);
        assert_eq!(slam.unheard(), unheard, "{late} frames late");
        let last = &outcomes[late as usize];
        assert_eq!(
            last.moving_share > 0.02,
            unheard == 0,
            "{late} frames late: {}",
            last.moving_share
        );
    }
}

#[test]
fn an_answer_older_than_one_that_was_heard_changes_nothing() {
    let outcomes = [false, true].map(|tells_old| {
        let mut slam = slam();
        let track = |i: u64| {
            let person = [object(Mobility::Dynamic, bounds(&STANDING, i, 4.0))];
            let aid = Aid {
                objects: match i {
                    5 => Some(Seen {
                        of: taken_at(5),
                        objects: &person,
                    }),
                    6 if tells_old => Some(Seen {
                        of: taken_at(4),
                        objects: &[],
                    }),
                    _ => None,
                },
                ..Aid::default()
            };
            let frame = render(i, walk(i), &[TABLE, STANDING]);
            slam.track_aided(&frame, &aid).expect("a good frame")
        };
        let outcomes: Vec<_> = (0..10).map(track).collect();
        assert_eq!(slam.unheard(), u64::from(tells_old));
        outcomes
    });
    let [plain, told] = &outcomes;
    assert!(plain == told);
    assert!(plain[9].moving_share > 0.02);
}

#[test]
fn a_parked_car_stays_in_the_map_of_a_detector_that_answers_late() {
    let car = |i| vec![object(Mobility::Potential, bounds(&STANDING, i, 4.0))];
    let mut slam = slam();
    let outcomes = run_late(&mut slam, (60, 3, 3), |_| vec![TABLE, STANDING], car);
    assert!(outcomes.iter().all(|o| o.moving_share < 1e-9));
    assert!(points_on(&STANDING, &dense(&mut slam)) > 1000);
}

#[test]
fn somebody_who_stands_still_serves_tracking_once_witnesses_know_them() {
    let person = |i| vec![object(Mobility::Dynamic, bounds(&STANDING, i, 4.0))];
    let mut slam = slam();
    let outcomes = run_with(&mut slam, (60, 1), |_| vec![TABLE, STANDING], person);
    let [left, top, right, bottom] = bounds(&STANDING, 59, 0.0);
    let overlay = slam.overlay();
    let on_them = |p: &&[f32; 2]| (left..right).contains(&p[0]) && (top..bottom).contains(&p[1]);
    let rejected = overlay.rejected.iter().filter(on_them).count();
    let all = rejected + overlay.tracked.iter().filter(on_them).count();
    assert!(
        all > 10 && 4 * rejected < all,
        "{rejected} of {all} rejected"
    );
    assert!(outcomes[59].moving_share > 0.02, "but they are not mapped");
}

#[test]
fn somebody_who_stands_still_from_the_start_is_furniture_to_geometry() {
    let mut slam = slam();
    let outcomes = run(&mut slam, 60, |_| vec![TABLE, STANDING]);
    assert!(outcomes.iter().all(|o| o.moving_share < 1e-9));
    assert!(
        points_on(&STANDING, &dense(&mut slam)) > 1000,
        "else the test above shows nothing"
    );
}

#[test]
fn the_wall_in_the_box_of_a_person_is_kept() {
    let mut slam = slam();
    let person = |i| vec![object(Mobility::Dynamic, bounds(&STANDING, i, 25.0))];
    run_with(&mut slam, (12, 1), |_| vec![TABLE, STANDING], person);
    let overlay = slam.overlay();
    let [left, top, right, bottom] = bounds(&STANDING, 11, 0.0);
    let middle = f32::midpoint(top.max(0.0), bottom);
    assert!(
        moves(&overlay, [f32::midpoint(left, right), middle]),
        "the person"
    );
    for x in [left - 20.0, right + 20.0] {
        assert!(!moves(&overlay, [x, middle]), "the wall at {x}");
    }
}

#[test]
fn a_mask_says_better_than_the_depth_what_belongs_to_a_person() {
    let mut slam = slam();
    let masked = |i| {
        let mut person = object(Mobility::Dynamic, bounds(&STANDING, i, 25.0));
        // Only the wall on the left of the person, by the mask.
        let [left, ..] = bounds(&STANDING, i, 0.0);
        let inside = vec![true; 12 * 60];
        let corner = [left as usize - 22, 80];
        person.mask = Some(PixelMask::new(corner, [12, 60], &inside).expect("as many"));
        vec![person]
    };
    run_with(&mut slam, (12, 1), |_| vec![TABLE, STANDING], masked);
    let overlay = slam.overlay();
    let [left, _, right, _] = bounds(&STANDING, 11, 0.0);
    assert!(
        moves(&overlay, [left - 16.0, 110.0]),
        "what the mask covers"
    );
    assert!(
        !moves(&overlay, [f32::midpoint(left, right), 110.0]),
        "what it does not"
    );
}

#[test]
fn a_parked_car_stays_in_the_map() {
    let mut slam = slam();
    let car = |i| vec![object(Mobility::Potential, bounds(&STANDING, i, 4.0))];
    let outcomes = run_with(&mut slam, (60, 1), |_| vec![TABLE, STANDING], car);
    assert!(outcomes.iter().all(|o| o.moving_share < 1e-9));
    assert!(points_on(&STANDING, &dense(&mut slam)) > 1000);
}

#[test]
fn nonsense_from_a_detector_changes_nothing() {
    let nonsense = |_| {
        let boxes = [
            [f32::NAN, 0.0, 50.0, 50.0],
            [0.0, 0.0, f32::INFINITY, 50.0],
            [80.0, 80.0, 20.0, 20.0],
            [-90.0, -90.0, -20.0, -20.0],
            [900.0, 900.0, 2000.0, 2000.0],
        ];
        let mut objects: Vec<_> = boxes.map(|b| object(Mobility::Dynamic, b)).into();
        let mut unsure = object(Mobility::Dynamic, [50.0, 50.0, 200.0, 200.0]);
        unsure.score = f32::NAN;
        objects.push(unsure);
        objects
    };
    let (mut plain, mut told) = (slam(), slam());
    let expected = run(&mut plain, 30, walker);
    assert!(run_with(&mut told, (30, 1), walker, nonsense) == expected);
}

/// A poster on a screen, which slides to and fro from frame 30 on without leaving a trace in the depth image.
fn poster(i: u64) -> Vec<Block> {
    let steps = i.saturating_sub(30) % 32;
    let y = -0.3 + 0.045 * steps.min(32 - steps) as f64;
    vec![
        Block {
            min: [2.0, -1.3, 0.0],
            max: [2.2, 1.3, 1.6],
        },
        Block {
            min: [1.98, y - 0.45, 0.3],
            max: [2.0, y + 0.45, 1.2],
        },
    ]
}

#[test]
fn what_slides_along_a_wall_is_known_by_its_features() {
    let mut slam = slam();
    let outcomes = run(&mut slam, 60, poster);
    let (before, after) = outcomes.split_at(30);
    assert!(
        before.iter().all(|o| o.moving_share < 1e-9),
        "it hangs still"
    );
    let sliding = after.iter().filter(|o| o.moving_share > 0.02).count();
    assert!(sliding >= 20, "only {sliding} of 30 frames say so");
}

#[test]
fn the_papers_scheme_drops_what_moves_by_its_kind_and_keeps_what_stands() {
    let settings = Settings {
        moving: Moving::Paper,
        ..Settings::default()
    };
    let mobilities = [Mobility::Dynamic, Mobility::Potential, Mobility::Static];
    for (mobility, dropped) in mobilities.into_iter().zip([true, false, false]) {
        let mut slam = Slam::new(CAMERA, settings.clone());
        let seen = |i| vec![object(mobility, bounds(&STANDING, i, 4.0))];
        let outcomes = run_with(&mut slam, (40, 1), |_| vec![TABLE, STANDING], seen);
        let moving = outcomes.iter().filter(|o| o.moving_share > 0.02).count();
        assert_eq!(moving, if dropped { 40 } else { 0 }, "{mobility:?}");
        assert_eq!(
            points_on(&STANDING, &dense(&mut slam)) == 0,
            dropped,
            "{mobility:?}"
        );
    }
}

#[test]
fn the_papers_scheme_tells_what_moves_across_its_epipolar_lines_from_what_stands() {
    let settings = Settings {
        moving: Moving::Paper,
        ..Settings::default()
    };
    let mut slam = Slam::new(CAMERA, settings);
    // The camera goes sideways, and the lift up and down.
    let lift = |i: u64| {
        let steps = i.saturating_sub(30) % 30;
        let z = 0.3 + 0.05 * steps.min(30 - steps) as f64;
        Block {
            min: [1.9, -0.4, z],
            max: [2.2, 0.4, z + 0.8],
        }
    };
    let seen = |i| vec![object(Mobility::Potential, bounds(&lift(i), i, 4.0))];
    let outcomes = run_with(&mut slam, (60, 1), |i| vec![TABLE, lift(i)], seen);
    let moving = |outcomes: &[Tracked]| outcomes.iter().filter(|o| o.moving_share > 0.02).count();
    assert_eq!(moving(&outcomes[..30]), 0, "it stands");
    let told = moving(&outcomes[30..]);
    assert!(told >= 24, "only in {told} of 30 frames");
}

#[test]
fn without_a_detector_the_papers_scheme_drops_nothing() {
    let settings = Settings {
        moving: Moving::Paper,
        ..Settings::default()
    };
    let mut slam = Slam::new(CAMERA, settings);
    let outcomes = run(&mut slam, 80, walker);
    assert!(outcomes.iter().all(|o| o.moving_share < 1e-9));
}

#[test]
fn the_plain_baseline_follows_the_camera_with_the_last_keyframe_alone() {
    let settings = Settings {
        moving: Moving::Ignore,
        mapping: Mapping::LastKeyframe,
        ..Settings::default()
    };
    let mut slam = Slam::new(CAMERA, settings);
    for i in 0..75 {
        let outcome = slam
            .track(&render(i, walk(i), &[TABLE]))
            .expect("a good frame");
        assert_eq!(outcome.state, State::Tracking, "frame {i}");
        assert!(
            apart(outcome.world_from_camera, truth(i)).0 < 0.1,
            "frame {i}"
        );
        assert_eq!(slam.map_size().1, 1, "keyframes at frame {i}");
    }
    assert_eq!(slam.trajectory().len(), 75);
    assert!(!slam.finish().keyframes.is_empty());
}
