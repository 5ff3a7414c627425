//! A picture of a map without a window: of an `OctoMap` file, or of a furnished room made up here.
//!
//! ```text
//! voxel_view OUT.png [MAP.bt] [--height] [--top] [--cut METRES] [--observed]
//! ```

use std::collections::BTreeSet;
use std::fs::File;
use std::io::BufWriter;
use std::sync::Arc;

use anyhow::{Context as _, ensure};
use clap::Parser;
use groundstation::render::{
    Camera3, Coloring, Frame, Freshness, GoalMarker, GroundCell, Marker, MarkerKind, Offscreen,
    Overlay, Polyline, Scene, Stroke, Surfaces, Viewport,
};
use maps::frame::{Isometry, Point, Vector, World};
use maps::scan::Scan;
use maps::voxel::{Rgb, VoxelMap};
use nalgebra::{Translation3, UnitQuaternion, Vector3};

#[derive(Parser)]
struct Arguments {
    /// Where the picture goes.
    out: std::path::PathBuf,
    /// An `OctoMap` binary tree.
    map: Option<std::path::PathBuf>,
    /// Colours by height.
    #[arg(long)]
    height: bool,
    /// From straight above.
    #[arg(long)]
    top: bool,
    /// Leaves out what is higher than this, in metres.
    #[arg(long)]
    cut: Option<f64>,
    /// Leaves out sides that no sensor has seen.
    #[arg(long)]
    observed: bool,
    /// Degrees from east in which to look.
    #[arg(long, default_value_t = 62.0)]
    heading: f64,
    /// Degrees below the horizon.
    #[arg(long, default_value_t = 42.0)]
    pitch: f64,
    /// Draws this often from slightly different sides, to measure.
    #[arg(long, default_value_t = 1)]
    frames: u32,
    /// How near to go once everything fits.
    #[arg(long, default_value_t = 1.0)]
    zoom: f64,
}

#[expect(clippy::print_stdout, reason = "the example's user reads it")]
fn main() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    let map = match &arguments.map {
        Some(path) => {
            let file =
                File::open(path).with_context(|| format!("cannot open {}", path.display()))?;
            octomap::read_bt(std::io::BufReader::new(file))
                .with_context(|| format!("cannot read {}", path.display()))?
        }
        None => room(),
    };
    let mut scene = Scene::default();
    scene.clip_above_m = arguments.cut;
    if arguments.height {
        scene.look.coloring = Coloring::Height;
    }
    if arguments.observed {
        scene.look.surfaces = Surfaces::Observed;
    }
    scene.update_map(&map, &map.tile_ids());
    if arguments.map.is_none() {
        furnish_with_a_mission(&mut scene);
    }
    let (low, high) = scene.bounds().context("the map is empty")?;
    let size_px = [1280, 800];
    let viewport = Viewport {
        width: f64::from(size_px[0]),
        height: f64::from(size_px[1]),
    };
    let mut camera = Camera3::looking_at(
        Point::origin(),
        arguments.heading.to_radians(),
        arguments.pitch.to_radians(),
        10.0,
    );
    if arguments.top {
        camera = camera.top_down();
    }
    camera = camera.fitted(low, high, viewport);
    camera = camera.zoomed(camera.target(), 1.0 / arguments.zoom);

    let quads = scene.quads();
    let mut device = Offscreen::new()?;
    let mut frame = Frame {
        scene: Arc::new(scene),
        camera,
        size_px,
    };
    ensure!(arguments.frames > 0, "nothing to draw");
    for _ in 1..arguments.frames {
        device.render(&frame)?;
        frame.camera = frame.camera.orbited(camera.target(), 1e-3, 0.0);
    }
    let image = device.render(&frame)?;
    println!("{quads} quads on {}", device.device_name());
    let file = File::create(&arguments.out)
        .with_context(|| format!("cannot write {}", arguments.out.display()))?;
    image.write_png(BufWriter::new(file))?;
    Ok(())
}

/// A box in the room: two corners and a colour.
type Block = ([f64; 3], [f64; 3], [u8; 3]);

const WALL: [u8; 3] = [196, 192, 182];
const WOOD: [u8; 3] = [158, 116, 74];
const BLOCKS: [Block; 17] = [
    ([-3.0, -2.5, -0.1], [3.0, 2.5, 0.0], [142, 132, 118]),
    ([-3.1, -2.6, 0.0], [-3.0, 2.6, 2.5], WALL),
    ([3.0, -2.6, 0.0], [3.1, 2.6, 2.5], WALL),
    ([-3.0, 2.5, 0.0], [3.0, 2.6, 2.5], [178, 186, 190]),
    ([-3.0, -2.6, 0.0], [3.0, -2.5, 2.5], [178, 186, 190]),
    ([-3.1, -2.6, 2.5], [3.1, 2.6, 2.6], [225, 224, 218]),
    // A table with legs.
    ([0.6, 0.2, 0.70], [2.2, 1.2, 0.76], WOOD),
    ([0.65, 0.25, 0.0], [0.72, 0.32, 0.7], WOOD),
    ([2.08, 0.25, 0.0], [2.15, 0.32, 0.7], WOOD),
    ([0.65, 1.08, 0.0], [0.72, 1.15, 0.7], WOOD),
    ([2.08, 1.08, 0.0], [2.15, 1.15, 0.7], WOOD),
    // A monitor, a shelf, a sofa, a box, a plant.
    ([1.1, 0.8, 0.78], [1.7, 0.85, 1.15], [42, 46, 54]),
    ([-2.95, -0.8, 0.0], [-2.6, 1.0, 1.9], [120, 84, 56]),
    ([-1.9, -2.4, 0.0], [0.1, -1.65, 0.42], [70, 96, 128]),
    ([-1.9, -2.45, 0.4], [0.1, -2.2, 0.85], [70, 96, 128]),
    ([-1.0, 1.2, 0.0], [-0.5, 1.7, 0.5], [196, 148, 60]),
    ([2.3, -2.2, 0.0], [2.65, -1.85, 1.3], [72, 122, 66]),
];

