//! A thread that draws what sensors see, so that the window never waits for it.
//!
//! There is one slot for what is wanted: who asks anew replaces what was asked for, so that the newest wins and nothing piles
//! up. Answers say what they are of: the window tells from that which are stale.

use std::num::NonZero;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, sync_channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use sitl::rays::Rays;
use sitl::render::Stage;
use sitl::render::diorama::{Diorama, Vertex};
use sitl::scene::{Name, Scene};

use super::sensors::{self, Around, Cloud, Pictures, Wanted};

/// Answers that may wait. A worker that finds no room waits, too.
const QUEUE: usize = 4;

/// A scene that can be shown.
#[derive(Debug)]
pub(crate) struct Loaded {
    pub(crate) name: Name,
    pub(crate) seed: u64,
    pub(crate) scene: Arc<Scene>,
    pub(crate) diorama: Diorama,
}

/// True voxels, as triangles.
#[derive(Debug)]
pub(crate) struct VoxelMesh {
    pub(crate) of: Around,
    pub(crate) vertices: Vec<Vertex>,
}

/// What has been made.
#[derive(Debug)]
pub(crate) enum Answer {
    Scene(Arc<Loaded>),
    Pictures(Pictures),
    Cloud(Cloud),
    Voxels(Arc<VoxelMesh>),
}

/// The worker is gone: it has stopped with a panic.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the thread that draws what sensors see has stopped; start the viewer anew, and please report what is on the terminal"
)]
pub(crate) struct WorkerError;

/// What wakes the window when there is an answer.
pub(crate) type Wake = Box<dyn Fn() + Send>;

/// The thread, from outside. It ends when this is dropped.
pub(crate) struct Worker {
    slot: Arc<Slot>,
    answers: Receiver<Answer>,
}

#[derive(Default)]
struct Slot {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    wanted: Option<Wanted>,
    has_ended: bool,
}

impl Slot {
    fn lock(&self) -> MutexGuard<'_, State> {
        // A panic elsewhere leaves it whole: it is only ever assigned to.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until something else is wanted; `None` when nothing will be.
    fn after(&self, done: Option<&Wanted>) -> Option<Wanted> {
        let is_done = |state: &mut State| !state.has_ended && state.wanted.as_ref() == done;
        let state = self.changed.wait_while(self.lock(), is_done);
        let state = state.unwrap_or_else(PoisonError::into_inner);
        state.wanted.filter(|_| !state.has_ended)
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.slot.lock().has_ended = true;
        self.slot.changed.notify_all();
    }
}

impl Worker {
    /// Starts it; `wake` is called after every answer. It leaves one processor to the window, where there are two.
    pub(crate) fn start(wake: Wake) -> anyhow::Result<Self> {
        let slot = Arc::new(Slot::default());
        let (to, answers) = sync_channel(QUEUE);
        let processors = thread::available_parallelism().map_or(1, NonZero::get);
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(processors.saturating_sub(1).max(1))
            .thread_name(|index| format!("sensors-{index}"))
            .build()?;
        let of_thread = Arc::clone(&slot);
        thread::Builder::new()
            .name("sensors".into())
            .spawn(move || pool.install(|| work(&of_thread, &Out { to, wake })))?;
        Ok(Self { slot, answers })
    }

    /// Replaces what was asked for.
    pub(crate) fn ask(&self, wanted: Wanted) {
        let mut state = self.slot.lock();
        if state.wanted != Some(wanted) {
            state.wanted = Some(wanted);
            self.slot.changed.notify_all();
        }
    }

    /// What has been made since.
    pub(crate) fn poll(&self) -> Result<Option<Answer>, WorkerError> {
        match self.answers.try_recv() {
            Ok(answer) => Ok(Some(answer)),
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Err(WorkerError),
        }
    }

    /// The same, but waits for it.
    pub(crate) fn wait(&self, patience: Duration) -> Result<Option<Answer>, WorkerError> {
        match self.answers.recv_timeout(patience) {
            Ok(answer) => Ok(Some(answer)),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(WorkerError),
        }
    }
}

struct Out {
    to: SyncSender<Answer>,
    wake: Wake,
}

impl Out {
    /// Whether somebody still listens.
    fn give(&self, answer: Answer) -> bool {
        let is_heard = self.to.send(answer).is_ok();
        (self.wake)();
        is_heard
    }
}

fn work(slot: &Slot, out: &Out) {
    let mut next = slot.after(None);
    while let Some(wanted) = next {
        let (name, seed) = wanted.scene;
        let scene = Arc::new(Scene::generate(name, seed));
        let stage = Stage::new(&scene);
        let loaded = Loaded {
            name,
            seed,
            diorama: Diorama::new(&stage),
            scene: Arc::clone(&scene),
        };
        if !out.give(Answer::Scene(Arc::new(loaded))) {
            return;
        }
        next = serve((slot, out), &stage, &Rays::new(&scene), wanted);
    }
}

