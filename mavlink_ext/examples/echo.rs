//! Sends every message that it understands back to where it came from: a peer for trying out another MAVLink library.
//!
//! `cargo run -p mavlink_ext --example echo -- udpin:127.0.0.1:14777`, until its standard input ends.

use std::error::Error;
use std::io::Read as _;
use std::sync::mpsc::sync_channel;
use std::thread;

use mavlink_ext::link::Link;
use mavlink_ext::{Address, Encoder, RawFrame};

fn main() -> Result<(), Box<dyn Error>> {
    let uri = std::env::args()
        .nth(1)
        .unwrap_or_else(|| "udpin:127.0.0.1:14777".to_owned());
    // When full, frames are dropped, as the air would.
    let (sender, receiver) = sync_channel::<RawFrame>(1000);
    let link = Link::open(&uri, move |frame| drop(sender.try_send(frame)))?;
    let echo = thread::Builder::new()
        .name("echo".to_owned())
        .spawn(move || {
            let mut encoder = Encoder::new(Address::new(1, 191));
            while let Ok(frame) = receiver.recv() {
                if let Ok(message) = frame.decode() {
                    // What cannot be sent is lost; there is nobody to tell.
                    drop(link.send(&encoder.encode(&message)));
                }
            }
        })?;
    std::io::stdin().read_to_end(&mut Vec::new())?;
    drop(echo); // The process ends, and the link with it.
    Ok(())
}
