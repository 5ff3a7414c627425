//! The viewer without a window, on whatever graphics device there is.

use std::time::Duration;

use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use egui_kittest::wgpu::{WgpuTestRenderer, create_render_state, default_wgpu_setup};
use maps::time::Stamp;
use sitl::palette;
use sitl::render::Stage;
use sitl::scene::Scene;
use sitl::simulation::{Event, Simulation};

use super::app::App;
use super::*;

const PATIENCE: Duration = Duration::from_mins(3);
const SCENE: (Name, u64) = (Name::ResidentialAlley, 1100);
const AT: Stamp = Stamp::from_nanos(8_000_000_000);
/// Between passes, in seconds.
const STEP: f32 = 0.05;

struct Image {
    width: usize,
    pixels: Vec<[u8; 4]>,
}

impl Image {
    /// The part of it within `rect`.
    fn within(&self, rect: egui::Rect) -> Vec<[u8; 4]> {
        let [left, right] = [rect.min.x, rect.max.x].map(|x| x as usize);
        let rows = rect.min.y as usize..rect.max.y as usize;
        let part = rows.map(|row| &self.pixels[row * self.width + left..row * self.width + right]);
        part.flatten().copied().collect()
    }

    fn pixel(&self, column: usize, row: usize) -> [u8; 4] {
        self.pixels[row * self.width + column]
    }
}

fn start(layers: &[Layer]) -> Start {
    Start {
        scene: SCENE,
        at: AT,
        layers: Layers {
            shown: Layer::ALL.map(|(layer, _)| layers.contains(&layer)),
            ..Layers::default()
        },
        ..Start::default()
    }
}

fn shown(app: App, size: [f32; 2]) -> Harness<'static, App> {
    let options = egui_wgpu::RendererOptions::PREDICTABLE;
    let state = create_render_state(default_wgpu_setup(), options);
    gpu::install(&state, false);
    let pass = |ui: &mut egui::Ui, app: &mut App| {
        let passed = ui.ctx().input(|input| input.unstable_dt);
        app.logic(ui.ctx(), f64::from(passed));
        app.ui(ui);
    };
    Harness::builder()
        .with_size(egui::vec2(size[0], size[1]))
        .with_step_dt(STEP)
        .renderer(WgpuTestRenderer::from_render_state(state))
        .build_ui_state(pass, app)
}

fn app(start: Start) -> App {
    App::new(start, None, Box::new(|| {})).expect("threads")
}

fn settle(window: &mut Harness<'_, App>) {
    let ctx = window.ctx.clone();
    window.run_steps(1);
    window.state_mut().settle(&ctx, PATIENCE).expect("drawn");
    window.run_steps(3);
}

fn picture(window: &mut Harness<'_, App>) -> Image {
    settle(window);
    let image = window.render().expect("a picture");
    Image {
        width: image.width() as usize,
        pixels: image.pixels().map(|pixel| pixel.0).collect(),
    }
}

fn canvas(window: &Harness<'_, App>) -> egui::Rect {
    window.get_by_label("scene in three dimensions").rect()
}

#[test]
fn the_view_shows_the_street_and_the_drone_where_its_pose_projects() {
    let mut window = shown(app(start(&[Layer::Surfaces])), [760.0, 460.0]);
    let image = picture(&mut window);
    let rect = canvas(&window);
    let colours: std::collections::BTreeSet<_> = image.pixels.iter().collect();
    assert!(colours.len() > 3000, "{} colours", colours.len());

    let eye = window
        .state()
        .eye_for_test([rect.width(), rect.height()].map(f64::from));
    let loaded = window.state().scene_for_test();
    let drone = window.state().wanted().uav(&loaded.scene);
    let size = [rect.width(), rect.height()].map(f64::from);
    let [x, y] = eye
        .pixel(drone.translation().raw, size)
        .expect("before the eye");
    let middle = [f64::from(rect.min.x) + x, f64::from(rect.min.y) + y];
    let is_orange = |[r, g, b, _]: [u8; 4]| r > 190 && (90..200).contains(&g) && b < 90;
    let mut near = 0;
    let mut above = 0;
    for (i, pixel) in image.pixels.iter().enumerate() {
        let (column, row) = (i % image.width, i / image.width);
        let is_inside = rect.contains(egui::pos2(column as f32, row as f32));
        if is_inside && is_orange(*pixel) {
            let off = [column as f64 - middle[0], row as f64 - middle[1]];
            near += usize::from(off[0].hypot(off[1]) < 25.0);
            above += usize::from(off[1] < -40.0 || off[0].abs() > 60.0);
        }
    }
    assert!(
        near > 30 && above < near / 4,
        "{near} near, {above} elsewhere"
    );
}

