//! The main view: the map in three dimensions with the vehicles, their tracks and their plans, and the tools to plan on it.

mod overlays;
mod scene;
mod tools;

use std::sync::Arc;

use egui::{Response, Sense, Ui};
use maps::frame::{Point, World};
use maps::tile::TileId;
use mavlink_ext::SystemId;

use super::camera::CameraCommand;
use super::layers::Layers;
use crate::command::Command;
use crate::model::{Model, Source};
use crate::render::{
    self, Camera3, Coloring, Navigation, Overlay, Ray, Scene, Surfaces, ViewId, Viewport,
};
pub use tools::Tool;

/// Before anything is known, the view shows this much of the ground.
const EMPTY_RADIUS_M: f64 = 4.0;

/// What the operator has chosen about the map view. It holds no state of any vehicle.
#[derive(Debug)]
pub struct MapView {
    /// Where it is seen from.
    pub camera: Camera3,
    /// What is shown.
    pub layers: Layers,
    /// What a click does.
    pub tool: Tool,
    /// What colour the voxels have.
    pub coloring: Coloring,
    /// Which sides of them are shown.
    pub surfaces: Surfaces,
    /// Voxels above this height are hidden.
    pub cut_m: Option<f64>,
    /// Where the ground vehicle can drive.
    pub drivable: Option<Arc<Overlay>>,
    scene: Arc<Scene>,
    navigation: Navigation,
    drag: Option<Point<World>>,
    follow: Option<SystemId>,
    wanted: Vec<CameraCommand>,
    viewport: Viewport,
    touched: bool,
    fitted_tiles: usize,
}

impl Default for MapView {
    fn default() -> Self {
        Self {
            camera: Camera3::default(),
            layers: Layers::default(),
            tool: Tool::default(),
            coloring: Coloring::default(),
            surfaces: Surfaces::Observed,
            cut_m: None,
            drivable: None,
            scene: Arc::default(),
            navigation: Navigation::default(),
            drag: None,
            follow: None,
            wanted: Vec::new(),
            viewport: Viewport {
                width: 960.0,
                height: 720.0,
            },
            touched: false,
            fitted_tiles: 0,
        }
    }
}

impl MapView {
    /// Moves the camera when it is next drawn.
    pub fn command(&mut self, command: CameraCommand) {
        self.touched = true;
        self.wanted.push(command);
    }

    /// Starts with an empty map, as a replay that was wound back does.
    pub fn forget_map(&mut self) {
        self.scene = Arc::default();
        self.drivable = None;
        self.fitted_tiles = 0;
    }

    /// Brings the scene up to date with the model, of whose map the tiles `changed` are new.
    pub fn update(&mut self, model: &Model, changed: &[TileId]) {
        scene::update(self, model, changed);
    }

    fn bounds(&self, model: &Model) -> (Point<World>, Point<World>) {
        let places = model
            .vehicles
            .values()
            .flat_map(|v| v.track.iter().filter_map(|point| point.world));
        let places = places.map(|place| (place, place));
        let boxes = self.scene.bounds().into_iter().chain(places);
        let all = boxes.reduce(|(low, high), (other_low, other_high)| {
            (
                Point::from_raw(low.raw.inf(&other_low.raw)),
                Point::from_raw(high.raw.sup(&other_high.raw)),
            )
        });
        let (low, high) = all.unwrap_or((Point::origin(), Point::origin()));
        if (high - low).norm() > 1.0 {
            return (low, high);
        }
        let margin = maps::frame::Vector::new(EMPTY_RADIUS_M, EMPTY_RADIUS_M, 0.0);
        (low + -margin, high + margin)
    }

    fn move_camera(&mut self, model: &Model) {
        let (low, high) = self.bounds(model);
        // Until somebody moves the camera, it shows all there is.
        let grown = model.map.tiles() + model.vehicles.len();
        if !self.touched && grown != self.fitted_tiles {
            self.fitted_tiles = grown;
            self.camera = self.camera.fitted(low, high, self.viewport);
        }
        for command in std::mem::take(&mut self.wanted) {
            self.obey(command, low, high);
        }
        let followed = self
            .follow
            .and_then(|id| model.vehicles.get(&id))
            .and_then(|vehicle| vehicle.position);
        if let Some(position) = followed {
            self.camera = looking_at(self.camera, position.value);
        }
    }

