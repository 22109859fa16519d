//! A rapier world: the bodies, colliders and joints of robots on their ground.

use super::between::Between;
use super::bodies::{BodyLink, wheel_transverse_inertia};
use super::bot::{DOFS, Mass};
use super::convert::{from_rapier, to_rapier};
use ballbot_base::collision_shape::{BodyShape, wheel_centers};
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::params::Params;
use ballbot_base::terrain::{Ground, Obstacle, Prism};
use ballbot_base::wheels::Wheels;
use nalgebra::Vector3;
use rapier3d_f64::parry::query;
use rapier3d_f64::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// All state that changes in a step. A step also needs a [`PhysicsPipeline`], which is workspace without state and must
/// not be shared between worlds.
#[derive(Clone, Default, Serialize, Deserialize)]
pub struct World {
    pub bodies: RigidBodySet,
    pub colliders: ColliderSet,
    impulse_joints: ImpulseJointSet,
    pub multibody_joints: MultibodyJointSet,
    islands: IslandManager,
    broad_phase: DefaultBroadPhase,
    narrow_phase: NarrowPhase,
    soft_bodies: SoftBodySet,
}

/// Handles of the parts of the robot.
#[derive(Clone, Copy)]
pub struct Handles {
    pub ball: RigidBodyHandle,
    pub body: RigidBodyHandle,
    pub wheels: Wheels<RigidBodyHandle>,
    pub bot: MultibodyIndex,
    pub floor_collider: ColliderHandle,
    /// Only on uneven ground, where the plane of the floor belongs only to the ball.
    pub uneven: Option<Uneven>,
    pub ball_collider: ColliderHandle,
    pub body_collider: ColliderHandle,
    pub wheel_colliders: Wheels<ColliderHandle>,
}

/// What touches uneven ground, and the planes that it touches.
#[derive(Clone, Copy)]
pub struct Uneven {
    /// Thin discs at the bottom and the top of the body, which itself touches only the ball.
    ends: [ColliderHandle; 2],
    pub end_planes: [ColliderHandle; 2],
    pub wheel_planes: Wheels<ColliderHandle>,
}

impl Handles {
    /// Parts of the bot that touch the ground, each with its plane.
    pub fn bot_on_planes(&self) -> impl Iterator<Item = (ColliderHandle, ColliderHandle)> {
        let floor = self.floor_collider;
        let (body, wheel_planes) =
            self.uneven.map_or(([Some((self.body_collider, floor)), None], Wheels([floor; 3])), |uneven| {
                let [bottom, top] = uneven.ends;
                let [below, above] = uneven.end_planes;
                ([Some((bottom, below)), Some((top, above))], uneven.wheel_planes)
            });
        body.into_iter().flatten().chain(self.wheel_colliders.into_iter().zip(wheel_planes))
    }

    /// All parts of the robot that touch obstacles and other robots.
    pub fn parts(&self) -> impl Iterator<Item = ColliderHandle> {
        [self.ball_collider, self.body_collider].into_iter().chain(self.wheel_colliders)
    }

    fn bodies(&self) -> impl Iterator<Item = RigidBodyHandle> {
        [self.ball, self.body].into_iter().chain(self.wheels)
    }

    /// Colliders of all parts and planes.
    fn colliders(&self) -> impl Iterator<Item = ColliderHandle> {
        self.planes().chain([self.ball_collider]).chain(self.bot_colliders())
    }

    /// Whether rapier has frozen a part, because numbers were not finite.
    pub fn in_quarantine(&self, quarantine: &Quarantine) -> bool {
        !quarantine.is_empty()
            && (self.bodies().any(|body| quarantine.bodies().contains(&body))
                || self.colliders().any(|collider| quarantine.colliders().contains(&collider)))
    }

    /// Body and wheels.
    fn bot_colliders(&self) -> impl Iterator<Item = ColliderHandle> {
        let ends = self.uneven.into_iter().flat_map(|uneven| uneven.ends);
        [self.body_collider].into_iter().chain(self.wheel_colliders).chain(ends)
    }

    /// All planes of the ground.
    fn planes(&self) -> impl Iterator<Item = ColliderHandle> {
        let planes =
            self.uneven.into_iter().flat_map(|uneven| uneven.end_planes.into_iter().chain(uneven.wheel_planes));
        [self.floor_collider].into_iter().chain(planes)
    }
}

