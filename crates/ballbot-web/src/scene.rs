//! Robots under a controller.

use crate::settings::{SIM_DT, Settings, changed_by};
use crate::target::Target;
use ballbot_core::control::{Controller, LaneSetpoint, Setpoint};
use ballbot_core::nalgebra::{Vector2, Vector3};
use ballbot_core::terrain::{Prism, Terrain};
use ballbot_core::{Ballbot, Error, Force, LaneState, Params, Result, Wheels, check_finite, wxyz};

/// Names and lengths of the parts of a robot's row. SI units; quaternions are `w, x, y, z`; `fallen` is 1 or 0.
pub const ROW: [(&str, usize); 13] = [
    ("ball_position", 3),
    ("ball_quaternion", 4),
    ("body_position", 3),
    ("body_quaternion", 4),
    ("wheel_angles", 3),
    ("ball_velocity", 3),
    ("tilt", 1),
    ("wheel_torques", 3),
    ("wheel_normal_forces", 3),
    ("wheel_tractions", 3),
    ("floor_force", 3),
    ("setpoint", 2),
    ("fallen", 1),
];

/// Numbers in a row.
pub fn row_width() -> usize {
    ROW.iter().map(|(_, len)| len).sum()
}

/// Tilt beyond which no robot recovers, rad.
const FALLEN: f64 = 1.0;

/// How long a fallen robot lies, s.
const LIES: f64 = 2.0;

/// Distance of neighbors, in radii of the ball.
const SPACING: f64 = 8.0;

/// Distance of a target from the edge of the ground, in radii of the ball, and largest distance from the ball, m.
const MARGIN: f64 = 4.0;
const FARTHEST: f64 = 5.0;

/// How far a robot yields before the target is moved to it, m.
const YIELDED: f64 = 0.01;

/// Largest force of a pull, in weights of a robot.
const PULL: f64 = 0.2;

struct Robot {
    body: Ballbot,
    memory: Vec<f64>,
    torques: Wheels<f64>,
    /// Its place in the formation.
    place: Vector2<f64>,
    tilt: Vector2<f64>,
    pull: Vector3<f64>,
    /// When it fell, s.
    fell: Option<f64>,
}

/// Robots that one controller moves, each in its place about a common target.
pub struct Scene {
    robots: Vec<Robot>,
    controller: Box<dyn Controller>,
    /// Whether the controller yields to a force, and stays where it is left.
    yields: bool,
    nominal: Params,
    target: Target,
    steps_per_control: usize,
    steps: u64,
    rows: Vec<f64>,
    heights: Vec<f64>,
    obstacles: Vec<f64>,
}

impl Scene {
    /// From TOML.
    ///
    /// # Errors
    /// Settings that are unknown or out of range, or a controller without a design for the robot.
    pub fn new(settings: &str) -> Result<Self> {
        let Settings { nominal, params, model, controller, yields, terrain, robots, tilt } = Settings::parse(settings)?;
        let ratio = controller.control_dt() / SIM_DT;
        let steps_per_control = ratio.round() as usize;
        if steps_per_control == 0 || (ratio - ratio.round()).abs() > 1e-6 * ratio {
            let limit = format!("a multiple of {SIM_DT} s");
            return Err(Error::OutOfRange { name: "control_dt".into(), value: controller.control_dt(), limit });
        }
        let side = (robots as f64).sqrt().ceil() as usize;
        let spacing = SPACING * params.ball_radius;
        let robots = (0..robots)
            .map(|i| {
                let mut body = Ballbot::new(&params, model, SIM_DT)?;
                body.set_terrain(terrain.as_ref())?;
                // The first is in the middle.
                let j = (i + side * (side / 2) + side / 2) % (side * side);
                let at = |k: usize| spacing * (k as f64 - (side / 2) as f64);
                let direction = i as f64 * 2.4;
                let mut robot = Robot {
                    body,
                    memory: vec![0.0; controller.memory_len()],
                    torques: Wheels::default(),
                    place: if side == 1 { Vector2::zeros() } else { Vector2::new(at(j % side), at(j / side)) },
                    tilt: Vector2::new(direction.cos(), direction.sin()) * tilt,
                    pull: Vector3::zeros(),
                    fell: None,
                };
                robot.start()?;
                Ok(robot)
            })
            .collect::<Result<Vec<_>>>()?;
        let rows = vec![0.0; robots.len() * row_width()];
        let margin = MARGIN * params.ball_radius;
        let extent = robots.iter().map(|robot| robot.place.amax()).fold(margin, |most, place| most.max(place + margin));
        let half = terrain.as_ref().map_or([f64::INFINITY; 2], |terrain| terrain.half_size());
        let target = Target::new(&nominal, half.map(|half| (half - extent).max(0.0)));
        let mut scene = Self {
            robots,
            controller,
            yields,
            nominal,
            target,
            steps_per_control,
            steps: 0,
            rows,
            heights: Vec::new(),
            obstacles: terrain.as_ref().map_or_else(Vec::new, |terrain| obstacle_rows(terrain)),
        };
        scene.write_rows();
        Ok(scene)
    }

