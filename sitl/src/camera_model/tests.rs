use maps::frame::{Camera, Isometry, Point, Vector, World};
use nalgebra::{Isometry3, Translation3, UnitQuaternion};

use super::*;
use crate::depth_camera::d455;
use crate::platform;
use crate::scene::{Face, Instance, Light, Material, Name, Scene};

const DEPTH_M: f64 = 5.0;
const AT: Stamp = Stamp::from_nanos(1_000_000_000);
const POLE: Instance = Instance(7);

/// A rectangle at the pole's depth before a camera at the origin that looks along z, of this width and far too high.
fn scene(width_m: f64, material: Material) -> Scene {
    let face = Face {
        corner: Point::new(-width_m / 2.0, 50.0, DEPTH_M),
        edge_u: Vector::new(width_m, 0.0, 0.0),
        edge_v: Vector::new(0.0, -100.0, 0.0),
        top: [0.0, 1.0],
        material,
        instance: POLE,
    };
    Scene::of(vec![face], Light::Lamps(Vec::new()))
}

/// A camera that passes the pole at `AT`, to the left in the picture's sense.
fn passing(speed_mps: f64) -> impl Fn(Stamp) -> Isometry<World, Camera> + Sync {
    move |at| {
        let t = at.as_secs_f64() - AT.as_secs_f64();
        let place = Translation3::new(-speed_mps * t, 0.0, 0.0);
        Isometry::claim(Isometry3::from_parts(place, UnitQuaternion::identity()))
    }
}

fn still() -> impl Fn(Stamp) -> Isometry<World, Camera> + Sync {
    passing(0.0)
}

fn fixed(time: Duration, gain: f32) -> Exposure {
    Exposure::Fixed(Setting { time, gain })
}

fn shoot(optics: Optics, scene: &Scene, pose_at: &PoseAt<'_>) -> Shot {
    let mut camera = CameraModel::new(d455(), optics, 1).expect("sound optics");
    camera.shoot(&Stage::new(scene), AT, pose_at)
}

/// The middle column of the pole in a row.
fn pole_in_row(picture: &Picture, row: usize) -> f64 {
    let columns = 0..picture.width;
    let shown: Vec<f64> = columns
        .filter(|column| picture.instance[row * picture.width + column] == POLE)
        .map(|column| column as f64)
        .collect();
    assert!(!shown.is_empty(), "no pole in row {row}");
    shown.iter().sum::<f64>() / shown.len() as f64
}

#[test]
fn ideal_optics_give_the_ideal_picture() {
    let scene = Scene::generate(Name::ResidentialAlley, 3);
    let stage = Stage::new(&scene);
    let pose_at = |at| platform::uav_camera(&scene, at, 3);
    let mut camera = CameraModel::new(d455(), Optics::IDEAL, 1).expect("sound optics");
    let ideal = stage.at(AT).picture(&d455(), pose_at(AT));
    assert!(camera.shoot(&stage, AT, &pose_at).picture == ideal);
    // Not only because it takes a short cut: light that is kept and developed later gives the same.
    let kept = stage.at(AT).radiance(&d455(), pose_at(AT));
    let rgb = camera.develop(&kept, stage.exposure(), 1.0);
    assert!(kept.with_colours(rgb) == ideal);
}

#[test]
fn rows_that_are_drawn_one_by_one_from_one_pose_are_the_picture_from_there() {
    let scene = Scene::generate(Name::UrbanArterial, 3);
    let stage = Stage::new(&scene);
    let pose = platform::uav_camera(&scene, AT, 3);
    let readout = Readout {
        at: AT,
        // So short that nothing moves by as much as rounding does.
        duration: Duration::from_nanos(480),
        rows: 480,
    };
    let scanned = stage.scan(&d455(), readout, &|_| pose);
    let whole = stage.at(AT).radiance(&d455(), pose);
    let pairs = scanned.instance.iter().zip(&whole.instance);
    let differing = pairs.filter(|(a, b)| a != b).count();
    // On the very edges of those who move.
    assert!(differing < 20, "{differing} pixels show something else");
    let pairs = scanned.depth_m.iter().zip(&whole.depth_m);
    let off = pairs.filter(|(a, b)| (*a - *b).abs() > 1e-3).count();
    assert!(off < 20, "{off} pixels have another depth");
}

