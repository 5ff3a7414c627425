//! Pictures: JPEG and PNG files, and the raw pixels of ROS messages.
//!
//! Decoding is strict: a picture that is cut off or damaged is an error, never a half-grey picture that SLAM then tracks.

use std::borrow::Cow;
use std::io::Cursor;
use std::path::Path;

use maps::camera::Pinhole;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use crate::SourceError;

/// No camera of ours has more; refuses sizes that only a damaged header has.
pub(crate) const LARGEST_SIDE: usize = 16_384;

/// A picture file that starts like this is a PNG.
const PNG_MAGIC: &[u8] = b"\x89PNG";

/// Red, green and blue of a colour picture as large as the camera's.
pub(crate) fn decode_color(
    path: &Path,
    bytes: &[u8],
    camera: &Pinhole,
) -> Result<Vec<[u8; 3]>, SourceError> {
    if bytes.starts_with(PNG_MAGIC) {
        color_png(path, bytes, camera)
    } else {
        color_jpeg(path, bytes, camera)
    }
}

fn color_jpeg(path: &Path, bytes: &[u8], camera: &Pinhole) -> Result<Vec<[u8; 3]>, SourceError> {
    let damaged = |reason: String| SourceError::Jpeg {
        path: path.to_owned(),
        reason,
    };
    let options = DecoderOptions::new_fast()
        .set_strict_mode(true)
        .set_max_width(LARGEST_SIDE)
        .set_max_height(LARGEST_SIDE)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder
        .decode_headers()
        .map_err(|e| damaged(e.to_string()))?;
    let (width, height) = decoder.dimensions().unwrap_or_default();
    check_size(path, [width, height], camera)?;
    // The decoder fills what is missing at the end with grey; the end marker tells.
    if !ends_with_marker(bytes) {
        return Err(damaged("it ends before its end-of-image marker".into()));
    }
    let pixels = decoder.decode().map_err(|e| damaged(e.to_string()))?;
    Ok(pixels.as_chunks::<3>().0.to_vec())
}

/// Whether the last thing in a JPEG file is its end marker, apart from the zeros that some cameras append.
fn ends_with_marker(bytes: &[u8]) -> bool {
    let end = bytes
        .iter()
        .rposition(|&b| b != 0)
        .map_or(0, |last| last + 1);
    bytes[..end].ends_with(&[0xff, 0xd9])
}

fn color_png(path: &Path, bytes: &[u8], camera: &Pinhole) -> Result<Vec<[u8; 3]>, SourceError> {
    let picture = png(
        path,
        bytes,
        camera,
        png::Transformations::normalize_to_color8(),
    )?;
    let pixels = picture.pixels;
    match picture.color {
        png::ColorType::Rgb => Ok(pixels.as_chunks::<3>().0.to_vec()),
        png::ColorType::Rgba => {
            let (rgba, _) = pixels.as_chunks::<4>();
            Ok(rgba.iter().map(|&[r, g, b, _]| [r, g, b]).collect())
        }
        png::ColorType::Grayscale => Ok(pixels.iter().map(|&gray| [gray; 3]).collect()),
        png::ColorType::GrayscaleAlpha => {
            let (gray, _) = pixels.as_chunks::<2>();
            Ok(gray.iter().map(|&[gray, _]| [gray; 3]).collect())
        }
        png::ColorType::Indexed => Err(SourceError::Pixels {
            path: path.to_owned(),
            found: "indexed".into(),
            expected: "red, green and blue",
        }),
    }
}

/// Metres of a 16-bit PNG in which `factor` is 1 m; 0 and 65535 (saturated) are nothing seen.
pub(crate) fn decode_depth(
    path: &Path,
    bytes: &[u8],
    camera: &Pinhole,
    factor: f64,
) -> Result<Vec<f32>, SourceError> {
    let picture = png(path, bytes, camera, png::Transformations::IDENTITY)?;
    if (picture.color, picture.depth) != (png::ColorType::Grayscale, png::BitDepth::Sixteen) {
        return Err(SourceError::Pixels {
            path: path.to_owned(),
            found: format!("{:?} {:?}-bit", picture.color, picture.depth),
            expected: "16-bit grey (depth)",
        });
    }
    let (raw, _) = picture.pixels.as_chunks::<2>();
    let metres_per_unit = (1.0 / factor) as f32;
    Ok(raw
        .iter()
        .map(|&b| metres(u16::from_be_bytes(b), metres_per_unit))
        .collect())
}

fn metres(raw: u16, metres_per_unit: f32) -> f32 {
    if raw == u16::MAX {
        0.0
    } else {
        f32::from(raw) * metres_per_unit
    }
}

struct Png {
    pixels: Vec<u8>,
    color: png::ColorType,
    depth: png::BitDepth,
}

