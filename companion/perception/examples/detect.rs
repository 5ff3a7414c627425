//! Writes what a detector sees in a recording in TUM layout, one object a line.
//!
//! ```text
//! cargo run --release -p perception --example detect -- yolox|fastest-det WEIGHTS FOLDER [--every N] > OBJECTS
//! ```
//!
//! A line is `stamp left top right bottom score mobility class`: seconds, pixels, 0 to 1, `static`, `movable`, `moving`
//! or `unknown`, and COCO's name of the class. Before the objects of an image stands a line with its stamp alone, so that
//! one in which there is nothing is known from one that was not looked at. `--every 3` looks at every third image.

use std::error::Error;
use std::fs;
use std::io::{BufWriter, Write};
use std::path::Path;

use maps::evidence::Mobility;
use perception::{Detector, FastestDet, Image, Yolox};

/// Objects less sure are not written; the scores of `FastestDet`, geometric means, are higher.
const LEAST_SCORE_YOLOX: f32 = 0.3;
const LEAST_SCORE_FASTEST_DET: f32 = 0.65;
const THREADS: usize = 2;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (kind, weights, folder, every) = match &arguments[..] {
        [kind, weights, folder] => (kind, weights, folder, 1),
        [kind, weights, folder, flag, every] if flag == "--every" => {
            (kind, weights, folder, every.parse()?)
        }
        _ => return Err("which of yolox and fastest-det, which weights, which folder?".into()),
    };
    let weights = Path::new(weights);
    let detector: Box<dyn Detector> = match kind.as_str() {
        "yolox" => Box::new(Yolox::open(weights, LEAST_SCORE_YOLOX, THREADS)?),
        "fastest-det" => Box::new(FastestDet::open(weights, LEAST_SCORE_FASTEST_DET, THREADS)?),
        other => return Err(format!("unknown detector {other}").into()),
    };
    let folder = Path::new(folder);
    let mut out = BufWriter::new(std::io::stdout().lock());
    let list = fs::read_to_string(folder.join("associations.txt"))?;
    for line in list.lines().step_by(every) {
        let mut fields = line.split_whitespace();
        let (Some(stamp), Some(file)) = (fields.next(), fields.next()) else {
            return Err(format!("not an association: {line}").into());
        };
        look(&mut out, detector.as_ref(), (stamp, &folder.join(file)))?;
    }
    out.flush()?;
    Ok(())
}

fn look(
    out: &mut impl Write,
    detector: &dyn Detector,
    (stamp, file): (&str, &Path),
) -> Result<(), Box<dyn Error>> {
    let mut decoder = zune_jpeg::JpegDecoder::new(std::io::Cursor::new(fs::read(file)?));
    let bytes = decoder.decode().map_err(|e| e.to_string())?;
    let (width, height) = decoder.dimensions().ok_or("an image without a size")?;
    let (pixels, _) = bytes.as_chunks::<3>();
    writeln!(out, "{stamp}")?;
    for found in detector.detect(&Image::new(width, height, pixels)?)? {
        let [left, top, right, bottom] = found.bounds_px;
        let mobility = match found.class.mobility() {
            Mobility::Static => "static",
            Mobility::Movable => "movable",
            Mobility::Moving => "moving",
            Mobility::Unknown => "unknown",
        };
        let (score, class) = (found.score, found.class);
        writeln!(
            out,
            "{stamp} {left:.1} {top:.1} {right:.1} {bottom:.1} {score:.3} {mobility} {class}"
        )?;
    }
    Ok(())
}