#[test]
fn a_rolling_shutter_bends_a_pole_by_speed_times_readout() {
    let scene = scene(0.1, Material::Rubber);
    let lens = d455();
    let (speed_mps, readout_s) = (10.0, 0.03);
    let optics = Optics {
        readout: Duration::from_secs_f64(readout_s),
        ..Optics::IDEAL
    };
    let shot = shoot(optics, &scene, &passing(speed_mps));
    let [top, middle, last] = [0, 240, 479].map(|row| pole_in_row(&shot.picture, row));
    let between_rows = 479.0 / 480.0;
    let bent = lens.fx * speed_mps * readout_s / DEPTH_M * between_rows;
    assert!(
        (last - top - bent).abs() <= 1.0,
        "{} px, not {bent}",
        last - top
    );
    assert!((middle - lens.cx).abs() <= 1.0, "the middle is at {middle}");
    let straight = shoot(Optics::IDEAL, &scene, &passing(speed_mps)).picture;
    assert!((pole_in_row(&straight, 479) - pole_in_row(&straight, 0)).abs() < 1e-9);
}

#[test]
fn each_row_says_when_it_was_exposed_and_its_truth_is_of_that_time() {
    let scene = scene(0.1, Material::Rubber);
    let optics = Optics {
        readout: Duration::from_millis(30),
        exposure: fixed(Duration::from_millis(8), 1.0),
        blur_samples: 5,
        photosites: None,
    };
    let shot = shoot(optics, &scene, &passing(10.0));
    for row in [0, 100, 300, 479] {
        let pose = passing(10.0)(shot.readout.time_of(row));
        let sharp = Stage::new(&scene).at(AT).picture(&d455(), pose);
        let off = pole_in_row(&shot.picture, row) - pole_in_row(&sharp, row);
        assert!(off.abs() < 1e-9, "row {row} is {off} px off");
    }
}

#[test]
fn a_pole_blurs_over_speed_times_exposure() {
    let scene = scene(0.1, Material::Rubber);
    let lens = d455();
    let (speed_mps, time_s, samples) = (10.0, 0.03, 31);
    let optics = Optics {
        exposure: fixed(Duration::from_secs_f64(time_s), 0.2),
        blur_samples: samples,
        ..Optics::IDEAL
    };
    let dark = |pose_at: &PoseAt<'_>| {
        let picture = shoot(optics, &scene, pose_at).picture;
        let row = &picture.rgb[240 * 640..241 * 640];
        row.iter().filter(|pixel| pixel[1] < row[0][1]).count() as f64
    };
    // The sky is the same whether it is blurred or not, and of the pole's way the samples span all but one share.
    let blurred = dark(&passing(speed_mps)) - dark(&still());
    let length = lens.fx * speed_mps * time_s / DEPTH_M * (1.0 - 1.0 / f64::from(samples));
    assert!(
        (blurred - length).abs() <= 1.5,
        "{blurred} px, not {length}"
    );
}

#[test]
fn blur_keeps_the_mean_of_the_light() {
    let scene = scene(0.5, Material::Rubber);
    let optics = Optics {
        exposure: fixed(Duration::from_millis(20), 0.3),
        blur_samples: 21,
        ..Optics::IDEAL
    };
    let camera = CameraModel::new(d455(), optics, 1).expect("sound optics");
    let setting = Some(optics.exposure.start());
    let readout = Readout {
        at: AT,
        duration: Duration::ZERO,
        rows: 480,
    };
    let light = |pose_at: &PoseAt<'_>| {
        let light = camera
            .gather(&Stage::new(&scene), readout, setting, pose_at)
            .light;
        light
            .iter()
            .map(|pixel| f64::from(pixel[1]))
            .collect::<Vec<_>>()
    };
    let [sharp, blurred] = [light(&still()), light(&passing(10.0))];
    let (sky, pole) = (sharp[0], sharp[240 * 640 + 320]);
    let mean = blurred.iter().sum::<f64>() / blurred.len() as f64;
    let covered = (mean - sky) / (pole - sky) * 640.0;
    let width = d455().fx * 0.5 / DEPTH_M;
    // Of each sample whole pixels count.
    assert!(
        (covered - width).abs() < 0.2,
        "{covered} px of the pole, not {width}"
    );
}

