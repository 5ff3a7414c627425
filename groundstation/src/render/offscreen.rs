//! Pictures of a scene without a window: for reports, for tests and for machines without a screen.
//!
//! Any Vulkan device will do, a graphics card before Mesa's software rasteriser.

use std::sync::mpsc;
use std::time::Duration;

use wgpu::{Adapter, Backends, Device, DeviceType, Queue};

use super::gpu::{Frame, Renderer, ViewId};

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
pub enum OffscreenError {
    /// No driver.
    #[error(
        "no Vulkan device found; without a graphics card install Mesa's software one: apt install mesa-vulkan-drivers"
    )]
    NoAdapter,
    /// A driver that does not do what every one must.
    #[error("the Vulkan device {name} cannot be used")]
    Device {
        /// What it calls itself.
        name: String,
        /// Why.
        source: wgpu::RequestDeviceError,
    },
    /// The picture is too large, or has no pixels.
    #[error(
        "cannot draw a picture of {width} x {height} pixels, only of 1 to {largest} along each side"
    )]
    Size {
        /// Wanted.
        width: u32,
        /// Wanted.
        height: u32,
        /// What the device can do.
        largest: u32,
    },
    /// The device did not finish.
    #[error("the Vulkan device {name} did not finish the picture within {} s", .waited.as_secs())]
    Stuck {
        /// What it calls itself.
        name: String,
        /// For how long.
        waited: Duration,
    },
}

/// A picture: red, green, blue and 255 of each pixel, row by row from the upper left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Pixels from left to right.
    pub width: u32,
    /// Pixels from top to bottom.
    pub height: u32,
    /// Four bytes a pixel.
    pub rgba: Vec<u8>,
}

impl Image {
    /// The colour of a pixel; `None` outside.
    pub fn pixel(&self, x: u32, y: u32) -> Option<[u8; 4]> {
        if x >= self.width || y >= self.height {
            return None;
        }
        let start = 4 * (y as usize * self.width as usize + x as usize);
        self.rgba.get(start..start + 4)?.try_into().ok()
    }

    /// Writes it as a PNG file.
    pub fn write_png(&self, to: impl std::io::Write) -> Result<(), png::EncodingError> {
        let mut encoder = png::Encoder::new(to, self.width, self.height);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.write_header()?.write_image_data(&self.rgba)
    }
}

/// A Vulkan device that draws pictures.
pub struct Offscreen {
    name: String,
    device: Device,
    queue: Queue,
    renderer: Renderer,
}

impl Offscreen {
    /// How long one picture may take: software on a busy machine is slow, but not that slow.
    const PATIENCE: Duration = Duration::from_mins(2);
    const VIEW: ViewId = ViewId(0);

    /// Opens the best Vulkan device.
    pub fn new() -> Result<Self, OffscreenError> {
        let adapter = best_adapter()?;
        let name = adapter.get_info().name;
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("map pictures"),
            required_limits: wgpu::Limits::downlevel_defaults().using_resolution(adapter.limits()),
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) =
            pollster::block_on(adapter.request_device(&descriptor)).map_err(|source| {
                OffscreenError::Device {
                    name: name.clone(),
                    source,
                }
            })?;
        let renderer = Renderer::new(&device, &queue, wgpu::TextureFormat::Rgba8Unorm);
        Ok(Self {
            name,
            device,
            queue,
            renderer,
        })
    }

    /// What the device calls itself.
    pub fn device_name(&self) -> &str {
        &self.name
    }

    /// The picture of `frame`.
    pub fn render(&mut self, frame: &Frame) -> Result<Image, OffscreenError> {
        let [width, height] = frame.size_px;
        let largest = self.renderer.largest_px();
        if !(1..=largest).contains(&width) || !(1..=largest).contains(&height) {
            return Err(OffscreenError::Size {
                width,
                height,
                largest,
            });
        }
        let drawing = self.renderer.draw(Self::VIEW, frame);
        let stuck = || OffscreenError::Stuck {
            name: self.name.clone(),
            waited: Self::PATIENCE,
        };
        let picture = self.renderer.picture(Self::VIEW).ok_or_else(stuck)?;

        // Rows in a buffer start at multiples of 256 bytes.
        let row_bytes = 4 * width;
        let stride = row_bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("map picture"),
            size: u64::from(stride) * u64::from(height),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut encoder = self
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_texture_to_buffer(
            picture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(stride),
                    rows_per_image: None,
                },
            },
            picture.size(),
        );
        let submission = self
            .queue
            .submit(drawing.into_iter().chain([encoder.finish()]));

        let (mapped, is_mapped) = mpsc::sync_channel(1);
        buffer.map_async(wgpu::MapMode::Read, .., move |result| {
            // The other end is gone only if nobody waits any more.
            let _unheard = mapped.send(result);
        });
        let wait = wgpu::PollType::Wait {
            submission_index: Some(submission),
            timeout: Some(Self::PATIENCE),
        };
        self.device.poll(wait).map_err(|_timeout| stuck())?;
        is_mapped
            .try_recv()
            .ok()
            .and_then(Result::ok)
            .ok_or_else(stuck)?;
        let bytes = buffer.get_mapped_range(..).map_err(|_unmapped| stuck())?;
        let rgba = bytes
            .chunks_exact(stride as usize)
            .flat_map(|row| &row[..row_bytes as usize])
            .copied()
            .collect();
        Ok(Image {
            width,
            height,
            rgba,
        })
    }
}

