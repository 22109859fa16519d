//! Derivatives of the model `contact`, as multiples of the motion that they differentiate:
//! `cargo bench --bench gradients`.

use ballbot_contact::{Constants, ContactState, SolvedStep, advance};
use ballbot_core::gradients::{Coordinates, Differentiable, Differentiated, Jacobian};
use ballbot_core::kinematics::Omniwheels;
use ballbot_core::{Params, State, Wheels, attitude};
use nalgebra::{DVector, Vector2, Vector3};
use std::hint::black_box;
use std::time::Instant;

/// Time step, s.
const SIM_DT: f64 = 0.001;

const TORQUES: Wheels<f64> = Wheels([0.02, -0.01, 0.01]);

/// Steps of a rollout, and of each of its motions, under torques that are held.
const ROLLOUT: usize = 200;
const HELD: [usize; 3] = [1, 10, 50];

/// Rounds, in each of which all computations are timed one after the other: so all meet the same machine.
const ROUNDS: usize = 200;

fn main() {
    let params = Params::paper();
    let constants = Constants::new(&params, SIM_DT);
    let body = attitude(Vector2::new(0.03, -0.05), 0.6);
    let start = State::rolling(&params, Vector2::new(0.1, -0.05), 0.2, body, Vector3::new(0.2, -0.1, 0.3));
    let mut state = ContactState::at(&constants, &Omniwheels::new(&params), None, &start);
    // The loads of a moving robot.
    advance(&constants, &mut state, None, TORQUES, 20);
    let robot = || {
        Differentiated::new(&params, &constants, state.clone(), None, &[], Coordinates::All)
            .expect("the paper's robot has derivatives")
    };

    println!("shortest of {ROUNDS} interleaved rounds                µs   of the motion");
    for steps in [1, 10, 50] {
        let [motion, rolling, all] = shortest([
            &mut || advance(&constants, black_box(&mut state.clone()), None, TORQUES, steps),
            &mut || {
                black_box(robot().advance_rolling(TORQUES, steps, &params).expect("the robot rolls"));
            },
            &mut || {
                black_box(robot().advance(TORQUES, steps).expect("the robot rolls"));
            },
        ]);
        line(&format!("motion of {steps} steps"), motion, motion);
        line(&format!("12 columns, {steps} steps"), rolling, motion);
        line(&format!("33 columns, {steps} steps"), all, motion);
    }
    let [step, contacts] =
        shortest([&mut || advance(&constants, black_box(&mut state.clone()), None, TORQUES, 1), &mut || {
            black_box(SolvedStep::new(&constants, &state, None, TORQUES, false));
        }]);
    line("contacts of a step", contacts, step);
    for held in HELD {
        let [rollout, reverse] = shortest([
            &mut || {
                let mut state = state.clone();
                (0..ROLLOUT / held).for_each(|_| advance(&constants, black_box(&mut state), None, TORQUES, held));
            },
            &mut || {
                let mut robot = robot();
                let motions = (0..ROLLOUT / held).map(|_| robot.advance(TORQUES, held)).collect::<Result<Vec<_>, _>>();
                black_box(gradient(&motions.expect("the robot rolls")));
            },
        ]);
        line(&format!("rollout of {ROLLOUT} steps, {held} under the same torques"), rollout, rollout);
        line("its gradient in reverse", reverse, rollout);
    }
}

/// Gradient of the last ball position along x with respect to the first state and all torques.
fn gradient(motions: &[Jacobian]) -> (DVector<f64>, Vec<DVector<f64>>) {
    let mut weights = DVector::zeros(motions[0].a.nrows());
    weights[0] = 1.0;
    let mut by_torques: Vec<_> = motions
        .iter()
        .rev()
        .map(|motion| {
            let gradient = motion.b.tr_mul(&weights);
            weights = motion.a.tr_mul(&weights);
            gradient
        })
        .collect();
    by_torques.reverse();
    (weights, by_torques)
}

/// Shortest times of computations, µs.
fn shortest<const N: usize>(mut computations: [&mut dyn FnMut(); N]) -> [f64; N] {
    /// Runs per time, since a clock is coarse.
    const RUNS: u32 = 8;
    let mut shortest = [f64::INFINITY; N];
    for _ in 0..ROUNDS {
        for (shortest, computation) in shortest.iter_mut().zip(&mut computations) {
            let begin = Instant::now();
            (0..RUNS).for_each(|_| computation());
            *shortest = shortest.min(begin.elapsed().as_secs_f64() * 1e6 / f64::from(RUNS));
        }
    }
    shortest
}

fn line(name: &str, time: f64, motion: f64) {
    println!("{name:<48} {time:>8.2} {:>8.1}", time / motion);
}
