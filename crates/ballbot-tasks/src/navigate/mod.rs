//! The navigate task: reach goals among posts without touching them.

mod guide;

use super::shared::{alive, bounded_error, effort, limited, squared_norm};
use super::start::{check_range, drawn_steps, in_range, starts_and_falls, task_fields};
use super::velocity::third_derivative;
use super::{Geometry, Goal, Metric, Metrics, Moment, Row, Rows, Sensed, Step, Task, Term, Terms};
use ballbot_base::collision_shape::BodyShape;
use ballbot_base::error::{Error, Result, check};
use ballbot_base::fields::Limit;
use ballbot_base::lanes::{Heading, Lane, Memory};
use ballbot_base::params::Params;
use ballbot_base::setpoint::Setpoint;
use ballbot_base::terrain::{Obstacles, Terrain};
use guide::{Near, barrier, nearest, potential_field};
use nalgebra::Vector2;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;
use std::sync::Arc;

task_fields! {
    fall 30.0, tilt 3.0;
    /// Options of the navigate task. SI units and radians. Tilts are from the equilibrium.
    pub struct Navigate {
        /// Smallest and largest distance of a goal from the ball, uniform, in any direction in which it is free.
        pub goal_distance: [f64; 2] = [1.0, 3.0], "m", Limit::from(0.0).to(100.0);
        /// Shortest and longest time from one goal to the next, uniform.
        pub goal_seconds: [f64; 2] = [20.0, 20.0], "s", Limit::above(0.0).to(1e9);
        /// Distance within which the ball is at its goal.
        pub goal_radius: f64 = 0.05, "m", Limit::from(1e-6).to(10.0);
        /// How long the ball must have been at its goal when the next goal is given.
        pub hold_seconds: f64 = 1.0, "s", Limit::from(0.0).to(1e9);
        /// Guide of the motion that a controller tracks: 0 leads straight to the goal, 1 is a potential field, 2 a control
        /// barrier function.
        pub guide: f64 = 2.0, "", Limit::from(0.0).to(2.0);
        /// Largest speed of the guided motion.
        pub speed: f64 = 0.4, "m/s", Limit::above(0.0).to(10.0), scaled;
        /// Rate at which it approaches the goal, and obstacles with guide 2.
        pub approach: f64 = 0.8, "1/s", Limit::above(0.0).to(100.0), scaled;
        /// The guided motion follows its guide with three poles at minus this value, at most 0.5 / control_dt.
        pub smoothing: f64 = 4.0, "1/s", Limit::above(0.0).to(1e3), scaled;
        /// Distance that guides keep between the robot upright and obstacles.
        pub margin: f64 = 0.1, "m", Limit::from(0.0).to(10.0);
        /// Distance from obstacles at which guides begin to avoid them.
        pub range: f64 = 0.5, "m", Limit::above(0.0).to(100.0);
    }
}

/// Memory after the memory of [`Goal`]: place of the guided motion, its velocity, acceleration and jerk; its guide; the
/// closeness of the two nearest obstacles; radius of the robot; whether it touched an obstacle in the last
/// step; collisions; least distance; whether the episode has begun; the poles of the guided motion; goals that were not free.
const PLACE: [usize; 2] = [Goal::MEMORY, Goal::MEMORY + 1];
const VELOCITY: [usize; 2] = [Goal::MEMORY + 2, Goal::MEMORY + 3];
const FIRST: [usize; 2] = [Goal::MEMORY + 4, Goal::MEMORY + 5];
const SECOND: [usize; 2] = [Goal::MEMORY + 6, Goal::MEMORY + 7];
const GUIDE: [usize; 2] = [Goal::MEMORY + 8, Goal::MEMORY + 9];
const OBSTACLES: [usize; 4] = [Goal::MEMORY + 10, Goal::MEMORY + 11, Goal::MEMORY + 12, Goal::MEMORY + 13];
const RADIUS: usize = Goal::MEMORY + 14;
const TOUCHES: usize = Goal::MEMORY + 15;
const COLLISIONS: usize = Goal::MEMORY + 16;
const LEAST: usize = Goal::MEMORY + 17;
const STARTED: usize = Goal::MEMORY + 18;
const POLE: usize = Goal::MEMORY + 19;
const BLOCKED: usize = Goal::MEMORY + 20;

/// Distance up to which obstacles are observed and measured, m: also in docs/obstacles.md.
const SIGHT: f64 = 2.0;

/// Largest product of a pole of the guided motion and a control step: beyond 0.55 its integration is not stable.
const FASTEST_POLE: f64 = 0.5;

