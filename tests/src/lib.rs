//! What runs the whole team at once: the mission of `make demo`, which the end-to-end tests drive too.

pub mod demo;
pub mod program;