#[track_caller]
fn check_convergence(start: Setting) {
    let scene = scene(100.0, Material::Lamp { is_red: false });
    let automatic = Automatic {
        start,
        ..Automatic::USUAL
    };
    let optics = Optics {
        exposure: Exposure::Automatic(automatic),
        ..Optics::IDEAL
    };
    let stage = Stage::new(&scene);
    let mut camera = CameraModel::new(d455(), optics, 1).expect("sound optics");
    let mut levels = Vec::new();
    for frame in 0..60 {
        let at = AT + Duration::from_millis(33 * frame);
        let shot = camera.shoot(&stage, at, &still());
        let setting = shot.setting.expect("automatic");
        assert!((automatic.times[0]..=automatic.times[1]).contains(&setting.time));
        assert!((1.0..=automatic.most_gain).contains(&setting.gain));
        levels.push(mean_level(&shot.picture.rgb));
    }
    let [first, last] = [levels[0], levels[59]];
    assert!(
        (first - automatic.target).abs() > 0.2,
        "it starts at {first}"
    );
    assert!((last - automatic.target).abs() < 0.01, "it ends at {last}");
    // No overshoot: each picture is at least as near the target as the one before, but for rounding.
    let errors: Vec<f32> = levels
        .iter()
        .map(|l| (l - automatic.target).abs())
        .collect();
    let is_nearer = |pair: &[f32]| pair[1] <= pair[0] + 0.005;
    assert!(errors.windows(2).all(is_nearer), "{levels:?}");
}

#[test]
fn automatic_exposure_finds_its_target_from_the_dark() {
    check_convergence(Setting {
        time: Duration::from_micros(100),
        gain: 1.0,
    });
}

#[test]
fn automatic_exposure_finds_its_target_from_a_white_picture() {
    check_convergence(Setting {
        time: Duration::from_millis(10),
        gain: 16.0,
    });
}

#[test]
fn automatic_exposure_stops_at_its_limits() {
    let dark = Automatic::USUAL.after(Automatic::USUAL.start, 0.0, Duration::from_secs(1000));
    assert_eq!(dark.time, Duration::from_millis(10));
    assert!((dark.gain - 16.0).abs() < 1e-6);
    let white = Automatic::USUAL.after(
        Setting {
            time: Duration::from_micros(100),
            gain: 1.0,
        },
        1.0,
        Duration::from_secs(1000),
    );
    assert_eq!(white.time, Duration::from_micros(100));
    assert!((white.gain - 1.0).abs() < 1e-6);
}

#[test]
fn the_variance_of_noise_is_that_of_emva_1288() {
    let scene = scene(100.0, Material::Lamp { is_red: false });
    let photosites = Photosites {
        full_well_e: 4000.0,
        read_noise_e: 10.0,
    };
    for gain in [1.0_f32, 4.0, 8.0] {
        let optics = Optics {
            // So that each is as bright as the others.
            exposure: fixed(Duration::from_secs_f32(0.008 / gain), gain),
            photosites: Some(photosites),
            ..Optics::IDEAL
        };
        let noisy = shoot(optics, &scene, &still()).picture;
        let clean = Optics {
            photosites: None,
            ..optics
        };
        let share = f64::from(shoot(clean, &scene, &still()).picture.rgb[0][1]) / 255.0;
        let share = share * share;
        let levels: Vec<f64> = noisy.rgb.iter().map(|pixel| f64::from(pixel[1])).collect();
        let mean = levels.iter().sum::<f64>() / levels.len() as f64;
        let squares: f64 = levels.iter().map(|level| (level - mean).powi(2)).sum();
        let variance = squares / levels.len() as f64;
        let k = f64::from(gain / photosites.full_well_e);
        let of_share = k * share + (k * f64::from(photosites.read_noise_e)).powi(2);
        // The gamma's slope there, and what rounding to whole levels adds.
        let expected = of_share * (127.5 * 127.5 / share) + 1.0 / 12.0;
        assert!(
            (variance / expected - 1.0).abs() < 0.05,
            "at gain {gain}: {variance}, not {expected}"
        );
    }
}