    /// Simulated time, s.
    pub fn time(&self) -> f64 {
        self.steps as f64 * SIM_DT
    }

    /// Advances by some time steps of 1 ms.
    pub fn advance(&mut self, steps: usize) {
        let mut left = steps;
        while left > 0 {
            let since = self.steps as usize % self.steps_per_control;
            if since == 0 {
                self.control();
            }
            let some = left.min(self.steps_per_control - since);
            for robot in &mut self.robots {
                // A robot that has diverged, or left the ground, starts again.
                if robot.body.step(robot.torques, some).is_err() {
                    robot.restart();
                    if robot.place == Vector2::zeros() {
                        self.target.rest_at(Vector2::zeros());
                    }
                }
            }
            self.steps += some as u64;
            left -= some;
        }
        self.write_rows();
    }

    fn control(&mut self) {
        let dt = self.steps_per_control as f64 * SIM_DT;
        let time = self.time();
        let first = &self.robots[0];
        let ball = first.body.state().ball_position.xy() - first.place;
        let yaw = LaneState::from(&first.body.state()).body_quaternion.yaw();
        if !self.follows("yaw") {
            self.target.head(yaw);
        }
        if !self.follows("position") {
            self.target.stay_with(ball);
        }
        self.target.advance(dt, ball);
        for robot in &mut self.robots {
            let state = robot.body.state();
            let fallen = state.tilt() > FALLEN || robot.body.bot_on_floor();
            match robot.fell {
                Some(fell) if time - fell > LIES => robot.restart(),
                Some(_) => {}
                None if fallen => robot.fell = Some(time),
                None => {}
            }
            robot.torques = Wheels::default();
            if robot.fell.is_none() {
                let state = robot.body.state();
                let goal = Setpoint { position: self.target.setpoint.position + robot.place, ..self.target.setpoint };
                let limit = robot.body.params().max_wheel_torque;
                let (state, goal) = (LaneState::from(&state), LaneSetpoint::from(&goal));
                robot.torques = self.controller.torques_one(&state, &goal, limit, &mut robot.memory);
                if robot.torques.iter().any(|torque| !torque.is_finite()) {
                    robot.torques = Wheels::default();
                }
            }
            // Far below the largest force; `planar` has only pushes.
            if (robot.pull != Vector3::zeros() || robot.body.has_force())
                && robot.body.apply_force(&Force::constant(robot.pull, None)).is_err()
            {
                let _ = robot.body.push(&(robot.pull * dt), None);
            }
        }
    }

    /// Pushes a robot at the center of mass of its body, N·s, inertial frame.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for an impulse that is not finite or too large, or a robot that does not exist.
    pub fn push(&mut self, robot: usize, impulse: [f64; 3]) -> Result<()> {
        self.robot(robot)?.body.push(&impulse.into(), None)
    }

