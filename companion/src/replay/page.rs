//! `report.html`: the report for people, one file without anything from elsewhere.
//!
//! Figures; the way of the camera from above, beside the truth where there is one; how far it is off over time; what each frame took;
//! some frames with what supports the pose and what was left out as moving; and the map.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use maps::frame::Camera;
use maps::picture::{self, Paint, Picture};
use maps::trajectory::Trajectory;
use maps::trajectory::evaluation::{Tool, aligned, pairs};
use maps::voxel::VoxelMap;

use super::chart::{Axes, Chart, Line, escaped};
use super::frames::{Row, Sample};
use crate::output::png;
use crate::report::Report;

const OURS: &str = "#0a6fb0";
const TRUE: &str = "#b8860b";

const STYLE: &str = "body{font:15px/1.45 sans-serif;color:#20242a;background:#fcfcfa;max-width:900px;margin:24px auto;\
padding:0 16px}h1{font-size:22px}h2{font-size:17px;margin:28px 0 6px}table{border-collapse:collapse}td{padding:2px 18px 2px 0}\
td:nth-child(2){text-align:right;font-variant-numeric:tabular-nums}svg{width:100%;font:12px sans-serif}svg text{fill:#20242a}\
.grid{stroke:#d8dcdf;fill:none}.line{fill:none;stroke-width:1.6;stroke-linejoin:round}.frames{display:flex;flex-wrap:wrap;\
gap:10px}figure{margin:0}figcaption,.none,.note{color:#5a626b;font-size:13px}img{max-width:100%}";

/// What the page is made of.
pub(super) struct Page<'a> {
    pub(super) report: &'a Report,
    /// Where the camera was, by all that is known in the end.
    pub(super) estimate: &'a Trajectory<Camera>,
    /// Where the recording says it was.
    pub(super) truth: Option<&'a Trajectory<Camera>>,
    pub(super) rows: &'a [Row],
    pub(super) samples: &'a [Sample],
    pub(super) map: &'a VoxelMap,
}

