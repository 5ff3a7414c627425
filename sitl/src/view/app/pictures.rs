//! What the sensors see, beside the 3-D view.

use egui::{Color32, RichText, Sense, TextureOptions, Ui, Vec2, vec2};
use sitl::scene::Class;

use super::App;
use crate::view::sensors::{Kind, Panel, Tab, Wanted};

/// What is old.
const AMBER: Color32 = Color32::from_rgb(0xff, 0xb8, 0x4d);
/// Above each picture, for its name.
const NAME_HEIGHT: f32 = 20.0;
const GAP: f32 = 6.0;
/// An entry of the legend has no more room than that on average.
const ENTRY_WIDTH: f32 = 76.0;
const ENTRY_HEIGHT: f32 = 15.0;

/// A panel's picture on the graphics card: as it is where it is enlarged, smooth where it is made smaller.
pub(super) fn load(ctx: &egui::Context, panel: &Panel) -> egui::TextureHandle {
    let canvas = &panel.canvas;
    let size = [canvas.width(), canvas.height()];
    let image = egui::ColorImage::from_rgb(size, canvas.pixels().as_flattened());
    let options = TextureOptions {
        magnification: egui::TextureFilter::Nearest,
        ..TextureOptions::LINEAR
    };
    ctx.load_texture(panel.name, image, options)
}

/// How old something is in comparison with what is wanted; `None` if it is of that moment.
pub(super) fn age(of: &Wanted, wanted: &Wanted) -> Option<String> {
    if of.scene != wanted.scene {
        return Some("of another scene".to_owned());
    }
    if of.at == wanted.at && of.poses == wanted.poses {
        return None;
    }
    let seconds = of.at.distance(wanted.at).as_secs_f64();
    let side = if of.at <= wanted.at {
        "before"
    } else {
        "after"
    };
    Some(format!("{seconds:.2} s {side}"))
}

/// In how many columns pictures of one size are as large as possible, and how large: `None` where there is no room at all. They
/// are enlarged by whole factors only, so that pixels stay pixels.
fn grid(count: usize, picture: Vec2, room: Vec2) -> Option<(usize, Vec2)> {
    let sizes = (1..=count).map(|columns| {
        let rows = count.div_ceil(columns) as f32;
        let across = columns as f32;
        let width = (room.x - GAP * (across - 1.0)) / across;
        let height = (room.y - GAP * (rows - 1.0)) / rows - NAME_HEIGHT;
        let scale = (width / picture.x).min(height / picture.y);
        (columns, scale)
    });
    let (columns, scale) = sizes.max_by(|a, b| a.1.total_cmp(&b.1))?;
    let scale = if scale >= 1.0 { scale.floor() } else { scale };
    (scale > 0.0).then(|| (columns, picture * scale))
}

impl App {
    pub(super) fn pictures_ui(&mut self, ui: &mut Ui) {
        // Without it the panel would shrink to what is in it before there are pictures.
        ui.take_available_width();
        ui.add_space(4.0);
        ui.horizontal(|ui| {
            for (tab, name) in Tab::ALL {
                ui.selectable_value(&mut self.tab, tab, RichText::new(name).strong());
            }
        });
        ui.horizontal_wrapped(|ui| {
            if self.tab == Tab::Above {
                ui.disable();
            }
            for (kind, name) in Kind::ALL {
                ui.selectable_value(&mut self.kind, kind, name);
            }
        });
        let wanted = self.wanted();
        let Some((pictures, textures)) = &self.pictures else {
            let text = match self.failed {
                Some(error) => error.to_string(),
                None => "drawing".to_owned(),
            };
            ui.label(text);
            return;
        };
        let age = age(&pictures.of, &wanted);
        let stamp = format!("at {:.3} s", pictures.of.at.as_secs_f64());
        let took = format!("drawn in {} ms", pictures.took.as_millis());
        let state = if let Some(age) = &age {
            RichText::new(format!("STALE: {age}")).color(AMBER)
        } else if pictures.of.has_pictures_of(&wanted) {
            RichText::new(took).weak()
        } else {
            RichText::new("drawing").color(AMBER)
        };
        // Cut off before it makes the panel wider.
        ui.add(egui::Label::new(RichText::new(stamp).monospace()).truncate());
        ui.add(egui::Label::new(state).truncate());
        let legend = legend(pictures.of.tab, pictures.of.kind);
        let per_row = (ui.available_width() / ENTRY_WIDTH).floor().max(1.0) as usize;
        let legend_height = legend.len().div_ceil(per_row) as f32 * ENTRY_HEIGHT;
        let room = ui.available_size() - vec2(0.0, legend_height + 4.0);
        let size = textures
            .first()
            .map_or(Vec2::ZERO, egui::TextureHandle::size_vec2);
        if let Some((columns, size)) = grid(textures.len(), size, room) {
            let shown: Vec<_> = pictures.panels.iter().zip(textures).collect();
            ui.spacing_mut().item_spacing = vec2(GAP, 0.0);
            for row in shown.chunks(columns) {
                ui.horizontal(|ui| {
                    for (panel, texture) in row {
                        picture_ui(ui, panel, (texture, size), age.is_some());
                    }
                });
                ui.add_space(GAP);
            }
        }
        legend_ui(ui, &legend);
    }
}

