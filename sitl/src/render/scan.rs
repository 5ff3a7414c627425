//! Light instead of colours, and pictures each of whose rows has a time and a pose of its own: a rolling shutter.
//!
//! A row is drawn as a picture of one row would be, from its own pose, with all that moves in its place at that time. Between
//! the first row and the last, faces move straight and at a constant speed. Shadows are those of the middle of the picture.

use std::time::Duration;

use maps::camera::Pinhole;
use maps::frame::{Camera, Isometry, World};
use maps::time::Stamp;
use rayon::prelude::*;

use super::band::{self, Ink, Rows, Scratch};
use super::raster::{BAND, bands};
use super::seen::{Bound, Frustum, Seen, Sway};
use super::shade::View;
use super::{Moment, Picture, Stage};
use crate::scene::{Face, Instance, Scene};

/// Where a camera is at any time.
pub type PoseAt<'a> = dyn Fn(Stamp) -> Isometry<World, Camera> + Sync + 'a;

/// The light that falls into an ideal camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Radiance {
    /// When.
    pub at: Stamp,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Light in each pixel, row by row: red, green and blue, linear, as much as the scene's light is measured in.
    pub light: Vec<[f32; 3]>,
    /// As in a [`Picture`].
    pub depth_m: Vec<f32>,
    /// As in a [`Picture`].
    pub facing: Vec<f32>,
    /// As in a [`Picture`].
    pub instance: Vec<Instance>,
}

impl Radiance {
    fn empty(at: Stamp, camera: &Pinhole) -> Self {
        let pixels = camera.width * camera.height;
        Self {
            at,
            width: camera.width,
            height: camera.height,
            light: vec![[0.0; 3]; pixels],
            depth_m: vec![0.0; pixels],
            facing: vec![0.0; pixels],
            instance: vec![Instance::NOTHING; pixels],
        }
    }

    /// The picture that has these colours and the same truth.
    pub fn with_colours(self, rgb: Vec<[u8; 3]>) -> Picture {
        Picture {
            at: self.at,
            width: self.width,
            height: self.height,
            rgb,
            depth_m: self.depth_m,
            facing: self.facing,
            instance: self.instance,
        }
    }

    /// Its pixels in so many rows at a time, to be drawn.
    fn bands(&mut self, rows: usize) -> impl IndexedParallelIterator<Item = Rows<'_>> {
        let pixels = (rows * self.width).max(1);
        let truth = self.depth_m.par_chunks_mut(pixels);
        let truth = truth.zip(self.facing.par_chunks_mut(pixels));
        let truth = truth.zip(self.instance.par_chunks_mut(pixels));
        let bands = self.light.par_chunks_mut(pixels).zip(truth).enumerate();
        bands.map(move |(band, (light, ((depth_m, facing), instance)))| Rows {
            top: band * rows,
            ink: Ink::Light(light),
            depth_m,
            facing,
            instance,
        })
    }
}

impl Moment<'_> {
    /// The light that a camera sees from there, all of it at this moment.
    pub fn radiance(
        &self,
        camera: &Pinhole,
        world_from_camera: Isometry<World, Camera>,
    ) -> Radiance {
        let seen = self.seen(camera, world_from_camera);
        let outlines: Vec<_> = seen.iter().map(|seen| &seen.outline).collect();
        let lists = bands(&outlines, camera.height);
        let view = View::new(self, camera, world_from_camera);
        let mut radiance = Radiance::empty(self.at, camera);
        let bands = radiance.bands(BAND).zip(&lists);
        bands.for_each_init(Scratch::default, |scratch, (mut rows, faces)| {
            band::draw(&view, &mut rows, scratch, &seen, faces);
        });
        radiance
    }
}

/// When the rows of a picture are exposed: one after the other, from the top.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Readout {
    /// The middle of the picture's time.
    pub at: Stamp,
    /// How long all rows take; each begins its share of it after the one above.
    pub duration: Duration,
    /// How many rows there are.
    pub rows: usize,
}

impl Readout {
    /// The middle of a row's exposure. No row is before the start of the clock.
    pub fn time_of(&self, row: usize) -> Stamp {
        let share = (row as f64 + 0.5) / self.rows.max(1) as f64 - 0.5;
        let offset = self.duration.mul_f64(share.abs());
        if share < 0.0 {
            self.at - offset
        } else {
            self.at + offset
        }
    }
}

impl Stage<'_> {
    /// The scene's own exposure: light times this is 1 at a camera's full scale.
    pub fn exposure(&self) -> f32 {
        self.scene.light().exposure()
    }

    /// The light that a camera sees that moves while its rows are read out.
    pub fn scan(&self, camera: &Pinhole, readout: Readout, pose_at: &PoseAt<'_>) -> Radiance {
        let moment = self.at(readout.at);
        if readout.duration.is_zero() {
            return moment.radiance(camera, pose_at(readout.at));
        }
        let times: Vec<_> = (0..camera.height).map(|row| readout.time_of(row)).collect();
        let poses: Vec<_> = times.iter().map(|at| pose_at(*at)).collect();
        let [Some(&first), Some(&last)] = [times.first(), times.last()] else {
            return Radiance::empty(readout.at, camera);
        };
        let scan = Scan {
            movers: Movers::between(self.scene, [first, last], &moment),
            moment,
            camera,
            times,
            poses,
        };
        scan.draw()
    }
}

