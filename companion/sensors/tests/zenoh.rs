//! Messages and frames over Zenoh, between sessions and between processes.

use std::net::TcpListener;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::sync_channel;
use std::thread::Builder;
use std::time::Duration;

use maps::camera::{Pinhole, RgbdFrame};
use maps::frame::Isometry;
use maps::time::Stamp;
use nalgebra::Isometry3;
use sensors::live::Losses;
use sensors::mcap::Topics;
use sensors::message::{self, Message};
use sensors::ros::{IMAGE, POSE_STAMPED};
use sensors::zenoh::{Mode, Patience, Publisher, Qos, Session, Settings, ZenohError, ZenohSource};
use sensors::{RgbdSource as _, Silence, SourceError};
use zenoh::Wait as _;

/// Much longer than anything takes.
const LONG: Duration = Duration::from_secs(30);

/// Set where this program is to be the other process: what to do, and where.
const ROLE: &str = "TANDEM_TEST_ZENOH_ROLE";
const ENDPOINT: &str = "TANDEM_TEST_ZENOH_ENDPOINT";

const TOPIC: &str = "/uav/anything";
const MESSAGES: u8 = 60;
/// No more than wait for a slow reader.
const FRAMES: u64 = 8;

/// An endpoint of this machine where nobody is.
fn free_endpoint() -> String {
    let free = TcpListener::bind("127.0.0.1:0").and_then(|socket| socket.local_addr());
    format!("tcp/{}", free.expect("a free port"))
}

fn session(endpoint: &str) -> Session {
    let settings = Settings::at(endpoint).expect("an endpoint");
    Session::open(&settings).expect("a session")
}

/// A session at which others can be, and its endpoint.
fn router() -> (Session, String) {
    let endpoint = free_endpoint();
    (session(&format!("listen:{endpoint}")), endpoint)
}

/// Blocks until it is so.
#[track_caller]
fn wait_until(what: &str, is_so: impl Fn() -> bool) {
    let (_never, wait) = sync_channel::<()>(0);
    for _ in 0..3000 {
        if is_so() {
            return;
        }
        // Nothing comes: a pause.
        let _timeout = wait.recv_timeout(Duration::from_millis(10));
    }
    panic!("not so within 30 s: {what}");
}

/// This test program again, in a role.
fn another_process(role: &str, endpoint: &str) -> Child {
    let program = std::env::current_exe().expect("a running test has a path");
    Command::new(program)
        .args(["--exact", "in_the_other_process", "--nocapture"])
        .env(ROLE, role)
        .env(ENDPOINT, endpoint)
        .stdout(Stdio::null())
        .spawn()
        .expect("it starts")
}

/// What the other process does; nothing where this is no other process.
#[test]
fn in_the_other_process() {
    let (Ok(role), Ok(endpoint)) = (std::env::var(ROLE), std::env::var(ENDPOINT)) else {
        return;
    };
    let session = session(&endpoint);
    match role.as_str() {
        "messages" => {
            let mut publisher = session
                .publisher(TOPIC, &IMAGE, Qos::EVERY_MESSAGE)
                .expect("a publisher");
            wait_until("subscribed", || publisher.has_subscribers());
            for number in 1..=MESSAGES {
                let (at, bytes) = numbered(number);
                publisher.publish(at, &bytes).expect("the session is open");
            }
            wait_until("all taken", || !publisher.has_subscribers());
        }
        "frames" => {
            let mut camera = Camera::new(&session);
            wait_until("subscribed", || camera.has_subscribers());
            for number in 0..FRAMES {
                camera.publish(number);
            }
            // Until this process is killed.
            wait_until("all taken", || !camera.has_subscribers());
        }
        other => panic!("no role {other}"),
    }
}

/// A message of some kilobytes to a megabyte, larger than a packet and than Zenoh's batches.
fn numbered(number: u8) -> (Stamp, Vec<u8>) {
    let length = usize::from(number) * 17_003;
    let bytes = (0..length)
        .map(|n| (n as u8).wrapping_mul(number))
        .collect();
    (Stamp::from_nanos(u64::from(number) * 1_000_000_007), bytes)
}