/// Largest speed of recovery from an overlap, m/s.
pub const MAX_RECOVERY_SPEED: f64 = 1.0;

/// Collision groups of the ball and the wheels; the contact of a wheel with the ball is not rapier's.
pub const BALL: Group = Group::GROUP_1;
pub const WHEEL: Group = Group::GROUP_2;
/// Collision groups of the body and of planes.
const BODY: Group = Group::GROUP_3;
pub const PLANE: Group = Group::GROUP_4;
/// Collision group of each wheel.
const WHEEL_GROUPS: Wheels<Group> = Wheels([Group::GROUP_5, Group::GROUP_6, Group::GROUP_7]);
/// Collision group of each end of the body.
const END_GROUPS: [Group; 2] = [Group::GROUP_8, Group::GROUP_9];
/// Collision group of obstacles.
const OBSTACLE: Group = Group::GROUP_10;
/// Thickness of the ends of the body, as a fraction of its length.
const END: f64 = 1e-3;

/// Recovery from overlap: the rate of a spring with 200 Hz natural frequency and damping ratio 5, without its
/// compliance, so that a contact carries its load from the first step on.
fn softness() -> SpringCoefficients<Real> {
    SpringCoefficients::new(2e5, 5e3)
}

/// An obstacle as a collider.
fn collider(shape: &Obstacle, prism: &Prism<f64>) -> ColliderBuilder {
    let (half, [cos, sin]) = (prism.half, prism.axis);
    let center = Vector3::new(prism.center.x, prism.center.y, prism.center.z);
    let turned = Rotation::from_rotation_z(sin.atan2(cos));
    let (builder, place) = match shape {
        Obstacle::Post(_) => {
            // Cylinders of rapier are along y.
            let upright = Rotation::from_rotation_x(std::f64::consts::FRAC_PI_2);
            (ColliderBuilder::cylinder(half.z, prism.radius), Pose::from_parts(to_rapier(&center), upright))
        }
        Obstacle::Box(_) => {
            (ColliderBuilder::cuboid(half.x, half.y, half.z), Pose::from_parts(to_rapier(&center), turned))
        }
        Obstacle::Wall(_) => {
            let face = center + Vector3::new(cos, sin, 0.0) * half.x;
            let normal = Vector::new(cos, sin, 0.0);
            (
                ColliderBuilder::new(SharedShape::halfspace(normal)),
                Pose::from_parts(to_rapier(&face), Rotation::IDENTITY),
            )
        }
    };
    builder
        .position(place)
        .friction(prism.friction)
        .friction_combine_rule(CoefficientCombineRule::Max)
        .restitution(prism.restitution)
        .restitution_combine_rule(CoefficientCombineRule::Max)
        .collision_groups(InteractionGroups::new(OBSTACLE, BALL | BODY | WHEEL, InteractionTestMode::And))
}

/// Rate of recovery from overlaps in steps of `dt`, 1/s.
pub fn recovery_rate(dt: f64) -> f64 {
    softness().erp_inv_dt(dt)
}

/// Solver settings, validated by growth rate, traction and loads of the robot. Each step sets the number of sweeps.
pub fn integration_parameters(sim_dt: f64) -> IntegrationParameters {
    let softness = softness();
    IntegrationParameters {
        dt: sim_dt,
        contact_softness: softness,
        static_contact_softness: softness,
        num_solver_iterations: 1,
        // Recycled contacts would have wrong lever arms after the bodies have moved.
        contact_recycling: false,
        contact_clustering: false,
        friction_in_bias_pass: true,
        max_ccd_substeps: 0,
        friction_model: FrictionModel::Coulomb,
        normalized_max_corrective_velocity: MAX_RECOVERY_SPEED,
        normalized_prediction_distance: 0.002,
        normalized_max_linear_velocity: Real::MAX,
        ..IntegrationParameters::default()
    }
}

/// Workspace for one world. Disabled counters save several clock reads per step.
pub fn new_pipeline() -> PhysicsPipeline {
    let mut pipeline = PhysicsPipeline::new();
    pipeline.counters.disable();
    pipeline
}

