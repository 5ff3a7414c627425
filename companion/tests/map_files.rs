//! What `companion map` does, from file to file.

use std::fs;
use std::path::Path;

use companion::map::MapError;
use companion::map::drawing::draw;
use companion::map::files::{OpenedMap, open, save_octomap};
use companion::map::info::{Info, Tiles};
use maps::picture::{Paint, Request};
use maps::voxel::{ClassId, LogOdds, Rgb, Voxel, VoxelKey, VoxelMap};
use octomap::{Colors, Content, ReadOptions, Shape};

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
        ..open(&path, &options).expect("a map")
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
    let opened = open(&map, &ReadOptions::default()).expect("a map");
    let request = Request {
        paint: Paint::Color,
        title: "floor.ot",
        width: 640,
        height: 480,
        ceiling_m: None,
    };
    draw(&opened, &map, &request, &png).expect("drawn");
    let decoder = png::Decoder::new(std::io::Cursor::new(fs::read(&png).expect("drawn")));
    let info = decoder.read_info().expect("a PNG file");
    assert_eq!((info.info().width, info.info().height), (640, 480));
    let error =
        draw(&opened, &map, &request, &folder.path().join("floor.jpg")).expect_err("no PNG");
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
    let error = open(&at("missing.ot"), &ReadOptions::default()).expect_err("no file");
    assert!(
        text(&error).contains("missing.ot: No such file"),
        "{}",
        text(&error)
    );
    fs::write(at("text.ot"), "hello").expect("written");
    let error = open(&at("text.ot"), &ReadOptions::default()).expect_err("no map");
    assert!(
        text(&error).ends_with("does not begin as an OctoMap .ot or .bt file does"),
        "{}",
        text(&error)
    );
}
