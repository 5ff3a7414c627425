//! The whole window: status bar, alerts, panels that can be moved, and the frame around a replay.

use egui::{CentralPanel, Color32, Frame, Margin, Panel, Stroke, StrokeKind, Ui, Visuals};
use egui_tiles::{
    Behavior, Container, Linear, LinearDir, SimplificationOptions, TabState, Tile, TileId, Tiles,
    Tree, UiResponse,
};

use super::map::{MapView, map_ui};
use super::{alerts, log, mission, orders, replay, status, theme, vehicle};
use crate::command::Command;
use crate::model::Model;
use crate::replay::{Replay, Steer};

/// What a panel shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pane {
    /// The map in three dimensions.
    Map,
    /// A card per vehicle.
    Vehicles,
    /// The plan of the active vehicle.
    Mission,
    /// Orders and their answers.
    Orders,
    /// What was said.
    Log,
}

impl Pane {
    fn title(self) -> &'static str {
        match self {
            Self::Map => "Map",
            Self::Vehicles => "Vehicles",
            Self::Mission => "Mission",
            Self::Orders => "Orders",
            Self::Log => "Messages",
        }
    }
}

/// How the operator has arranged the window, and the state of its views.
#[derive(Debug)]
pub struct Workspace {
    /// The main view.
    pub map: MapView,
    tree: Tree<Pane>,
}

/// What the operator has asked for in one frame.
#[derive(Debug, Default)]
pub struct Asked {
    /// Of vehicles and plans.
    pub commands: Vec<Command>,
    /// Of the replay.
    pub steers: Vec<Steer>,
}

impl Default for Workspace {
    /// The map on the left, everything about vehicles on the right, messages below the map.
    fn default() -> Self {
        let mut tiles = Tiles::default();
        let map = tiles.insert_pane(Pane::Map);
        let log = tiles.insert_pane(Pane::Log);
        let vehicles = tiles.insert_pane(Pane::Vehicles);
        let mission = tiles.insert_pane(Pane::Mission);
        let orders = tiles.insert_pane(Pane::Orders);
        let left = split(&mut tiles, LinearDir::Vertical, &[(map, 0.82), (log, 0.18)]);
        let right = split(
            &mut tiles,
            LinearDir::Vertical,
            &[(vehicles, 0.52), (mission, 0.32), (orders, 0.16)],
        );
        let root = split(
            &mut tiles,
            LinearDir::Horizontal,
            &[(left, 0.74), (right, 0.26)],
        );
        Self {
            map: MapView::default(),
            tree: Tree::new(egui::Id::unique("workspace"), root, tiles),
        }
    }
}

fn split(tiles: &mut Tiles<Pane>, direction: LinearDir, parts: &[(TileId, f32)]) -> TileId {
    let mut linear = Linear::new(direction, parts.iter().map(|(tile, _)| *tile).collect());
    for (tile, share) in parts {
        linear.shares.set_share(*tile, share * parts.len() as f32);
    }
    tiles.insert_new(Tile::Container(Container::Linear(linear)))
}

/// Draws everything and gives back what was asked for.
pub fn window_ui(
    ui: &mut Ui,
    model: &Model,
    workspace: &mut Workspace,
    replay: Option<&Replay>,
) -> Asked {
    let mut asked = Asked::default();
    let bar = Frame::new()
        .fill(theme::PANEL)
        .inner_margin(Margin::symmetric(12, 4));
    Panel::top("status")
        .exact_size(40.0)
        .frame(bar)
        .show(ui, |ui| {
            asked.commands.extend(status::status_ui(ui, model));
        });
    if !model.alerts.present().is_empty() {
        let strip = Frame::new()
            .fill(theme::PANEL)
            .inner_margin(Margin::symmetric(8, 4));
        Panel::top("alerts")
            .resizable(false)
            .frame(strip)
            .show(ui, |ui| {
                asked.commands.extend(alerts::alerts_ui(ui, model));
            });
    }
    if let Some(replay) = replay {
        Panel::bottom("replay")
            .exact_size(40.0)
            .frame(bar)
            .show(ui, |ui| {
                asked.steers.extend(replay::replay_ui(ui, replay));
            });
    }
    CentralPanel::no_frame()
        .frame(Frame::new().fill(theme::GROUND))
        .show(ui, |ui| {
            let mut behavior = Panes {
                model,
                map: &mut workspace.map,
                commands: Vec::new(),
            };
            workspace.tree.ui(&mut behavior, ui);
            asked.commands.append(&mut behavior.commands);
        });
    if replay.is_some() {
        let whole = ui.ctx().content_rect();
        let stroke = Stroke::new(3.0, theme::REPLAY);
        ui.painter()
            .rect_stroke(whole, 0.0, stroke, StrokeKind::Inside);
    }
    asked
}

struct Panes<'a> {
    model: &'a Model,
    map: &'a mut MapView,
    commands: Vec<Command>,
}

impl Behavior<Pane> for Panes<'_> {
    fn pane_ui(&mut self, ui: &mut Ui, _tile: TileId, pane: &mut Pane) -> UiResponse {
        if *pane == Pane::Map {
            self.commands.extend(map_ui(ui, self.model, self.map));
            return UiResponse::None;
        }
        let frame = Frame::new()
            .fill(theme::PANEL)
            .inner_margin(Margin::same(10));
        frame.show(ui, |ui| {
            ui.set_min_size(ui.available_size());
            if *pane == Pane::Log {
                log::log_ui(ui, self.model);
                return;
            }
            egui::ScrollArea::vertical()
                .id_salt(pane.title())
                .auto_shrink(false)
                .show(ui, |ui| match pane {
                    Pane::Vehicles => self.commands.extend(vehicle::vehicles_ui(ui, self.model)),
                    Pane::Mission => self.commands.extend(mission::mission_ui(ui, self.model)),
                    Pane::Orders => orders::orders_ui(ui, self.model),
                    Pane::Map | Pane::Log => {}
                });
        });
        UiResponse::None
    }

    fn tab_title_for_pane(&mut self, pane: &Pane) -> egui::WidgetText {
        pane.title().into()
    }

    fn simplification_options(&self) -> SimplificationOptions {
        SimplificationOptions {
            all_panes_must_have_tabs: true,
            ..SimplificationOptions::default()
        }
    }

    fn tab_bar_color(&self, _visuals: &Visuals) -> Color32 {
        theme::PANEL
    }

    fn tab_bg_color(
        &self,
        _visuals: &Visuals,
        _tiles: &Tiles<Pane>,
        _tile: TileId,
        _state: &TabState,
    ) -> Color32 {
        theme::PANEL
    }

    fn tab_text_color(
        &self,
        _visuals: &Visuals,
        _tiles: &Tiles<Pane>,
        _tile: TileId,
        state: &TabState,
    ) -> Color32 {
        if state.active {
            theme::TEXT
        } else {
            theme::DIM
        }
    }

    fn tab_outline_stroke(
        &self,
        _visuals: &Visuals,
        _tiles: &Tiles<Pane>,
        _tile: TileId,
        _state: &TabState,
    ) -> Stroke {
        Stroke::NONE
    }

    fn gap_width(&self, _style: &egui::Style) -> f32 {
        3.0
    }
}
