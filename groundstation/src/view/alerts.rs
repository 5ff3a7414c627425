//! The alerts, under the status bar: most urgent first, flashing until the operator has seen them.

use egui::{Color32, RichText, Ui};

use super::{theme, widgets};
use crate::command::Command;
use crate::model::Model;
use crate::model::alerts::{Alert, Level};

/// More than this many are counted, not listed.
const SHOWN: usize = 4;
/// Unacknowledged warnings flash this often a second.
const FLASH_HZ: f64 = 3.0;

/// The list; nothing at all while there is nothing to say.
pub fn alerts_ui(ui: &mut Ui, model: &Model) -> Vec<Command> {
    let mut commands = Vec::new();
    let present = model.alerts.present();
    for alert in present.iter().take(SHOWN) {
        alert_ui(ui, model, alert, &mut commands);
    }
    if present.len() > SHOWN {
        ui.label(RichText::new(format!("and {} more", present.len() - SHOWN)).color(theme::AMBER));
    }
    commands
}

fn alert_ui(ui: &mut Ui, model: &Model, alert: &Alert, commands: &mut Vec<Command>) {
    let ink = match alert.level {
        Level::Warning => theme::RED,
        Level::Caution => theme::AMBER,
        Level::Advisory => theme::CYAN,
    };
    let flashing = alert.level == Level::Warning && !alert.acknowledged;
    let lit = !flashing || (ui.input(|input| input.time) * FLASH_HZ).fract() < 0.6;
    if flashing {
        ui.ctx()
            .request_repaint_after(std::time::Duration::from_millis(100));
    }
    let fill = ink.gamma_multiply(if lit { 0.22 } else { 0.08 });
    let frame = egui::Frame::new()
        .fill(fill)
        .corner_radius(4)
        .inner_margin(egui::Margin::symmetric(10, 3));
    frame.show(ui, |ui| {
        ui.horizontal(|ui| {
            widgets::sign(ui, widgets::Sign::Attention, ink);
            ui.label(RichText::new(alert.level.word()).strong().color(ink));
            ui.label(RichText::new(&alert.text).color(Color32::WHITE));
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                if !alert.acknowledged && ui.small_button("Acknowledge").clicked() {
                    commands.push(Command::Acknowledge(alert.id));
                }
                let age = widgets::age_text(model.now.since(alert.since));
                ui.label(RichText::new(age).monospace().color(theme::DIM));
            });
        });
    });
}
