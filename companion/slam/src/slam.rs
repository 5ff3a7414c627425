//! The state machine: a map is started, followed, lost and found again.

mod atlas;
mod bending;
mod closing;
mod handing_out;
mod hearing;
mod plumb;
mod positions;

use std::collections::VecDeque;
use std::sync::Arc;

use maps::camera::{Pinhole, RgbdFrame};
use maps::frame::{Camera, Isometry, World};
use maps::time::Stamp;
use nalgebra::{Isometry3, Matrix6};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::SeedableRng as _;

use crate::aid::Aid;
use crate::bundle::{Local, Solved};
use crate::dense::{DenseKeyframe, Pending};
use crate::drift::{self, Drift};
use crate::dynamics::{self, History, Scene};
use crate::front_end::{FrontEnd, Look};
use crate::level::{self, Floor, Plane};
use crate::map::{Keyframe, KeyframeId, Map, Standing};
use crate::mapping;
use crate::matching::Sighting;
use crate::motion::Motion;
use crate::optics::Optics;
use crate::revisit;
use crate::settings::{Mapping, Moving, Settings};
use crate::solver::Fit;
use crate::stage::{Stage, Watch};
use crate::tracked::{FrameError, Overlay, State, Tracked};
use crate::tracking::{self, Located};
use crate::triangulate;
use crate::worker::Worker;
use bending::Bent;
use closing::{BackEnd, Recognised};
use plumb::Plumb;
use positions::Positions;

/// The least number of features with depth that starts a map.
const FEWEST_TO_START: usize = 80;
/// So many frames after a keyframe its adjustment is due: with the next one, as what is tracked against an unadjusted
/// keyframe is told wrong.
const ADJUSTED_AFTER: usize = 1;
/// Covariance of a pose that is not known.
const UNKNOWN: f64 = 1e6;

/// RGB-D SLAM: frames in, poses and dense keyframes out.
pub struct Slam {
    settings: Settings,
    front_end: FrontEnd,
    /// The front end's.
    optics: Arc<Optics>,
    watch: Option<Watch>,
    /// Adjusts the window; due [`ADJUSTED_AFTER`] a keyframe.
    mapper: Worker<Solved>,
    /// Compares a keyframe with older ones; due with the next keyframe.
    seeker: Worker<Option<Recognised>>,
    rng: Pcg64,
    map: Map,
    state: State,
    floor: Option<Floor>,
    last: Last,
    /// What moved in the last frames.
    moved: History,
    /// Keyframes whose poses still move, oldest first.
    window: VecDeque<KeyframeId>,
    log: Vec<Logged>,
    settled: Vec<DenseKeyframe>,
    reset_counter: u32,
    /// Which keyframe a lost camera is compared with next.
    next_try: usize,
    back: BackEnd,
    positions: Positions,
    plumb: Plumb,
    /// Due with the next keyframe.
    bender: Worker<Option<Bent>>,
}

/// The last frame that was looked at; the motion and covariance are of the last one whose pose was found.
struct Last {
    at: Option<Stamp>,
    sighting: Sighting,
    motion: Motion,
    covariance: Matrix6<f64>,
    frames_since_keyframe: usize,
    rejected: usize,
}

/// A tracked frame, tied to the keyframe it was tracked against: it moves with it in bundle adjustment.
struct Logged {
    at: Stamp,
    map: u32,
    reference: KeyframeId,
    reference_from_camera: Isometry3<f64>,
}

/// Where the system gives no thread, the work is done in the caller's.
fn worker<T: Send + 'static>(settings: &Settings, name: &str) -> Worker<T> {
    let thread = settings.threaded.then(|| Worker::thread(name).ok());
    thread.flatten().unwrap_or(Worker::Here(None))
}