/// What a camera that looks around in four places sees of the room.
fn room() -> VoxelMap {
    let mut map = VoxelMap::new(0.05);
    for (x, y) in [(-0.3, -0.9), (2.3, -0.6), (-2.0, 1.9), (0.2, 1.9)] {
        let origin = Point::new(x, y, 1.5);
        let (mut hits, mut colors) = (Vec::new(), Vec::new());
        for up in -250..250 {
            for around in 0..1200 {
                let (sin, cos) = (f64::from(around) * std::f64::consts::TAU / 1200.0).sin_cos();
                let (rise, level) = (f64::from(up) * std::f64::consts::PI / 500.0).sin_cos();
                let direction = Vector::new(cos * level, sin * level, rise);
                if let Some((m, color)) = first_hit(origin, direction) {
                    let hit = origin + direction * (m + 0.01);
                    hits.push(hit);
                    colors.push(Rgb(textured(color, hit)));
                }
            }
        }
        map.insert_scan(&Scan {
            colors: &colors,
            max_range_m: 20.0,
            ..Scan::new(origin, &hits)
        });
    }
    map
}

fn first_hit(origin: Point<World>, direction: Vector<World>) -> Option<(f64, [u8; 3])> {
    BLOCKS
        .iter()
        .filter_map(|(low, high, color)| {
            let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
            for axis in 0..3 {
                let per_m = 1.0 / direction.raw[axis];
                let a = (low[axis] - origin.raw[axis]) * per_m;
                let b = (high[axis] - origin.raw[axis]) * per_m;
                (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
            }
            (enter > 0.0 && enter < leave).then_some((enter, *color))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
}

/// Boards on the floor, books on the shelf, a little unevenness everywhere.
fn textured(color: [u8; 3], at: Point<World>) -> [u8; 3] {
    let [x, y, z] = [at.raw.x, at.raw.y, at.raw.z].map(|c| (c * 20.0).floor() as i64);
    let noise =
        ((x * 73_856_093) ^ (y * 19_349_663) ^ (z * 83_492_791)).rem_euclid(17) as f64 - 8.0;
    let stripe = if z <= 0 && y.rem_euclid(4) == 0 {
        -16.0
    } else {
        0.0
    };
    color.map(|c| (f64::from(c) + noise + stripe).clamp(0.0, 255.0) as u8)
}

fn furnish_with_a_mission(scene: &mut Scene) {
    const BLUE: [u8; 3] = [64, 132, 255];
    const VIOLET: [u8; 3] = [170, 96, 240];
    let pose = |x: f64, y: f64, z: f64, heading: f64| {
        Isometry::claim(nalgebra::Isometry3::from_parts(
            Translation3::new(x, y, z),
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading),
        ))
    };
    let marker = |kind, world_from_body, color| Marker {
        kind,
        world_from_body,
        color,
        length_m: 0.42,
        freshness: Freshness::Fresh,
        selected: false,
    };
    scene.markers = vec![
        marker(MarkerKind::Copter, pose(0.2, -0.4, 1.4, 0.6), BLUE),
        Marker {
            selected: true,
            ..marker(MarkerKind::Rover, pose(-2.1, -1.2, 0.0, 0.3), VIOLET)
        },
        Marker {
            freshness: Freshness::Stale { radius_m: 0.6 },
            ..marker(MarkerKind::Rover, pose(1.9, -1.2, 0.0, 2.2), [40, 170, 160])
        },
    ];
    let path: Vec<_> = (0..=40)
        .map(|i| {
            let t = f64::from(i) / 40.0;
            Point::new(
                -2.1 + 4.4 * t,
                -1.2 + 1.1 * (4.5 * t).sin() * t + 1.2 * t * t,
                0.02,
            )
        })
        .collect();
    scene.goal = path.last().map(|&position| GoalMarker {
        position,
        heading_rad: Some(0.4),
        color: VIOLET,
    });
    let survey = [
        [-2.0, -1.0],
        [2.0, -1.0],
        [2.0, 0.0],
        [-2.0, 0.0],
        [-2.0, 1.0],
        [2.0, 1.0],
    ]
    .map(|[x, y]| Point::new(x, y, 1.4));
    let line = |points, [r, g, b]: [u8; 3], stroke| Polyline {
        points,
        color: [r, g, b, 255],
        width_px: 3.0,
        stroke,
    };
    scene.lines = vec![
        line(path, VIOLET, Stroke::Solid),
        line(survey.to_vec(), BLUE, Stroke::Dashed { length_m: 0.1 }),
    ];
    scene.overlay = Some(Arc::new(drivable()));
}

/// Squares as a planner would colour them.
fn drivable() -> Overlay {
    let blocked: BTreeSet<(i32, i32)> = (-6..6).flat_map(|x| [(x, -10), (x, 9)]).collect();
    let cells = (-10..10)
        .flat_map(|y| (-12..12).map(move |x| (x, y)))
        .map(|(x, y)| GroundCell {
            center: Point::new(
                f64::from(x) * 0.25 + 0.125,
                f64::from(y) * 0.25 + 0.125,
                0.0,
            ),
            color: if blocked.contains(&(x, y)) {
                [230, 140, 40, 70]
            } else {
                [60, 200, 190, 46]
            },
        })
        .collect();
    Overlay {
        cell_m: 0.25,
        cells,
    }
}
