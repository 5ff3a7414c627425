//! The viewer's state, and what becomes of it in every pass.

mod bars;
mod pictures;
mod scene;

use std::sync::Arc;
use std::time::Duration;

use maps::time::Stamp;
use nalgebra::Point3;
use sitl::render::diorama::Vertex;
use sitl::scene::Name;

use super::eye::{Eye, Orbit};
use super::gpu::Drawing;
use super::sensors::{Cloud, Kind, Pictures, Tab, Wanted};
use super::sketch::Colouring;
use super::time_line::TimeLine;
use super::worker::{Answer, Loaded, VoxelMesh, Wake, Worker, WorkerError};
use super::world::{History, Poses};

/// Where the eye is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Follow {
    /// Where it is put.
    Free,
    /// Along with the drone.
    Drone,
    /// Along with the ground vehicle.
    Ground,
    /// In the drone's camera.
    Camera,
}

impl Follow {
    pub(crate) const ALL: [(Self, &'static str); 4] = [
        (Self::Free, "free"),
        (Self::Drone, "drone"),
        (Self::Ground, "ground vehicle"),
        (Self::Camera, "drone's camera"),
    ];
}

/// What is drawn of all there is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Layers {
    pub(crate) shown: [bool; Layer::ALL.len()],
    pub(crate) colouring: Colouring,
}

/// What can be left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Layer {
    /// Everything that cameras see.
    Surfaces,
    /// True boxes of road users, with where they are in a second.
    Boxes,
    /// What they are, and how fast.
    Labels,
    /// What the drone's camera looks at.
    Frustum,
    /// Returns of the ground vehicle's sensor.
    Lidar,
    /// True voxels around the ground vehicle.
    Voxels,
}

impl Layer {
    pub(crate) const ALL: [(Self, &'static str); 6] = [
        (Self::Surfaces, "surfaces"),
        (Self::Boxes, "boxes (truth)"),
        (Self::Labels, "labels (truth)"),
        (Self::Frustum, "drone's view"),
        (Self::Lidar, "LiDAR"),
        (Self::Voxels, "voxels (truth)"),
    ];
}

impl Default for Layers {
    fn default() -> Self {
        let hidden = [Layer::Labels, Layer::Voxels];
        Self {
            shown: Layer::ALL.map(|(layer, _)| !hidden.contains(&layer)),
            colouring: Colouring::Intensity,
        }
    }
}

impl Layers {
    pub(crate) fn has(self, layer: Layer) -> bool {
        self.shown[layer as usize]
    }
}

/// What the viewer starts with.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Start {
    pub(crate) scene: (Name, u64),
    pub(crate) at: Stamp,
    pub(crate) tab: Tab,
    pub(crate) kind: Kind,
    pub(crate) follow: Option<Follow>,
    pub(crate) layers: Layers,
}

impl Default for Start {
    fn default() -> Self {
        Self {
            scene: (Name::UrbanArterial, 1),
            at: Stamp::ZERO,
            tab: Tab::Drone,
            kind: Kind::Colour,
            follow: None,
            layers: Layers::default(),
        }
    }
}

/// The viewer.
pub(crate) struct App {
    scene: (Name, u64),
    time: TimeLine,
    tab: Tab,
    kind: Kind,
    follow: Follow,
    orbit: Orbit,
    layers: Layers,
    shows_help: bool,
    worker: Worker,
    /// Where vehicles are simulated beside it.
    history: Option<History>,
    loaded: Option<Arc<Loaded>>,
    pictures: Option<(Pictures, Vec<egui::TextureHandle>)>,
    cloud: Option<Cloud>,
    voxels: Option<Arc<VoxelMesh>>,
    moving: Option<(Stamp, Arc<Vec<Vertex>>)>,
    drawing: Option<(Shown, Arc<Drawing>)>,
    /// Counts answers: what has been drawn before one is old.
    answers: u64,
    failed: Option<WorkerError>,
    /// Passes a second, smoothed; 0 if unknown.
    rate_hz: f32,
}

