//! `evaluate map-update`: which rule makes the best map of the same evidence.
//!
//! Three simulated streets change after their prior map was made and while a drone and a ground vehicle look at them. Every
//! rule gets the same observations, and its own best parameters, fitted with the same number of tries to other streets of
//! the same kinds. The layout is that of the paper's Table 10.

use anyhow::{Context as _, ensure};
use maps::metrics::Tolerance;

use super::{Figures, Outcome, Request, Table};
use fit::fit;
use judge::{Judge, Score};
use rules::{Ablation, Method};
use scenes::Scene;
use sensors::Recording;

mod fit;
mod judge;
mod noise;
mod rules;
mod scenes;
mod sensors;
mod world;

/// The first of the streets that nothing is fitted to.
const FIRST_TEST_SEED: u64 = 1100;
/// How many of each kind.
const TEST_SEEDS: u64 = 5;
/// The streets that rules are fitted to: below every seed that may be asked for.
const TRAIN_SEEDS: [u64; 2] = [11, 12];
/// Seeds below this are for fitting.
const TRAINING_END: u64 = 1000;

/// A name and its scores, by scene and seed.
struct Row {
    name: &'static str,
    scores: Vec<Vec<Score>>,
}

/// Measures all rules; some minutes on one core.
pub(super) fn run(request: &mut Request<'_>) -> anyhow::Result<Outcome> {
    let first = request.seed.unwrap_or(FIRST_TEST_SEED);
    ensure!(
        first >= TRAINING_END,
        "--seed {first} is below {TRAINING_END}, where the rules are fitted: take a greater one"
    );
    let fitted = fit_all(request)?;
    let names = Method::ALL.map(Method::name);
    let names = names.into_iter().chain(Ablation::ALL.map(Ablation::name));
    let mut rows: Vec<_> = names
        .map(|name| Row {
            name,
            scores: Vec::new(),
        })
        .collect();
    for scene in Scene::ALL {
        for row in &mut rows {
            row.scores.push(Vec::new());
        }
        for seed in first..first.saturating_add(TEST_SEEDS) {
            (request.say)(&format!("{} {seed}: every rule", scene.name()));
            let recording = Recording::of(scene, seed)?;
            let judge = Judge::of(&recording);
            let methods = Method::ALL.iter().zip(&fitted);
            let methods =
                methods.map(|(method, values)| method.in_full(values, &judge, &recording));
            let ours = fitted.last().context("the last rule is ours")?;
            let ablations = Ablation::ALL
                .iter()
                .map(|a| a.in_full(ours, &judge, &recording));
            for (row, score) in rows.iter_mut().zip(methods.chain(ablations)) {
                row.scores
                    .last_mut()
                    .context("a scene was begun")?
                    .push(score);
            }
        }
    }
    Ok(Outcome {
        figures: figures(&rows)?,
        text: text(&rows, &fitted, first),
    })
}

/// The best values of every rule's knobs.
fn fit_all(request: &mut Request<'_>) -> anyhow::Result<Vec<Vec<f64>>> {
    let mut streets = Vec::new();
    for scene in Scene::ALL {
        for seed in TRAIN_SEEDS {
            (request.say)(&format!("{} {seed}: to fit the rules to", scene.name()));
            let recording = Recording::of(scene, seed)?.thinned();
            streets.push((Judge::of(&recording), recording));
        }
    }
    Ok(Method::ALL
        .iter()
        .map(|method| {
            (request.say)(&format!(
                "fitting {} in {} tries",
                method.name(),
                fit::TRIES
            ));
            fit(&method.knobs(), |values| {
                let good = streets.iter().map(|(judge, recording)| {
                    let score = method.judge(values, judge, recording);
                    score.f1 - 0.01 * score.rmse
                });
                good.sum::<f64>() / streets.len() as f64
            })
        })
        .collect())
}

fn mean(scores: &[Score], of: impl Fn(&Score) -> f64) -> f64 {
    scores.iter().map(of).sum::<f64>() / scores.len() as f64
}

/// The deviation of a sample.
fn deviation(scores: &[Score], of: impl Fn(&Score) -> f64) -> f64 {
    let middle = mean(scores, &of);
    let squares: f64 = scores
        .iter()
        .map(|score| (of(score) - middle).powi(2))
        .sum();
    (squares / (scores.len() as f64 - 1.0)).sqrt()
}