impl World {
    /// Inserts a robot upright at rest at the origin, on level ground or on planes that follow it.
    pub fn insert_robot(&mut self, params: &Params, wheels: &Omniwheels, link: &BodyLink, level: bool) -> Handles {
        let plane = |touched: Group| {
            ColliderBuilder::new(SharedShape::halfspace(Vector::Z))
                .friction(params.floor_dynamic_friction)
                // All floor contacts use the friction of the floor.
                .friction_combine_rule(CoefficientCombineRule::Max)
                .collision_groups(InteractionGroups::new(PLANE, touched, InteractionTestMode::And))
        };
        let touched = if level { Group::ALL } else { BALL };
        let floor_collider = self.colliders.insert(plane(touched));
        let (ball, ball_collider) = self.insert_ball(params);
        let (body, body_collider) = self.insert_body(params, link);
        let links = Wheels::from_fn(|i| self.insert_wheel(params, wheels, link, body, i));
        let uneven = (!level).then(|| Uneven {
            ends: self.insert_ends(params, link, body),
            end_planes: END_GROUPS.map(|part| self.colliders.insert(plane(part))),
            wheel_planes: WHEEL_GROUPS.map(|part| self.colliders.insert(plane(part))),
        });
        let bot = self.bot_index(body);
        let multibody = self.multibody_joints.get_multibody_mut(bot).expect("just built");
        multibody.set_self_contacts_enabled(false);
        // Rapier damps all angular degrees of freedom by default, including the free root.
        multibody.damping_mut().fill(0.0);
        Handles {
            ball,
            body,
            wheels: links.map(|(handle, _)| handle),
            bot,
            floor_collider,
            uneven,
            ball_collider,
            body_collider,
            wheel_colliders: links.map(|(_, collider)| collider),
        }
    }

    /// Lets a robot touch the other robots of the world, by the rules of [`Between`], which also keep its wheels from its ball.
    pub fn share(&mut self, handles: &Handles, number: usize) {
        for collider in handles.colliders() {
            let collider = &mut self.colliders[collider];
            collider.user_data = number as u128 + 1;
            collider.set_active_hooks(ActiveHooks::FILTER_CONTACT_PAIRS | ActiveHooks::MODIFY_SOLVER_CONTACTS);
        }
        for collider in handles.wheel_colliders.into_iter().chain([handles.ball_collider]) {
            let collider = &mut self.colliders[collider];
            let memberships = collider.collision_groups().memberships;
            collider.set_collision_groups(InteractionGroups::new(memberships, Group::ALL, InteractionTestMode::And));
        }
    }

    /// Inserts the obstacles of a ground.
    pub fn insert_obstacles(&mut self, ground: &Ground) -> Arc<[ColliderHandle]> {
        let obstacles = ground.terrain().obstacles();
        let shapes = obstacles.shapes().iter().zip(obstacles.prisms());
        shapes.map(|(shape, prism)| self.colliders.insert(collider(shape, prism))).collect()
    }

    fn insert_ball(&mut self, params: &Params) -> (RigidBodyHandle, ColliderHandle) {
        let inertia = Vector::splat(params.ball_inertia);
        self.insert(
            RigidBodyBuilder::dynamic()
                .translation(Vector::Z * params.ball_radius)
                .additional_mass_properties(MassProperties::new(Vector::ZERO, params.ball_mass, inertia)),
            ColliderBuilder::ball(params.ball_radius).collision_groups(InteractionGroups::new(
                BALL,
                !WHEEL,
                InteractionTestMode::And,
            )),
        )
    }

    /// Mass matrix of the multibody of a robot upright at rest.
    pub fn upright_mass(&self, handles: &Handles) -> Mass {
        let mut world = self.clone();
        // Rapier computes it in a step.
        world.step(&mut new_pipeline(), &Vector3::zeros(), &integration_parameters(1e-9), &Between::default());
        let multibody = world.multibody_joints.get_multibody(handles.bot).expect("just built");
        let inverse = multibody.inv_augmented_mass().try_inverse().expect("a mass matrix is regular");
        inverse.fixed_view::<DOFS, DOFS>(0, 0).into_owned().try_inverse().expect("a mass matrix is regular")
    }

