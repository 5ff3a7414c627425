use std::net::UdpSocket;
use std::sync::mpsc::{Receiver, sync_channel};

use super::*;
use crate::dialect::Message;
use crate::dialect::tandem::{COMMAND_LONG_DATA, HEARTBEAT_DATA};
use crate::wire::{Address, Encoder};

const PATIENCE: Duration = Duration::from_secs(10);

fn open(uri: &str) -> (Link, Receiver<RawFrame>) {
    let (sender, receiver) = sync_channel(100);
    let link = Link::open(uri, move |frame| {
        sender.send(frame).expect("the test reads what comes");
    })
    .expect("loopback has free ports");
    (link, receiver)
}

fn address(link: &Link) -> SocketAddr {
    link.local_address().expect("it has a socket")
}

/// Sends until something comes out at the other end: connections take their time.
#[track_caller]
fn sends_until_heard(link: &Link, frame: &RawFrame, heard: &Receiver<RawFrame>) {
    let begun = monotonic_now();
    while begun.elapsed() < PATIENCE {
        link.send(frame).expect("loopback takes it");
        if let Ok(came) = heard.recv_timeout(POLL) {
            assert_eq!(came, *frame);
            return;
        }
    }
    panic!("nothing came: {:?}", link.problem());
}

fn heartbeat(from: Address) -> RawFrame {
    Encoder::new(from).encode(&Message::HEARTBEAT(HEARTBEAT_DATA::default()))
}

fn command_for(target: Address) -> RawFrame {
    let command = COMMAND_LONG_DATA {
        target_system: target.system.0,
        target_component: target.component.0,
        ..COMMAND_LONG_DATA::default()
    };
    Encoder::new(Address::new(255, 190)).encode(&Message::COMMAND_LONG(command))
}

#[test]
fn a_listener_answers_every_peer_and_addresses_the_one_that_was_heard() {
    let (listener, heard) = open("udpin:127.0.0.1:0");
    assert_eq!(
        listener.send(&heartbeat(Address::new(255, 190))).ok(),
        Some(0)
    );
    let uri = format!("udpout:{}", address(&listener));
    let (copter, copter_hears) = open(&uri);
    let (rover, rover_hears) = open(&uri);
    for (link, address) in [(&copter, Address::new(1, 1)), (&rover, Address::new(2, 1))] {
        assert_eq!(link.send(&heartbeat(address)).ok(), Some(1));
        assert_eq!(heard.recv_timeout(PATIENCE), Ok(heartbeat(address)));
    }

    let for_rover = command_for(Address::new(2, 1));
    assert_eq!(listener.send(&for_rover).ok(), Some(1));
    let for_all = heartbeat(Address::new(255, 190));
    assert_eq!(listener.send(&for_all).ok(), Some(2));
    assert_eq!(rover_hears.recv_timeout(PATIENCE), Ok(for_rover));
    assert_eq!(rover_hears.recv_timeout(PATIENCE), Ok(for_all.clone()));
    assert_eq!(copter_hears.recv_timeout(PATIENCE), Ok(for_all));

    let stats = listener.stats();
    assert_eq!(
        (stats.frames_sent, stats.frames_received, stats.peers),
        (3, 2, 2)
    );
    assert_eq!(stats.bad_frames, 0);
}

#[test]
fn garbage_is_counted_and_the_frame_after_it_delivered() {
    let (listener, heard) = open("udpin:127.0.0.1:0");
    let socket = UdpSocket::bind("127.0.0.1:0").expect("loopback has free ports");
    let frame = heartbeat(Address::new(1, 1));
    let mut damaged = frame.bytes().to_vec();
    damaged[12] ^= 0x40;
    for datagram in [
        &damaged,
        &frame.bytes()[..15].to_vec(),
        &frame.bytes().to_vec(),
    ] {
        socket
            .send_to(datagram, address(&listener))
            .expect("loopback takes it");
    }
    assert_eq!(heard.recv_timeout(PATIENCE), Ok(frame));
    assert_eq!(listener.stats().bad_frames, 2);
}

