//! Files in memory: their names and bytes, in formats that need no program of ours to be read.

use std::fmt::Write as _;

use png::{BitDepth, ColorType, EncodingError};
use rayon::prelude::*;

/// A file of a sequence that is yet to be written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct File {
    /// Within the folder of the sequence, with `/` between parts.
    pub(super) name: String,
    pub(super) bytes: Vec<u8>,
}

/// A picture that is yet to be encoded.
pub(super) enum Image<'a> {
    /// Red, green and blue.
    Rgb(&'a [[u8; 3]]),
    /// One byte a pixel.
    Grey(Vec<u8>),
    /// Two bytes a pixel.
    Grey16(Vec<u16>),
}

/// A picture with its name and width.
pub(super) struct Png<'a> {
    pub(super) name: String,
    pub(super) width: usize,
    pub(super) image: Image<'a>,
}

/// Encodes pictures, side by side where there are threads.
pub(super) fn encode(pictures: &[Png<'_>]) -> Result<Vec<File>, EncodingError> {
    pictures.par_iter().map(Png::encode).collect()
}

impl Png<'_> {
    fn encode(&self) -> Result<File, EncodingError> {
        let (colour, depth, pixels) = match &self.image {
            Image::Rgb(pixels) => (ColorType::Rgb, BitDepth::Eight, pixels.len()),
            Image::Grey(pixels) => (ColorType::Grayscale, BitDepth::Eight, pixels.len()),
            Image::Grey16(pixels) => (ColorType::Grayscale, BitDepth::Sixteen, pixels.len()),
        };
        let size = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        let height = pixels / self.width.max(1);
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, size(self.width), size(height));
        encoder.set_color(colour);
        encoder.set_depth(depth);
        let mut writer = encoder.write_header()?;
        match &self.image {
            Image::Rgb(pixels) => writer.write_image_data(pixels.as_flattened())?,
            Image::Grey(pixels) => writer.write_image_data(pixels)?,
            Image::Grey16(pixels) => {
                let bytes: Vec<u8> = pixels
                    .iter()
                    .flat_map(|level| level.to_be_bytes())
                    .collect();
                writer.write_image_data(&bytes)?;
            }
        }
        writer.finish()?;
        Ok(File {
            name: self.name.clone(),
            bytes,
        })
    }
}

/// A point cloud as `Open3D` writes it: `x y z rgb` in single precision, binary. `Open3D` keeps no intensity, so that OPV2V
/// has it as red.
pub(super) fn pcd(name: String, points: impl ExactSizeIterator<Item = ([f32; 3], u8)>) -> File {
    let count = points.len();
    let mut header = String::new();
    // Writing to a string cannot fail.
    let _written = write!(
        header,
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\n\
         COUNT 1 1 1 1\nWIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n"
    );
    let mut bytes = header.into_bytes();
    bytes.reserve(16 * count);
    for (point, intensity) in points {
        for c in point {
            bytes.extend(c.to_le_bytes());
        }
        bytes.extend((u32::from(intensity) << 16).to_le_bytes());
    }
    File { name, bytes }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_read_back_as_what_they_were() {
        let depths = vec![0, 1, 256, 65_535, 40_000, 7];
        let classes = vec![0, 16, 255, 3];
        let colours = [[1, 2, 3], [250, 251, 252]];
        let pictures = [
            Png {
                name: "depth.png".into(),
                width: 3,
                image: Image::Grey16(depths.clone()),
            },
            Png {
                name: "class.png".into(),
                width: 2,
                image: Image::Grey(classes.clone()),
            },
            Png {
                name: "colour.png".into(),
                width: 1,
                image: Image::Rgb(&colours),
            },
        ];
        let files = encode(&pictures).expect("small pictures");
        let pixels = |file: &File| {
            let decoder = png::Decoder::new(std::io::Cursor::new(&file.bytes));
            let mut reader = decoder.read_info().expect("a picture");
            let mut pixels = vec![0; reader.output_buffer_size().expect("small")];
            reader.next_frame(&mut pixels).expect("pixels");
            pixels
        };
        let wide: Vec<u8> = depths.iter().flat_map(|d: &u16| d.to_be_bytes()).collect();
        assert_eq!(pixels(&files[0]), wide);
        assert_eq!(pixels(&files[1]), classes);
        assert_eq!(pixels(&files[2]), colours.as_flattened());
    }

    #[test]
    fn a_point_cloud_has_as_many_points_as_its_header_says() {
        let file = pcd(
            "a.pcd".into(),
            [([1.0, -2.0, 0.5], 255), ([0.0; 3], 1)].into_iter(),
        );
        let text = String::from_utf8_lossy(&file.bytes);
        assert!(text.contains("POINTS 2\n"), "{text}");
        let start = text.find("DATA binary\n").expect("a header") + "DATA binary\n".len();
        let data = &file.bytes[start..];
        assert_eq!(data.len(), 32);
        assert_eq!(data[4..8], (-2.0_f32).to_le_bytes());
        assert_eq!(data[12..16], [0, 0, 255, 0], "blue, green, red, nothing");
    }
}
