//! The window without a window: the same panels and the same 3-D view, drawn into a texture.
//!
//! A software rasteriser will do: a processor is taken as device if that is all there is.

use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::Path;
use std::sync::mpsc;
use std::time::Duration;

use anyhow::Context as _;
use egui_wgpu::{RenderState, ScreenDescriptor, WgpuConfiguration, WgpuSetup, WgpuSetupCreateNew};

use super::app::{App, Start};
use super::gpu;

/// A software rasteriser on a busy machine is slow, but not that slow.
const PATIENCE: Duration = Duration::from_mins(3);
/// egui needs some passes to know the size of everything.
const PASSES: usize = 4;

/// Why nothing can be drawn.
#[derive(Debug, thiserror::Error)]
pub(crate) enum HeadlessError {
    #[error(
        "no Vulkan device: {0}; on Debian, `apt-get install mesa-vulkan-drivers` brings one in software"
    )]
    NoDevice(egui_wgpu::WgpuError),
    #[error("the graphics device draws at most {largest} pixels along an edge, not {wanted}")]
    TooLarge { wanted: u32, largest: u32 },
    #[error("the graphics device did not finish a picture within {PATIENCE:?}")]
    Stuck,
}

/// Draws what the window would show, once everything in it is of the moment that is shown.
pub(super) fn screenshot(start: Start, size: [u32; 2], file: &Path) -> anyhow::Result<()> {
    let state = device(size)?;
    gpu::install(&state, true);
    let ctx = egui::Context::default();
    ctx.set_theme(egui::Theme::Dark);
    let mut app = App::new(start, None, Box::new(|| {}))?;
    app.settle(&ctx, PATIENCE)?;
    let rgba = picture(&state, &ctx, size, |ui| app.ui(ui))?;
    let cannot = || format!("cannot write {}", file.display());
    let mut out = BufWriter::new(File::create(file).with_context(cannot)?);
    let mut encoder = png::Encoder::new(&mut out, size[0], size[1]);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().with_context(cannot)?;
    writer.write_image_data(&rgba).with_context(cannot)?;
    drop(writer);
    out.flush().with_context(cannot)
}

fn device(size: [u32; 2]) -> Result<RenderState, HeadlessError> {
    let setup = WgpuSetup::CreateNew(WgpuSetupCreateNew::without_display_handle());
    let instance = pollster::block_on(setup.new_instance());
    let config = WgpuConfiguration {
        wgpu_setup: setup,
        ..WgpuConfiguration::default()
    };
    let options = egui_wgpu::RendererOptions::PREDICTABLE;
    let state = pollster::block_on(RenderState::create(&config, &instance, None, options))
        .map_err(HeadlessError::NoDevice)?;
    let largest = state.device.limits().max_texture_dimension_2d;
    let wanted = size[0].max(size[1]);
    if wanted > largest {
        return Err(HeadlessError::TooLarge { wanted, largest });
    }
    Ok(state)
}

/// Runs `ui` until it has settled and draws it: red, green, blue and 255 of each pixel, row by row.
fn picture(
    state: &RenderState,
    ctx: &egui::Context,
    size: [u32; 2],
    mut ui: impl FnMut(&mut egui::Ui),
) -> Result<Vec<u8>, HeadlessError> {
    let screen = egui::vec2(size[0] as f32, size[1] as f32);
    let rect = egui::Rect::from_min_size(egui::Pos2::ZERO, screen);
    let mut last = None;
    for _ in 0..PASSES {
        let input = egui::RawInput {
            screen_rect: Some(rect),
            time: Some(0.0),
            ..egui::RawInput::default()
        };
        let mut output = ctx.run_ui(input, &mut ui);
        take_textures(state, &mut output.textures_delta);
        last = Some(output);
    }
    let output = last.ok_or(HeadlessError::Stuck)?;
    let primitives = ctx.tessellate(output.shapes, output.pixels_per_point);
    draw(state, &primitives, (size, output.pixels_per_point))
}

