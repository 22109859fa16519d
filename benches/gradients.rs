//! Derivatives of the model `contact`, and the step that they differentiate: `cargo bench --bench gradients`.

use ballbot_contact::{Constants, ContactState, SolvedStep, advance};
use ballbot_core::gradients::{Coordinates, Differentiable, Differentiated};
use ballbot_core::kinematics::Omniwheels;
use ballbot_core::{Params, State, Wheels, attitude};
use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use nalgebra::{Vector2, Vector3};
use std::time::Duration;

/// Time step, s.
const SIM_DT: f64 = 0.001;

const TORQUES: Wheels<f64> = Wheels([0.02, -0.01, 0.01]);

fn gradients(criterion: &mut Criterion) {
    let params = Params::paper();
    let constants = Constants::new(&params, SIM_DT);
    let body = attitude(Vector2::new(0.03, -0.05), 0.6);
    let start = State::rolling(&params, Vector2::new(0.1, -0.05), 0.2, body, Vector3::new(0.2, -0.1, 0.3));
    let mut state = ContactState::at(&constants, &Omniwheels::new(&params), None, &start);
    // The loads of a moving robot.
    advance(&constants, &mut state, None, TORQUES, 20);

    let mut group = criterion.benchmark_group("gradients");
    for steps in [1, 10] {
        group.bench_function(format!("step/{steps}"), |b| {
            b.iter_batched_ref(
                || state.clone(),
                |state| advance(&constants, state, None, TORQUES, steps),
                BatchSize::SmallInput,
            );
        });
        let robot = || {
            Differentiated::new(&params, &constants, state.clone(), None, &[], Coordinates::All)
                .expect("the paper's robot has derivatives")
        };
        group.bench_function(format!("12 columns/{steps}"), |b| {
            b.iter_batched_ref(
                robot,
                |robot| robot.advance_rolling(TORQUES, steps, &params).expect("the robot rolls"),
                BatchSize::SmallInput,
            );
        });
        group.bench_function(format!("33 columns/{steps}"), |b| {
            b.iter_batched_ref(
                robot,
                |robot| robot.advance(TORQUES, steps).expect("the robot rolls"),
                BatchSize::SmallInput,
            );
        });
    }
    group.bench_function("contacts of a step", |b| b.iter(|| SolvedStep::new(&constants, &state, None, TORQUES)));
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(2));
    targets = gradients
}
criterion_main!(benches);