/// All that the 3-D view depends on.
type Shown = (Wanted, Eye, Layers, u64);

impl App {
    /// A viewer; where vehicles are simulated, `history` tells of them. `wake` asks for a pass.
    pub(crate) fn new(start: Start, history: Option<History>, wake: Wake) -> anyhow::Result<Self> {
        let mut app = Self {
            scene: start.scene,
            time: TimeLine::new(start.at),
            tab: start.tab,
            kind: start.kind,
            follow: Follow::Free,
            orbit: Orbit::behind(1.0),
            layers: start.layers,
            shows_help: false,
            worker: Worker::start(wake)?,
            history,
            loaded: None,
            pictures: None,
            cloud: None,
            voxels: None,
            moving: None,
            drawing: None,
            answers: 0,
            failed: None,
            rate_hz: 0.0,
        };
        let follow = start.follow.unwrap_or(match start.scene.0 {
            Name::Room => Follow::Free,
            _ => Follow::Ground,
        });
        app.set_follow(follow);
        app.ask();
        Ok(app)
    }

    /// What is wanted of sensors at the moment that is shown.
    pub(crate) fn wanted(&self) -> Wanted {
        let history = self.history.as_ref();
        let poses = history.map_or(Poses::default(), |history| history.poses(self.time.at()));
        Wanted {
            scene: self.scene,
            at: self.time.at(),
            poses,
            tab: self.tab,
            kind: self.kind,
            lidar: self.layers.has(Layer::Lidar),
            voxels: self.layers.has(Layer::Voxels),
        }
    }

    fn ask(&self) {
        self.worker.ask(self.wanted());
    }

    /// Lets `seconds` of real time pass, takes what has been drawn and asks for what is wanted now. Never waits.
    pub(crate) fn logic(&mut self, ctx: &egui::Context, seconds: f64) {
        if let Some(present) = self.history.as_mut().and_then(History::listen) {
            self.time.reach(present);
        }
        self.time.advance(seconds);
        if seconds > 0.0 && self.time.is_playing() {
            let rate_hz = (1.0 / seconds) as f32;
            let share = if self.rate_hz > 0.0 { 0.1 } else { 1.0 };
            self.rate_hz += (rate_hz - self.rate_hz) * share;
        }
        while self.failed.is_none() {
            match self.worker.poll() {
                Ok(Some(answer)) => self.take(ctx, answer),
                Ok(None) => break,
                Err(error) => self.failed = Some(error),
            }
        }
        self.ask();
    }

    fn take(&mut self, ctx: &egui::Context, answer: Answer) {
        self.answers += 1;
        match answer {
            Answer::Scene(loaded) => {
                if self.scene == (loaded.name, loaded.seed) {
                    self.moving = None;
                    self.loaded = Some(loaded);
                }
            }
            Answer::Pictures(pictures) => {
                let textures = pictures
                    .panels
                    .iter()
                    .map(|panel| pictures::load(ctx, panel));
                let textures = textures.collect();
                self.pictures = Some((pictures, textures));
            }
            Answer::Cloud(cloud) => self.cloud = Some(cloud),
            Answer::Voxels(mesh) => self.voxels = Some(mesh),
        }
    }

    /// The scene that is wanted, if it is there.
    fn current(&self) -> Option<&Arc<Loaded>> {
        let is_wanted = |loaded: &&Arc<Loaded>| (loaded.name, loaded.seed) == self.scene;
        self.loaded.as_ref().filter(is_wanted)
    }

    /// Whether everything that is shown is of the moment that is shown.
    pub(crate) fn is_settled(&self) -> bool {
        let wanted = self.wanted();
        let pictures = self.pictures.as_ref();
        let has_pictures = pictures.is_some_and(|(shown, _)| shown.of.has_pictures_of(&wanted));
        let cloud = self.cloud.as_ref();
        let has_cloud = cloud.is_some_and(|cloud| cloud.of.has_returns_of(&wanted));
        self.current().is_some()
            && has_pictures
            && (has_cloud || !wanted.lidar)
            && (self.voxels_of(&wanted).is_some() || !wanted.voxels)
    }

