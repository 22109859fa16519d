//! The robots of a chunk: one of any model, or eight of the contact model in lanes.

use super::ledger::{Ledger, Ledgers};
use super::measure::Measured;
use super::task_step::{Simulated, TaskStep};
use crate::actuator::Actuator;
use crate::control::LaneWidth;
use crate::robot::{Ballbot, check_push, check_state};
use crate::sensor::Sensor;
use crate::task::Task;
use ballbot_base::collision_shape::CollisionShape;
use ballbot_base::error::{Error, Result};
use ballbot_base::force::{Force, HeldForce};
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::lane_state::{ConditionCells, LaneRobot, LaneState};
use ballbot_base::lanes::{EIGHT, Eight, Kernel, Lane, Memory, Registers, Scalar, Vec3, Wide, run_eight};
use ballbot_base::model::same_geometry;
use ballbot_base::params::Params;
use ballbot_base::payload::{Deflection, PAYLOADS};
use ballbot_base::snapshot;
use ballbot_base::state::{Contacts, State};
use ballbot_base::terrain::Ground;
use ballbot_base::wheels::Wheels;
use ballbot_gradients::{Coordinates, Differentiable, Differentiated, Parameter};
use ballbot_lanes::ContactLanes;
use nalgebra::Vector3;

/// Robots that are stepped together; `i` counts within them.
pub trait Robots: Send + Sync {
    /// Their numbers in memory.
    type Cell: Ledgers + LaneWidth + Measured;

    /// Advances all by `steps` model steps under commands in [-1, 1]. `one` is scratch space for the actuator of one
    /// robot.
    fn drive<A: Actuator>(
        &mut self,
        actuator: &A,
        commands: &Wheels<Self::Cell>,
        memory: &mut [Self::Cell],
        one: &mut [f64],
        steps: usize,
    );

    /// Concludes a control step; `one` is scratch space for the ledger of one robot, `com_directions` are as in
    /// [`TaskStep::run`].
    fn conclude<T: Task, S: Sensor>(
        &self,
        step: &TaskStep<T, S>,
        commands: &Wheels<Self::Cell>,
        com_directions: &[Self::Cell; 3],
        ledger: &mut Ledger<Self::Cell>,
        one: &mut Ledger<f64>,
    );

    /// The ground; `None` for level ground.
    fn ground(&self) -> Option<&Ground>;

    /// Writes the states of all.
    fn read(&self, states: &mut LaneState<Self::Cell>);

    /// Restarts robot `i` from an accepted state.
    fn place(&mut self, i: usize, state: &State);

    /// Keeps the robots from index `used` on, which belong to no environment, upright at rest.
    fn park(&mut self, used: usize);

    /// Checks that [`Robots::place`] would accept a state.
    ///
    /// # Errors
    /// As [`Ballbot::reset`].
    fn accepts(&self, i: usize, state: &State) -> Result<()>;

    /// [`Robots::accepts`] of a robot with other valid parameters.
    ///
    /// # Errors
    /// As [`Ballbot::new`] and [`Ballbot::reset`].
    fn accepts_as(&self, params: &Params, state: &State) -> Result<()>;

    /// Checks that [`Robots::set_params`] would accept parameters.
    ///
    /// # Errors
    /// As [`Ballbot::set_params`].
    fn could_have(&self, params: &Params) -> Result<()>;

    /// State of robot `i`.
    fn state(&self, i: usize) -> State;

    /// The same for computations written over lanes.
    fn lane_state(&self, i: usize) -> LaneState<f64>;

    /// Contact forces of the last step of robot `i`.
    fn contacts(&self, i: usize) -> Contacts;

    /// As [`Ballbot::jacobian`]: robot `i`, as it moves next.
    ///
    /// # Errors
    /// As [`Ballbot::jacobian`].
    fn differentiated(
        &self,
        i: usize,
        parameters: &[Parameter],
        coordinates: Coordinates,
    ) -> Result<Box<dyn Differentiable>>;

    /// Parameters of robot `i`.
    fn params(&self, i: usize) -> &Params;

    /// Wheels of robot `i`.
    fn wheels(&self, i: usize) -> &Omniwheels;

    /// As [`Ballbot::set_params`].
    ///
    /// # Errors
    /// As [`Ballbot::set_params`].
    fn set_params(&mut self, i: usize, params: &Params) -> Result<bool>;

    /// As [`Ballbot::push`].
    ///
    /// # Errors
    /// As [`Ballbot::push`].
    fn push(&mut self, i: usize, impulse: &Vector3<f64>, point: Option<&Vector3<f64>>) -> Result<()>;

    /// As [`Ballbot::apply_force`].
    ///
    /// # Errors
    /// As [`Ballbot::apply_force`].
    fn apply_force(&mut self, i: usize, force: &Force) -> Result<()>;

