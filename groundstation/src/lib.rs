//! The operator's app: one fused map, plans and commands.
//!
//! ```text
//! net ─► Event ─► station.step ─► Action ─► net, planner            model ─► view ─► Command ─► Event
//! ```
//!
//! - [`model`]: everything known, pure; [`station`]: the one step that changes it.
//! - [`view`]: functions from the model to pixels, which give back [`command`]s; [`render`]: the map in three dimensions.
//! - [`plan`]: paths and surveys, as mission items; [`modes`]: what autopilots call their modes.
//! - [`net`]: links and the recording; [`replay`]: a recording through the same step.
//! - [`script`]: plays the operator; [`report`]: the figures of a run.
//! - [`app`]: all of it together; [`window`] shows it, [`headless`] draws it without a window; [`clock`], [`config`],
//!   [`picture`]: what they need.

pub mod app;
pub mod clock;
pub mod command;
pub mod config;
pub mod headless;
pub mod model;
pub mod modes;
pub mod net;
pub mod picture;
pub mod plan;
pub mod render;
pub mod replay;
pub mod report;
pub mod script;
pub mod station;
pub mod view;
pub mod window;
