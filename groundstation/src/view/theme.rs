//! Colours and type of the ground station: dark, quiet, with the loud colours kept for what is urgent.

use egui::{Color32, CornerRadius, FontFamily, FontId, Margin, Stroke, TextStyle, Vec2};
use mavlink_ext::SystemId;

/// Behind everything.
pub const GROUND: Color32 = Color32::from_rgb(0x0c, 0x0f, 0x14);
/// Panels.
pub const PANEL: Color32 = Color32::from_rgb(0x13, 0x18, 0x1f);
/// Cards and fields on panels.
pub const CARD: Color32 = Color32::from_rgb(0x1b, 0x22, 0x2b);
/// Lines between things.
pub const LINE: Color32 = Color32::from_rgb(0x2b, 0x35, 0x41);
/// Text.
pub const TEXT: Color32 = Color32::from_rgb(0xdd, 0xe4, 0xec);
/// Text of less weight, and values that are old.
pub const DIM: Color32 = Color32::from_rgb(0x8b, 0x98, 0xa8);
/// Warnings, and nothing else.
pub const RED: Color32 = Color32::from_rgb(0xff, 0x5d, 0x5d);
/// Cautions, and nothing else.
pub const AMBER: Color32 = Color32::from_rgb(0xff, 0xb8, 0x4d);
/// The words "ready" and "verified".
pub const GREEN: Color32 = Color32::from_rgb(0x62, 0xd3, 0x8f);
/// Selection and advisories.
pub const CYAN: Color32 = Color32::from_rgb(0x4f, 0xc3, 0xe8);
/// The frame of a replay.
pub const REPLAY: Color32 = Color32::from_rgb(0xc8, 0x8c, 0xff);

/// Identity of vehicles: none of the colours that mean something.
const VEHICLES: [Color32; 4] = [
    Color32::from_rgb(0x7a, 0xa2, 0xff),
    Color32::from_rgb(0xe0, 0x8f, 0xd0),
    Color32::from_rgb(0x3f, 0xb8, 0xa5),
    Color32::from_rgb(0xc9, 0x9a, 0x6b),
];

/// The colour of a vehicle: blue for 1, pink for 2, teal for 3, brown for 4, and again.
pub fn vehicle(id: SystemId) -> Color32 {
    VEHICLES[usize::from(id.0.wrapping_sub(1)) % VEHICLES.len()]
}

/// Captions above groups of values.
pub fn caption() -> TextStyle {
    TextStyle::Name("caption".into())
}

/// The one value of a panel that matters most.
pub fn large() -> TextStyle {
    TextStyle::Name("large".into())
}

/// Makes a context look like the ground station.
pub fn apply(ctx: &egui::Context) {
    ctx.set_theme(egui::Theme::Dark);
    ctx.all_styles_mut(|style| {
        let text = |size| FontId::new(size, FontFamily::Proportional);
        style.text_styles = [
            (TextStyle::Small, text(11.0)),
            (TextStyle::Body, text(13.5)),
            (TextStyle::Button, text(13.5)),
            (TextStyle::Heading, text(17.0)),
            (
                TextStyle::Monospace,
                FontId::new(12.5, FontFamily::Monospace),
            ),
            (caption(), text(11.0)),
            (large(), FontId::new(17.0, FontFamily::Monospace)),
        ]
        .into();
        let spacing = &mut style.spacing;
        spacing.item_spacing = Vec2::new(8.0, 5.0);
        spacing.button_padding = Vec2::new(10.0, 4.0);
        spacing.interact_size.y = 24.0;
        spacing.menu_margin = Margin::same(8);
        colour(&mut style.visuals);
    });
}

fn colour(visuals: &mut egui::Visuals) {
    visuals.panel_fill = PANEL;
    visuals.window_fill = CARD;
    visuals.window_stroke = Stroke::new(1.0, LINE);
    visuals.extreme_bg_color = GROUND;
    visuals.faint_bg_color = CARD;
    visuals.override_text_color = None;
    visuals.weak_text_color = Some(DIM);
    visuals.warn_fg_color = AMBER;
    visuals.error_fg_color = RED;
    visuals.hyperlink_color = CYAN;
    visuals.selection.bg_fill = Color32::from_rgb(0x1d, 0x4a, 0x5c);
    visuals.selection.stroke = Stroke::new(1.0, CYAN);
    let radius = CornerRadius::same(4);
    let states = [
        (&mut visuals.widgets.noninteractive, PANEL, LINE, TEXT),
        (
            &mut visuals.widgets.inactive,
            Color32::from_rgb(0x27, 0x31, 0x3d),
            LINE,
            TEXT,
        ),
        (
            &mut visuals.widgets.hovered,
            Color32::from_rgb(0x32, 0x3f, 0x4e),
            CYAN,
            Color32::WHITE,
        ),
        (
            &mut visuals.widgets.active,
            Color32::from_rgb(0x3b, 0x4b, 0x5d),
            CYAN,
            Color32::WHITE,
        ),
        (
            &mut visuals.widgets.open,
            Color32::from_rgb(0x27, 0x31, 0x3d),
            LINE,
            TEXT,
        ),
    ];
    for (state, fill, line, text) in states {
        state.bg_fill = fill;
        state.weak_bg_fill = fill;
        state.bg_stroke = Stroke::new(1.0, line);
        state.fg_stroke = Stroke::new(1.0, text);
        state.corner_radius = radius;
        state.expansion = 0.0;
    }
}