    /// Waits until everything that is shown is of the moment that is shown: for pictures without a window.
    pub(crate) fn settle(&mut self, ctx: &egui::Context, patience: Duration) -> anyhow::Result<()> {
        self.logic(ctx, 0.0);
        while !self.is_settled() {
            if let Some(error) = self.failed {
                return Err(error.into());
            }
            let answer = self.worker.wait(patience)?;
            let Some(answer) = answer else {
                anyhow::bail!("the pictures were not drawn within {patience:?}");
            };
            self.take(ctx, answer);
            self.logic(ctx, 0.0);
        }
        Ok(())
    }

    fn voxels_of(&self, wanted: &Wanted) -> Option<&Arc<VoxelMesh>> {
        let scene = &self.current()?.scene;
        let around = super::sensors::Around::of(wanted, scene);
        self.voxels.as_ref().filter(|mesh| mesh.of == around)
    }

    /// Follows someone else, from where one sees it well.
    pub(crate) fn set_follow(&mut self, follow: Follow) {
        self.orbit = match follow {
            Follow::Free => match self.scene.0 {
                Name::Room => Orbit {
                    target: Point3::new(1.3, 0.0, 0.6),
                    heading_rad: 1.0,
                    pitch_rad: 0.95,
                    distance_m: 10.0,
                },
                _ => Orbit {
                    target: Point3::new(20.0, 0.0, 1.0),
                    heading_rad: 0.5,
                    pitch_rad: 0.6,
                    distance_m: 70.0,
                },
            },
            Follow::Drone => Orbit::behind(7.0),
            Follow::Ground | Follow::Camera => Orbit {
                heading_rad: 0.2,
                ..Orbit::behind(13.0)
            },
        };
        self.follow = follow;
    }

    fn set_scene(&mut self, scene: (Name, u64)) {
        let is_other_place = self.scene.0 != scene.0;
        self.scene = scene;
        if is_other_place {
            let follow = match scene.0 {
                Name::Room => Follow::Free,
                _ if self.follow == Follow::Free => Follow::Ground,
                _ => self.follow,
            };
            self.set_follow(follow);
        }
    }

    /// Draws the viewer, and does what is asked for in it.
    pub(crate) fn ui(&mut self, ui: &mut egui::Ui) {
        self.keys(ui.ctx());
        egui::Panel::top("choices").show(ui, |ui| self.choices_ui(ui));
        egui::Panel::bottom("time").show(ui, |ui| self.time_ui(ui));
        let share = 0.3 * ui.available_width();
        egui::Panel::right("sensors")
            .default_size(share.clamp(260.0, 700.0))
            .size_range(220.0..=1400.0)
            .show(ui, |ui| self.pictures_ui(ui));
        egui::CentralPanel::no_frame().show(ui, |ui| self.scene_ui(ui));
        if self.shows_help {
            self.help_ui(ui.ctx());
        }
    }

    /// Whether another pass is due even if nobody moves anything.
    pub(crate) fn is_moving(&self) -> bool {
        self.time.is_playing()
    }
}

#[cfg(test)]
pub(super) mod test {
    use super::*;

    impl App {
        pub(crate) fn time_mut(&mut self) -> &mut TimeLine {
            &mut self.time
        }

        pub(crate) fn eye_for_test(&self, size: [f64; 2]) -> Eye {
            self.eye(self.current().expect("a scene"), size)
        }

        pub(crate) fn choose(&mut self, tab: Tab, kind: Kind) {
            (self.tab, self.kind) = (tab, kind);
        }

        pub(crate) fn scene_for_test(&self) -> Arc<Loaded> {
            Arc::clone(self.current().expect("a scene"))
        }

        pub(crate) fn shown_pictures(&self) -> Option<&Pictures> {
            self.pictures.as_ref().map(|(pictures, _)| pictures)
        }
    }
}
