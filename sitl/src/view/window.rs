//! The window: eframe around [`App`].

use std::time::Duration;

use egui_wgpu::WgpuError;

use super::app::{App, Start};
use super::gpu;
use super::world::History;

/// How often a run is looked at while the time line stands.
const LOOK_EVERY: Duration = Duration::from_millis(100);

struct Window<F> {
    app: App,
    /// Vehicles are simulated beside it.
    is_live: bool,
    has_ended: F,
}

/// Shows the viewer until it is closed, or `has_ended`.
pub(super) fn show(
    start: Start,
    history: Option<History>,
    [width, height]: [u32; 2],
    has_ended: impl Fn() -> bool,
) -> anyhow::Result<()> {
    let options = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default()
            .with_title("Tandem simulated world")
            .with_inner_size([width as f32, height as f32]),
        ..eframe::NativeOptions::default()
    };
    let make = |context: &eframe::CreationContext<'_>| {
        context.egui_ctx.set_theme(egui::Theme::Dark);
        let state = context
            .wgpu_render_state
            .as_ref()
            .ok_or("the window has no wgpu device")?;
        gpu::install(state, false);
        let ctx = context.egui_ctx.clone();
        let wake = Box::new(move || ctx.request_repaint());
        let is_live = history.is_some();
        let window = Window {
            app: App::new(start, history, wake)?,
            is_live,
            has_ended,
        };
        Ok(Box::new(window) as Box<dyn eframe::App + '_>)
    };
    eframe::run_native("tandem-sitl", options, Box::new(make)).map_err(|error| explained(&error))
}

/// What to do about it.
fn explained(error: &eframe::Error) -> anyhow::Error {
    let remedy = match error {
        eframe::Error::Wgpu(
            WgpuError::RequestAdapterError(_)
            | WgpuError::CustomNativeAdapterSelectionError(_)
            | WgpuError::RequestDeviceError(_),
        ) => {
            "There is no graphics device: on Debian, `apt-get install mesa-vulkan-drivers` brings one in software"
        }
        _ => "Without a display, draw a picture: sitl view --screenshot FILE",
    };
    anyhow::anyhow!("cannot open a window: {error}\n{remedy}")
}

impl<F: Fn() -> bool> eframe::App for Window<F> {
    fn logic(&mut self, ctx: &egui::Context, _frame: &mut eframe::Frame) {
        let passed = ctx.input(|input| input.unstable_dt);
        self.app.logic(ctx, f64::from(passed));
        if (self.has_ended)() {
            ctx.send_viewport_cmd(egui::ViewportCommand::Close);
        }
        if self.app.is_moving() {
            ctx.request_repaint();
        } else if self.is_live {
            ctx.request_repaint_after(LOOK_EVERY);
        }
    }

    fn ui(&mut self, ui: &mut egui::Ui, _frame: &mut eframe::Frame) {
        self.app.ui(ui);
    }

    fn persist_egui_memory(&self) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_window_the_error_names_what_to_do() {
        let no_reason = || Box::<dyn std::error::Error + Send + Sync>::from("no display");
        let text = explained(&eframe::Error::AppCreation(no_reason())).to_string();
        assert!(
            text.contains("no display") && text.contains("--screenshot FILE"),
            "{text}"
        );
        let none = WgpuError::CustomNativeAdapterSelectionError("none".to_owned());
        let text = explained(&eframe::Error::Wgpu(none)).to_string();
        assert!(text.contains("mesa-vulkan-drivers"), "{text}");
    }
}
