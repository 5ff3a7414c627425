//! The sheet: title, two views, a scale for each, and the legend.

use super::canvas::{Area, FRAME, INK, LINE, width_of};
use super::legend::Legend;
use super::view::{Projection, View};
use super::{Drawn, Picture, PictureError, Request};
use crate::voxel::VoxelMap;

/// Paper around everything.
const MARGIN: usize = 16;
/// Between a line of text and what follows.
const GAP: usize = 6;
/// The legend: a ramp with its numbers, or two lines of classes.
const LEGEND: usize = 2 * LINE + 16;
/// Between a view's frame and what is drawn.
const PADDING: usize = 8;

/// Draws a map on a sheet: from above with north up, and from the south-south-west, each with its own scale.
pub fn sheet(map: &VoxelMap, request: &Request<'_>) -> Result<Picture, PictureError> {
    let (width, height) = (request.width, request.height);
    if !Request::SIZE.contains(&width) || !Request::SIZE.contains(&height) {
        return Err(PictureError::Size { width, height });
    }
    let drawn = Drawn::new(map, request.ceiling_m);
    check_not_empty(&drawn, request)?;
    let legend = Legend::new(request.paint, &drawn)?;
    let views = [
        ("from above, north up", View::new(&drawn, Projection::TOP)),
        (
            "from the south-south-west, 40° down",
            View::new(&drawn, Projection::oblique()),
        ),
    ];
    let mut picture = Picture::paper(width, height);
    picture.text(MARGIN, MARGIN, request.title);
    picture.text(
        MARGIN,
        MARGIN + LINE + GAP,
        &summary(map, request.ceiling_m),
    );
    let top = MARGIN + 2 * (LINE + GAP) + GAP;
    let bottom = height - MARGIN - LEGEND;
    let room = Area::new(MARGIN, top, width - 2 * MARGIN, bottom - 2 * GAP - top);
    for (place, (name, view)) in layout(room, &views).into_iter().zip(&views) {
        picture.text(place.left, place.top, name);
        let frame = frame_in(place);
        picture.frame(frame, FRAME);
        let inside = inside(frame);
        view.draw(
            &drawn,
            inside,
            |key, voxel| legend.color(key, voxel),
            &mut picture,
        );
        let pixels_a_m = view.scale(inside.width, inside.height) / map.resolution_m();
        draw_scale(place, pixels_a_m, &mut picture);
    }
    let strip = Area::new(MARGIN, bottom, width - 2 * MARGIN, LEGEND);
    legend.draw(strip, &mut picture);
    Ok(picture)
}

fn check_not_empty(drawn: &Drawn<'_>, request: &Request<'_>) -> Result<(), PictureError> {
    let lowest = drawn.map.occupied().map(|(key, _)| key.z).min();
    let lowest = lowest.ok_or(PictureError::Empty)?;
    match request.ceiling_m {
        Some(ceiling_m) if lowest > drawn.top => Err(PictureError::AllAbove {
            ceiling_m,
            lowest_m: f64::from(lowest + 1) * drawn.map.resolution_m(),
        }),
        _ => Ok(()),
    }
}

/// Resolution, extent and counts in a line.
fn summary(map: &VoxelMap, ceiling_m: Option<f64>) -> String {
    let resolution_m = map.resolution_m();
    let extent = map.bounds().map_or([0.0; 3], |(low, high)| {
        [high.x - low.x, high.y - low.y, high.z - low.z].map(|c| f64::from(c + 1) * resolution_m)
    });
    let [east, north, up] = extent;
    let occupied = map.occupied_count();
    let free = map.known_count() - occupied;
    let left_out = ceiling_m.map_or(String::new(), |m| format!(", above {m} m left out"));
    format!(
        "voxels of {resolution_m} m, {east:.1} x {north:.1} x {up:.1} m, {occupied} occupied, {free} free{left_out}"
    )
}

/// Side by side or one above the other, whichever shows the voxels larger.
fn layout(room: Area, views: &[(&str, View); 2]) -> [Area; 2] {
    let (wide, high) = ((room.width - MARGIN) / 2, (room.height - MARGIN) / 2);
    let beside =
        [0, 1].map(|i| Area::new(room.left + i * (wide + MARGIN), room.top, wide, room.height));
    let stacked =
        [0, 1].map(|i| Area::new(room.left, room.top + i * (high + MARGIN), room.width, high));
    let size = |places: &[Area; 2]| -> f64 {
        let scales = places.iter().zip(views).map(|(place, (_, view))| {
            let inside = inside(frame_in(*place));
            view.scale(inside.width, inside.height)
        });
        scales.product()
    };
    if size(&stacked) > size(&beside) {
        stacked
    } else {
        beside
    }
}

/// A view's frame: below its name and above its scale.
fn frame_in(place: Area) -> Area {
    let text = LINE + GAP;
    Area::new(
        place.left,
        place.top + text,
        place.width,
        place.height - 2 * text,
    )
}

fn inside(frame: Area) -> Area {
    let Area {
        left,
        top,
        width,
        height,
    } = frame;
    Area::new(
        left + PADDING,
        top + PADDING,
        width - 2 * PADDING,
        height - 2 * PADDING,
    )
}

/// A bar of a round length, at most a third of the view.
fn draw_scale(place: Area, pixels_a_m: f64, picture: &mut Picture) {
    let most_m = place.width as f64 / 3.0 / pixels_a_m;
    let length_m = round_below(most_m);
    let pixels = (length_m * pixels_a_m).round() as usize;
    let top = place.top + place.height - LINE;
    let bar = Area::new(place.left, top + LINE / 2 - 2, pixels.max(2), 4);
    picture.fill(bar, INK);
    for x in [bar.left, bar.left + bar.width - 2] {
        picture.fill(Area::new(x, top + LINE / 2 - 6, 2, 12), INK);
    }
    let text = format!("{length_m} m");
    let left = (bar.left + bar.width + GAP).min(place.left + place.width - width_of(&text));
    picture.text(left, top, &text);
}

/// The greatest of 1, 2 and 5 times a power of ten that is not above.
fn round_below(value: f64) -> f64 {
    let power = 10.0_f64.powf(value.log10().floor());
    let times = [5.0, 2.0].into_iter().find(|times| times * power <= value);
    // Powers of ten below one are not exact; a sixth of a digit is no length to print.
    let round = times.unwrap_or(1.0) * power;
    (round * 1e6).round() / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_are_round() {
        for (most, expected) in [
            (0.17, 0.1),
            (0.2, 0.2),
            (1.99, 1.0),
            (7.3, 5.0),
            (49.0, 20.0),
        ] {
            assert!((round_below(most) - expected).abs() < 1e-9, "{most}");
        }
    }
}
