//! The FTP server: whatever is asked, nothing outside of its folder is touched.
#![no_main]

use std::cell::RefCell;
use std::fs;
use std::time::Duration;

use libfuzzer_sys::fuzz_target;
use maps::time::Stamp;
use mavlink_ext::ftp::{Root, Server};
use mavlink_ext::{Address, RawFrame};

const OWN: Address = Address::new(1, 191);
const CLIENT: Address = Address::new(255, 190);

thread_local! {
    static FOLDER: RefCell<Option<tempfile::TempDir>> = const { RefCell::new(None) };
}

fuzz_target!(|bytes: &[u8]| {
    FOLDER.with_borrow_mut(|folder| {
        let folder = folder.get_or_insert_with(|| tempfile::tempdir().expect("a folder"));
        let served = folder.path().join("served");
        fs::create_dir_all(&served).expect("there is room");
        fs::write(served.join("a"), [7; 1000]).expect("there is room");
        fs::write(folder.path().join("a"), "outside").expect("there is room");
        let root = Root::new(&served, true).expect("it exists");
        let mut server = Server::new(OWN, Some(root), 100_000);
        let mut now = Stamp::ZERO;
        let mut rest = bytes;
        while let [length, payload @ ..] = rest {
            let payload = &payload[..usize::from(*length).min(payload.len())];
            rest = &rest[1 + payload.len()..];
            // FILE_TRANSFER_PROTOCOL to us, of any client.
            let mut fields = vec![0, OWN.system.0, OWN.component.0];
            fields.extend(payload);
            fields.truncate(254);
            let frame = RawFrame::new(CLIENT, 0, (110, &fields));
            let Ok(message) = frame.decode() else { continue };
            now += Duration::from_millis(9);
            assert!(server.handle(now, CLIENT, &message).len() <= 1);
            assert!(server.tick(now).len() < 100);
        }
        let outside = fs::read_dir(folder.path()).expect("it is there").count();
        assert_eq!(outside, 2, "the folder, and the file beside it");
        assert_eq!(fs::read(folder.path().join("a")).expect("untouched"), b"outside");
        fs::remove_dir_all(&served).expect("it is ours");
    });
});
