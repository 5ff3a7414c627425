//! What runs the whole team at once: the mission of `make demo`, which the end-to-end tests drive too, and the
//! evaluation that reproduces every table of figures.

pub mod demo;
pub mod evaluate;
pub mod program;
pub mod radio;
