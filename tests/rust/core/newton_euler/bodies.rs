//! The five bodies, their constraints, and the system that gives accelerations and forces.

use crate::support::general::{contacts_and_axles, steiner};
use ballbot_core::{Params, State, Wheels, rolling_rate};
use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, RowVector3, UnitQuaternion, Vector3};

const BALL: usize = 0;
const BODY: usize = 1;
const BODIES: usize = 5;

/// A rigid body in motion, inertial frame.
struct Body {
    mass: f64,
    inertia: Matrix3<f64>,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    rate: Vector3<f64>,
}

/// Conditions on velocities: rows J and the term J' v of their derivative.
#[derive(Default)]
struct Constraints {
    rows: Vec<[RowVector3<f64>; 2 * BODIES]>,
    drifts: Vec<f64>,
}

impl Constraints {
    /// A condition in which each body's velocity and angular velocity have these coefficients.
    fn add(&mut self, terms: &[(usize, Vector3<f64>, Vector3<f64>)], drift: f64) -> usize {
        let mut row = [RowVector3::zeros(); 2 * BODIES];
        for (body, on_velocity, on_rate) in terms {
            row[2 * body] += on_velocity.transpose();
            row[2 * body + 1] += on_rate.transpose();
        }
        self.rows.push(row);
        self.drifts.push(drift);
        self.rows.len() - 1
    }

    fn matrix(&self) -> DMatrix<f64> {
        DMatrix::from_fn(self.rows.len(), 6 * BODIES, |i, j| self.rows[i][j / 3][j % 3])
    }
}

/// One robot, moving without slip.
pub struct Robot {
    params: Params,
    pinned: bool,
    /// Whether a wheel's inertia is its own or its motor's.
    absolute_wheel_spin: bool,
    bodies: [Body; BODIES],
    /// From the ball's center to each wheel's, unit vectors.
    p: [Vector3<f64>; 3],
    /// Directions in which the rims move, across the axles.
    rims: [Vector3<f64>; 3],
    /// Along the axes of the rollers, which hold the ball.
    d: [Vector3<f64>; 3],
    axles: [Vector3<f64>; 3],
    wheel_speeds: Wheels<f64>,
}

/// Accelerations in the terms of [`SpatialModel`], and forces.
pub struct Solution {
    pub ball: [f64; 2],
    pub turning: [f64; 4],
    pub loads: [f64; 3],
    pub tractions: [f64; 3],
    pub floor: [f64; 3],
}

impl Robot {
    /// `transverse`: a wheel's inertia across its axle as a fraction of its inertia about the axle.
    pub fn new(params: &Params, state: &State, transverse: f64, pinned: bool, absolute_wheel_spin: bool) -> Self {
        let rotation = state.body_quaternion.to_rotation_matrix().into_inner();
        let local_p = contacts_and_axles(params).map(|(contact, _)| contact);
        let local_rims = params.wheel_azimuths.map(|b| Vector3::new(-b.sin(), b.cos(), 0.0));
        let across = transverse * params.wheel_inertia;
        let reach = params.ball_radius + params.wheel_radius;

        // The body link is the rest of the whole.
        let link_mass = params.body_mass - 3.0 * params.wheel_mass;
        let whole = Vector3::new(params.body_com_offset[0], params.body_com_offset[1], params.body_com_height);
        let wheels: Vector3<f64> = local_p.iter().map(|p| p * (reach * params.wheel_mass)).sum();
        let link = (whole * params.body_mass - wheels) / link_mass;
        let [xx, yy, zz] = params.body_inertia;
        let [xy, xz, yz] = params.body_products_of_inertia;
        let mut link_inertia = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) - steiner(link_mass, link - whole);
        for i in 0..3 {
            let axle = local_rims[i].cross(&local_p[i]);
            link_inertia -= steiner(params.wheel_mass, local_p[i] * reach - whole);
            link_inertia -= (Matrix3::identity() - axle * axle.transpose()) * across;
        }

