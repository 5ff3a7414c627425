//! Signs what leaves by a link, and says whether what comes in is taken.

use std::borrow::Cow;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, SystemTime};

use super::uri::LinkSigning;
use super::{LinkError, lock};
use crate::signing::{KeyFile, Rejection, Signing, SigningStats, Timestamp};
use crate::wire::RawFrame;

/// How often the highest timestamp is kept. After a crash with a wrong clock the next start begins a
/// minute after what was kept.
const KEEP_EVERY: Timestamp = Timestamp::from_duration(Duration::from_secs(10));

/// How long it is told that a frame was not taken.
const SHOWN_FOR: Timestamp = Timestamp::from_duration(Duration::from_secs(10));

/// The number of the next link that signs: each has streams of its own.
static NEXT_LINK: AtomicU8 = AtomicU8::new(0);

/// The signatures of a link; of one that has none, it lets everything pass.
pub(super) struct Guard(Option<Signed>);

struct Signed {
    signing: Mutex<Signing>,
    file: KeyFile,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    kept: Timestamp,
    /// When a frame was not taken last, and why.
    rejection: Option<(Timestamp, Rejection)>,
    /// Why the timestamp cannot be kept.
    not_kept: Option<String>,
}

impl Guard {
    /// Reads the key.
    pub(super) fn open(signing: Option<&LinkSigning>) -> Result<Self, LinkError> {
        let Some(LinkSigning { policy, key }) = signing else {
            return Ok(Self(None));
        };
        let file = KeyFile::new(key);
        let after = file.begin(clock());
        let number = NEXT_LINK.fetch_add(1, Ordering::Relaxed);
        Ok(Self(Some(Signed {
            signing: Mutex::new(Signing::new(*policy, file.read()?, number, after)),
            file,
            state: Mutex::default(),
        })))
    }

    /// The frame as it leaves; `None` if it cannot be signed and has to be.
    pub(super) fn sign<'a>(&self, frame: &'a RawFrame) -> Option<Cow<'a, RawFrame>> {
        let Some(signed) = &self.0 else {
            return Some(Cow::Borrowed(frame));
        };
        lock(&signed.signing)
            .sign(clock(), frame.clone())
            .map(Cow::Owned)
    }

    /// Whether a frame that came is taken.
    pub(super) fn takes(&self, frame: &RawFrame) -> bool {
        let Some(signed) = &self.0 else {
            return true;
        };
        let now = clock();
        let checked = lock(&signed.signing).check(now, frame);
        if let Err(rejection) = checked {
            lock(&signed.state).rejection = Some((now, rejection));
        }
        checked.is_ok()
    }

    /// Keeps the highest timestamp now and then. It touches the disk, so it is called by the threads that wait for bytes.
    pub(super) fn keep(&self) {
        let Some(signed) = &self.0 else {
            return;
        };
        let highest = lock(&signed.signing).timestamp();
        {
            let mut state = lock(&signed.state);
            if highest < state.kept.plus(KEEP_EVERY) {
                return;
            }
            state.kept = highest;
        }
        signed.keep(highest);
    }

    pub(super) fn stats(&self) -> SigningStats {
        let signed = self.0.as_ref();
        signed.map_or(SigningStats::default(), |signed| {
            lock(&signed.signing).stats()
        })
    }

    /// What an operator should know: frames that are not taken, or a timestamp that cannot be kept.
    pub(super) fn problem(&self) -> Option<String> {
        let state = lock(&self.0.as_ref()?.state);
        let rejected = state
            .rejection
            .filter(|(at, _)| at.plus(SHOWN_FOR) >= clock())
            .map(|(_, why)| format!("frames are not taken: {why}"));
        state.not_kept.clone().or(rejected)
    }
}

impl Signed {
    fn keep(&self, highest: Timestamp) {
        let kept = self.file.keep(highest);
        lock(&self.state).not_kept = kept.err().map(|error| error.to_string());
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        if let Some(signed) = &self.0 {
            let highest = lock(&signed.signing).timestamp();
            signed.keep(highest);
        }
    }
}

#[expect(
    clippy::disallowed_methods,
    reason = "the shell around a socket: signatures carry the time of day"
)]
fn clock() -> Timestamp {
    let since_1970 = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    Timestamp::from_unix(since_1970.unwrap_or_default())
}