    /// As [`Ballbot::move_payload`].
    ///
    /// # Errors
    /// As [`Ballbot::move_payload`].
    fn move_payload(&mut self, i: usize, payload: usize, offset: [f64; 3]) -> Result<()>;

    /// Moves the first payloads of all robots to offsets along the body axes, m, of robots that have one.
    fn move_payloads(&mut self, offsets: &[Self::Cell; 3]);

    /// As [`Ballbot::payloads`].
    fn payloads(&self, i: usize) -> [Deflection<f64>; PAYLOADS];

    /// As [`Ballbot::set_payloads`].
    ///
    /// # Errors
    /// As [`Ballbot::set_payloads`].
    fn set_payloads(&mut self, i: usize, deflections: &[Deflection<f64>; PAYLOADS]) -> Result<()>;

    /// As [`Ballbot::has_force`].
    fn has_force(&self, i: usize) -> bool;

    /// As [`Model::pending_push`](ballbot_base::model::Model::pending_push).
    fn pending_push(&self, i: usize) -> [f64; 6];

    /// Bytes of robot `i` for [`Robots::load`].
    fn save(&self, i: usize) -> Vec<u8>;

    /// Continues from bytes of [`Robots::save`] of a robot of the same model and parameters.
    ///
    /// # Errors
    /// [`Error::Decode`] if the bytes are not such a snapshot.
    fn load(&mut self, i: usize, bytes: &[u8]) -> Result<()>;
}

/// One robot of any model.
pub struct Single {
    pub robot: Ballbot,
    wheels: Omniwheels,
}

impl Single {
    pub fn new(robot: Ballbot) -> Self {
        Self { wheels: Omniwheels::new(robot.params()), robot }
    }
}

impl Robots for Single {
    type Cell = f64;

    fn drive<A: Actuator>(
        &mut self,
        actuator: &A,
        commands: &Wheels<f64>,
        memory: &mut [f64],
        _: &mut [f64],
        steps: usize,
    ) {
        let mut memory = Memory::<f64>::new(Scalar, memory);
        if actuator.is_held() {
            let torques = actuator.torques(*commands, Wheels::default(), &mut memory);
            self.robot.advance(torques, steps);
            return;
        }
        for _ in 0..steps {
            let torques = actuator.torques(*commands, self.robot.state().wheel_speeds, &mut memory);
            self.robot.advance(torques, 1);
        }
    }

    fn conclude<T: Task, S: Sensor>(
        &self,
        step: &TaskStep<T, S>,
        commands: &Wheels<f64>,
        com_directions: &[f64; 3],
        ledger: &mut Ledger<f64>,
        _: &mut Ledger<f64>,
    ) {
        let robot = LaneRobot {
            state: LaneState::from(&self.robot.state()),
            healthy: self.robot.healthy(),
            on_floor: self.robot.bot_on_floor(),
            on_obstacle: self.robot.on_obstacle(),
        };
        let mut measured = robot.state;
        step.measure(&mut measured, ledger, &mut []);
        let payload = if T::LEAN.is_some() { self.robot.payloads()[0] } else { Deflection::default() };
        step.run_one(&Simulated { robot, measured, payload }, commands, com_directions, ledger);
    }

    fn ground(&self) -> Option<&Ground> {
        self.robot.ground().map(|ground| &**ground)
    }

    fn read(&self, states: &mut LaneState<f64>) {
        *states = LaneState::from(&self.robot.state());
    }

    fn place(&mut self, _: usize, state: &State) {
        self.robot.place(state);
    }

    fn park(&mut self, _: usize) {}

    fn accepts(&self, _: usize, state: &State) -> Result<()> {
        self.robot.accepts(state)
    }

    fn accepts_as(&self, params: &Params, state: &State) -> Result<()> {
        self.robot.alike(params)?.accepts(state)
    }

    fn could_have(&self, params: &Params) -> Result<()> {
        self.robot.alike(params).map(|_| ())
    }

    fn state(&self, _: usize) -> State {
        self.robot.state()
    }

    fn lane_state(&self, _: usize) -> LaneState<f64> {
        LaneState::from(&self.robot.state())
    }

    fn contacts(&self, _: usize) -> Contacts {
        self.robot.contacts()
    }

    fn differentiated(
        &self,
        _: usize,
        parameters: &[Parameter],
        coordinates: Coordinates,
    ) -> Result<Box<dyn Differentiable>> {
        self.robot.differentiated(parameters, coordinates)
    }

    fn params(&self, _: usize) -> &Params {
        self.robot.params()
    }

    fn wheels(&self, _: usize) -> &Omniwheels {
        &self.wheels
    }

