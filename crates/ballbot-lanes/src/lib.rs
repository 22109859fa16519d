//! Eight robots of the contact model side by side, with equal or individual parameters.
//!
//! Most of the machine code of the workspace is here, so the crate is separate: other edits do not compile it again.

#![warn(clippy::print_stdout, clippy::print_stderr, clippy::unwrap_used)]

use ballbot_base::kinematics::Omniwheels;
use ballbot_base::lane_state::{ConditionCells, LaneState};
use ballbot_base::lanes::{EIGHT, Eight, Kernel, Memory, Registers, Scalar, Wide, run_eight, run_eight_at};
use ballbot_base::params::Params;
use ballbot_base::payload::Deflection;
use ballbot_base::state::State;
use ballbot_base::terrain::{Ground, upright_on};
use ballbot_base::wheels::Wheels;
use ballbot_contact::{
    Constants, ContactState, Footing, InLanes, LaneConstants, PerturbedFloor, advance, advance_wide,
};
use ballbot_stages::actuator::Actuator;
use fearless_simd::Level;
use std::borrow::Cow;
use std::sync::Arc;

/// Eight robots, in the order of the lanes.
pub struct ContactLanes {
    params: [Arc<Params>; EIGHT],
    wheels: [Arc<Omniwheels>; EIGHT],
    constants: LaneConstants,
    state: ContactState<Eight>,
    footing: Option<Box<Footing<Eight>>>,
    /// Floors that move, or on which friction differs from place to place, if any robot has one.
    perturbed: Option<Box<PerturbedFloor<Eight>>>,
    sim_dt: f64,
}

impl ContactLanes {
    /// Eight robots upright at rest.
    pub fn new(params: &Arc<Params>, sim_dt: f64) -> Self {
        let wheels = Arc::new(Omniwheels::new(params));
        let mut lanes = Self {
            constants: LaneConstants::of_all(Constants::new(params, sim_dt)),
            state: ContactState::default(),
            footing: None,
            perturbed: None,
            params: std::array::from_fn(|_| Arc::clone(params)),
            wheels: std::array::from_fn(|_| Arc::clone(&wheels)),
            sim_dt,
        };
        if params.has_perturbed_floor() {
            lanes.perturb_floor(0);
        }
        (0..EIGHT).for_each(|i| lanes.place_upright(i));
        lanes
    }

    /// Time step, s.
    pub fn sim_dt(&self) -> f64 {
        self.sim_dt
    }

    /// Parameters of robot `i`.
    pub fn lane_params(&self, i: usize) -> &Params {
        &self.params[i]
    }

    /// Wheels of robot `i`.
    pub fn lane_wheels(&self, i: usize) -> &Omniwheels {
        &self.wheels[i]
    }

    /// Puts all robots upright at rest on another ground (level if `None`).
    pub fn set_ground(&mut self, ground: Option<&Arc<Ground>>) {
        self.footing = ground.map(|ground| Box::new(Footing::new(ground)));
        (0..EIGHT).for_each(|i| self.place_upright(i));
    }

    /// The ground.
    pub fn ground(&self) -> Option<&Ground> {
        self.footing.as_ref().map(|footing| &*footing.ground)
    }

    /// The ground, shared with others.
    pub fn shared_ground(&self) -> Option<&Arc<Ground>> {
        self.footing.as_ref().map(|footing| &footing.ground)
    }

