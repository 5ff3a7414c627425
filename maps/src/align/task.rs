//! One alignment: the minima around the guess, the best of them, and what is wrong with it.

use nalgebra::{Isometry3, Matrix6, Vector3, Vector6};
use rayon::prelude::*;

use super::cells::Cells;
use super::observe::{self, Weak};
use super::refine::{Fit, Prior, Refined, approach, finish, fit};
use super::search::{Window, starts};
use super::source::Source;
use super::surface::Level;
use super::{AlignError, AlignSettings, Alignment, Guess, Local, Reference, WeakDirection, se3};
use crate::frame::{Isometry, Vector};

/// Samples that are refined with, and those that approach from each start.
const SAMPLES: usize = 6000;
const APPROACH_SAMPLES: usize = 1500;
/// Minima that are refined to the end.
const FINALISTS: usize = 4;
/// The search reaches this many standard deviations of the guess.
const SEARCH_SIGMAS: f64 = 3.0;
/// The 99.9th percentile of χ² with six degrees of freedom: a result further from its guess contradicts it.
const TOO_FAR_SQUARED: f64 = 22.46;
/// A fit is worth as much as this many independent observations when it is weighed against the guess.
const WORTH: f64 = 50.0;
/// Another place is as good if its score is within this share of the best.
const AS_GOOD: f64 = 0.05;
/// A result that still moves by more than this many of its standard deviations is none.
const MOVING_SIGMAS: f64 = 0.5;
/// Minima closer than this are one.
const SAME_M: f64 = 0.5;

/// An alignment under way; poses are those of the centre of the source.
pub(super) struct Task<'a> {
    levels: &'a [Level],
    settings: &'a AlignSettings,
    pub(super) source: Source,
    pub(super) prior: Prior,
    window: Window,
}

/// A minimum.
#[derive(Clone)]
pub(super) struct Minimum {
    pub(super) refined: Refined,
    pub(super) fit: Fit,
    /// The fit less what the guess says against it.
    score: f64,
}

/// The best minimum and what its surfaces do not tell.
pub(super) struct Best {
    pub(super) refined: Refined,
    pub(super) fit: Fit,
    pub(super) weak: Vec<Weak>,
}

impl<'a> Task<'a> {
    pub(super) fn new<L>(
        reference: &'a Reference,
        local: &Local<L>,
        guess: &Guess<L>,
        settings: &'a AlignSettings,
    ) -> Result<Self, AlignError> {
        let finite =
            guess.world_from_local.is_finite() && guess.covariance.iter().all(|c| c.is_finite());
        let information = finite
            .then(|| guess.covariance.cholesky())
            .flatten()
            .map(|c| c.inverse())
            .ok_or(AlignError::BadGuess)?;
        let cells = Cells::of(
            local.points.iter().copied(),
            reference.levels[0]
                .cell_m
                .max(super::CELL_VOXELS * local.grain_m),
            local.grain_m,
        );
        let source = Source::of(&cells, SAMPLES);
        if source.samples.len() < settings.least_samples {
            return Err(AlignError::TooFewPoints {
                found: source.samples.len(),
                least: settings.least_samples,
            });
        }
        let moved = se3::about_origin(&source.center);
        let back = se3::about_origin(&-source.center);
        let prior = Prior {
            pose: guess.world_from_local.raw * Isometry3::from(source.center),
            information: moved.transpose() * information * moved,
        };
        let window = window(
            &(back * guess.covariance * back.transpose()),
            &prior,
            settings,
        );
        Ok(Self {
            levels: &reference.levels,
            settings,
            source,
            prior,
            window,
        })
    }

    /// The best place, unless it is a bad one or not the only one.
    pub(super) fn best(&self) -> Result<Best, AlignError> {
        let minima = self.minima();
        let Some(best) = minima.first() else {
            return Err(AlignError::PoorFit {
                inlier_share: 0.0,
                least: self.settings.least_inlier_share,
            });
        };
        if best.fit.inlier_share < self.settings.least_inlier_share {
            return Err(AlignError::PoorFit {
                inlier_share: best.fit.inlier_share,
                least: self.settings.least_inlier_share,
            });
        }
        let Refined {
            pose, information, ..
        } = &best.refined;
        let weak = observe::weak_motions(
            &self.levels[0],
            &self.source,
            pose,
            information,
            self.settings.most_std_m,
        );
        for other in &minima[1..] {
            let far = self.apart(pose, &other.refined.pose, &weak) > SAME_M;
            if far && other.score > best.score - AS_GOOD * best.fit.score {
                return Err(AlignError::Ambiguous {
                    apart_m: Vector::from_raw(
                        other.refined.pose.translation.vector - pose.translation.vector,
                    ),
                    score: best.fit.score,
                    other_score: other.fit.score,
                });
            }
        }
        Ok(Best {
            refined: best.refined.clone(),
            fit: best.fit,
            weak,
        })
    }

    /// The best place once more, without what its weak motions tell: along them it goes back to the guess.
    pub(super) fn held(&self, best: &Best) -> (Refined, Fit) {
        if best.weak.is_empty() {
            return (best.refined.clone(), best.fit);
        }
        let kept = observe::without(&best.weak, self.source.radius_m);
        let (level, samples) = (&self.levels[0], &self.source.samples);
        let refined = finish(level, samples, &self.prior, &best.refined.pose, Some(&kept));
        let fit = fit(level, samples, &refined.pose);
        (refined, fit)
    }