#[test]
fn messages_of_another_process_arrive_byte_for_byte_with_their_stamps() {
    let (here, endpoint) = router();
    let subscriber = here
        .subscriber(TOPIC, &IMAGE, usize::from(MESSAGES))
        .expect("a subscriber");
    let mut other = another_process("messages", &endpoint);
    for number in 1..=MESSAGES {
        let received = subscriber.receive(LONG).expect("a message");
        let (at, bytes) = numbered(number);
        assert_eq!(received.sequence, i64::from(number));
        assert_eq!(received.at, at);
        assert!(received.bytes == bytes, "message {number}");
    }
    assert_eq!((subscriber.overflowed(), subscriber.damaged()), (0, 0));
    let found = here.publishers(TOPIC).expect("the graph answers");
    let found: Vec<_> = found
        .iter()
        .map(|p| (p.node.as_str(), p.kind.as_str()))
        .collect();
    assert_eq!(found, [("tandem", IMAGE.name)]);
    drop(subscriber);
    assert!(other.wait().expect("it ends").success());
}

#[test]
fn frames_of_another_process_are_read_until_it_is_lost_and_then_the_topic_is_named() {
    let endpoint = free_endpoint();
    let mut other = another_process("frames", &endpoint);
    let patience = Patience {
        camera: LONG,
        frame: Duration::from_millis(1500),
    };
    let settings = Settings::at(&format!("listen:{endpoint}")).expect("an endpoint");
    let mut source = ZenohSource::open(&settings, Topics::default(), patience).expect("a camera");
    assert_eq!(source.camera(), camera());
    for number in 0..FRAMES {
        let found = source.next_frame().expect("no error").expect("a frame");
        assert_eq!(found, frame(number));
    }
    other.kill().expect("it is still there");
    other.wait().expect("it ends");
    let error = source.next_frame().expect_err("the camera is gone");
    let text = error.to_string();
    assert!(
        matches!(
            &error,
            SourceError::Silent {
                why: Silence::Unpublished,
                ..
            }
        ),
        "{text}"
    );
    for word in [
        Topics::default().color.as_str(),
        "1.5 s",
        "start the camera's driver",
    ] {
        assert!(text.contains(word), "`{word}` is not in: {text}");
    }
    assert_eq!(source.truth().len(), FRAMES as usize);
    assert_eq!(source.next_frame().expect("ended"), None);
}

fn camera() -> Pinhole {
    Pinhole {
        width: 64,
        height: 48,
        fx: 60.0,
        fy: 60.0,
        cx: 32.0,
        cy: 24.0,
        distortion: [0.1, 0.0, 0.0, 0.0, 0.0],
    }
}

fn frame(number: u64) -> RgbdFrame {
    RgbdFrame {
        at: Stamp::from_nanos(1_000_000_000 + number * 33_000_000),
        width: 64,
        height: 48,
        rgb: (0..64 * 48).map(|n| [number as u8, n as u8, 7]).collect(),
        depth_m: (0..64 * 48).map(|n| (1000 + n) as f32 * 1e-3).collect(),
    }
}

/// A driver's node.
struct Camera {
    topics: Topics,
    color: Publisher,
    depth: Publisher,
    info: Publisher,
    truth: Publisher,
}

impl Camera {
    fn new(session: &Session) -> Self {
        let topics = Topics::default();
        let publisher = |topic: &str, schema| {
            let publisher = session.publisher(topic, schema, Qos::EVERY_MESSAGE);
            publisher.expect("a publisher")
        };
        let [color, depth] = message::frame(&topics, &frame(0));
        let info = message::camera(&topics, Stamp::ZERO, &camera());
        Self {
            color: publisher(color.topic, color.schema),
            depth: publisher(depth.topic, depth.schema),
            info: publisher(info.topic, info.schema),
            truth: publisher(&topics.truth, &POSE_STAMPED),
            topics,
        }
    }

    fn has_subscribers(&self) -> bool {
        let Self {
            color,
            depth,
            info,
            truth,
            ..
        } = self;
        [color, depth, info, truth]
            .iter()
            .all(|p| p.has_subscribers())
    }

    fn describe(&mut self) {
        let message = message::camera(&self.topics, Stamp::ZERO, &camera());
        send(&mut self.info, &message);
    }

    fn publish(&mut self, number: u64) {
        let frame = frame(number);
        let pose = Isometry::claim(Isometry3::translation(number as f64, 0.0, 0.0));
        self.describe();
        send(
            &mut self.truth,
            &message::truth(&self.topics, frame.at, &pose),
        );
        let [color, depth] = message::frame(&self.topics, &frame);
        send(&mut self.color, &color);
        send(&mut self.depth, &depth);
    }
}