        let [p, rims] = [local_p, local_rims].map(|vectors| vectors.map(|v| rotation * v));
        let axles = [0, 1, 2].map(|i| rims[i].cross(&p[i]));
        let d = [0, 1, 2].map(|i| Rotation3::from_scaled_axis(p[i] * params.roller_angle) * rims[i]);
        let rate = rotation * state.body_angular_velocity;
        let ball_rate = rolling_rate(params, &state.ball_velocity) + Vector3::z() * state.ball_angular_velocity.z;
        // The ball's center moves with the body: p spans space.
        let moving = |arm: Vector3<f64>| state.ball_velocity + rate.cross(&arm);
        let wheel_speeds = Wheels::from_fn(|i| {
            let ball_surface = state.ball_velocity + ball_rate.cross(&(p[i] * params.ball_radius));
            let carried = moving(p[i] * params.ball_radius);
            (ball_surface - carried).dot(&d[i]) / (params.wheel_radius * rims[i].dot(&d[i]))
        });
        let body = |mass, inertia, arm: Vector3<f64>, rate| Body {
            mass,
            inertia: rotation * inertia * rotation.transpose(),
            position: state.ball_position + arm,
            velocity: moving(arm),
            rate,
        };
        let wheel = |i: usize| {
            let axle = local_rims[i].cross(&local_p[i]);
            let along = if absolute_wheel_spin { params.wheel_inertia } else { 0.0 };
            let along_axle = axle * axle.transpose();
            let inertia = along_axle * along + (Matrix3::identity() - along_axle) * across;
            body(params.wheel_mass, inertia, p[i] * reach, rate + axles[i] * wheel_speeds[i])
        };
        let ball_inertia = Matrix3::from_diagonal_element(params.ball_inertia);
        let bodies = [
            body(params.ball_mass, ball_inertia, Vector3::zeros(), ball_rate),
            body(link_mass, link_inertia, rotation * link, rate),
            wheel(0),
            wheel(1),
            wheel(2),
        ];
        Self { params: params.clone(), pinned, absolute_wheel_spin, bodies, p, rims, d, axles, wheel_speeds }
    }

    /// The conditions, with the numbers of the first row of the floor, of the normals and of the drives.
    fn constraints(&self) -> (Constraints, [usize; 3], [usize; 3]) {
        let mut c = Constraints::default();
        let [ball, body] = [&self.bodies[BALL], &self.bodies[BODY]];
        let (r_k, r_w, omega) = (self.params.ball_radius, self.params.wheel_radius, body.rate);
        let lowest = -Vector3::z() * r_k;
        for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
            // axis · (ω × arm) = (arm × axis) · ω
            c.add(&[(BALL, axis, lowest.cross(&axis))], 0.0);
        }
        if self.pinned {
            c.add(&[(BALL, Vector3::zeros(), Vector3::z())], 0.0);
        }
        for i in 0..3 {
            let (at, wheel) = (2 + i, &self.bodies[2 + i]);
            let r = wheel.position - body.position;
            let centripetal = omega.cross(&omega.cross(&r));
            for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
                let terms = [(at, axis, Vector3::zeros()), (BODY, -axis, -r.cross(&axis))];
                c.add(&terms, -centripetal.dot(&axis));
            }
            for t in [self.p[i], self.rims[i]] {
                let terms = [(at, Vector3::zeros(), t), (BODY, Vector3::zeros(), -t)];
                c.add(&terms, omega.cross(&t).dot(&(wheel.rate - omega)));
            }
        }
        let normals = [0, 1, 2].map(|i| {
            let (at, p) = (2 + i, self.p[i]);
            let apart = self.bodies[at].velocity - ball.velocity;
            c.add(&[(at, p, Vector3::zeros()), (BALL, -p, Vector3::zeros())], omega.cross(&p).dot(&apart))
        });
        let drives = [0, 1, 2].map(|i| {
            let (at, p, d) = (2 + i, self.p[i], self.d[i]);
            let wheel = &self.bodies[at];
            let slip = wheel.velocity - wheel.rate.cross(&p) * r_w - ball.velocity - ball.rate.cross(&p) * r_k;
            let turning = omega.cross(&p);
            let drift = -d.dot(&(wheel.rate.cross(&turning) * r_w + ball.rate.cross(&turning) * r_k));
            let terms = [(at, d, -p.cross(&d) * r_w), (BALL, -d, -p.cross(&d) * r_k)];
            c.add(&terms, drift + omega.cross(&d).dot(&slip))
        });
        (c, normals, drives)
    }

    /// Mass matrix and right-hand side of the momenta.
    fn momenta(&self, motors: &[f64; 3]) -> (DMatrix<f64>, DVector<f64>) {
        let mut mass = DMatrix::zeros(6 * BODIES, 6 * BODIES);
        let mut force = DVector::zeros(6 * BODIES);
        let [x, y] = self.params.floor_tilt;
        let floor = Rotation3::from_scaled_axis(Vector3::new(x, y, 0.0));
        let gravity = floor.inverse() * Vector3::new(0.0, 0.0, -self.params.gravity);
        for (i, body) in self.bodies.iter().enumerate() {
            let at = 6 * i;
            mass.fixed_view_mut::<3, 3>(at, at).fill_diagonal(body.mass);
            mass.fixed_view_mut::<3, 3>(at + 3, at + 3).copy_from(&body.inertia);
            add(&mut force, at, &(gravity * body.mass));
            let gyroscopic = body.rate.cross(&(body.inertia * body.rate));
            add(&mut force, at + 3, &-gyroscopic);
        }
        let drag = self.bodies[BALL].velocity * self.params.ball_viscous_friction;
        add(&mut force, 0, &-drag);
        for (i, motor) in motors.iter().enumerate() {
            let (on_wheel, on_body) = (6 * (2 + i) + 3, 6 * BODY + 3);
            let torque = self.axles[i] * (motor - self.params.wheel_viscous_friction * self.wheel_speeds[i]);
            add(&mut force, on_wheel, &torque);
            add(&mut force, on_body, &-torque);
            if !self.absolute_wheel_spin {
                // The armature: ψ̈ = axle · (ω_w' − ω_b'), since ω_w − ω_b is along the axle.
                let armature = self.axles[i] * self.axles[i].transpose() * self.params.wheel_inertia;
                for (row, column, sign) in [
                    (on_wheel, on_wheel, 1.0),
                    (on_wheel, on_body, -1.0),
                    (on_body, on_wheel, -1.0),
                    (on_body, on_body, 1.0),
                ] {
                    let mut block = mass.fixed_view_mut::<3, 3>(row, column);
                    block += armature * sign;
                }
            }
        }
        (mass, force)
    }

    pub fn solve(&self, body_quaternion: &UnitQuaternion<f64>, motors: &[f64; 3]) -> Solution {
        let (constraints, normals, drives) = self.constraints();
        let (mass, force) = self.momenta(motors);
        let jacobian = constraints.matrix();
        let (n, m) = (6 * BODIES, jacobian.nrows());
        let mut system = DMatrix::zeros(n + m, n + m);
        system.view_mut((0, 0), (n, n)).copy_from(&mass);
        system.view_mut((0, n), (n, m)).copy_from(&-jacobian.transpose());
        system.view_mut((n, 0), (m, n)).copy_from(&jacobian);
        let mut right = DVector::zeros(n + m);
        right.rows_mut(0, n).copy_from(&force);
        right.rows_mut(n, m).copy_from(&-DVector::from_vec(constraints.drifts));
        let solved = solve_dense(&system, &right);
        let body_turning = body_quaternion.inverse_transform_vector(&solved.fixed_rows::<3>(6 * BODY + 3).into_owned());
        Solution {
            ball: [solved[0], solved[1]],
            turning: [body_turning.x, body_turning.y, body_turning.z, solved[5]],
            loads: normals.map(|row| solved[n + row]),
            tractions: drives.map(|row| -solved[n + row]),
            floor: [solved[n], solved[n + 1], solved[n + 2]],
        }
    }
}

fn add(to: &mut DVector<f64>, at: usize, vector: &Vector3<f64>) {
    let mut rows = to.fixed_rows_mut::<3>(at);
    rows += vector;
}

/// With one refinement step, which restores the accuracy that elimination loses between rows of mass and rows of
/// inertia.
fn solve_dense(system: &DMatrix<f64>, right: &DVector<f64>) -> DVector<f64> {
    let factors = system.clone().full_piv_lu();
    let first = factors.solve(right).expect("a robot's constraints are independent");
    let residual = right - system * &first;
    first + factors.solve(&residual).expect("as before")
}
