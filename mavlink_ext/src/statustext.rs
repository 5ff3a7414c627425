//! Texts for the operator, cut into pieces of 50 bytes and put together again.
//!
//! A text that fits one `STATUSTEXT` has the id 0. A longer one has another id in all of its pieces, which are counted; the
//! last one is the first that is not full. <https://mavlink.io/en/messages/common.html#STATUSTEXT>

use std::collections::BTreeMap;
use std::time::Duration;

use maps::time::Stamp;

use crate::dialect::Message;
use crate::dialect::tandem::{MavSeverity, STATUSTEXT_DATA};
use crate::wire::Address;

/// Bytes in a message.
const PIECE: usize = 50;
/// Pieces of one text at most: their number has 8 bits.
const MAX_PIECES: usize = 256;
/// After so long without a further piece, what is there is all there will be.
const PATIENCE: Duration = Duration::from_secs(1);
/// Texts that are put together at once.
const MAX_TEXTS: usize = 32;
/// Stands for a piece that was lost.
const LOST: &str = "[…]";

/// Cuts texts into messages.
#[derive(Clone, Debug, Default)]
pub struct Speaker {
    last_id: u16,
}

impl Speaker {
    /// Has said nothing yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// The messages of a text. It ends after 12800 bytes.
    pub fn say(&mut self, severity: MavSeverity, text: &str) -> Vec<Message> {
        let mut pieces: Vec<&[u8]> = text.as_bytes().chunks(PIECE).take(MAX_PIECES).collect();
        let id = if text.len() <= PIECE {
            0
        } else {
            self.last_id = self.last_id.checked_add(1).unwrap_or(1);
            self.last_id
        };
        let ends_full = pieces.last().is_none_or(|piece| piece.len() == PIECE);
        if id != 0 && ends_full && pieces.len() < MAX_PIECES {
            pieces.push(&[]);
        }
        let message = |(number, piece): (usize, &&[u8])| {
            let mut bytes = [0; PIECE];
            bytes[..piece.len()].copy_from_slice(piece);
            Message::STATUSTEXT(STATUSTEXT_DATA {
                severity,
                text: bytes.into(),
                id,
                chunk_seq: number as u8,
            })
        };
        pieces.iter().enumerate().map(message).collect()
    }
}

/// A text that somebody said.
#[derive(Clone, Debug, PartialEq)]
pub struct Text {
    /// Who.
    pub from: Address,
    /// How important it is.
    pub severity: MavSeverity,
    /// What; `[…]` for what was lost. Without control characters.
    pub words: String,
}

struct Pieces {
    severity: MavSeverity,
    by_number: BTreeMap<u8, [u8; PIECE]>,
    last_heard: Stamp,
}

/// Puts texts together.
#[derive(Default)]
pub struct Listener {
    texts: BTreeMap<(Address, u16), Pieces>,
}

impl Listener {
    /// Has heard nothing yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// A piece came; the text, if it is whole now.
    pub fn hear(&mut self, now: Stamp, from: Address, piece: &STATUSTEXT_DATA) -> Option<Text> {
        let mut bytes = [0; PIECE];
        let said: &[u8] = piece.text.as_ref();
        let length = said.len().min(PIECE);
        bytes[..length].copy_from_slice(&said[..length]);
        let severity = piece.severity;
        if piece.id == 0 {
            let words = readable(&bytes);
            return (!words.is_empty()).then_some(Text {
                from,
                severity,
                words,
            });
        }
        let key = (from, piece.id);
        if !self.texts.contains_key(&key) && self.texts.len() >= MAX_TEXTS {
            let oldest = self.texts.iter().min_by_key(|(_, p)| p.last_heard);
            if let Some(oldest) = oldest.map(|(key, _)| *key) {
                self.texts.remove(&oldest);
            }
        }
        let partial = self.texts.entry(key).or_insert_with(|| Pieces {
            severity,
            by_number: BTreeMap::new(),
            last_heard: now,
        });
        partial.last_heard = now;
        partial.by_number.insert(piece.chunk_seq, bytes);
        if partial.is_whole() {
            let whole = self.texts.remove(&key)?;
            return whole.text(from);
        }
        None
    }

    /// Lets time pass: texts of which the rest was lost.
    pub fn tick(&mut self, now: Stamp) -> Vec<Text> {
        let is_over = |partial: &Pieces| now.since(partial.last_heard) > PATIENCE;
        let over: Vec<(Address, u16)> = (self.texts.iter())
            .filter(|(_, partial)| is_over(partial))
            .map(|(key, _)| *key)
            .collect();
        let texts = over.into_iter().filter_map(|key| {
            let partial = self.texts.remove(&key)?;
            partial.text(key.0)
        });
        texts.collect()
    }
}

impl Pieces {
    fn is_whole(&self) -> bool {
        let in_order = (0..=u8::MAX).zip(self.by_number.keys());
        in_order.into_iter().all(|(number, key)| number == *key) && self.has_end()
    }

    fn has_end(&self) -> bool {
        (self.by_number.last_key_value())
            .is_some_and(|(number, piece)| piece.contains(&0) || *number == u8::MAX)
    }

