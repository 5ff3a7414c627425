//! The window without a window: the same egui views and the same wgpu pass, drawn into a texture.
//!
//! A software rasteriser will do: a processor is taken as adapter if that is all there is.

use std::sync::mpsc;
use std::time::Duration;

use egui_wgpu::{
    RenderState, ScreenDescriptor, WgpuConfiguration, WgpuSetup, WgpuSetupCreateNew, wgpu,
};

use crate::picture::Picture;

/// A software rasteriser on a busy machine is slow, but not that slow.
const PATIENCE: Duration = Duration::from_mins(2);
/// Passes before the picture is taken: egui needs some to know the size of everything.
const SETTLING_PASSES: usize = 3;

/// Why nothing can be drawn.
#[derive(Debug, thiserror::Error)]
pub enum HeadlessError {
    /// There is neither a graphics card nor a software rasteriser.
    #[error(
        "no Vulkan device: {0}; on Debian, `apt-get install mesa-vulkan-drivers` brings a software rasteriser"
    )]
    NoDevice(egui_wgpu::WgpuError),
    /// It did not finish in time.
    #[error("the graphics device did not finish a picture within {PATIENCE:?}: {0}")]
    Poll(wgpu::PollError),
    /// The pixels cannot be read back.
    #[error("cannot read the picture from the graphics device: {0}")]
    Map(wgpu::BufferAsyncError),
    /// The pixels cannot be looked at.
    #[error("cannot look at the picture of the graphics device: {0}")]
    Range(wgpu::MapRangeError),
    /// The device never answered.
    #[error("the graphics device never gave the picture back")]
    Silent,
}

/// An egui context that draws into a texture.
pub struct Headless {
    ctx: egui::Context,
    state: RenderState,
    size: [u32; 2],
}

impl Headless {
    /// Looks for a device and draws pictures of `size` pixels from now on.
    pub fn new(ctx: egui::Context, size: [u32; 2]) -> Result<Self, HeadlessError> {
        let setup = WgpuSetup::CreateNew(WgpuSetupCreateNew::without_display_handle());
        let instance = pollster::block_on(setup.new_instance());
        let config = WgpuConfiguration {
            wgpu_setup: setup,
            ..WgpuConfiguration::default()
        };
        let options = egui_wgpu::RendererOptions::PREDICTABLE;
        let state = pollster::block_on(RenderState::create(&config, &instance, None, options))
            .map_err(HeadlessError::NoDevice)?;
        Ok(Self { ctx, state, size })
    }

    /// What the device and its renderer are.
    pub fn render_state(&self) -> &RenderState {
        &self.state
    }

    /// Draws `ui` as it is at `time_s` of the context's time.
    pub fn picture(
        &mut self,
        time_s: f64,
        mut ui: impl FnMut(&mut egui::Ui),
    ) -> Result<Picture, HeadlessError> {
        let rect = egui::Rect::from_min_size(
            egui::Pos2::ZERO,
            egui::vec2(self.size[0] as f32, self.size[1] as f32),
        );
        for pass in 0.. {
            let input = egui::RawInput {
                screen_rect: Some(rect),
                time: Some(time_s),
                ..egui::RawInput::default()
            };
            let mut output = self.ctx.run_ui(input, &mut ui);
            self.take_textures(&mut output.textures_delta);
            if pass == SETTLING_PASSES {
                return self.draw(output.shapes, output.pixels_per_point);
            }
        }
        Err(HeadlessError::Silent)
    }

    fn take_textures(&self, delta: &mut egui::TexturesDelta) {
        let mut renderer = self.state.renderer.write();
        #[expect(
            clippy::iter_over_hash_type,
            reason = "each texture is set and freed by itself"
        )]
        for (id, images) in delta.set.drain() {
            for image in images {
                renderer.update_texture(&self.state.device, &self.state.queue, id, &image);
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
        &self,
        shapes: Vec<egui::epaint::ClippedShape>,
        pixels_per_point: f32,
    ) -> Result<Picture, HeadlessError> {
        let RenderState { device, queue, .. } = &self.state;
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor {
            label: Some("picture"),
        });
        let screen = ScreenDescriptor {
            pixels_per_point,
            size_in_pixels: self.size,
        };
        let primitives = self.ctx.tessellate(shapes, pixels_per_point);
        let mut renderer = self.state.renderer.write();
        let before = renderer.update_buffers(device, queue, &mut encoder, &primitives, &screen);
        let texture = self.target();
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let mut pass = encoder
            .begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("picture"),
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
        renderer.render(&mut pass, &primitives, &screen);
        drop((pass, renderer));
        let (buffer, stride) = self.copy_out(&mut encoder, &texture);
        queue.submit(before.into_iter().chain([encoder.finish()]));
        let rgba = self.read(&buffer, stride)?;
        Ok(Picture {
            width: self.size[0],
            height: self.size[1],
            rgba,
        })
    }

    fn target(&self) -> wgpu::Texture {
        self.state.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("picture"),
            size: self.extent(),
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: self.state.target_format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        })
    }

    fn extent(&self) -> wgpu::Extent3d {
        wgpu::Extent3d {
            width: self.size[0],
            height: self.size[1],
            depth_or_array_layers: 1,
        }
    }

    fn copy_out(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        texture: &wgpu::Texture,
    ) -> (wgpu::Buffer, u32) {
        let stride = (4 * self.size[0]).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffer = self.state.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("picture"),
            size: u64::from(stride) * u64::from(self.size[1]),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(stride),
            rows_per_image: None,
        };
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout,
            },
            self.extent(),
        );
        (buffer, stride)
    }

    fn read(&self, buffer: &wgpu::Buffer, stride: u32) -> Result<Vec<u8>, HeadlessError> {
        let (sender, receiver) = mpsc::sync_channel(1);
        buffer.map_async(wgpu::MapMode::Read, .., move |mapped| {
            // The other end waits below, or has given up.
            drop(sender.send(mapped));
        });
        let wait = wgpu::PollType::Wait {
            submission_index: None,
            timeout: Some(PATIENCE),
        };
        self.state.device.poll(wait).map_err(HeadlessError::Poll)?;
        let mapped = receiver
            .recv_timeout(PATIENCE)
            .map_err(|_timeout| HeadlessError::Silent)?;
        mapped.map_err(HeadlessError::Map)?;
        let bytes = buffer.get_mapped_range(..).map_err(HeadlessError::Range)?;
        let row = 4 * self.size[0] as usize;
        let mut rgba: Vec<u8> = bytes
            .chunks_exact(stride as usize)
            .flat_map(|padded| &padded[..row])
            .copied()
            .collect();
        let is_bgra = matches!(
            self.state.target_format,
            wgpu::TextureFormat::Bgra8Unorm | wgpu::TextureFormat::Bgra8UnormSrgb
        );
        for pixel in rgba.chunks_exact_mut(4) {
            if is_bgra {
                pixel.swap(0, 2);
            }
            pixel[3] = 255;
        }
        Ok(rgba)
    }
}
