//! Policies as controllers.

use ballbot_core::batch::{
    Autoreset, Batch, EnvConfig, History, Layer, Networks, StepResults, TaskConfig, policy_controller,
};
use ballbot_core::control::{LaneSetpoint, Setpoint, default_max_torque};
use ballbot_core::kinematics::Omniwheels;
use ballbot_core::lanes::{EIGHT, Eight, Heading};
use ballbot_core::models::LinearModel;
use ballbot_core::models::linear::STATES;
use ballbot_core::nalgebra::{Matrix2, Rotation2, SVector, Vector2, Vector3};
use ballbot_core::task::{ACTION_LEN, Balance, Goal, Push, Task, Velocity};
use ballbot_core::{LaneState, Params, State};

/// A network with small numbers of all signs.
struct Network {
    widths: Vec<usize>,
    /// Weights and biases of each layer.
    numbers: Vec<[Vec<f64>; 2]>,
}

impl Network {
    fn new(widths: &[usize]) -> Self {
        let numbers = |count: usize, size: f64| (0..count).map(|i| size * ((i * i) as f64).sin()).collect();
        let layer = |pair: &[usize]| [numbers(pair[0] * pair[1], 0.5 / (pair[0] as f64).sqrt()), numbers(pair[1], 0.1)];
        Self { widths: widths.into(), numbers: widths.windows(2).map(layer).collect() }
    }

    fn layers(&self) -> Vec<Layer<'_>> {
        let pairs = self.widths.windows(2).zip(&self.numbers);
        pairs.map(|(w, [weights, biases])| Layer { inputs: w[0], outputs: w[1], weights, biases }).collect()
    }
}

/// The setpoint that a robot of the batch has.
type SetpointOf = fn(&mut Batch, usize) -> Setpoint;

/// A network chooses the same actions as a controller, for one robot and for eight, as in the environment of its task.
fn acts_as_in<T: Task>(robot: &str, options: &[(&str, &[f64])], ages: &[f64], setpoint_of: SetpointOf) {
    const N: usize = EIGHT;
    let history = History::of_ages(ages).unwrap();
    let params = Params::preset(robot).unwrap();
    let mut config = EnvConfig::<T> { params: params.clone(), history: history.clone(), ..EnvConfig::default() };
    for (name, values) in options {
        TaskConfig::set(&mut config, name, values).unwrap();
    }
    let mut batch = Batch::new(&config, N, Autoreset::Disabled, Some(1), 3).unwrap();
    let inputs = batch.observation_len();
    let network = Network::new(&[inputs, 12, ACTION_LEN]);
    let networks = Networks::shared(N, &network.layers()).unwrap();
    let policy = policy_controller(T::NAME, &params, options, &history, &[], &network.layers()).unwrap();
    let torque = config.action_torque();

    let mut results = StepResults::new(&batch);
    batch.reset(None, &mut results.observations).unwrap();
    let mut own = vec![vec![0.0; policy.memory_len()]; N];
    let mut lanes = vec![Eight::default(); policy.memory_len()];
    for step in 0..20 {
        let mut actions = [0.0; N * ACTION_LEN];
        networks.act(&results.observations, &mut actions).unwrap();
        let (mut states, mut setpoints) = (LaneState::<Eight>::default(), LaneSetpoint::<Eight>::default());
        for i in 0..N {
            states.set_lane(i, &LaneState::from(&batch.state(i).unwrap()));
            setpoints.set_lane(i, &LaneSetpoint::from(&setpoint_of(&mut batch, i)));
        }
        let together = policy.torques_eight(&states, &setpoints, f64::INFINITY, &mut lanes);
        for i in 0..N {
            let alone = policy.torques_one(&states.lane(i), &setpoints.lane(i), f64::INFINITY, &mut own[i]);
            for k in 0..ACTION_LEN {
                let action = f64::from(actions[i * ACTION_LEN + k]);
                // Observations of environments are rounded to f32.
                assert!((alone[k] / torque - action).abs() < 2e-6, "{} {step} {i} {k}: {action}", T::NAME);
                assert!((together[k].0[i] - alone[k]).abs() < 1e-12);
            }
        }
        batch.step(&actions, &mut results.buffers()).unwrap();
        assert!(!results.terminated.contains(&true), "{} {step}", T::NAME);
    }
}

