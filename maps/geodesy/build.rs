//! Compiles the bridge to `GeographicLib`.

fn main() {
    let found = pkg_config::Config::new()
        .atleast_version("2.0")
        .probe("geographiclib");
    let library = match found {
        Ok(library) => library,
        Err(error) => panic!("geodesy needs GeographicLib (Debian: libgeographiclib-dev): {error}"),
    };
    cxx_build::bridge("src/bridge.rs")
        .file("src/bridge.cpp")
        .includes(library.include_paths)
        .std("c++17")
        .compile("geodesy-bridge");
    for file in [
        "build.rs",
        "src/bridge.rs",
        "src/bridge.cpp",
        "src/bridge.h",
    ] {
        println!("cargo:rerun-if-changed={file}");
    }
}