fn png(
    path: &Path,
    bytes: &[u8],
    camera: &Pinhole,
    transformations: png::Transformations,
) -> Result<Png, SourceError> {
    let damaged = |source| SourceError::Png {
        path: path.to_owned(),
        source,
    };
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(transformations);
    let mut reader = decoder.read_info().map_err(damaged)?;
    let info = reader.info();
    check_size(path, [info.width as usize, info.height as usize], camera)?;
    let (color, depth) = reader.output_color_type();
    // The size is the camera's by now, so this is small.
    let mut pixels = vec![0; reader.output_buffer_size().unwrap_or_default()];
    reader.next_frame(&mut pixels).map_err(damaged)?;
    reader.finish().map_err(damaged)?;
    Ok(Png {
        pixels,
        color,
        depth,
    })
}

fn check_size(path: &Path, found: [usize; 2], camera: &Pinhole) -> Result<(), SourceError> {
    let camera = [camera.width, camera.height];
    if found == camera {
        return Ok(());
    }
    Err(SourceError::Size {
        path: path.to_owned(),
        found,
        camera,
    })
}

/// The rows of raw pixels without the padding between them; `None` if they are too short.
fn packed(data: &[u8], row: usize, step: usize, height: usize) -> Option<Cow<'_, [u8]>> {
    if step == row || height <= 1 {
        return data.get(..row.checked_mul(height)?).map(Cow::Borrowed);
    }
    if step < row {
        return None;
    }
    let rows = (0..height).map(|y| data.get(y * step..y * step + row));
    rows.collect::<Option<Vec<_>>>()
        .map(|r| Cow::Owned(r.concat()))
}

/// Red, green and blue of the raw pixels of a ROS image; `None` if the encoding is not known or the data too short.
pub(crate) fn raw_color(image: &crate::ros::Image<'_>) -> Option<Vec<[u8; 3]>> {
    let bytes_per_pixel = match image.encoding {
        "rgb8" | "bgr8" | "8UC3" => 3,
        "rgba8" | "bgra8" => 4,
        "mono8" => 1,
        _ => return None,
    };
    let row = image.width as usize * bytes_per_pixel;
    let data = packed(image.data, row, image.step as usize, image.height as usize)?;
    Some(match image.encoding {
        "rgb8" => data.as_chunks::<3>().0.to_vec(),
        "rgba8" => data
            .as_chunks::<4>()
            .0
            .iter()
            .map(|&[r, g, b, _]| [r, g, b])
            .collect(),
        "bgra8" => data
            .as_chunks::<4>()
            .0
            .iter()
            .map(|&[b, g, r, _]| [r, g, b])
            .collect(),
        "mono8" => data.iter().map(|&gray| [gray; 3]).collect(),
        // OpenCV's order, for `8UC3` too.
        _ => data
            .as_chunks::<3>()
            .0
            .iter()
            .map(|&[b, g, r]| [r, g, b])
            .collect(),
    })
}