/// A picture that is drawn row by row.
struct Scan<'a> {
    moment: Moment<'a>,
    movers: Movers,
    camera: &'a Pinhole,
    /// When each row is exposed, and from where.
    times: Vec<Stamp>,
    poses: Vec<Isometry<World, Camera>>,
}

/// Faces that a few rows may see: their places among what stands still and among what moves.
struct Candidates {
    still: Vec<u32>,
    moving: Vec<u32>,
}

impl Scan<'_> {
    fn draw(&self) -> Radiance {
        let still = self.moment.scene.still().len() as u32;
        let all = Candidates {
            still: (0..still).collect(),
            moving: (0..self.movers.bounds.len() as u32).collect(),
        };
        let all = self.among(&all, 0, self.camera.height);
        let mut radiance = Radiance::empty(self.moment.at, self.camera);
        let bands = radiance.bands(BAND);
        bands.for_each_init(Scratch::default, |scratch, rows| {
            let count = rows.depth_m.len() / self.camera.width.max(1);
            let candidates = self.among(&all, rows.top, count);
            for row in rows.single(self.camera.width) {
                self.row(row, &candidates, scratch);
            }
        });
        radiance
    }

    /// Those of them that so many rows from `top` on may see.
    fn among(&self, faces: &Candidates, top: usize, count: usize) -> Candidates {
        let poses = &self.poses[top..top + count];
        let reference = poses[count / 2];
        let sway = Sway::around(reference, poses);
        let frustum = Frustum::of_rows(self.camera, reference, [top, top + count]);
        let still = &self.moment.bounds;
        let sees = |bound: &Bound| frustum.may_see_swaying(bound, sway);
        let kept = |faces: &[u32], bounds: &[Bound]| {
            let faces = faces.iter().copied();
            faces
                .filter(|face| sees(&bounds[*face as usize]))
                .collect::<Vec<_>>()
        };
        Candidates {
            still: kept(&faces.still, still),
            moving: kept(&faces.moving, &self.movers.bounds),
        }
    }

    fn row(&self, mut row: Rows<'_>, candidates: &Candidates, scratch: &mut Scratch) {
        let pose = self.poses[row.top];
        let camera_from_world = pose.inverse();
        let still = self.moment.scene.still();
        let still = candidates.still.iter().map(|face| &still[*face as usize]);
        let moved: Vec<Face> = candidates
            .moving
            .iter()
            .map(|face| self.movers.at(*face as usize, self.times[row.top]))
            .collect();
        let seen: Vec<_> = still
            .chain(&moved)
            .filter_map(|face| Seen::new(face, self.camera, &camera_from_world))
            .collect();
        let touched: Vec<u32> = (0..)
            .zip(&seen)
            .filter(|(_, seen)| seen.outline.is_in_row(row.top))
            .map(|(index, _)| index)
            .collect();
        let view = View::new(&self.moment, self.camera, pose);
        band::draw(&view, &mut row, scratch, &seen, &touched);
    }
}

/// Everything that moves, from the first row to the last.
struct Movers {
    times: [Stamp; 2],
    from: Vec<Face>,
    to: Vec<Face>,
    /// Around all of each face's way.
    bounds: Vec<Bound>,
}

impl Movers {
    fn between(scene: &Scene, times: [Stamp; 2], middle: &Moment<'_>) -> Self {
        let [mut from, mut to] = times.map(|at| scene.moving(at));
        let is_same = |(a, b): (&Face, &Face)| a.instance == b.instance && a.material == b.material;
        // Whoever comes or leaves meanwhile would change which face is which.
        if from.len() != to.len() || !from.iter().zip(&to).all(is_same) {
            from.clone_from(&middle.moving);
            to.clone_from(&middle.moving);
        }
        let pairs = from.iter().zip(&to);
        Self {
            times,
            bounds: pairs
                .map(|(a, b)| Bound::of(a).along_to(&Bound::of(b)))
                .collect(),
            from,
            to,
        }
    }

    /// One of the faces at a time.
    fn at(&self, face: usize, at: Stamp) -> Face {
        let (from, to) = (&self.from[face], &self.to[face]);
        let whole = self.times[1].since(self.times[0]).as_secs_f64();
        let share = at.since(self.times[0]).as_secs_f64() / whole.max(1e-9);
        let corner = from.corner.raw + (to.corner.raw - from.corner.raw) * share;
        let mut moved = *from;
        moved.corner.raw = corner;
        moved.edge_u.raw = from.edge_u.raw.lerp(&to.edge_u.raw, share);
        moved.edge_v.raw = from.edge_v.raw.lerp(&to.edge_v.raw, share);
        moved
    }
}
