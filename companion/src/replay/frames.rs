//! Frame by frame: what each took and what came of it, and pictures of some.

use std::io::{self, Write};
use std::time::Duration;

use maps::camera::RgbdFrame;
use maps::time::Stamp;
use slam::{Overlay, State};

use crate::pipeline::FrameDone;

/// Half of the most pictures that are kept.
const FEWEST: usize = 6;

/// One frame of the recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Row {
    /// When it was taken.
    pub(super) at: Stamp,
    pub(super) tracking: Duration,
    /// Of the keyframes that had settled by then.
    pub(super) mapping: Duration,
    pub(super) is_tracked: bool,
    pub(super) is_keyframe: bool,
    /// Map points that support the pose.
    pub(super) points: usize,
    /// Features left out because they are on something that moves.
    pub(super) rejected: usize,
    /// Of the measured depth, 0 to 1.
    pub(super) moving_share: f64,
}

impl Row {
    pub(super) fn new(at: Stamp, done: &FrameDone) -> Self {
        let tracked = done.tracked.as_ref();
        Self {
            at,
            tracking: done.tracking,
            mapping: done.mapping,
            is_tracked: tracked.is_some_and(|t| t.state == State::Tracking),
            is_keyframe: tracked.is_some_and(|t| t.keyframe),
            points: tracked.map_or(0, |t| t.points),
            rejected: tracked.map_or(0, |t| t.rejected),
            moving_share: tracked.map_or(0.0, |t| t.moving_share),
        }
    }

    pub(super) fn took_ms(&self) -> f64 {
        (self.tracking + self.mapping).as_secs_f64() * 1e3
    }
}

/// Writes one line a frame.
pub(super) fn write_csv(rows: &[Row], file: &mut impl Write) -> io::Result<()> {
    writeln!(
        file,
        "time_s,tracking_ms,mapping_ms,tracked,keyframe,points,rejected,moving_share"
    )?;
    for row in rows {
        let [tracking_ms, mapping_ms] = [row.tracking, row.mapping].map(|d| d.as_secs_f64() * 1e3);
        let [tracked, keyframe] = [row.is_tracked, row.is_keyframe].map(u8::from);
        writeln!(
            file,
            "{},{tracking_ms:.3},{mapping_ms:.3},{tracked},{keyframe},{},{},{:.4}",
            row.at, row.points, row.rejected, row.moving_share
        )?;
    }
    Ok(())
}

/// A frame at half its size with what SLAM made of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Sample {
    /// When it was taken.
    pub(super) at: Stamp,
    /// Pixels in a row and rows.
    pub(super) size: [usize; 2],
    /// Row by row.
    pub(super) rgb: Vec<[u8; 3]>,
}

/// On the background.
const STATIC: [u8; 3] = [60, 230, 90];
/// On what moves.
const MOVING: [u8; 3] = [255, 50, 40];

impl Sample {
    /// Features that support the pose are green, those left out red, and what moves is reddened.
    pub(super) fn draw(frame: &RgbdFrame, overlay: &Overlay) -> Self {
        let size = [frame.width / 2, frame.height / 2];
        let mut rgb = Vec::with_capacity(size[0] * size[1]);
        for y in 0..size[1] {
            for x in 0..size[0] {
                let mean = |channel: usize| {
                    let corners = [[0, 0], [1, 0], [0, 1], [1, 1]];
                    let values = corners.map(|[dx, dy]| {
                        let at = (2 * y + dy) * frame.width + 2 * x + dx;
                        frame
                            .rgb
                            .get(at)
                            .map_or(0, |pixel| u32::from(pixel[channel]))
                    });
                    (values.iter().sum::<u32>() / 4) as u8
                };
                let pixel = [mean(0), mean(1), mean(2)];
                let is_moving = is_moving(overlay, [2 * x, 2 * y]);
                rgb.push(if is_moving { reddened(pixel) } else { pixel });
            }
        }
        let mut sample = Self {
            at: frame.at,
            size,
            rgb,
        };
        for (pixels, color) in [(&overlay.rejected, MOVING), (&overlay.tracked, STATIC)] {
            for pixel in pixels {
                sample.dot(*pixel, color);
            }
        }
        sample
    }

    /// A square of 2 × 2 at this place of the whole frame.
    fn dot(&mut self, pixel: [f32; 2], color: [u8; 3]) {
        let [x, y] = pixel.map(|c| (c / 2.0).max(0.0) as usize);
        for (x, y) in [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)] {
            if x < self.size[0] && y < self.size[1] {
                self.rgb[y * self.size[0] + x] = color;
            }
        }
    }
}