impl Slam {
    /// SLAM for this camera, with an empty map.
    pub fn new(camera: Pinhole, settings: Settings) -> Self {
        let front_end = FrontEnd::new(camera, &settings);
        Self {
            optics: Arc::clone(&front_end.optics),
            front_end,
            watch: None,
            mapper: worker(&settings, "slam-map"),
            seeker: worker(&settings, "slam-loops"),
            rng: Pcg64::seed_from_u64(settings.seed),
            map: Map::default(),
            state: State::Searching,
            floor: None,
            last: Last {
                at: None,
                sighting: Sighting::default(),
                motion: Motion::default(),
                covariance: Matrix6::identity() * UNKNOWN,
                frames_since_keyframe: 0,
                rejected: 0,
            },
            moved: History::default(),
            window: VecDeque::new(),
            log: Vec::new(),
            settled: Vec::new(),
            reset_counter: 0,
            next_try: 0,
            back: BackEnd::default(),
            positions: Positions::default(),
            plumb: Plumb::default(),
            bender: worker(&settings, "slam-bend"),
            settings,
        }
    }

    /// Finds where the camera was when it took `frame`. A frame in which that is impossible is no error: see
    /// [`Tracked::state`].
    pub fn track(&mut self, frame: &RgbdFrame) -> Result<Tracked, FrameError> {
        self.track_aided(frame, &Aid::default())
    }

    /// The same with what else is known of the frame.
    pub fn track_aided(&mut self, frame: &RgbdFrame, aid: &Aid<'_>) -> Result<Tracked, FrameError> {
        let look = self.front_end.look(frame)?;
        self.lap(Stage::Features);
        self.track_look(frame, look, aid)
    }

    /// Finds features as [`Slam::track`] does; for another thread, ahead of [`Slam::track_look`].
    pub fn front_end(&self) -> FrontEnd {
        self.front_end.clone()
    }

    /// Has `watch` told whenever a stage of a frame is over, in the thread that tracks: it may read a clock.
    pub fn watch(&mut self, watch: impl FnMut(Stage) + Send + 'static) {
        self.watch = Some(Box::new(watch));
    }

    /// The same as [`Slam::track_aided`], for a frame in which features were sought before.
    pub fn track_look(
        &mut self,
        frame: &RgbdFrame,
        look: Look,
        aid: &Aid<'_>,
    ) -> Result<Tracked, FrameError> {
        self.check(frame, &look)?;
        self.last.at = Some(frame.at);
        if let Some(seen) = aid.objects.filter(|seen| seen.of != frame.at) {
            self.hear(&seen);
        }
        if self.last.frames_since_keyframe + 1 >= ADJUSTED_AFTER {
            self.take_adjustment();
        }
        let mut now = Sighting::new(&self.optics, look.features, look.coarse);
        let keyframe = match self.state {
            State::Searching => self.start(frame, now, aid),
            State::Tracking | State::Lost { .. } => match self.locate(frame.at, &mut now, aid) {
                Some(fit) => self.follow(frame, now, (&fit, aid)),
                None => self.lose(frame, now, aid),
            },
        };
        if let Some(fix) = &aid.position {
            self.note_position(fix);
        }
        self.note_felt(aid);
        Ok(self.outcome(frame.at, keyframe))
    }

    /// Every tracked frame whose place in the world is known, as known now: frames move with the keyframes they were
    /// tracked against. Those of a map begun after the place was lost come in once it is joined to the others.
    pub fn trajectory(&self) -> Vec<(Stamp, Isometry<World, Camera>)> {
        let pose = |logged: &Logged| {
            let map = self.map_of(logged.map)?;
            let reference = map.poses.get(logged.reference.0 as usize)?;
            let joined = map.standing == Standing::Joined;
            joined.then(|| {
                (
                    logged.at,
                    Isometry::claim(reference * logged.reference_from_camera),
                )
            })
        };
        self.log.iter().filter_map(pose).collect()
    }

    /// What was made of the last frame, for pictures.
    pub fn overlay(&self) -> Overlay {
        let now = &self.last.sighting;
        let matched = now.features.iter().zip(&now.points);
        let moving = |raw: [f32; 2]| now.coarse.moving[self.optics.cell_at(raw)];
        Overlay {
            tracked: matched
                .filter(|(_, p)| p.is_some())
                .map(|(f, _)| f.raw)
                .collect(),
            rejected: now
                .features
                .iter()
                .map(|f| f.raw)
                .filter(|&raw| moving(raw))
                .collect(),
            cell_px: self.optics.stride,
            cells_across: self.optics.cells_across,
            moving: (0..now.coarse.moving.len())
                .map(|cell| now.coarse.is_unmapped(cell))
                .collect(),
        }
    }