#[test]
fn noise_is_the_same_for_the_same_seed_and_moment_only() {
    let scene = scene(100.0, Material::Lamp { is_red: false });
    let optics = Optics {
        photosites: Some(Photosites::SMALL),
        ..Optics::IDEAL
    };
    let stage = Stage::new(&scene);
    let shoot = |seed, at| {
        let mut camera = CameraModel::new(d455(), optics, seed).expect("sound optics");
        camera.shoot(&stage, at, &still()).picture.rgb
    };
    let later = AT + Duration::from_millis(33);
    assert!(shoot(1, AT) == shoot(1, AT));
    assert!(shoot(1, AT) != shoot(2, AT));
    assert!(shoot(1, AT) != shoot(1, later));
}

#[test]
fn a_rolling_picture_is_the_same_on_one_thread_and_on_two() {
    let scene = Scene::generate(Name::ResidentialAlley, 2);
    let stage = Stage::new(&scene);
    let optics = Optics {
        blur_samples: 3,
        ..Optics::ROLLING_SHUTTER
    };
    let take = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().expect("threads");
        let mut camera = CameraModel::new(d455(), optics, 1).expect("sound optics");
        pool.install(|| camera.shoot(&stage, AT, &|at| platform::uav_camera(&scene, at, 2)))
    };
    assert!(take(1) == take(2));
}

#[test]
fn optics_that_make_no_sense_are_refused_by_name() {
    #[track_caller]
    fn check(optics: Optics, expected: &str) {
        let error = CameraModel::new(d455(), optics, 1).expect_err("nonsense");
        assert_eq!(error.to_string(), expected);
    }
    let ideal = Optics::IDEAL;
    check(
        Optics {
            blur_samples: 4,
            ..ideal
        },
        "blur_samples is 4: take an odd number from 1 to 63",
    );
    check(
        Optics {
            readout: Duration::from_secs(3),
            ..ideal
        },
        "the readout time is 3 s: take at most 1 s",
    );
    check(
        Optics {
            exposure: fixed(Duration::from_millis(5), f32::NAN),
            ..ideal
        },
        "gain is NaN: take a finite number above 0",
    );
    check(
        Optics {
            exposure: Exposure::Automatic(Automatic {
                times: [Duration::from_millis(5), Duration::from_millis(2)],
                ..Automatic::USUAL
            }),
            ..ideal
        },
        "the shortest exposure is 0.005 s and the longest 0.002 s: take more than 0 for the first and no less for the other",
    );
    check(
        Optics {
            exposure: Exposure::Automatic(Automatic {
                target: 1.5,
                ..Automatic::USUAL
            }),
            ..ideal
        },
        "the target of automatic exposure is 1.5: take a mean level above 0 and below 1",
    );
    check(
        Optics {
            photosites: Some(Photosites {
                full_well_e: 0.0,
                read_noise_e: 4.0,
            }),
            ..ideal
        },
        "full_well_e is 0: take a finite number above 0",
    );
    check(
        Optics {
            photosites: Some(Photosites {
                full_well_e: 100.0,
                read_noise_e: -1.0,
            }),
            ..ideal
        },
        "read_noise_e is -1: take a finite number that is not below 0",
    );
}
