//! The rooms of the house and the arrows between them.

use cargo_metadata::{DependencyKind, MetadataCommand};

/// What each crate may use of the others; nothing else.
const MAY_USE: &[(&str, &[&str])] = &[
    ("maps", &[]),
    ("geodesy", &["maps"]),
    ("octomap", &["maps"]),
    ("store", &["maps"]),
    ("mavlink_ext", &["maps"]),
    ("slam", &["maps"]),
    ("perception", &["maps"]),
    ("sensors", &["maps"]),
    (
        "companion",
        &[
            "maps",
            "geodesy",
            "octomap",
            "store",
            "mavlink_ext",
            "slam",
            "perception",
            "sensors",
        ],
    ),
    (
        "groundstation",
        &["maps", "geodesy", "octomap", "store", "mavlink_ext"],
    ),
    ("sitl", &["maps", "mavlink_ext", "sensors"]),
];

#[test]
fn crates_use_only_what_the_architecture_lets_them() {
    let workspace = MetadataCommand::new()
        .no_deps()
        .exec()
        .expect("cargo metadata of this workspace");
    let names: Vec<_> = workspace
        .packages
        .iter()
        .map(|p| p.name.to_string())
        .collect();
    for package in workspace
        .packages
        .iter()
        .filter(|p| p.name.as_str() != "tests")
    {
        let (_, allowed) = MAY_USE
            .iter()
            .find(|(name, _)| *name == package.name.as_str())
            .unwrap_or_else(|| panic!("crate {} has no row in the table of arrows", package.name));
        for dependency in package
            .dependencies
            .iter()
            .filter(|d| d.kind == DependencyKind::Normal)
        {
            assert!(
                !names.contains(&dependency.name) || allowed.contains(&dependency.name.as_str()),
                "{} must not use {}",
                package.name,
                dependency.name
            );
        }
    }
}
