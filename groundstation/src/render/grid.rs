//! The ground: a metric grid that is as fine as the view is near, a north arrow, and where its numbers belong.

use maps::frame::{Point, Vector, World};

use super::camera::{Camera3, Lens, Viewport};
use super::scene::Label;
use super::sketch::{Sketch, opaque};

/// What of the ground is drawn.
pub(crate) struct Grid {
    /// Its middle.
    pub(crate) center: Point<World>,
    pub(crate) radius_m: f64,
    /// From one line to the next; every tenth is stronger.
    pub(crate) spacing_m: f64,
}

impl Grid {
    pub(crate) fn of(camera: &Camera3) -> Self {
        let target = camera.target();
        let reach = match camera.lens() {
            Lens::Perspective => 8.0,
            Lens::Parallel => 4.0,
        };
        Self {
            center: Point::new(target.raw.x, target.raw.y, 0.0),
            radius_m: reach * camera.distance_m().max(target.raw.z.abs()),
            spacing_m: 10_f64
                .powf((0.25 * camera.distance_m()).log10().floor())
                .max(0.1),
        }
    }
}

const PALE: [u8; 3] = [214, 222, 232];

/// An arrow from the origin to the north with its letter, as large as a thumb wherever the camera is.
pub(crate) fn north_arrow(sketch: &mut Sketch, camera: &Camera3) {
    let unit_m = 0.07 * camera.distance_m();
    let at = |x: f64, y: f64| Point::new(x * unit_m, y * unit_m, 0.0);
    let color = opaque(PALE, 220);
    sketch.ring(Point::origin(), 0.12 * unit_m, color, 1.5);
    sketch.line(&[at(0.0, 0.12), at(0.0, 1.0)], color, 2.0);
    sketch.line(&[at(-0.12, 0.78), at(0.0, 1.0), at(0.12, 0.78)], color, 2.0);
    sketch.line(
        &[
            at(-0.11, 1.12),
            at(-0.11, 1.42),
            at(0.11, 1.12),
            at(0.11, 1.42),
        ],
        color,
        2.0,
    );
}

/// The metres east along the east-west axis and north along the other, at the lines of the grid, as far as there is
/// room for them; for the user interface to write.
pub fn labels(camera: &Camera3, viewport: Viewport) -> Vec<Label> {
    const ROOM_PX: f64 = 72.0;
    const MOST: i32 = 24;
    let grid = Grid::of(camera);
    let per_metre = camera.pixels_per_metre(camera.target(), viewport);
    let Some(step_m) = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0]
        .map(|times| times * grid.spacing_m)
        .into_iter()
        .find(|step_m| step_m * per_metre >= ROOM_PX)
    else {
        return Vec::new();
    };
    let mut labels = Vec::new();
    for axis in [
        Vector::<World>::new(1.0, 0.0, 0.0),
        Vector::new(0.0, 1.0, 0.0),
    ] {
        let middle = (axis.raw.dot(&grid.center.raw.coords) / step_m).round();
        for step in -MOST..=MOST {
            let metres = (middle + f64::from(step)) * step_m;
            let place = Point::origin() + axis * metres;
            let is_far = (place - grid.center).norm() > 0.5 * grid.radius_m;
            if metres == 0.0 || is_far {
                continue;
            }
            let Some(pixel) = camera.project(place, viewport) else {
                continue;
            };
            let is_inside = (0.0..=viewport.width).contains(&pixel[0])
                && (0.0..=viewport.height).contains(&pixel[1]);
            if is_inside {
                labels.push(Label {
                    pixel,
                    text: format!("{} m", shortest(metres)),
                });
            }
        }
    }
    labels
}

/// Centimetres at most, without zeros that say nothing.
fn shortest(metres: f64) -> f64 {
    (metres * 100.0).round() / 100.0
}

#[cfg(test)]
mod tests {
    use super::*;

    const VIEWPORT: Viewport = Viewport {
        width: 800.0,
        height: 600.0,
    };

    #[test]
    fn the_grid_is_as_fine_as_the_view_is_near() {
        for (distance_m, spacing_m) in [
            (0.5, 0.1),
            (10.0, 1.0),
            (39.0, 1.0),
            (41.0, 10.0),
            (4100.0, 1000.0),
        ] {
            let camera = Camera3::looking_at(Point::origin(), 0.0, 1.0, distance_m);
            assert!(
                (Grid::of(&camera).spacing_m - spacing_m).abs() < 1e-9,
                "{distance_m} m away"
            );
        }
    }

    #[test]
    fn labels_stand_where_their_metres_are() {
        let camera = Camera3::default().top_down();
        let labels = labels(&camera, VIEWPORT);
        let one_east = labels
            .iter()
            .find(|label| label.text == "1 m" && label.pixel[0] > 410.0)
            .expect("there is room");
        let seen = camera
            .project(Point::new(1.0, 0.0, 0.0), VIEWPORT)
            .expect("in view");
        let error = (one_east.pixel[0] - seen[0]).hypot(one_east.pixel[1] - seen[1]);
        assert!(error < 1e-9);
        assert!(
            labels.iter().all(|label| label.text != "0 m"),
            "the origin has its own sign"
        );
    }
}
