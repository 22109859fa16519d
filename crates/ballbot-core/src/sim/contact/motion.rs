//! The contact model in motion: one robot, in plain `f64`.

use super::constants::Constants;
use super::memory::Memory;
use super::step::advance;
use crate::energy::mechanical_energy;
use crate::error::Result;
use crate::kinematics::Omniwheels;
use crate::lanes::{Scalar, run_one};
use crate::model::{JointDynamics, Model};
use crate::params::Params;
use crate::sim::outline::Outline;
use crate::snapshot;
use crate::state::{Contacts, State, wxyz};
use nalgebra::{Quaternion, UnitQuaternion, Vector2, Vector3};

/// How far a contact may be open for its first impulses to count on the robot's weight, m.
const TOUCHING: f64 = 1e-4;

/// A ballbot on a flat floor, in contact wherever it touches.
pub struct ContactMotion {
    params: Params,
    wheels: Omniwheels,
    constants: Constants,
    memory: Memory<f64>,
}

impl ContactMotion {
    /// At rest upright.
    pub fn new(params: &Params, sim_dt: f64) -> Self {
        let mut motion = Self {
            wheels: Omniwheels::new(params),
            constants: Constants::new(params, sim_dt),
            memory: Memory::default(),
            params: params.clone(),
        };
        motion.set_joint_dynamics(JointDynamics::of(params));
        motion.place(&State::upright(params));
        motion
    }

    /// Constants of its robot and time step.
    pub fn constants(&self) -> &Constants {
        &self.constants
    }

    /// What it carries from one step to the next.
    pub fn memory(&self) -> &Memory<f64> {
        &self.memory
    }

    /// What it carries from one step to the next, to replace it.
    pub fn memory_mut(&mut self) -> &mut Memory<f64> {
        &mut self.memory
    }

    /// [`Model::reset`] to a state that has been accepted.
    pub fn place(&mut self, state: &State) {
        let c = &self.constants;
        let com = Vector3::z() * c.com_height;
        let rate = state.body_angular_velocity;
        let spins = Vector3::from(state.wheel_speeds) - self.wheels.u * rate;
        let position = state.body_position + state.body_quaternion * com;
        let velocity = state.body_velocity + state.body_quaternion * rate.cross(&com);
        let old = &self.memory;
        self.memory = Memory {
            ball_position: state.ball_position.into(),
            ball_quaternion: wxyz(&state.ball_quaternion),
            ball_velocity: state.ball_velocity.into(),
            ball_rate: state.ball_angular_velocity.into(),
            body_position: position.into(),
            body_quaternion: wxyz(&state.body_quaternion),
            body_velocity: velocity.into(),
            body_rate: rate.into(),
            wheel_angles: state.wheel_angles,
            wheel_spins: spins.into(),
            joint_viscous_friction: old.joint_viscous_friction,
            joint_coulomb_friction: old.joint_coulomb_friction,
            ..Memory::default()
        };
        let floor_gap = state.ball_position.z - c.ball_radius;
        let load = c.static_wheel_load * c.sim_dt;
        let touches = |i: usize| {
            let center = position + state.body_quaternion * Vector3::from(c.wheel_centers[i]);
            (center - state.ball_position).norm() - c.ball_radius - c.wheel_radius <= TOUCHING
        };
        self.memory.normal_impulses = [0, 1, 2].map(|i| if touches(i) { load } else { 0.0 });
        if floor_gap <= TOUCHING {
            self.memory.floor_impulse[0] = c.static_floor_load * c.sim_dt;
        }
    }

    fn body_rotation(&self) -> UnitQuaternion<f64> {
        rotation(self.memory.body_quaternion)
    }

