//! `companion map`: what is asked of map files.

#![expect(
    clippy::doc_markdown,
    reason = "these comments are the program's help, not Markdown"
)]

use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::{Subcommand, ValueEnum};
use companion::clock::since_1970;
use companion::map::conflict::{CONTRADICTION, Conflict};
use companion::map::files::{self, OpenedMap};
use companion::map::info::{Info, Tiles};
use companion::map::stored::{self, Imported};
use companion::map::{MapError, drawing};
use maps::picture::{Measure, Paint, Request};
use maps::time::Stamp;
use maps::voxel::VoxelMap;
use octomap::{Colors, Content, Pruning, ReadOptions, Shape};
use store::AsOf;

#[derive(Subcommand)]
pub(crate) enum MapCommand {
    /// Says what is in a map file: resolution, bounds, counts, digest.
    Info {
        /// OctoMap file (.ot, .bt) or tile store.
        file: PathBuf,
        /// Lists the tiles, a line each.
        #[arg(long)]
        tiles: bool,
        #[command(flatten)]
        reading: Reading,
    },
    /// Draws a map from above and from aside into a PNG file.
    Render {
        /// OctoMap file (.ot, .bt) or tile store.
        file: PathBuf,
        /// The picture, a PNG file.
        #[arg(long, value_name = "PNG")]
        out: PathBuf,
        /// What colours tell.
        #[arg(long, value_enum, default_value = "height")]
        by: By,
        /// The map that is compared, for --by conflict: where one says occupied and the other free.
        #[arg(long, value_name = "FILE")]
        against: Option<PathBuf>,
        /// Pixels, 480x480 to 8192x8192.
        #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "1600x1000", value_parser = size)]
        size: [usize; 2],
        /// Leaves out what is higher above the origin, to look into a building.
        #[arg(long, value_parser = finite, allow_negative_numbers = true)]
        ceiling_m: Option<f64>,
        #[command(flatten)]
        reading: Reading,
    },
    /// Puts a map into a tile store as the newest version of its tiles; the store is made if there is none.
    Import {
        /// OctoMap file (.ot, .bt) or tile store.
        file: PathBuf,
        /// The tile store.
        store: PathBuf,
        #[command(flatten)]
        reading: Reading,
    },
    /// Writes a map as an OctoMap file, .ot or .bt by its name.
    Export {
        /// The map.
        file: PathBuf,
        /// The OctoMap file to write.
        to: PathBuf,
        /// What a .ot file tells beside occupancy.
        #[arg(long, value_enum, default_value = "occupancy")]
        keep: Keep,
        /// Writes every voxel as a leaf, even where eight are alike.
        #[arg(long)]
        unpruned: bool,
        /// Cuts off so many levels: the least leaf is 2 to this power voxels wide.
        #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=15))]
        cut_levels: u32,
        #[command(flatten)]
        reading: Reading,
    },
}

#[derive(clap::Args)]
pub(crate) struct Reading {
    /// Takes the colours of an OctoMap file for those of classes, by the palette that export writes.
    #[arg(long)]
    classes: bool,
    /// Reads so many levels coarser: each doubles the edge of a voxel.
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=15))]
    coarser: u32,
    /// Refuses a map that would take more memory.
    #[arg(long, default_value_t = 2048)]
    most_mib: u64,
    /// Reads a tile store as it was so many seconds after 1970.
    #[arg(long, value_name = "SECONDS", value_parser = moment)]
    at: Option<Stamp>,
}

#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum By {
    /// How high it is.
    Height,
    /// What it is, by the palette.
    Class,
    /// As a camera saw it.
    Color,
    /// How much it contradicts the map given with --against, from 0 to 1.
    Conflict,
}

#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum Keep {
    /// Nothing: an OcTree.
    Occupancy,
    /// What a camera saw: a ColorOcTree.
    Color,
    /// The palette's colour of each class: a ColorOcTree.
    Class,
}

