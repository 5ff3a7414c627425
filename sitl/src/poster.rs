//! A contact sheet: what all sensors see of a scene at one moment, beside the truth, in one picture to look at.
//!
//! ```text
//! drone: colour       depth            classes
//! ground: front       left             rear              right        (colour, below it classes)
//! LiDAR from above    street from above (truth)   voxels from above (truth)   occlusion of road users
//! ```

use maps::frame::{Camera, Isometry, World};
use maps::time::Stamp;

pub use crate::palette::Canvas;

use crate::depth_camera::d455;
use crate::lidar::Lidar;
use crate::palette::{Above, classes, colours, depths};
use crate::platform;
use crate::rays::Rays;
use crate::render::{Moment, Picture, Stage};
use crate::scene::{Name, Scene};

/// Between panels.
const GAP: usize = 6;
/// The width of one of four panels side by side.
const PANEL: usize = 368;
const BACKGROUND: [u8; 3] = [24, 26, 30];

/// A camera's pose, and what it sees.
type View = (Isometry<World, Camera>, Picture);

/// The sheet of one scene at one moment.
pub fn poster(name: Name, seed: u64, at: Stamp) -> Canvas {
    let scene = Scene::generate(name, seed);
    let moment = Stage::new(&scene).at(at);
    let rays = Rays::new(&scene);
    let views = platform::ugv_views(&moment);
    let width = 4 * PANEL + 3 * GAP;
    let rows = [
        drone(&moment, seed, width),
        ground(&scene, &views),
        above(&moment, &views, &rays, seed),
    ];
    Canvas::stacked(&rows, GAP, BACKGROUND)
}

fn drone(moment: &Moment<'_>, seed: u64, width: usize) -> Canvas {
    let camera = d455();
    let pose = platform::uav_camera(moment.scene(), moment.at(), seed);
    let picture = moment.picture(&camera, pose);
    let each = (width - 2 * GAP) / 3;
    let panels = [
        colours(&picture),
        depths(&picture),
        classes(moment.scene(), &picture),
    ];
    let panels = panels.map(|panel| panel.scaled(each, each * 3 / 4));
    Canvas::side_by_side(&panels, GAP, BACKGROUND)
}

fn ground(scene: &Scene, views: &[View]) -> Canvas {
    let lens = platform::ugv_lens();
    let height = PANEL * lens.height / lens.width;
    let row = |of: &dyn Fn(&Picture) -> Canvas| {
        let panels: Vec<_> = views
            .iter()
            .map(|(_, picture)| of(picture).scaled(PANEL, height))
            .collect();
        Canvas::side_by_side(&panels, GAP, BACKGROUND)
    };
    let rows = [row(&colours), row(&|picture| classes(scene, picture))];
    Canvas::stacked(&rows, GAP, BACKGROUND)
}

fn above(moment: &Moment<'_>, views: &[View], rays: &Rays<'_>, seed: u64) -> Canvas {
    let scene = moment.scene();
    let body = platform::ugv(scene, moment.at());
    let start = Stamp::from_nanos(moment.at().as_nanos().saturating_sub(100_000_000));
    let returns = Lidar::rs_32().sweep(rays, start, |at| platform::ugv(scene, at), seed);
    let above = Above { body, size: PANEL };
    let panels = [
        above.lidar(scene, &returns),
        above.street(moment, rays),
        above.voxels(scene),
        above.occlusions(moment, views),
    ];
    Canvas::side_by_side(&panels, GAP, BACKGROUND)
}
