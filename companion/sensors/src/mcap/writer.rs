//! Writes ROS 2 messages to a file.

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

/// Why a recording cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: check the folder, its permissions and the free space", path.display())]
pub struct WriteError {
    /// The file.
    pub path: PathBuf,
    /// What the container's writer says.
    pub source: McapError,
}

/// Writes messages to a file, uncompressed, each topic with the definition of its type. What was written before a crash
/// can be read; [`Writer::finish`] adds the index by which viewers seek.
pub struct Writer {
    path: PathBuf,
    topics: Topics,
    file: ::mcap::Writer<BufWriter<File>>,
    channels: BTreeMap<String, Channel>,
}

#[derive(Clone, Copy)]
struct Channel {
    id: u16,
    sequence: u32,
}

impl Writer {
    /// Starts a file, replacing one that is there. `topics` are those of its RGB-D camera.
    pub fn create(path: &Path, topics: &Topics) -> Result<Self, WriteError> {
        let error = |source| WriteError {
            path: path.to_owned(),
            source,
        };
        let file = File::create(path).map_err(|e| error(e.into()))?;
        let options = WriteOptions::new().profile("ros2").compression(None);
        Ok(Self {
            path: path.to_owned(),
            topics: topics.clone(),
            file: options.create(BufWriter::new(file)).map_err(error)?,
            channels: BTreeMap::new(),
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

    /// Appends a message that came in then, by the recorder's clock.
    pub fn write(&mut self, logged: Stamp, message: &Message<'_>) -> Result<(), WriteError> {
        let outcome = self.append(logged, message);
        self.checked(outcome)
    }

    fn append(&mut self, logged: Stamp, message: &Message<'_>) -> Result<(), McapError> {
        if !self.channels.contains_key(message.topic) {
            let schema = message.schema;
            let text = schema.text.as_bytes();
            let schema = self.file.add_schema(schema.name, "ros2msg", text)?;
            let none = BTreeMap::new();
            let id = self.file.add_channel(schema, message.topic, "cdr", &none)?;
            let new = Channel { id, sequence: 0 };
            self.channels.insert(message.topic.to_owned(), new);
        }
        let Some(channel) = self.channels.get_mut(message.topic) else {
            return Ok(());
        };
        let header = MessageHeader {
            channel_id: channel.id,
            sequence: channel.sequence,
            log_time: logged.as_nanos(),
            publish_time: message.at.as_nanos(),
        };
        channel.sequence = channel.sequence.wrapping_add(1);
        self.file.write_to_known_channel(&header, &message.bytes)
    }

    /// Appends the camera. A reader needs it once; players that seek need it now and then.
    pub fn camera(&mut self, at: Stamp, camera: &Pinhole) -> Result<(), WriteError> {
        let topics = self.topics.clone();
        self.write(at, &message::camera(&topics, at, camera))
    }

    /// Appends a frame: colour as `rgb8`, depth as `16UC1`, which is to the millimetre and up to 65.5 m.
    pub fn frame(&mut self, frame: &RgbdFrame) -> Result<(), WriteError> {
        let topics = self.topics.clone();
        let [color, depth] = message::frame(&topics, frame);
        self.write(frame.at, &color)?;
        self.write(frame.at, &depth)
    }

    /// Appends where the camera really was.
    pub fn truth(
        &mut self,
        at: Stamp,
        world_from_camera: &Isometry<World, Camera>,
    ) -> Result<(), WriteError> {
        let topics = self.topics.clone();
        self.write(at, &message::truth(&topics, at, world_from_camera))
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
