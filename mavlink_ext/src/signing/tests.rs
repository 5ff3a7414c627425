use std::fs;
use std::os::unix::fs::PermissionsExt as _;

use proptest::prelude::*;

use super::*;
use crate::dialect::Message;
use crate::dialect::tandem::{HEARTBEAT_DATA, RADIO_STATUS_DATA};
use crate::wire::{Encoder, STX_V2, WireError};

const KEY: SigningKey = SigningKey::new([7; 32]);
const COPTER: Address = Address::new(1, 1);

fn at(seconds: u64) -> Timestamp {
    Timestamp::from_unix(Timestamp::EPOCH + Duration::from_secs(seconds))
}

fn signing(policy: Policy) -> Signing {
    Signing::new(policy, KEY, 3, Timestamp::default())
}

fn heartbeat() -> RawFrame {
    Encoder::new(COPTER).encode(&Message::HEARTBEAT(HEARTBEAT_DATA::default()))
}

fn signed(signing: &mut Signing, seconds: u64) -> RawFrame {
    signing.sign(at(seconds), heartbeat()).expect("MAVLink 2")
}

#[test]
fn a_signed_frame_is_whole_and_taken_once() {
    let mut sender = signing(Policy::Required);
    let mut receiver = signing(Policy::Required);
    let frame = signed(&mut sender, 1000);
    assert_eq!(
        frame.bytes().len(),
        heartbeat().bytes().len() + SIGNATURE_BYTES
    );
    let again = RawFrame::from_bytes(frame.bytes()).expect("its checksum is right");
    assert_eq!(again.decode().ok(), heartbeat().decode().ok());
    assert_eq!(receiver.check(at(1000), &again), Ok(()));
    assert_eq!(receiver.check(at(1000), &again), Err(Rejection::Replayed));
    assert_eq!(receiver.check(at(1000), &signed(&mut sender, 1000)), Ok(()));
    let stats = receiver.stats();
    assert_eq!((stats.signed, stats.rejected_replayed), (2, 1));
}

#[test]
fn the_signature_covers_what_the_guide_says() {
    // The key, and the frame up to the hash itself. That others read it the same way is for the test with pymavlink.
    let frame = signed(&mut signing(Policy::Required), 0);
    let bytes = frame.bytes();
    let (head, tail) = bytes.split_at(bytes.len() - 6);
    let mut all = vec![7; 32];
    all.extend(head);
    assert_eq!(tail, &Sha256::digest(&all)[..6]);
    assert_eq!(
        &bytes[bytes.len() - 13..bytes.len() - 6],
        [3, 1, 0, 0, 0, 0, 0]
    );
    assert_eq!(bytes[2], 1, "the flag that says so");
}

#[test]
fn a_message_that_is_not_in_the_dialect_is_signed_too() {
    // AUTOPILOT_VERSION_REQUEST of ardupilotmega.xml, id 183, CRC_EXTRA 85.
    let mut bytes = vec![STX_V2, 2, 0, 0, 9, 1, 1, 183, 0, 0, 255, 190];
    let crc = mavlink_core::calculate_crc(&bytes[1..], 85);
    bytes.extend(crc.to_le_bytes());
    let frame = RawFrame::from_bytes(&bytes).expect("a frame");
    assert!(matches!(
        frame.decode(),
        Err(WireError::Unknown { id: 183 })
    ));
    let signed = signing(Policy::Required)
        .sign(at(0), frame)
        .expect("MAVLink 2");
    let end = 12;
    let crc = mavlink_core::calculate_crc(&signed.bytes()[1..end], 85);
    assert_eq!(signed.bytes()[end..end + 2], crc.to_le_bytes());
}

#[test]
fn another_key_and_a_changed_byte_are_rejected() {
    let frame = signed(&mut signing(Policy::Required), 1000);
    let other = SigningKey::new([8; 32]);
    let mut receiver = Signing::new(Policy::Accepted, other, 0, Timestamp::default());
    assert_eq!(receiver.check(at(1000), &frame), Err(Rejection::WrongKey));
    let mut receiver = signing(Policy::Accepted);
    let end = frame.bytes().len();
    for place in end - 13..end {
        let mut bytes = frame.bytes().to_vec();
        bytes[place] ^= 1;
        let changed = RawFrame::from_bytes(&bytes).expect("the checksum does not cover it");
        assert_eq!(
            receiver.check(at(1000), &changed),
            Err(Rejection::WrongKey),
            "byte {place}"
        );
    }
    assert_eq!(receiver.stats().rejected_wrong_key, 13);
}

#[test]
fn unsigned_frames_are_taken_as_the_policy_says_and_the_radio_always() {
    let radio = Encoder::new(Address::new(51, 68))
        .encode(&Message::RADIO_STATUS(RADIO_STATUS_DATA::default()));
    for (policy, expected) in [
        (Policy::Off, Ok(())),
        (Policy::Accepted, Ok(())),
        (Policy::Required, Err(Rejection::Unsigned)),
    ] {
        let mut receiver = signing(policy);
        assert_eq!(receiver.check(at(0), &heartbeat()), expected);
        assert_eq!(receiver.check(at(0), &radio), Ok(()));
    }
}