    /// Constants of robot `i`.
    pub fn constants(&self, i: usize) -> Cow<'_, Constants<f64>> {
        self.constants.lane(i)
    }

    /// Replaces the parameters of robot `i`. Its motion does not change, except that impulses of joint friction restart
    /// from zero, and for rounding where the principal axes change.
    pub fn set_lane_params(&mut self, i: usize, params: &Params) {
        replace(&mut self.params[i], params.clone());
        replace(&mut self.wheels[i], Omniwheels::new(params));
        let constants = Constants::new(params, self.sim_dt);
        let mut state = self.state.lane(i);
        state.change_body(&self.constants.lane(i), &constants);
        self.constants.set_lane(i, &constants);
        state.joint_impulses = Wheels::default();
        self.state.set_lane(i, &state);
        self.perturb_floor(i);
    }

    /// Takes the floor of robot `i` from its parameters.
    fn perturb_floor(&mut self, i: usize) {
        match &mut self.perturbed {
            None if !self.params[i].has_perturbed_floor() => {}
            None => {
                let mut floors = Box::new(PerturbedFloor::unset());
                (0..EIGHT).for_each(|i| floors.set_lane(i, &self.params[i], &self.constants.lane(i)));
                self.perturbed = Some(floors);
            }
            Some(floors) => {
                floors.set_lane(i, &self.params[i], &self.constants.lane(i));
                if !self.params.iter().any(|params| params.has_perturbed_floor()) {
                    self.perturbed = None;
                }
            }
        }
    }

    /// Restarts robot `i` from an accepted state.
    pub fn place_lane(&mut self, i: usize, state: &State) {
        let placed = ContactState::at(&self.constants.lane(i), &self.wheels[i], self.ground(), state);
        self.state.set_lane(i, &placed);
    }

    /// Restarts robot `i` upright at rest.
    pub fn place_upright(&mut self, i: usize) {
        self.place_lane(i, &upright_on(self.ground(), &self.params[i]));
    }

    /// The solver's state of robot `i`.
    pub fn lane(&self, i: usize) -> ContactState<f64> {
        self.state.lane(i)
    }

    /// Replaces the solver's state of robot `i`.
    pub fn set_lane(&mut self, i: usize, state: &ContactState<f64>) {
        self.state.set_lane(i, state);
    }

    /// Moves the rest of the first payloads' springs to offsets from their places, body axes, m.
    pub fn set_payload_offsets(&mut self, offsets: &[Eight; 3]) {
        self.state.payloads[0].offset = *offsets;
    }

    /// Deflections of the first payloads of the robots in `states`.
    pub fn payload_deflections(&self, states: &LaneState<Eight>) -> Deflection<Eight> {
        let mut all = Deflection::default();
        for i in 0..EIGHT {
            let (payload, motion) = (self.constants.lane(i).payloads[0], self.state.payloads[0].lane(i));
            all.set_lane(i, &Deflection::of(&payload, &states.lane(i), &motion));
        }
        all
    }

    /// Advances all robots by `steps` time steps under commands in [-1, 1]; `one` is workspace for the actuator memory
    /// of one robot.
    pub fn drive_lanes<A: Actuator>(
        &mut self,
        actuator: &A,
        commands: &Wheels<Eight>,
        memory: &mut [Eight],
        one: &mut [f64],
        steps: usize,
    ) {
        let (calls, steps) = if actuator.is_held() { (1, steps) } else { (steps, 1) };
        for _ in 0..calls {
            let mut torques = Wheels::default();
            let state = &self.state;
            match &self.constants {
                LaneConstants::Shared(constants) => {
                    run_eight(Actuate { constants, state, actuator, commands, memory, one, torques: &mut torques });
                }
                LaneConstants::PerLane(constants) => {
                    run_eight(Actuate { constants, state, actuator, commands, memory, one, torques: &mut torques });
                }
            }
            self.advance(&torques, steps);
        }
    }

    /// Advances all robots by `steps` time steps under constant torques. Not generic, so that it is compiled once for
    /// all actuators.
    fn advance(&mut self, torques: &Wheels<Eight>, steps: usize) {
        let (state, mut footing) = (&mut self.state, self.footing.as_deref_mut());
        if let Some(floors) = self.perturbed.as_deref_mut() {
            for _ in 0..steps {
                run_eight(Perturb { floors, state, ground: footing.as_deref().map(|footing| &*footing.ground) });
                run_eight(Advance {
                    constants: floors.constants(),
                    state,
                    footing: footing.as_deref_mut(),
                    torques,
                    steps: 1,
                });
            }
            return;
        }
        advance_eight(Level::new(), &self.constants, state, footing, torques, steps);
    }

    /// Writes the present states. Not generic, so that it is compiled once for equal and individual parameters.
    pub fn read(&self, states: &mut LaneState<Eight>, conditions: &mut ConditionCells<Eight>) {
        let state = &self.state;
        match &self.constants {
            LaneConstants::Shared(constants) => run_eight(Read { constants, state, states, conditions }),
            LaneConstants::PerLane(constants) => run_eight(Read { constants, state, states, conditions }),
        }
    }
}

/// Advances eight robots by `steps` time steps under constant torques, with the instructions of `level`.
pub fn advance_eight(
    level: Level,
    constants: &LaneConstants,
    state: &mut ContactState<Eight>,
    footing: Option<&mut Footing<Eight>>,
    torques: &Wheels<Eight>,
    steps: usize,
) {
    match constants {
        LaneConstants::Shared(constants) => {
            run_eight_at(level, Advance { constants, state, footing, torques, steps });
        }
        LaneConstants::PerLane(constants) => {
            run_eight_at(level, Advance { constants, state, footing, torques, steps });
        }
    }
}