    /// Refuses a result that moves still or contradicts the guess.
    pub(super) fn checked(&self, refined: &Refined) -> Result<(), AlignError> {
        let squared = self.prior.squared_distance(&refined.pose);
        if squared > TOO_FAR_SQUARED {
            let (rho, phi) = se3::parts(&se3::log(&(self.prior.pose.inverse() * refined.pose)));
            return Err(AlignError::TooFar {
                translation_m: rho.norm(),
                rotation_rad: phi.norm(),
                sigmas: squared.sqrt(),
            });
        }
        if refined.last_step_sigmas > MOVING_SIGMAS {
            return Err(AlignError::NotConverged {
                step_sigmas: refined.last_step_sigmas,
            });
        }
        Ok(())
    }

    /// The result in terms of the origin of the local frame.
    pub(super) fn alignment<L>(&self, refined: &Refined, fit: Fit) -> Alignment<L> {
        let about_center = (refined.information + self.prior.information)
            .try_inverse()
            .unwrap_or_else(Matrix6::identity); // cannot be: the prior is positive definite
        let map_std = observe::in_metres(self.source.radius_m) * self.settings.map_std_m;
        let about_center = about_center + map_std * map_std;
        let moved = se3::about_origin(&self.source.center);
        let covariance = moved * about_center * moved.transpose();
        Alignment {
            world_from_local: Isometry::claim(refined.pose * Isometry3::from(-self.source.center)),
            covariance: (covariance + covariance.transpose()) * 0.5,
            inlier_share: fit.inlier_share,
            residual_m: fit.residual_m,
        }
    }

    /// What the caller is told of weak motions.
    pub(super) fn directions(&self, best: &Best) -> Vec<WeakDirection> {
        let turn = best.refined.pose.rotation;
        let direction = |weak: &Weak| {
            let (rho, phi) = se3::parts(&weak.motion);
            WeakDirection {
                translation_m: Vector::from_raw(turn * rho),
                rotation_rad: Vector::from_raw(turn * phi / self.source.radius_m),
                std_m: weak.std_m,
                support: weak.support,
            }
        };
        best.weak.iter().map(direction).collect()
    }

    /// The minima found from all starts, the best first.
    fn minima(&self) -> Vec<Minimum> {
        let [fine, middle, ..] = self.levels else {
            return Vec::new();
        };
        let starts = starts(middle, &self.source, &self.prior.pose, &self.window);
        let few = self.source.thinned(APPROACH_SAMPLES);
        let mut approached: Vec<(Minimum, Isometry3<f64>)> = starts
            .par_iter()
            .map(|start| {
                let pose = approach(&self.levels[1..], &few, &self.prior, start);
                let refined = finish(fine, &few, &self.prior, &pose, None);
                let pose = refined.pose;
                (self.minimum(&few, refined), pose)
            })
            .collect();
        approached.sort_by(|a, b| b.0.score.total_cmp(&a.0.score));
        let mut distinct: Vec<Isometry3<f64>> = Vec::new();
        for (_, pose) in &approached {
            if distinct.iter().all(|d| self.apart(d, pose, &[]) > SAME_M) {
                distinct.push(*pose);
            }
        }
        distinct.truncate(FINALISTS);
        let mut minima: Vec<Minimum> = distinct
            .par_iter()
            .map(|pose| {
                let refined = finish(fine, &self.source.samples, &self.prior, pose, None);
                self.minimum(&self.source.samples, refined)
            })
            .collect();
        minima.sort_by(|a, b| b.score.total_cmp(&a.score));
        minima
    }

    fn minimum(&self, samples: &[super::source::Sample], refined: Refined) -> Minimum {
        let fit = fit(&self.levels[0], samples, &refined.pose);
        let against = self.prior.squared_distance(&refined.pose) / (2.0 * WORTH);
        Minimum {
            score: fit.score - against,
            refined,
            fit,
        }
    }

    /// How far two poses are apart in metres, a turn counting as what it moves the samples by, weak motions aside.
    fn apart(&self, a: &Isometry3<f64>, b: &Isometry3<f64>, weak: &[Weak]) -> f64 {
        let motion = se3::log(&(a.inverse() * b));
        let metres: Vector6<f64> = observe::in_metres(self.source.radius_m.recip()) * motion;
        let rest = weak
            .iter()
            .fold(metres, |rest, w| rest - w.motion * w.motion.dot(&rest));
        rest.norm()
    }
}

/// Three standard deviations of a covariance about the centre, along the axes of the world.
fn window(about_center: &Matrix6<f64>, prior: &Prior, settings: &AlignSettings) -> Window {
    let turn = prior.pose.rotation.to_rotation_matrix().into_inner();
    let variance = |at: usize| {
        let block = about_center.fixed_view::<3, 3>(at, at);
        Vector3::from((turn * block * turn.transpose()).diagonal())
    };
    let reach = |variance: f64| SEARCH_SIGMAS * variance.max(0.0).sqrt();
    Window {
        reach_m: variance(0).map(|v| reach(v).min(settings.reach_m)),
        yaw_rad: reach(variance(3).z).min(std::f64::consts::PI),
    }
}