/// Metres of the raw pixels of a ROS depth image (REP-118); `None` if the encoding is not known or the data too short.
pub(crate) fn raw_depth(image: &crate::ros::Image<'_>) -> Option<Vec<f32>> {
    let [width, height, step] = [image.width, image.height, image.step].map(|n| n as usize);
    match image.encoding {
        "16UC1" | "mono16" => {
            let data = packed(image.data, width * 2, step, height)?;
            let (raw, _) = data.as_chunks::<2>();
            let value = |&b: &[u8; 2]| {
                if image.is_bigendian {
                    u16::from_be_bytes(b)
                } else {
                    u16::from_le_bytes(b)
                }
            };
            Some(raw.iter().map(|b| metres(value(b), 1e-3)).collect())
        }
        "32FC1" => {
            let data = packed(image.data, width * 4, step, height)?;
            let (raw, _) = data.as_chunks::<4>();
            let value = |&b: &[u8; 4]| {
                if image.is_bigendian {
                    f32::from_be_bytes(b)
                } else {
                    f32::from_le_bytes(b)
                }
            };
            let seen = |depth: f32| depth.is_finite() && depth > 0.0;
            Some(
                raw.iter()
                    .map(value)
                    .map(|d| if seen(d) { d } else { 0.0 })
                    .collect(),
            )
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::ros::Image;
    use maps::time::Stamp;

    fn camera(width: usize, height: usize) -> Pinhole {
        Pinhole {
            width,
            height,
            fx: 10.0,
            fy: 10.0,
            cx: 1.0,
            cy: 1.0,
            distortion: [0.0; 5],
        }
    }

    fn raw<'a>(encoding: &'a str, step: u32, is_bigendian: bool, data: &'a [u8]) -> Image<'a> {
        Image {
            at: Stamp::ZERO,
            frame_id: "",
            width: 2,
            height: 2,
            encoding,
            is_bigendian,
            step,
            data,
        }
    }

    /// A 16 x 8 picture, quality 90: dark green on the left, orange on the right. Made with `ImageMagick`.
    const JPEG: &[u8] = include_bytes!("../tests/data/two-colors.jpg");

    #[test]
    fn a_jpeg_is_decoded_to_its_colors() {
        let pixels = decode_color(Path::new("a.jpg"), JPEG, &camera(16, 8)).expect("a sound file");
        assert_eq!(pixels.len(), 16 * 8);
        // JPEG at quality 90 keeps flat colours to within a few steps.
        for (pixel, expected) in [(pixels[1], [0, 100, 0]), (pixels[14], [255, 165, 0])] {
            for (channel, expected) in pixel.iter().zip(expected) {
                assert!(i32::from(*channel).abs_diff(expected) <= 6, "{pixel:?}");
            }
        }
    }

    #[test]
    fn a_jpeg_cut_off_anywhere_is_an_error() {
        for length in 0..JPEG.len() {
            let outcome = decode_color(Path::new("a.jpg"), &JPEG[..length], &camera(16, 8));
            let error = outcome.expect_err("cut off").to_string();
            assert!(error.contains("a.jpg"), "{length} bytes: {error}");
        }
    }

    fn depth_png(values: &[u16], width: u32) -> Vec<u8> {
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, width, values.len() as u32 / width);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_depth(png::BitDepth::Sixteen);
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_be_bytes()).collect();
        let mut writer = encoder.write_header().expect("header");
        writer.write_image_data(&bytes).expect("data");
        writer.finish().expect("end");
        file
    }

    #[test]
    fn depth_is_divided_by_the_factor_and_saturated_depth_is_nothing() {
        let file = depth_png(&[0, 5000, 12_500, u16::MAX], 2);
        let depth = decode_depth(Path::new("d.png"), &file, &camera(2, 2), 5000.0).expect("sound");
        for (found, expected) in depth.iter().zip([0.0, 1.0, 2.5, 0.0]) {
            assert!((found - expected).abs() < 1e-6, "{depth:?}");
        }
    }

    #[test]
    fn a_png_cut_off_anywhere_is_an_error() {
        let file = depth_png(&[1, 2, 3, 4], 2);
        for length in 0..file.len() {
            let outcome = decode_depth(Path::new("d.png"), &file[..length], &camera(2, 2), 5000.0);
            assert!(outcome.is_err(), "{length} bytes");
        }
    }

    #[test]
    fn a_picture_of_another_size_names_both_sizes() {
        let file = depth_png(&[1, 2, 3, 4], 2);
        let error = decode_depth(Path::new("d.png"), &file, &camera(640, 480), 5000.0);
        let text = error.expect_err("too small").to_string();
        assert!(
            text.contains("2 x 2") && text.contains("640 x 480"),
            "{text}"
        );
    }

    #[test]
    fn rows_may_be_padded_and_channels_in_any_order() {
        let padded = [1, 2, 3, 4, 5, 6, 0, 0, 7, 8, 9, 10, 11, 12, 0, 0];
        assert_eq!(
            raw_color(&raw("bgr8", 8, false, &padded)),
            Some(vec![[3, 2, 1], [6, 5, 4], [9, 8, 7], [12, 11, 10]])
        );
        assert_eq!(
            raw_color(&raw("rgb8", 5, false, &padded)),
            None,
            "step too short"
        );
        assert_eq!(
            raw_color(&raw("rgb8", 8, false, &padded[..13])),
            None,
            "cut off"
        );
        assert_eq!(
            raw_color(&raw("yuv422", 8, false, &padded)),
            None,
            "unknown"
        );
        let millimetres = [0, 0, 0xe8, 3, 0xff, 0xff, 1, 0];
        assert_eq!(
            raw_depth(&raw("16UC1", 4, false, &millimetres)),
            Some(vec![0.0, 1.0, 0.0, 1e-3])
        );
        let metres: Vec<u8> = [f32::NAN, -1.0, 1.5, f32::INFINITY]
            .iter()
            .flat_map(|d| d.to_be_bytes())
            .collect();
        assert_eq!(
            raw_depth(&raw("32FC1", 8, true, &metres)),
            Some(vec![0.0, 0.0, 1.5, 0.0])
        );
    }

    proptest! {
        #[test]
        fn any_bytes_are_a_picture_or_an_error(bytes: Vec<u8>, magic in 0..3, flip in 0..400_usize) {
            let mut file = match magic {
                0 => bytes,
                1 => { let mut file = JPEG.to_vec(); file.splice(flip.min(JPEG.len()).., bytes); file }
                _ => { let mut file = depth_png(&[1, 2, 3, 4], 2); let end = flip.min(file.len()); file.splice(end.., bytes); file }
            };
            if let Some(byte) = file.get_mut(flip) {
                *byte ^= 0x55;
            }
            let _outcomes = (
                decode_color(Path::new("a"), &file, &camera(16, 8)).is_ok(),
                decode_depth(Path::new("a"), &file, &camera(2, 2), 5000.0).is_ok(),
            );
        }

        #[test]
        fn any_raw_pixels_are_a_picture_or_none(width: u32, height: u32, step: u32, data: Vec<u8>, encoding in 0..4_usize) {
            let encoding = ["rgb8", "bgra8", "16UC1", "32FC1"][encoding];
            let image = Image { at: Stamp::ZERO, frame_id: "", width, height, encoding, is_bigendian: false, step, data: &data };
            let _outcomes = (raw_color(&image).is_some(), raw_depth(&image).is_some());
        }
    }
}
