use super::*;

fn information(sigma_m: f64, sigma_rad: f64) -> Matrix6<f64> {
    let (t, r) = (sigma_m.powi(-2), sigma_rad.powi(-2));
    Matrix6::from_diagonal(&Vector6::new(t, t, t, r, r, r))
}

fn tracked(from: usize, step: Isometry3<f64>) -> Edge {
    Edge {
        from,
        to: from + 1,
        from_from_to: step,
        information: information(0.02, 0.01),
        trust: Trust::Certain,
    }
}

fn recognised(from: usize, to: usize, from_from_to: Isometry3<f64>) -> Edge {
    Edge {
        from,
        to,
        from_from_to,
        information: information(0.01, 0.005),
        trust: Trust::Robust,
    }
}

/// A path once around a square of `4 · side` steps of half a metre, and the same with a drift in every step.
fn square(side: usize) -> (Vec<Isometry3<f64>>, PoseGraph) {
    let turn = std::f64::consts::FRAC_PI_2;
    let drift = Isometry3::new(
        Vector3::new(0.01, 0.004, -0.003),
        Vector3::new(0.001, 0.0, 0.006),
    );
    let (mut truth, mut poses, mut edges) = (
        vec![Isometry3::identity()],
        vec![Isometry3::identity()],
        Vec::new(),
    );
    for i in 0..4 * side {
        let corner = if i % side == side - 1 { turn } else { 0.0 };
        let step = Isometry3::new(Vector3::new(0.5, 0.0, 0.0), Vector3::new(0.0, 0.0, corner));
        edges.push(tracked(i, step * drift));
        truth.push(truth[i] * step);
        poses.push(poses[i] * step * drift);
    }
    let graph = PoseGraph {
        poses,
        fixed: 0,
        edges,
        outside: Outside::default(),
    };
    (truth, graph)
}

fn farthest(truth: &[Isometry3<f64>], found: &[Isometry3<f64>]) -> f64 {
    let apart = |(a, b): (&Isometry3<f64>, &Isometry3<f64>)| {
        (a.translation.vector - b.translation.vector).norm()
    };
    truth.iter().zip(found).map(apart).fold(0.0, f64::max)
}

/// What a recognised place measures: the truth.
fn seen(truth: &[Isometry3<f64>], from: usize, to: usize) -> Edge {
    recognised(from, to, truth[from].inverse() * truth[to])
}

#[test]
fn a_square_with_drift_closes() {
    let (truth, mut graph) = square(10);
    let drifted = farthest(&truth, &graph.poses);
    assert!(
        drifted > 0.5,
        "{drifted} m of drift, else this shows nothing"
    );
    graph.edges.push(seen(&truth, 0, 40));
    let found = graph.solve().expect("a good graph").poses;
    let end = farthest(&truth[40..], &found[40..]);
    assert!(
        end < 0.02,
        "the end is {end} m from where it was recognised"
    );
    let worst = farthest(&truth, &found);
    assert!(worst < 0.5 * drifted, "{worst} m off of {drifted}");
    assert!(
        farthest(&truth[..1], &found[..1]) < 1e-12,
        "the first stays"
    );
}

#[test]
fn a_wrong_edge_is_outvoted() {
    let (truth, mut graph) = square(10);
    for (from, to) in [(0, 40), (1, 39), (2, 40)] {
        graph.edges.push(seen(&truth, from, to));
    }
    let right = graph.clone().solve().expect("a good graph").poses;
    let aside = Isometry3::translation(4.0, -3.0, 0.0);
    graph
        .edges
        .push(recognised(5, 25, truth[5].inverse() * truth[25] * aside));
    let found = graph.solve().expect("a good graph").poses;
    let moved = farthest(&right, &found);
    assert!(moved < 0.02, "the wrong edge moves a pose by {moved} m");
}

/// The best poses as they lie on the Earth.
fn on_earth(graph: &PoseGraph) -> Vec<Isometry3<f64>> {
    let solved = graph.clone().solve().expect("a good graph");
    let enu_from_world = solved.outside.world_from_enu.inverse();
    solved
        .poses
        .iter()
        .map(|pose| enu_from_world * pose)
        .collect()
}

#[test]
fn measured_positions_hold_a_path_that_drifts() {
    let (truth, mut graph) = square(10);
    let drifted = farthest(&truth, &graph.poses);
    graph.outside.positions = (0..=40)
        .step_by(5)
        .map(|node| Position {
            node,
            beside: Vector3::zeros(),
            in_enu: truth[node].translation.vector,
            covariance: Matrix3::from_diagonal(&Vector3::new(0.01, 0.01, 0.01)),
        })
        .collect();
    let worst = farthest(&truth, &on_earth(&graph));
    assert!(worst < 0.2, "{worst} m off of {drifted}");
    for position in &mut graph.outside.positions {
        position.covariance *= 1e6;
    }
    let vague = farthest(&truth, &on_earth(&graph));
    assert!(
        vague > 0.5 * drifted,
        "{vague} m: positions known to 100 m must not pull"
    );
}

