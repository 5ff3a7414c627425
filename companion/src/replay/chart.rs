//! Charts as SVG: lines over axes with round numbers, and a legend.

use std::fmt::Write as _;

/// A line of a chart.
pub(super) struct Line<'a> {
    pub(super) name: &'a str,
    /// As CSS has it.
    pub(super) color: &'a str,
    /// What cannot be drawn, because it is not finite, is left out.
    pub(super) points: Vec<[f64; 2]>,
}

/// What the axes show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Axes {
    /// A quantity over time: each axis has its own scale, the upward one begins at zero.
    OverTime,
    /// A plane: a metre is as long along both.
    Plane,
}

/// A chart with the names of its axes, units included.
pub(super) struct Chart<'a> {
    pub(super) across: &'a str,
    pub(super) up: &'a str,
    pub(super) axes: Axes,
    pub(super) lines: Vec<Line<'a>>,
}

const WIDTH: f64 = 760.0;
/// Room for numbers and names.
const LEFT: f64 = 64.0;
const BELOW: f64 = 44.0;
const ABOVE: f64 = 26.0;
const RIGHT: f64 = 14.0;
/// No line needs more corners than this on so few pixels.
const MOST_POINTS: usize = 1500;

/// Where values lie on paper.
struct Scale {
    low: [f64; 2],
    per_unit: [f64; 2],
    height: f64,
}

impl Scale {
    fn x(&self, value: f64) -> f64 {
        LEFT + (value - self.low[0]) * self.per_unit[0]
    }

    fn y(&self, value: f64) -> f64 {
        self.height - BELOW - (value - self.low[1]) * self.per_unit[1]
    }
}

impl Chart<'_> {
    /// The chart as an `<svg>` element; where there is nothing to draw, a line that says so.
    pub(super) fn svg(&self) -> String {
        let Some([low, high]) = self.bounds() else {
            return "<p class=\"none\">nothing to draw</p>".to_owned();
        };
        let scale = self.scale(low, high);
        let mut svg = String::new();
        // Writing to a string cannot fail.
        let _ = write!(
            svg,
            "<svg viewBox=\"0 0 {WIDTH} {:.0}\" role=\"img\">",
            scale.height
        );
        self.draw_axes(&scale, high, &mut svg);
        for line in &self.lines {
            draw_line(line, &scale, &mut svg);
        }
        self.draw_legend(&mut svg);
        svg.push_str("</svg>");
        svg
    }

    fn bounds(&self) -> Option<[[f64; 2]; 2]> {
        let points = self.lines.iter().flat_map(|line| &line.points);
        let mut finite = points.filter(|p| p.iter().all(|c| c.is_finite()));
        let first = *finite.next()?;
        let (mut low, mut high) = (first, first);
        for point in finite {
            for i in 0..2 {
                low[i] = low[i].min(point[i]);
                high[i] = high[i].max(point[i]);
            }
        }
        match self.axes {
            Axes::OverTime => low[1] = low[1].min(0.0),
            Axes::Plane => {
                let margin = 0.05 * (high[0] - low[0]).max(high[1] - low[1]).max(0.1);
                low = low.map(|c| c - margin);
                high = high.map(|c| c + margin);
            }
        }
        // What stands still still has an axis.
        for i in 0..2 {
            high[i] = high[i].max(low[i] + 1e-3);
        }
        Some([low, high])
    }

    fn scale(&self, low: [f64; 2], high: [f64; 2]) -> Scale {
        let span = [high[0] - low[0], high[1] - low[1]];
        let wide = WIDTH - LEFT - RIGHT;
        match self.axes {
            Axes::OverTime => {
                let height = 240.0;
                let tall = height - BELOW - ABOVE;
                Scale {
                    low,
                    per_unit: [wide / span[0], tall / (1.05 * span[1])],
                    height,
                }
            }
            Axes::Plane => {
                let per_unit = (wide / span[0]).min(520.0 / span[1]);
                let height = (span[1] * per_unit).max(120.0) + BELOW + ABOVE;
                Scale {
                    low,
                    per_unit: [per_unit; 2],
                    height,
                }
            }
        }
    }

    fn draw_axes(&self, scale: &Scale, high: [f64; 2], svg: &mut String) {
        let bottom = scale.height - BELOW;
        let (step_x, step_y) = match self.axes {
            Axes::OverTime => (
                round_step((high[0] - scale.low[0]) / 8.0),
                round_step((high[1] - scale.low[1]) / 4.0),
            ),
            Axes::Plane => {
                let widest = (high[0] - scale.low[0]).max(high[1] - scale.low[1]);
                (round_step(widest / 8.0), round_step(widest / 8.0))
            }
        };
        let right = LEFT + (high[0] - scale.low[0]) * scale.per_unit[0];
        for value in ticks(scale.low[0], high[0], step_x) {
            let x = scale.x(value);
            let _ = write!(
                svg,
                "<path class=\"grid\" d=\"M{x:.1} {ABOVE}V{bottom:.1}\"/><text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                bottom + 16.0,
                number(value, step_x)
            );
        }
        for value in ticks(scale.low[1], high[1], step_y) {
            let y = scale.y(value);
            let _ = write!(
                svg,
                "<path class=\"grid\" d=\"M{LEFT} {y:.1}H{right:.1}\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                LEFT - 6.0,
                y + 4.0,
                number(value, step_y)
            );
        }
        let middle = f64::midpoint(ABOVE, bottom);
        let _ = write!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\
             <text transform=\"translate(14 {middle:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            f64::midpoint(LEFT, right),
            bottom + 36.0,
            escaped(self.across),
            escaped(self.up)
        );
    }

    fn draw_legend(&self, svg: &mut String) {
        let mut x = LEFT;
        for line in &self.lines {
            let _ = write!(
                svg,
                "<path d=\"M{x:.1} 12h18\" stroke=\"{}\" stroke-width=\"3\"/><text x=\"{:.1}\" y=\"16\">{}</text>",
                line.color,
                x + 24.0,
                escaped(line.name)
            );
            x += 44.0 + 7.0 * line.name.chars().count() as f64;
        }
    }
}

