//! Fuzzy rules of the lean.

use super::{CONTROL_DT, around, assert_poles, closed_loop, gain_of, made, pair, position, presets, robot, run};
use ballbot_core::control::{Controller, FuzzyMamdani, FuzzyOptions, LimitOptions, RuleTable, SETS, memberships};
use ballbot_core::models::LinearModel;
use ballbot_core::{ModelKind, Params, State};
use nalgebra::{Complex, DMatrix};

/// Numbers from −1.4 to 1.4 and the edges of all sets.
fn inputs() -> impl Iterator<Item = f64> + Clone {
    (-140..=140).map(|k| f64::from(k) / 100.0).chain((-3..=3).map(|k| f64::from(k) / 3.0))
}

/// Rules without any symmetry.
fn odd_rules() -> [[f64; SETS]; SETS] {
    std::array::from_fn(|i| std::array::from_fn(|j| (1.0 + i as f64 * 2.3 + j as f64 * 5.1).sin()))
}

#[test]
fn memberships_add_up_to_one() {
    for input in inputs() {
        let sets = memberships(input);
        assert!(sets.iter().all(|m| (0.0..=1.0).contains(m)), "{input}: {sets:?}");
        assert!((sets.iter().sum::<f64>() - 1.0).abs() < 1e-15, "{input}: {sets:?}");
        assert!(sets.iter().filter(|m| **m > 0.0).count() <= 2, "{input}: {sets:?}");
    }
    assert!(memberships(f64::NAN).iter().any(|m| m.is_nan()));
}

#[test]
fn the_table_is_met_at_its_nodes() {
    let rules = odd_rules();
    let table = RuleTable::new(rules).unwrap();
    let node = |i: usize| (i as f64 - 3.0) / 3.0;
    for (i, row) in rules.iter().enumerate() {
        for (j, expected) in row.iter().enumerate() {
            assert!((table.output(node(i), node(j)) - expected).abs() < 1e-14);
        }
    }
}

/// Triangle with feet at `a` and `c` and its top at `b`.
fn triangle(x: f64, [a, b, c]: [f64; 3]) -> f64 {
    ((x - a) / (b - a)).min((c - x) / (c - b)).max(0.0)
}

/// As in a textbook: every rule fires by the product of its memberships, and the output is the weighted mean of the
/// consequents. And as an interpolation in the cell of the table.
#[test]
fn the_output_matches_plain_implementations() {
    let rules = odd_rules();
    let table = RuleTable::new(rules).unwrap();
    for x in inputs() {
        for y in inputs() {
            let (inside_x, inside_y) = (x.clamp(-1.0, 1.0), y.clamp(-1.0, 1.0));
            let (mut sum, mut weights) = (0.0, 0.0);
            for (i, row) in rules.iter().enumerate() {
                for (j, consequent) in row.iter().enumerate() {
                    let set = |k: usize| [k as f64 - 4.0, k as f64 - 3.0, k as f64 - 2.0].map(|edge| edge / 3.0);
                    let fired = triangle(inside_x, set(i)) * triangle(inside_y, set(j));
                    (sum, weights) = (sum + fired * consequent, weights + fired);
                }
            }
            let cell = |input: f64| {
                let place = 3.0 * (input + 1.0);
                let first = (place.floor() as usize).min(SETS - 2);
                (first, place - first as f64)
            };
            let ((i, s), (j, t)) = (cell(inside_x), cell(inside_y));
            let along = |row: [f64; SETS]| row[j] * (1.0 - t) + row[j + 1] * t;
            let interpolated = along(rules[i]) * (1.0 - s) + along(rules[i + 1]) * s;
            let found = table.output(x, y);
            assert!((found - sum / weights).abs() < 1e-12, "{x}, {y}: {found}, expected {}", sum / weights);
            assert!((found - interpolated).abs() < 1e-12, "{x}, {y}: {found}, expected {interpolated}");
        }
    }
}

