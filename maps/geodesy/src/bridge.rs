//! The C++ side: `GeographicLib::LocalCartesian`, `UTMUPS`, `MGRS` and `Geoid`.

#[cxx::bridge(namespace = "tandem")]
pub(crate) mod ffi {
    unsafe extern "C++" {
        include!("geodesy/src/bridge.h");

        fn forward(origin: &[f64; 3], place: &[f64; 3]) -> [f64; 3];
        fn reverse(origin: &[f64; 3], enu: &[f64; 3]) -> [f64; 3];

        fn utm_forward(lat: f64, lon: f64) -> Result<[f64; 4]>;
        fn utm_reverse(zone: u8, north: bool, easting: f64, northing: f64) -> Result<[f64; 2]>;
        fn mgrs_forward(lat: f64, lon: f64, digits: i32) -> Result<String>;
        fn mgrs_reverse(text: &str) -> Result<[f64; 3]>;

        type GeoidModel;

        fn open_geoid(name: &str, folder: &str) -> Result<UniquePtr<GeoidModel>>;
        fn height(&self, lat: f64, lon: f64) -> Result<f64>;
        fn geoid_folder() -> String;
    }
}