fn is_moving(overlay: &Overlay, [x, y]: [usize; 2]) -> bool {
    let cell = overlay.cell_px.max(1);
    let column = x / cell;
    let index = (y / cell) * overlay.cells_across + column;
    column < overlay.cells_across && overlay.moving.get(index) == Some(&true)
}

fn reddened([r, g, b]: [u8; 3]) -> [u8; 3] {
    [128 + r / 2, g / 2, b / 2]
}

/// A few pictures, evenly spread over a recording of any length: when there are too many, every other one goes, and from then on
/// half as many come.
pub(super) struct Samples {
    every: u64,
    kept: Vec<Sample>,
}

impl Default for Samples {
    fn default() -> Self {
        Self {
            every: 1,
            kept: Vec::new(),
        }
    }
}

impl Samples {
    /// Whether the frame of that number, from 0, is to be drawn.
    pub(super) fn wants(&self, frame: u64) -> bool {
        frame.is_multiple_of(self.every)
    }

    /// One that was wanted.
    pub(super) fn add(&mut self, sample: Sample) {
        self.kept.push(sample);
        if self.kept.len() == 2 * FEWEST {
            self.every = self.every.saturating_mul(2);
            let mut index = 0;
            self.kept.retain(|_| {
                index += 1;
                index % 2 == 1
            });
        }
    }

    /// In order of time.
    pub(super) fn all(&self) -> &[Sample] {
        &self.kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(nanos: u64) -> Sample {
        Sample {
            at: Stamp::from_nanos(nanos),
            size: [0, 0],
            rgb: Vec::new(),
        }
    }

    #[test]
    fn samples_of_a_recording_of_any_length_are_few_and_evenly_spread() {
        for frames in [0, 1, 5, 12, 100, 12_345] {
            let mut samples = Samples::default();
            for frame in 0..frames {
                if samples.wants(frame) {
                    samples.add(sample(frame));
                }
            }
            let at: Vec<u64> = samples.all().iter().map(|s| s.at.as_nanos()).collect();
            assert!(at.len() < 2 * FEWEST, "{frames}: {at:?}");
            assert!(at.len() >= FEWEST.min(frames as usize), "{frames}: {at:?}");
            let steps: Vec<u64> = at.windows(2).map(|pair| pair[1] - pair[0]).collect();
            assert!(
                steps.iter().all(|step| *step == steps[0]),
                "{frames}: {at:?}"
            );
        }
    }

    #[test]
    fn a_picture_shows_what_supports_the_pose_and_what_moves() {
        let frame = RgbdFrame {
            at: Stamp::ZERO,
            width: 16,
            height: 8,
            rgb: vec![[100; 3]; 16 * 8],
            depth_m: vec![1.0; 16 * 8],
        };
        let overlay = Overlay {
            tracked: vec![[2.0, 2.0], [900.0, -5.0]],
            rejected: vec![[13.0, 5.0]],
            cell_px: 8,
            cells_across: 2,
            moving: vec![false, true],
        };
        let drawn = Sample::draw(&frame, &overlay);
        assert_eq!(drawn.size, [8, 4]);
        let at = |x: usize, y: usize| drawn.rgb[y * 8 + x];
        assert_eq!(at(1, 1), STATIC);
        assert_eq!(at(6, 2), MOVING);
        assert_eq!(at(0, 3), [100; 3], "the background stays");
        assert_eq!(at(4, 0), [178, 50, 50], "what moves is reddened");
    }

    #[test]
    fn each_frame_is_a_line_of_the_table() {
        let row = Row {
            at: Stamp::from_nanos(1_500_000_000),
            tracking: Duration::from_micros(12_345),
            mapping: Duration::ZERO,
            is_tracked: true,
            is_keyframe: false,
            points: 321,
            rejected: 4,
            moving_share: 0.25,
        };
        let mut text = Vec::new();
        write_csv(&[row], &mut text).expect("memory");
        let text = String::from_utf8(text).expect("text");
        let lines: Vec<_> = text.lines().collect();
        assert_eq!(lines[1], "1.500000000,12.345,0.000,1,0,321,4,0.2500");
        assert_eq!(lines[0].split(',').count(), lines[1].split(',').count());
    }
}