#[test]
fn a_policy_acts_as_in_its_environment() {
    let own: SetpointOf = |batch, i| {
        let yaw = LaneState::from(&batch.state(i).unwrap()).body_quaternion.yaw();
        Setpoint { yaw, ..batch.setpoint(i).unwrap() }
    };
    let velocity: SetpointOf = |batch, i| {
        let mut command = [0.0; 3];
        batch.command(i, &mut command).unwrap();
        let heading = Heading::new(LaneState::from(&batch.state(i).unwrap()).body_quaternion);
        let [x, y] = heading.to_inertial(command[0], command[1]);
        Setpoint { velocity: Vector2::new(x, y), yaw_rate: command[2], ..Setpoint::default() }
    };
    acts_as_in::<Balance>("paper", &[], &[0.0], own);
    acts_as_in::<Balance>("kugle", &[("scale_by_robot", &[1.0])], &[0.0, 1.0, 4.0], own);
    acts_as_in::<Balance>("paper", &[("scale_observations", &[0.0]), ("max_wheel_torque", &[0.3])], &[0.0, 1.0], own);
    acts_as_in::<Balance>("kugle", &[("scale_by_robot", &[1.0]), ("integral_rate", &[8.0])], &[0.0, 1.0, 4.0], own);
    acts_as_in::<Push>("asroballet", &[("integral_rate", &[5.0])], &[0.0], own);
    acts_as_in::<Goal>("paper", &[], &[0.0, 2.0], own);
    acts_as_in::<Velocity>("rezero", &[], &[0.0], velocity);
}

/// The textbook form of an LSTM cell, from the outputs and states of the last step; returns the outputs.
fn lstm(cell: &Layer<'_>, inputs: &[f64], outputs: &mut Vec<f64>, states: &mut [f64]) -> Vec<f64> {
    let (units, given) = (states.len(), [inputs, &outputs[..]].concat());
    let sum = |row: usize| {
        let weights = &cell.weights[row * cell.inputs..][..cell.inputs];
        let products = weights.iter().zip(&given).map(|(weight, value)| f64::from(*weight as f32) * value);
        f64::from(cell.biases[row] as f32) + products.sum::<f64>()
    };
    let sigmoid = |x: f64| 1.0 / (1.0 + (-x).exp());
    *outputs = (0..units)
        .map(|j| {
            states[j] = sigmoid(sum(units + j)) * states[j] + sigmoid(sum(j)) * sum(2 * units + j).tanh();
            sigmoid(sum(3 * units + j)) * states[j].tanh()
        })
        .collect();
    outputs.clone()
}