#[test]
fn seeking_shows_another_moment_and_back_the_same() {
    let mut window = shown(app(start(&[Layer::Surfaces, Layer::Boxes])), [560.0, 380.0]);
    let mut at = |at| {
        window.state_mut().time_mut().seek(at);
        let image = picture(&mut window);
        image.within(canvas(&window))
    };
    let now = at(AT);
    let later = at(AT + Duration::from_secs(4));
    let both = now.iter().zip(&later);
    let share = both.filter(|(a, b)| a != b).count() as f64 / now.len() as f64;
    assert!(share > 0.1, "{share}");
    assert!(at(AT) == now, "the same moment again");
}

#[test]
fn play_runs_and_pause_holds() {
    let mut window = shown(app(start(&[])), [760.0, 420.0]);
    settle(&mut window);
    window.get_by_label("Play").click();
    window.run_steps(10);
    let at = window.state().wanted().at;
    assert!(at > AT + Duration::from_millis(300), "{at:?}");
    window.get_by_label("Pause").click();
    window.run_steps(2);
    let at = window.state().wanted().at;
    window.run_steps(10);
    assert_eq!(window.state().wanted().at, at);
    window.get_by_label("- 0.1 s").click();
    window.run_steps(2);
    assert_eq!(window.state().wanted().at, at - Duration::from_millis(100));
}

#[test]
fn a_camera_tab_shows_the_exact_picture_pixel_by_pixel() {
    let scene = Scene::generate(SCENE.0, SCENE.1);
    let pose = sitl::platform::uav_camera(&scene, AT, SCENE.1);
    let moment = Stage::new(&scene).at(AT);
    let exact = moment.picture(&sitl::depth_camera::d455(), pose);
    let mut window = shown(app(start(&[])), [2300.0, 900.0]);
    for (kind, expected) in [
        (Kind::Colour, palette::colours(&exact)),
        (Kind::Class, palette::classes(&scene, &exact)),
        (Kind::Depth, palette::depths(&exact)),
        (Kind::Instance, palette::instances(&exact)),
    ] {
        window.state_mut().choose(Tab::Drone, kind);
        let image = picture(&mut window);
        let rect = window.get_by_label("picture: drone").rect();
        assert_eq!(rect.size(), egui::vec2(640.0, 480.0), "pixel by pixel");
        let [left, top] = [rect.min.x, rect.min.y].map(|c| c.round() as usize);
        let mut wrong = 0;
        for (i, pixel) in expected.pixels().iter().enumerate() {
            let shown = image.pixel(left + i % 640, top + i / 640);
            wrong += usize::from(shown[..3] != *pixel);
        }
        assert_eq!(wrong, 0, "{kind:?}");
    }
}

#[test]
fn every_tab_has_its_pictures() {
    let mut window = shown(app(start(&[])), [1000.0, 620.0]);
    for (label, names) in [
        ("Ground", vec!["front", "left", "rear", "right"]),
        (
            "Above",
            vec!["street (truth)", "occlusion (truth)", "LiDAR"],
        ),
        ("Drone", vec!["drone"]),
    ] {
        window.get_by_label(label).click();
        settle(&mut window);
        for name in names {
            window.get_by_label(&format!("picture: {name}"));
        }
    }
}

#[test]
fn what_is_old_says_so_until_it_is_drawn_anew() {
    let mut window = shown(app(start(&[])), [760.0, 420.0]);
    settle(&mut window);
    assert!(window.query_by_label_contains("STALE").is_none());
    window
        .state_mut()
        .time_mut()
        .seek(AT + Duration::from_millis(500));
    window.run_steps(1);
    window.get_by_label("STALE: 0.50 s before");
    let old = window.state().shown_pictures().expect("still there").of.at;
    assert_eq!(old, AT);
    settle(&mut window);
    assert!(window.query_by_label_contains("STALE").is_none());
}