/// In the middle of the table the loop is a PD loop with canceled gravity.
#[test]
fn poles_match_the_design() {
    for (name, params) in presets() {
        let params = Params { ball_viscous_friction: 0.0, wheel_viscous_friction: 0.0, ..params };
        let [x, y, _] = params.body_inertia;
        let params = Params { body_inertia: [x.max(y), x.max(y), params.body_inertia[2]], ..params };
        let gain = gain_of(made("fuzzy_mamdani", &params, &[("yaw_damping", &[0.7])]).as_ref(), &params);
        let rate = LinearModel::new(&params).a[(8, 3)].sqrt();
        let (lean, position) = ([3.2 * rate, 2.56 * rate * rate], [0.4 * rate, 0.0625 * rate * rate]);
        let sum = lean[0] - position[0];
        let product = lean[1] - position[0] * sum - position[1];
        let root = Complex::from(0.25 * sum * sum - product).sqrt();
        let plane = [pair(0.25 * rate, 0.8).to_vec(), vec![-root - 0.5 * sum, root - 0.5 * sum]].concat();
        println!("{name}");
        let expected = [plane.clone(), plane, pair(4.0, 0.7).to_vec()].concat();
        assert_poles(&closed_loop(&params, &gain, &DMatrix::zeros(0, 10)), &expected, 1e-6 * rate);
    }
}

/// Narrow rules saturate: their cost.
#[test]
fn a_wide_range_keeps_the_basin() {
    let params = Params::paper();
    let basin = |degrees: f64| {
        let options = [("range", &[degrees.to_radians()][..])];
        let holds = |tilt: f64| {
            around(12).all(|direction| {
                let start = State::tilted(&params, direction * tilt.to_radians(), 0.0);
                let mut robot = robot(&params, ModelKind::Contact, &start);
                let mut controller = made("fuzzy_mamdani", &params, &options);
                let end = run(&mut robot, controller.as_mut(), 6.0, position(0.0, 0.0), |_, _| ());
                end.is_some_and(|run| run.end.tilt() < 0.03)
            })
        };
        (5..=30).map(f64::from).take_while(|tilt| holds(*tilt)).last().unwrap_or(0.0)
    };
    let [narrow, middle, wide] = [5.0, 10.0, 20.0].map(basin);
    println!("range of 5 deg: {narrow} deg, of 10 deg: {middle} deg, of 20 deg: {wide} deg");
    assert!(narrow < middle && middle < wide, "{narrow}, {middle}, {wide}");
}

#[test]
fn rules_that_cannot_balance_are_rejected() {
    let params = Params::paper();
    let made = |rules: RuleTable| {
        let options = FuzzyOptions::default();
        FuzzyMamdani::with_rules(&params, CONTROL_DT, rules, &options, &LimitOptions::TRACTION)
    };
    let message = made(RuleTable::new([[0.0; SETS]; SETS]).unwrap()).unwrap_err().to_string();
    assert!(message.contains("it must be below 1"), "{message}");
    let mut rules = odd_rules();
    rules[2][5] = 1.5;
    let message = RuleTable::new(rules).unwrap_err().to_string();
    assert!(message.contains("consequents[2][5] = 1.5"), "{message}");
    // The default rules, bent.
    let bent = std::array::from_fn(|i| std::array::from_fn(|j| ((i + j) as f64 - 6.0).clamp(-3.0, 3.0) / 3.0))
        .map(|row: [f64; SETS]| row.map(|c| c.signum() * c.abs().powf(0.9)));
    let mut law = made(RuleTable::new(bent).unwrap()).unwrap();
    let start = State::tilted(&params, nalgebra::Vector2::new(0.2, 0.1), 0.0);
    let mut robot = robot(&params, ModelKind::Contact, &start);
    let end = run(&mut robot, &mut law as &mut dyn Controller, 10.0, position(0.0, 0.0), |_, _| ()).unwrap().end;
    assert!(end.tilt() < 1e-3, "{} rad", end.tilt());
}