#[test]
fn cells_keep_their_state_in_the_memory_of_each_robot() {
    let params = Params::paper();
    let history = History::of_ages(&[0.0, 2.0]).unwrap();
    let config = EnvConfig::<Balance> { history: history.clone(), ..EnvConfig::default() };
    let mut batch = Batch::new(&config, EIGHT, Autoreset::Disabled, Some(1), 3).unwrap();
    let inputs = batch.observation_len();
    // As layers, cells of 5 and 4 units, and then dense layers.
    let [first, second] = [(inputs + 5, 4 * 5), (5 + 4, 4 * 4)].map(|(from, to)| Network::new(&[from, to]));
    let cells = [first.layers()[0], second.layers()[0]];
    let dense = Network::new(&[4, 6, ACTION_LEN]);
    let networks = Networks::new(1, &dense.layers()).unwrap();
    let policy = policy_controller("balance", &params, &[], &history, &cells, &dense.layers()).unwrap();
    let plain =
        policy_controller("balance", &params, &[], &history, &[], &Network::new(&[inputs, 3]).layers()).unwrap();
    assert_eq!(policy.memory_len(), plain.memory_len() - 3 + 6 * 5 + 6 * 4 + 6 + 3);

    let mut results = StepResults::new(&batch);
    batch.reset(None, &mut results.observations).unwrap();
    let mut own = vec![vec![0.0; policy.memory_len()]; EIGHT];
    let mut lanes = vec![Eight::default(); policy.memory_len()];
    let mut state = vec![[(vec![0.0; 5], vec![0.0; 5]), (vec![0.0; 4], vec![0.0; 4])]; EIGHT];
    let mut is_kept = false;
    for step in 0..30 {
        // The episode of one robot begins again, the others continue.
        if step == 12 {
            state[3] = [(vec![0.0; 5], vec![0.0; 5]), (vec![0.0; 4], vec![0.0; 4])];
            own[3].fill(0.0);
            lanes.iter_mut().for_each(|number| number.0[3] = 0.0);
            batch.reset(Some(&std::array::from_fn::<_, EIGHT, _>(|i| i == 3)), &mut results.observations).unwrap();
        }
        let mut actions = [0.0; EIGHT * ACTION_LEN];
        let (mut states, mut setpoints) = (LaneState::<Eight>::default(), LaneSetpoint::<Eight>::default());
        for i in 0..EIGHT {
            let rows: Vec<f64> =
                results.observations[i * inputs..][..inputs].iter().map(|row| f64::from(*row)).collect();
            let [one, two] = &mut state[i];
            let between = lstm(&cells[0], &rows, &mut one.0, &mut one.1);
            let last: Vec<f32> =
                lstm(&cells[1], &between, &mut two.0, &mut two.1).iter().map(|value| *value as f32).collect();
            networks.act(&last, &mut actions[i * ACTION_LEN..][..ACTION_LEN]).unwrap();
            let seen = batch.state(i).unwrap();
            let yaw = LaneState::from(&seen).body_quaternion.yaw();
            let setpoint = Setpoint { yaw, ..batch.setpoint(i).unwrap() };
            states.set_lane(i, &LaneState::from(&seen));
            setpoints.set_lane(i, &LaneSetpoint::from(&setpoint));
        }
        let together = policy.torques_eight(&states, &setpoints, f64::INFINITY, &mut lanes);
        for i in 0..EIGHT {
            let alone = policy.torques_one(&states.lane(i), &setpoints.lane(i), f64::INFINITY, &mut own[i]);
            let fresh =
                policy.torques_one(&states.lane(i), &setpoints.lane(i), f64::INFINITY, &mut vec![0.0; own[i].len()]);
            is_kept |= (0..ACTION_LEN).any(|k| (fresh[k] - alone[k]).abs() > 1e-3);
            for k in 0..ACTION_LEN {
                let action = f64::from(actions[i * ACTION_LEN + k]);
                assert!((alone[k] / config.action_torque() - action).abs() < 2e-6, "{step} {i} {k}: {action}");
                assert!((together[k].0[i] - alone[k]).abs() < 1e-12);
            }
        }
        batch.step(&actions, &mut results.buffers()).unwrap();
    }
    assert!(is_kept);
}

#[test]
fn cells_that_do_not_fit_are_named() {
    let error = |cells: &[[usize; 2]], widths: &[usize]| {
        let made: Vec<_> = cells.iter().map(|shape| Network::new(shape)).collect();
        let cells: Vec<_> = made.iter().map(|network| network.layers()[0]).collect();
        let layers = Network::new(widths);
        policy_controller("balance", &Params::paper(), &[], &History::default(), &cells, &layers.layers())
            .err()
            .unwrap()
            .to_string()
    };
    for (found, words) in [
        (error(&[[20, 15]], &[4, 3]), "outputs of cell 0: 15, expected 4 for each unit"),
        (error(&[[20, 0]], &[4, 3]), "outputs of cell 0: 0, expected 4 for each unit"),
        (error(&[[21, 16]], &[4, 3]), "inputs of cell 0: 21, expected 16 rows of the task balance"),
        (error(&[[20, 16], [5, 8]], &[2, 3]), "inputs of cell 1: 5, expected 4 units of cell 0 and 2 units"),
        (error(&[[20, 16]], &[5, 3]), "inputs of layer 0: 5, expected 4 units of the last cell"),
    ] {
        assert!(found.contains(words), "{found}");
    }
    let (short, network) = ([0.0; 7], Network::new(&[4, 3]));
    let cell = Layer { inputs: 20, outputs: 16, weights: &short, biases: &short };
    let made = policy_controller("balance", &Params::paper(), &[], &History::default(), &[cell], &network.layers());
    let found = made.err().unwrap().to_string();
    assert!(found.contains("weights of cell 0") && found.contains("320"), "{found}");
}