fn picture_ui(
    ui: &mut Ui,
    panel: &Panel,
    (texture, size): (&egui::TextureHandle, Vec2),
    old: bool,
) {
    ui.vertical(|ui| {
        ui.set_width(size.x);
        ui.spacing_mut().item_spacing.y = 0.0;
        let name = vec2(size.x, NAME_HEIGHT);
        let layout = egui::Layout::left_to_right(egui::Align::Center);
        ui.allocate_ui_with_layout(name, layout, |ui| {
            ui.set_min_height(NAME_HEIGHT);
            ui.label(RichText::new(panel.name).small());
        });
        let (rect, response) = ui.allocate_exact_size(size, Sense::hover());
        response.widget_info(|| {
            egui::WidgetInfo::labeled(egui::Role::Image, true, format!("picture: {}", panel.name))
        });
        // On whole points, so that a pixel of the picture is one of the window where it is as large.
        let rect = egui::Rect::from_min_size(rect.min.round(), rect.size());
        let whole = egui::Rect::from_min_max(egui::Pos2::ZERO, egui::pos2(1.0, 1.0));
        ui.painter()
            .image(texture.id(), rect, whole, Color32::WHITE);
        if old {
            let stroke = egui::Stroke::new(2.0, AMBER);
            let painter = ui.painter();
            painter.rect_stroke(rect, 0.0, stroke, egui::StrokeKind::Outside);
        }
    });
}

/// What colours mean.
fn legend(tab: Tab, kind: Kind) -> Vec<([u8; 3], String)> {
    const CLASSES: [Class; 17] = [
        Class::Sky,
        Class::Road,
        Class::Sidewalk,
        Class::Terrain,
        Class::Building,
        Class::Wall,
        Class::Pole,
        Class::Sign,
        Class::Vegetation,
        Class::Bridge,
        Class::Object,
        Class::Car,
        Class::Truck,
        Class::Bus,
        Class::Cyclist,
        Class::Pedestrian,
        Class::Robot,
    ];
    let named = |name: &str, colour| (colour, name.to_owned());
    let occlusion = [
        named("seen whole", [0, 255, 38]),
        named("half hidden", [127, 127, 38]),
        named("hidden", [255, 0, 38]),
    ];
    let classes = CLASSES.map(|class| (class.colour(), format!("{class:?}").to_lowercase()));
    match (tab, kind) {
        (Tab::Above, _) => classes.into_iter().chain(occlusion).collect(),
        (_, Kind::Class) => classes.into(),
        (_, Kind::Occlusion) => occlusion.into(),
        (_, Kind::Depth) => vec![
            named("4 m or nearer", [255, 255, 63]),
            named("16 m", [127, 90, 127]),
            named("nothing", [0, 0, 191]),
        ],
        (_, Kind::Colour | Kind::Instance) => Vec::new(),
    }
}

fn legend_ui(ui: &mut Ui, legend: &[([u8; 3], String)]) {
    ui.spacing_mut().item_spacing = vec2(4.0, 1.0);
    ui.horizontal_wrapped(|ui| {
        for ([r, g, b], name) in legend {
            let (rect, _) = ui.allocate_exact_size(vec2(10.0, 10.0), Sense::hover());
            let painter = ui.painter();
            painter.rect_filled(rect, 2.0, Color32::from_rgb(*r, *g, *b));
            let stroke = egui::Stroke::new(1.0, Color32::from_gray(120));
            painter.rect_stroke(rect, 2.0, stroke, egui::StrokeKind::Inside);
            let label = egui::Label::new(RichText::new(name).small());
            ui.add(label.wrap_mode(egui::TextWrapMode::Extend));
            ui.add_space(4.0);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check_grid(count: usize, picture: [f32; 2], room: [f32; 2], columns: usize) {
        let (got, size) = grid(count, picture.into(), room.into()).expect("room");
        assert_eq!(got, columns, "{count} pictures of {picture:?} in {room:?}");
        let rows = count.div_ceil(got) as f32;
        let height = rows * (size.y + NAME_HEIGHT) + GAP * (rows - 1.0);
        let width = got as f32 * size.x + GAP * (got as f32 - 1.0);
        assert!(
            width <= room[0] + 0.1 && height <= room[1] + 0.1,
            "{size:?}"
        );
    }

    #[test]
    fn pictures_are_as_large_as_the_room_lets_them_be() {
        check_grid(1, [640.0, 480.0], [400.0, 800.0], 1);
        check_grid(4, [736.0, 256.0], [420.0, 800.0], 1);
        check_grid(4, [736.0, 256.0], [1400.0, 500.0], 2);
        check_grid(3, [384.0, 384.0], [420.0, 500.0], 2);
        let (_, size) = grid(1, vec2(640.0, 480.0), vec2(1000.0, 900.0)).expect("room");
        assert_eq!(size, vec2(640.0, 480.0), "whole factors");
        assert_eq!(grid(4, vec2(736.0, 256.0), vec2(0.0, 50.0)), None);
        assert_eq!(grid(0, vec2(1.0, 1.0), vec2(50.0, 50.0)), None);
    }

    #[test]
    fn the_legend_has_the_colours_of_the_pictures() {
        let of = |class: Class| legend(Tab::Drone, Kind::Class)[class as usize].clone();
        for class in [Class::Sky, Class::Bus, Class::Robot] {
            assert_eq!(of(class).0, class.colour());
        }
        assert!(legend(Tab::Ground, Kind::Colour).is_empty());
    }
}
