use std::fs;

use super::judge::Row;
use super::methods::STATIC;
use super::suite::{share_ghosts, tail};
use super::*;

fn row(method: &str, ghosts: f64) -> Row {
    Row {
        case: "sitl-room-1100".to_owned(),
        method: method.to_owned(),
        figures: vec![("ghost_voxels", ghosts)],
    }
}

#[test]
fn ghosts_are_shares_of_what_the_static_method_leaves() {
    let mut rows = [row("tandem", 2.0), row(STATIC, 400.0)];
    share_ghosts(&mut rows);
    assert_eq!(rows[0].get("ghost_share"), Some(0.005));
    assert_eq!(rows[1].get("ghost_share"), Some(1.0));
    // Without ghosts, or without that method, there is nothing to share.
    let mut rows = [row("tandem", 2.0), row(STATIC, 0.0)];
    share_ghosts(&mut rows);
    assert_eq!(rows[0].get("ghost_share"), None);
    let mut rows = [row("tandem", 2.0)];
    share_ghosts(&mut rows);
    assert_eq!(rows[0].get("ghost_share"), None);
}

fn names(request: &Request<'_>) -> (Vec<String>, Vec<String>) {
    let mut notes = Vec::new();
    let cases = cases(request, &mut notes).expect("cases");
    (cases.into_iter().map(|case| case.name).collect(), notes)
}

#[test]
fn cases_have_the_names_of_recordings_and_of_scenes_with_their_seed() {
    let data = tempfile::tempdir().expect("a folder");
    let recording = data.path().join("bonn_x");
    fs::create_dir(&recording).expect("made");
    fs::write(recording.join("associations.txt"), "").expect("written");
    fs::create_dir(data.path().join("notes")).expect("made");
    let options = Options {
        cases: vec!["bonn".to_owned(), "alley".to_owned()],
        seeds: 2,
        ..Options::default()
    };
    let mut say = |_: &str| {};
    let request = Request {
        seed: None,
        data: Some(data.path()),
        out: data.path(),
        slam: &options,
        say: &mut say,
    };
    let (names, notes) = names(&request);
    let expected = [
        "bonn_x",
        "sitl-residential-alley-1100",
        "sitl-residential-alley-1101",
    ];
    assert_eq!(names, expected);
    assert!(
        notes.len() == 1 && notes[0].starts_with("notes is left out"),
        "{notes:?}"
    );
}

#[test]
fn a_method_that_there_is_not_is_refused_before_anything_runs() {
    let error = chosen(&["tandem".to_owned(), "magic".to_owned()])
        .err()
        .expect("refused");
    assert!(
        error.to_string().contains("magic") && error.to_string().contains("no-dynamics"),
        "{error}"
    );
    assert_eq!(chosen(&[]).expect("all").len(), METHODS.len());
}

#[test]
fn only_the_last_lines_of_what_a_program_said_are_told() {
    assert_eq!(tail(b"a\nb\n\nc\nd\n"), "b | c | d");
    assert_eq!(tail(b""), "");
}
