//! Benchmark maps and scenarios as their authors publish them.
//!
//! - `.map` and `.scen` of the `MovingAI` laboratory: one character a cell, north up; `.`, `G` and `S` are free, all else is
//!   an obstacle (N. Sturtevant, *Benchmarks for grid-based pathfinding*, 2012).
//! - `.yaml` and `.pgm` of the ROS map server, as Nav2 ships them: occupied and free by two thresholds, unknown between.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use maps::traversability::{Cell, Traversability};

/// Level ground at no extra cost.
const FLAT: Cell = Cell::Drivable {
    height_m: 0.0,
    cost: 0.0,
};

/// A picture of a map, its first row in the north.
pub(super) struct Raster {
    width: usize,
    cells: Vec<Cell>,
    /// Edge of a cell, where the file says so.
    pub(super) cell_m: Option<f64>,
}

/// A start and a goal, as cells of a raster (column, row from the north).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Scenario {
    pub(super) start: [usize; 2],
    pub(super) goal: [usize; 2],
}

impl Raster {
    pub(super) fn rows(&self) -> usize {
        self.cells.len() / self.width
    }

    /// The raster as a grid whose cells have edges of `cell_m / split` and whose south-western corner is the origin.
    pub(super) fn grid(&self, cell_m: f64, split: usize) -> anyhow::Result<Traversability> {
        let cells = self
            .cells
            .chunks_exact(self.width)
            .rev()
            .flat_map(|row| {
                let line: Vec<Cell> = row
                    .iter()
                    .flat_map(|&cell| std::iter::repeat_n(cell, split))
                    .collect();
                std::iter::repeat_n(line, split).flatten()
            })
            .collect();
        let grid = Traversability::from_cells(
            [0.0, 0.0],
            cell_m / split as f64,
            self.width * split,
            cells,
        )?;
        Ok(grid)
    }

    /// The same map in cells `by` times as wide: blocked where anything in them is, else unknown where anything is.
    pub(super) fn coarser(&self, by: usize) -> Self {
        let (width, rows) = (self.width / by, self.rows() / by);
        let worst = |x: usize, y: usize| {
            let within =
                (0..by * by).map(|i| self.cells[(y * by + i / by) * self.width + x * by + i % by]);
            within.reduce(worse).unwrap_or(Cell::Unknown)
        };
        Self {
            width,
            cells: (0..width * rows)
                .map(|i| worst(i % width, i / width))
                .collect(),
            cell_m: self.cell_m.map(|m| m * by as f64),
        }
    }

    /// A `.map` file.
    pub(super) fn movingai(path: &Path) -> anyhow::Result<Self> {
        let text =
            fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
        let mut lines = text.lines();
        let mut field = |name: &str| -> anyhow::Result<usize> {
            let line = lines
                .find(|line| line.starts_with(name))
                .with_context(|| format!("{}: no line \"{name} N\"", path.display()))?;
            Ok(line[name.len()..].trim().parse()?)
        };
        let (height, width) = (field("height")?, field("width")?);
        let cells: Vec<Cell> = lines
            .skip_while(|line| line.trim() != "map")
            .skip(1)
            .flat_map(str::bytes)
            .map(|byte| match byte {
                b'.' | b'G' | b'S' => FLAT,
                _ => Cell::Blocked,
            })
            .collect();
        ensure!(
            width > 0 && cells.len() == width * height,
            "{}: {} cells instead of {width} x {height}",
            path.display(),
            cells.len()
        );
        Ok(Self {
            width,
            cells,
            cell_m: None,
        })
    }

    /// A map of the ROS map server by its `.yaml` file.
    pub(super) fn nav2(yaml: &Path) -> anyhow::Result<Self> {
        let text =
            fs::read_to_string(yaml).with_context(|| format!("cannot read {}", yaml.display()))?;
        let value = |key: &str| -> anyhow::Result<&str> {
            text.lines()
                .find_map(|line| line.strip_prefix(key)?.strip_prefix(':'))
                .map(str::trim)
                .with_context(|| format!("{}: no key {key}", yaml.display()))
        };
        let image: PathBuf = yaml.with_file_name(value("image")?);
        let cell_m: f64 = value("resolution")?.parse()?;
        let negated = value("negate")? == "1";
        let (occupied, free): (f64, f64) = (
            value("occupied_thresh")?.parse()?,
            value("free_thresh")?.parse()?,
        );
        let (width, pixels) = pgm(&image)?;
        let cells = pixels
            .iter()
            .map(|&pixel| {
                let bright = f64::from(pixel) / 255.0;
                let probability = if negated { bright } else { 1.0 - bright };
                if probability > occupied {
                    Cell::Blocked
                } else if probability < free {
                    FLAT
                } else {
                    Cell::Unknown
                }
            })
            .collect();
        Ok(Self {
            width,
            cells,
            cell_m: Some(cell_m),
        })
    }
}