    fn text(&self, from: Address) -> Option<Text> {
        let mut bytes = Vec::new();
        let mut next = 0;
        for (number, piece) in &self.by_number {
            if usize::from(*number) > next {
                bytes.extend(LOST.as_bytes());
            }
            next = usize::from(*number) + 1;
            let end = piece.iter().position(|byte| *byte == 0).unwrap_or(PIECE);
            bytes.extend(&piece[..end]);
        }
        if !self.has_end() {
            bytes.extend(LOST.as_bytes());
        }
        let words = readable(&bytes);
        (!words.is_empty()).then_some(Text {
            from,
            severity: self.severity,
            words,
        })
    }
}

/// The text up to its first zero; what is no UTF-8 is replaced, control characters are left out.
fn readable(text: &[u8]) -> String {
    let end = text.iter().position(|byte| *byte == 0);
    String::from_utf8_lossy(&text[..end.unwrap_or(text.len())])
        .chars()
        .filter(|c| !c.is_control())
        .collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const COPTER: Address = Address::new(1, 1);
    const SEVERITY: MavSeverity = MavSeverity::MAV_SEVERITY_WARNING;

    fn at(millis: u64) -> Stamp {
        Stamp::ZERO + Duration::from_millis(millis)
    }

    fn pieces(messages: Vec<Message>) -> Vec<STATUSTEXT_DATA> {
        let piece = |message| match message {
            Message::STATUSTEXT(piece) => piece,
            other => panic!("{other:?}"),
        };
        messages.into_iter().map(piece).collect()
    }

    #[test]
    fn a_short_text_is_one_message_without_an_id() {
        let said = pieces(Speaker::new().say(SEVERITY, &"x".repeat(50)));
        assert_eq!((said.len(), said[0].id), (1, 0));
        let heard = Listener::new().hear(at(0), COPTER, &said[0]);
        assert_eq!(heard.map(|text| text.words), Some("x".repeat(50)));
    }

    #[test]
    fn pieces_may_come_in_any_order() {
        let text = "Arm: Gyros inconsistent, and the rest of this sentence needs a second and a third message to be told.";
        let mut said = pieces(Speaker::new().say(SEVERITY, text));
        assert_eq!(said.len(), 3);
        said.reverse();
        let mut listener = Listener::new();
        let heard: Vec<Text> = said
            .iter()
            .filter_map(|p| listener.hear(at(0), COPTER, p))
            .collect();
        let expected = Text {
            from: COPTER,
            severity: SEVERITY,
            words: text.to_owned(),
        };
        assert_eq!(heard, [expected]);
    }

    #[test]
    fn what_was_lost_is_marked_after_a_second() {
        let text: String = ["a", "b", "c", "d"]
            .map(|letter| letter.repeat(50))
            .concat();
        let said = pieces(Speaker::new().say(SEVERITY, &text));
        assert_eq!(said.len(), 5, "the last is empty: it tells the end");
        let mut listener = Listener::new();
        for piece in [&said[0], &said[2]] {
            assert_eq!(listener.hear(at(0), COPTER, piece), None);
        }
        assert_eq!(listener.tick(at(1000)), []);
        let texts: Vec<String> = listener
            .tick(at(1001))
            .into_iter()
            .map(|t| t.words)
            .collect();
        assert_eq!(
            texts,
            [format!("{}[…]{}[…]", "a".repeat(50), "c".repeat(50))]
        );
        assert_eq!(listener.tick(at(5000)), []);
    }

    #[test]
    fn a_flood_of_unfinished_texts_is_bounded() {
        let mut listener = Listener::new();
        for id in 1..=u16::MAX {
            let piece = STATUSTEXT_DATA {
                severity: SEVERITY,
                text: "x".into(),
                id,
                chunk_seq: 9,
            };
            listener.hear(at(u64::from(id)), COPTER, &piece);
        }
        assert_eq!(listener.texts.len(), MAX_TEXTS);
    }

    proptest! {
        #[test]
        fn any_text_arrives_as_it_was_said(text in "\\PC{0,400}") {
            let said = pieces(Speaker::new().say(SEVERITY, &text));
            let mut listener = Listener::new();
            let heard: Vec<Text> = said.iter().filter_map(|p| listener.hear(at(0), COPTER, p)).collect();
            let heard: Vec<&str> = heard.iter().map(|text| text.words.as_str()).collect();
            let expected: Vec<&str> = Some(text.as_str()).filter(|text| !text.is_empty()).into_iter().collect();
            prop_assert_eq!(heard, expected);
        }

        #[test]
        fn any_pieces_never_panic(
            all in prop::collection::vec((any::<[u8; 32]>(), 0u16..3, any::<u8>()), 0..50)
        ) {
            let mut listener = Listener::new();
            for (bytes, id, chunk_seq) in all {
                let mut text = [0; PIECE];
                text[..32].copy_from_slice(&bytes);
                let piece = STATUSTEXT_DATA { severity: SEVERITY, text: text.into(), id, chunk_seq };
                listener.hear(at(0), COPTER, &piece);
            }
            listener.tick(at(2000));
        }
    }
}