fn draw_line(line: &Line<'_>, scale: &Scale, svg: &mut String) {
    let every = line.points.len().div_ceil(MOST_POINTS).max(1);
    let last = line.points.len().saturating_sub(1);
    let mut path = String::new();
    for (index, point) in line.points.iter().enumerate() {
        if (index % every != 0 && index != last) || !point.iter().all(|c| c.is_finite()) {
            continue;
        }
        let step = if path.is_empty() { 'M' } else { 'L' };
        let _ = write!(
            path,
            "{step}{:.1} {:.1}",
            scale.x(point[0]),
            scale.y(point[1])
        );
    }
    let _ = write!(
        svg,
        "<path class=\"line\" d=\"{path}\" stroke=\"{}\"/>",
        line.color
    );
}

/// The least of 1, 2 and 5 times a power of ten that is not below.
fn round_step(least: f64) -> f64 {
    let power = 10.0_f64.powf(least.max(1e-9).log10().floor());
    let times = [1.0, 2.0, 5.0]
        .into_iter()
        .find(|times| times * power >= least);
    times.unwrap_or(10.0) * power
}

fn ticks(low: f64, high: f64, step: f64) -> impl Iterator<Item = f64> {
    let first = (low / step - 1e-9).ceil();
    let count = ((high / step + 1e-9).floor() - first).clamp(-1.0, 100.0);
    (0..=count as i64)
        .filter(move |_| count >= 0.0)
        .map(move |i| (first + i as f64) * step)
}

/// As many digits as the step has.
fn number(value: f64, step: f64) -> String {
    let digits = (-step.log10().floor()).clamp(0.0, 6.0) as usize;
    let text = format!("{value:.digits$}");
    // Not `-0`.
    if text
        .trim_start_matches('-')
        .chars()
        .all(|c| c == '0' || c == '.')
    {
        text.trim_start_matches('-').to_owned()
    } else {
        text
    }
}

/// Text as HTML and SVG have it.
pub(super) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(axes: Axes, points: Vec<[f64; 2]>) -> String {
        let line = Line {
            name: "a & b",
            color: "#123456",
            points,
        };
        Chart {
            across: "time s",
            up: "error m",
            axes,
            lines: vec![line],
        }
        .svg()
    }

    #[test]
    fn steps_and_numbers_are_round() {
        for (least, step) in [
            (0.013, 0.02),
            (0.7, 1.0),
            (2.0, 2.0),
            (30.0, 50.0),
            (6.0, 10.0),
        ] {
            assert!((round_step(least) - step).abs() < 1e-9, "{least}");
        }
        assert_eq!(number(-0.0001, 0.02), "0.00");
        assert_eq!(number(1.5, 0.5), "1.5");
        let found: Vec<f64> = ticks(-0.1, 0.45, 0.2).collect();
        assert!(found.len() == 3 && found[0].abs() < 1e-9, "{found:?}");
        assert_eq!(ticks(0.3, 0.4, 1.0).count(), 0);
    }

    #[test]
    fn what_is_not_finite_is_left_out_and_nothing_is_said_to_be_nothing() {
        let drawn = chart(
            Axes::OverTime,
            vec![
                [0.0, 1.0],
                [f64::NAN, 2.0],
                [2.0, f64::INFINITY],
                [3.0, 4.0],
            ],
        );
        assert!(!drawn.contains("NaN") && !drawn.contains("inf"), "{drawn}");
        assert!(drawn.contains("a &amp; b") && drawn.matches('L').count() >= 1);
        assert!(chart(Axes::Plane, Vec::new()).contains("nothing to draw"));
        assert!(chart(Axes::Plane, vec![[f64::NAN, 0.0]]).contains("nothing to draw"));
        let still = chart(Axes::Plane, vec![[1.0, 1.0]; 3]);
        assert!(!still.contains("NaN"), "{still}");
    }

    #[test]
    fn a_metre_is_as_long_along_both_axes_of_a_plane() {
        let line = |points| Line {
            name: "",
            color: "",
            points,
        };
        let chart = Chart {
            across: "",
            up: "",
            axes: Axes::Plane,
            lines: vec![line(vec![[0.0, 0.0], [10.0, 3.0]])],
        };
        let [low, high] = chart.bounds().expect("two points");
        let scale = chart.scale(low, high);
        let wide = scale.x(1.0) - scale.x(0.0);
        let tall = scale.y(0.0) - scale.y(1.0);
        assert!((wide - tall).abs() < 1e-9, "{wide} and {tall}");
        assert!(scale.y(high[1]) >= ABOVE - 1e-9 && scale.x(high[0]) <= WIDTH);
    }

    #[test]
    fn long_lines_are_thinned_out() {
        let points = (0..100_000).map(|i| [f64::from(i), 1.0]).collect();
        let drawn = chart(Axes::OverTime, points);
        assert!(drawn.len() < 40_000, "{}", drawn.len());
    }
}
