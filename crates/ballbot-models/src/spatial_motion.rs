//! Simulation of the spatial model: RK4 for position, attitude and generalized velocity.

use super::rk4::rk4;
use super::slope::Slope;
use super::{BallSpin, PointForce, Saved, SpatialModel, WheelSpin, are_bounded, require_rolling};
use ballbot_base::error::Result;
use ballbot_base::force::HeldForce;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Quat, Vec3, run_one};
use ballbot_base::model::{Model, same_geometry};
use ballbot_base::params::Params;
use ballbot_base::payload::{Deflection, Payload, PayloadMotion};
use ballbot_base::snapshot;
use ballbot_base::state::{Contacts, State, rolling_rate};
use ballbot_base::terrain::{Ground, upright_on};
use ballbot_base::wheels::Wheels;
use nalgebra::{Quaternion, SVector, UnitQuaternion, Vector2, Vector3, Vector6};
use std::any::Any;
use std::sync::Arc;

/// Coordinates: ball position (2), body quaternion (4), ν (6), ball quaternion (4), wheel angles (3).
type Coordinates = SVector<f64, 19>;

/// Coordinates, then position and velocity of the payload.
type WithPayload = SVector<f64, 25>;

/// A robot with the equations of [`SpatialModel`], absolute wheel spin and free ball spin.
#[derive(Clone, Debug)]
pub struct SpatialMotion {
    /// Model of the body without its payload on the plane of `slope`, in its frame.
    model: SpatialModel,
    params: Params,
    slope: Option<Slope>,
    sim_dt: f64,
    steps: u64,
    is_finite: bool,
    coordinates: Coordinates,
    wheel_torques: Wheels<f64>,
    force: HeldForce<f64>,
    /// The force from outside in the last step, in the frame of the slope.
    load: PointForce,
    payload: Payload<f64>,
    /// In the frame of the slope; of no meaning without a payload.
    payload_motion: PayloadMotion<f64>,
}

impl SpatialMotion {
    /// A robot upright at rest.
    pub fn new(params: &Params, sim_dt: f64) -> Self {
        Self::on(params, None, sim_dt)
    }

    fn on(params: &Params, slope: Option<Slope>, sim_dt: f64) -> Self {
        let there = slope.as_ref().map_or_else(|| params.clone(), |slope| slope.params_of(params));
        let model = SpatialModel::new(&there.without_payload(), WheelSpin::Absolute, BallSpin::Free);
        let mut motion = Self {
            model,
            params: params.clone(),
            slope,
            sim_dt,
            steps: 0,
            is_finite: true,
            coordinates: Coordinates::zeros(),
            wheel_torques: Wheels::default(),
            force: HeldForce::default(),
            load: PointForce::default(),
            payload: Payload::new(params),
            payload_motion: PayloadMotion::default(),
        };
        motion.place(&motion.upright());
        motion
    }

    fn upright(&self) -> State {
        upright_on(self.slope.as_ref().map(|slope| &*slope.ground), &self.params)
    }

    /// A state in the frame of the slope.
    fn level(&self, state: &State) -> State {
        self.slope.as_ref().map_or_else(|| state.clone(), |slope| slope.level(state))
    }

    /// Takes gravity in the middle of a step from a floor that moves: its error is of second order.
    fn move_floor(&mut self, step: u64) {
        let gravity = self.params.gravity_at((step as f64 + 0.5) * self.sim_dt);
        let turned = self.slope.as_ref().map_or(gravity, |slope| slope.rotation * gravity);
        self.model.set_weight(Vector3::zeros() - turned);
    }

    /// The coordinates and the payload after a step; false in `is_finite` after numbers that are not.
    fn next(&mut self) -> (Coordinates, PayloadMotion<f64>) {
        if self.payload.mass == 0.0 {
            let next = rk4(&self.coordinates, self.sim_dt, |y| self.derivative(y, &[self.load]));
            self.is_finite &= are_bounded(next.as_slice());
            return (next, self.payload_motion);
        }
        let mut y = WithPayload::zeros();
        y.fixed_rows_mut::<19>(0).copy_from(&self.coordinates);
        y.fixed_rows_mut::<6>(19).copy_from_slice(&numbers(&self.payload_motion));
        // The rest of the springs, as a floor that moves, is taken in the middle of the step.
        let time = (self.steps as f64 + 0.5) * self.sim_dt;
        let next = rk4(&y, self.sim_dt, |y| self.derivative_with_payload(y, time));
        self.is_finite &= are_bounded(next.as_slice());
        (next.fixed_rows::<19>(0).into_owned(), self.motion_at(&next))
    }

