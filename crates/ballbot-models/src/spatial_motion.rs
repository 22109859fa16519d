//! Simulation of the spatial model: RK4 for position, attitude and generalized velocity.

use super::rk4::rk4;
use super::slope::Slope;
use super::{BallSpin, PointForce, Saved, SpatialModel, WheelSpin, are_bounded, require_rolling};
use ballbot_base::energy::energy_of_payloads;
use ballbot_base::error::Result;
use ballbot_base::force::HeldForce;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Quat, Vec3, run_one};
use ballbot_base::model::{Model, same_geometry};
use ballbot_base::params::Params;
use ballbot_base::payload::{Deflection, PAYLOADS, Payload, PayloadMotion};
use ballbot_base::snapshot;
use ballbot_base::state::{Contacts, State, rolling_rate};
use ballbot_base::terrain::{Ground, upright_on};
use ballbot_base::wheels::Wheels;
use nalgebra::{Quaternion, SVector, UnitQuaternion, Vector2, Vector3, Vector6};
use std::any::Any;
use std::sync::Arc;

/// Coordinates: ball position (2), body quaternion (4), ν (6), ball quaternion (4), wheel angles (3).
type Coordinates = SVector<f64, 19>;

/// A robot with the equations of [`SpatialModel`], absolute wheel spin and free ball spin.
#[derive(Clone, Debug)]
pub struct SpatialMotion {
    /// Model of the body without its payloads on the plane of `slope`, in its frame.
    model: SpatialModel,
    params: Params,
    slope: Option<Slope>,
    sim_dt: f64,
    steps: u64,
    is_finite: bool,
    coordinates: Coordinates,
    wheel_torques: Wheels<f64>,
    force: HeldForce<f64>,
    /// The external force in the last step, in the frame of the slope.
    load: PointForce,
    payloads: [Payload<f64>; PAYLOADS],
    /// In the frame of the slope; of no meaning without payloads.
    payload_motions: [PayloadMotion<f64>; PAYLOADS],
}

impl SpatialMotion {
    /// A robot upright at rest.
    pub fn new(params: &Params, sim_dt: f64) -> Self {
        Self::on(params, None, sim_dt)
    }

