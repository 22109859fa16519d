//! Omniwheels of barrel rollers, each barrel a separate body in rapier: a reference for the ripple that `contact` and
//! `rigid` give to round wheels. It shares only the parameters with them.

use super::{Motion, Simulation, close};
use ballbot_core::kinematics::Omniwheels;
use ballbot_core::{Params, State};
use nalgebra::{UnitQuaternion, Vector2, Vector3};
use rapier3d_f64::prelude::*;
use std::f64::consts::{PI, TAU};

const DT: f64 = 5e-4;

/// Rate of the wheels, rad/s.
const RATE: f64 = 7.0;

/// Distance of neighboring spheres of a barrel, m. Between two of them the ball of the robot sinks in by 4 µm.
const SPACING: f64 = 5e-4;

/// Radius of a barrel in its middle, and its mass.
const BARREL_RADIUS: f64 = 8e-3;
const BARREL_MASS: f64 = 5e-3;

/// Wheels of two rows with half of the barrels each, which alternate around the wheel.
struct Wheels {
    params: Params,
    /// Distance of each row from the middle of the wheel along the axle, m.
    row_offset: f64,
}

impl Wheels {
    /// Radius of the arc of a barrel. Its center is c = `wheel_radius` - arc before the center of the wheel, so that at
    /// the angle ξ of the barrel's middle from the contact the centers of wheel and ball are c cos ξ + √((r + arc)² -
    /// c² sin² ξ) apart. With two barrels at once, ξ = π/n, this is smaller by `roller_ripple`.
    fn arc(&self) -> f64 {
        let Params { wheel_radius, ball_radius, roller_ripple, roller_count, .. } = self.params;
        let (sin, cos) = (PI / roller_count).sin_cos();
        let mut c = 0.0;
        for _ in 0..50 {
            let reach = ball_radius + wheel_radius - c;
            let sagitta = reach - (reach * reach - c * c * sin * sin).sqrt();
            c = (roller_ripple - sagitta) / (1.0 - cos);
        }
        wheel_radius - c
    }

    /// Spheres along x that fill a barrel, from its middle.
    fn barrel(&self) -> SharedShape {
        let arc = self.arc();
        let half = self.params.wheel_radius * (PI / self.params.roller_count).sin();
        // A sphere about a point s on the axle touches the arc where its normal passes through s.
        let reach = half * (arc - BARREL_RADIUS) / arc;
        let count = (reach / SPACING).ceil();
        let spheres = (-count as i32..=count as i32).map(|k| {
            let s = reach * f64::from(k) / count;
            let radius = arc - (s * s + (arc - BARREL_RADIUS).powi(2)).sqrt();
            (Pose::from_parts(Vector::X * s, Rotation::IDENTITY), SharedShape::ball(radius))
        });
        SharedShape::compound(spheres.collect())
    }
}

fn vector(v: Vector3<f64>) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

/// A joint about an axis through a point, both in the frames of bodies with the same orientation.
fn axle(parent: Vector, child: Vector, axis: Vector) -> GenericJoint {
    let turned = Rotation::from_rotation_arc(Vector::X, axis);
    let mut joint = GenericJoint::new(JointAxesMask::LOCKED_REVOLUTE_AXES);
    joint.set_local_frame1(Pose::from_parts(parent, turned));
    joint.set_local_frame2(Pose::from_parts(child, turned));
    joint
}

struct Robot {
    bodies: RigidBodySet,
    colliders: ColliderSet,
    joints: MultibodyJointSet,
    impulse_joints: ImpulseJointSet,
    soft_bodies: SoftBodySet,
    islands: IslandManager,
    broad_phase: DefaultBroadPhase,
    narrow_phase: NarrowPhase,
    pipeline: PhysicsPipeline,
    settings: IntegrationParameters,
    gravity: Vector,
    body: RigidBodyHandle,
    wheels: Vec<RigidBodyHandle>,
    axles: Vec<Vector>,
    com: Vector,
}