    /// What the floor was taken to be in the frame that started the map; none before.
    pub fn floor(&self) -> Option<Floor> {
        self.floor
    }

    /// Map points and keyframes held now, in all maps.
    pub fn map_size(&self) -> (usize, usize) {
        let all = || std::iter::once(&self.map).chain(&self.back.stored);
        (
            all().map(Map::point_count).sum(),
            all().map(|map| map.keyframes.len()).sum(),
        )
    }

    fn check(&self, frame: &RgbdFrame, look: &Look) -> Result<(), FrameError> {
        if look.at != frame.at {
            return Err(FrameError::OtherLook {
                at: frame.at,
                look: look.at,
            });
        }
        match self.last.at {
            Some(before) if frame.at <= before => Err(FrameError::Order {
                at: frame.at,
                before,
            }),
            Some(_) | None => Ok(()),
        }
    }

    fn start(&mut self, frame: &RgbdFrame, mut now: Sighting, aid: &Aid<'_>) -> bool {
        let deep = now.features.iter().filter(|f| f.depth_m.is_some()).count();
        if deep < FEWEST_TO_START {
            self.last.sighting = now;
            return false;
        }
        let heights_m = &self.settings.floor_below_m;
        let found = level::find_floor(&self.optics, &now.coarse, heights_m, &mut self.rng);
        let height_m = self.settings.initial_height_m;
        self.floor = Some(found.map_or(Floor::Assumed { height_m }, |plane| plane.as_found()));
        let floor = found.unwrap_or(Plane::level(height_m));
        let pose = level::first_pose(&floor, self.settings.initial_heading_rad);
        self.mark_moving(&mut now, &pose, aid);
        self.state = State::Tracking;
        self.last.motion = Motion::at_rest(frame.at, pose);
        self.last.covariance = Matrix6::identity() * 1e-12;
        self.last.sighting = now;
        self.insert_keyframe(frame);
        self.record(frame.at);
        true
    }

    /// The pose of the frame and, left in `now`, the points that support it.
    fn locate(&mut self, at: Stamp, now: &mut Sighting, aid: &Aid<'_>) -> Option<Fit> {
        let known = Located {
            optics: &self.optics,
            map: &self.map,
        };
        let fit = match self.state {
            State::Tracking => known.follow(
                &self.last.sighting,
                &self.last.motion,
                &self.last.motion.guess(at, aid),
                now,
            ),
            State::Searching | State::Lost { .. } => None,
        };
        let fit = fit.or_else(|| {
            let candidates = tracking::candidates(&self.map, now, self.next_try);
            self.next_try += 1;
            known.find_again(&candidates, now, &mut self.rng)
        })?;
        self.lap(Stage::Pose);
        let rate = self.last.motion.turn_rate(at, &fit.world_from_camera);
        now.coarse.turned(&self.optics, rate);
        let fit = self.reject_moving(now, fit, aid)?;
        self.lap(Stage::Moving);
        (fit.agreeing >= tracking::FEWEST).then_some(fit)
    }

    /// Marks what moves in a frame taken from `pose`.
    fn mark_moving(&mut self, now: &mut Sighting, pose: &Isometry3<f64>, aid: &Aid<'_>) {
        let unknown = Sighting::default();
        let followed = self.state == State::Tracking;
        let at = self.last.at.unwrap_or(Stamp::ZERO);
        let scene = Scene {
            optics: &self.optics,
            map: &self.map,
            at,
            last: if followed {
                &self.last.sighting
            } else {
                &unknown
            },
            last_pose: &self.last.motion.pose,
            pose,
            objects: aid.objects.filter(|s| s.of == at).map(|s| s.objects),
        };
        match self.settings.moving {
            Moving::Ignore => {}
            Moving::Paper => dynamics::reject_objects(&scene, now, &mut self.rng),
            Moving::Reject => dynamics::reject_moving(&scene, now, &mut self.moved),
        }
    }

