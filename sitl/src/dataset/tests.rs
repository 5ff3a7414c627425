use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use super::*;

fn settings(out: &Path) -> Settings {
    Settings {
        split: Split::Train,
        layout: Layout::Tandem,
        out: out.to_owned(),
        scenes: vec![Name::ResidentialAlley],
        seeds: 3..5,
        frames: 1,
        rate_hz: 2.0,
        threads: 2,
    }
}

fn make(settings: &Settings) -> Result<Outcome, DatasetError> {
    run(settings, &Local, &AtomicBool::new(false), |_| {})
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a folder")
}

/// All files below a folder, with what is in them.
fn tree(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        let name = path
            .file_name()
            .expect("a name")
            .to_string_lossy()
            .into_owned();
        if path.is_dir() {
            let below = tree(&path);
            found.extend(
                below
                    .into_iter()
                    .map(|(below, bytes)| (format!("{name}/{below}"), bytes)),
            );
        } else {
            found.insert(name, fs::read(&path).expect("a file"));
        }
    }
    found
}

#[track_caller]
fn check_refusal(result: Result<Outcome, DatasetError>, words: &[&str]) {
    let text = result.expect_err("refused").to_string();
    for word in words {
        assert!(text.contains(word), "{word:?} is not in: {text}");
    }
}

#[test]
fn what_cannot_be_made_is_refused_with_what_can() {
    let out = folder();
    let base = settings(out.path());
    let with = |change: &dyn Fn(&mut Settings)| {
        let mut settings = base.clone();
        change(&mut settings);
        make(&settings)
    };
    check_refusal(
        with(&|s| s.seeds = 999..1001),
        &["999..1001", "0..1000", "train"],
    );
    check_refusal(with(&|s| s.split = Split::Test), &["1100..1200"]);
    check_refusal(with(&|s| s.seeds = 3..3), &["at least one"]);
    check_refusal(with(&|s| s.scenes = vec![Name::Room]), &["room", "streets"]);
    check_refusal(with(&|s| s.rate_hz = 20.0), &["20", "--rate 10"]);
    check_refusal(with(&|s| s.rate_hz = f64::NAN), &["--rate 10"]);
    check_refusal(with(&|s| s.frames = 481), &["240.5 s", "--frames 480"]);
    assert_eq!(tree(out.path()), BTreeMap::new(), "nothing was written");
}

#[test]
fn splits_share_no_seed() {
    let [train, val, test] = [Split::Train, Split::Val, Split::Test].map(Split::seeds);
    assert!(train.end <= val.start && val.end <= test.start);
}

#[test]
fn bytes_are_the_same_on_any_number_of_threads_in_both_layouts() {
    for layout in [Layout::Tandem, Layout::Opv2v] {
        let [one, three] = [1, 3].map(|threads| {
            let out = folder();
            let settings = Settings {
                layout,
                threads,
                ..settings(out.path())
            };
            let outcome = make(&settings).expect("a set");
            assert_eq!((outcome.made, outcome.kept, outcome.missing), (2, 0, 0));
            tree(out.path())
        });
        assert!(one == three, "{layout}");
        let parts: Vec<_> = one.keys().filter(|name| name.contains(".part")).collect();
        assert!(parts.is_empty(), "{parts:?}");
    }
}

#[test]
fn a_run_that_was_killed_goes_on_with_what_is_missing() {
    let out = folder();
    let settings = settings(out.path());
    make(&settings).expect("a set");
    let whole = tree(out.path());
    let lost = settings.folder().join("residential-alley-0004");
    let part = settings.folder().join("residential-alley-0004.part");
    fs::rename(&lost, &part).expect("renamed");
    fs::write(part.join("000000_uav.png"), "half a pic").expect("written");
    fs::write(part.join("rubbish"), "rubbish").expect("written");
    let outcome = make(&settings).expect("the rest");
    assert_eq!((outcome.made, outcome.kept), (1, 1));
    assert!(tree(out.path()) == whole);
    let again = make(&settings).expect("nothing to do");
    assert_eq!((again.made, again.kept, again.bytes), (0, 2, 0));
}

