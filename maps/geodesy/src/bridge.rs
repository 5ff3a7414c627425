//! The C++ side: `GeographicLib::LocalCartesian`.

#[cxx::bridge(namespace = "tandem")]
pub(crate) mod ffi {
    unsafe extern "C++" {
        include!("geodesy/src/bridge.h");

        fn forward(origin: &[f64; 3], place: &[f64; 3]) -> [f64; 3];
        fn reverse(origin: &[f64; 3], enu: &[f64; 3]) -> [f64; 3];
    }
}