    /// Pulls a robot with a force, N, inertial frame, until another call; at most a fifth of its weight.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a number that is not finite, or a robot that does not exist.
    pub fn pull(&mut self, robot: usize, force: [f64; 3]) -> Result<()> {
        check_finite("force", &force)?;
        let robot = self.robot(robot)?;
        let force = Vector3::from(force);
        let params = robot.body.params();
        let most = PULL * params.gravity * (params.body_mass + params.ball_mass);
        robot.pull = force * (most / force.norm().max(most));
        Ok(())
    }

    /// Drives by fractions of the largest velocity, heading frame, and of the largest yaw rate.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a fraction beyond ±1; [`Error::Inconsistent`] for a controller that follows no motion.
    pub fn drive(&mut self, fractions: [f64; 3]) -> Result<()> {
        self.require_motion()?;
        for (name, value) in ["forward", "left", "turn"].into_iter().zip(fractions) {
            if !(-1.0..=1.0).contains(&value) {
                return Err(Error::OutOfRange { name: name.into(), value, limit: "within ±1".into() });
            }
        }
        self.lead();
        self.target.drive(fractions);
        Ok(())
    }

    /// Moves the target to a place on the floor, m. A place beyond 5 m from the first robot, or near the edge of the
    /// ground, is brought nearer.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a number that is not finite; [`Error::Inconsistent`] for a controller that follows no
    /// motion.
    pub fn go_to(&mut self, place: [f64; 2]) -> Result<()> {
        check_finite("place", &place)?;
        self.require_position()?;
        self.lead();
        let ball = self.robots[0].body.state().ball_position.xy() - self.robots[0].place;
        let way = Vector2::from(place) - ball;
        self.target.go_to(ball + way * (FARTHEST / way.norm().max(FARTHEST)));
        Ok(())
    }

    /// Moves the target along a curve, `circle` or `eight`, from where it comes to rest.
    ///
    /// # Errors
    /// [`Error::UnknownName`] for another curve; [`Error::Inconsistent`] for a controller that follows no position, or a
    /// curve that would leave the ground.
    pub fn follow(&mut self, curve: &str) -> Result<()> {
        self.require_position()?;
        self.lead();
        self.target.follow(curve)
    }

    /// Begins a motion of the target at the first robot, if the robots may have yielded away from it.
    fn lead(&mut self) {
        // Its first numbers are how far it has yielded.
        let yielded = |robot: &Robot| robot.memory.iter().take(2).any(|way| way.abs() > YIELDED);
        if self.yields && self.robots.iter().any(yielded) {
            let first = &self.robots[0];
            let yaw = self.target.setpoint.yaw;
            self.target.rest_at(first.body.state().ball_position.xy() - first.place);
            self.target.head(yaw);
            self.robots.iter_mut().for_each(|robot| robot.memory.fill(0.0));
        }
    }

    fn follows(&self, part: &str) -> bool {
        self.controller.parts().contains(&part)
    }

    fn require_motion(&self) -> Result<()> {
        if self.follows("position") || self.follows("velocity") {
            return Ok(());
        }
        Err(Error::Inconsistent("this controller follows neither position nor velocity: it holds the tilt".into()))
    }

    fn require_position(&self) -> Result<()> {
        self.require_motion()?;
        if self.follows("position") {
            return Ok(());
        }
        Err(Error::Inconsistent("this controller follows a velocity, not a position: drive it".into()))
    }

    /// Changes the robots, from TOML, by the parameters of the nominal robot; the controller stays.
    ///
    /// # Errors
    /// Parameters that are unknown or out of range; the robots are then unchanged.
    pub fn set_params(&mut self, changes: &str) -> Result<()> {
        let params = changed_by(&self.nominal, changes)?;
        for robot in &mut self.robots {
            robot.body.set_params(&params)?;
        }
        Ok(())
    }