    fn set_params(&mut self, _: usize, params: &Params) -> Result<bool> {
        params.validate()?;
        let continues = params == self.robot.params() || self.robot.change_params(params)?;
        self.wheels = Omniwheels::new(params);
        Ok(continues)
    }

    fn push(&mut self, _: usize, impulse: &Vector3<f64>, point: Option<&Vector3<f64>>) -> Result<()> {
        self.robot.push(impulse, point)
    }

    fn apply_force(&mut self, _: usize, force: &Force) -> Result<()> {
        self.robot.apply_force(force)
    }

    fn move_payload(&mut self, _: usize, payload: usize, offset: [f64; 3]) -> Result<()> {
        self.robot.move_payload(payload, offset)
    }

    fn move_payloads(&mut self, offsets: &[f64; 3]) {
        self.robot.move_rider(*offsets);
    }

    fn payloads(&self, _: usize) -> [Deflection<f64>; PAYLOADS] {
        self.robot.payloads()
    }

    fn set_payloads(&mut self, _: usize, deflections: &[Deflection<f64>; PAYLOADS]) -> Result<()> {
        self.robot.set_payloads(deflections)
    }

    fn has_force(&self, _: usize) -> bool {
        self.robot.has_force()
    }

    fn pending_push(&self, _: usize) -> [f64; 6] {
        self.robot.pending_push()
    }

    fn save(&self, _: usize) -> Vec<u8> {
        self.robot.save_model()
    }

    fn load(&mut self, _: usize, bytes: &[u8]) -> Result<()> {
        self.robot.load_model(bytes)
    }
}

impl Robots for ContactLanes {
    type Cell = Eight;

    fn drive<A: Actuator>(
        &mut self,
        actuator: &A,
        commands: &Wheels<Eight>,
        memory: &mut [Eight],
        one: &mut [f64],
        steps: usize,
    ) {
        self.drive_lanes(actuator, commands, memory, one, steps);
    }

    fn conclude<T: Task, S: Sensor>(
        &self,
        step: &TaskStep<T, S>,
        commands: &Wheels<Eight>,
        com_directions: &[Eight; 3],
        ledger: &mut Ledger<Eight>,
        one: &mut Ledger<f64>,
    ) {
        let (mut states, mut conditions) = (LaneState::default(), ConditionCells::default());
        ContactLanes::read(self, &mut states, &mut conditions);
        let mut measured = states;
        step.measure(&mut measured, ledger, &mut one.sensor);
        let payloads = &T::LEAN.map(|_| self.payload_deflections(&states));
        let (states, measured, conditions) = (&states, &measured, &conditions);
        run_eight(Conclude { step, states, measured, payloads, conditions, commands, com_directions, ledger, one });
    }

    fn ground(&self) -> Option<&Ground> {
        ContactLanes::ground(self)
    }

    fn read(&self, states: &mut LaneState<Eight>) {
        ContactLanes::read(self, states, &mut ConditionCells::default());
    }

    fn place(&mut self, i: usize, state: &State) {
        self.place_lane(i, state);
    }

    fn park(&mut self, used: usize) {
        (used..EIGHT).for_each(|i| self.place_upright(i));
    }

    fn accepts(&self, i: usize, state: &State) -> Result<()> {
        check_state(self.lane_params(i), self.ground(), state)?;
        CollisionShape::new(self.lane_params(i), self.lane_wheels(i)).require_above(self.ground(), state)
    }

    fn accepts_as(&self, params: &Params, state: &State) -> Result<()> {
        check_state(params, self.ground(), state)?;
        CollisionShape::new(params, &Omniwheels::new(params)).require_above(self.ground(), state)
    }

    fn could_have(&self, params: &Params) -> Result<()> {
        params.validate()?;
        params.validate_payload_step(self.sim_dt())
    }

    fn state(&self, i: usize) -> State {
        self.lane_state(i).into()
    }

    fn lane_state(&self, i: usize) -> LaneState<f64> {
        self.lane(i).read(&self.constants(i))
    }

    fn contacts(&self, i: usize) -> Contacts {
        self.lane(i).contacts(&self.constants(i), self.ground())
    }

    fn differentiated(
        &self,
        i: usize,
        parameters: &[Parameter],
        coordinates: Coordinates,
    ) -> Result<Box<dyn Differentiable>> {
        let (params, constants) = (self.lane_params(i), self.constants(i));
        let ground = self.shared_ground();
        Ok(Box::new(Differentiated::new(params, &constants, self.lane(i), ground, parameters, coordinates)?))
    }

    fn params(&self, i: usize) -> &Params {
        self.lane_params(i)
    }

    fn wheels(&self, i: usize) -> &Omniwheels {
        self.lane_wheels(i)
    }