#[test]
fn off_means_that_signatures_are_neither_made_nor_looked_at() {
    let mut off = signing(Policy::Off);
    assert_eq!(off.sign(at(0), heartbeat()), Some(heartbeat()));
    let other = SigningKey::new([8; 32]);
    let mut foreign = Signing::new(Policy::Required, other, 0, Timestamp::default());
    assert_eq!(off.check(at(0), &signed(&mut foreign, 0)), Ok(()));
}

#[test]
fn an_old_stream_is_not_taken_for_a_new_one() {
    let mut receiver = signing(Policy::Required);
    let frame_of = |seconds| signed(&mut signing(Policy::Required), seconds);
    assert_eq!(
        receiver.check(at(1000), &frame_of(939)),
        Err(Rejection::Replayed)
    );
    assert_eq!(receiver.check(at(1000), &frame_of(941)), Ok(()));
    assert_eq!(
        receiver.check(at(1000), &frame_of(5000)),
        Ok(()),
        "its clock is ahead"
    );
    assert_eq!(receiver.timestamp(), at(5000), "ours follows");
}

#[test]
fn forwarded_signatures_stay_and_mavlink_1_goes_only_where_signatures_are_optional() {
    let mut ours = signing(Policy::Required);
    let other = SigningKey::new([8; 32]);
    let theirs = signed(
        &mut Signing::new(Policy::Required, other, 9, Timestamp::default()),
        5,
    );
    assert_eq!(ours.sign(at(10), theirs.clone()), Some(theirs));
    let old = RawFrame::from_bytes(&[0xFE, 1, 0, 1, 1, 163, 7, 0, 0]).expect("a frame");
    assert_eq!(ours.sign(at(10), old.clone()), None);
    assert_eq!(ours.stats().unsignable, 1);
    assert_eq!(
        signing(Policy::Accepted).sign(at(10), old.clone()),
        Some(old)
    );
}

#[test]
fn timestamps_go_on_after_a_restart_with_a_wrong_clock() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = KeyFile::new(folder.path().join("key"));
    assert_eq!(file.begin(at(1000)), Timestamp::default());
    let mut before = Signing::new(Policy::Required, KEY, 3, file.begin(at(1000)));
    let mut receiver = signing(Policy::Required);
    assert_eq!(receiver.check(at(1000), &signed(&mut before, 1000)), Ok(()));
    file.keep(before.timestamp()).expect("there is room");
    assert_eq!(receiver.check(at(1020), &signed(&mut before, 1020)), Ok(()));
    let mut after = Signing::new(Policy::Required, KEY, 3, file.begin(at(0)));
    assert_eq!(
        receiver.check(at(1030), &signed(&mut after, 0)),
        Ok(()),
        "the clock is at 2015"
    );
}

#[test]
fn programs_that_share_a_key_and_start_together_take_one_anothers_frames() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = KeyFile::new(folder.path().join("key"));
    // Each keeps its timestamp as soon as it runs, before the next one starts.
    let mut programs: Vec<Signing> = (0..4)
        .map(|i| {
            let now = at(1000 + i);
            let program = Signing::new(Policy::Required, KEY, i as u8, file.begin(now));
            file.keep(program.timestamp().max(now))
                .expect("there is room");
            program
        })
        .collect();
    for sender in 0..4 {
        let frame = signed(&mut programs[sender], 1005);
        for receiver in (0..4).filter(|receiver| *receiver != sender) {
            let taken = programs[receiver].check(at(1005), &frame);
            assert_eq!(taken, Ok(()), "from {sender} to {receiver}");
        }
    }
}

#[test]
fn a_key_is_read_only_from_a_file_of_its_owner_alone() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("key");
    let file = KeyFile::new(&path);
    assert!(matches!(file.read(), Err(KeyError::Read { .. })));
    file.create(&KEY).expect("there is room");
    assert_eq!(file.read().expect("just written"), KEY);
    assert!(
        matches!(file.create(&KEY), Err(KeyError::Write { .. })),
        "never overwritten"
    );
    fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).expect("it is ours");
    let error = file.read().expect_err("the group may read it");
    assert!(
        error.to_string().ends_with("(mode 640): chmod 600 it"),
        "{error}"
    );
    fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).expect("it is ours");
    for wrong in ["", "7", "zz", &"é".repeat(32), &"0".repeat(200)] {
        fs::write(&path, wrong).expect("there is room");
        assert!(
            matches!(file.read(), Err(KeyError::Content { .. })),
            "{wrong:?}"
        );
    }
    assert_eq!(format!("{KEY:?}"), "SigningKey(..)");
}

proptest! {
    #[test]
    fn any_bytes_with_a_signature_are_rejected_without_the_key(
        stamp in any::<[u8; 6]>(), hash in any::<[u8; 6]>(), link in any::<u8>()
    ) {
        let mut signature = [link; SIGNATURE_BYTES];
        signature[1..7].copy_from_slice(&stamp);
        signature[7..].copy_from_slice(&hash);
        let forged = heartbeat().with_signature(signature);
        prop_assert_eq!(signing(Policy::Accepted).check(at(0), &forged), Err(Rejection::WrongKey));
    }
}
