//! What the operator sees: functions from the model to pixels, which give back what the operator asks for.
//!
//! `fn x_ui(ui, &Model) -> Vec<Command>`: no view changes the model, and what a view shows about a vehicle comes from telemetry.
//!
//! Rules kept here (after 14 CFR 25.1322 and MIL-STD-1472D): red is for warnings, amber for cautions, green for the words
//! "ready" and "verified", cyan for selection; never colour alone; the button names its target; what is old says how old.

pub mod alerts;
pub mod camera;
pub mod layers;
pub mod log;
pub mod map;
pub mod mission;
pub mod orders;
pub mod replay;
pub mod status;
pub mod theme;
pub mod vehicle;
pub mod widgets;
pub mod workspace;