    fn set_params(&mut self, i: usize, params: &Params) -> Result<bool> {
        if params == self.lane_params(i) {
            return Ok(true);
        }
        self.could_have(params)?;
        let continues = same_geometry(self.lane_params(i), params);
        self.set_lane_params(i, params);
        if !continues {
            self.place_upright(i);
        }
        Ok(continues)
    }

    fn push(&mut self, i: usize, impulse: &Vector3<f64>, point: Option<&Vector3<f64>>) -> Result<()> {
        check_push(impulse, point)?;
        let com = self.lane_params(i).body_com();
        let mut state = self.lane(i);
        state.push(&self.constants(i), impulse, point.unwrap_or(&com));
        self.set_lane(i, &state);
        Ok(())
    }

    fn apply_force(&mut self, i: usize, force: &Force) -> Result<()> {
        let sim_dt = self.constants(i).sim_dt;
        force.validate(sim_dt)?;
        let mut state = self.lane(i);
        state.force = HeldForce::new(force, &self.lane_params(i).body_com(), sim_dt);
        self.set_lane(i, &state);
        Ok(())
    }

    fn move_payload(&mut self, i: usize, payload: usize, offset: [f64; 3]) -> Result<()> {
        self.lane_params(i).validate_offset(payload, offset)?;
        let mut state = self.lane(i);
        state.payloads[payload].offset = offset;
        self.set_lane(i, &state);
        Ok(())
    }

    fn move_payloads(&mut self, offsets: &[Eight; 3]) {
        self.set_payload_offsets(offsets);
    }

    fn payloads(&self, i: usize) -> [Deflection<f64>; PAYLOADS] {
        self.lane(i).payload_deflections(&self.constants(i))
    }

    fn set_payloads(&mut self, i: usize, deflections: &[Deflection<f64>; PAYLOADS]) -> Result<()> {
        self.lane_params(i).validate_deflections(&"payloads", deflections)?;
        let mut state = self.lane(i);
        state.set_payloads(&self.constants(i), deflections);
        self.set_lane(i, &state);
        Ok(())
    }

    fn has_force(&self, i: usize) -> bool {
        self.lane(i).force.is_on()
    }

    fn pending_push(&self, i: usize) -> [f64; 6] {
        self.lane(i).push
    }

    fn save(&self, i: usize) -> Vec<u8> {
        snapshot::pack(&self.lane(i))
    }

    fn load(&mut self, i: usize, bytes: &[u8]) -> Result<()> {
        let state = snapshot::unpack("snapshot of a contact model", bytes)?;
        self.set_lane(i, &state);
        Ok(())
    }
}

/// A control step's conclusion in lanes.
struct Conclude<'a, T, S> {
    step: &'a TaskStep<T, S>,
    states: &'a LaneState<Eight>,
    measured: &'a LaneState<Eight>,
    /// If riders lean in the task.
    payloads: &'a Option<Deflection<Eight>>,
    conditions: &'a ConditionCells<Eight>,
    commands: &'a Wheels<Eight>,
    com_directions: &'a [Eight; 3],
    ledger: &'a mut Ledger<Eight>,
    one: &'a mut Ledger<f64>,
}

impl<T: Task, S: Sensor> Kernel for Conclude<'_, T, S> {
    #[inline(always)]
    fn run<V: Registers>(self, simd: V) {
        let robot = LaneRobot::<Wide<V>>::load(simd, self.states, self.conditions);
        let payload = match self.payloads {
            Some(payloads) => payloads.load(simd),
            None => {
                let zero = Vec3::zero(robot.state.ball_position.x.zero());
                Deflection { position: zero, velocity: zero }
            }
        };
        let simulated = Simulated { robot, measured: self.measured.load(simd), payload };
        self.step.run(simd, &simulated, self.commands, self.com_directions, self.ledger);
    }

    fn run_one_by_one(self) {
        for i in 0..EIGHT {
            let robot = LaneRobot::<f64>::load(Scalar, &self.states.lane(i), &self.conditions.lane(i));
            let measured = self.measured.lane(i).load(Scalar);
            let commands = self.commands.map(|eight| eight.0[i]);
            let com = self.com_directions.map(|eight| eight.0[i]);
            Eight::take(self.ledger, i, self.one);
            let payload = self.payloads.map_or_else(Deflection::default, |payloads| payloads.lane(i));
            self.step.run_one(&Simulated { robot, measured, payload }, &commands, &com, self.one);
            Eight::put(self.ledger, i, self.one);
        }
    }
}

/// The error for bytes that are not a snapshot of such an environment.
pub fn invalid_snapshot(reason: String) -> Error {
    Error::Decode { what: "snapshot of an environment".into(), reason }
}