#[test]
fn positions_find_how_the_earth_lies_and_bend_the_path_no_less_for_it() {
    let (truth, mut graph) = square(10);
    let earth = Isometry3::new(Vector3::new(30.0, -8.0, 4.0), Vector3::new(0.0, 0.0, 2.1));
    let antenna = Vector3::new(0.1, 0.0, 0.3);
    let drifted = graph.poses.clone();
    let position = |node: usize| Position {
        node,
        beside: drifted[node].rotation * antenna,
        in_enu: (earth.inverse() * truth[node] * nalgebra::Point3::from(antenna)).coords,
        covariance: Matrix3::identity() * 1e-4,
    };
    graph.outside.positions = (0..=40).map(position).collect();
    // As far off as a line through a path that drifts has it.
    graph.outside.world_from_enu =
        Isometry3::new(Vector3::new(0.4, 0.2, -0.3), Vector3::new(0.0, 0.0, 0.05)) * earth;
    let found: Vec<_> = on_earth(&graph).iter().map(|pose| earth * pose).collect();
    let worst = farthest(&truth, &found);
    assert!(worst < 0.02, "{worst} m off");
    let first = graph.solve().expect("a good graph").poses[0];
    assert!((first.translation.vector - truth[0].translation.vector).norm() < 1e-9);
}

#[test]
fn uprights_turn_the_path_upright_and_find_how_the_accelerometer_leans() {
    let (truth, mut graph) = square(10);
    // The world leans, and the path drifts out of the plane.
    let lean = Isometry3::rotation(Vector3::new(0.006, -0.004, 0.0));
    let tilt = Isometry3::rotation(Vector3::new(0.0, 0.004, 0.0));
    for edge in &mut graph.edges {
        edge.from_from_to = truth[edge.from].inverse() * truth[edge.to] * tilt;
        edge.information = information(0.005, 0.003);
    }
    graph.poses = vec![lean];
    for edge in &graph.edges {
        graph.poses.push(graph.poses[edge.from] * edge.from_from_to);
    }
    let bias = Vector3::new(0.004, -0.006, 0.0);
    graph.outside.uprights = (0..=40)
        .map(|node| Upright {
            node,
            up: truth[node].rotation.inverse() * Vector3::z() + bias,
            sigma_rad: 0.002,
        })
        .collect();
    let farthest_up = |poses: &[Isometry3<f64>]| {
        let up = poses
            .iter()
            .map(|p| (p.rotation * Vector3::z()).angle(&Vector3::z()));
        up.fold(0.0, f64::max)
    };
    let before = farthest_up(&graph.poses);
    assert!(before > 0.03, "{before} rad");
    let solved = graph.solve().expect("a good graph");
    let after = farthest_up(&solved.poses);
    assert!(after < 0.006, "{after} rad from upright");
    let found = solved.outside.lean - bias;
    assert!(
        found.xy().norm() < 0.5 * bias.norm(),
        "the lean is {found} off"
    );
    let first = solved.poses[0].translation.vector.norm();
    assert!(first < 1e-3, "it stays where it is: {first} m");
}

#[test]
fn the_gradient_of_what_ties_the_path_to_the_world_outside_is_that_of_its_cost() {
    let (truth, mut graph) = square(1);
    let turn = Isometry3::rotation(Vector3::new(2e-4, 3e-4, 0.0));
    graph.outside = Outside {
        positions: vec![Position {
            node: 1,
            beside: Vector3::new(0.1, 0.2, 0.3),
            in_enu: truth[2].translation.vector + Vector3::new(1.0, 2.0, 3.0),
            covariance: Matrix3::from_diagonal(&Vector3::new(0.5, 0.5, 2.0)),
        }],
        world_from_enu: Isometry3::translation(0.3, 0.1, 0.2)
            * Isometry3::rotation(0.7 * Vector3::z()),
        uprights: vec![Upright {
            node: 2,
            up: Vector3::new(0.1, -0.05, 0.99),
            sigma_rad: 0.1,
        }],
        lean: Vector3::new(0.001, 0.002, -0.001),
    };
    let anchor = Anchor {
        node: 0,
        pose: graph.poses[0] * turn * Isometry3::translation(1e-5, 0.0, 0.0),
    };
    let unknowns = graph.poses.len() + UNKNOWNS;
    let mut system = crate::blocks::BlockSystem::new(unknowns);
    graph.outside.add_to(&mut system, &graph.poses, &anchor);
    for block in 0..unknowns {
        for axis in 0..6 {
            // The Earth has four unknowns, the lean three.
            let is_unknown = match block.checked_sub(graph.poses.len()) {
                None => true,
                Some(0) => axis < 4,
                Some(_) => axis < 3,
            };
            if !is_unknown {
                continue;
            }
            let at = |step: f64| {
                let mut steps = vec![Vector6::zeros(); unknowns];
                steps[block][axis] = step;
                let mut moved = graph.clone();
                moved.take(&steps);
                moved.outside.cost(&moved.poses, &anchor)
            };
            let numeric = (at(1e-7) - at(-1e-7)) / 2e-7;
            let exact = -2.0 * system.right(block)[axis];
            let wrong = (numeric - exact).abs();
            assert!(
                wrong < 1e-3 * (1.0 + exact.abs()),
                "{block}, {axis}: {numeric}, not {exact}"
            );
        }
    }
}

