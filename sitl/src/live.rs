//! What the simulated sensors say, live over Zenoh, as nodes with `rmw_zenoh` read it.
//!
//! The messages are those of a recording, on the same topics: a ROS 2 node, or the companion, cannot tell them from a
//! driver's. Nobody needs to listen, and a slow listener loses messages, not the simulation time.

use std::collections::BTreeMap;

use sensors::message::Message;
use sensors::zenoh::{Publisher, Qos, Session, Settings, ZenohError};

/// A node that publishes on topics as they come up.
pub struct Live {
    session: Session,
    publishers: BTreeMap<String, Publisher>,
}

impl Live {
    /// Joins the ROS 2 graph whose router is at `tcp/HOST:PORT`, or is the router at `listen:tcp/HOST:PORT`.
    pub fn open(endpoint: &str) -> Result<Self, ZenohError> {
        let settings = Settings {
            node: "sitl".into(),
            ..Settings::at(endpoint)?
        };
        Ok(Self {
            session: Session::open(&settings)?,
            publishers: BTreeMap::new(),
        })
    }

    /// Sends a message; a topic is announced with its first one.
    pub fn publish(&mut self, message: &Message<'_>) -> Result<(), ZenohError> {
        if let Some(publisher) = self.publishers.get_mut(message.topic) {
            return publisher.publish(message.at, &message.bytes);
        }
        let mut publisher = self
            .session
            .publisher(message.topic, message.schema, Qos::SENSOR)?;
        publisher.publish(message.at, &message.bytes)?;
        self.publishers.insert(message.topic.to_owned(), publisher);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;
    use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
    use std::thread::Builder;
    use std::time::Duration;

    use maps::camera::{Pinhole, RgbdFrame};
    use maps::frame::Isometry;
    use maps::time::Stamp;
    use nalgebra::Isometry3;
    use sensors::RgbdSource as _;
    use sensors::mcap::Topics;
    use sensors::message;
    use sensors::zenoh::{Patience, ZenohSource};

    use super::*;

    fn camera() -> Pinhole {
        Pinhole {
            width: 4,
            height: 2,
            fx: 4.0,
            fy: 4.0,
            cx: 2.0,
            cy: 1.0,
            distortion: [0.0; 5],
        }
    }

    fn frame(number: u64) -> RgbdFrame {
        RgbdFrame {
            at: Stamp::from_nanos(number * 10_000_000),
            width: 4,
            height: 2,
            rgb: vec![[number as u8, 1, 2]; 8],
            // As 1500 millimetres are read.
            depth_m: vec![1500.0 * 1e-3; 8],
        }
    }

    /// Publishes frames every 10 ms until it is told to end.
    fn fly(mut live: Live, end: &Receiver<()>) {
        let topics = Topics::default();
        let mut number = 0;
        while end.recv_timeout(Duration::from_millis(10)) == Err(RecvTimeoutError::Timeout) {
            let frame = frame(number);
            let pose = Isometry::claim(Isometry3::translation(number as f64, 0.0, 0.0));
            let [color, depth] = message::frame(&topics, &frame);
            for message in [
                message::camera(&topics, frame.at, &camera()),
                message::truth(&topics, frame.at, &pose),
                color,
                depth,
            ] {
                live.publish(&message).expect("the session is open");
            }
            number += 1;
        }
    }

    #[test]
    fn what_is_published_is_read_back_as_frames_with_their_truth() {
        let free = TcpListener::bind("127.0.0.1:0").and_then(|socket| socket.local_addr());
        let endpoint = format!("tcp/{}", free.expect("a free port"));
        let live = Live::open(&format!("listen:{endpoint}")).expect("a free port");
        let (stop, stopped) = sync_channel(0);
        let flight = Builder::new()
            .name("flight".into())
            .spawn(move || fly(live, &stopped))
            .expect("a thread");
        let settings = Settings::at(&endpoint).expect("sound");
        let mut source =
            ZenohSource::open(&settings, Topics::default(), Patience::default()).expect("a camera");
        assert_eq!(source.camera(), camera());
        for _ in 0..5 {
            let found = source.next_frame().expect("no error").expect("a frame");
            assert_eq!(found, frame(found.at.as_nanos() / 10_000_000));
        }
        let truth = source.truth().first().expect("it came before its frame");
        let x = truth.pose.translation.x * 1e7;
        assert!((x - truth.at.as_nanos() as f64).abs() < 1e-3, "{truth:?}");
        drop(stop);
        flight.join().expect("it ends");
    }

    #[test]
    fn what_is_no_endpoint_is_refused() {
        let error = Live::open("udp/127.0.0.1:7447").err().expect("no endpoint");
        assert!(error.to_string().contains("tcp/HOST:PORT"), "{error}");
    }
}