fn worse(a: Cell, b: Cell) -> Cell {
    match (a, b) {
        (Cell::Blocked, _) | (_, Cell::Blocked) => Cell::Blocked,
        (Cell::Unknown, _) | (_, Cell::Unknown) => Cell::Unknown,
        (Cell::Drivable { .. }, Cell::Drivable { .. }) => a,
    }
}

/// Width and pixels of a binary PGM file of one byte a pixel.
fn pgm(path: &Path) -> anyhow::Result<(usize, Vec<u8>)> {
    let bytes = fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let mut fields = Vec::new();
    let mut at = 0;
    while fields.len() < 4 {
        let begin = at
            + (bytes[at..].iter())
                .take_while(|b| b.is_ascii_whitespace())
                .count();
        let comment = bytes.get(begin) == Some(&b'#');
        let length = bytes[begin..]
            .iter()
            .take_while(|b| {
                if comment {
                    **b != b'\n'
                } else {
                    !b.is_ascii_whitespace()
                }
            })
            .count();
        if length == 0 {
            bail!("{}: the header ends early", path.display());
        }
        if !comment {
            fields.push(std::str::from_utf8(&bytes[begin..begin + length])?);
        }
        at = begin + length;
    }
    let (width, height): (usize, usize) = (fields[1].parse()?, fields[2].parse()?);
    let count = width.saturating_mul(height);
    ensure!(
        fields[0] == "P5" && fields[3] == "255" && count > 0 && bytes.len() == at + 1 + count,
        "{}: not a binary PGM of {width} x {height} bytes",
        path.display()
    );
    Ok((width, bytes[at + 1..].to_vec()))
}

/// The scenarios of a `.scen` file, in its order.
pub(super) fn scenarios(path: &Path) -> anyhow::Result<Vec<Scenario>> {
    let text =
        fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    (text.lines().skip(1))
        .filter(|line| !line.trim().is_empty())
        .map(|line| {
            let mut numbers = line.split_whitespace().skip(4).map(str::parse::<usize>);
            let mut next = || {
                numbers
                    .next()
                    .with_context(|| format!("{}: a short line: {line}", path.display()))?
                    .with_context(|| format!("{}: {line}", path.display()))
            };
            Ok(Scenario {
                start: [next()?, next()?],
                goal: [next()?, next()?],
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(name: &str, bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join(name);
        fs::write(&path, bytes).expect("a file");
        (folder, path)
    }

    #[test]
    fn a_movingai_map_is_read_north_up_and_split() {
        let (_folder, path) = written("a.map", b"type octile\nheight 2\nwidth 3\nmap\n.@G\nT..\n");
        let grid = Raster::movingai(&path)
            .expect("a map")
            .grid(0.4, 2)
            .expect("a grid");
        assert_eq!(grid.size(), (6, 4));
        assert!((grid.resolution_m() - 0.2).abs() < 1e-12);
        assert_eq!(
            grid.cell(0.1, 0.1),
            Cell::Blocked,
            "the T in the south-west"
        );
        assert_eq!(grid.cell(0.1, 0.7), FLAT);
        assert_eq!(grid.cell(0.5, 0.7), Cell::Blocked, "the @ in the north");
    }

    #[test]
    fn a_nav2_map_has_three_kinds_of_cells_and_becomes_coarser_for_the_worse() {
        let (folder, path) = written(
            "a.pgm",
            b"P5\n# a comment\n4 2 255\n\xfe\xfe\xfe\xcd\xfe\x00\xfe\xfe",
        );
        let yaml = folder.path().join("a.yaml");
        let text = "image: a.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.1\n";
        fs::write(&yaml, text).expect("a file");
        let raster = Raster::nav2(&yaml).expect("a map");
        assert_eq!(raster.cells[..4], [FLAT, FLAT, FLAT, Cell::Unknown]);
        assert_eq!(raster.coarser(2).cells, [Cell::Blocked, Cell::Unknown]);
        drop(path);
    }

    #[test]
    fn damaged_files_are_refused() {
        let (_folder, path) = written("a.map", b"type octile\nheight 2\nwidth 3\nmap\n.@\n");
        assert!(Raster::movingai(&path).is_err());
        let (_folder, path) = written("a.pgm", b"P5 9");
        assert!(pgm(&path).is_err());
        let (_folder, path) = written("a.scen", b"version 1\n0 a.map 3 2 0\n");
        assert!(scenarios(&path).is_err());
    }
}