    /// Surface speed of wheel `i` less the ball's along its drive direction, m/s.
    fn slip_speed(&self, i: usize) -> f64 {
        let (c, m) = (&self.constants, &self.memory);
        let body = self.body_rotation();
        let rate = Vector3::from(m.body_rate);
        let u = body * Vector3::from(c.u[i]);
        let center = body * Vector3::from(c.wheel_centers[i]);
        let normal = (center + Vector3::from(m.body_position) - Vector3::from(m.ball_position)).normalize();
        let drive = u.cross(&normal).normalize();
        // The wheel turns with the body, but about its axle −u with its own spin.
        let wheel_rate = body * rate - u * (m.wheel_spins[i] + Vector3::from(c.u[i]).dot(&rate));
        let rim =
            Vector3::from(m.body_velocity) + (body * rate).cross(&center) - wheel_rate.cross(&normal) * c.wheel_radius;
        let ball = Vector3::from(m.ball_velocity) + Vector3::from(m.ball_rate).cross(&normal) * c.ball_radius;
        (rim - ball).dot(&drive)
    }
}

fn rotation([w, x, y, z]: [f64; 4]) -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z))
}

impl Model for ContactMotion {
    fn params(&self) -> &Params {
        &self.params
    }

    fn sim_dt(&self) -> f64 {
        self.constants.sim_dt
    }

    fn reset(&mut self, state: &State) -> Result<()> {
        self.accepts(state)?;
        self.place(state);
        Ok(())
    }

    fn step(&mut self, wheel_torques: &[f64; 3]) {
        advance(&self.constants, &mut self.memory, wheel_torques, 1);
    }

    fn time(&self) -> f64 {
        self.memory.steps * self.constants.sim_dt
    }

    fn state(&self) -> State {
        let (c, memory) = (&self.constants, &self.memory);
        run_one(
            #[inline(always)]
            || memory.state::<f64>(Scalar, c).into(),
        )
    }

    fn contacts(&self) -> Contacts {
        let m = &self.memory;
        // Before the first step the impulses are only where its sweeps start.
        let per_second = if m.steps > 0.0 { self.constants.sim_dt.recip() } else { 0.0 };
        let [z, x, y] = m.floor_impulse;
        let r = self.constants.ball_radius;
        Contacts {
            wheel_normal_forces: m.normal_impulses.map(|impulse| impulse * per_second),
            wheel_tractions: m.drive_impulses.map(|impulse| -impulse * per_second),
            wheel_slip_speeds: [self.slip_speed(0), self.slip_speed(1), self.slip_speed(2)],
            floor_force: Vector3::new(x, y, z) * per_second,
            floor_slip_velocity: Vector2::new(
                m.ball_velocity[0] - r * m.ball_rate[1],
                m.ball_velocity[1] + r * m.ball_rate[0],
            ),
            bot_on_floor: self.bot_on_floor(),
        }
    }

    fn bot_on_floor(&self) -> bool {
        self.memory.bot_on_floor > 0.0
    }

    fn energy(&self) -> f64 {
        mechanical_energy(&self.params, &self.wheels, &self.state())
    }

    fn healthy(&self) -> bool {
        self.memory.diverged == 0.0
    }

    fn accepts(&self, state: &State) -> Result<()> {
        state.validate()?;
        Outline::new(&self.params, &self.wheels).require_above_floor(state)
    }

    /// Acts over the next time step, so that the contacts answer within that step.
    fn push(&mut self, impulse: &Vector3<f64>, point: &Vector3<f64>) {
        let com = Vector3::z() * self.constants.com_height;
        let turning = (self.body_rotation() * (point - com)).cross(impulse);
        for i in 0..3 {
            self.memory.push[i] += impulse[i];
            self.memory.push[3 + i] += turning[i];
        }
    }

    fn joint_dynamics(&self) -> JointDynamics {
        JointDynamics {
            viscous_friction: self.memory.joint_viscous_friction,
            coulomb_friction: self.memory.joint_coulomb_friction,
        }
    }

    fn set_joint_dynamics(&mut self, dynamics: JointDynamics) {
        self.memory.joint_viscous_friction = dynamics.viscous_friction;
        self.memory.joint_coulomb_friction = dynamics.coulomb_friction;
        // Without friction nothing would take back the impulses that it left.
        self.memory.joint_impulses = [0.0; 3];
    }

    fn save(&self) -> Vec<u8> {
        snapshot::encode(&self.memory)
    }

    fn load(&mut self, bytes: &[u8]) -> Result<()> {
        self.memory = snapshot::decode("snapshot of a contact model", bytes)?;
        Ok(())
    }
}
