//! Conversion of one robot's solver state from and to [`State`] and [`Contacts`], and pushes.

use super::constants::Constants;
use super::state::ContactState;
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Scalar, run_one};
use ballbot_base::payload::{Deflection, PAYLOADS, PayloadMotion};
use ballbot_base::state::{Contacts, State, wxyz};
use ballbot_base::terrain::Ground;
use ballbot_base::wheels::Wheels;
use nalgebra::{Quaternion, UnitQuaternion, Vector2, Vector3};

/// Largest gap at which a contact of a new state starts with the impulse of its static load, m.
const CONTACT_TOLERANCE: f64 = 1e-4;

impl ContactState<f64> {
    /// Solver state at time zero in an accepted `state`.
    pub fn at(c: &Constants<f64>, wheels: &Omniwheels, ground: Option<&Ground>, state: &State) -> Self {
        let (com, axes) = (Vector3::from(c.com), rotation(c.principal_axes));
        let spins = state.wheel_speeds - Wheels::of_column(wheels.axles * state.body_angular_velocity);
        let (mut attitude, mut rate) = (state.body_quaternion, state.body_angular_velocity);
        if c.general > 0.0 {
            attitude *= axes;
            rate = axes.inverse_transform_vector(&rate);
        }
        let position = state.body_position + attitude * com;
        let velocity = state.body_velocity + attitude * rate.cross(&com);
        let touches = |i: usize| {
            let center = position + attitude * Vector3::from(c.wheel_centers[i]);
            (center - state.ball_position).norm() - c.ball_radius - c.wheel_radius <= CONTACT_TOLERANCE
        };
        let (gap, normal) = match ground {
            Some(ground) => ground.gap(&state.ball_position, c.ball_radius),
            None => (state.ball_position.z - c.ball_radius, Vector3::z()),
        };
        let touching = Wheels::from_fn(touches);
        // The floor carries the bot only through the ball.
        let carried = if touching.0.contains(&true) { c.static_floor_load } else { c.static_ball_load };
        let across = Vector3::from(c.gravity_dt).dot(&normal) / c.gravity_dt[2];
        let load = if gap <= CONTACT_TOLERANCE { carried * across * c.sim_dt } else { 0.0 };
        Self {
            ball_position: state.ball_position.into(),
            ball_quaternion: wxyz(&state.ball_quaternion),
            ball_velocity: state.ball_velocity.into(),
            ball_rate: state.ball_angular_velocity.into(),
            body_position: position.into(),
            body_quaternion: wxyz(&attitude),
            body_velocity: velocity.into(),
            body_rate: rate.into(),
            wheel_angles: state.wheel_angles,
            wheel_spins: spins,
            normal_impulses: Wheels::from_fn(|i| if touching[i] { c.wheel_loads[i] * c.sim_dt } else { 0.0 }),
            floor_impulse: [load * normal.z, load * normal.x, load * normal.y],
            payloads: PayloadMotion::at_places(&c.payloads, &LaneState::from(state)),
            ..Self::default()
        }
    }

    /// The state over lanes of width one.
    pub fn read(&self, c: &Constants<f64>) -> LaneState<f64> {
        run_one(
            #[inline(always)]
            || self.lane_state::<f64, f64>(Scalar, c),
        )
    }

    /// Contact forces of the last step; zeros before the first.
    pub fn contacts(&self, c: &Constants<f64>, ground: Option<&Ground>) -> Contacts {
        // Before the first step the impulses are only the solver's initial guess.
        let per_second = if self.steps > 0.0 { c.sim_dt.recip() } else { 0.0 };
        let [z, x, y] = self.floor_impulse;
        let r = c.ball_radius;
        Contacts {
            wheel_normal_forces: self.normal_impulses.map(|impulse| impulse * per_second),
            wheel_tractions: self.drive_impulses.map(|impulse| -impulse * per_second),
            wheel_slip_speeds: Wheels::from_fn(|i| self.slip_speed(c, i)),
            floor_force: Vector3::new(x, y, z) * per_second,
            bot_floor_force: if self.bot_on_floor > 0.0 {
                Vector3::from(self.bot_floor_impulse) * per_second
            } else {
                Vector3::zeros()
            },
            floor_slip_velocity: match ground {
                Some(ground) => {
                    let (_, normal) = ground.gap(&self.ball_position.into(), r);
                    let surface = Vector3::from(self.ball_rate).cross(&normal) * r;
                    let slip = Vector3::from(self.ball_velocity) - surface;
                    (slip - normal * normal.dot(&slip)).xy()
                }
                None => Vector2::new(
                    self.ball_velocity[0] - r * self.ball_rate[1],
                    self.ball_velocity[1] + r * self.ball_rate[0],
                ),
            },
            obstacle_force: if self.on_obstacle > 0.0 {
                Vector3::from(self.obstacle_impulse) * per_second
            } else {
                Vector3::zeros()
            },
            bot_on_floor: self.bot_on_floor > 0.0,
            on_obstacle: self.on_obstacle > 0.0,
            searched_steps: self.searched_steps as u64,
            unsolved_steps: self.unsolved_steps as u64,
        }
    }

