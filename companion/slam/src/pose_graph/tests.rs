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
        positions: Vec::new(),
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
    let found = graph.solve().expect("a good graph");
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
    let right = graph.clone().solve().expect("a good graph");
    let aside = Isometry3::translation(4.0, -3.0, 0.0);
    graph
        .edges
        .push(recognised(5, 25, truth[5].inverse() * truth[25] * aside));
    let found = graph.solve().expect("a good graph");
    let moved = farthest(&right, &found);
    assert!(moved < 0.02, "the wrong edge moves a pose by {moved} m");
}

#[test]
fn measured_positions_hold_a_path_that_drifts() {
    let (truth, mut graph) = square(10);
    let drifted = farthest(&truth, &graph.poses);
    graph.positions = (5..=40)
        .step_by(5)
        .map(|node| Position {
            node,
            in_world: truth[node].translation.vector,
            covariance: Matrix3::from_diagonal(&Vector3::new(0.01, 0.01, 0.01)),
        })
        .collect();
    let found = graph.clone().solve().expect("a good graph");
    let worst = farthest(&truth, &found);
    assert!(worst < 0.15, "{worst} m off of {drifted}");
    for position in &mut graph.positions {
        position.covariance *= 1e6;
    }
    let vague = farthest(&truth, &graph.solve().expect("a good graph"));
    assert!(
        vague > 0.5 * drifted,
        "{vague} m: positions known to 100 m must not pull"
    );
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
        graph.solve(),
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
        in_world: truth[2].translation.vector,
        covariance: Matrix3::identity() * covariance,
    };
    assert_eq!(
        check(&|g| g.positions.push(vague(f64::NAN))),
        Err(GraphError::Senseless)
    );
    assert_eq!(
        check(&|g| g.positions.push(vague(0.0))),
        Err(GraphError::Senseless)
    );
    assert_eq!(check(&|g| g.positions.push(vague(1.0))), Ok("solved"));
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
        positions: Vec::new(),
    };
    assert_eq!(
        empty.solve(),
        Err(GraphError::NoSuchPose { index: 0, poses: 0 })
    );
}