impl MapCommand {
    /// Does it.
    pub(crate) fn run(self) -> Result<()> {
        match self {
            Self::Info {
                file,
                tiles,
                reading,
            } => {
                let tiles = if tiles { Tiles::Listed } else { Tiles::Counted };
                let opened = reading.open(&file)?;
                write!(io::stdout(), "{}", Info::new(&opened, tiles))?;
            }
            Self::Render {
                file,
                out,
                by,
                against,
                size: [width, height],
                ceiling_m,
                reading,
            } => {
                let opened = reading.open(&file)?;
                let request = Request {
                    paint: Paint::Height,
                    title: &name_of(&file),
                    width,
                    height,
                    ceiling_m,
                };
                let paint = match (by, against) {
                    (By::Conflict, Some(other)) => {
                        let against = reading.open(&other)?.map;
                        return draw_conflict(
                            &opened.map,
                            (&file, &other),
                            &against,
                            &request,
                            &out,
                        );
                    }
                    (By::Conflict, None) => {
                        bail!("--by conflict needs a map to compare: give one with --against")
                    }
                    (_, Some(_)) => bail!("--against is for --by conflict only"),
                    (By::Height, None) => Paint::Height,
                    (By::Class, None) => Paint::Class,
                    (By::Color, None) => Paint::Color,
                };
                drawing::draw(&opened.map, &file, &Request { paint, ..request }, &out)?;
            }
            Self::Import {
                file,
                store,
                reading,
            } => {
                import(&reading.open(&file)?.map, &store)?;
            }
            Self::Export {
                file,
                to,
                keep,
                unpruned,
                cut_levels,
                reading,
            } => {
                let opened = reading.open(&file)?;
                let pruning = if unpruned {
                    Pruning::Nothing
                } else {
                    Pruning::EqualLeaves
                };
                let shape = Shape {
                    pruning,
                    cut_levels,
                };
                files::save_octomap(&opened.map, &to, keep.into(), shape)?;
            }
        }
        Ok(())
    }
}

impl Reading {
    fn open(&self, file: &Path) -> Result<OpenedMap, MapError> {
        let colors = if self.classes {
            Colors::Classes
        } else {
            Colors::Surface
        };
        let options = ReadOptions {
            coarser: self.coarser,
            colors,
            most_bytes: self.most_mib.saturating_mul(1 << 20),
        };
        let as_of = self.at.map_or(AsOf::Newest, AsOf::Time);
        files::open(file, &options, as_of)
    }
}

fn import(map: &VoxelMap, store: &Path) -> Result<()> {
    let Imported { changed, same } = stored::import(map, store, since_1970())?;
    writeln!(
        io::stdout(),
        "{changed} tiles are new or changed in {}, {same} were there like that",
        store.display()
    )?;
    Ok(())
}

fn draw_conflict(
    map: &VoxelMap,
    (file, other): (&Path, &Path),
    against: &VoxelMap,
    request: &Request<'_>,
    out: &Path,
) -> Result<()> {
    let conflict = Conflict::new(map, (against, other))?;
    // Two maps often have the same name, in different folders.
    let title = format!("{} against {}", file.display(), other.display());
    let measure = Measure {
        name: "conflict K",
        low: 0.0,
        high: 1.0,
        of: &|key| conflict.at(key),
    };
    let request = Request {
        paint: Paint::Measure(measure),
        title: &title,
        ..*request
    };
    drawing::draw(&conflict.both(), file, &request, out)?;
    let (both, contradicting) = conflict.count();
    writeln!(
        io::stdout(),
        "of {both} voxels that both know, {contradicting} contradict each other (K of at least {CONTRADICTION})"
    )?;
    Ok(())
}

impl From<Keep> for Content {
    fn from(keep: Keep) -> Self {
        match keep {
            Keep::Occupancy => Self::Occupancy,
            Keep::Color => Self::Color,
            Keep::Class => Self::Class,
        }
    }
}

fn name_of(file: &Path) -> String {
    let name = file.file_name().unwrap_or(file.as_os_str());
    name.to_string_lossy().into_owned()
}

fn size(text: &str) -> Result<[usize; 2], String> {
    let parse = |text: &str| text.parse().ok().filter(|n| Request::SIZE.contains(n));
    let sides = text.split_once('x');
    let size = sides.and_then(|(width, height)| Some([parse(width)?, parse(height)?]));
    size.ok_or_else(|| "expected as 1600x1000, each side 480 to 8192".to_owned())
}

fn finite(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|m: &f64| m.is_finite());
    value.ok_or_else(|| "expected a number of metres".to_owned())
}

fn moment(text: &str) -> Result<Stamp, String> {
    let seconds = text.parse().ok().and_then(Stamp::from_secs_f64);
    seconds.ok_or_else(|| "expected seconds after 1970".to_owned())
}