/// Tries to find a free goal; then the goal is where the ball is, and the episode no success.
const TRIES: usize = 100;

/// Lengths of the default terrain, in ball radii: mean radius of posts, their gap, the clear place, the tile.
const POST: f64 = 1.0;
const GAP: f64 = 9.0;
const CLEAR: f64 = 8.0;
const TILE: f64 = 80.0;

/// Posts in a tile of the highest level.
const POSTS: f64 = 20.0;

impl Task for Navigate {
    const NAME: &'static str = "navigate";
    const ID: &'static str = "ballbot/Navigate-v0";
    const SUMMARY: &'static str = "Reach goals among posts without touching them.";
    const MAX_EPISODE_STEPS: usize = 4000;
    const SUCCESS: &'static str = "not terminated, no obstacle touched, and every goal free and held within `goal_radius` for the last `hold_seconds` of its time";
    const ANYWHERE: bool = true;
    const HAS_TERRAIN: bool = true;
    const GEOMETRY: Option<Geometry> = Some(Geometry::Point);
    const COMMAND: &'static [Row] = Goal::COMMAND;
    const MEMORY: usize = Goal::MEMORY + 21;

    fn validate(&self, params: &Params) -> Result<()> {
        check_range("goal_distance", self.goal_distance)?;
        check("guide", self.guide, "0, 1 or 2", |guide| guide.fract() == 0.0)?;
        if self.approach > 0.5 * self.smoothing {
            let (approach, most) = (self.approach, 0.5 * self.smoothing);
            return Err(Error::OutOfRange {
                name: "approach".into(),
                value: approach,
                limit: format!("at most smoothing / 2 = {most}: the guided motion would overshoot"),
            });
        }
        self.goal().validate(params)
    }

    starts_and_falls!();

    fn terrain(&self, params: &Params) -> Result<Option<Arc<Terrain>>> {
        let unit = params.ball_radius;
        let tile = TILE * unit;
        let parameters = [
            ("density", POSTS / (tile * tile)),
            ("radius", POST * unit),
            ("gap", GAP * unit),
            ("clear", CLEAR * unit),
            ("tile", tile),
        ];
        Terrain::shared("posts", 0, &parameters).map(Some)
    }

    fn command(&self, moment: &Moment<'_>, rng: &mut ChaCha8Rng, memory: &mut [f64]) -> f64 {
        let ball = moment.state.ball_position;
        let needed = radius_of(moment.params) + self.margin + self.goal_radius;
        [memory[0], memory[1]] = [ball.x, ball.y];
        memory[BLOCKED] += 1.0;
        for _ in 0..TRIES {
            let distance = in_range(rng, self.goal_distance);
            let (sin, cos) = (TAU * rng.random::<f64>()).sin_cos();
            let goal = [distance.mul_add(cos, ball.x), distance.mul_add(sin, ball.y)];
            if is_free(moment.terrain, [ball.x, ball.y], goal, needed) {
                [memory[0], memory[1]] = goal;
                memory[BLOCKED] -= 1.0;
                break;
            }
        }
        drawn_steps(self.goal_seconds, moment.control_dt, rng)
    }

    fn commanded(&self, moment: &Moment<'_>, memory: &mut [f64]) {
        self.goal().commanded(moment, memory);
        if memory[STARTED] == 0.0 {
            let ball = moment.state.ball_position;
            [memory[PLACE[0]], memory[PLACE[1]]] = [ball.x, ball.y];
            memory[RADIUS] = radius_of(moment.params);
            memory[LEAST] = SIGHT;
            memory[STARTED] = 1.0;
            memory[POLE] = self.smoothing.min(FASTEST_POLE / moment.control_dt);
            let near = nearest(moment.terrain.map(Terrain::obstacles), [ball.x, ball.y], SIGHT);
            for i in 0..2 {
                [memory[OBSTACLES[2 * i]], memory[OBSTACLES[2 * i + 1]]] = closeness(&near[i]);
            }
        }
    }

    fn setpoint(&self, memory: &[f64]) -> Setpoint {
        let two = |[x, y]: [usize; 2]| Vector2::new(memory[x], memory[y]);
        let (velocity, first, second, guide) = (two(VELOCITY), two(FIRST), two(SECOND), two(GUIDE));
        Setpoint {
            position: two(PLACE),
            velocity,
            acceleration: first,
            jerk: second,
            snap: Vector2::from_fn(|i, _| third_derivative(memory[POLE], guide[i], velocity[i], first[i], second[i])),
            ..Setpoint::default()
        }
    }