fn send(publisher: &mut Publisher, message: &Message<'_>) {
    let sent = publisher.publish(message.at, &message.bytes);
    sent.expect("the session is open");
}

const SHORT: Patience = Patience {
    camera: Duration::from_millis(500),
    frame: Duration::from_millis(500),
};

/// A camera in a session of its own, and a source that has heard of it.
fn camera_and_source(patience: Patience) -> (Session, Camera, ZenohSource) {
    let (session, endpoint) = router();
    let mut node = Camera::new(&session);
    let settings = Settings::at(&endpoint).expect("an endpoint");
    let opening = Builder::new()
        .name("opening".into())
        .spawn(move || {
            let patience = Patience {
                camera: LONG,
                ..patience
            };
            ZenohSource::open(&settings, Topics::default(), patience).expect("a camera")
        })
        .expect("a thread");
    wait_until("subscribed", || node.has_subscribers());
    node.describe();
    let source = opening.join().expect("it opens");
    (session, node, source)
}

#[test]
fn a_camera_that_says_nothing_of_itself_is_an_error_that_names_the_topic_and_the_remedy() {
    let (session, endpoint) = router();
    let topics = Topics::default();
    let _color = session.publisher(&topics.color, &IMAGE, Qos::SENSOR);
    let settings = Settings::at(&endpoint).expect("an endpoint");
    let error = ZenohSource::open(&settings, topics.clone(), SHORT).err();
    let text = error.expect("no camera").to_string();
    for word in [
        topics.camera_info.as_str(),
        &endpoint,
        "0.5 s",
        "set the source's topics",
    ] {
        assert!(text.contains(word), "`{word}` is not in: {text}");
    }
}

#[test]
fn a_topic_of_another_type_is_an_error_that_names_both() {
    let (session, endpoint) = router();
    let topics = Topics::default();
    let _other = session
        .publisher(&topics.camera_info, &POSE_STAMPED, Qos::SENSOR)
        .expect("a publisher");
    let settings = Settings::at(&endpoint).expect("an endpoint");
    let error = ZenohSource::open(&settings, topics.clone(), SHORT).err();
    let text = error.expect("no camera").to_string();
    for word in [
        topics.camera_info.as_str(),
        POSE_STAMPED.name,
        "sensor_msgs/msg/CameraInfo",
    ] {
        assert!(text.contains(word), "`{word}` is not in: {text}");
    }
}

#[test]
fn where_no_router_is_the_error_says_how_to_start_one() {
    let settings = Settings::at(&free_endpoint()).expect("an endpoint");
    let error = ZenohSource::open(&settings, Topics::default(), SHORT).err();
    let text = error.expect("nobody is there").to_string();
    assert!(text.contains("rmw_zenohd"), "{text}");
    let client = Settings {
        mode: Mode::Client,
        ..settings
    };
    let error = Session::open(&client).err().expect("nobody is there");
    assert!(matches!(error, ZenohError::Open { .. }), "{error}");
}

#[test]
fn a_cut_message_is_left_out_and_counted_and_the_next_frame_comes() {
    let (_session, mut node, mut source) = camera_and_source(Patience::default());
    node.publish(0);
    let [color, depth] = message::frame(&node.topics, &frame(1));
    let half = &color.bytes[..color.bytes.len() / 2];
    node.color.publish(color.at, half).expect("open");
    send(&mut node.depth, &depth);
    node.publish(2);
    for number in [0, 2] {
        let found = source.next_frame().expect("no error").expect("a frame");
        assert_eq!(found, frame(number));
    }
    let expected = Losses {
        damaged: 1,
        unpaired: 1,
        ..Losses::default()
    };
    assert_eq!(source.live().expect("live").losses(), expected);
}

#[test]
fn where_all_messages_are_damaged_the_error_says_on_which_topic() {
    let (_session, mut node, mut source) = camera_and_source(SHORT);
    node.depth
        .publish(Stamp::ZERO, b"\x00\x01\x00\x00cut")
        .expect("open");
    let error = source.next_frame().expect_err("nothing else comes");
    let text = error.to_string();
    assert!(matches!(error, SourceError::Message { .. }), "{text}");
    assert!(text.contains(&node.topics.depth), "{text}");
}

