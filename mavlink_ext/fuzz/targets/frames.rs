//! The frame parser: whatever comes, every frame that it finds is whole, and no byte is counted twice.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mavlink_ext::{Parser, RawFrame};

fuzz_target!(|bytes: &[u8]| {
    let Some((&step, stream)) = bytes.split_first() else {
        return;
    };
    let mut parser = Parser::new();
    let mut in_frames = 0;
    for piece in stream.chunks(usize::from(step).max(1)) {
        parser.push(piece);
        for frame in parser.by_ref().flatten() {
            in_frames += frame.bytes().len();
            let again = RawFrame::from_bytes(frame.bytes()).expect("it was whole");
            assert_eq!(again, frame);
            // It may hold what the dialect does not know.
            let _message = frame.decode();
            let _target = frame.target();
        }
    }
    parser.finish();
    assert!(in_frames + parser.skipped_bytes() as usize <= stream.len());
});