fn take_textures(state: &RenderState, delta: &mut egui::TexturesDelta) {
    let mut renderer = state.renderer.write();
    #[expect(
        clippy::iter_over_hash_type,
        reason = "each texture is set and freed by itself"
    )]
    for (id, images) in delta.set.drain() {
        for image in images {
            renderer.update_texture(&state.device, &state.queue, id, &image);
        }
    }
    #[expect(
        clippy::iter_over_hash_type,
        reason = "each texture is set and freed by itself"
    )]
    for id in delta.free.drain() {
        renderer.free_texture(&id);
    }
}

fn draw(
    state: &RenderState,
    primitives: &[egui::ClippedPrimitive],
    (size, pixels_per_point): ([u32; 2], f32),
) -> Result<Vec<u8>, HeadlessError> {
    let (device, queue) = (&state.device, &state.queue);
    let screen = ScreenDescriptor {
        pixels_per_point,
        size_in_pixels: size,
    };
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let mut renderer = state.renderer.write();
    let before = renderer.update_buffers(device, queue, &mut encoder, primitives, &screen);
    let extent = wgpu::Extent3d {
        width: size[0],
        height: size[1],
        depth_or_array_layers: 1,
    };
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("screenshot"),
        size: extent,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: state.target_format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    let mut pass = encoder
        .begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("screenshot"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &view,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                    store: wgpu::StoreOp::Store,
                },
                depth_slice: None,
            })],
            ..wgpu::RenderPassDescriptor::default()
        })
        .forget_lifetime();
    renderer.render(&mut pass, primitives, &screen);
    drop((pass, renderer));
    // Rows in a buffer start at multiples of 256 bytes.
    let stride = (4 * size[0]).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("screenshot"),
        size: u64::from(stride) * u64::from(size[1]),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(stride),
        rows_per_image: None,
    };
    let to = wgpu::TexelCopyBufferInfo {
        buffer: &buffer,
        layout,
    };
    encoder.copy_texture_to_buffer(texture.as_image_copy(), to, extent);
    queue.submit(before.into_iter().chain([encoder.finish()]));
    let padded = read(device, &buffer)?;
    Ok(pixels(&padded, stride, size[0], state.target_format))
}

fn read(device: &wgpu::Device, buffer: &wgpu::Buffer) -> Result<Vec<u8>, HeadlessError> {
    let (sender, receiver) = mpsc::sync_channel(1);
    buffer.map_async(wgpu::MapMode::Read, .., move |mapped| {
        // The other end waits below, or has given up.
        drop(sender.send(mapped));
    });
    let wait = wgpu::PollType::Wait {
        submission_index: None,
        timeout: Some(PATIENCE),
    };
    device.poll(wait).map_err(|_timeout| HeadlessError::Stuck)?;
    let mapped = receiver.recv_timeout(PATIENCE);
    mapped
        .ok()
        .and_then(Result::ok)
        .ok_or(HeadlessError::Stuck)?;
    let bytes = buffer.get_mapped_range(..);
    let bytes = bytes.map_err(|_unmapped| HeadlessError::Stuck)?;
    Ok(bytes.to_vec())
}

fn pixels(padded: &[u8], stride: u32, width: u32, format: wgpu::TextureFormat) -> Vec<u8> {
    let row = 4 * width as usize;
    let rows = padded.chunks_exact(stride as usize);
    let mut rgba: Vec<u8> = rows.flat_map(|padded| &padded[..row]).copied().collect();
    let is_bgra = matches!(
        format,
        wgpu::TextureFormat::Bgra8Unorm | wgpu::TextureFormat::Bgra8UnormSrgb
    );
    for pixel in rgba.chunks_exact_mut(4) {
        if is_bgra {
            pixel.swap(0, 2);
        }
        pixel[3] = 255;
    }
    rgba
}
