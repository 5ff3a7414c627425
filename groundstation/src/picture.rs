//! Pictures of the window, as PNG files.

use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

/// Red, green, blue and opacity of each pixel, row by row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `4 * width * height` bytes.
    pub rgba: Vec<u8>,
}

/// Why a picture could not be written.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The file cannot be made.
    #[error("cannot create {}: {source}", path.display())]
    Create {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The pixels cannot be written.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: png::EncodingError,
    },
}

impl Picture {
    /// What egui took of its window.
    pub fn from_egui(image: &egui::ColorImage) -> Self {
        Self {
            width: image.size[0] as u32,
            height: image.size[1] as u32,
            rgba: image
                .pixels
                .iter()
                .flat_map(|pixel| [pixel.r(), pixel.g(), pixel.b(), 255])
                .collect(),
        }
    }

    /// Writes it, and the folder it belongs into.
    pub fn write(&self, path: &Path) -> Result<(), PictureError> {
        let create = |source| PictureError::Create {
            path: path.to_owned(),
            source,
        };
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(create)?;
        }
        let file = BufWriter::new(File::create(path).map_err(create)?);
        let mut encoder = png::Encoder::new(file, self.width, self.height);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(png::BitDepth::Eight);
        let write = |source| PictureError::Write {
            path: path.to_owned(),
            source,
        };
        let mut writer = encoder.write_header().map_err(write)?;
        writer.write_image_data(&self.rgba).map_err(write)?;
        writer.finish().map_err(write)
    }
}
