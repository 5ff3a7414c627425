//! Plans, their upload, and what a moved origin does to them.

use super::*;

#[track_caller]
fn check_plan_is_refused(bench: &mut Bench, vehicle: u8, reason: &str) {
    let vehicle = SystemId(vehicle);
    bench.command(Command::PlanPath {
        vehicle,
        x_m: 1.0,
        y_m: 1.0,
        heading_deg: None,
    });
    let expected = PlanState::Refused {
        at: bench.now,
        reason: reason.to_owned(),
    };
    assert_eq!(bench.model().missions[&vehicle].plan, expected);
    assert!(bench.jobs.is_empty());
}

#[test]
fn a_plan_is_refused_with_the_reason() {
    let mut bench = Bench::new(Source::Live);
    check_plan_is_refused(&mut bench, 2, "vehicle 2 has never been heard");
    bench.heartbeat(ROVER, MavType::MAV_TYPE_GROUND_ROVER, false, 4);
    check_plan_is_refused(&mut bench, 2, "UGV 2 has not told its position");
    bench.rover();
    check_plan_is_refused(&mut bench, 2, "there is no map yet");
    bench.copter();
    check_plan_is_refused(&mut bench, 1, "UAV 1 does not drive");
}

#[test]
fn the_planner_is_asked_from_where_the_rover_is_and_its_refusal_is_shown() {
    let mut bench = Bench::new(Source::Live);
    bench.rover();
    deliver_map(&mut bench, &floor());
    let vehicle = SystemId(2);
    bench.command(Command::PlanPath {
        vehicle,
        x_m: 90.0,
        y_m: 0.0,
        heading_deg: Some(0.0),
    });
    let Some(Job::Path(job)) = bench.jobs.pop() else {
        panic!("a job for the planner")
    };
    assert!(
        job.start.x_m.abs() < 1e-6 && job.start.heading_rad.abs() < 1e-6,
        "{:?}",
        job.start
    );
    assert_eq!(
        job.goal_heading_rad,
        Some(std::f64::consts::FRAC_PI_2),
        "north"
    );
    bench.feed(Event::Planned(crate::plan::run(Job::Path(job))));
    let PlanState::Refused { reason, .. } = &bench.model().missions[&vehicle].plan else {
        panic!("90 m away there is no map");
    };
    assert!(
        reason.starts_with("the goal (90.00, 0.00) m is outside the map"),
        "{reason}"
    );
}

#[test]
fn a_path_becomes_a_plan_with_figures() {
    let mut bench = Bench::new(Source::Live);
    bench.rover();
    deliver_map(&mut bench, &floor());
    let vehicle = SystemId(2);
    bench.command(Command::PlanPath {
        vehicle,
        x_m: 1.5,
        y_m: 0.5,
        heading_deg: None,
    });
    let job = bench.jobs.pop().expect("a job for the planner");
    bench.feed(Event::Planned(crate::plan::run(job)));
    let plan = bench.model().missions[&vehicle]
        .plan()
        .expect("a plan")
        .clone();
    let crate::model::missions::PlanKind::Path { length_m, .. } = plan.kind else {
        panic!("a path")
    };
    assert!((1.5..2.5).contains(&length_m), "{length_m} m");
    assert_eq!(
        plan.items[0].command,
        cmd::NAV_WAYPOINT,
        "home first, as ArduPilot wants it"
    );
    assert_eq!(plan.items[1].command, cmd::DO_CHANGE_SPEED);
    assert!(plan.line.len() + 2 <= plan.items.len() + 1);
}

fn survey(bench: &mut Bench) {
    let area = SurveyArea {
        from_m: [-1.0, -1.0],
        to_m: [1.0, 1.0],
        altitude_m: 2.0,
        spacing_m: 1.0,
    };
    bench.command(Command::PlanSurvey {
        vehicle: SystemId(1),
        area,
    });
}

#[test]
fn an_upload_that_is_read_back_equal_is_verified() {
    let mut bench = Bench::new(Source::Live);
    bench.copter();
    survey(&mut bench);
    bench.sent.clear();
    bench.command(Command::Upload(SystemId(1)));
    assert_eq!(
        bench.model().missions[&SystemId(1)].transfer,
        Transfer::Uploading { done: 0, total: 8 }
    );
    bench.serve(&mut Server::new(COPTER, |_| Ok(())), COPTER);
    let transfer = &bench.model().missions[&SystemId(1)].transfer;
    assert!(
        matches!(transfer, Transfer::Verified { items: 8, .. }),
        "{transfer:?}"
    );
    assert!(bench.alerts().is_empty(), "{:?}", bench.alerts());
}