    fn obey(&mut self, command: CameraCommand, low: Point<World>, high: Point<World>) {
        match command {
            CameraCommand::Top => {
                self.camera = self.camera.top_down().fitted(low, high, self.viewport);
            }
            CameraCommand::Fit => self.camera = self.camera.fitted(low, high, self.viewport),
            CameraCommand::Free => self.follow = None,
            CameraCommand::Follow(id) => self.follow = Some(id),
            CameraCommand::Orbit {
                azimuth_deg,
                elevation_deg,
                distance_m,
            } => {
                let heading_rad = (90.0 - azimuth_deg).to_radians();
                let pitch_rad = elevation_deg.to_radians();
                let target = self.camera.target();
                self.camera = Camera3::looking_at(target, heading_rad, pitch_rad, distance_m);
            }
            CameraCommand::LookAt { x_m, y_m, z_m } => {
                self.camera = looking_at(self.camera, Point::new(x_m, y_m, z_m));
            }
        }
    }
}

/// The camera moved to look at `target`, from the same side and distance.
fn looking_at(camera: Camera3, target: Point<World>) -> Camera3 {
    let (heading_rad, pitch_rad) = (camera.heading_rad(), camera.pitch_rad());
    Camera3::looking_at(target, heading_rad, pitch_rad, camera.distance_m())
        .with_lens(camera.lens())
}

/// The map with its tools; gives back what was planned on it.
pub fn map_ui(ui: &mut Ui, model: &Model, view: &mut MapView) -> Vec<Command> {
    let mut commands = Vec::new();
    let (rect, response) = ui.allocate_exact_size(ui.available_size(), Sense::click_and_drag());
    response.widget_info(|| {
        egui::WidgetInfo::labeled(egui::Role::Canvas, true, "map in three dimensions")
    });
    view.viewport = render::callback::viewport_of(rect);
    view.move_camera(model);
    navigate(view, model, &response);
    let painter = ui.painter_at(rect);
    painter.rect_filled(rect, 0.0, super::theme::GROUND);
    painter.add(render::callback::shape(
        rect,
        ViewId(0),
        Arc::clone(&view.scene),
        view.camera,
    ));
    overlays::labels(&painter, rect, model, view);
    overlays::instruments(&painter, rect, model, view, response.hover_pos());
    if model.source == Source::Live {
        commands.extend(tools::plan(&painter, &response, model, view));
    }
    tools::toolbar(ui, rect, model, view);
    commands
}

/// The mouse moves the camera, unless the tool wants the left button.
fn navigate(view: &mut MapView, model: &Model, response: &Response) {
    let before = view.camera;
    let scene = Arc::clone(&view.scene);
    let touch = |ray: Ray| touched(model, &scene, ray);
    let tool_drags = view.tool != Tool::Look && response.dragged_by(egui::PointerButton::Primary);
    if !tool_drags {
        view.navigation.update(response, &mut view.camera, touch);
    }
    if view.camera != before {
        (view.touched, view.follow) = (true, None);
    }
}

/// Where a ray meets the map, or else the ground.
fn touched(model: &Model, scene: &Scene, ray: Ray) -> Option<Point<World>> {
    match &model.map.voxels {
        Some(map) => render::pick(map, scene, ray).map(|picked| picked.point),
        None => ray
            .distance_to_height_m(0.0)
            .filter(|m| *m < 10_000.0)
            .map(|m| ray.at(m)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::model::Source;

    #[test]
    fn two_commands_before_the_next_picture_both_count() {
        let model = Model::new(Config::default(), Source::Live, 0);
        let mut view = MapView::default();
        view.command(CameraCommand::Orbit {
            azimuth_deg: 90.0,
            elevation_deg: 40.0,
            distance_m: 6.0,
        });
        view.command(CameraCommand::LookAt {
            x_m: 2.0,
            y_m: -1.0,
            z_m: 0.5,
        });
        view.move_camera(&model);
        assert!((view.camera.distance_m() - 6.0).abs() < 1e-9);
        let off = view.camera.target() - Point::new(2.0, -1.0, 0.5);
        assert!(off.norm() < 1e-9, "looks {} m past it", off.norm());
    }
}
