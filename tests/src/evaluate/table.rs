//! A table for people.

use std::fmt;

/// Rows of text under a header; the first column reads from the left, the others from the right.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Table {
    /// What it shows.
    pub title: String,
    /// The names of the columns.
    pub header: Vec<String>,
    /// The cells; a short row is filled up with empty ones.
    pub rows: Vec<Vec<String>>,
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines = || std::iter::once(&self.header).chain(&self.rows);
        let columns = lines().map(Vec::len).max().unwrap_or(0);
        let cell = |line: &'_ Vec<String>, column: usize| -> String {
            line.get(column).cloned().unwrap_or_default()
        };
        let widths: Vec<_> = (0..columns)
            .map(|column| lines().map(|line| cell(line, column).chars().count()).max())
            .map(Option::unwrap_or_default)
            .collect();
        writeln!(f, "{}", self.title)?;
        for line in lines() {
            let cells = widths.iter().enumerate().map(|(column, &width)| {
                let cell = cell(line, column);
                if column == 0 {
                    format!("  {cell:<width$}")
                } else {
                    format!("  {cell:>width$}")
                }
            });
            let text: String = cells.collect();
            writeln!(f, "{}", text.trim_end())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_as_wide_as_their_widest_cell() {
        let row = |cells: &[&str]| cells.iter().map(|&cell| cell.to_owned()).collect();
        let table = Table {
            title: "Two methods".to_owned(),
            header: row(&["", "f1", "±"]),
            rows: vec![row(&["a longer name", "0.5"]), row(&["b", "0.25", "0.1"])],
        };
        let expected = "\
Two methods
                   f1    ±
  a longer name   0.5
  b              0.25  0.1
";
        assert_eq!(table.to_string(), expected);
    }
}
