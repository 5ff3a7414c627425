//! Plans for the vehicles: asked for, found, refused.

use maps::plan::Pose2;
use mavlink_ext::SystemId;
use mavlink_ext::convert::MissionItem;

use super::{Action, Station};
use crate::command::SurveyArea;
use crate::model::log::Severity;
use crate::model::missions::{HomeItem, Mission, Plan, PlanKind, PlanState, Transfer};
use crate::modes::Firmware;
use crate::plan::{FoundPath, Job, Outcome, PathJob, items, survey};

impl Station {
    /// Lets the planner look for a path from where the vehicle is.
    pub(super) fn plan_path(
        &mut self,
        id: SystemId,
        goal_m: [f64; 2],
        heading_deg: Option<f64>,
        act: &mut impl FnMut(Action),
    ) {
        if self
            .model
            .missions
            .get(&id)
            .is_some_and(Mission::is_transferring)
        {
            return self.refuse(id, "an upload is under way".to_owned());
        }
        let job = match self.path_job(id, goal_m, heading_deg) {
            Ok(job) => job,
            Err(why) => return self.refuse(id, why),
        };
        let since = self.model.now;
        let mission = Mission {
            plan: PlanState::Planning { since },
            transfer: Transfer::None,
        };
        self.model.missions.insert(id, mission);
        act(Action::Plan(Job::Path(Box::new(job))));
    }

    fn path_job(
        &mut self,
        id: SystemId,
        goal_m: [f64; 2],
        heading_deg: Option<f64>,
    ) -> Result<PathJob, String> {
        let vehicle = self
            .model
            .vehicles
            .get(&id)
            .ok_or_else(|| format!("vehicle {} has never been heard", id.0))?;
        let name = vehicle.name();
        if !vehicle.kind.drives() {
            return Err(format!("{name} does not drive"));
        }
        let position = vehicle
            .position
            .ok_or_else(|| format!("{name} has not told its position"))?;
        let attitude = vehicle
            .attitude
            .ok_or_else(|| format!("{name} has not told its heading"))?;
        let map = self
            .model
            .map
            .voxels
            .as_ref()
            .ok_or("there is no map yet")?;
        self.path_number += 1;
        self.newest_path.insert(id, self.path_number);
        Ok(PathJob {
            number: self.path_number,
            vehicle: id,
            map: map.clone(),
            ugv: self.model.config.vehicle(),
            limits: self.model.config.plan_limits(),
            start: Pose2 {
                x_m: position.value.raw.x,
                y_m: position.value.raw.y,
                heading_rad: attitude.value.heading_rad(),
            },
            goal_m,
            goal_heading_rad: heading_deg.map(|deg| (90.0 - deg).to_radians()),
        })
    }

    /// What the planner has found.
    pub(super) fn planned(&mut self, outcome: Outcome) {
        let Outcome::Path {
            number,
            vehicle,
            found,
            goal_heading_rad,
        } = outcome
        else {
            return;
        };
        if self.newest_path.get(&vehicle) != Some(&number) {
            return;
        }
        match found.and_then(|found| self.path_plan(vehicle, found, goal_heading_rad)) {
            Ok(plan) => self.accept(vehicle, plan),
            Err(reason) => self.refuse(vehicle, reason),
        }
    }

    fn path_plan(
        &self,
        id: SystemId,
        found: FoundPath,
        goal_heading_rad: Option<f64>,
    ) -> Result<Plan, String> {
        let origin = self
            .model
            .map
            .origin
            .as_ref()
            .ok_or("the map's place on the earth is not known")?;
        let path = &found.path;
        let (home, mut items) = self.home_item(id);
        items.extend(items::of_path(
            path,
            &origin.origin,
            self.model.config.ugv.cruise_mps,
        ));
        Ok(Plan {
            made_at: self.model.now,
            home,
            kind: PlanKind::Path {
                length_m: path.length_m,
                min_clearance_m: path.min_clearance_m,
                gear_changes: path.gear_changes(),
                goal_heading_rad,
            },
            items,
            line: found.line,
        })
    }

    /// The planner has enough to do.
    pub(super) fn planner_busy(&mut self, job: &Job) {
        if let Job::Path(job) = job {
            self.refuse(job.vehicle, "the planner is busy: try again".to_owned());
        }
    }

    /// Lays survey lines, which takes no time.
    pub(super) fn plan_survey(&mut self, id: SystemId, area: SurveyArea) {
        if self
            .model
            .missions
            .get(&id)
            .is_some_and(Mission::is_transferring)
        {
            return self.refuse(id, "an upload is under way".to_owned());
        }
        match self.survey_plan(id, area) {
            Ok(plan) => self.accept(id, plan),
            Err(reason) => self.refuse(id, reason),
        }
    }