    #[inline(always)]
    fn observe<L: Lane>(&self, sensed: &Sensed<'_, L>, memory: &Memory<'_, L>, rows: &mut impl Rows<L>) {
        self.goal().observe(sensed, memory, rows);
        let heading = Heading::new(sensed.state.body_quaternion);
        let ball = sensed.state.ball_position;
        let [x, y] = heading.of(memory.get(PLACE[0]) - ball.x, memory.get(PLACE[1]) - ball.y);
        rows.row(Row::new("way to the guided motion, heading x", "m", 1.0, 0.1), x);
        rows.row(Row::new("way to the guided motion, heading y", "m", 1.0, 0.1), y);
        let [x, y] = heading.of(memory.get(VELOCITY[0]), memory.get(VELOCITY[1]));
        rows.row(Row::new("guided velocity, heading x", "m/s", 1.0, 0.2), x);
        rows.row(Row::new("guided velocity, heading y", "m/s", 1.0, 0.2), y);
        let [x, y] = heading.of(memory.get(FIRST[0]), memory.get(FIRST[1]));
        rows.row(Row::new("guided acceleration, heading x", "m/s²", 10.0, 0.2), x);
        rows.row(Row::new("guided acceleration, heading y", "m/s²", 10.0, 0.2), y);
        let [x, y] = heading.of(memory.get(OBSTACLES[0]), memory.get(OBSTACLES[1]));
        rows.row(Row::new("closeness of the nearest obstacle, heading x", "", 1.0, 0.2), x);
        rows.row(Row::new("closeness of the nearest obstacle, heading y", "", 1.0, 0.2), y);
        let [x, y] = heading.of(memory.get(OBSTACLES[2]), memory.get(OBSTACLES[3]));
        rows.row(Row::new("closeness of the next obstacle, heading x", "", 1.0, 0.2), x);
        rows.row(Row::new("closeness of the next obstacle, heading y", "", 1.0, 0.2), y);
    }

    #[inline(always)]
    fn advance<L: Lane>(&self, step: &Step<'_, L>, memory: &mut Memory<'_, L>) {
        self.goal().advance(step, memory);
        let obstacles = step.terrain.map(Terrain::obstacles);
        let ball = step.state.ball_position;
        let near = nearest(obstacles, [ball.x, ball.y], SIGHT);
        let radius = memory.get(RADIUS);
        for i in 0..2 {
            let [x, y] = closeness(&near[i]);
            memory.set(OBSTACLES[2 * i], x);
            memory.set(OBSTACLES[2 * i + 1], y);
        }
        memory.set(LEAST, memory.get(LEAST).min(near[0].distance - radius));
        let zero = radius.zero();
        let touches = L::select(step.on_obstacle, zero.splat(1.0), zero);
        let begins = (touches - memory.get(TOUCHES)).max(zero);
        memory.set(TOUCHES, touches);
        memory.set(COLLISIONS, memory.get(COLLISIONS) + begins);
        self.guide(step, obstacles, memory);
    }

    #[inline(always)]
    fn success<L: Lane>(&self, step: &Step<'_, L>, terminated: L::Mask, memory: &mut Memory<'_, L>) -> L::Mask {
        let collisions = memory.get(COLLISIONS);
        let failed = collisions + memory.get(BLOCKED);
        self.goal().success(step, terminated, memory) & failed.le(failed.zero())
    }

    #[inline(always)]
    fn reward<L: Lane>(
        &self,
        step: &Step<'_, L>,
        terminated: L::Mask,
        memory: &Memory<'_, L>,
        terms: &mut impl Terms<L>,
    ) {
        let (ball, velocity) = (step.state.ball_position, step.state.ball_velocity);
        let to_goal = [memory.get(0) - ball.x, memory.get(1) - ball.y];
        let way = [memory.get(PLACE[0]) - ball.x, memory.get(PLACE[1]) - ball.y];
        let slower = [memory.get(VELOCITY[0]) - velocity.x, memory.get(VELOCITY[1]) - velocity.y];
        alive(terminated, 1.0, step.tilt, terms);
        terms.term(
            Term::cost("guided_position", 0.3, "d² / (d² + (0.1 m)²), d the distance from the guided motion"),
            bounded_error(squared_norm(way), 0.1),
        );
        terms.term(
            Term::cost("guided_velocity", 0.3, "e² / (e² + (0.2 m/s)²), e the difference from the guided velocity"),
            bounded_error(squared_norm(slower), 0.2),
        );
        terms.term(
            Term::cost("position", 0.2, "d² / (d² + (0.05 m)²), d the distance of the goal"),
            bounded_error(squared_norm(to_goal), 0.05),
        );
        effort(step, terms);
        terms.term(Term::cost("collision", 1.0, "1 while the robot touches an obstacle, else 0"), memory.get(TOUCHES));
    }