/// Draws what is wanted of one scene; returns what is wanted of another.
fn serve(
    (slot, out): (&Slot, &Out),
    stage: &Stage<'_>,
    rays: &Rays<'_>,
    first: Wanted,
) -> Option<Wanted> {
    let scene = rays.scene();
    let (mut pictures, mut cloud) = (None::<Wanted>, None::<Wanted>);
    let mut voxels = None;
    let mut wanted = first;
    while wanted.scene == first.scene {
        if !pictures.is_some_and(|done| done.has_pictures_of(&wanted)) {
            let start = now();
            let panels = sensors::pictures(&wanted, &stage.at(wanted.at), rays);
            let took = start.elapsed();
            pictures = Some(wanted);
            let of = wanted;
            if !out.give(Answer::Pictures(Pictures { of, panels, took })) {
                return None;
            }
        }
        if wanted.lidar && !cloud.is_some_and(|done| done.has_returns_of(&wanted)) {
            let echoes = sensors::echoes(&wanted, rays);
            cloud = Some(wanted);
            let of = wanted;
            if !out.give(Answer::Cloud(Cloud { of, echoes })) {
                return None;
            }
        }
        let around = Around::of(&wanted, scene);
        if wanted.voxels && voxels != Some(around) {
            let vertices = around.voxels(scene);
            voxels = Some(around);
            let mesh = Arc::new(VoxelMesh {
                of: around,
                vertices,
            });
            if !out.give(Answer::Voxels(mesh)) {
                return None;
            }
        }
        wanted = slot.after(Some(&wanted))?;
    }
    Some(wanted)
}

#[expect(
    clippy::disallowed_methods,
    reason = "how long pictures take is shown; nothing depends on it"
)]
fn now() -> Instant {
    Instant::now()
}

#[cfg(test)]
mod tests {
    use super::super::sensors::{Kind, Tab};
    use super::super::world::Poses;
    use super::*;
    use maps::time::Stamp;

    const PATIENCE: Duration = Duration::from_mins(2);

    fn wanted(name: Name, millis: u64) -> Wanted {
        Wanted {
            scene: (name, 1),
            at: Stamp::from_nanos(millis * 1_000_000),
            poses: Poses::default(),
            tab: Tab::Drone,
            kind: Kind::Colour,
            lidar: false,
            voxels: false,
        }
    }

    fn worker() -> Worker {
        Worker::start(Box::new(|| {})).expect("threads")
    }

    fn next(worker: &Worker) -> Answer {
        worker.wait(PATIENCE).expect("alive").expect("in time")
    }

    #[test]
    fn the_newest_wish_wins_and_what_nobody_wants_any_more_is_not_drawn() {
        let worker = worker();
        for millis in 0..200 {
            worker.ask(wanted(Name::Room, millis));
        }
        let mut drawn = Vec::new();
        while drawn.last() != Some(&wanted(Name::Room, 199).at) {
            if let Answer::Pictures(pictures) = next(&worker) {
                drawn.push(pictures.of.at);
            }
        }
        assert!(drawn.len() <= 3, "{drawn:?}");
    }

    #[test]
    fn a_wish_of_another_scene_brings_that_scene_first() {
        let worker = worker();
        for name in [Name::Room, Name::ResidentialAlley, Name::Room] {
            worker.ask(wanted(name, 500));
            let Answer::Scene(loaded) = next(&worker) else {
                panic!("no scene");
            };
            assert_eq!((loaded.name, loaded.seed), (name, 1));
            let Answer::Pictures(pictures) = next(&worker) else {
                panic!("no pictures");
            };
            assert_eq!(pictures.of, wanted(name, 500));
        }
    }

    #[test]
    fn the_drones_picture_is_the_one_that_a_recording_has() {
        let worker = worker();
        worker.ask(wanted(Name::Room, 700));
        let pictures = loop {
            if let Answer::Pictures(pictures) = next(&worker) {
                break pictures;
            }
        };
        let scene = Scene::generate(Name::Room, 1);
        let at = Stamp::from_nanos(700_000_000);
        let pose = sitl::platform::uav_camera(&scene, at, 1);
        let camera = sitl::depth_camera::d455();
        let drawn = sitl::render::render(&scene, at, &camera, pose);
        assert!(pictures.panels[0].canvas.pixels() == drawn.rgb);
    }

    #[test]
    fn returns_and_voxels_come_when_they_are_wanted() {
        let worker = worker();
        let all = Wanted {
            lidar: true,
            voxels: true,
            ..wanted(Name::ResidentialAlley, 5000)
        };
        worker.ask(all);
        let answers = [(); 4].map(|()| next(&worker));
        let [_, _, Answer::Cloud(cloud), Answer::Voxels(mesh)] = &answers else {
            panic!("{} answers of other kinds", answers.len());
        };
        assert!(cloud.echoes.len() > 10_000 && mesh.vertices.len() > 10_000);
        // The vehicle stands on the road: most returns are near it, and none far below.
        let ugv = all.ugv(&Scene::generate(Name::ResidentialAlley, 1));
        let place = ugv.translation().raw;
        let near = |echo: &&sensors::Echo| {
            let [x, y, z] = echo.place.map(f64::from);
            (x - place.x).hypot(y - place.y) < 20.0 && z > -0.3
        };
        let share = cloud.echoes.iter().filter(near).count() as f64 / cloud.echoes.len() as f64;
        assert!(share > 0.5, "{share}");
    }

    #[test]
    fn a_worker_whose_window_is_gone_ends() {
        let slot = Arc::new(Slot::default());
        let (to, answers) = sync_channel(QUEUE);
        drop(answers);
        slot.lock().wanted = Some(wanted(Name::Room, 0));
        let wake: Wake = Box::new(|| {});
        work(&slot, &Out { to, wake });
    }
}
