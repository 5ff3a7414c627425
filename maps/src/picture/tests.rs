use super::*;
use crate::palette;
use crate::voxel::{ClassId, LogOdds, Rgb, Voxel};

const REQUEST: Request<'_> = Request {
    paint: Paint::Height,
    title: "a room",
    width: 640,
    height: 480,
    ceiling_m: None,
};

/// A floor of 4 m by 4 m with a wall along its north side, 2 m high, and a ceiling.
fn room() -> VoxelMap {
    let mut map = VoxelMap::new(0.1);
    for i in 0..40 * 40 {
        let (x, y) = (i % 40, i / 40);
        for (key, class, color) in [
            (VoxelKey::new(x, y, 0), 1, [255, 0, 0]),
            (VoxelKey::new(x, 39, y.min(20)), 2, [0, 255, 0]),
            (VoxelKey::new(x, y, 20), 3, [0, 0, 255]),
        ] {
            let voxel = Voxel {
                color: Some(Rgb(color)),
                class: ClassId(class),
                ..Voxel::new(LogOdds::MAX)
            };
            map.set_voxel(key, voxel);
        }
    }
    map
}

/// How many pixels are nearer to this colour than 40 in each channel.
fn count_like(picture: &Picture, color: [u8; 3]) -> usize {
    let near = |pixel: &[u8]| pixel.iter().zip(color).all(|(a, b)| a.abs_diff(b) < 40);
    picture
        .rgb
        .chunks_exact(3)
        .filter(|pixel| near(pixel))
        .count()
}

#[test]
fn from_above_the_ceiling_hides_the_floor_until_it_is_taken_off() {
    let covered = Request {
        paint: Paint::Color,
        ..REQUEST
    };
    let open = Request {
        ceiling_m: Some(1.9),
        ..covered
    };
    let [covered, open] = [covered, open].map(|request| sheet(&room(), &request).expect("a room"));
    let (red, blue) = ([235, 10, 10], [10, 10, 235]);
    // From aside the edge of the floor shows in either.
    let counts = [&covered, &open].map(|picture| [red, blue].map(|c| count_like(picture, c)));
    let [[edges, ceiling], [floor, none]] = counts;
    assert!(ceiling > 5000 && edges < floor / 4, "{counts:?}");
    assert!(floor > 5000 && none == 0, "{counts:?}");
}

#[test]
fn classes_are_drawn_in_the_colours_of_the_palette() {
    let request = Request {
        paint: Paint::Class,
        ceiling_m: Some(1.9),
        ..REQUEST
    };
    let picture = sheet(&room(), &request).expect("a room");
    let of = |class| palette::color_of(ClassId(class)).map(|c| count_like(&picture, c.0));
    assert!(
        of(1) > Some(5000) && of(2) > Some(1000),
        "{:?} {:?}",
        of(1),
        of(2)
    );
    assert_eq!(of(3), Some(0));
}

#[test]
fn a_measure_is_drawn_from_low_to_high() {
    let of = |key: VoxelKey| (key.x < 20).then_some(1.0);
    let measure = Measure {
        name: "conflict",
        low: 0.0,
        high: 1.0,
        of: &of,
    };
    let request = Request {
        paint: Paint::Measure(measure),
        ..REQUEST
    };
    let picture = sheet(&room(), &request).expect("a room");
    let [high, low] = [1.0, 0.0].map(|t| count_like(&picture, palette::ramp(t)));
    assert!(
        high > 4000 && low < 500,
        "{high} and {low}, of the legend alone"
    );
}

#[test]
fn the_same_map_gives_the_same_picture() {
    assert_eq!(sheet(&room(), &REQUEST), sheet(&room(), &REQUEST));
}

#[test]
fn a_stray_voxel_does_not_shrink_the_map() {
    let mut map = room();
    let plain = count_like(&sheet(&map, &REQUEST).expect("a room"), canvas::PAPER);
    map.set_voxel(VoxelKey::new(20_000, 0, 0), Voxel::new(LogOdds::MAX));
    let stray = count_like(&sheet(&map, &REQUEST).expect("a room"), canvas::PAPER);
    assert!(
        stray < plain + plain / 20,
        "{stray} pixels of paper, {plain} without"
    );
}

#[test]
fn what_cannot_be_drawn_is_said() {
    let refused = |map: &VoxelMap, request: Request<'_>| {
        sheet(map, &request)
            .map_err(|e| e.to_string())
            .expect_err("nothing to draw")
    };
    let mut map = VoxelMap::new(0.1);
    map.set_voxel(VoxelKey::new(0, 0, 0), Voxel::new(LogOdds::MIN));
    assert_eq!(
        refused(&map, REQUEST),
        "no voxel of the map is occupied: there is nothing to draw"
    );
    map.set_voxel(VoxelKey::new(0, 0, 5), Voxel::new(LogOdds::MAX));
    assert!(sheet(&map, &REQUEST).is_ok(), "one voxel is enough");
    assert_eq!(
        refused(
            &map,
            Request {
                ceiling_m: Some(0.3),
                ..REQUEST
            }
        ),
        "no voxel is occupied below 0.3 m: the lowest one reaches 0.60 m"
    );
    assert_eq!(
        refused(
            &map,
            Request {
                paint: Paint::Class,
                ..REQUEST
            }
        ),
        "no voxel of the map has a class"
    );
    assert_eq!(
        refused(
            &map,
            Request {
                paint: Paint::Color,
                ..REQUEST
            }
        ),
        "no voxel of the map has a colour"
    );
    assert_eq!(
        refused(
            &map,
            Request {
                width: 9000,
                ..REQUEST
            }
        ),
        "a picture of 9000 x 480 pixels: each must be 480 to 8192"
    );
    assert_eq!(
        refused(
            &map,
            Request {
                ceiling_m: Some(f64::NAN),
                ..REQUEST
            }
        ),
        "no voxel is occupied below NaN m: the lowest one reaches 0.60 m"
    );
}
