//! The bar below a replay: where it is, how fast it runs, and that it is one.

use std::time::Duration;

use egui::{Key, RichText, Ui};

use super::theme;
use crate::replay::{Replay, Steer};

const SPEEDS: [f64; 6] = [0.25, 0.5, 1.0, 2.0, 5.0, 10.0];

/// Play, pause, seek and speed.
pub fn replay_ui(ui: &mut Ui, replay: &Replay) -> Vec<Steer> {
    let mut steers = Vec::new();
    ui.horizontal_centered(|ui| {
        ui.label(RichText::new("REPLAY").strong().color(theme::REPLAY));
        let (label, steer) = if replay.is_playing() {
            ("Pause", Steer::Pause)
        } else {
            ("Play", Steer::Play)
        };
        if ui.button(label).clicked() {
            steers.push(steer);
        }
        egui::ComboBox::from_id_salt("replay speed")
            .selected_text(format!("{}×", replay.speed()))
            .width(64.0)
            .show_ui(ui, |ui| {
                for speed in SPEEDS {
                    if ui
                        .selectable_label(
                            replay.speed().to_bits() == speed.to_bits(),
                            format!("{speed}×"),
                        )
                        .clicked()
                    {
                        steers.push(Steer::Speed(speed));
                    }
                }
            })
            .response
            .on_hover_text("speed of the replay");
        let (at, length) = (
            replay.position().as_secs_f64(),
            replay.length().as_secs_f64(),
        );
        ui.label(RichText::new(format!("{} / {}", clock(at), clock(length))).monospace());
        if let Some(to) = timeline_ui(ui, at, length) {
            steers.push(Steer::Seek(Duration::from_secs_f64(to.max(0.0))));
        }
    });
    if !ui.ctx().egui_wants_keyboard_input() && ui.input(|input| input.key_pressed(Key::Space)) {
        steers.push(if replay.is_playing() {
            Steer::Pause
        } else {
            Steer::Play
        });
    }
    steers
}

fn timeline_ui(ui: &mut Ui, at: f64, length: f64) -> Option<f64> {
    let mut to = at;
    ui.spacing_mut().slider_width = (ui.available_width() - 16.0).max(60.0);
    let slider = egui::Slider::new(&mut to, 0.0..=length.max(1e-3))
        .show_value(false)
        .trailing_fill(true);
    let response = ui.add(slider).accessible_name("place in the recording");
    response.changed().then_some(to)
}

fn clock(seconds: f64) -> String {
    let whole = seconds.max(0.0) as u64;
    format!(
        "{:02}:{:02}.{}",
        whole / 60,
        whole % 60,
        (seconds.fract() * 10.0) as u64
    )
}
