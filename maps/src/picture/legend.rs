//! What the colours of a picture mean, and the strip that says so.

use super::canvas::{Area, FRAME, INK, LINE, width_of};
use super::{Drawn, Measure, Paint, Picture, PictureError};
use crate::palette;
use crate::voxel::{ClassId, Rgb, Voxel, VoxelKey};

/// What has no colour, or no class.
const UNTOLD: [u8; 3] = [176, 178, 182];
/// Share of the voxels that may be below, or above, the ends of a ramp.
const BEYOND: f64 = 0.01;
/// Pixels of a ramp or of a class's patch.
const RAMP: usize = 320;
const PATCH: usize = LINE;

/// The meaning of the colours of one picture.
pub(super) enum Legend<'a> {
    /// From low to high.
    Height {
        low_m: f64,
        high_m: f64,
        resolution_m: f64,
    },
    /// The classes there are, the most frequent first, with their number of voxels.
    Classes(Vec<(ClassId, usize)>),
    /// Colours are what they are.
    Color,
    /// From low to high.
    Measure(Measure<'a>),
}

impl<'a> Legend<'a> {
    /// The meaning for what is drawn; there must be something.
    pub(super) fn new(paint: Paint<'a>, drawn: &Drawn<'_>) -> Result<Self, PictureError> {
        let voxels = || {
            let voxels = drawn.map.occupied();
            voxels.filter(|(key, _)| key.z <= drawn.top)
        };
        match paint {
            Paint::Height => {
                let resolution_m = drawn.map.resolution_m();
                let mut layers: Vec<_> = voxels().map(|(key, _)| key.z).collect();
                let beyond = (layers.len() as f64 * BEYOND) as usize;
                let last = layers.len() - 1;
                let low = *layers.select_nth_unstable(beyond).1;
                let high = *layers.select_nth_unstable(last - beyond).1 + 1;
                Ok(Self::Height {
                    low_m: f64::from(low) * resolution_m,
                    high_m: f64::from(high) * resolution_m,
                    resolution_m,
                })
            }
            Paint::Class => {
                let mut counts = [0; 256];
                for (_, voxel) in voxels() {
                    counts[usize::from(voxel.class.0)] += 1;
                }
                let mut classes: Vec<_> = (0..=255).map(ClassId).zip(counts).collect();
                classes.retain(|(_, count)| *count > 0);
                classes.sort_by_key(|(class, count)| (std::cmp::Reverse(*count), *class));
                if classes.iter().all(|(class, _)| *class == ClassId::NONE) {
                    return Err(PictureError::NothingToTell("class"));
                }
                Ok(Self::Classes(classes))
            }
            Paint::Color => {
                if voxels().all(|(_, voxel)| voxel.color.is_none()) {
                    return Err(PictureError::NothingToTell("colour"));
                }
                Ok(Self::Color)
            }
            Paint::Measure(measure) => Ok(Self::Measure(measure)),
        }
    }

    /// The colour of a voxel in the light.
    pub(super) fn color(&self, key: VoxelKey, voxel: Voxel) -> [u8; 3] {
        let told = match self {
            Self::Height {
                low_m,
                high_m,
                resolution_m,
            } => {
                let height_m = (f64::from(key.z) + 0.5) * resolution_m;
                return palette::ramp((height_m - low_m) / (high_m - low_m));
            }
            Self::Classes(_) => palette::color_of(voxel.class),
            Self::Color => voxel.color,
            Self::Measure(Measure { low, high, of, .. }) => {
                of(key).map(|value| Rgb(palette::ramp((value - low) / (high - low))))
            }
        };
        told.map_or(UNTOLD, |Rgb(color)| color)
    }

    /// Draws the strip; what does not fit is left out and counted.
    pub(super) fn draw(&self, area: Area, picture: &mut Picture) {
        match self {
            Self::Height { low_m, high_m, .. } => {
                let range = (*low_m, *high_m, " m");
                draw_ramp("height above the origin", range, area, picture);
            }
            Self::Measure(Measure {
                name, low, high, ..
            }) => draw_ramp(name, (*low, *high, ""), area, picture),
            Self::Classes(classes) => draw_classes(classes, area, picture),
            Self::Color => {
                picture.fill(Area::new(area.left, area.top, PATCH, PATCH), UNTOLD);
                let text = "colours as seen by the camera; grey where none was";
                picture.text(area.left + PATCH + 10, area.top + 2, text);
            }
        }
    }
}

fn draw_ramp(label: &str, (low, high, unit): (f64, f64, &str), area: Area, picture: &mut Picture) {
    picture.text(area.left, area.top + 2, label);
    let (left, wide) = (area.left + width_of(label) + 24, RAMP.min(area.width / 3));
    for x in 0..wide {
        let color = palette::ramp((x as f64 + 0.5) / wide as f64);
        picture.fill(Area::new(left + x, area.top, 1, LINE), color);
    }
    picture.frame(Area::new(left, area.top, wide, LINE), FRAME);
    // Enough digits to tell the marks apart.
    let digits = usize::from(high - low < 100.0) + usize::from(high - low < 6.0);
    for i in 0..5_usize {
        let value = low + (high - low) * i as f64 / 4.0;
        let x = left + (wide - 1) * i / 4;
        picture.fill(Area::new(x, area.top + LINE, 1, 5), INK);
        let number = format!("{value:.digits$}");
        let text = if i == 4 {
            format!("{number}{unit}")
        } else {
            number.clone()
        };
        let half = width_of(&number) / 2;
        picture.text(x.saturating_sub(half), area.top + LINE + 7, &text);
    }
}

fn draw_classes(classes: &[(ClassId, usize)], area: Area, picture: &mut Picture) {
    let all: usize = classes.iter().map(|(_, count)| count).sum();
    let (mut x, mut y) = (area.left, area.top);
    let step = LINE + 8;
    for (place, (class, count)) in classes.iter().enumerate() {
        let share = 100.0 * *count as f64 / all as f64;
        let name = match *class {
            ClassId::NONE => format!("no class {share:.1}%"),
            ClassId(class) => format!("class {class} {share:.1}%"),
        };
        let wide = PATCH + 8 + width_of(&name) + 20;
        if x + wide > area.left + area.width {
            (x, y) = (area.left, y + step);
        }
        // The last line keeps room to say how many are not shown.
        let last_line = y + 2 * step > area.top + area.height;
        let left = classes.len() - place;
        let more = format!("and {left} more");
        if last_line && left > 1 && x + wide + width_of(&more) > area.left + area.width {
            picture.text(x, y + 2, &more);
            return;
        }
        let color = palette::color_of(*class).map_or(UNTOLD, |Rgb(color)| color);
        picture.fill(Area::new(x, y, PATCH, PATCH), color);
        picture.frame(Area::new(x, y, PATCH, PATCH), FRAME);
        picture.text(x + PATCH + 8, y + 2, &name);
        x += wide;
    }
}
