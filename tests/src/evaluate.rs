//! `evaluate`: every table of figures, each by one suite that anyone can run again.
//!
//! A suite measures and returns [`Figures`], a list of numbers with fixed keys, and a text for people. [`write()`] keeps
//! the figures with the commit and the command that made them:
//!
//! ```text
//! DIR/SUITE.json   { "suite", "commit", "command", "figures": { "<case>/<method>/<metric>": number } }
//! ```

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{fs, io};

use anyhow::Context as _;
use clap::ValueEnum;
use serde::Serialize;

mod figures;
mod link;
mod map_update;
mod planning;
mod sitl;
mod slam;
mod table;

pub use self::slam::{Options as SlamOptions, run_job as run_slam_job};
pub use figures::{FigureError, Figures};
pub use table::Table;

/// What can be measured: one module each.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Suite {
    /// Paths of a ground vehicle against A\* with smoothing.
    Planning,
    /// Rules that fold the evidence of several sources into one map
    MapUpdate,
    /// The object transport over bad links
    Link,
    /// The simulated world against the paper's scenes
    Sitl,
    /// The SLAM on recordings and over simulated streets
    Slam,
}

/// What a suite is asked to do.
pub struct Request<'a> {
    /// The first random seed; the suite's own if `None`.
    pub seed: Option<u64>,
    /// The folder of recordings, for suites that need one.
    pub data: Option<&'a Path>,
    /// Where results go: beside its figures a suite may leave what they were made of.
    pub out: &'a Path,
    /// What is asked of the SLAM's suite.
    pub slam: &'a SlamOptions,
    /// Shows people how far it has come.
    pub say: &'a mut dyn FnMut(&str),
}

/// What a suite found.
pub struct Outcome {
    /// The numbers, for programs.
    pub figures: Figures,
    /// The tables and what there is to say about them, for people.
    pub text: String,
}

impl Suite {
    /// As the command line and the file's name have it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Planning => "planning",
            Self::MapUpdate => "map-update",
            Self::Link => "link",
            Self::Sitl => "sitl",
            Self::Slam => "slam",
        }
    }

    /// Measures. Takes minutes.
    pub fn run(self, request: &mut Request<'_>) -> anyhow::Result<Outcome> {
        match self {
            Self::Planning => planning::run(request),
            Self::MapUpdate => map_update::run(request),
            Self::Link => link::run(request),
            Self::Sitl => sitl::run(request),
            Self::Slam => slam::run(request),
        }
    }
}

/// The file a suite leaves behind.
#[derive(Serialize)]
struct Document<'a> {
    suite: &'a str,
    commit: String,
    command: &'a str,
    figures: &'a Figures,
}

/// Writes `folder/SUITE.json` as a whole or not at all, and returns its path.
pub fn write(
    folder: &Path,
    suite: Suite,
    command: &str,
    figures: &Figures,
) -> anyhow::Result<PathBuf> {
    write_document(
        folder,
        &Document {
            suite: suite.name(),
            commit: commit(),
            command,
            figures,
        },
    )
}

const REMEDY: &str = "name another folder with --out";

/// Makes the folder for figures, unless it is there.
pub fn make_folder(folder: &Path) -> anyhow::Result<()> {
    fs::create_dir_all(folder)
        .with_context(|| format!("cannot make {}: {REMEDY}", folder.display()))
}

fn write_document(folder: &Path, document: &Document<'_>) -> anyhow::Result<PathBuf> {
    make_folder(folder)?;
    let file = folder.join(format!("{}.json", document.suite));
    let text = serde_json::to_string_pretty(document).context("cannot write figures as JSON")?;
    let partial = file.with_extension("json.partial");
    fs::write(&partial, text + "\n")
        .and_then(|()| fs::rename(&partial, &file))
        .with_context(|| format!("cannot write {}: {REMEDY}", file.display()))?;
    Ok(file)
}

/// The command as somebody would type it to run the same again: the program without its folder, then its arguments.
pub fn command_line(arguments: impl IntoIterator<Item = OsString>) -> String {
    let mut arguments = arguments.into_iter();
    let program = arguments.next().map(PathBuf::from).unwrap_or_default();
    let program = program.file_name().unwrap_or_default().to_owned();
    let quoted = |word: OsString| {
        let word = word.to_string_lossy().into_owned();
        let is_plain = |c: char| c.is_alphanumeric() || "-_./=:,+@".contains(c);
        if !word.is_empty() && word.chars().all(is_plain) {
            word
        } else {
            format!("'{}'", word.replace('\'', r"'\''"))
        }
    };
    std::iter::once(program)
        .chain(arguments)
        .map(quoted)
        .collect::<Vec<_>>()
        .join(" ")
}

/// The commit checked out in the current folder, `-dirty` if files differ from it; `unknown` where git cannot tell.
fn commit() -> String {
    let git = |arguments: &[&str]| -> io::Result<Option<String>> {
        let output = Command::new("git").args(arguments).output()?;
        let text = String::from_utf8_lossy(&output.stdout).trim().to_owned();
        Ok(output.status.success().then_some(text))
    };
    let describe = [
        "describe",
        "--always",
        "--dirty",
        "--abbrev=40",
        "--exclude=*",
    ];
    match git(&describe) {
        Ok(Some(commit)) if !commit.is_empty() => commit,
        // Without git there is no commit to name, and the figures are no worse for it.
        Ok(_) | Err(_) => "unknown".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    #[test]
    fn a_document_says_what_made_its_figures() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let mut figures = Figures::default();
        figures.set(&["b", "tandem", "f1"], 0.5).expect("new");
        figures.set(&["a", "tandem", "f1"], 1.0).expect("new");
        let document = Document {
            suite: "map-update",
            commit: commit(),
            command: "evaluate map-update --out x",
            figures: &figures,
        };
        let file = write_document(&folder.path().join("made/anew"), &document).expect("written");
        assert!(file.ends_with("made/anew/map-update.json"));
        let text = fs::read_to_string(&file).expect("readable");
        let read: Value = serde_json::from_str(&text).expect("JSON");
        assert_eq!(read["suite"], "map-update");
        assert_eq!(read["command"], "evaluate map-update --out x");
        assert_eq!(
            read["figures"],
            json!({ "b/tandem/f1": 0.5, "a/tandem/f1": 1.0 })
        );
        let [b, a] = ["b/tandem", "a/tandem"].map(|key| text.find(key).expect("it is there"));
        assert!(b < a, "in the order of the suite, not of the alphabet");
        let left: Vec<_> = fs::read_dir(file.parent().expect("a folder"))
            .expect("readable")
            .collect();
        assert_eq!(left.len(), 1, "nothing partial is left");
    }

    #[test]
    fn a_folder_that_cannot_be_is_named_with_a_remedy() {
        let file = tempfile::NamedTempFile::new().expect("a temporary file");
        let document = Document {
            suite: "map-update",
            commit: String::new(),
            command: "",
            figures: &Figures::default(),
        };
        let error = write_document(file.path(), &document).expect_err("it is a file");
        let expected = format!(
            "cannot make {}: name another folder with --out",
            file.path().display()
        );
        assert_eq!(error.to_string(), expected);
    }

    #[test]
    fn a_command_line_can_be_typed_again() {
        let words = ["/somewhere/evaluate", "map-update", "--out", "it's here"];
        assert_eq!(
            command_line(words.map(OsString::from)),
            r"evaluate map-update --out 'it'\''s here'"
        );
    }
}
