//! Pictures with exact depth: a span rasteriser into a visibility buffer, then shading of what is visible.
//!
//! A plane `n·p = d` seen along the ray `(x, y, 1)` of a pixel has the inverse depth
//!
//! ```text
//! 1/z = (n_x·x + n_y·y + n_z) / d        (x, y) = ((u - cx)/fx, (v - cy)/fy)
//! ```
//!
//! which is linear in the pixel: no interpolation error, and colour, depth and instance of a pixel come from the same
//! face. Bands of rows are independent, so the picture is the same on any number of threads.
//!
//! - J. Burns and W. Hunt, *The Visibility Buffer: A Cache-Friendly Approach to Deferred Shading*, JCGT 2(2), 2013.

mod band;
pub mod diorama;
mod raster;
mod scan;
mod seen;
mod shade;
mod shadow;

use std::collections::BTreeMap;
use std::sync::Arc;

use maps::camera::Pinhole;
use maps::frame::{Camera, Isometry, World};
use maps::time::Stamp;
use rayon::prelude::*;

use crate::scene::{Face, Instance, Light, Scene};
pub use scan::{PoseAt, Radiance, Readout};

use band::{Ink, Rows, Scratch};
use raster::{BAND, Outline, bands};
use seen::{Bound, Frustum, Seen};
use shade::View;
use shadow::{ShadowMap, Shadows};

/// Faces that are looked at together.
const FACES: usize = 512;

/// What an ideal camera sees.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// When.
    pub at: Stamp,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Colour of each pixel, row by row.
    pub rgb: Vec<[u8; 3]>,
    /// True distance along the optical axis in metres; 0 where there is nothing.
    pub depth_m: Vec<f32>,
    /// Cosine between the view ray and the surface's normal; 0 where there is nothing.
    pub facing: Vec<f32>,
    /// What each pixel shows.
    pub instance: Vec<Instance>,
}

/// A scene that is to be drawn, with what its drawings share: the shadows of all that stands still.
#[derive(Clone, Debug)]
pub struct Stage<'a> {
    scene: &'a Scene,
    bounds: Arc<Vec<Bound>>,
    shadows: Option<Arc<ShadowMap>>,
}

impl<'a> Stage<'a> {
    /// Prepares a scene.
    pub fn new(scene: &'a Scene) -> Self {
        let shadows = match scene.light() {
            Light::Lamps(_) => None,
            Light::Sun(sun) => {
                let mut map = ShadowMap::around(scene.still(), sun);
                map.draw(scene.still());
                Some(Arc::new(map))
            }
        };
        Self {
            scene,
            bounds: Arc::new(scene.still().iter().map(Bound::of).collect()),
            shadows,
        }
    }

    /// The scene at one moment, for as many cameras as look at it.
    pub fn at(&self, at: Stamp) -> Moment<'a> {
        let moving = self.scene.moving(at);
        let shadows = self.shadows.clone();
        Moment {
            scene: self.scene,
            at,
            bounds: Arc::clone(&self.bounds),
            shadows: shadows.map(|still| Shadows::new(still, &moving)),
            moving,
        }
    }
}

/// A scene at one moment.
#[derive(Clone, Debug)]
pub struct Moment<'a> {
    scene: &'a Scene,
    at: Stamp,
    bounds: Arc<Vec<Bound>>,
    moving: Vec<Face>,
    shadows: Option<Shadows>,
}