impl Page<'_> {
    /// The page.
    pub(super) fn html(&self) -> String {
        let name = escaped(&self.report.recording);
        let mut html = format!(
            "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" \
             content=\"width=device-width\"><title>{name}</title><style>{STYLE}</style></head><body><h1>Replay of {name}</h1>"
        );
        let mut section = |title: &str, content: &str| {
            // Writing to a string cannot fail.
            let _ = write!(html, "<h2>{title}</h2>{content}");
        };
        section("Figures", &self.figures());
        section("The camera's way from above", &self.way());
        if self.truth.is_some() {
            section("Distance from the truth", &self.errors());
        }
        section("Time for each frame", &self.times());
        section("What moves", &self.moving());
        section("Frames", &self.frames());
        section("The map", &self.map());
        html.push_str("</body></html>\n");
        html
    }

    fn figures(&self) -> String {
        let report = self.report;
        let (frames, share) = (report.frames, 100.0 * report.tracked_share);
        let mut rows = vec![
            ("Frames", frames.to_string()),
            ("Tracked", format!("{share:.1} %")),
        ];
        if let Some(ate_m) = report.ate_rmse_m {
            rows.push((
                "Absolute trajectory error, root mean square",
                format!("{ate_m:.4} m"),
            ));
        }
        rows.extend([
            (
                "Length of the estimated way",
                format!("{:.1} m", self.estimate.length_m()),
            ),
            (
                "Frames a second of tracking and mapping",
                format!("{:.1}", report.slam_fps),
            ),
            (
                "Time for a frame, median",
                format!("{:.1} ms", report.slam_p50_ms),
            ),
            (
                "Time for a frame, 99th percentile",
                format!("{:.1} ms", report.slam_p99_ms),
            ),
            ("Occupied voxels", report.map_voxels_occupied.to_string()),
            ("Edge of a voxel", format!("{} m", report.map_resolution_m)),
        ]);
        let rows = rows
            .iter()
            .map(|(name, value)| format!("<tr><td>{name}</td><td>{value}</td></tr>"));
        let mut table = format!("<table>{}</table>", rows.collect::<String>());
        if let Some(error) = &report.source_error {
            let _ = write!(
                table,
                "<p class=\"note\">The recording ended early: {}</p>",
                escaped(error)
            );
        } else if !report.source_finished {
            table.push_str(
                "<p class=\"note\">The replay was stopped before the end of the recording.</p>",
            );
        }
        table
    }

    /// The estimate where it fits the truth best; as it is, without truth to lay it over.
    fn laid_over(&self) -> Option<(&Trajectory<Camera>, Trajectory<Camera>)> {
        let truth = self.truth?;
        Some((truth, aligned(truth, self.estimate).ok()?))
    }

    fn way(&self) -> String {
        let from_above = |trajectory: &Trajectory<Camera>| -> Vec<[f64; 2]> {
            let places = trajectory
                .poses()
                .iter()
                .map(|(_, pose)| pose.translation().raw);
            places.map(|p| [p.x, p.y]).collect()
        };
        let over = self.laid_over();
        let mut lines = Vec::new();
        if let Some((truth, _)) = &over {
            let ends = self
                .estimate
                .poses()
                .first()
                .zip(self.estimate.poses().last());
            let during = truth.poses().iter().filter(|(at, _)| {
                ends.is_some_and(|((first, _), (last, _))| (*first..=*last).contains(at))
            });
            let places = during.map(|(_, pose)| pose.translation().raw);
            lines.push(Line {
                name: "truth",
                color: TRUE,
                points: places.map(|p| [p.x, p.y]).collect(),
            });
        }
        let estimate = over.as_ref().map_or(self.estimate, |(_, aligned)| aligned);
        lines.push(Line {
            name: "estimate",
            color: OURS,
            points: from_above(estimate),
        });
        let chart = Chart {
            across: if over.is_some() {
                "x m, of the truth"
            } else {
                "east m"
            },
            up: if over.is_some() { "y m" } else { "north m" },
            axes: Axes::Plane,
            lines,
        };
        let note = if over.is_some() {
            "<p class=\"note\">The estimate is turned and moved to where it fits the truth best.</p>"
        } else {
            ""
        };
        chart.svg() + note
    }

    fn errors(&self) -> String {
        let points = self.laid_over().map_or_else(Vec::new, |(truth, over)| {
            let start = over.poses().first().map(|(at, _)| *at);
            (pairs(truth, &over, Tool::TumBenchmark).into_iter())
                .filter_map(|(i, j)| {
                    let ((_, true_pose), (at, pose)) = (truth.poses()[i], over.poses()[j]);
                    let distance = (true_pose.translation() - pose.translation()).norm();
                    Some([at.since(start?).as_secs_f64(), distance])
                })
                .collect()
        });
        let chart = Chart {
            across: "time s",
            up: "distance m",
            axes: Axes::OverTime,
            lines: vec![Line {
                name: "after alignment",
                color: OURS,
                points,
            }],
        };
        chart.svg()
    }

    fn over_time(&self, name: &str, up: &str, of: impl Fn(&Row) -> f64) -> String {
        let start = self.rows.first().map(|row| row.at);
        let points = self.rows.iter().filter_map(|row| {
            let at = row.at.since(start?);
            Some([at.as_secs_f64(), of(row)])
        });
        let chart = Chart {
            across: "time s",
            up,
            axes: Axes::OverTime,
            lines: vec![Line {
                name,
                color: OURS,
                points: points.collect(),
            }],
        };
        chart.svg()
    }

    fn times(&self) -> String {
        self.over_time("tracking and mapping", "time ms", Row::took_ms)
    }

    fn moving(&self) -> String {
        self.over_time("share of what is seen", "share %", |row| {
            100.0 * row.moving_share
        })
    }

    fn frames(&self) -> String {
        let start = self.rows.first().map(|row| row.at);
        let mut html = String::from(
            "<p class=\"note\">Green: points that support the pose. Red: points left out, on what is taken for moving, which is reddened.</p>\
             <div class=\"frames\">",
        );
        for sample in self.samples {
            let picture = Picture {
                width: sample.size[0],
                height: sample.size[1],
                rgb: sample.rgb.as_flattened().to_vec(),
            };
            let at_s = start.map_or(0.0, |start| sample.at.since(start).as_secs_f64());
            let _ = write!(
                html,
                "<figure>{}<figcaption>{at_s:.1} s</figcaption></figure>",
                image(&picture)
            );
        }
        html + "</div>"
    }

    fn map(&self) -> String {
        let request = picture::Request {
            paint: Paint::Color,
            title: "Map in colours of the camera",
            width: 1200,
            height: 800,
            ceiling_m: None,
        };
        let colored = picture::sheet(self.map, &request);
        let drawn = colored.or_else(|_| {
            let by_height = picture::Request {
                paint: Paint::Height,
                title: "Map by height",
                ..request
            };
            picture::sheet(self.map, &by_height)
        });
        match drawn {
            Ok(picture) => image(&picture),
            Err(error) => format!("<p class=\"none\">{}</p>", escaped(&error.to_string())),
        }
    }
}

fn image(picture: &Picture) -> String {
    let mut bytes = Vec::new();
    match png(picture, &mut bytes) {
        Ok(()) => format!(
            "<img width=\"{}\" height=\"{}\" alt=\"\" src=\"data:image/png;base64,{}\">",
            picture.width,
            picture.height,
            STANDARD.encode(bytes)
        ),
        Err(error) => format!("<p class=\"none\">{}</p>", escaped(&error.to_string())),
    }
}

#[cfg(test)]
mod tests;
