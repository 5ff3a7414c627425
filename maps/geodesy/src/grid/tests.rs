use std::process::Command;

use proptest::prelude::*;

use super::*;

fn place(lat_deg: f64, lon_deg: f64) -> Geodetic {
    Geodetic {
        lat_deg,
        lon_deg,
        alt_m: 0.0,
    }
}

/// Metres between two places that are near each other.
fn metres(a: Geodetic, b: Geodetic) -> f64 {
    let around = (a.lon_deg - b.lon_deg + 540.0).rem_euclid(360.0) - 180.0;
    let east = around.to_radians() * a.lat_deg.to_radians().cos();
    let north = (a.lat_deg - b.lat_deg).to_radians();
    6_378_137.0 * east.hypot(north)
}

proptest! {
    #[test]
    fn utm_coordinates_come_back_to_a_micrometre(lat_deg in -90.0..90.0, lon_deg in -180.0..180.0) {
        let there = place(lat_deg, lon_deg);
        let back = Utm::of(there).and_then(|utm| utm.to_geodetic(0.0)).expect("the whole earth has some");
        prop_assert!(metres(there, back) < 1e-6, "{} m off", metres(there, back));
    }

    #[test]
    fn utm_text_comes_back_to_a_centimetre(lat_deg in -90.0..90.0, lon_deg in -180.0..180.0) {
        let utm = Utm::of(place(lat_deg, lon_deg)).expect("a place");
        let back: Utm = utm.to_string().parse().expect("we wrote it");
        prop_assert_eq!((back.zone, back.hemisphere), (utm.zone, utm.hemisphere));
        prop_assert!((back.easting_m - utm.easting_m).abs() < 0.0051);
        prop_assert!((back.northing_m - utm.northing_m).abs() < 0.0051);
    }

    #[test]
    fn a_place_is_within_its_square(lat_deg in -89.0..89.0, lon_deg in -180.0..180.0) {
        let there = place(lat_deg, lon_deg);
        for (square, edge_m) in [(Square::M1, 1.0), (Square::M100, 100.0), (Square::Km1, 1e3)] {
            let mgrs = Mgrs::of(there, square).expect("a place");
            prop_assert!((mgrs.edge_m() - edge_m).abs() < 1e-9);
            let away = metres(there, mgrs.to_geodetic(0.0));
            // Half a diagonal; grids stretch by up to 0.6 % near the poles.
            prop_assert!(away < 0.7072 * 1.007 * edge_m, "{mgrs}: {away} m from the middle");
            prop_assert_eq!(mgrs.to_string().parse::<Mgrs>(), Ok(mgrs));
        }
    }

    #[test]
    fn any_text_is_read_or_refused(text in "\\PC{0,30}", near in "[0-9nsA-Z. ]{0,24}") {
        for text in [text, near] {
            if let Ok(utm) = text.parse::<Utm>() {
                prop_assert!(utm.to_geodetic(0.0).is_ok());
            }
            if let Ok(mgrs) = text.parse::<Mgrs>() {
                prop_assert!((-90.0..=90.0).contains(&mgrs.to_geodetic(0.0).lat_deg));
            }
        }
    }
}

#[test]
fn places_are_where_the_manual_of_geographiclib_puts_them() {
    // GeoConvert(1): `echo 33.3 44.4 | GeoConvert -u -p -1`, `-m` and the examples of MGRS.hpp.
    let baghdad = place(33.3, 44.4);
    assert_eq!(
        Utm::of(baghdad).map(|u| u.to_string()),
        Ok("38n 444140.54 3684706.36".into())
    );
    assert_eq!(
        Mgrs::of(baghdad, Square::M10).map(|m| m.to_string()),
        Ok("38SMB44148470".into())
    );
    let square: Mgrs = " 38s mb 4414 8470 "
        .parse()
        .expect("in any case and with spaces");
    assert!(metres(square.to_geodetic(0.0), baghdad) < 7.1);
    let pole = Utm::of(place(90.0, 0.0)).expect("a place");
    assert_eq!(pole.to_string(), "n 2000000.00 2000000.00");
}

#[test]
fn norway_and_svalbard_have_wider_zones() {
    let zone = |lat, lon| Utm::of(place(lat, lon)).map(|utm| utm.zone);
    assert_eq!(zone(60.0, 4.0), Ok(32), "Bergen");
    assert_eq!(zone(55.0, 4.0), Ok(31), "south of it");
    assert_eq!(zone(78.0, 10.0), Ok(33), "Svalbard");
}

#[test]
fn what_is_no_place_or_no_text_is_refused_with_a_reason() {
    let error = |text: &str| text.parse::<Utm>().expect_err(text).to_string();
    for text in [
        "",
        "32 1 2",
        "32n 1",
        "32n 1 2 3",
        "61n 500000 1",
        "00n 2000000 2000000",
        "+3n 500000 1",
        "32n nan 5",
    ] {
        assert!(
            error(text).contains("is not as \"32n 465711 5249461\""),
            "{text}: {}",
            error(text)
        );
    }
    let outside = error("32n 9000000 5249461");
    assert!(
        outside.starts_with("32n 9000000.00 5249461.00 is outside of its zone: Easting 9000km"),
        "{outside}"
    );
    let error = |text: &str| text.parse::<Mgrs>().expect_err(text).to_string();
    assert!(
        error("99TMT65").contains("is no MGRS square"),
        "{}",
        error("99TMT65")
    );
    assert!(
        error("32T").contains("100 km square are missing"),
        "{}",
        error("32T")
    );
    assert!(
        error("32TMT654").contains("digits"),
        "{}",
        error("32TMT654")
    );
    assert_eq!(
        Utm::of(place(f64::NAN, 8.0)).map_err(|e| e.to_string()),
        Err("latitude NaN, longitude 8 is no place".to_owned())
    );
    assert!(Mgrs::of(place(91.0, 8.0), Square::M1).is_err());
    let nowhere = Utm {
        easting_m: f64::NAN,
        ..Utm::of(place(1.0, 2.0)).expect("a place")
    };
    assert!(nowhere.to_geodetic(0.0).is_err());
}

#[test]
fn geoconvert_says_the_same() {
    let places = [
        (47.3977, 8.5456),
        (-33.9, 18.4),
        (60.4, 5.3),
        (-79.0, 140.0),
        (85.0, 30.0),
        (-88.0, -100.0),
        (0.1, -179.9),
    ];
    for (lat, lon) in places {
        let input = format!("{lat} {lon}");
        let convert = |options: &[&str]| {
            Command::new("GeoConvert")
                .args(options)
                .args(["--input-string", &input])
                .output()
        };
        let (Ok(utm), Ok(mgrs)) = (convert(&["-u", "-p", "2"]), convert(&["-m", "-p", "0"])) else {
            println!("no GeoConvert (Debian: geographiclib-tools): nothing to compare");
            return;
        };
        let said = |output: Vec<u8>| String::from_utf8_lossy(&output).trim().to_owned();
        assert_eq!(
            Utm::of(place(lat, lon)).map(|u| u.to_string()),
            Ok(said(utm.stdout))
        );
        assert_eq!(
            Mgrs::of(place(lat, lon), Square::M1).map(|m| m.to_string()),
            Ok(said(mgrs.stdout))
        );
    }
}