    /// Adds an impulse (inertial frame, N·s) on the body at `point` (body frame, m), to act over the next step.
    pub fn push(&mut self, c: &Constants<f64>, impulse: &Vector3<f64>, point: &Vector3<f64>) {
        let mut point = *point;
        if c.general > 0.0 {
            point = rotation(c.principal_axes).inverse_transform_vector(&point);
        }
        let arm = rotation(self.body_quaternion) * (point - Vector3::from(c.com));
        let angular_impulse = arm.cross(impulse);
        for i in 0..3 {
            self.push[i] += impulse[i];
            self.push[3 + i] += angular_impulse[i];
        }
    }

    /// Keeps the motion when the body changes from `before` to `after`, with its new principal frame.
    pub fn change_body(&mut self, before: &Constants<f64>, after: &Constants<f64>) {
        if before.payloads != after.payloads {
            self.change_payloads(before, after);
            return;
        }
        if before.principal_axes == after.principal_axes {
            return;
        }
        let turn = rotation(before.principal_axes).inverse() * rotation(after.principal_axes);
        self.body_quaternion = wxyz(&(rotation(self.body_quaternion) * turn));
        self.body_rate = turn.inverse_transform_vector(&self.body_rate.into()).into();
    }

    /// Keeps the motion of the body, and payloads in their deflections; a new payload begins at rest at its place.
    fn change_payloads(&mut self, before: &Constants<f64>, after: &Constants<f64>) {
        let body = self.read(before);
        run_one(
            #[inline(always)]
            || self.set_lane_state::<f64, f64>(after, &body),
        );
        self.payloads = PayloadMotion::all_changed(&self.payloads, &before.payloads, &after.payloads, &body);
    }

    /// Deflections of the payloads from their places; zeros without a payload.
    pub fn payload_deflections(&self, c: &Constants<f64>) -> [Deflection<f64>; PAYLOADS] {
        Deflection::of_all(&c.payloads, &self.read(c), &self.payloads)
    }

    /// Replaces the deflections of the payloads.
    pub fn set_payloads(&mut self, c: &Constants<f64>, deflections: &[Deflection<f64>; PAYLOADS]) {
        self.payloads = PayloadMotion::all_deflected(&self.payloads, &c.payloads, &self.read(c), deflections);
    }

    /// Surface speed of wheel `i` relative to the ball along its drive direction, m/s.
    fn slip_speed(&self, c: &Constants<f64>, i: usize) -> f64 {
        let body = rotation(self.body_quaternion);
        let rate = Vector3::from(self.body_rate);
        let u = body * Vector3::from(c.u[i]);
        let center = body * Vector3::from(c.wheel_centers[i]);
        let normal = (center + Vector3::from(self.body_position) - Vector3::from(self.ball_position)).normalize();
        let mut drive = u.cross(&normal).normalize();
        if c.inclined > 0.0 {
            let [cos, sin] = c.roller_axis;
            drive = drive * cos + normal.cross(&drive) * sin;
        }
        // The wheel rotates with the body, except about its axle −u, where it has its own spin.
        let wheel_rate = body * rate - u * (self.wheel_spins[i] + Vector3::from(c.u[i]).dot(&rate));
        let rim = Vector3::from(self.body_velocity) + (body * rate).cross(&center)
            - wheel_rate.cross(&normal) * c.wheel_radius;
        let ball = Vector3::from(self.ball_velocity) + Vector3::from(self.ball_rate).cross(&normal) * c.ball_radius;
        (rim - ball).dot(&drive)
    }
}

fn rotation([w, x, y, z]: [f64; 4]) -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z))
}