    /// Marks what moves, and fits again without it.
    fn reject_moving(&mut self, now: &mut Sighting, fit: Fit, aid: &Aid<'_>) -> Option<Fit> {
        let pose = fit.world_from_camera;
        self.mark_moving(now, &pose, aid);
        let mut dropped = 0;
        for i in 0..now.features.len() {
            let moving = now.coarse.moving[self.optics.cell_at(now.features[i].raw)];
            if moving && now.points[i].is_some() {
                now.forget_match(i);
                dropped += 1;
            }
        }
        if dropped == 0 {
            return Some(fit);
        }
        let known = Located {
            optics: &self.optics,
            map: &self.map,
        };
        known.fit_matches(now, &pose, fit.prior)
    }

    fn follow(&mut self, frame: &RgbdFrame, now: Sighting, (fit, aid): (&Fit, &Aid<'_>)) -> bool {
        let pose = fit.world_from_camera;
        if matches!(self.state, State::Lost { .. }) || self.last.motion.jumps_to(frame.at, &pose) {
            self.reset_counter = self.reset_counter.wrapping_add(1);
            self.last.motion = Motion::at_rest(frame.at, pose);
        } else {
            self.last.motion.advance(frame.at, pose, aid);
        }
        self.state = State::Tracking;
        mapping::count_found(&self.optics, &mut self.map, &now, &pose);
        let moving = |raw: [f32; 2]| now.coarse.moving[self.optics.cell_at(raw)];
        self.last.rejected = now.features.iter().filter(|f| moving(f.raw)).count();
        self.last.covariance = self.uncertainty(&now, fit);
        self.last.sighting = now;
        self.last.frames_since_keyframe += 1;
        let keyframe = self.needs_keyframe(fit.agreeing);
        if keyframe {
            self.insert_keyframe(frame);
            self.lap(Stage::Keyframe);
        }
        self.record(frame.at);
        keyframe
    }

    fn uncertainty(&self, now: &Sighting, fit: &Fit) -> Matrix6<f64> {
        let twist = self.last.motion.twist();
        let shared = drift::shared(self.optics.camera.fx, now.median_depth_m(), &twist);
        Drift::of(&self.map, &now.points).widen(&(fit.covariance + shared))
    }

    fn needs_keyframe(&self, agreeing: usize) -> bool {
        let Some(reference) = self.window.back().and_then(|id| self.map.keyframes.get(id)) else {
            return true;
        };
        mapping::needs_keyframe(
            reference,
            &self.last.sighting,
            (&self.optics, &self.last.motion.pose),
            (agreeing, self.last.frames_since_keyframe),
        )
    }

    fn insert_keyframe(&mut self, frame: &RgbdFrame) {
        self.take_adjustment();
        let now = &self.last.sighting;
        let keyframe = Keyframe {
            at: frame.at,
            world_from_camera: self.last.motion.pose,
            features: now.features.clone(),
            points: now.points.clone(),
            coarse: now.coarse.clone(),
            pending: Some(Pending::new(
                frame,
                self.front_end.depths,
                self.settings.dense_stride,
            )),
            surface: None,
            tracked: now.matched(),
            drift: Drift::from_covariance(&self.last.covariance),
        };
        if self.settings.mapping == Mapping::LastKeyframe {
            return self.restart_from(keyframe);
        }
        let id = self.map.add_keyframe(keyframe);
        if self.window.is_empty() {
            self.map.starts.push(id);
        }
        mapping::forget_seen_through(&self.optics, &mut self.map, id);
        self.window.push_back(id);
        let window = self.window.make_contiguous();
        revisit::correct_drift(&self.optics, &mut self.map, window, &mut self.rng);
        mapping::add_points(&self.optics, &mut self.map, id);
        triangulate::add_far_points(&self.optics, &mut self.map, self.window.make_contiguous());
        let limits = (&self.settings, self.most_keyframes());
        mapping::cull(&mut self.map, self.window.make_contiguous(), limits);
        let id = self.close_loop(id);
        self.bend();
        if let Some(k) = self.map.keyframes.get_mut(&id) {
            k.tracked = k.points.iter().flatten().count();
        }
        self.resume_from(id);
        if let Some(local) = Local::new(&self.map, self.window.make_contiguous()) {
            let optics = Arc::clone(&self.optics);
            self.mapper.start(move || local.solve(&optics));
        }
        self.last.frames_since_keyframe = 0;
    }

    /// Puts the adjusted window into the map and tidies up, if it was not done since the last keyframe.
    fn take_adjustment(&mut self) {
        let Some(solved) = self.mapper.take() else {
            return;
        };
        let Some(&newest) = self.window.back() else {
            return;
        };
        let newest_from_camera = self.pose_of(newest).inverse() * self.last.motion.pose;
        solved.write_back(&mut self.map);
        while self.window.len() > self.settings.window.max(2) {
            if let Some(oldest) = self.window.pop_front() {
                self.settle(oldest);
            }
        }
        self.correct(self.pose_of(newest) * newest_from_camera);
    }

    fn pose_of(&self, keyframe: KeyframeId) -> Isometry3<f64> {
        self.map.poses[keyframe.0 as usize]
    }

    /// The last frame was this keyframe: its points and pose are those to go on from.
    fn resume_from(&mut self, id: KeyframeId) {
        if let Some(k) = self.map.keyframes.get(&id) {
            self.last.sighting.points.clone_from(&k.points);
            self.correct(k.world_from_camera);
        }
    }

    /// The last frame was taken from this pose, as known now.
    fn correct(&mut self, pose: Isometry3<f64>) {
        if self.last.motion.is_off(&pose) {
            self.reset_counter = self.reset_counter.wrapping_add(1);
        }
        self.last.motion.correct(pose);
    }

    /// The map becomes what this keyframe sees; all else is handed out and forgotten.
    fn restart_from(&mut self, mut keyframe: Keyframe) {
        while let Some(id) = self.window.pop_front() {
            self.settle(id);
            self.map.remove_keyframe(id);
        }
        keyframe.points.fill(None);
        let id = self.map.add_keyframe(keyframe);
        self.window.push_back(id);
        mapping::add_points(&self.optics, &mut self.map, id);
        if let Some(k) = self.map.keyframes.get_mut(&id) {
            k.tracked = k.points.iter().flatten().count();
            self.last.sighting.points.clone_from(&k.points);
        }
        self.last.frames_since_keyframe = 0;
    }

    fn lap(&mut self, stage: Stage) {
        if let Some(watch) = &mut self.watch {
            watch(stage);
        }
    }

    fn record(&mut self, at: Stamp) {
        if let Some(&reference) = self.window.back() {
            let pose = self.map.poses[reference.0 as usize];
            self.log.push(Logged {
                at,
                map: self.map.number,
                reference,
                reference_from_camera: pose.inverse() * self.last.motion.pose,
            });
        }
    }

    fn outcome(&self, at: Stamp, keyframe: bool) -> Tracked {
        let now = &self.last.sighting;
        let tracking = self.state == State::Tracking;
        let known = tracking && self.map.standing == Standing::Joined;
        let measured = now.coarse.depth_m.iter().filter(|&&d| d > 0.0).count();
        let depths = now.coarse.depth_m.iter().enumerate();
        let moving = depths
            .filter(|&(cell, &depth)| depth > 0.0 && now.coarse.is_unmapped(cell))
            .count();
        Tracked {
            at,
            state: self.state,
            world_from_camera: Isometry::claim(self.last.motion.pose),
            covariance: if known {
                self.last.covariance
            } else {
                Matrix6::identity() * UNKNOWN
            },
            reset_counter: self.reset_counter,
            points: if tracking { now.matched() } else { 0 },
            rejected: self.last.rejected,
            moving_share: moving as f64 / measured.max(1) as f64,
            keyframe,
        }
    }
}
