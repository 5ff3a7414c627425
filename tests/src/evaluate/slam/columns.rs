//! Files of numbers beside the pictures of a simulated flight: so many a line, with spaces between them.

use std::fs;
use std::path::Path;

use anyhow::Context as _;

/// What each line says; `kind` is what a line should be, for who reads the error.
pub(super) fn read<const N: usize, T>(
    path: &Path,
    kind: &str,
    line: impl Fn([f64; N]) -> Option<T>,
) -> anyhow::Result<Vec<T>> {
    let text =
        fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    let numbers = |line: &str| -> Option<[f64; N]> {
        let words: Option<Vec<f64>> = line.split(' ').map(|word| word.parse().ok()).collect();
        words?.try_into().ok()
    };
    let lines = text.lines().map(|text| line(numbers(text)?));
    let lines: Option<Vec<T>> = lines.collect();
    lines.with_context(|| format!("{} has a line that is no {kind}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_so_many_numbers_are_read_and_others_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("pairs.txt");
        let pairs = |text: &str| {
            fs::write(&path, text).expect("written");
            read(&path, "pair", |[a, b]: [f64; 2]| Some(a + b))
        };
        assert_eq!(pairs("1 2\n3 4.5\n").expect("two pairs"), [3.0, 7.5]);
        for wrong in ["1 2\n3\n", "1 2 3\n", "1 b\n"] {
            let error = pairs(wrong).expect_err(wrong).to_string();
            assert!(
                error.contains("pairs.txt") && error.contains("no pair"),
                "{error}"
            );
        }
    }
}