impl Robot {
    /// Upright; the ball spins about the vertical so that all wheels turn at [`RATE`].
    fn new(wheels: &Wheels) -> Self {
        let p = &wheels.params;
        let geometry = Omniwheels::new(p);
        let mut bodies = RigidBodySet::new();
        let mut colliders = ColliderSet::new();
        let mut joints = MultibodyJointSet::new();
        let floor = ColliderBuilder::new(SharedShape::halfspace(Vector::Z)).friction(p.floor_dynamic_friction);
        colliders.insert(floor.collision_groups(groups(Group::GROUP_1, Group::GROUP_2)));

        let center = Vector3::z() * p.ball_radius;
        let spin = RATE / (p.gear_ratio() * p.wheel_zenith.sin());
        let inertia = Vector::splat(p.ball_inertia);
        let ball = RigidBodyBuilder::dynamic()
            .translation(vector(center))
            .angvel(Vector::Z * spin)
            .can_sleep(false)
            .additional_mass_properties(MassProperties::new(Vector::ZERO, p.ball_mass, inertia));
        let ball = bodies.insert(ball);
        let sphere = ColliderBuilder::ball(p.ball_radius).density(0.0).friction(p.wheel_dynamic_friction);
        let sphere = sphere.collision_groups(groups(Group::GROUP_2, Group::GROUP_1 | Group::GROUP_3));
        colliders.insert_with_parent(sphere, ball, &mut bodies);

        // The frame of the root is at its center of mass: rapier integrates others wrongly.
        let centers = geometry.contact_directions.map(|p_i| p_i * (p.ball_radius + p.wheel_radius));
        let mass = p.body_mass - 3.0 * p.wheel_mass;
        let com = (p.body_com() * p.body_mass - centers.iter().sum::<Vector3<f64>>() * p.wheel_mass) / mass;
        let moments = p.body_inertia_matrix().diagonal();
        let body = RigidBodyBuilder::dynamic()
            .translation(vector(center + com))
            .can_sleep(false)
            .additional_mass_properties(MassProperties::new(Vector::ZERO, mass, vector(moments)));
        let body = bodies.insert(body);

        let count = p.roller_count as usize;
        let (mut handles, mut axles) = (Vec::new(), Vec::new());
        for (i, at) in centers.into_iter().enumerate() {
            let along = -geometry.u.row(i).transpose();
            let mut outward = -geometry.contact_directions[i];
            // Positive about the axle: the rim at the contact moves as the surface of the ball does.
            let rate = along
                * (spin * Vector3::z().cross(&geometry.contact_directions[i]).dot(&along.cross(&outward))).signum()
                * RATE;
            let hub = p.wheel_mass - p.roller_count * BARREL_MASS;
            let transverse = 0.5 * p.wheel_inertia;
            let hub = MassProperties::with_principal_inertia_frame(
                Vector::ZERO,
                hub,
                Vector::new(p.wheel_inertia, transverse, transverse),
                Rotation::from_rotation_arc(Vector::X, vector(along)),
            );
            let wheel = RigidBodyBuilder::dynamic()
                .translation(vector(center + at))
                .angvel(vector(rate))
                .can_sleep(false)
                .additional_mass_properties(hub);
            let wheel = bodies.insert(wheel);
            joints.insert(body, wheel, axle(vector(at - com), Vector::ZERO, vector(along)), true).unwrap();
            // The phase of the ripple at the start: the middle of a barrel is this far from the contact.
            let start = UnitQuaternion::from_scaled_axis(along * (p.roller_phases[i] / p.roller_count));
            outward = start * outward;
            for k in 0..count {
                let radial = UnitQuaternion::from_scaled_axis(along * (TAU * k as f64 / p.roller_count)) * outward;
                let row = if k % 2 == 0 { wheels.row_offset } else { -wheels.row_offset };
                let place = radial * (p.wheel_radius - BARREL_RADIUS) + along * row;
                let tangent = along.cross(&radial);
                let light = 0.5 * BARREL_MASS * BARREL_RADIUS * BARREL_RADIUS;
                let barrel = RigidBodyBuilder::dynamic()
                    .translation(vector(center + at + place))
                    .linvel(vector(rate.cross(&place)))
                    .angvel(vector(rate))
                    .can_sleep(false)
                    .additional_mass_properties(MassProperties::new(Vector::ZERO, BARREL_MASS, Vector::splat(light)));
                let barrel = bodies.insert(barrel);
                let shape = ColliderBuilder::new(wheels.barrel())
                    .position(Pose::from_parts(Vector::ZERO, Rotation::from_rotation_arc(Vector::X, vector(tangent))))
                    .density(0.0)
                    .friction(p.wheel_dynamic_friction)
                    .collision_groups(groups(Group::GROUP_3, Group::GROUP_2));
                colliders.insert_with_parent(shape, barrel, &mut bodies);
                joints.insert(wheel, barrel, axle(vector(place), Vector::ZERO, vector(tangent)), true).unwrap();
            }
            handles.push(wheel);
            axles.push(vector(along));
        }
        let index = joints.rigid_body_link(body).unwrap().multibody;
        let links = joints.get_multibody_mut(index).unwrap();
        links.set_self_contacts_enabled(false);
        links.damping_mut().fill(0.0);
        let stiff = SpringCoefficients::new(2e5, 5e3);
        let settings = IntegrationParameters {
            dt: DT,
            contact_softness: stiff,
            static_contact_softness: stiff,
            num_solver_iterations: 8,
            num_internal_pgs_iterations: 8,
            contact_recycling: false,
            contact_clustering: false,
            max_ccd_substeps: 0,
            friction_model: FrictionModel::Coulomb,
            normalized_max_linear_velocity: Real::MAX,
            ..IntegrationParameters::default()
        };
        Self {
            bodies,
            colliders,
            joints,
            impulse_joints: ImpulseJointSet::new(),
            soft_bodies: SoftBodySet::new(),
            islands: IslandManager::new(),
            broad_phase: DefaultBroadPhase::default(),
            narrow_phase: NarrowPhase::new(),
            pipeline: PhysicsPipeline::new(),
            settings,
            gravity: Vector::Z * -p.gravity,
            body,
            wheels: handles,
            axles,
            com: vector(com),
        }
    }