fn best_adapter() -> Result<Adapter, OffscreenError> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: Backends::VULKAN,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let adapters = pollster::block_on(instance.enumerate_adapters(Backends::VULKAN));
    adapters
        .into_iter()
        .min_by_key(|adapter| match adapter.get_info().device_type {
            DeviceType::DiscreteGpu => 0,
            DeviceType::IntegratedGpu => 1,
            DeviceType::VirtualGpu | DeviceType::Other => 2,
            DeviceType::Cpu => 3,
        })
        .ok_or(OffscreenError::NoAdapter)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use maps::frame::{Isometry, Point};
    use maps::voxel::{LogOdds, Rgb, Voxel, VoxelKey, VoxelMap};

    use super::*;
    use crate::render::scene::{Freshness, Marker, MarkerKind, Polyline, Scene, Stroke, Surfaces};
    use crate::render::{Camera3, Lens};

    const RED: [u8; 3] = [248, 0, 0];

    /// A red slab of 20 x 20 voxels of 0.1 m about the origin, its upper side on the ground, seen from above.
    fn slab() -> Scene {
        let mut map = VoxelMap::new(0.1);
        for x in -10..10 {
            for y in -10..10 {
                let voxel = Voxel {
                    color: Some(Rgb(RED)),
                    ..Voxel::new(LogOdds(70))
                };
                map.set_voxel(VoxelKey { x, y, z: -1 }, voxel);
            }
        }
        let mut scene = Scene::default();
        scene.look.grid = false;
        scene.update_map(&map, &map.tile_ids());
        scene
    }

    fn from_above(scene: Scene) -> Frame {
        Frame {
            scene: Arc::new(scene),
            camera: Camera3::default().top_down(),
            size_px: [123, 100],
        }
    }

    fn device() -> Offscreen {
        Offscreen::new().expect("a Vulkan device")
    }

    fn is_red([r, g, b, a]: [u8; 4]) -> bool {
        r > 200 && g < 20 && b < 20 && a == 255
    }

    #[test]
    fn a_voxel_is_where_the_camera_says_in_its_colour_and_nothing_is_around_it() {
        let image = device().render(&from_above(slab())).expect("a picture");
        // 100 pixels for 8.28 m: the slab is 24 wide.
        assert!(is_red(image.pixel(61, 50).expect("inside")));
        assert!(is_red(image.pixel(51, 40).expect("inside")));
        let nothing = image.pixel(40, 50).expect("inside");
        assert_eq!(nothing[..3], Scene::default().look.background);
        assert_eq!(image.pixel(123, 0), None);
    }

    #[test]
    fn both_lenses_see_the_target_in_the_middle_and_from_the_side() {
        let mut device = device();
        for lens in [Lens::Perspective, Lens::Parallel] {
            let frame = Frame {
                camera: Camera3::looking_at(Point::origin(), 0.7, 0.6, 5.0).with_lens(lens),
                ..from_above(slab())
            };
            let image = device.render(&frame).expect("a picture");
            assert!(is_red(image.pixel(61, 49).expect("inside")), "{lens:?}");
        }
    }

    #[test]
    fn the_near_hides_the_far() {
        let mut map = VoxelMap::new(0.1);
        for x in -20..20 {
            for y in -20..20 {
                for (z, rgb) in [(-1, RED), (20, [0, 248, 0])] {
                    map.set_voxel(
                        VoxelKey { x, y, z },
                        Voxel {
                            color: Some(Rgb(rgb)),
                            ..Voxel::new(LogOdds(70))
                        },
                    );
                }
            }
        }
        let mut scene = Scene::default();
        scene.look.grid = false;
        scene.update_map(&map, &map.tile_ids());
        let mut device = device();
        for lens in [Lens::Perspective, Lens::Parallel] {
            let mut frame = from_above(scene.clone());
            frame.camera = frame.camera.with_lens(lens);
            let [r, g, ..] = device
                .render(&frame)
                .expect("a picture")
                .pixel(61, 50)
                .expect("inside");
            assert!(g > 200 && r < 20, "the roof hides the floor, {lens:?}");
            let mut open = scene.clone();
            open.clip_above_m = Some(1.0);
            open.update_map(&map, &[]);
            frame.scene = Arc::new(open);
            let floor = device
                .render(&frame)
                .expect("a picture")
                .pixel(61, 50)
                .expect("inside");
            assert!(is_red(floor), "without the roof, {lens:?}");
        }
    }

    #[test]
    fn sides_that_nobody_has_seen_can_be_left_out() {
        let mut scene = slab();
        scene.look.surfaces = Surfaces::Observed;
        let image = device().render(&from_above(scene)).expect("a picture");
        assert_eq!(
            image.pixel(61, 50).expect("inside")[..3],
            Scene::default().look.background
        );
    }

    #[test]
    fn a_floor_is_shown_from_the_side_it_was_seen_from_only() {
        let mut map = VoxelMap::new(0.1);
        for x in -10..10 {
            for y in -10..10 {
                let color = Some(Rgb(RED));
                map.set_voxel(
                    VoxelKey { x, y, z: -1 },
                    Voxel {
                        color,
                        ..Voxel::new(LogOdds(70))
                    },
                );
                for z in 0..5 {
                    let free = Voxel::new(LogOdds(-40));
                    map.set_voxel(VoxelKey { x, y, z }, free);
                }
            }
        }
        let mut scene = Scene::default();
        scene.look.grid = false;
        scene.look.surfaces = Surfaces::Observed;
        scene.update_map(&map, &map.tile_ids());
        let scene = Arc::new(scene);
        let mut device = device();
        for lens in [Lens::Perspective, Lens::Parallel] {
            for (pitch_rad, is_shown) in [(1.2, true), (0.5, true), (-0.5, false), (-1.2, false)] {
                let frame = Frame {
                    scene: Arc::clone(&scene),
                    camera: Camera3::looking_at(Point::origin(), 0.7, pitch_rad, 5.0)
                        .with_lens(lens),
                    size_px: [123, 100],
                };
                let image = device.render(&frame).expect("a picture");
                let [r, ..] = image.pixel(61, 50).expect("inside");
                assert_eq!(r > 150, is_shown, "{pitch_rad} rad down, {lens:?}");
            }
        }
    }

    #[test]
    fn lines_and_vehicles_are_drawn_and_a_stale_vehicle_is_hollow() {
        let blue = [60, 120, 255];
        let mut scene = Scene::default();
        scene.look.grid = false;
        scene.lines.push(Polyline {
            points: vec![Point::new(-3.0, 2.0, 0.0), Point::new(3.0, 2.0, 0.0)],
            color: [0, 255, 0, 255],
            width_px: 4.0,
            stroke: Stroke::Solid,
        });
        scene.markers.push(Marker {
            kind: MarkerKind::Rover,
            world_from_body: Isometry::identity(),
            color: blue,
            length_m: 2.0,
            freshness: Freshness::Fresh,
            selected: false,
        });
        let mut device = device();
        let image = device
            .render(&from_above(scene.clone()))
            .expect("a picture");
        assert_eq!(
            image.pixel(61, 50 - 24),
            Some([0, 255, 0, 255]),
            "2 m to the north"
        );
        let [r, _, b, _] = image.pixel(55, 50).expect("inside");
        assert!(b > 150 && b > 2 * r, "the body of the rover");

        scene.markers[0].freshness = Freshness::Stale { radius_m: 0.0 };
        let image = device.render(&from_above(scene)).expect("a picture");
        assert_eq!(
            image.pixel(55, 50).expect("inside")[..3],
            Scene::default().look.background
        );
    }

    #[test]
    fn a_view_that_shows_the_frame_already_is_not_drawn_again() {
        let mut device = device();
        let frame = from_above(slab());
        assert!(device.renderer.draw(ViewId(7), &frame).is_some());
        assert!(device.renderer.draw(ViewId(7), &frame.clone()).is_none());
        let mut turned = frame.clone();
        turned.camera = turned.camera.orbited(Point::origin(), 0.1, 0.0);
        assert!(device.renderer.draw(ViewId(7), &turned).is_some());
        let mut with_grid = (*frame.scene).clone();
        with_grid.look.grid = true;
        let with_grid = Frame {
            scene: Arc::new(with_grid),
            ..turned
        };
        assert!(device.renderer.draw(ViewId(7), &with_grid).is_some());
        assert!(
            device.renderer.draw(ViewId(8), &with_grid).is_some(),
            "another view has its own picture"
        );
    }

    #[test]
    fn a_size_that_cannot_be_is_refused_with_the_one_that_can() {
        let mut device = device();
        for size_px in [[0, 10], [10, 1_000_000]] {
            let error = device
                .render(&Frame {
                    size_px,
                    ..from_above(slab())
                })
                .expect_err("no such picture");
            assert!(
                matches!(error, OffscreenError::Size { largest, .. } if largest >= 2048),
                "{error}"
            );
        }
    }

    #[test]
    fn a_picture_survives_being_a_png_file() {
        let image = device().render(&from_above(slab())).expect("a picture");
        let mut file = Vec::new();
        image.write_png(&mut file).expect("written");
        let mut reader = png::Decoder::new(std::io::Cursor::new(file))
            .read_info()
            .expect("a PNG file");
        let mut bytes = vec![0; reader.output_buffer_size().expect("it has a size")];
        reader.next_frame(&mut bytes).expect("a picture");
        assert_eq!(bytes, image.rgba);
    }
}