#[test]
fn an_upload_that_reads_back_otherwise_is_shown_with_what_differs() {
    let mut bench = Bench::new(Source::Live);
    bench.copter();
    survey(&mut bench);
    bench.sent.clear();
    bench.command(Command::Upload(SystemId(1)));
    let mut server = Server::new(COPTER, |_| Ok(()));
    for _ in 0..200 {
        for message in std::mem::take(&mut bench.sent) {
            for mut answer in server
                .handle(bench.now, Address::new(255, 190), &message)
                .send
            {
                if let Message::MISSION_ITEM_INT(item) = &mut answer
                    && item.seq == 3
                {
                    item.x += 500;
                }
                bench.hear(COPTER, &answer);
            }
        }
        bench.silence(Duration::from_millis(100));
        bench.heartbeat(COPTER, MavType::MAV_TYPE_QUADROTOR, false, 0);
    }
    let Transfer::Differs { differences, .. } = &bench.model().missions[&SystemId(1)].transfer
    else {
        panic!("{:?}", bench.model().missions[&SystemId(1)].transfer);
    };
    assert_eq!(differences.len(), 1);
    assert!(
        differences[0].starts_with("mission item 3: sent to"),
        "{differences:?}"
    );
    let text = "UAV 1: the mission read back differs in 1 places".to_owned();
    assert_eq!(bench.alerts(), [(Level::Warning, text)]);
}

#[test]
fn an_upload_to_a_silent_vehicle_fails_and_says_so() {
    let mut bench = Bench::new(Source::Live);
    bench.copter();
    survey(&mut bench);
    bench.command(Command::Upload(SystemId(1)));
    bench.silence(Duration::from_secs(20));
    let transfer = &bench.model().missions[&SystemId(1)].transfer;
    let Transfer::Failed { reason, .. } = transfer else {
        panic!("{transfer:?}")
    };
    assert_eq!(
        reason,
        "no answer from the vehicle after 0 of 8 mission items"
    );
}

#[test]
fn a_mission_is_complete_when_the_vehicle_says_so_and_not_any_more_when_it_starts_anew() {
    let mut bench = Bench::new(Source::Live);
    bench.copter();
    let mut tell = |mission_state| {
        let current = MISSION_CURRENT_DATA {
            seq: 3,
            total: 5,
            mission_state,
            ..MISSION_CURRENT_DATA::default()
        };
        bench.hear(COPTER, &Message::MISSION_CURRENT(current));
        bench.model().vehicles[&SystemId(1)]
            .mission
            .is_some_and(|mission| mission.value.complete)
    };
    assert!(!tell(MissionState::MISSION_STATE_ACTIVE));
    assert!(tell(MissionState::MISSION_STATE_COMPLETE));
    assert!(tell(MissionState::MISSION_STATE_UNKNOWN), "nothing new");
    assert!(!tell(MissionState::MISSION_STATE_ACTIVE));
}

#[test]
fn a_plan_made_before_the_origin_moved_is_dropped_and_that_is_said() {
    let moved = |bench: &mut Bench, east_e7: i32| {
        let origin = TANDEM_ORIGIN_DATA {
            lat: ORIGIN_E7[0],
            lon: ORIGIN_E7[1] + east_e7,
            alt: 488_000,
            epoch: 2,
        };
        bench.hear(COMPANION, &Message::TANDEM_ORIGIN(origin));
    };
    let mut bench = Bench::new(Source::Live);
    bench.copter();
    survey(&mut bench);
    moved(&mut bench, 0); // the same place, in another epoch
    let plan = |bench: &Bench| bench.model().missions[&SystemId(1)].plan.clone();
    assert!(
        matches!(plan(&bench), PlanState::Ready(_)),
        "the same place"
    );
    moved(&mut bench, 100);
    let PlanState::Refused { reason, .. } = plan(&bench) else {
        panic!("the items lead 0.7 m beside what is drawn");
    };
    assert!(reason.contains("origin has changed"), "{reason}");
    let before = bench.sent.len();
    bench.command(Command::Upload(SystemId(1)));
    assert_eq!(bench.sent.len(), before, "nothing is uploaded");
}

#[test]
fn a_survey_is_drawn_lower_when_the_origin_turns_out_to_be_higher() {
    let mut bench = Bench::new(Source::Live);
    bench.copter();
    survey(&mut bench);
    let height_m = |bench: &Bench| match &bench.model().missions[&SystemId(1)].plan {
        PlanState::Ready(plan) => plan.line[0].raw.z,
        other => panic!("its items count from the home: {other:?}"),
    };
    let before = height_m(&bench);
    let origin = TANDEM_ORIGIN_DATA {
        lat: ORIGIN_E7[0],
        lon: ORIGIN_E7[1],
        alt: 500_000,
        epoch: 2,
    };
    bench.hear(COMPANION, &Message::TANDEM_ORIGIN(origin));
    let lowered = before - height_m(&bench);
    assert!((lowered - 12.0).abs() < 1e-6, "{lowered}");
}
