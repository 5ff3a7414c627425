//! What was said, the newest last.

use egui::{RichText, Ui};

use super::theme;
use crate::model::Model;
use crate::model::log::{LogLine, Severity};

/// The messages, scrolled to the newest.
pub fn log_ui(ui: &mut Ui, model: &Model) {
    // Lines of text, not of buttons.
    ui.spacing_mut().interact_size.y = 0.0;
    if model.log.iter().len() == 0 {
        ui.label(RichText::new("No messages yet.").color(theme::DIM));
        return;
    }
    let height = ui.text_style_height(&egui::TextStyle::Body);
    let scroll = egui::ScrollArea::vertical()
        .auto_shrink(false)
        .stick_to_bottom(true);
    scroll.show_rows(ui, height, model.log.iter().len(), |ui, rows| {
        for line in model.log.iter().skip(rows.start).take(rows.len()) {
            line_ui(ui, model, line);
        }
    });
}

fn line_ui(ui: &mut Ui, model: &Model, line: &LogLine) {
    let ink = match line.severity {
        Severity::Critical | Severity::Error => theme::RED,
        Severity::Warning => theme::AMBER,
        Severity::Notice => theme::TEXT,
        Severity::Debug => theme::DIM,
    };
    ui.horizontal(|ui| {
        ui.label(
            RichText::new(model.utc(line.at))
                .monospace()
                .small()
                .color(theme::DIM),
        );
        let who = line
            .from
            .map_or_else(|| "Station".to_owned(), |id| model.name_of(id));
        let identity = line.from.map_or(theme::DIM, theme::vehicle);
        ui.label(RichText::new(who).small().color(identity));
        if line.severity < Severity::Notice {
            ui.label(
                RichText::new(line.severity.word())
                    .small()
                    .strong()
                    .color(ink),
            );
        }
        ui.add(egui::Label::new(RichText::new(&line.text).color(ink)).truncate());
    });
}