    fn derivative_with_payload(&self, y: &WithPayload, time: f64) -> WithPayload {
        let coordinates = y.fixed_rows::<19>(0).into_owned();
        let payload = self.motion_at(y);
        let (force, load) = self.payload_forces(&self.body_at(&coordinates), &payload, time);
        let mut out = WithPayload::zeros();
        out.fixed_rows_mut::<19>(0).copy_from(&self.derivative(&coordinates, &[self.load, load]));
        out.fixed_rows_mut::<3>(19).copy_from_slice(y.fixed_rows::<3>(22).as_slice());
        out.fixed_rows_mut::<3>(22).copy_from(&(force / self.payload.mass - self.model.weight()));
        out
    }

    /// The motion of the payload in coordinates.
    fn motion_at(&self, y: &WithPayload) -> PayloadMotion<f64> {
        let [position, velocity] = [19, 22].map(|at| Vec3::new(y[at], y[at + 1], y[at + 2]));
        PayloadMotion { position, velocity, ..self.payload_motion }
    }

    /// Force on the payload, N, in the frame of the slope, and its reaction on the body.
    fn payload_forces(
        &self,
        body: &LaneState<f64>,
        payload: &PayloadMotion<f64>,
        time: f64,
    ) -> (Vector3<f64>, PointForce) {
        let (force, arm) = run_one(
            #[inline(always)]
            || {
                let deflection = self.payload.deflection(body, payload);
                let force =
                    body.body_quaternion.rotation().apply(self.payload.force(&deflection, payload.offset, time));
                (force, deflection.position + Vec3::from(self.payload.place))
            },
        );
        let force = Vector3::new(force.x, force.y, force.z);
        (force, PointForce { force: -force, point: Vector3::new(arm.x, arm.y, arm.z) })
    }

    /// The reaction of the payload on the body now.
    fn payload_load(&self) -> PointForce {
        if self.payload.mass == 0.0 {
            return PointForce::default();
        }
        self.payload_forces(&self.body(), &self.payload_motion, self.time()).1
    }

    /// The body in the frame of the slope, for its payload.
    fn body(&self) -> LaneState<f64> {
        self.body_at(&self.coordinates)
    }

    fn body_at(&self, y: &Coordinates) -> LaneState<f64> {
        let place = Vec3::new(y[0], y[1], self.params.ball_radius);
        let quaternion = quaternion_at(y, 2);
        LaneState {
            body_position: place,
            body_quaternion: Quat { w: quaternion.w, v: Vec3::new(quaternion.i, quaternion.j, quaternion.k) },
            body_velocity: Vec3::new(y[6], y[7], 0.0),
            body_angular_velocity: Vec3::new(y[8], y[9], y[10]),
            ..LaneState::default()
        }
    }

    fn velocity(&self) -> Vector6<f64> {
        self.coordinates.fixed_rows::<6>(6).into_owned()
    }

    /// The force from outside in the next step, its mean over the step.
    fn next_load(&mut self) -> PointForce {
        if !self.force.is_on() {
            return PointForce::default();
        }
        let force = self.force.next_impulse() / self.sim_dt;
        let force = self.slope.as_ref().map_or(force, |slope| slope.rotation * force);
        PointForce { force, point: self.force.point.into() }
    }

    fn derivative(&self, y: &Coordinates, loads: &[PointForce]) -> Coordinates {
        let body_quaternion = quaternion_at(y, 2);
        let velocity = y.fixed_rows::<6>(6).into_owned();
        let rate = velocity.fixed_rows::<3>(2).into_owned();
        let ball_velocity = Vector3::new(velocity[0], velocity[1], 0.0);
        let ball_rate = rolling_rate(self.model.params(), &ball_velocity) + Vector3::z() * velocity[5];

        let mut out = Coordinates::zeros();
        out.fixed_rows_mut::<2>(0).copy_from(&velocity.fixed_rows::<2>(0));
        let body_rate = Quaternion::new(y[2], y[3], y[4], y[5]) * Quaternion::from_imag(rate) * 0.5;
        write_quaternion(&mut out, 2, &body_rate);
        out.fixed_rows_mut::<6>(6).copy_from(&self.model.accelerations_under(
            &body_quaternion,
            &velocity,
            self.wheel_torques,
            loads,
        ));
        let ball_quaternion_rate = Quaternion::from_imag(ball_rate) * Quaternion::new(y[12], y[13], y[14], y[15]) * 0.5;
        write_quaternion(&mut out, 12, &ball_quaternion_rate);
        let wheel_speeds = self.model.wheels().wheel_speeds(&body_quaternion, &ball_rate, &rate);
        out.fixed_rows_mut::<3>(16).copy_from_slice(wheel_speeds.as_slice());
        out
    }
}

