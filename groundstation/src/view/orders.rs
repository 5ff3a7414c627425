//! Orders and what became of them, the newest first.

use egui::{Color32, RichText, Ui};

use super::theme;
use super::widgets::{self, Sign};
use crate::model::orders::{OrderState, SentOrder};
use crate::model::{Model, Source};

/// The list.
pub fn orders_ui(ui: &mut Ui, model: &Model) {
    // Lines of text, not of buttons.
    ui.spacing_mut().interact_size.y = 0.0;
    if model.orders.iter().len() == 0 {
        let text = match model.source {
            Source::Live => "Nothing has been ordered yet.",
            Source::Replay => "Orders are not shown in a replay.",
        };
        ui.label(RichText::new(text).color(theme::DIM));
    }
    for order in model.orders.iter() {
        order_ui(ui, model, order);
    }
}

fn order_ui(ui: &mut Ui, model: &Model, order: &SentOrder) {
    let (sign, state, ink) = state_of(model, order);
    ui.horizontal_wrapped(|ui| {
        ui.label(
            RichText::new(model.utc(order.sent_at))
                .monospace()
                .small()
                .color(theme::DIM),
        );
        let target =
            RichText::new(model.name_of(order.vehicle)).color(theme::vehicle(order.vehicle));
        ui.label(target.strong());
        ui.label(order.order.to_string());
        if let Some(sign) = sign {
            widgets::sign(ui, sign, ink);
        }
        ui.label(RichText::new(state).color(ink));
    });
}

fn state_of(model: &Model, order: &SentOrder) -> (Option<Sign>, String, Color32) {
    if let Some(failure) = order.failure() {
        return (Some(Sign::Failed), failure, theme::AMBER);
    }
    let state = match &order.state {
        OrderState::Sent { attempt: 1, .. } => "sent".to_owned(),
        OrderState::Sent { attempt, of } => format!("retry {attempt}/{of}"),
        OrderState::InProgress {
            percent: Some(percent),
        } => format!("in progress {percent} %"),
        OrderState::InProgress { percent: None } => "in progress".to_owned(),
        _ if order.confirmed_at.is_some() => {
            return (Some(Sign::Done), "done".to_owned(), theme::TEXT);
        }
        _ if order.is_without_effect(model.now) => {
            let words = "accepted, but telemetry does not show it".to_owned();
            return (Some(Sign::Attention), words, theme::AMBER);
        }
        _ => return (None, "accepted".to_owned(), theme::TEXT),
    };
    (None, state, theme::CYAN)
}
