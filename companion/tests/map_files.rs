//! What `companion map` does, from file to file.

use std::fs;
use std::path::Path;
use std::time::Duration;

use companion::map::MapError;
use companion::map::conflict::Conflict;
use companion::map::drawing::draw;
use companion::map::files::{OpenedMap, open, save_octomap};
use companion::map::info::{Info, Tiles};
use companion::map::stored::{Imported, import};
use maps::picture::{Paint, Request};
use maps::time::Stamp;
use maps::voxel::{ClassId, LogOdds, Rgb, Voxel, VoxelKey, VoxelMap};
use octomap::{Colors, Content, ReadOptions, Shape};
use store::AsOf;

/// A floor of 4 m by 4 m, red and of class 7, under a metre of free space.
fn floor() -> VoxelMap {
    let mut map = VoxelMap::new(0.1);
    for i in 0..40 * 40 {
        let (x, y) = (i % 40 - 20, i / 40 - 20);
        let voxel = Voxel {
            color: Some(Rgb([255, 0, 0])),
            class: ClassId(7),
            ..Voxel::new(LogOdds::MAX)
        };
        map.set_voxel(VoxelKey::new(x, y, -1), voxel);
        for z in 0..10 {
            map.set_voxel(VoxelKey::new(x, y, z), Voxel::new(LogOdds::MIN));
        }
    }
    map
}

fn save(map: &VoxelMap, path: &Path, content: Content) -> Result<(), MapError> {
    save_octomap(map, path, content, Shape::default())
}

/// The text of an error with its causes.
fn text(error: &MapError) -> String {
    let mut texts = vec![error.to_string()];
    let mut cause = std::error::Error::source(error);
    while let Some(error) = cause {
        texts.push(error.to_string());
        cause = error.source();
    }
    texts.join(": ")
}

#[test]
fn a_map_is_described_in_lines() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("floor.ot");
    save(&floor(), &path, Content::Class).expect("written");
    let options = ReadOptions {
        colors: Colors::Classes,
        ..ReadOptions::default()
    };
    let opened = OpenedMap {
        resident_bytes: Some(88 << 10),
        ..open(&path, &options, AsOf::Newest).expect("a map")
    };
    let digest = opened.map.digest();
    let said = Info::new(&opened, Tiles::Listed).to_string();
    let lines: Vec<_> = said.lines().collect();
    assert!(
        lines[0].starts_with("file        OctoMap .ot, ColorOcTree of "),
        "{}",
        lines[0]
    );
    let expected = [
        "resolution  0.1 m".to_owned(),
        "bounds      -2.00 to 2.00 m east, -2.00 to 2.00 m north, -0.10 to 1.00 m up".to_owned(),
        "occupied    1600 voxels, 0 with a colour, 1600 with a class".to_owned(),
        "free        16000 voxels".to_owned(),
        "tiles       8".to_owned(),
        "memory      0.1 MiB, 5.12 bytes a known voxel".to_owned(),
        format!("digest      {digest}"),
    ];
    assert_eq!(lines[1..8], expected);
    assert!(
        lines[10].starts_with("-1/-1/-1             400          0  "),
        "{}",
        lines[10]
    );
    assert_eq!(lines.len(), 18);
}

#[test]
fn a_map_is_drawn_into_a_png_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let (map, png) = (
        folder.path().join("floor.ot"),
        folder.path().join("floor.png"),
    );
    save(&floor(), &map, Content::Color).expect("written");
    let opened = open(&map, &ReadOptions::default(), AsOf::Newest).expect("a map");
    let request = Request {
        paint: Paint::Color,
        title: "floor.ot",
        width: 640,
        height: 480,
        ceiling_m: None,
    };
    draw(&opened.map, &map, &request, &png).expect("drawn");
    let decoder = png::Decoder::new(std::io::Cursor::new(fs::read(&png).expect("drawn")));
    let info = decoder.read_info().expect("a PNG file");
    assert_eq!((info.info().width, info.info().height), (640, 480));
    let error = draw(
        &opened.map,
        &map,
        &request,
        &folder.path().join("floor.jpg"),
    )
    .expect_err("no PNG");
    assert!(
        error.to_string().ends_with("it must end in .png"),
        "{error}"
    );
}