/// A state that moves with a velocity, and turns at a rate about the vertical.
fn moving(params: &Params, state: &State, place: Vector3<f64>, velocity: Vector3<f64>, rate: f64) -> State {
    let rolling = Vector3::new(-velocity.y, velocity.x, 0.0) / params.ball_radius;
    let turning = state.body_quaternion.inverse_transform_vector(&(rate * Vector3::z()));
    let mut state = state.clone();
    state.ball_position += place;
    state.body_position += place;
    state.ball_velocity = velocity;
    state.body_velocity = velocity;
    state.ball_angular_velocity = rolling;
    state.body_angular_velocity = turning;
    state.wheel_speeds = Omniwheels::new(params).wheel_speeds(&state.body_quaternion, &rolling, &turning);
    state
}

#[test]
fn a_balancing_policy_acts_in_the_frame_of_its_setpoint() {
    let params = Params::paper();
    let network = Network::new(&[16, 12, ACTION_LEN]);
    let torques_of = |params: &Params, state: &State, setpoint: &Setpoint| {
        let layers = network.layers();
        let mut policy = policy_controller("balance", params, &[], &History::default(), &[], &layers).unwrap();
        policy.wheel_torques(state, setpoint).0
    };
    let torques = |state: &State, setpoint: &Setpoint| torques_of(&params, state, setpoint);
    let close = |found: [f64; ACTION_LEN], expected: [f64; ACTION_LEN], limit: f64| {
        let far = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(far < limit, "{found:?}, {expected:?}");
    };
    let yaw = 0.7;
    let upright = State::tilted(&params, Vector2::zeros(), yaw);
    let leaning = State::tilted(&params, Vector2::new(0.03, -0.02), yaw);
    let still = Setpoint { yaw, ..Setpoint::default() };
    let (place, velocity, rate) = (Vector3::new(0.4, -1.0, 0.0), Vector3::new(0.5, 0.3, 0.0), -0.4);
    let on_the_way = Setpoint { position: place.xy(), velocity: velocity.xy(), yaw, yaw_rate: rate, ..still };
    close(torques(&moving(&params, &upright, place, velocity, rate), &on_the_way), torques(&upright, &still), 1e-9);
    // The frame has the wheel speeds of the upright robot, which a lean changes by its square.
    close(
        torques(&moving(&params, &leaning, place, velocity, 0.0), &Setpoint { yaw_rate: 0.0, ..on_the_way }),
        torques(&leaning, &still),
        0.005,
    );

    // A robot that accelerates leans, and its wheels have the torques that hold the lean.
    let LinearModel { a, b } = LinearModel::new(&params);
    let acceleration = Vector2::new(0.05, -0.02);
    let holding = |tilt: Vector2<f64>| {
        let mut x = SVector::<f64, STATES>::zeros();
        x.fixed_rows_mut::<2>(2).copy_from(&tilt);
        let torques = b.fixed_view::<3, 3>(7, 0).into_owned().try_inverse().unwrap() * -(a * x).fixed_rows::<3>(7);
        ((a * x + b * torques).fixed_rows::<2>(5).into_owned(), torques)
    };
    let per_tilt = Matrix2::from_columns(&[holding(Vector2::x()).0, holding(Vector2::y()).0]);
    let heading = Rotation2::new(yaw);
    let tilt = per_tilt.try_inverse().unwrap() * (heading.inverse() * acceleration);
    let of_lean = torques(&State::tilted(&params, heading * tilt, yaw), &Setpoint { acceleration, ..still });
    let held = holding(tilt).1;
    let upright_now = torques(&upright, &still);
    close(of_lean, std::array::from_fn(|i| upright_now[i] + held[i]), 1e-9);

    // The friction of the joints in the motion is compensated.
    let rubbing = Params { wheel_viscous_friction: 1e-3, wheel_coulomb_friction: 0.02, ..params.clone() };
    let passing = moving(&rubbing, &upright, place, velocity, rate);
    let unmoved = torques_of(&rubbing, &upright, &still);
    let friction = passing.wheel_speeds.0.map(|speed| 1e-3 * speed + 0.02 * speed / speed.hypot(1.0));
    close(torques_of(&rubbing, &passing, &on_the_way), std::array::from_fn(|i| unmoved[i] + friction[i]), 1e-9);

    // While the robot turns, the policy does not see the ball spin.
    let turning = Setpoint { yaw: yaw + 0.1, ..still };
    let spinning = |rate: f64, setpoint: &Setpoint| {
        let mut state = upright.clone();
        state.ball_angular_velocity.z = rate;
        let (ball, body) = (state.ball_angular_velocity, state.body_angular_velocity);
        state.wheel_speeds = Omniwheels::new(&params).wheel_speeds(&state.body_quaternion, &ball, &body);
        torques(&state, setpoint)
    };
    for rate in [0.5, 20.0] {
        close(spinning(rate, &turning), spinning(0.0, &turning), 1e-9);
        assert!(spinning(rate, &still) != spinning(0.0, &still));
    }

    // Nor the body: a PD law turns it towards the heading of the setpoint, as for at most half a radian, and with at most
    // 0.3 of the default torque.
    let turned = |error: f64, rate: f64| {
        let state = moving(&params, &upright, Vector3::zeros(), Vector3::zeros(), rate);
        let found = torques(&state, &Setpoint { yaw: yaw + error, ..still });
        SVector::<f64, ACTION_LEN>::from_fn(|i, _| found[i] - upright_now[i])
    };
    for (error, rate) in [(0.1, 0.1), (0.1, 0.2), (0.1, 0.3), (-0.05, 0.0)] {
        let acceleration = b.fixed_view::<3, 3>(7, 0) * turned(error, rate);
        let expected = Vector3::new(0.0, 0.0, 8.0 * (2.0 * error - rate));
        assert!((acceleration - expected).amax() < 1e-6, "{acceleration}, {expected}");
    }
    let [half, behind, fast] = [turned(0.5, 0.0), turned(2.0, 0.0), turned(0.1, -50.0)];
    assert!((half - behind).amax() < 1e-12, "{half}, {behind}");
    assert!((fast.amax() - 0.3 * default_max_torque(&params)).abs() < 1e-9, "{fast}");
}

#[test]
fn what_does_not_fit_a_policy_is_named() {
    let error = |task: &str, options: &[(&str, &[f64])], history: &History, widths: &[usize]| {
        let network = Network::new(widths);
        policy_controller(task, &Params::paper(), options, history, &[], &network.layers()).err().unwrap().to_string()
    };
    let now = History::default();
    for (found, words) in [
        (error("path", &[], &now, &[16, 3]), "path"),
        (error("balance", &[], &now, &[17, 3]), "16 rows of the task balance for each of 1 ages"),
        (error("balance", &[], &now, &[16, 4]), "outputs of layer 0: 4, expected 3"),
        (error("balance", &[("tilt", &[1.0])], &now, &[16, 3]), "tilt"),
        (error("balance", &[("max_wheel_torque", &[-1.0])], &now, &[16, 3]), "max_wheel_torque"),
        (error("balance", &[], &History::Ages(vec![1]), &[16, 3]), "the first age must be 0"),
    ] {
        assert!(found.contains(words), "{found}");
    }
}