#[test]
fn tcp_peers_are_addressed_as_udp_peers_are() {
    let (listener, heard) = open("tcpin:127.0.0.1:0");
    let uri = format!("tcpout:{}", address(&listener));
    let (copter, copter_hears) = open(&uri);
    let (rover, rover_hears) = open(&uri);
    for (link, address) in [(&copter, Address::new(1, 1)), (&rover, Address::new(2, 1))] {
        sends_until_heard(link, &heartbeat(address), &heard);
        assert_eq!(link.problem(), None);
    }
    let for_rover = command_for(Address::new(2, 1));
    assert_eq!(listener.send(&for_rover).ok(), Some(1));
    assert_eq!(rover_hears.recv_timeout(PATIENCE), Ok(for_rover));
    let for_all = heartbeat(Address::new(255, 190));
    assert_eq!(listener.send(&for_all).ok(), Some(2));
    assert_eq!(rover_hears.recv_timeout(PATIENCE), Ok(for_all.clone()));
    assert_eq!(copter_hears.recv_timeout(PATIENCE), Ok(for_all));
    assert_eq!(listener.stats().peers, 2);
}

#[test]
fn a_tcp_link_comes_back_when_its_peer_does() {
    let (listener, _heard) = open("tcpin:127.0.0.1:0");
    let place = address(&listener);
    drop(listener);
    let (link, _hears) = open(&format!("tcpout:{place}"));
    let begun = monotonic_now();
    while link.problem().is_none() && begun.elapsed() < PATIENCE {
        std::thread::park_timeout(POLL);
    }
    let problem = link.problem().expect("nobody listens");
    assert!(problem.contains("refused"), "{problem}");
    for _ in 0..2 {
        let (listener, heard) = open(&format!("tcpin:{place}"));
        sends_until_heard(&link, &heartbeat(Address::new(1, 1)), &heard);
        drop(listener);
    }
}

#[test]
fn a_frame_that_is_cut_by_the_end_of_a_connection_does_not_spoil_the_next() {
    use std::io::Write as _;
    let (listener, heard) = open("tcpin:127.0.0.1:0");
    let frame = heartbeat(Address::new(1, 1));
    for sent in [&frame.bytes()[..10], frame.bytes()] {
        let mut stream =
            std::net::TcpStream::connect(address(&listener)).expect("somebody listens");
        stream.write_all(sent).expect("loopback takes it");
    }
    assert_eq!(heard.recv_timeout(PATIENCE), Ok(frame));
}

#[test]
fn a_peer_that_takes_nothing_holds_up_nobody() {
    let (listener, heard) = open("tcpin:127.0.0.1:0");
    let (other, other_hears) = open(&format!("tcpout:{}", address(&listener)));
    sends_until_heard(&other, &heartbeat(Address::new(1, 1)), &heard);
    let mut deaf = std::net::TcpStream::connect(address(&listener)).expect("somebody listens");
    std::io::Write::write_all(&mut deaf, heartbeat(Address::new(2, 1)).bytes()).expect("taken");
    assert_eq!(
        heard.recv_timeout(PATIENCE),
        Ok(heartbeat(Address::new(2, 1)))
    );
    let for_deaf = command_for(Address::new(2, 1));
    // More than the buffers of two sockets and the outbox hold.
    while listener.stats().frames_dropped == 0 {
        listener.send(&for_deaf).expect("sending never fails");
    }
    let for_other = command_for(Address::new(1, 1));
    assert_eq!(listener.send(&for_other).ok(), Some(1));
    assert_eq!(other_hears.recv_timeout(PATIENCE), Ok(for_other));
}

#[test]
fn a_serial_port_carries_frames_both_ways() {
    use std::io::{Read as _, Write as _};
    let (mut far, near) = serialport::TTYPort::pair().expect("the system has terminals");
    let device = serialport::SerialPort::name(&near).expect("it has a name");
    let (link, heard) = open(&format!("serial:{device}:57600"));
    let frame = heartbeat(Address::new(1, 1));
    let begun = monotonic_now();
    while link.send(&frame).ok() != Some(1) && begun.elapsed() < PATIENCE {
        std::thread::park_timeout(POLL);
    }
    let mut bytes = vec![0; frame.bytes().len()];
    serialport::SerialPort::set_timeout(&mut far, PATIENCE).expect("any timeout");
    far.read_exact(&mut bytes).expect("what was sent");
    assert_eq!(bytes, frame.bytes());
    far.write_all(frame.bytes()).expect("it is open");
    assert_eq!(heard.recv_timeout(PATIENCE), Ok(frame));
}