    /// Inserts the root of the multibody. Its frame is at its CoM, because rapier integrates a root with an offset CoM
    /// wrongly.
    fn insert_body(&mut self, params: &Params, link: &BodyLink) -> (RigidBodyHandle, ColliderHandle) {
        let i = &link.inertia;
        let inertia = Matrix::from_cols_array(&[
            i[(0, 0)],
            i[(1, 0)],
            i[(2, 0)],
            i[(0, 1)],
            i[(1, 1)],
            i[(2, 1)],
            i[(0, 2)],
            i[(1, 2)],
            i[(2, 2)],
        ]);
        let shape = BodyShape::new(params);
        let center = Vector3::z() * (0.5 * (shape.bottom + shape.top)) - link.com;
        // Cylinders of rapier are along y.
        let upright = Rotation::from_rotation_x(std::f64::consts::FRAC_PI_2);
        self.insert(
            RigidBodyBuilder::dynamic()
                .translation(to_rapier(&(Vector3::z() * params.ball_radius + link.com)))
                .additional_mass_properties(MassProperties::with_inertia_matrix(Vector::ZERO, link.mass, inertia)),
            ColliderBuilder::cylinder(0.5 * (shape.top - shape.bottom), shape.radius)
                .position(Pose::from_parts(to_rapier(&center), upright))
                .collision_groups(InteractionGroups::new(BODY, Group::ALL, InteractionTestMode::And)),
        )
    }

    /// Inserts the ends of the body that touch uneven ground.
    fn insert_ends(&mut self, params: &Params, link: &BodyLink, body: RigidBodyHandle) -> [ColliderHandle; 2] {
        let shape = BodyShape::new(params);
        let half = 0.5 * END * (shape.top - shape.bottom);
        let upright = Rotation::from_rotation_x(std::f64::consts::FRAC_PI_2);
        let mut insert = |height: f64, group| {
            let center = Vector3::z() * height - link.com;
            let end = ColliderBuilder::cylinder(half, shape.radius)
                .position(Pose::from_parts(to_rapier(&center), upright))
                .collision_groups(InteractionGroups::new(group, PLANE, InteractionTestMode::And));
            self.colliders.insert_with_parent(end.density(0.0).friction(0.0), body, &mut self.bodies)
        };
        [insert(shape.bottom + half, END_GROUPS[0]), insert(shape.top - half, END_GROUPS[1])]
    }

    fn insert_wheel(
        &mut self,
        params: &Params,
        wheels: &Omniwheels,
        link: &BodyLink,
        body: RigidBodyHandle,
        i: usize,
    ) -> (RigidBodyHandle, ColliderHandle) {
        let center = to_rapier(&(wheel_centers(params, wheels)[i] - link.com));
        let axle = Rotation::from_rotation_arc(Vector::X, to_rapier(&-wheels.axles.row(i).transpose()));
        let transverse = wheel_transverse_inertia(params);
        let mass = MassProperties::with_principal_inertia_frame(
            Vector::ZERO,
            params.wheel_mass,
            Vector::new(params.wheel_inertia, transverse, transverse),
            axle,
        );
        let start = self.bodies[body].translation() + center;
        let inserted = self.insert(
            RigidBodyBuilder::dynamic().translation(start).additional_mass_properties(mass),
            ColliderBuilder::ball(params.wheel_radius).collision_groups(InteractionGroups::new(
                WHEEL | WHEEL_GROUPS[i],
                !BALL,
                InteractionTestMode::And,
            )),
        );
        let mut joint = GenericJoint::new(JointAxesMask::LOCKED_REVOLUTE_AXES);
        joint.set_local_frame1(Pose::from_parts(center, axle));
        joint.set_local_frame2(Pose::from_parts(Vector::ZERO, axle));
        self.multibody_joints.insert(body, inserted.0, joint, true).expect("a wheel has no other joint");
        inserted
    }

    fn insert(&mut self, body: RigidBodyBuilder, collider: ColliderBuilder) -> (RigidBodyHandle, ColliderHandle) {
        // Rapier would put a slowly moving robot to sleep.
        let handle = self.bodies.insert(body.can_sleep(false));
        let collider = collider.density(0.0).friction(0.0);
        (handle, self.colliders.insert_with_parent(collider, handle, &mut self.bodies))
    }

    fn bot_index(&self, body: RigidBodyHandle) -> MultibodyIndex {
        self.multibody_joints.rigid_body_link(body).expect("the wheels' joints made the body a link").multibody
    }

    /// Advances by one step under `gravity` (inertial frame, m/s²).
    pub fn step(
        &mut self,
        pipeline: &mut PhysicsPipeline,
        gravity: &Vector3<f64>,
        settings: &IntegrationParameters,
        between: &Between,
    ) {
        pipeline.step(
            to_rapier(gravity),
            settings,
            &mut self.islands,
            &mut self.broad_phase,
            &mut self.narrow_phase,
            &mut self.bodies,
            &mut self.colliders,
            &mut self.impulse_joints,
            &mut self.multibody_joints,
            &mut self.soft_bodies,
            &mut CCDSolver::new(),
            between,
            &(),
        );
    }