    /// Starts again.
    pub fn reset(&mut self) {
        self.target.rest_at(Vector2::zeros());
        self.steps = 0;
        for robot in &mut self.robots {
            robot.restart();
            robot.pull = Vector3::zeros();
        }
        self.write_rows();
    }

    /// The states of the robots, a row of [`ROW`] each.
    pub fn rows(&self) -> &[f64] {
        &self.rows
    }

    /// Heights of the ground, m, at the nodes of a square grid about a place; x runs fastest.
    pub fn heights(&mut self, [x, y]: [f64; 2], half: f64, count: usize) -> &[f64] {
        let terrain = self.robots[0].body.terrain();
        let cell = 2.0 * half / (count.max(2) - 1) as f64;
        let at = |i: usize| -half + cell * i as f64;
        let height = |i: usize| terrain.map_or(0.0, |ground| ground.height(x + at(i % count), y + at(i / count)));
        self.heights = (0..count * count).map(height).collect();
        &self.heights
    }

    /// The obstacles, a row of seven each: x and y of the center, height of the top, m, angle of the length, rad, length, width
    /// and radius, m; a post has only a radius. Walls end after 40 m.
    pub fn obstacles(&self) -> &[f64] {
        &self.obstacles
    }

    fn robot(&mut self, index: usize) -> Result<&mut Robot> {
        let limit = format!("below {}, the number of robots", self.robots.len());
        let missing = Error::OutOfRange { name: "robot".into(), value: index as f64, limit };
        self.robots.get_mut(index).ok_or(missing)
    }

    fn write_rows(&mut self) {
        for (robot, row) in self.robots.iter().zip(self.rows.chunks_exact_mut(row_width())) {
            let (state, contacts) = (robot.body.state(), robot.body.contacts());
            let goal = self.target.setpoint.position + robot.place;
            let (ball, body) = (wxyz(&state.ball_quaternion), wxyz(&state.body_quaternion));
            let fallen = [f64::from(u8::from(robot.fell.is_some()))];
            let tilt = [state.tilt()];
            let parts: [&[f64]; ROW.len()] = [
                state.ball_position.as_slice(),
                &ball,
                state.body_position.as_slice(),
                &body,
                &state.wheel_angles.0,
                state.ball_velocity.as_slice(),
                &tilt,
                &robot.torques.0,
                &contacts.wheel_normal_forces.0,
                &contacts.wheel_tractions.0,
                contacts.floor_force.as_slice(),
                goal.as_slice(),
                &fallen,
            ];
            row.iter_mut().zip(parts.into_iter().flatten()).for_each(|(to, from)| *to = *from);
        }
    }
}

impl Robot {
    /// Begins in its place with its tilt, at rest.
    fn start(&mut self) -> Result<()> {
        let tilt = (self.tilt != Vector2::zeros()).then_some(self.tilt);
        self.body.place_on_ground(self.place.x, self.place.y, 0.0, tilt)
    }

    /// Starts again. The start was valid once, but the parameters may since have changed: then it lies where it is.
    fn restart(&mut self) {
        let _ = self.start();
        self.memory.fill(0.0);
        self.torques = Wheels::default();
        self.fell = None;
    }
}

/// Half the length of a wall that is shown, m.
const SHOWN: f64 = 20.0;

fn obstacle_rows(terrain: &Terrain) -> Vec<f64> {
    let row = |prism: &Prism<f64>| {
        let [length, width] = [prism.half.x, prism.half.y].map(|half| 2.0 * half.min(SHOWN));
        // Of a wall, the part behind its face.
        let behind = (prism.half.x - SHOWN).max(0.0);
        let [x, y] = [prism.center.x + behind * prism.axis[0], prism.center.y + behind * prism.axis[1]];
        let top = (prism.center.z + prism.half.z).min(1.0);
        [x, y, top, prism.axis[1].atan2(prism.axis[0]), length, width, prism.radius]
    };
    terrain.obstacles().prisms().iter().flat_map(row).collect()
}