#[test]
fn a_camera_that_falls_silent_and_one_whose_clock_goes_back_are_told_apart() {
    let (_session, mut node, mut source) = camera_and_source(SHORT);
    node.publish(5);
    let found = source.next_frame().expect("no error").expect("a frame");
    assert_eq!(found.at, frame(5).at);
    node.publish(1);
    let error = source.next_frame().expect_err("it has gone back");
    assert!(error.to_string().contains("gone back"), "{error}");

    let (_session, mut node, mut source) = camera_and_source(SHORT);
    let [color, _depth] = message::frame(&node.topics, &frame(5));
    send(&mut node.color, &color);
    let text = source.next_frame().expect_err("no depth").to_string();
    assert!(text.contains(&node.topics.depth), "{text}");
    assert!(text.contains("tandem is there and sends nothing"), "{text}");
}

#[test]
fn a_slow_reader_gets_the_newest_frames_and_what_it_missed_is_counted() {
    let (_session, mut node, mut source) = camera_and_source(Patience::default());
    for number in 0..30 {
        node.publish(number);
    }
    let live = source.live().expect("live");
    // Of 30 messages on each of four topics, eight wait.
    wait_until("all have come", || live.losses().overflowed == 4 * 22);
    for number in 22..30 {
        let found = source.next_frame().expect("no error").expect("a frame");
        assert_eq!(found, frame(number));
    }
    assert_eq!(live.losses().total(), 4 * 22);
}

#[test]
fn a_wait_for_a_frame_ends_at_once_when_the_source_is_stopped() {
    let patience = Patience {
        camera: LONG,
        frame: Duration::from_mins(10),
    };
    let (_session, _node, mut source) = camera_and_source(patience);
    let live = source.live().expect("live");
    let waiting = Builder::new()
        .name("waiting".into())
        .spawn(move || source.next_frame().expect("no error"))
        .expect("a thread");
    live.stop();
    assert_eq!(waiting.join().expect("it ends"), None);
}

#[test]
fn nodes_of_another_domain_are_neither_heard_nor_seen() {
    let (here, endpoint) = router();
    let elsewhere = Settings {
        domain: 7,
        ..Settings::at(&endpoint).expect("an endpoint")
    };
    let elsewhere = Session::open(&elsewhere).expect("a session");
    let neighbour = session(&endpoint);
    let subscriber = here.subscriber(TOPIC, &IMAGE, 4).expect("a subscriber");
    let mut other = elsewhere
        .publisher(TOPIC, &IMAGE, Qos::EVERY_MESSAGE)
        .expect("a publisher");
    let mut ours = neighbour
        .publisher(TOPIC, &IMAGE, Qos::EVERY_MESSAGE)
        .expect("a publisher");
    wait_until("subscribed", || ours.has_subscribers());
    assert!(!other.has_subscribers());
    other.publish(Stamp::ZERO, b"other").expect("open");
    ours.publish(Stamp::ZERO, b"ours").expect("open");
    assert_eq!(subscriber.receive(LONG).expect("a message").bytes, b"ours");
    assert_eq!(here.publishers(TOPIC).expect("an answer").len(), 1);
}

#[test]
fn a_message_without_an_attachment_is_left_out_and_counted() {
    let (here, endpoint) = router();
    let subscriber = here.subscriber(TOPIC, &IMAGE, 4).expect("a subscriber");
    let neighbour = session(&endpoint);
    let mut publisher = neighbour
        .publisher(TOPIC, &IMAGE, Qos::EVERY_MESSAGE)
        .expect("a publisher");
    wait_until("subscribed", || publisher.has_subscribers());
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("connect/endpoints", format!("[\"{endpoint}\"]")),
        ("scouting/multicast/enabled", "false".to_owned()),
    ] {
        config.insert_json5(key, &value).expect("a setting");
    }
    let bare = zenoh::open(config).wait().expect("a session");
    let key = "0/uav/anything/sensor_msgs::msg::dds_::Image_/\
               RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47";
    bare.put(key, "bare").wait().expect("open");
    wait_until("it has come", || subscriber.damaged() == 1);
    publisher.publish(Stamp::ZERO, b"whole").expect("open");
    assert_eq!(subscriber.receive(LONG).expect("a message").bytes, b"whole");
}