#[test]
fn what_was_made_otherwise_is_refused_and_what_is_damaged_is_found() {
    let out = folder();
    let settings = Settings {
        seeds: 3..4,
        ..settings(out.path())
    };
    make(&settings).expect("a set");
    let folder = settings.folder().join("residential-alley-0003");
    let other = Settings {
        rate_hz: 1.0,
        ..settings.clone()
    };
    check_refusal(
        make(&other),
        &["1 frames at 2 Hz", "1 frames at 1 Hz", "--out"],
    );
    assert_eq!(check(&settings.folder()).expect("as written").sequences, 1);

    let path = folder.join("000000_lidar.bin");
    let right = fs::read(&path).expect("points");
    let mut wrong = right.clone();
    wrong[17] ^= 1;
    fs::write(&path, &wrong).expect("written");
    check_refusal(
        make(&settings),
        &["another version", "000000_lidar.bin", "--out"],
    );
    let error = check(&settings.folder()).expect_err("damaged").to_string();
    assert!(
        error.contains("residential-alley-0003") && error.contains("delete it"),
        "{error}"
    );

    fs::write(&path, &right[..100]).expect("written");
    check_refusal(make(&settings), &["damaged", "delete it"]);
    fs::remove_file(folder.join("sequence.json")).expect("removed");
    check_refusal(
        make(&settings),
        &["in the way", "residential-alley-0003", "sequence.json"],
    );
}

/// A disk with room for so many files.
struct Small {
    files: usize,
    written: AtomicUsize,
}

impl Disk for Small {
    fn room(&self, _: &Path) -> io::Result<u64> {
        Ok(u64::MAX)
    }

    fn write(&self, file: &Path, bytes: &[u8]) -> io::Result<()> {
        if self.written.fetch_add(1, Ordering::Relaxed) >= self.files {
            return Err(io::ErrorKind::StorageFull.into());
        }
        fs::write(file, bytes)
    }
}

#[test]
fn a_full_disk_is_told_of_and_leaves_whole_sequences_only() {
    let out = folder();
    let settings = Settings {
        threads: 1,
        ..settings(out.path())
    };
    // The manifest, the first sequence, and some of the second.
    let disk = Small {
        files: 1 + 22 + 5,
        written: AtomicUsize::new(0),
    };
    let result = run(&settings, &disk, &AtomicBool::new(false), |_| {});
    check_refusal(result, &["full", "goes on"]);
    let folders = |name: &str| settings.folder().join(name).exists();
    assert!(folders("residential-alley-0003"));
    assert!(!folders("residential-alley-0004") && !folders("residential-alley-0004.part"));
    let outcome = make(&settings).expect("there is room again");
    assert_eq!((outcome.made, outcome.kept), (1, 1));
    assert_eq!(check(&settings.folder()).expect("as written").sequences, 2);
}

#[test]
fn a_set_that_does_not_fit_is_not_begun() {
    struct Tiny;
    impl Disk for Tiny {
        fn room(&self, _: &Path) -> io::Result<u64> {
            Ok(3_000_000)
        }

        fn write(&self, file: &Path, _: &[u8]) -> io::Result<()> {
            panic!("{} is written", file.display());
        }
    }
    let out = folder();
    let result = run(
        &settings(out.path()),
        &Tiny,
        &AtomicBool::new(false),
        |_| {},
    );
    check_refusal(result, &["needs about", "3 MB free", "--seeds"]);
}

#[test]
fn told_to_stop_it_ends_after_the_frame_in_hand_and_leaves_nothing_half_made() {
    let out = folder();
    let settings = Settings {
        frames: 20,
        threads: 1,
        ..settings(out.path())
    };
    let stop = AtomicBool::new(false);
    let mut frames = 0;
    let outcome = run(&settings, &Local, &stop, |progress| {
        frames = progress.frames;
        stop.store(progress.frames > 0, Ordering::Relaxed);
    });
    let outcome = outcome.expect("stopped");
    assert_eq!((outcome.made, outcome.missing), (0, 2));
    // One may be drawn while the first is told of.
    assert!((1..=3).contains(&frames), "{frames} frames");
    let left: Vec<_> = tree(out.path()).into_keys().collect();
    assert_eq!(left, ["train/.lock", "train/dataset.json"]);
}

#[test]
fn two_programs_do_not_write_to_one_split() {
    let out = folder();
    let settings = settings(out.path());
    let mut second = None;
    let stop = AtomicBool::new(false);
    let _stopped = run(&settings, &Local, &stop, |_| {
        second.get_or_insert_with(|| make(&settings));
        stop.store(true, Ordering::Relaxed);
    });
    check_refusal(second.expect("watched"), &["another sitl", "train"]);
}

#[test]
fn the_size_that_is_told_beforehand_is_about_that_of_what_is_written() {
    let out = folder();
    let settings = Settings {
        seeds: 3..4,
        ..settings(out.path())
    };
    let mut expected = 0;
    let outcome = run(&settings, &Local, &AtomicBool::new(false), |progress| {
        expected = progress.all_bytes;
    });
    let written = outcome.expect("a set").bytes as f64;
    let ratio = expected as f64 / written;
    assert!((1.0..1.4).contains(&ratio), "{expected} for {written}");
}