impl Moment<'_> {
    /// When.
    pub fn at(&self) -> Stamp {
        self.at
    }

    /// Everything that can be seen.
    pub fn faces(&self) -> impl Iterator<Item = &Face> {
        self.scene.still().iter().chain(&self.moving)
    }

    /// What is drawn.
    pub fn scene(&self) -> &Scene {
        self.scene
    }

    /// How many pixels each of these instances would cover if nothing else were there; those outside of the picture left out.
    pub fn coverage(
        &self,
        camera: &Pinhole,
        world_from_camera: Isometry<World, Camera>,
        is_wanted: impl Fn(Instance) -> bool,
    ) -> BTreeMap<Instance, u32> {
        let camera_from_world = world_from_camera.inverse();
        let mut outlines: BTreeMap<Instance, Vec<Outline>> = BTreeMap::new();
        for face in self.faces().filter(|face| is_wanted(face.instance)) {
            if let Some(seen) = Seen::new(face, camera, &camera_from_world) {
                outlines
                    .entry(face.instance)
                    .or_default()
                    .push(seen.outline);
            }
        }
        let area = |outlines: &[Outline]| raster::area(outlines, camera.width, camera.height);
        let areas = outlines
            .iter()
            .map(|(instance, outlines)| (*instance, area(outlines)));
        areas.filter(|(_, area)| *area > 0).collect()
    }

    /// What a camera sees from there. The lens distortion is not applied: a simulated lens has none.
    pub fn picture(&self, camera: &Pinhole, world_from_camera: Isometry<World, Camera>) -> Picture {
        let seen = self.seen(camera, world_from_camera);
        let outlines: Vec<_> = seen.iter().map(|seen| &seen.outline).collect();
        let bands = bands(&outlines, camera.height);
        let view = View::new(self, camera, world_from_camera);
        let mut picture = Picture::empty(self.at, camera);
        picture
            .bands(camera.width * BAND)
            .zip(&bands)
            .for_each_init(Scratch::default, |scratch, (mut rows, faces)| {
                band::draw(&view, &mut rows, scratch, &seen, faces);
            });
        picture
    }

    /// The faces that a camera sees, hidden ones among them, in their order.
    fn seen(&self, camera: &Pinhole, world_from_camera: Isometry<World, Camera>) -> Vec<Seen<'_>> {
        let camera_from_world = world_from_camera.inverse();
        let frustum = Frustum::of(camera, world_from_camera);
        let seen = |face| Seen::new(face, camera, &camera_from_world);
        let still = self.scene.still().par_chunks(FACES);
        let still = still.zip(self.bounds.par_chunks(FACES));
        let still = still.flat_map_iter(|(faces, bounds)| {
            let pairs = faces.iter().zip(bounds);
            let may_be_seen = pairs.filter(|(_, bound)| frustum.may_see(bound));
            may_be_seen.filter_map(|(face, _)| seen(face))
        });
        let moving = self.moving.par_chunks(FACES).flat_map_iter(|faces| {
            let may_be_seen = faces
                .iter()
                .filter(|face| frustum.may_see(&Bound::of(face)));
            may_be_seen.filter_map(seen)
        });
        still.chain(moving).collect()
    }
}

impl Picture {
    /// Nothing, as seen by a camera.
    fn empty(at: Stamp, camera: &Pinhole) -> Self {
        let pixels = camera.width * camera.height;
        Self {
            at,
            width: camera.width,
            height: camera.height,
            rgb: vec![[0; 3]; pixels],
            depth_m: vec![0.0; pixels],
            facing: vec![0.0; pixels],
            instance: vec![Instance::NOTHING; pixels],
        }
    }

    /// Its pixels in so many at a time, to be drawn.
    fn bands(&mut self, pixels: usize) -> impl IndexedParallelIterator<Item = Rows<'_>> {
        let pixels = pixels.max(1);
        let truth = self.depth_m.par_chunks_mut(pixels);
        let truth = truth.zip(self.facing.par_chunks_mut(pixels));
        let truth = truth.zip(self.instance.par_chunks_mut(pixels));
        let bands = self.rgb.par_chunks_mut(pixels).zip(truth).enumerate();
        bands.map(|(band, (rgb, ((depth_m, facing), instance)))| Rows {
            top: band * BAND,
            ink: Ink::Developed(rgb),
            depth_m,
            facing,
            instance,
        })
    }
}

/// Draws the scene as it is at that moment. Who draws more than once keeps a [`Stage`].
pub fn render(
    scene: &Scene,
    at: Stamp,
    camera: &Pinhole,
    world_from_camera: Isometry<World, Camera>,
) -> Picture {
    Stage::new(scene).at(at).picture(camera, world_from_camera)
}

#[cfg(test)]
mod tests;