/// Replaces a value, in place without an allocation if no other robot uses it.
fn replace<T>(shared: &mut Arc<T>, value: T) {
    match Arc::get_mut(shared) {
        Some(own) => *own = value,
        None => *shared = Arc::new(value),
    }
}

struct Actuate<'a, V, A> {
    constants: &'a Constants<V>,
    state: &'a ContactState<Eight>,
    actuator: &'a A,
    commands: &'a Wheels<Eight>,
    memory: &'a mut [Eight],
    one: &'a mut [f64],
    torques: &'a mut Wheels<Eight>,
}

impl<V: InLanes, A: Actuator> Kernel for Actuate<'_, V, A> {
    #[inline(always)]
    fn run<S: Registers>(self, simd: S) {
        let Self { constants, state, actuator, commands, memory, torques, .. } = self;
        let mut memory = Memory::<Wide<S>>::new(simd, memory);
        let commands = Wheels::<Wide<S>>::load(simd, commands);
        let speeds = if actuator.is_held() {
            Wheels::zero(commands[0])
        } else {
            V::with(
                constants,
                simd,
                #[inline(always)]
                |c| state.wheel_speeds::<Wide<S>, V::Wide<S>>(simd, c),
            )
        };
        actuator.torques(commands, speeds, &mut memory).store(torques);
    }

    fn run_one_by_one(self) {
        for i in 0..EIGHT {
            let c = self.constants.map(|value| value.lane(i));
            self.one.iter_mut().zip(&*self.memory).for_each(|(one, all)| *one = all.0[i]);
            let commands = self.commands.map(|eight| eight.0[i]);
            let speeds = self.state.lane(i).wheel_speeds::<f64, f64>(Scalar, &c);
            let torques = self.actuator.torques(commands, speeds, &mut Memory::new(Scalar, self.one));
            self.one.iter().zip(&mut *self.memory).for_each(|(one, all)| all.0[i] = *one);
            self.torques.iter_mut().zip(torques).for_each(|(all, torque)| all.0[i] = torque);
        }
    }
}

struct Advance<'a, V> {
    constants: &'a Constants<V>,
    state: &'a mut ContactState<Eight>,
    footing: Option<&'a mut Footing<Eight>>,
    torques: &'a Wheels<Eight>,
    steps: usize,
}

impl<V: InLanes> Kernel for Advance<'_, V> {
    #[inline(always)]
    fn run<S: Registers>(self, simd: S) {
        advance_wide(simd, self.constants, self.state, self.footing, self.torques, self.steps);
    }

    fn run_one_by_one(self) {
        let mut footing = self.footing.map(|all| Footing::new(&all.ground));
        for i in 0..EIGHT {
            let c = self.constants.map(|value| value.lane(i));
            let mut state = self.state.lane(i);
            advance(&c, &mut state, footing.as_mut(), self.torques.map(|eight| eight.0[i]), self.steps);
            self.state.set_lane(i, &state);
        }
    }
}

/// Computes the constants of a step on perturbed floors.
struct Perturb<'a> {
    floors: &'a mut PerturbedFloor<Eight>,
    state: &'a ContactState<Eight>,
    ground: Option<&'a Ground>,
}

impl Kernel for Perturb<'_> {
    #[inline(always)]
    fn run<S: Registers>(self, simd: S) {
        self.floors.update::<Wide<S>>(simd, self.state, self.ground);
    }

    fn run_one_by_one(self) {
        self.floors.update_one_by_one(self.state, self.ground);
    }
}

struct Read<'a, V> {
    constants: &'a Constants<V>,
    state: &'a ContactState<Eight>,
    states: &'a mut LaneState<Eight>,
    conditions: &'a mut ConditionCells<Eight>,
}

impl<V: InLanes> Kernel for Read<'_, V> {
    #[inline(always)]
    fn run<S: Registers>(self, simd: S) {
        let Self { constants, state, states, conditions } = self;
        V::with(
            constants,
            simd,
            #[inline(always)]
            |c| state.robot::<Wide<S>, V::Wide<S>>(simd, c).store(states, conditions),
        );
    }

    fn run_one_by_one(self) {
        let (mut state, mut condition) = (LaneState::default(), ConditionCells::default());
        for i in 0..EIGHT {
            let c = self.constants.map(|value| value.lane(i));
            self.state.lane(i).robot::<f64, f64>(Scalar, &c).store(&mut state, &mut condition);
            self.states.set_lane(i, &state);
            self.conditions.set_lane(i, &condition);
        }
    }
}
