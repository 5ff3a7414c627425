//! The map in three dimensions: voxels, vehicles, plans and the ground, in a window or without one.
//!
//! - [`scene`]: what is shown, as plain data; [`mesh`] makes surfaces of the map's tiles.
//! - [`camera`]: from where; [`navigate`] moves it with the mouse, [`mod@pick`] says what is under the cursor.
//! - [`gpu`]: draws it; [`callback`] puts it into an egui panel, [`offscreen`] into a picture.
//! - [`ramp`] and [`grid`]: the colours and numbers that a legend needs.
//!
//! Nothing here reads a clock, and the same scene from the same camera is the same picture on the same device.

pub mod callback;
pub mod camera;
mod glyph;
pub mod gpu;
pub mod grid;
pub mod mesh;
pub mod navigate;
pub mod offscreen;
pub mod pick;
mod pipelines;
pub mod ramp;
pub mod scene;
mod sketch;
mod view;

pub use callback::install;
pub use camera::{Camera3, Lens, Ray, Viewport};
pub use gpu::{Frame, Renderer, ViewId};
pub use navigate::Navigation;
pub use offscreen::{Image, Offscreen, OffscreenError};
pub use pick::{Picked, pick};
pub use scene::{
    Coloring, Freshness, GoalMarker, GroundCell, Label, Look, Marker, MarkerKind, Overlay,
    Polyline, Rgba, Scene, Stroke, Surfaces,
};
