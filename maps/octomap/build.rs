//! Compiles the bridge to liboctomap if the feature `referee` asks for it.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    #[cfg(feature = "referee")]
    referee();
}

#[cfg(feature = "referee")]
fn referee() {
    let found = pkg_config::Config::new()
        .atleast_version("1.9")
        .probe("octomap");
    let library = match found {
        Ok(library) => library,
        Err(error) => {
            panic!("the feature referee needs liboctomap (Debian: liboctomap-dev): {error}")
        }
    };
    cxx_build::bridge("src/referee.rs")
        .file("src/referee.cpp")
        .includes(library.include_paths)
        .std("c++17")
        .compile("octomap-referee");
    for file in ["src/referee.rs", "src/referee.cpp", "src/referee.h"] {
        println!("cargo:rerun-if-changed={file}");
    }
}