#[test]
fn what_cannot_be_done_is_said() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let error = save(&floor(), &at("floor.bt"), Content::Class).expect_err("no classes in .bt");
    assert!(error.to_string().ends_with("write a .ot file"), "{error}");
    let error = save(&floor(), &at("floor.pcd"), Content::Color).expect_err("no .pcd");
    assert!(
        error.to_string().ends_with("it must end in .ot or .bt"),
        "{error}"
    );
    let error =
        open(&at("missing.ot"), &ReadOptions::default(), AsOf::Newest).expect_err("no file");
    assert!(
        text(&error).contains("missing.ot: No such file"),
        "{}",
        text(&error)
    );
    fs::write(at("text.ot"), "hello").expect("written");
    let error = open(&at("text.ot"), &ReadOptions::default(), AsOf::Newest).expect_err("no map");
    assert!(
        text(&error).ends_with("does not begin as an OctoMap .ot or .bt file does"),
        "{}",
        text(&error)
    );
}

#[test]
fn a_map_goes_into_a_store_and_comes_out_as_it_was_at_each_time() {
    let folder = tempfile::tempdir().expect("a folder");
    let store = folder.path().join("site.tandem");
    let mut map = floor();
    let at = Duration::from_secs;
    let first = import(&map, &store, at(100)).expect("a new store");
    let before = map.digest();
    assert_eq!((first.changed, first.same), (8, 0));
    map.set_voxel(VoxelKey::new(3, 3, 5), Voxel::new(LogOdds::MAX));
    let second = import(&map, &store, at(200)).expect("the same store");
    let expected = Imported {
        changed: 1,
        same: 7,
    };
    assert_eq!(second, expected, "only what has changed");
    let read = |as_of| open(&store, &ReadOptions::default(), as_of);
    let then = read(AsOf::Time(Stamp::ZERO + at(150))).expect("the past");
    let now = read(AsOf::Newest).expect("the present");
    assert_eq!(
        (then.map.digest(), now.map.digest()),
        (before, map.digest())
    );
    let said = Info::new(&now, Tiles::Counted).to_string();
    assert!(said.contains("tile store, 8 tiles"), "{said}");
    let error = read(AsOf::Time(Stamp::ZERO + at(50))).expect_err("before all");
    assert!(text(&error).contains("no tile at that time"), "{error}");
}

#[test]
fn what_does_not_fit_a_store_is_refused_with_the_reason() {
    let folder = tempfile::tempdir().expect("a folder");
    let store = folder.path().join("site.tandem");
    import(&floor(), &store, Duration::from_secs(1)).expect("a new store");
    let coarse = VoxelMap::new(0.2);
    let error = import(&coarse, &store, Duration::from_secs(2)).expect_err("other voxels");
    assert!(
        text(&error).contains("voxels of 0.1 m, this map of 0.2 m"),
        "{error}"
    );
    let file = folder.path().join("floor.ot");
    save(&floor(), &file, Content::Occupancy).expect("written");
    let past = AsOf::Time(Stamp::ZERO);
    let error = open(&file, &ReadOptions::default(), past).expect_err("no history");
    assert!(text(&error).contains("leave out --at"), "{error}");
    fs::write(&store, b"SQLite format 3\0 and then nothing").expect("written");
    let error = open(&store, &ReadOptions::default(), AsOf::Newest).expect_err("no store");
    assert!(text(&error).contains("site.tandem"), "{error}");
}

#[test]
fn maps_conflict_where_one_is_sure_of_the_opposite() {
    let (before, mut now) = (floor(), floor());
    let parked = VoxelKey::new(0, 0, 3);
    now.set_voxel(parked, Voxel::new(LogOdds::MAX));
    let path = Path::new("before.ot");
    let conflict = Conflict::new(&now, (&before, path)).expect("voxels of one size");
    let k = conflict.at(parked).expect("both know it");
    assert!(k > 0.6, "occupied against free: {k}");
    assert_eq!(conflict.at(VoxelKey::new(1, 0, 3)), Some(0.0), "both free");
    assert_eq!(
        conflict.at(VoxelKey::new(0, 0, 50)),
        None,
        "nobody was there"
    );
    assert_eq!(conflict.count(), (40 * 40 * 11, 1));
    let gone = Conflict::new(&before, (&now, path)).expect("voxels of one size");
    assert_eq!(gone.both().occupied_count(), before.occupied_count() + 1);
    assert!(Conflict::new(&now, (&VoxelMap::new(0.2), path)).is_err());
}
