//! The bars above and below, keys and help.

use std::time::Duration;

use clap::ValueEnum as _;
use egui::containers::menu::{MenuButton, MenuConfig};
use egui::{Color32, Key, PopupCloseBehavior, RichText, Ui};
use maps::time::Stamp;
use sitl::scene::Name;

use super::{App, Follow, Layer};
use crate::view::sensors::{Kind, Tab};
use crate::view::sketch::Colouring;
use crate::view::time_line::SPEEDS;

/// One turn of the `LiDAR`.
const STEP: Duration = Duration::from_millis(100);
const LEAP: Duration = Duration::from_secs(5);

const HELP: [(&str, &str); 16] = [
    ("Space", "run or stand"),
    ("Left / Right", "0.1 s back or on (with Shift: 5 s)"),
    ("+ / -", "faster or slower"),
    ("Home", "to the start"),
    ("L", "to the present of the vehicles and on with them"),
    (
        "1 2 3 4",
        "eye: free, drone, ground vehicle, drone's camera",
    ),
    ("Drag", "turn the eye"),
    ("Right drag, Shift + drag", "move over the ground"),
    ("Wheel", "nearer or farther"),
    ("W A S D", "move over the ground"),
    ("T", "next sensor"),
    ("C", "next kind of picture"),
    ("B, N", "boxes, labels"),
    ("V, P", "voxels, LiDAR points"),
    ("F, G", "drone's view, surfaces"),
    ("F1 or H", "this help"),
];

impl App {
    pub(super) fn choices_ui(&mut self, ui: &mut Ui) {
        ui.add_space(3.0);
        ui.horizontal_wrapped(|ui| {
            self.scene_choice_ui(ui);
            ui.separator();
            ui.label("Eye");
            for (follow, name) in Follow::ALL {
                if ui.selectable_label(self.follow == follow, name).clicked() {
                    self.set_follow(follow);
                }
            }
            ui.separator();
            let stays = MenuConfig::new().close_behavior(PopupCloseBehavior::CloseOnClickOutside);
            MenuButton::new("Layers").config(stays).ui(ui, |ui| {
                for (layer, name) in Layer::ALL {
                    ui.checkbox(&mut self.layers.shown[layer as usize], name);
                }
                ui.separator();
                ui.label("LiDAR by");
                for (colouring, name) in Colouring::ALL {
                    ui.radio_value(&mut self.layers.colouring, colouring, name);
                }
            });
            ui.toggle_value(&mut self.shows_help, "Keys (F1)");
        });
        ui.add_space(2.0);
    }

    fn scene_choice_ui(&mut self, ui: &mut Ui) {
        let (mut name, mut seed) = self.scene;
        if self.history.is_some() {
            // Vehicles drive in this one.
            ui.label(RichText::new(format!("{name}  seed {seed}")).strong());
            return;
        }
        egui::ComboBox::from_id_salt("scene")
            .selected_text(name.to_string())
            .width(150.0)
            .show_ui(ui, |ui| {
                for other in Name::value_variants() {
                    ui.selectable_value(&mut name, *other, other.to_string());
                }
            })
            .response
            .on_hover_text("scene");
        ui.label("Seed");
        let field = egui::DragValue::new(&mut seed).speed(0.2);
        ui.add(field).accessible_name("seed");
        if (name, seed) != self.scene {
            self.set_scene((name, seed));
        }
    }

