//! The constants of a step on a floor that moves, or on which friction differs from place to place.
//!
//! Only gravity and the friction of the floor depend on time and place. They are computed before each step, so that the step
//! itself is the same code, and robots on other floors do no more work. A bot that touches the floor has the friction below
//! its ball.

use super::constants::Constants;
use super::state::ContactState;
use ballbot_base::lanes::{Cell, EIGHT, Eight, Lane, Scalar, Vec3, lane_struct, run_one};
use ballbot_base::params::Params;
use ballbot_base::perturbed_floor::{FloorMotion, FrictionMap, Tile};
use ballbot_base::terrain::{Ground, Patch};

lane_struct! {
    /// The floor of one robot or of eight.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    struct Floor<T> {
        motion: FloorMotion<T>,
        friction: FrictionMap<T>,
        /// Constants at rest, with friction at a factor of 1.
        gravity_dt: [T; 3],
        floor_static_friction: T,
        floor_dynamic_friction: T,
    }
}

/// The floor of one robot or of eight, and their constants in the present step.
pub struct PerturbedFloor<T> {
    floor: Floor<T>,
    tile: Tile<T>,
    patch: Patch<T>,
    constants: Constants<T>,
}

impl<T: Cell> PerturbedFloor<T> {
    /// Floors for [`PerturbedFloor::set_lane`] of each robot.
    pub fn unset() -> Self {
        Self {
            floor: Floor::default(),
            tile: Tile::default(),
            patch: Patch::default(),
            constants: Constants::default(),
        }
    }

    /// Replaces the floor and the constants of robot `i`.
    pub fn set_lane(&mut self, i: usize, params: &Params, constants: &Constants<f64>) {
        let floor = Floor {
            motion: FloorMotion::new(params),
            friction: FrictionMap::new(params),
            gravity_dt: constants.gravity_dt,
            floor_static_friction: constants.floor_static_friction,
            floor_dynamic_friction: constants.floor_dynamic_friction,
        };
        self.floor.set_lane(i, &floor);
        self.constants.set_lane(i, constants);
        self.tile.forget(i);
    }

    /// The constants of the step of [`PerturbedFloor::update`].
    pub fn constants(&self) -> &Constants<T> {
        &self.constants
    }

    /// Computes the constants of the next step of robots on their ground.
    #[inline(always)]
    pub fn update<L: Lane<Cell = T>>(&mut self, token: L::Token, state: &ContactState<T>, ground: Option<&Ground>) {
        let Self { floor, tile, patch, constants } = self;
        let motion = floor.motion.load::<L>(token);
        let steps = L::load(token, &state.steps);
        let sim_dt = L::load(token, &constants.sim_dt);
        // In the middle of the step: its error is of second order.
        let up = motion.up((steps + 0.5) * sim_dt);
        let moves = motion.moves();
        let [x, y, z] = &mut constants.gravity_dt;
        for (cell, (at_rest, now)) in [x, y, z].into_iter().zip(floor.gravity_dt.iter().zip([up.x, up.y, up.z])) {
            L::select(moves, now * sim_dt, L::load(token, at_rest)).store(cell);
        }

        let ball = Vec3::<L>::load(token, &state.ball_position);
        let mut place = [ball.x, ball.y];
        if let Some(ground) = ground {
            let radius = L::load(token, &constants.ball_radius);
            let (_, frame) = ground.under(token, [ball.x, ball.y, ball.z], radius, patch);
            place = [frame.normal.x.neg_mul_add(radius, ball.x), frame.normal.y.neg_mul_add(radius, ball.y)];
        }
        let factor = floor.friction.factor(token, place, tile);
        (L::load(token, &floor.floor_static_friction) * factor).store(&mut constants.floor_static_friction);
        (L::load(token, &floor.floor_dynamic_friction) * factor).store(&mut constants.floor_dynamic_friction);
    }
}

impl PerturbedFloor<f64> {
    /// The floor of a robot; `None` if it is at rest and friction is the same everywhere.
    pub fn new(params: &Params, constants: &Constants<f64>) -> Option<Box<Self>> {
        params.has_perturbed_floor().then(|| {
            let mut floor = Box::new(Self::unset());
            floor.set_lane(0, params, constants);
            floor
        })
    }

    /// The constants of the next step.
    pub fn next(&mut self, state: &ContactState<f64>, ground: Option<&Ground>) -> &Constants<f64> {
        run_one(
            #[inline(always)]
            || self.update::<f64>(Scalar, state, ground),
        );
        &self.constants
    }
}

impl PerturbedFloor<Eight> {
    /// [`PerturbedFloor::update`] robot by robot.
    pub fn update_one_by_one(&mut self, state: &ContactState<Eight>, ground: Option<&Ground>) {
        let mut one = PerturbedFloor::<f64>::unset();
        for i in 0..EIGHT {
            one.floor = self.floor.lane(i);
            one.constants = self.constants.lane(i);
            one.tile = Tile::default();
            one.patch = Patch::default();
            self.constants.set_lane(i, one.next(&state.lane(i), ground));
        }
    }
}
