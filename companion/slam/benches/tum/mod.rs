//! Recordings in the TUM layout: `associations.txt` and the images it names.

use std::error::Error;
use std::fs::{self, File};
use std::io::{BufReader, Cursor};
use std::path::{Path, PathBuf};

use maps::camera::{Pinhole, RgbdFrame};
use maps::time::Stamp;

type Result<T> = std::result::Result<T, Box<dyn Error + Send + Sync>>;

/// The camera of the Bonn dynamic dataset.
pub(crate) const BONN: Pinhole = Pinhole {
    width: 640,
    height: 480,
    fx: 542.822_841,
    fy: 542.576_870,
    cx: 315.593_520,
    cy: 237.756_098,
    distortion: [0.039_903, -0.099_343, -0.000_730, -0.000_144, 0.0],
};

/// Of the recordings of TUM and Bonn, the value of a depth pixel at 1 m.
pub(crate) const DEPTH_FACTOR: f32 = 5000.0;

/// The frames, decoded one after the other.
pub(crate) fn frames(
    folder: &Path,
    depth_factor: f32,
) -> Result<impl Iterator<Item = Result<RgbdFrame>> + Send + 'static> {
    let list = fs::read_to_string(folder.join("associations.txt"))?;
    let lines: Vec<String> = list.lines().map(str::to_owned).collect();
    let folder: PathBuf = folder.to_owned();
    Ok(lines
        .into_iter()
        .map(move |line| read_frame(&folder, &line, depth_factor)))
}

fn read_frame(folder: &Path, line: &str, depth_factor: f32) -> Result<RgbdFrame> {
    let fields: Vec<&str> = line.split_whitespace().collect();
    let [stamp, rgb, _, depth] = fields[..] else {
        return Err(format!("not an association: {line}").into());
    };
    let (pixels, width, height) = if Path::new(rgb).extension().is_some_and(|e| e == "png") {
        read_png(&folder.join(rgb))?
    } else {
        let mut decoder = zune_jpeg::JpegDecoder::new(Cursor::new(fs::read(folder.join(rgb))?));
        let pixels = decoder.decode().map_err(|e| format!("{rgb}: {e}"))?;
        let (width, height) = decoder.dimensions().ok_or("no size")?;
        (pixels, width, height)
    };
    let (raw, ..) = read_png(&folder.join(depth))?;
    Ok(RgbdFrame {
        at: Stamp::from_secs_f64(stamp.parse()?).ok_or("bad stamp")?,
        width,
        height,
        rgb: pixels.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect(),
        depth_m: raw
            .chunks_exact(2)
            .map(|b| f32::from(u16::from_be_bytes([b[0], b[1]])) / depth_factor)
            .collect(),
    })
}

/// Bytes, width and height.
fn read_png(path: &Path) -> Result<(Vec<u8>, usize, usize)> {
    let mut png = png::Decoder::new(BufReader::new(File::open(path)?)).read_info()?;
    let mut raw = vec![0; png.output_buffer_size().ok_or("too large")?];
    let info = png.next_frame(&mut raw)?;
    Ok((raw, info.width as usize, info.height as usize))
}