    fn measure(&self, memory: &[f64], control_dt: f64, metrics: &mut impl Metrics) {
        self.goal().measure(&memory[..Goal::MEMORY], control_dt, metrics);
        metrics
            .metric(Metric::new("collisions", "", "number of times the robot touched an obstacle"), memory[COLLISIONS]);
        metrics.metric(
            Metric::new(
                "clearance",
                "m",
                "smallest distance from an obstacle, of an upright robot at the ball, at most 2 m",
            ),
            memory[LEAST],
        );
    }
}

/// Horizontal radius of an upright robot, m.
fn radius_of(params: &Params) -> f64 {
    params.ball_radius.max(BodyShape::new(params).radius + params.wheel_radius)
}

/// The direction to an obstacle, with a length of 1 at its outline that falls to 0 at the end of sight.
#[inline(always)]
fn closeness<L: Lane>(near: &Near<L>) -> [L; 2] {
    let size = near.distance * (1.0 / SIGHT) - 1.0;
    [near.away[0] * size, near.away[1] * size]
}

/// Whether a goal is at least `needed`, m, from obstacles and, on a terrain, within the tile of the ball.
fn is_free(terrain: Option<&Terrain>, ball: [f64; 2], goal: [f64; 2], needed: f64) -> bool {
    let Some(terrain) = terrain else { return true };
    let (middle, half) = match terrain.tiles() {
        Some(tiles) => {
            let [column, level] = tiles.nearest(ball[0], ball[1]);
            (tiles.center(column, level), [0.5 * tiles.side; 2])
        }
        None => ([0.0; 2], terrain.half_size()),
    };
    (0..2).all(|i| (goal[i] - middle[i]).abs() + needed <= half[i]) && terrain.obstacles().aside(goal) >= needed
}

impl Navigate {
    /// The task of going to the goals.
    #[inline(always)]
    fn goal(&self) -> Goal {
        Goal {
            goal_distance: self.goal_distance,
            goal_seconds: self.goal_seconds,
            goal_radius: self.goal_radius,
            approach_acceleration: 100.0,
            approach_time: 1.0 / self.approach,
            hold_seconds: self.hold_seconds,
            reset_tilt: self.reset_tilt,
            reset_yaw: self.reset_yaw,
            reset_ball_speed: self.reset_ball_speed,
            reset_tilt_rate: self.reset_tilt_rate,
            reset_yaw_rate: self.reset_yaw_rate,
            fall_tilt: self.fall_tilt,
        }
    }

    /// Advances the guided motion by a step.
    #[inline(always)]
    fn guide<L: Lane>(&self, step: &Step<'_, L>, obstacles: Option<&Obstacles>, memory: &mut Memory<'_, L>) {
        let place = [memory.get(PLACE[0]), memory.get(PLACE[1])];
        let desired = limited(
            [(memory.get(0) - place[0]) * self.approach, (memory.get(1) - place[1]) * self.approach],
            self.speed,
        );
        let kept = memory.get(RADIUS) + self.margin;
        let guide = if self.guide == 0.0 {
            desired
        } else {
            let mut near = nearest(obstacles, place, SIGHT.max(self.range));
            for near in &mut near {
                near.distance -= kept;
            }
            if self.guide == 1.0 {
                // Without this factor an obstacle next to the goal would keep the robot away from it.
                let to_goal = [memory.get(0) - place[0], memory.get(1) - place[1]];
                let fades = (squared_norm(to_goal).sqrt() * (1.0 / self.range)).min(kept.splat(1.0));
                potential_field(desired, &near, self.range, self.speed, fades)
            } else {
                barrier(desired, &near, self.range, self.speed, self.approach)
            }
        };
        let dt = step.control_dt;
        for i in 0..2 {
            let (velocity, first, second) = (memory.get(VELOCITY[i]), memory.get(FIRST[i]), memory.get(SECOND[i]));
            let pole = memory.get(POLE);
            let third = (guide[i] - velocity) * (pole * pole.squared())
                - first * (pole.squared() * 3.0)
                - second * (pole * 3.0);
            let second = second + third * dt;
            let first = first + second * dt;
            let velocity = velocity + first * dt;
            memory.set(GUIDE[i], guide[i]);
            memory.set(SECOND[i], second);
            memory.set(FIRST[i], first);
            memory.set(VELOCITY[i], velocity);
            memory.set(PLACE[i], place[i] + velocity * dt);
        }
    }
}