fn figures(rows: &[Row]) -> anyhow::Result<Figures> {
    let mut figures = Figures::default();
    for (at, scene) in Scene::ALL.into_iter().enumerate() {
        for row in rows {
            let scores = &row.scores[at];
            for (metric, value) in [
                ("f1", mean(scores, |s| s.f1)),
                ("f1_std", deviation(scores, |s| s.f1)),
                ("rmse", mean(scores, |s| s.rmse)),
                ("rmse_std", deviation(scores, |s| s.rmse)),
                ("precision", mean(scores, |s| s.precision)),
                ("recall", mean(scores, |s| s.recall)),
                ("f1_exact", mean(scores, |s| s.f1_exact)),
                ("chamfer_m", mean(scores, |s| s.chamfer_m)),
            ] {
                // A map without a single occupied voxel has no distance.
                if value.is_finite() {
                    figures.set(&[scene.name(), row.name, metric], value)?;
                }
            }
        }
    }
    Ok(figures)
}

fn text(rows: &[Row], fitted: &[Vec<f64>], first: u64) -> String {
    let table = |title: &str, cell: &dyn Fn(&[Score]) -> Vec<String>, columns: &[&str]| Table {
        title: title.to_owned(),
        header: std::iter::once("rule".to_owned())
            .chain(Scene::ALL.iter().flat_map(|scene| {
                let columns = columns.iter();
                columns.map(move |column| format!("{} {column}", scene.letter()))
            }))
            .collect(),
        rows: rows
            .iter()
            .map(|row| {
                let cells = row.scores.iter().flat_map(|scores| cell(scores));
                std::iter::once(row.name.to_owned()).chain(cells).collect()
            })
            .collect(),
    };
    let spread = |scores: &[Score], of: fn(&Score) -> f64, digits: usize| {
        let (mean, deviation) = (mean(scores, of), deviation(scores, of));
        format!("{mean:.digits$} ± {deviation:.digits$}")
    };
    let main = table(
        &format!(
            "Map update, mean ± deviation over seeds {first} to {}: F1 within {} voxel, RMSE of the probability in per cent",
            first.saturating_add(TEST_SEEDS - 1),
            Tolerance::NEIGHBOURS.0
        ),
        &|scores: &[Score]| vec![spread(scores, |s| s.f1, 3), spread(scores, |s| s.rmse, 2)],
        &["F1", "RMSE"],
    );
    let details = table(
        "Precision, recall, strict F1 and chamfer distance in metres",
        &|scores: &[Score]| {
            let three = |of: fn(&Score) -> f64| format!("{:.3}", mean(scores, of));
            vec![
                three(|s| s.precision),
                three(|s| s.recall),
                three(|s| s.f1_exact),
                three(|s| s.chamfer_m),
            ]
        },
        &["P", "R", "strict", "chamfer"],
    );
    let scenes = Scene::ALL.map(|scene| format!("{} {}", scene.letter(), scene.name()));
    let knobs = Method::ALL.iter().zip(fitted).map(|(method, values)| {
        let knobs = method.knobs();
        let values = knobs
            .iter()
            .zip(values)
            .map(|(knob, value)| format!("{} {value:.3e}", knob.name));
        format!(
            "  {}: {}\n",
            method.name(),
            values.collect::<Vec<_>>().join(", ")
        )
    });
    format!(
        "{main}\n{details}\nscenes: {}\nfitted to seeds {TRAIN_SEEDS:?} in {} tries each:\n{}",
        scenes.join(", "),
        fit::TRIES,
        knobs.collect::<String>()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(f1: f64) -> Score {
        Score {
            f1,
            ..Score::default()
        }
    }

    #[test]
    fn a_deviation_is_that_of_a_sample() {
        let scores = [0.7, 0.8, 0.9].map(of);
        assert!((mean(&scores, |s| s.f1) - 0.8).abs() < 1e-12);
        assert!((deviation(&scores, |s| s.f1) - 0.1).abs() < 1e-12);
    }

    #[test]
    fn seeds_that_rules_are_fitted_to_are_refused() {
        let mut request = Request {
            seed: Some(999),
            data: None,
            out: std::path::Path::new("."),
            slam: &crate::evaluate::SlamOptions::default(),
            say: &mut |_| {},
        };
        let error = run(&mut request).map(|_| ()).expect_err("a training seed");
        assert_eq!(
            error.to_string(),
            "--seed 999 is below 1000, where the rules are fitted: take a greater one"
        );
    }
}