    fn on(params: &Params, slope: Option<Slope>, sim_dt: f64) -> Self {
        let there = slope.as_ref().map_or_else(|| params.clone(), |slope| slope.params_of(params));
        let model = SpatialModel::new(&there.without_payloads(), WheelSpin::Absolute, BallSpin::Free);
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
            payloads: Payload::of(params),
            payload_motions: Default::default(),
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

    /// The coordinates and the payloads after a step; false in `is_finite` after numbers that are not.
    fn next(&mut self) -> (Coordinates, [PayloadMotion<f64>; PAYLOADS]) {
        match self.payloads.iter().filter(|payload| payload.mass > 0.0).count() {
            0 => {
                let next = rk4(&self.coordinates, self.sim_dt, |y| self.derivative(y, &[self.load]));
                self.is_finite &= are_bounded(next.as_slice());
                (next, self.payload_motions)
            }
            1 => self.next_with_payloads::<1, 25>(),
            _ => self.next_with_payloads::<PAYLOADS, 31>(),
        }
    }

    /// [`SpatialMotion::next`] of a robot with `N` payloads and 19 + 6 N coordinates.
    fn next_with_payloads<const N: usize, const LEN: usize>(
        &mut self,
    ) -> (Coordinates, [PayloadMotion<f64>; PAYLOADS]) {
        let mut y = SVector::<f64, LEN>::zeros();
        y.fixed_rows_mut::<19>(0).copy_from(&self.coordinates);
        for (i, motion) in self.payload_motions[..N].iter().enumerate() {
            y.fixed_rows_mut::<6>(19 + 6 * i).copy_from_slice(&numbers(motion));
        }
        // The rest of the springs, as a floor that moves, is taken in the middle of the step.
        let time = (self.steps as f64 + 0.5) * self.sim_dt;
        let next = rk4(&y, self.sim_dt, |y| self.derivative_with_payloads::<N, LEN>(y, time));
        self.is_finite &= are_bounded(next.as_slice());
        let mut motions = self.payload_motions;
        for (i, motion) in motions[..N].iter_mut().enumerate() {
            *motion = self.motion_at(&next, i);
        }
        (next.fixed_rows::<19>(0).into_owned(), motions)
    }

    fn derivative_with_payloads<const N: usize, const LEN: usize>(
        &self,
        y: &SVector<f64, LEN>,
        time: f64,
    ) -> SVector<f64, LEN> {
        let coordinates = y.fixed_rows::<19>(0).into_owned();
        let body = self.body_at(&coordinates);
        let mut loads = [self.load; PAYLOADS + 1];
        let mut out = SVector::<f64, LEN>::zeros();
        for i in 0..N {
            let at = 19 + 6 * i;
            let (force, load) = self.payload_forces(i, &body, &self.motion_at(y, i), time);
            loads[1 + i] = load;
            out.fixed_rows_mut::<3>(at).copy_from_slice(y.fixed_rows::<3>(at + 3).as_slice());
            out.fixed_rows_mut::<3>(at + 3).copy_from(&(force / self.payloads[i].mass - self.model.weight()));
        }
        out.fixed_rows_mut::<19>(0).copy_from(&self.derivative(&coordinates, &loads[..1 + N]));
        out
    }

    /// The motion of payload `index` in coordinates.
    fn motion_at<const LEN: usize>(&self, y: &SVector<f64, LEN>, index: usize) -> PayloadMotion<f64> {
        let [position, velocity] = [19, 22].map(|at| at + 6 * index).map(|at| Vec3::new(y[at], y[at + 1], y[at + 2]));
        PayloadMotion { position, velocity, ..self.payload_motions[index] }
    }

    /// Force on payload `index`, N, in the frame of the slope, and its reaction on the body.
    fn payload_forces(
        &self,
        index: usize,
        body: &LaneState<f64>,
        motion: &PayloadMotion<f64>,
        time: f64,
    ) -> (Vector3<f64>, PointForce) {
        let payload = &self.payloads[index];
        let (force, arm) = run_one(
            #[inline(always)]
            || {
                let deflection = payload.deflection(body, motion);
                let force = body.body_quaternion.rotation().apply(payload.force(&deflection, motion.offset, time));
                (force, deflection.position + Vec3::from(payload.place))
            },
        );
        let force = Vector3::new(force.x, force.y, force.z);
        (force, PointForce { force: -force, point: Vector3::new(arm.x, arm.y, arm.z) })
    }

    /// The reaction of payload `index` on the body now.
    fn payload_load(&self, index: usize) -> PointForce {
        if self.payloads[index].mass == 0.0 {
            return PointForce::default();
        }
        self.payload_forces(index, &self.body(), &self.payload_motions[index], self.time()).1
    }

    /// The body in the frame of the slope, for its payloads.
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

    /// The external force in the next step, its mean over the step.
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
            robot.payload_motions =
                PayloadMotion::all_changed(&self.payload_motions, &self.payloads, &robot.payloads, &self.body());
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
        self.payload_motions = PayloadMotion::at_places(&self.payloads, &self.body());
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
            let (mut next, payloads) = self.next();
            for at in [2, 12] {
                let length = next.fixed_rows::<4>(at).norm();
                next.fixed_rows_mut::<4>(at).unscale_mut(length);
            }
            if self.is_finite {
                self.coordinates = next;
                self.payload_motions = payloads;
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
            &[self.load, self.payload_load(0), self.payload_load(1)],
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
        if !self.params.has_payload() {
            return alone;
        }
        let up = p.up() * p.gravity;
        let of_payloads = energy_of_payloads(&self.payloads, &self.body(), &self.payload_motions, &up, self.time());
        let above = if self.slope.is_some() { p.gravity } else { up.z };
        alone + of_payloads - self.params.mass_of_payloads() * p.ball_radius * above
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

    fn move_payload(&mut self, index: usize, offset: [f64; 3]) {
        self.payload_motions[index].offset = offset;
    }

    fn payloads(&self) -> [Deflection<f64>; PAYLOADS] {
        Deflection::of_all(&self.payloads, &self.body(), &self.payload_motions)
    }

    fn set_payloads(&mut self, deflections: &[Deflection<f64>; PAYLOADS]) {
        let (motions, payloads) = (&self.payload_motions, &self.payloads);
        self.payload_motions = PayloadMotion::all_deflected(motions, payloads, &self.body(), deflections);
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
            payloads: self.payload_motions,
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
        self.payload_motions = saved.payloads;
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
