//! RGB-D SLAM among moving people and vehicles, and dense mapping.