    /// Whether the world contains all parts of the robot.
    pub fn holds(&self, handles: &Handles) -> bool {
        handles.bodies().all(|body| self.bodies.contains(body))
            && handles.colliders().all(|collider| self.colliders.get(collider).is_some())
            && self
                .multibody_joints
                .get_multibody(handles.bot)
                .is_some_and(|bot| bot.ndofs() == 9 && bot.num_links() == 4)
    }

    /// Enables or disables the colliders of the bot.
    pub fn set_bot_colliders(&mut self, handles: &Handles, enabled: bool) {
        if self.colliders[handles.body_collider].is_enabled() != enabled {
            for collider in handles.bot_colliders() {
                self.colliders[collider].set_enabled(enabled);
            }
        }
    }

    /// Sets the floor's friction coefficient.
    pub fn set_floor_friction(&mut self, handles: &Handles, friction: f64) {
        // Rapier processes a changed collider again, so changes without effect are skipped.
        for plane in handles.planes() {
            if (self.colliders[plane].friction() - friction).abs() > 1e-6 {
                self.colliders[plane].set_friction(friction);
            }
        }
    }

    fn points(&self, a: ColliderHandle, b: ColliderHandle) -> impl Iterator<Item = &TrackedContact<ContactData>> {
        self.narrow_phase
            .contact_pair(a, b)
            .map_or(&[] as &[ContactManifold], |pair| pair.solver_manifolds())
            .iter()
            .flat_map(|manifold| &manifold.points)
    }

    /// Impulse of a plane on another collider in the last step, inertial frame, N·s.
    pub fn plane_impulse(&self, plane: ColliderHandle, other: ColliderHandle, normal: &Vector3<f64>) -> Vector3<f64> {
        let mut impulse = Vector3::zeros();
        let Some(pair) = self.narrow_phase.contact_pair(plane, other) else {
            return impulse;
        };
        let on_other = if pair.collider1 == plane { -1.0 } else { 1.0 };
        for point in self.points(plane, other) {
            impulse += from_rapier(point.data.warmstart_tangent_world) * on_other;
            impulse += normal * point.data.impulse;
        }
        impulse
    }

    /// Impulse of the floor on the bot in the last step, inertial frame, N·s.
    pub fn bot_floor_impulse(&self, handles: &Handles) -> Vector3<f64> {
        let impulse = |(part, plane): (ColliderHandle, ColliderHandle)| {
            let normal = from_rapier(self.colliders[plane].rotation() * Vector::Z);
            self.plane_impulse(plane, part, &normal)
        };
        handles.bot_on_planes().map(impulse).sum()
    }

    /// Impulse of one collider on another in the last step, inertial frame, N·s.
    pub fn impulse(&self, of: ColliderHandle, on: ColliderHandle) -> Vector3<f64> {
        let mut impulse = Vector3::zeros();
        let Some(pair) = self.narrow_phase.contact_pair(of, on) else {
            return impulse;
        };
        // Normals are from the first to the second collider; tangential impulses are of the first.
        let on_other = if pair.collider1 == of { 1.0 } else { -1.0 };
        for manifold in pair.solver_manifolds() {
            let normal = from_rapier(manifold.data.normal);
            for point in &manifold.points {
                impulse += (normal * point.data.impulse - from_rapier(point.data.warmstart_tangent_world)) * on_other;
            }
        }
        impulse
    }

    /// By how much two colliders of parts overlap, m; 0 if they do not.
    pub fn overlap(&self, a: ColliderHandle, b: ColliderHandle) -> f64 {
        let [a, b] = [a, b].map(|handle| {
            let collider = &self.colliders[handle];
            let body = collider.parent().map_or(Pose::IDENTITY, |body| *self.bodies[body].position());
            (collider.position_wrt_parent().map_or(body, |place| body * *place), collider.shape())
        });
        let contact = query::contact(&a.0, a.1, &b.0, b.1, 0.0);
        contact.ok().flatten().map_or(0.0, |contact| (-contact.dist).max(0.0))
    }

    /// Whether two colliders carried each other in the last step.
    pub fn touch(&self, a: ColliderHandle, b: ColliderHandle) -> bool {
        self.points(a, b).any(|point| point.data.impulse > 0.0)
    }
}