    fn survey_plan(&self, id: SystemId, area: SurveyArea) -> Result<Plan, String> {
        let vehicle = self
            .model
            .vehicles
            .get(&id)
            .ok_or_else(|| format!("vehicle {} has never been heard", id.0))?;
        if !vehicle.kind.flies() {
            return Err(format!("{} does not fly", vehicle.name()));
        }
        let origin = self
            .model
            .map
            .origin
            .as_ref()
            .ok_or("the map's place on the earth is not known")?;
        let from = vehicle
            .position
            .ok_or_else(|| format!("{} has not told its position", vehicle.name()))?
            .value;
        let corners =
            survey::lines(&area, [from.raw.x, from.raw.y]).map_err(|error| error.to_string())?;
        let height_m =
            from.raw.z - vehicle.fix.map_or(0.0, |fix| fix.value.above_home_m) + area.altitude_m;
        let line: Vec<_> = corners
            .iter()
            .map(|[x, y]| maps::frame::Point::new(*x, *y, height_m))
            .collect();
        let length_m = line.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
        let (home, mut items) = self.home_item(id);
        let speed_mps = self.model.config.survey.speed_mps;
        items.extend(items::of_survey(&corners, &area, &origin.origin, speed_mps));
        Ok(Plan {
            made_at: self.model.now,
            home,
            kind: PlanKind::Survey { area, length_m },
            items,
            line,
        })
    }

    /// `ArduPilot` takes the first item of a mission for the home position.
    fn home_item(&self, id: SystemId) -> (HomeItem, Vec<MissionItem>) {
        let vehicle = self
            .model
            .vehicles
            .get(&id)
            .filter(|vehicle| vehicle.firmware == Firmware::ArduPilot);
        match vehicle.and_then(|vehicle| vehicle.fix.map(|fix| fix.value.geodetic)) {
            Some(place) => (HomeItem::First, vec![items::home(place)]),
            None => (HomeItem::None, Vec::new()),
        }
    }

    fn accept(&mut self, id: SystemId, plan: Plan) {
        self.say(
            Severity::Notice,
            format!(
                "plan for {} with {} items",
                self.model.name_of(id),
                plan.items.len()
            ),
        );
        self.model.missions.insert(
            id,
            Mission {
                plan: PlanState::Ready(plan),
                transfer: Transfer::None,
            },
        );
    }

    /// The map's origin is `up_m` lower than it was taken to be: what flies is drawn so much higher. Its items do not change,
    /// as they count from the vehicle's home.
    pub(super) fn lift_surveys(&mut self, up_m: f64) {
        for mission in self.model.missions.values_mut() {
            if let PlanState::Ready(Plan {
                kind: PlanKind::Survey { .. },
                line,
                ..
            }) = &mut mission.plan
            {
                for place in line {
                    place.raw.z += up_m;
                }
            }
        }
    }

    /// The map lies elsewhere on the earth now: plans made before would lead elsewhere than they show.
    pub(super) fn drop_plans_of_old_origin(&mut self) {
        const REASON: &str = "the map's origin has changed since: plan anew";
        self.newest_path.clear();
        let at = self.model.now;
        let ids: Vec<SystemId> = self.model.missions.keys().copied().collect();
        for id in ids {
            self.transfers.remove(&id);
            let refused = PlanState::Refused {
                at,
                reason: REASON.to_owned(),
            };
            let mission = Mission {
                plan: refused,
                transfer: Transfer::None,
            };
            let Some(before) = self.model.missions.insert(id, mission) else {
                continue;
            };
            let name = self.model.name_of(id);
            if before.is_transferring() || before.is_verified() {
                self.say(
                    Severity::Warning,
                    format!(
                        "{name} has a mission that was planned before the map's origin changed: plan and upload anew"
                    ),
                );
            } else if before != Mission::default() {
                self.say(Severity::Warning, format!("no plan for {name}: {REASON}"));
            }
        }
    }

    fn refuse(&mut self, id: SystemId, reason: String) {
        self.say(
            Severity::Warning,
            format!("no plan for {}: {reason}", self.model.name_of(id)),
        );
        let at = self.model.now;
        let mission = self.model.missions.entry(id).or_default();
        if !mission.is_transferring() {
            *mission = Mission {
                plan: PlanState::Refused { at, reason },
                transfer: Transfer::None,
            };
        }
    }
}