impl Model for SpatialMotion {
    fn as_any(&self) -> &dyn Any {
        self
    }

    fn params(&self) -> &Params {
        &self.params
    }

    fn sim_dt(&self) -> f64 {
        self.sim_dt
    }

    fn set_params(&mut self, params: &Params) -> Result<()> {
        if self.slope.is_some() {
            params.require_level("the model 'spatial' on a terrain")?;
        }
        let mut robot = Self::on(params, self.slope.clone(), self.sim_dt);
        if same_geometry(self.params(), params) {
            robot.coordinates = self.coordinates;
            robot.steps = self.steps;
            robot.is_finite = self.is_finite;
            robot.wheel_torques = self.wheel_torques;
            robot.force = self.force;
            robot.load = self.load;
            robot.payload_motion = self.payload_motion.changed(&self.payload, &robot.payload, &self.body());
        }
        *self = robot;
        if self.params.has_moving_floor() {
            // The contact forces are of the last step.
            self.move_floor(self.steps.saturating_sub(1));
        }
        Ok(())
    }

    fn set_ground(&mut self, ground: Option<&Arc<Ground>>) -> Result<()> {
        Ground::require_no_obstacles(ground, "the model 'spatial'")?;
        let slope = ground.map(|ground| Slope::new(ground, &self.params)).transpose()?;
        *self = Self::on(&self.params.clone(), slope, self.sim_dt);
        Ok(())
    }

    fn place(&mut self, state: &State) {
        self.coordinates = coordinates_of(&self.level(state));
        self.payload_motion = PayloadMotion::at_place(&self.payload, &self.body());
        self.steps = 0;
        self.is_finite = true;
        self.wheel_torques = Wheels::default();
        self.force = HeldForce::default();
        self.load = PointForce::default();
        if self.params.has_moving_floor() {
            // The contact forces are of the last step.
            self.move_floor(self.steps.saturating_sub(1));
        }
    }

    fn advance(&mut self, wheel_torques: Wheels<f64>, steps: usize) {
        self.wheel_torques = wheel_torques;
        let moves = self.params.has_moving_floor();
        for _ in 0..steps {
            self.load = self.next_load();
            if moves {
                self.move_floor(self.steps);
            }
            let (mut next, payload) = self.next();
            for at in [2, 12] {
                let length = next.fixed_rows::<4>(at).norm();
                next.fixed_rows_mut::<4>(at).unscale_mut(length);
            }
            if self.is_finite {
                self.coordinates = next;
                self.payload_motion = payload;
            }
            self.steps += 1;
        }
    }

    fn time(&self) -> f64 {
        self.steps as f64 * self.sim_dt
    }

    fn healthy(&self) -> bool {
        self.is_finite
    }

    fn accepts(&self, state: &State) -> Result<()> {
        require_rolling(self.model.params(), self.model.wheels(), &self.level(state))
    }

    fn state(&self) -> State {
        let y = &self.coordinates;
        let velocity = self.velocity();
        let rolling = State::rolling_on(
            self.model.params(),
            self.model.wheels(),
            Vector2::new(velocity[0], velocity[1]),
            velocity[5],
            quaternion_at(y, 2),
            velocity.fixed_rows::<3>(2).into_owned(),
        );
        let position = Vector3::new(y[0], y[1], self.params().ball_radius);
        let state = State {
            ball_position: position,
            body_position: position,
            ball_quaternion: quaternion_at(y, 12),
            wheel_angles: Wheels([y[16], y[17], y[18]]),
            ..rolling
        };
        match &self.slope {
            Some(slope) => slope.inertial(&state),
            None => state,
        }
    }

    fn contacts(&self) -> Contacts {
        let contacts = self.model.contacts_under(
            &quaternion_at(&self.coordinates, 2),
            &self.velocity(),
            self.wheel_torques,
            &[self.load, self.payload_load()],
        );
        match &self.slope {
            Some(slope) => Contacts { floor_force: slope.rotation.inverse() * contacts.floor_force, ..contacts },
            None => contacts,
        }
    }