    fn step(&mut self) {
        self.pipeline.step(
            self.gravity,
            &self.settings,
            &mut self.islands,
            &mut self.broad_phase,
            &mut self.narrow_phase,
            &mut self.bodies,
            &mut self.colliders,
            &mut self.impulse_joints,
            &mut self.joints,
            &mut self.soft_bodies,
            &mut CCDSolver::new(),
            &(),
            &(),
        );
    }

    fn moment(&self) -> Moment {
        let body = &self.bodies[self.body];
        let rates =
            self.wheels.iter().zip(&self.axles).map(|(wheel, axle)| {
                (self.bodies[*wheel].angvel() - body.angvel()).dot(*body.rotation() * *axle).abs()
            });
        let [x, y] = [body.angvel().x, body.angvel().y];
        Moment {
            height: (body.translation() - *body.rotation() * self.com).z,
            speed: body.linvel().z,
            tilt_rate: x.hypot(y),
            wheel_rate: rates.sum::<f64>() / 3.0,
        }
    }
}

fn groups(of: Group, with: Group) -> InteractionGroups {
    InteractionGroups::new(of, with, InteractionTestMode::And)
}

/// Quantities of a time step that are compared.
struct Moment {
    /// Position of the body's origin, m.
    height: f64,
    speed: f64,
    tilt_rate: f64,
    /// Mean of the three.
    wheel_rate: f64,
}

/// Effect of a ripple on a robot whose ball spins below it, without torques.
#[derive(Debug)]
struct Bob {
    /// From top to bottom, m.
    size: f64,
    /// Periods per turn of the wheels.
    times_a_turn: f64,
    /// Root mean square, rad/s.
    tilt_rate: f64,
}

