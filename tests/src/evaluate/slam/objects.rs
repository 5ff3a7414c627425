//! What a detector sees in the frames of a recording, from a file.
//!
//! ```text
//! stamp left top right bottom score class
//! ```
//!
//! One object a line: the stamp of its frame in seconds, its box in raw pixels, 0 to 1, and a name of COCO or of the
//! simulator, or before it one of `static`, `movable` and `moving`. `#` begins a comment. A frame of which there is no line, or
//! one with its stamp alone, shows nothing.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::Context as _;
use maps::time::Stamp;
use perception::Class;
use slam::{Mobility, Object};

/// By frame. Stamps agree to the millisecond: a detector may print fewer digits than a recording has.
pub(super) struct Objects(BTreeMap<u64, Vec<Object>>);

impl Objects {
    pub(super) fn read(path: &Path) -> anyhow::Result<Self> {
        let text = fs::read_to_string(path)
            .with_context(|| format!("cannot read the objects in {}", path.display()))?;
        let mut frames: BTreeMap<u64, Vec<Object>> = BTreeMap::new();
        for (index, line) in text.lines().enumerate() {
            let line = line.split('#').next().unwrap_or_default().trim();
            if line.is_empty() {
                continue;
            }
            let (at, object) = entry(line).with_context(|| {
                format!(
                    "{}, line {}: expected `stamp left top right bottom score class`, found {line:?}",
                    path.display(),
                    index + 1
                )
            })?;
            frames.entry(millis(at)).or_default().extend(object);
        }
        Ok(Self(frames))
    }

    /// What the frame of that stamp shows.
    pub(super) fn at(&self, at: Stamp) -> &[Object] {
        self.0.get(&millis(at)).map_or(&[], Vec::as_slice)
    }
}

fn millis(at: Stamp) -> u64 {
    (at.as_nanos() + 500_000) / 1_000_000
}

fn entry(line: &str) -> Option<(Stamp, Option<Object>)> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let stamp = |at: f64| Stamp::from_secs_f64(at).filter(|_| at.is_finite());
    if let [alone] = words[..] {
        return Some((stamp(alone.parse().ok()?)?, None));
    }
    // A class may be of two words: `traffic light`.
    let (numbers, class) = words.split_at_checked(6)?;
    let mut values = [0.0_f64; 6];
    for (value, word) in values.iter_mut().zip(numbers) {
        *value = word.parse().ok().filter(|n: &f64| n.is_finite())?;
    }
    let [at, left, top, right, bottom, score] = values;
    if class.is_empty() || right < left || bottom < top || !(0.0..=1.0).contains(&score) {
        return None;
    }
    let object = Object {
        mobility: mobility(&class.join(" ")),
        score: score as f32,
        bounds_px: [left, top, right, bottom].map(|n| n as f32),
        mask: None,
    };
    Some((stamp(at)?, Some(object)))
}

/// Detectors of ours say it in a word before the class, and COCO's classes have a table. The others are the simulator's.
fn mobility(class: &str) -> Mobility {
    let said = class.split(' ').next().unwrap_or_default();
    match said {
        "moving" => return Mobility::Dynamic,
        "movable" => return Mobility::Potential,
        "static" => return Mobility::Static,
        _ => {}
    }
    match class {
        "pedestrian" | "cyclist" | "rider" | "robot" => Mobility::Dynamic,
        _ => Class::named(class).map_or(Mobility::Static, |class| class.mobility().into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> anyhow::Result<Objects> {
        let file = tempfile::NamedTempFile::new().expect("a file");
        fs::write(file.path(), text).expect("written");
        Objects::read(file.path())
    }

    #[test]
    fn a_frame_has_the_objects_of_its_stamp_and_others_have_none() {
        let text = "# seen\n1.000033 10 20 30 40 0.9 person\n1.5 0 0 5 5 1 traffic light # red\n1.5 1 1 2 2 0.5 car\n1.5 1 1 2 2 0.5 moving person\n3\n";
        let objects = read(text).expect("sound");
        let at = |nanos| objects.at(Stamp::from_nanos(nanos));
        assert_eq!(at(1_000_400_000).len(), 1, "to the millisecond");
        assert_eq!(at(1_000_033_000)[0].mobility, Mobility::Dynamic);
        let bounds = at(1_000_033_000)[0].bounds_px.map(|c| c as i32);
        assert_eq!(bounds, [10, 20, 30, 40]);
        let kinds: Vec<_> = at(1_500_000_000).iter().map(|o| o.mobility).collect();
        assert_eq!(
            kinds,
            [Mobility::Static, Mobility::Potential, Mobility::Dynamic]
        );
        assert!(at(2_000_000_000).is_empty());
        assert!(at(3_000_000_000).is_empty(), "looked at, and nothing seen");
    }

    #[test]
    fn a_line_that_is_no_object_is_refused_with_its_number() {
        for line in [
            "1 0 0 5 5 0.5",
            "1 0 0 5 nan 0.5 car",
            "1 9 0 5 5 0.5 car",
            "1 0 0 5 5 1.5 car",
            "-1 0 0 5 5 0.5 car",
            "x",
        ] {
            let error = read(&format!("1 0 0 5 5 0.5 car\n{line}\n"))
                .err()
                .expect(line);
            assert!(error.to_string().contains("line 2"), "{line}: {error}");
        }
    }
}