    fn energy(&self) -> f64 {
        let (p, y) = (self.model.params(), &self.coordinates);
        // Potential energy of the ball's position on the slope.
        let place = (p.ball_mass + p.body_mass) * p.gravity * p.up().xy().dot(&Vector2::new(y[0], y[1]));
        // On a slope the ball's center is lower by the cosine of the slope than on level ground.
        let lower = match self.slope {
            Some(_) => (p.ball_mass + p.body_mass) * p.gravity * p.ball_radius * (1.0 - p.up().z),
            None => 0.0,
        };
        let alone = self.model.energy(&quaternion_at(y, 2), &self.velocity()) + place - lower;
        if self.payload.mass == 0.0 {
            return alone;
        }
        let up = p.up() * p.gravity;
        let of_payload = run_one(
            #[inline(always)]
            || self.payload.energy(&self.body(), &self.payload_motion, Vec3::new(up.x, up.y, up.z), self.time()),
        );
        let above = if self.slope.is_some() { p.gravity } else { up.z };
        alone + of_payload - self.payload.mass * p.ball_radius * above
    }

    fn push(&mut self, impulse: &Vector3<f64>, point: &Vector3<f64>) {
        let impulse = self.slope.as_ref().map_or(*impulse, |slope| slope.rotation * impulse);
        let jump = self.model.velocity_jump(&quaternion_at(&self.coordinates, 2), &impulse, point);
        let mut velocity = self.coordinates.fixed_rows_mut::<6>(6);
        velocity += jump;
    }

    fn hold_force(&mut self, force: &HeldForce<f64>) -> Result<()> {
        self.force = *force;
        Ok(())
    }

    fn held_force(&self) -> HeldForce<f64> {
        self.force
    }

    fn move_payload(&mut self, offset: [f64; 3]) {
        self.payload_motion.offset = offset;
    }

    fn payload(&self) -> Deflection<f64> {
        Deflection::of(&self.payload, &self.body(), &self.payload_motion)
    }

    fn set_payload(&mut self, deflection: &Deflection<f64>) {
        self.payload_motion = self.payload_motion.deflected(&self.payload, &self.body(), deflection);
    }

    fn save(&self) -> Vec<u8> {
        snapshot::pack(&Saved {
            steps: self.steps,
            is_finite: self.is_finite,
            coordinates: self.coordinates.into(),
            wheel_torques: self.wheel_torques,
            force: self.force,
            load: {
                let PointForce { force: f, point: p } = self.load;
                [f.x, f.y, f.z, p.x, p.y, p.z]
            },
            payload: self.payload_motion,
        })
    }

    fn load(&mut self, bytes: &[u8]) -> Result<()> {
        let saved: Saved = snapshot::unpack("snapshot of a spatial model", bytes)?;
        self.steps = saved.steps;
        self.is_finite = saved.is_finite;
        self.coordinates = saved.coordinates.into();
        self.wheel_torques = saved.wheel_torques;
        self.force = saved.force;
        let [x, y, z, point @ ..] = saved.load;
        self.load = PointForce { force: Vector3::new(x, y, z), point: point.into() };
        self.payload_motion = saved.payload;
        if self.params.has_moving_floor() {
            // The contact forces are of the last step.
            self.move_floor(self.steps.saturating_sub(1));
        }
        Ok(())
    }
}

/// Position and velocity of a payload.
fn numbers(motion: &PayloadMotion<f64>) -> [f64; 6] {
    let PayloadMotion { position: p, velocity: v, .. } = motion;
    [p.x, p.y, p.z, v.x, v.y, v.z]
}

fn coordinates_of(state: &State) -> Coordinates {
    let mut y = Coordinates::zeros();
    y.fixed_rows_mut::<2>(0).copy_from(&state.ball_position.xy());
    write_quaternion(&mut y, 2, &state.body_quaternion);
    y.fixed_rows_mut::<2>(6).copy_from(&state.ball_velocity.xy());
    y.fixed_rows_mut::<3>(8).copy_from(&state.body_angular_velocity);
    y[11] = state.ball_angular_velocity.z;
    write_quaternion(&mut y, 12, &state.ball_quaternion);
    y.fixed_rows_mut::<3>(16).copy_from_slice(state.wheel_angles.as_slice());
    y
}

fn quaternion_at(y: &Coordinates, at: usize) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(Quaternion::new(y[at], y[at + 1], y[at + 2], y[at + 3]))
}

fn write_quaternion(y: &mut Coordinates, at: usize, q: &Quaternion<f64>) {
    y.fixed_rows_mut::<4>(at).copy_from_slice(&[q.w, q.i, q.j, q.k]);
}
