//! Writes an RGB-D recording.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use ::mcap::records::{MessageHeader, Metadata};
use ::mcap::{McapError, WriteOptions};
use maps::camera::{Pinhole, RgbdFrame};
use maps::frame::{Camera, Isometry, World};
use maps::time::Stamp;

use super::Topics;
use crate::message::{self, Message};
use crate::ros::{self, Schema};

/// Why a recording cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: check the folder, its permissions and the free space", path.display())]
pub struct WriteError {
    /// The file.
    pub path: PathBuf,
    /// What the container's writer says.
    pub source: McapError,
}

/// Writes one camera's frames and true poses to a file, uncompressed. What was written before a crash can be read;
/// [`Writer::finish`] adds the index by which viewers seek.
pub struct Writer {
    path: PathBuf,
    topics: Topics,
    file: ::mcap::Writer<BufWriter<File>>,
    color: Channel,
    depth: Channel,
    camera_info: Channel,
    truth: Channel,
}

struct Channel {
    id: u16,
    sequence: u32,
}

impl Writer {
    /// Starts a file, replacing one that is there.
    pub fn create(path: &Path, topics: &Topics) -> Result<Self, WriteError> {
        let error = |source| WriteError {
            path: path.to_owned(),
            source,
        };
        let file = File::create(path).map_err(|e| error(e.into()))?;
        let options = WriteOptions::new().profile("ros2").compression(None);
        let mut file = options.create(BufWriter::new(file)).map_err(error)?;
        let mut channel = |topic: &str, schema: &Schema| -> Result<Channel, McapError> {
            let schema = file.add_schema(schema.name, "ros2msg", schema.text.as_bytes())?;
            let id = file.add_channel(schema, topic, "cdr", &BTreeMap::new())?;
            Ok(Channel { id, sequence: 0 })
        };
        let color = channel(&topics.color, &ros::IMAGE).map_err(error)?;
        let depth = channel(&topics.depth, &ros::IMAGE).map_err(error)?;
        let camera_info = channel(&topics.camera_info, &ros::CAMERA_INFO).map_err(error)?;
        let truth = channel(&topics.truth, &ros::POSE_STAMPED).map_err(error)?;
        Ok(Self {
            path: path.to_owned(),
            topics: topics.clone(),
            file,
            color,
            depth,
            camera_info,
            truth,
        })
    }

    /// Notes what the recording is, such as the scene and the seed it was made from.
    pub fn describe(
        &mut self,
        name: &str,
        values: BTreeMap<String, String>,
    ) -> Result<(), WriteError> {
        let metadata = Metadata {
            name: name.to_owned(),
            metadata: values,
        };
        let outcome = self.file.write_metadata(&metadata);
        self.checked(outcome)
    }

    /// Appends the camera. A reader needs it once; players that seek need it now and then.
    pub fn camera(&mut self, at: Stamp, camera: &Pinhole) -> Result<(), WriteError> {
        let message = message::camera(&self.topics, at, camera);
        let outcome = write(&mut self.file, &mut self.camera_info, &message);
        self.checked(outcome)
    }

    /// Appends a frame: colour as `rgb8`, depth as `16UC1`, which is to the millimetre and up to 65.5 m.
    pub fn frame(&mut self, frame: &RgbdFrame) -> Result<(), WriteError> {
        let [color, depth] = message::frame(&self.topics, frame);
        let outcome = write(&mut self.file, &mut self.color, &color)
            .and_then(|()| write(&mut self.file, &mut self.depth, &depth));
        self.checked(outcome)
    }

    /// Appends where the camera really was.
    pub fn truth(
        &mut self,
        at: Stamp,
        world_from_camera: &Isometry<World, Camera>,
    ) -> Result<(), WriteError> {
        let message = message::truth(&self.topics, at, world_from_camera);
        let outcome = write(&mut self.file, &mut self.truth, &message);
        self.checked(outcome)
    }

    /// Writes the index and closes the file.
    pub fn finish(mut self) -> Result<(), WriteError> {
        let outcome = self.file.finish().map(drop);
        self.checked(outcome)
    }

    fn checked(&self, outcome: Result<(), McapError>) -> Result<(), WriteError> {
        outcome.map_err(|source| WriteError {
            path: self.path.clone(),
            source,
        })
    }
}

fn write(
    file: &mut ::mcap::Writer<BufWriter<File>>,
    channel: &mut Channel,
    message: &Message<'_>,
) -> Result<(), McapError> {
    let header = MessageHeader {
        channel_id: channel.id,
        sequence: channel.sequence,
        log_time: message.at.as_nanos(),
        publish_time: message.at.as_nanos(),
    };
    channel.sequence = channel.sequence.wrapping_add(1);
    file.write_to_known_channel(&header, &message.bytes)
}
