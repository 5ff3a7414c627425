use std::time::Duration;

use maps::frame::{Isometry, Point};
use maps::scan::Scan;
use maps::time::Stamp;
use nalgebra::Isometry3;

use super::*;
use crate::config::Config;
use crate::figures::Figures;

/// A camera that goes round a circle of 1 m, seen from a world that is turned by this much.
fn circle(turned_rad: f64) -> Trajectory<Camera> {
    let pose = |i: u32| {
        let angle = f64::from(i) * 0.1;
        let place = Isometry3::translation(angle.cos(), angle.sin(), 1.5);
        let turned = Isometry3::rotation(nalgebra::Vector3::z() * turned_rad);
        let at = Stamp::from_nanos(u64::from(i) * 100_000_000);
        (at, Isometry::claim(turned * place))
    };
    Trajectory::new((0..63).map(pose).collect()).expect("increasing")
}

fn report() -> Report {
    let mut config = Config::default();
    config.source.path = "recording".into();
    let settings = config.check().expect("sound");
    Figures::new("<room> & \"more\"", Some(63), &settings.mapping).report(Stamp::ZERO)
}

fn rows() -> Vec<Row> {
    let row = |i: u64| Row {
        at: Stamp::from_nanos(i * 100_000_000),
        tracking: Duration::from_millis(20 + i % 7),
        mapping: Duration::from_millis(1),
        is_tracked: true,
        is_keyframe: i.is_multiple_of(10),
        points: 300,
        rejected: 12,
        moving_share: 0.1,
    };
    (0..63).map(row).collect()
}

fn map() -> VoxelMap {
    let mut map = VoxelMap::new(0.1);
    let floor: Vec<_> = (0..2500)
        .map(|i| Point::new(f64::from(i % 50) * 0.05, f64::from(i / 50) * 0.05, 0.0))
        .collect();
    map.insert_scan(&Scan::new(Point::new(1.0, 1.0, 1.5), &floor));
    map
}

#[test]
fn a_page_has_everything_in_itself() {
    let (report, estimate, truth) = (report(), circle(0.5), circle(0.0));
    let sample = Sample {
        at: Stamp::ZERO,
        size: [4, 2],
        rgb: vec![[9; 3]; 8],
    };
    let page = Page {
        report: &report,
        estimate: &estimate,
        truth: Some(&truth),
        rows: &rows(),
        samples: &[sample],
        map: &map(),
    };
    let html = page.html();
    assert_eq!(
        html.matches("<svg").count(),
        4,
        "way, errors, times, what moves"
    );
    assert_eq!(
        html.matches("data:image/png;base64,").count(),
        2,
        "a frame and the map"
    );
    for outside in ["http:", "https:", "<script", "src=\"/", "url("] {
        assert!(!html.contains(outside), "{outside}");
    }
    assert!(html.contains("&lt;room&gt; &amp; &quot;more&quot;") && !html.contains("<room>"));
    assert!(
        !html.contains("NaN") && !html.contains("inf"),
        "every number is one"
    );
    // Laid over each other, both go the same way: the lines have the same corners.
    let paths: Vec<&str> = html.split("class=\"line\" d=\"").skip(1).collect();
    let corner = |path: &str| path.split('L').nth(20).map(str::to_owned);
    assert_eq!(corner(paths[0]), corner(paths[1]));
}

#[test]
fn a_replay_in_which_nothing_was_found_still_makes_a_page() {
    let report = report();
    let none = Trajectory::new(Vec::new()).expect("no poses");
    let page = Page {
        report: &report,
        estimate: &none,
        truth: None,
        rows: &[],
        samples: &[],
        map: &VoxelMap::new(0.1),
    };
    let html = page.html();
    assert!(html.contains("nothing to draw") && html.contains("no voxel of the map is occupied"));
    assert!(!html.contains("Distance from the truth"));
    assert!(html.contains("stopped before the end"));
}