    pub(super) fn time_ui(&mut self, ui: &mut Ui) {
        ui.add_space(4.0);
        ui.horizontal(|ui| {
            if ui.button("Start").clicked() {
                self.time.seek(Stamp::ZERO);
            }
            if ui.button("- 0.1 s").clicked() {
                self.time.step(STEP, false);
            }
            let label = if self.time.is_playing() {
                "Pause"
            } else {
                "Play"
            };
            if ui
                .add(egui::Button::new(label).min_size(egui::vec2(54.0, 0.0)))
                .clicked()
            {
                self.time.toggle();
            }
            if ui.button("+ 0.1 s").clicked() {
                self.time.step(STEP, true);
            }
            if self.time.present().is_some() {
                let live = if self.time.follows() {
                    RichText::new("LIVE").color(Color32::from_rgb(0x62, 0xd3, 0x8f))
                } else {
                    RichText::new("to live")
                };
                if ui.button(live.strong()).clicked() {
                    self.time.follow();
                }
            }
            egui::ComboBox::from_id_salt("speed")
                .selected_text(format!("{}x", self.time.speed()))
                .width(60.0)
                .show_ui(ui, |ui| {
                    for (index, speed) in SPEEDS.into_iter().enumerate() {
                        let is_it = speed.to_bits() == self.time.speed().to_bits();
                        if ui.selectable_label(is_it, format!("{speed}x")).clicked() {
                            self.time.set_speed(index);
                        }
                    }
                })
                .response
                .on_hover_text("speed");
            let (at, end) = (self.time.at().as_secs_f64(), self.time.end().as_secs_f64());
            ui.label(RichText::new(format!("{at:7.2} / {end:.0} s")).monospace());
            let mut to = at;
            ui.spacing_mut().slider_width = (ui.available_width() - 16.0).max(60.0);
            let slider = egui::Slider::new(&mut to, 0.0..=end.max(1e-3))
                .show_value(false)
                .trailing_fill(true);
            let response = ui.add(slider).accessible_name("time");
            if response.changed()
                && let Some(to) = Stamp::from_secs_f64(to)
            {
                self.time.seek(to);
            }
        });
        ui.add_space(2.0);
    }

    pub(super) fn help_ui(&mut self, ctx: &egui::Context) {
        egui::Window::new("Keys")
            .open(&mut self.shows_help)
            .resizable(false)
            .collapsible(false)
            .show(ctx, |ui| {
                egui::Grid::new("keys").striped(true).show(ui, |ui| {
                    for (keys, what) in HELP {
                        ui.label(RichText::new(keys).strong());
                        ui.label(what);
                        ui.end_row();
                    }
                });
            });
    }

    pub(super) fn keys(&mut self, ctx: &egui::Context) {
        if ctx.egui_wants_keyboard_input() {
            return;
        }
        self.time_keys(ctx);
        let pressed = |key| ctx.input(|input| input.key_pressed(key));
        for (key, (follow, _)) in [Key::Num1, Key::Num2, Key::Num3, Key::Num4]
            .into_iter()
            .zip(Follow::ALL)
        {
            if pressed(key) {
                self.set_follow(follow);
            }
        }
        let layers = [
            (Key::B, Layer::Boxes),
            (Key::N, Layer::Labels),
            (Key::V, Layer::Voxels),
            (Key::P, Layer::Lidar),
            (Key::F, Layer::Frustum),
            (Key::G, Layer::Surfaces),
        ];
        for (key, layer) in layers {
            self.layers.shown[layer as usize] ^= pressed(key);
        }
        self.shows_help ^= pressed(Key::F1) | pressed(Key::H);
        if pressed(Key::T) {
            self.tab = Tab::ALL[(self.tab as usize + 1) % Tab::ALL.len()].0;
        }
        if pressed(Key::C) {
            self.kind = Kind::ALL[(self.kind as usize + 1) % Kind::ALL.len()].0;
        }
        let moves = [
            (Key::W, 0.0, 1.0),
            (Key::S, 0.0, -1.0),
            (Key::D, 1.0, 0.0),
            (Key::A, -1.0, 0.0),
        ];
        for (key, right, ahead) in moves {
            if pressed(key) {
                let step_m = 0.06 * self.orbit.distance_m;
                let base_rad = self.base().map_or(0.0, |(_, heading)| heading);
                self.orbit.shift(right * step_m, ahead * step_m, base_rad);
            }
        }
    }

    fn time_keys(&mut self, ctx: &egui::Context) {
        let pressed = |key| ctx.input(|input| input.key_pressed(key));
        let by = if ctx.input(|input| input.modifiers.shift) {
            LEAP
        } else {
            STEP
        };
        if pressed(Key::Space) {
            self.time.toggle();
        }
        for (key, forwards) in [(Key::ArrowLeft, false), (Key::ArrowRight, true)] {
            if pressed(key) {
                self.time.step(by, forwards);
            }
        }
        if pressed(Key::Plus) || pressed(Key::Equals) {
            self.time.faster();
        }
        if pressed(Key::Minus) {
            self.time.slower();
        }
        if pressed(Key::Home) {
            self.time.seek(Stamp::ZERO);
        }
        if pressed(Key::L) {
            self.time.follow();
        }
    }
}