impl Bob {
    /// The first tenth of a second is omitted.
    fn of(mut step: impl FnMut() -> Moment) -> Self {
        let moments: Vec<_> = (0..1200).map(|_| step()).skip(200).collect();
        let lowest = moments.iter().fold(f64::MAX, |least, now| least.min(now.height));
        let size = moments.iter().fold(f64::MIN, |most, now| most.max(now.height)) - lowest;
        let mut turned = 0.0;
        let turns: Vec<_> = moments.iter().map(|now| (turned, turned += now.wheel_rate * DT).0).collect();
        // The strongest line of the vertical speed, which has no drift, over the angle of the wheels.
        let strength = |times: f64| {
            let (mut re, mut im) = (0.0, 0.0);
            for (now, angle) in moments.iter().zip(&turns) {
                let window = (PI * angle / turned).sin().powi(2);
                let (sin, cos) = (times * angle).sin_cos();
                re += window * now.speed * cos;
                im += window * now.speed * sin;
            }
            f64::hypot(re, im)
        };
        let candidates = (0..300).map(|k| 5.0 + 0.05 * f64::from(k));
        let times_a_turn = candidates.max_by(|a, b| strength(*a).total_cmp(&strength(*b))).unwrap();
        let squares: f64 = moments.iter().map(|now| now.tilt_rate.powi(2)).sum();
        Self { size, times_a_turn, tilt_rate: (squares / moments.len() as f64).sqrt() }
    }

    fn of_barrels(wheels: &Wheels) -> Self {
        let mut robot = Robot::new(wheels);
        Self::of(|| {
            robot.step();
            robot.moment()
        })
    }

    fn of_ripple(simulation: Simulation, params: &Params) -> Self {
        let mut robot = simulation.robot(params, DT);
        let spin = RATE / (params.gear_ratio() * params.wheel_zenith.sin());
        let start = State::rolling(params, Vector2::zeros(), spin, UnitQuaternion::identity(), Vector3::zeros());
        robot.reset(&start).unwrap();
        Self::of(|| {
            robot.step([0.0; 3]);
            let state = robot.state();
            Moment {
                height: state.body_position.z,
                speed: state.body_velocity.z,
                tilt_rate: state.body_angular_velocity.xy().norm(),
                wheel_rate: state.wheel_speeds.iter().sum::<f64>().abs() / 3.0,
            }
        })
    }
}

fn rippled() -> Params {
    Params { roller_ripple: 5e-4, ..Params::paper() }
}

/// All wheels in phase: their barrels hit their neighbors together and throw the robot up a little.
#[test]
fn barrels_bob_a_robot_as_far_as_the_ripple_does() {
    let params = rippled();
    let size = params.roller_ripple / params.wheel_zenith.cos();
    let barrels = Bob::of_barrels(&Wheels { params: params.clone(), row_offset: 0.0 });
    let ripple = Bob::of_ripple(Simulation::Contact, &params);
    println!("barrels {barrels:?}\nripple {ripple:?}");
    close("bob of barrels", barrels.size, size, 0.25 * size);
    close("bob of the ripple", ripple.size, size, 0.01 * size);
}

#[test]
fn barrels_shake_a_robot_as_often_and_as_much_as_the_ripple_does() {
    let params = Params { roller_phases: [0.4, 2.0, -2.5], ..rippled() };
    let barrels = Bob::of_barrels(&Wheels { params: params.clone(), row_offset: 0.0 });
    let rows = Bob::of_barrels(&Wheels { params: params.clone(), row_offset: 4e-3 });
    let ripple = Bob::of_ripple(Simulation::Contact, &params);
    println!("barrels {barrels:?}\nin two rows {rows:?}\nripple {ripple:?}");
    for (bob, most) in [(&barrels, 3.0), (&rows, 2.0), (&ripple, 1.0)] {
        close("bobs a turn", bob.times_a_turn, params.roller_count, 0.03 * params.roller_count);
        let share = bob.tilt_rate / ripple.tilt_rate;
        assert!((1.0 / most..=most).contains(&share), "{share}");
    }
}