#[test]
fn keys_do_what_the_help_says() {
    let mut window = shown(app(start(&[])), [760.0, 560.0]);
    settle(&mut window);
    window.key_press(egui::Key::F1);
    window.run_steps(2);
    window.get_by_label("run or stand");
    window.key_press(egui::Key::ArrowRight);
    window.run_steps(2);
    assert_eq!(window.state().wanted().at, AT + Duration::from_millis(100));
    window.key_press(egui::Key::Home);
    window.key_press(egui::Key::V);
    window.key_press(egui::Key::T);
    window.run_steps(2);
    let wanted = window.state().wanted();
    assert_eq!((wanted.at, wanted.voxels), (Stamp::ZERO, true));
    assert_eq!(wanted.tab, Tab::Ground);
}

#[test]
fn a_run_is_followed_and_its_vehicles_are_where_it_says() {
    let origin = "50.7277,7.0866,110".parse().expect("a place");
    let mut simulation = Simulation::new([sitl::simulation::copter(&origin, None, 1)]);
    let (mut teller, history) = world::channel();
    for _ in 0..100 {
        simulation.step(&Event::Tick);
        teller.tell(&simulation);
    }
    let room = Start {
        scene: (Name::Room, 1),
        ..start(&[])
    };
    let app = App::new(room, Some(history), Box::new(|| {})).expect("threads");
    let mut window = shown(app, [760.0, 420.0]);
    settle(&mut window);
    window.get_by_label("LIVE");
    let wanted = window.state().wanted();
    assert_eq!(wanted.at, simulation.now());
    let truth = simulation.vehicles().next().expect("a copter").truth();
    assert_eq!(wanted.poses.uav, Some(truth.world_from_body));
    let pictures = window.state().shown_pictures().expect("drawn");
    assert_eq!(pictures.of.poses.uav, Some(truth.world_from_body));
    window.get_by_label("- 0.1 s").click();
    window.run_steps(2);
    window.get_by_label("to live");
}

#[test]
fn a_screenshot_is_a_picture_of_that_size() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("room.png");
    let room = Start {
        scene: (Name::Room, 1),
        ..Start::default()
    };
    headless::screenshot(room, [640, 400], &file).expect("drawn");
    let decoder = png::Decoder::new(std::io::BufReader::new(
        std::fs::File::open(&file).expect("written"),
    ));
    let mut reader = decoder.read_info().expect("a PNG");
    assert_eq!((reader.info().width, reader.info().height), (640, 400));
    let mut bytes = vec![0; reader.output_buffer_size().expect("a size")];
    reader.next_frame(&mut bytes).expect("pixels");
    let colours: std::collections::BTreeSet<_> = bytes.chunks(4).collect();
    assert!(colours.len() > 1000, "{}", colours.len());
    let nowhere = folder.path().join("no/such/folder.png");
    let error = headless::screenshot(room, [640, 400], &nowhere).expect_err("no folder");
    assert!(format!("{error:#}").contains("cannot write"), "{error:#}");
}

#[test]
fn sizes_and_moments_that_cannot_be_are_refused() {
    for text in ["", "640", "640x", "10x10", "640x99999", "-640x480"] {
        assert!(size(text).is_err(), "{text}");
    }
    assert_eq!(size("640x480"), Ok([640, 480]));
    for text in ["", "x", "-1", "NaN", "inf"] {
        assert!(moment(text).is_err(), "{text}");
    }
    assert_eq!(moment("1.5"), Ok(Stamp::from_nanos(1_500_000_000)));
}

#[test]
fn a_run_beside_a_window_that_cannot_open_is_stopped() {
    let (stopper, heard) = std::sync::mpsc::sync_channel::<()>(1);
    let shown = alongside(
        move || drop(stopper),
        move |_teller| {
            // Until the other end is dropped.
            assert!(heard.recv().is_err());
            Ok(())
        },
        |_history, has_ended| {
            assert!(!has_ended());
            anyhow::bail!("no display")
        },
    );
    assert_eq!(shown.expect_err("no window").to_string(), "no display");
}

#[test]
fn a_run_that_fails_says_so_when_its_window_has_closed() {
    let fails = |_teller: Teller| anyhow::bail!("the link is gone");
    let shown = alongside(
        || {},
        fails,
        |_history, has_ended| {
            while !has_ended() {
                std::thread::yield_now();
            }
            Ok(())
        },
    );
    assert_eq!(shown.expect_err("a cause").to_string(), "the link is gone");
}
