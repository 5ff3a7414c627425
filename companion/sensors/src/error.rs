//! Why a recording cannot be used, and what to do about it.

use std::io;
use std::path::PathBuf;

use maps::trajectory::tum::TumError;

use crate::cdr::CdrError;
use crate::zenoh::ZenohError;

/// Why a source has no (more) frames to give. Each message names the file and, where there is one, the remedy.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// A file or folder that cannot be opened or read.
    #[error("cannot read {}: check the path and its permissions", path.display())]
    Read {
        /// What was to be read.
        path: PathBuf,
        /// What the operating system says.
        source: io::Error,
    },
    /// A text file far larger than any list of images.
    #[error("{} is larger than {limit} bytes: it is no list of images or poses", path.display())]
    TooLong {
        /// The file.
        path: PathBuf,
        /// The largest length that is read.
        limit: u64,
    },
    /// A line that is not what the format says.
    #[error("line {line} of {} is not `{expected}`: correct or remove it", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// What a line should look like.
        expected: &'static str,
    },
    /// True poses that are none.
    #[error("cannot understand {}: correct or remove it", path.display())]
    Truth {
        /// The file.
        path: PathBuf,
        /// Which line, and why.
        source: TumError,
    },
    /// No colour image has a depth image taken at the same time.
    #[error(
        "none of the {colors} colour and {depths} depth images listed in {} were taken within {window_ms} ms of each \
         other: check the time stamps in rgb.txt and depth.txt",
        path.display()
    )]
    NoPairs {
        /// The folder.
        path: PathBuf,
        /// Colour images listed.
        colors: usize,
        /// Depth images listed.
        depths: usize,
        /// How far apart the two images of a frame may be.
        window_ms: u128,
    },
    /// Images that are listed and not there.
    #[error(
        "{} is listed but missing, as are {others} more of {listed} images: complete the folder, or set \
         `missing_images = \"skip\"` in [source] of the configuration to leave their frames out",
        path.display()
    )]
    MissingImages {
        /// The first of them.
        path: PathBuf,
        /// How many more are missing.
        others: usize,
        /// How many are listed.
        listed: usize,
    },
    /// A JPEG file that cannot be decoded from its first to its last byte.
    #[error("{} is damaged: copy it again from the original ({reason})", path.display())]
    Jpeg {
        /// The file.
        path: PathBuf,
        /// What the decoder says.
        reason: String,
    },
    /// A PNG file that cannot be decoded from its first to its last byte.
    #[error("{} is damaged: copy it again from the original", path.display())]
    Png {
        /// The file.
        path: PathBuf,
        /// What the decoder says.
        source: png::DecodingError,
    },
    /// An image whose pixels are of another kind.
    #[error("{} has {found} pixels, expected {expected}", path.display())]
    Pixels {
        /// The file.
        path: PathBuf,
        /// What they are.
        found: String,
        /// What they should be.
        expected: &'static str,
    },
    /// An image that was not taken by the configured camera.
    #[error(
        "{} is {} x {} pixels, the camera is {} x {}: correct the camera's width and height, or the recording",
        path.display(), found[0], found[1], camera[0], camera[1]
    )]
    Size {
        /// The file.
        path: PathBuf,
        /// Width and height of the image.
        found: [usize; 2],
        /// Width and height of the camera.
        camera: [usize; 2],
    },
    /// A camera that cannot be.
    #[error("{}: the camera is not usable: {reason}", path.display())]
    Camera {
        /// Where it was read, or the recording it is for.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// An MCAP file that is damaged or was not closed.
    #[error(
        "{} is damaged after {frames} frames: `mcap recover` saves what is left, or record it again",
        path.display()
    )]
    Mcap {
        /// The file.
        path: PathBuf,
        /// Frames before the damage.
        frames: usize,
        /// What the reader says.
        source: mcap::McapError,
    },
    /// A file that is something else.
    #[error("{} is no MCAP file: give a folder in TUM layout or an MCAP file", path.display())]
    NotMcap {
        /// The file.
        path: PathBuf,
    },
    /// A folder that is something else.
    #[error("{} is no recording in the TUM layout: it has no rgb.txt and no associations.txt", path.display())]
    NotTum {
        /// The folder.
        path: PathBuf,
    },
    /// A file in which too many images come before their partners.
    #[error(
        "{} has more than {most} colour or depth images before their partners: `mcap sort` puts them in order",
        path.display()
    )]
    Order {
        /// The file.
        path: PathBuf,
        /// How many may wait.
        most: usize,
    },
    /// A message in an MCAP file that is not of the type its channel says.
    #[error("a message on {topic} in {} is damaged", path.display())]
    Message {
        /// The file.
        path: PathBuf,
        /// The channel.
        topic: String,
        /// What is wrong with it.
        source: CdrError,
    },
    /// A channel that is needed and not there.
    #[error("{} has nothing on {topic}, only {present:?}: set the source's topics to those of the recording", path.display())]
    Topic {
        /// The file.
        path: PathBuf,
        /// The channel.
        topic: String,
        /// The channels that are there.
        present: Vec<String>,
    },
    /// A channel that carries something else.
    #[error("{topic} in {} carries {found}, expected {expected}", path.display())]
    Kind {
        /// The file.
        path: PathBuf,
        /// The channel.
        topic: String,
        /// The type or encoding it has.
        found: String,
        /// What it should have.
        expected: &'static str,
    },
    /// Live messages that cannot be received.
    #[error(transparent)]
    Zenoh(#[from] ZenohError),
    /// A live camera from which nothing comes.
    #[error("nothing to be used on {topic} for {seconds} s, over Zenoh at {endpoint}: {why}")]
    Silent {
        /// Where it is.
        endpoint: String,
        /// What is missing.
        topic: String,
        /// How long it was waited for.
        seconds: f64,
        /// Why, as far as can be told.
        why: Silence,
    },
}

/// Why nothing comes from a live camera.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Silence {
    /// Nobody is at the other end.
    #[error(
        "no router is there, so start it (`ros2 run rmw_zenoh_cpp rmw_zenohd`), or correct the endpoint"
    )]
    Unconnected,
    /// Nobody publishes there, or not any more.
    #[error(
        "nobody publishes there: start the camera's driver, or set the source's topics to those of the driver"
    )]
    Unpublished,
    /// Somebody publishes there and says nothing.
    #[error(
        "its publisher {node} is there and sends nothing: look at the camera and at the network between"
    )]
    Mute {
        /// The publisher's node.
        node: String,
    },
    /// What comes is older than what came before.
    #[error("its time stamps have gone back, as after a restart of the driver: start again")]
    BackInTime,
    /// Colour and depth come, but not together.
    #[error(
        "colour and depth come, but none within {window_ms} ms of each other: check the driver's time stamps"
    )]
    Apart {
        /// How far apart the two images of a frame may be.
        window_ms: u128,
    },
}