#[test]
fn a_serial_port_that_is_not_there_is_named() {
    let (link, _heard) = open("serial:/dev/no_such_port:57600");
    let begun = monotonic_now();
    while link.problem().is_none() && begun.elapsed() < PATIENCE {
        std::thread::park_timeout(POLL);
    }
    let problem = link.problem().expect("it is not there");
    assert!(problem.contains("No such file"), "{problem}");
}

/// A folder with two keys.
fn keys() -> (tempfile::TempDir, [String; 2]) {
    let folder = tempfile::tempdir().expect("a place for files");
    let keys = [1, 2].map(|number| {
        let path = folder.path().join(format!("{number}.key"));
        let key = crate::signing::SigningKey::new([number; 32]);
        crate::signing::KeyFile::new(&path)
            .create(&key)
            .expect("a new file");
        path.display().to_string()
    });
    (folder, keys)
}

fn signed(uri: &str, policy: &str, key: &str) -> String {
    format!("{uri}?signing={policy}&key={key}")
}

#[test]
fn only_who_has_the_key_is_heard_and_answered() {
    let (folder, [key, other_key]) = keys();
    for way in ["udp", "tcp"] {
        let (listener, heard) = open(&signed(&format!("{way}in:127.0.0.1:0"), "required", &key));
        let there = format!("{way}out:{}", address(&listener));
        let (stranger, _) = open(&there);
        let (wrong, _) = open(&signed(&there, "accepted", &other_key));
        let frame = heartbeat(Address::new(1, 1));
        let begun = monotonic_now();
        let rejected = |stats: SigningStats| (stats.rejected_unsigned, stats.rejected_wrong_key);
        while begun.elapsed() < PATIENCE {
            stranger.send(&frame).expect("loopback takes it");
            wrong.send(&frame).expect("loopback takes it");
            let (unsigned, wrongly) = rejected(listener.signing_stats());
            if unsigned > 0 && wrongly > 0 {
                break;
            }
            assert!(heard.recv_timeout(POLL).is_err(), "nothing is taken");
        }
        let (unsigned, wrongly) = rejected(listener.signing_stats());
        assert!(
            unsigned > 0 && wrongly > 0,
            "{:?}",
            listener.signing_stats()
        );
        let problem = listener.problem().unwrap_or_default();
        assert!(problem.starts_with("frames are not taken"), "{problem}");
        assert_eq!(listener.stats().frames_received, 0);
        if way == "udp" {
            assert_eq!(listener.stats().peers, 0, "nothing is sent to them");
        }
        let (friend, friend_hears) = open(&signed(&there, "required", &key));
        let begun = monotonic_now();
        let came = loop {
            friend.send(&frame).expect("loopback takes it");
            match heard.recv_timeout(POLL) {
                Ok(came) => break came,
                Err(_) => assert!(begun.elapsed() < PATIENCE, "{:?}", listener.problem()),
            }
        };
        assert!(came.is_signed());
        assert_eq!(came.decode().ok(), frame.decode().ok());
        let answer = command_for(Address::new(1, 1));
        listener.send(&answer).expect("loopback takes it");
        let back = friend_hears.recv_timeout(PATIENCE).expect("it is a peer");
        assert_eq!(back.decode().ok(), answer.decode().ok());
    }
    assert!(folder.path().join("1.key.timestamp").exists());
}

#[test]
fn a_key_that_cannot_be_used_is_an_error_that_names_it() {
    let (_folder, [key, _]) = keys();
    let opened = |key: &str| {
        let uri = signed("udpin:127.0.0.1:0", "required", key);
        Link::open(&uri, |_| ())
            .map(|_| ())
            .map_err(|error| error.to_string())
    };
    assert_eq!(opened(&key), Ok(()));
    let missing = opened("/nowhere/link.key").expect_err("no such file");
    assert!(missing.contains("/nowhere/link.key"), "{missing}");
    let mode = std::os::unix::fs::PermissionsExt::from_mode(0o644);
    std::fs::set_permissions(&key, mode).expect("ours");
    let exposed = opened(&key).expect_err("others may read it");
    assert!(exposed.contains(&key), "{exposed}");
}
