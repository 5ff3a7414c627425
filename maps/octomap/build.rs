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
    cxx_build::bridges(["src/referee.rs", "src/node_referee.rs"])
        .files(["src/referee.cpp", "src/node_referee.cpp"])
        .includes(library.include_paths)
        .std("c++17")
        .compile("octomap-referee");
    for name in ["referee", "node_referee"] {
        for ending in ["rs", "cpp", "h"] {
            println!("cargo:rerun-if-changed=src/{name}.{ending}");
        }
    }
}