#[test]
fn the_derivatives_are_those_of_the_error() {
    let (_, mut graph) = square(3);
    graph.edges[1].from_from_to *=
        Isometry3::new(Vector3::new(0.2, -0.1, 0.3), Vector3::new(0.4, -0.7, 0.2));
    let edge = graph.edges[1].clone();
    let (off, _) = graph.error(&edge);
    let (by_from, by_to) = graph.derivatives(&edge, &off);
    for (node, exact) in [(edge.from, by_from), (edge.to, by_to)] {
        for axis in 0..6 {
            let at = |step: f64| {
                let mut xi = Vector6::zeros();
                xi[axis] = step;
                let mut moved = graph.clone();
                moved.poses[node] = boxplus(&graph.poses[node], &xi);
                moved.error(&edge).1
            };
            let numeric = (at(1e-6) - at(-1e-6)) / 2e-6;
            let wrong = (numeric - exact.column(axis)).norm();
            assert!(wrong < 1e-6, "pose {node}, axis {axis}: {wrong} off");
        }
    }
}

#[test]
fn a_graph_in_pieces_is_refused() {
    let (_, mut graph) = square(3);
    graph.edges.remove(8);
    assert_eq!(
        graph.solve().map(|_| ()),
        Err(GraphError::Disconnected {
            loose: 4,
            poses: 13
        })
    );
}

#[test]
fn senseless_numbers_are_refused() {
    let (truth, good) = square(3);
    let check = |spoil: &dyn Fn(&mut PoseGraph)| {
        let mut graph = good.clone();
        spoil(&mut graph);
        graph.solve().map(|_| "solved")
    };
    let nan = Isometry3::translation(f64::NAN, 0.0, 0.0);
    assert_eq!(check(&|g| g.poses[3] = nan), Err(GraphError::Senseless));
    assert_eq!(
        check(&|g| g.edges[3].from_from_to = nan),
        Err(GraphError::Senseless)
    );
    assert_eq!(
        check(&|g| g.edges[3].information *= -1.0),
        Err(GraphError::Senseless)
    );
    assert_eq!(
        check(&|g| g.edges[3].information *= f64::INFINITY),
        Err(GraphError::Senseless)
    );
    let vague = |covariance: f64| Position {
        node: 2,
        beside: Vector3::zeros(),
        in_enu: truth[2].translation.vector,
        covariance: Matrix3::identity() * covariance,
    };
    assert_eq!(
        check(&|g| g.outside.positions.push(vague(f64::NAN))),
        Err(GraphError::Senseless)
    );
    assert_eq!(
        check(&|g| g.outside.positions.push(vague(0.0))),
        Err(GraphError::Senseless)
    );
    assert_eq!(
        check(&|g| g.outside.positions.push(vague(1.0))),
        Ok("solved")
    );
    let upright = |node: usize, sigma_rad: f64| Upright {
        node,
        up: Vector3::z(),
        sigma_rad,
    };
    assert_eq!(
        check(&|g| g.outside.uprights.push(upright(2, f64::NAN))),
        Err(GraphError::Senseless)
    );
    assert_eq!(
        check(&|g| g.outside.uprights.push(upright(2, 0.0))),
        Err(GraphError::Senseless)
    );
    assert_eq!(
        check(&|g| g.outside.uprights.push(upright(13, 0.1))),
        Err(GraphError::NoSuchPose {
            index: 13,
            poses: 13
        })
    );
    assert_eq!(
        check(&|g| g
            .edges
            .push(seen(&[truth.clone(), truth.clone()].concat(), 0, 20))),
        Err(GraphError::NoSuchPose {
            index: 20,
            poses: 13
        })
    );
    let empty = PoseGraph {
        poses: Vec::new(),
        fixed: 0,
        edges: Vec::new(),
        outside: Outside::default(),
    };
    assert_eq!(
        empty.solve().map(|_| ()),
        Err(GraphError::NoSuchPose { index: 0, poses: 0 })
    );
}
