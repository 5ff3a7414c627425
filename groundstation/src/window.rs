//! The window: eframe around [`App`].

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Duration;

use crate::app::App;
use crate::picture::Picture;
use crate::render;
use crate::view::theme;

/// What is shown is never older than this. The window also draws whenever the operator moves something.
const REDRAW_EVERY: Duration = Duration::from_millis(100);
/// Some frames before a picture, so that everything has found its place.
const SETTLING_FRAMES: u32 = 3;

struct Window {
    app: Option<App>,
    stop: Arc<AtomicBool>,
    outcome: SyncSender<anyhow::Result<()>>,
    pictures: (SyncSender<Picture>, Receiver<Picture>),
    settled: u32,
}

/// Runs the app in a window until it is closed, the script ends or `stop` is set.
pub fn run(app: App, size: [f32; 2], stop: Arc<AtomicBool>) -> anyhow::Result<()> {
    let (sender, outcome) = sync_channel(1);
    let options = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default()
            .with_title("Tandem ground station")
            .with_inner_size(size),
        ..eframe::NativeOptions::default()
    };
    let make = move |context: &eframe::CreationContext<'_>| {
        theme::apply(&context.egui_ctx);
        let state = context
            .wgpu_render_state
            .as_ref()
            .ok_or("the window has no wgpu device")?;
        render::install(state);
        let window = Window {
            app: Some(app),
            stop,
            outcome: sender,
            pictures: sync_channel(4),
            settled: 0,
        };
        Ok(Box::new(window) as Box<dyn eframe::App>)
    };
    eframe::run_native("tandem-groundstation", options, Box::new(make)).map_err(|error| {
        anyhow::anyhow!(
            "cannot open a window: {error}\nWithout a display, run with --headless (and --script, --screenshot)"
        )
    })?;
    outcome.try_recv().unwrap_or(Ok(()))
}

impl Window {
    /// Ends the app and closes the window.
    fn end(&mut self, ctx: &egui::Context) {
        self.finish();
        ctx.send_viewport_cmd(egui::ViewportCommand::Close);
    }

    fn finish(&mut self) {
        if let Some(app) = self.app.take() {
            // The other end waits for it in `run`.
            drop(self.outcome.try_send(app.finish()));
        }
    }

    fn take_pictures(&mut self, ctx: &egui::Context) -> anyhow::Result<()> {
        let Some(app) = &mut self.app else {
            return Ok(());
        };
        if let Ok(picture) = self.pictures.1.try_recv() {
            self.settled = 0;
            return app.deliver_picture(&picture);
        }
        if app.wanted_picture().is_none() {
            return Ok(());
        }
        self.settled += 1;
        if self.settled == SETTLING_FRAMES {
            let sender = self.pictures.0.clone();
            // A picture that comes too late for anybody is dropped.
            ctx.request_screenshot(move |image| drop(sender.try_send(Picture::from_egui(&image))));
        }
        ctx.request_repaint();
        Ok(())
    }
}

impl eframe::App for Window {
    fn logic(&mut self, ctx: &egui::Context, _frame: &mut eframe::Frame) {
        let Some(app) = &mut self.app else { return };
        app.logic(Duration::ZERO);
        let ended = app.end().is_some() && app.wanted_picture().is_none();
        let taken = self.take_pictures(ctx);
        if let Err(error) = taken {
            tracing::error!("{error:#}");
            self.end(ctx);
        } else if ended || self.stop.load(Ordering::Relaxed) {
            self.end(ctx);
        }
        ctx.request_repaint_after(REDRAW_EVERY);
    }

    fn ui(&mut self, ui: &mut egui::Ui, _frame: &mut eframe::Frame) {
        if let Some(app) = &mut self.app {
            app.ui(ui);
        }
    }

    fn on_exit(&mut self) {
        self.finish();
    }

    fn persist_egui_memory(&self) -> bool {
        false
    }
}
