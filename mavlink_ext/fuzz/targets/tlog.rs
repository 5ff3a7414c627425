//! The reader of telemetry logs: it comes to the end, and accounts for every byte.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mavlink_ext::tlog::{TlogError, TlogReader};

fuzz_target!(|bytes: &[u8]| {
    let mut read = 0;
    for item in TlogReader::new(bytes) {
        match item {
            Ok((_time, frame)) => read += 8 + frame.bytes().len() as u64,
            Err(TlogError::Damaged { bytes, .. }) => read += bytes,
            Err(TlogError::Read(error)) => panic!("memory does not fail: {error}"),
        }
    }
    assert_eq!(read, bytes.len() as u64);
});
