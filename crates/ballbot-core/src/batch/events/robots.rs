//! Draws of the events of a chunk's robots, and the times of the next draws.

use super::event::When;
use super::plan::{Plan, Target};
use super::sampler::{ATTEMPTS, Source};
use super::setup::{Setup, Stages};
use crate::batch::env::robots::{Robots, invalid_snapshot};
use ballbot_base::error::Result;
use ballbot_base::fields::Fields;
use ballbot_base::params::Params;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Fraction of a control step by which an event may be early, for rounding.
const EARLY: f64 = 1e-9;

/// The events of one robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Drawn {
    /// Whether the next episode samples what is sampled once per environment.
    startup_due: bool,
    /// Current draws, in the columns of the plan; NaN where there is none.
    draws: Vec<f64>,
    /// Time of the next draw of each event, s from the start of the episode; infinity if there is none.
    times: Vec<f64>,
    /// Draws of each event in this episode.
    counts: Vec<u32>,
    /// Control steps for which the push of each event still acts.
    left: Vec<u32>,
    /// Draws that were repeated since the environment was seeded.
    repeated: u32,
    /// Control step before which the next event fires; 0 while a push acts.
    next: f64,
}

/// The events of one robot with what they are applied to, for snapshots.
#[derive(Serialize, Deserialize)]
pub struct Saved {
    checksum: u32,
    nominal: Vec<f64>,
    drawn: Drawn,
}

/// The events of a chunk's robots.
pub struct Randomized {
    pub plan: Arc<Plan>,
    nominal: Vec<Arc<Setup>>,
    drawn: Vec<Drawn>,
    /// Current options of the stages.
    stages: Vec<Stages>,
    /// Scratch space for one robot.
    robot: Setup,
}

/// Whether a robot changed by events is valid, in addition to the checks of its model.
pub type CheckRobot<'a> = &'a dyn Fn(&Setup) -> Result<()>;

impl Drawn {
    fn new(plan: &Plan) -> Self {
        let n = plan.events.len();
        Self {
            startup_due: true,
            draws: vec![f64::NAN; plan.width],
            times: vec![f64::INFINITY; n],
            counts: vec![0; n],
            left: vec![0; n],
            repeated: 0,
            next: f64::INFINITY,
        }
    }

    /// Samples the events of a new environment.
    fn start(&mut self, plan: &Plan, source: Source, attempt: u32) {
        self.draws.fill(f64::NAN);
        for event in plan.events.iter().filter(|event| event.event.when == When::Startup) {
            event.draw(Source { episode: 0, ..source }, 0, attempt, &mut self.draws[event.columns()]);
        }
    }

    /// Samples the events of a new episode, and the times of later events.
    fn begin(&mut self, plan: &Plan, source: Source, attempt: u32) {
        self.counts.fill(0);
        self.left.fill(0);
        for (event, time) in plan.events.iter().zip(&mut self.times) {
            let draws = &mut self.draws[event.columns()];
            *time = f64::INFINITY;
            match event.event.when {
                When::Startup => continue,
                When::Reset => {
                    event.draw(source, 0, attempt, draws);
                    continue;
                }
                When::At(at) => *time = at,
                When::Every(_) => *time = event.gap(source, 0),
            }
            draws.fill(f64::NAN);
        }
        self.find_next(plan);
    }

    /// Samples with `draw` until the resulting robot is valid. If it never is, the robot is nominal and has no draws.
    /// Returns whether it is valid.
    fn settle(
        &mut self,
        of: (&Plan, &Setup),
        robot: &mut Setup,
        accepts: &mut dyn FnMut(&Setup) -> Result<()>,
        draw: impl Fn(&mut Self, u32),
    ) -> bool {
        let (plan, nominal) = of;
        for attempt in 0..ATTEMPTS {
            draw(self, attempt);
            plan.apply(nominal, &self.draws, robot);
            if accepts(robot).is_ok() {
                return true;
            }
            self.repeated = self.repeated.saturating_add(1);
        }
        self.draws.fill(f64::NAN);
        robot.clone_from(nominal);
        accepts(robot).expect("the nominal robot was accepted");
        false
    }

    /// [`Drawn::settle`] of a new environment.
    fn settle_start(
        &mut self,
        of: (&Plan, &Setup),
        robot: &mut Setup,
        source: Source,
        accepts: &mut dyn FnMut(&Setup) -> Result<()>,
    ) {
        self.startup_due = !self.settle(of, robot, accepts, |drawn, attempt| drawn.start(of.0, source, attempt));
    }

    /// [`Drawn::settle`] of a new episode, in a new environment if it is due.
    fn settle_episode(
        &mut self,
        of: (&Plan, &Setup),
        robot: &mut Setup,
        source: Source,
        accepts: &mut dyn FnMut(&Setup) -> Result<()>,
    ) {
        if self.startup_due {
            self.settle_start(of, robot, source, accepts);
        }
        let settled = self.settle(of, robot, accepts, |drawn, attempt| drawn.begin(of.0, source, attempt));
        self.startup_due |= !settled;
    }

    /// Counts a draw of event `k`; the next one comes after `gap`, s.
    fn count(&mut self, k: usize, gap: f64) {
        self.counts[k] = self.counts[k].wrapping_add(1);
        self.times[k] += gap;
    }

    fn find_next(&mut self, plan: &Plan) {
        let soonest = self.times.iter().copied().fold(f64::INFINITY, f64::min);
        let acts = self.left.iter().any(|&left| left > 0);
        self.next = if acts { 0.0 } else { (soonest / plan.control_dt - EARLY).ceil() };
    }

    /// Whether it may belong to a robot under these events.
    fn fits(&self, plan: &Plan) -> bool {
        let n = plan.events.len();
        (self.draws.len(), self.times.len(), self.counts.len(), self.left.len()) == (plan.width, n, n, n)
            && self.left.iter().zip(&plan.events).all(|(&left, event)| left < event.steps)
            && self.times.iter().all(|time| *time >= 0.0)
            && plan.events.iter().all(|event| event.could_draw(&self.draws[event.columns()]))
    }
}

impl Randomized {
    /// For `used` robots with the same nominal parameters; samples nothing.
    pub fn new(plan: &Arc<Plan>, nominal: &Arc<Setup>, used: usize) -> Self {
        Self {
            nominal: vec![Arc::clone(nominal); used],
            drawn: vec![Drawn::new(plan); used],
            stages: vec![nominal.stages.clone(); used],
            robot: Setup::clone(nominal),
            plan: Arc::clone(plan),
        }
    }

    /// Parameters of robot `i` without events.
    pub fn nominal(&self, i: usize) -> &Params {
        &self.nominal[i].params
    }

    /// Current options of the stages of robot `i`.
    pub fn stages(&self, i: usize) -> &Stages {
        &self.stages[i]
    }

    /// Current draws of robot `i`, in the columns of the plan; NaN where there is none.
    pub fn draws(&self, i: usize) -> &[f64] {
        &self.drawn[i].draws
    }

    /// How many draws of robot `i` were invalid and were repeated, since it was seeded.
    pub fn repeated(&self, i: usize) -> u32 {
        self.drawn[i].repeated
    }

    /// Pushes of robot `i` in its episode.
    pub fn push_count(&self, i: usize) -> u32 {
        let counts = self.plan.events.iter().zip(&self.drawn[i].counts);
        counts.filter(|(event, _)| matches!(event.target, Target::Push)).map(|(_, count)| count).sum()
    }

    /// Applies the events of a new environment to robot `i`.
    pub fn start<R: Robots>(&mut self, robots: &mut R, i: usize, source: Source, check: CheckRobot<'_>) {
        let of = (&*self.plan, &*self.nominal[i]);
        let accepts = &mut |robot: &Setup| accept(robots, i, robot, check);
        self.drawn[i].settle_start(of, &mut self.robot, source, accepts);
        self.stages[i].clone_from(&self.robot.stages);
    }

    /// Applies the events of a new episode to robot `i`.
    pub fn begin<R: Robots>(&mut self, robots: &mut R, i: usize, source: Source, check: CheckRobot<'_>) {
        let of = (&*self.plan, &*self.nominal[i]);
        let accepts = &mut |robot: &Setup| accept(robots, i, robot, check);
        self.drawn[i].settle_episode(of, &mut self.robot, source, accepts);
        self.stages[i].clone_from(&self.robot.stages);
    }

    /// The parameters that robot `i` would have in a new episode, after a new seed if there is one.
    pub fn of_next_episode<R: Robots>(
        &self,
        robots: &R,
        i: usize,
        source: Source,
        seeded: bool,
        check: CheckRobot<'_>,
    ) -> Params {
        let mut drawn = if seeded { Drawn::new(&self.plan) } else { self.drawn[i].clone() };
        let mut robot = self.robot.clone();
        let accepts = &mut |robot: &Setup| check(robot).and_then(|()| robots.could_have(&robot.params));
        drawn.settle_episode((&self.plan, &self.nominal[i]), &mut robot, source, accepts);
        robot.params
    }

    /// Makes the next episode resample, under a new seed, what is sampled once per environment.
    pub fn seed(&mut self, i: usize) {
        self.drawn[i].startup_due = true;
        self.drawn[i].repeated = 0;
    }

    /// Whether an event of robot `i` fires before control step `step` of its episode.
    #[inline]
    pub fn due(&self, i: usize, step: f64) -> bool {
        step >= self.drawn[i].next
    }

    /// Fires the events that are due: first parameters and options, then pushes and forces on the changed robot. Returns whether
    /// the robot has changed.
    pub fn fire<R: Robots>(
        &mut self,
        robots: &mut R,
        i: usize,
        source: Source,
        step: f64,
        check: CheckRobot<'_>,
    ) -> bool {
        let plan = Arc::clone(&self.plan);
        let now = (step + EARLY) * plan.control_dt;
        // One bit per event; a list has no more.
        let mut fired = 0u64;
        for (k, event) in plan.events.iter().enumerate() {
            let drawn = &mut self.drawn[i];
            if !matches!(event.target, Target::Field { .. }) || drawn.times[k] > now {
                continue;
            }
            event.draw(source, drawn.counts[k], 0, &mut drawn.draws[event.columns()]);
            drawn.count(k, event.gap(source, drawn.counts[k].wrapping_add(1)));
            fired |= 1 << k;
        }
        let mut attempt = 0;
        while fired != 0 && !self.assign(robots, i, check) {
            attempt += 1;
            let drawn = &mut self.drawn[i];
            drawn.repeated = drawn.repeated.saturating_add(1);
            for (k, event) in plan.events.iter().enumerate() {
                let draws = &mut drawn.draws[event.columns()];
                if attempt == ATTEMPTS && event.event.when.is_timed() {
                    // The robot at the start of the episode was accepted.
                    draws.fill(f64::NAN);
                } else if fired >> k & 1 == 1 {
                    event.draw(source, drawn.counts[k].wrapping_sub(1), attempt, draws);
                }
            }
            if attempt == ATTEMPTS {
                self.assign(robots, i, check);
                break;
            }
        }
        for (k, event) in plan.events.iter().enumerate() {
            let drawn = &mut self.drawn[i];
            if matches!(event.target, Target::Field { .. }) {
                continue;
            }
            if drawn.times[k] <= now {
                event.draw(source, drawn.counts[k], 0, &mut drawn.draws[event.columns()]);
                drawn.count(k, event.gap(source, drawn.counts[k].wrapping_add(1)));
                if let Target::Force = event.target {
                    let force = event.force(&drawn.draws[event.columns()], &self.nominal[i].params);
                    robots.apply_force(i, &force).expect("the largest force and the model were checked");
                    continue;
                }
                drawn.left[k] = event.steps;
            }
            if drawn.left[k] > 0 {
                let (impulse, point) = event.load(&drawn.draws[event.columns()], &self.nominal[i].params);
                let part = impulse / f64::from(event.steps);
                robots.push(i, &part, point.as_ref()).expect("the largest push was checked");
                drawn.left[k] -= 1;
            }
        }
        self.drawn[i].find_next(&plan);
        fired != 0
    }

    /// Applies the current draws of robot `i` to a nominal robot.
    pub fn made_of(&self, i: usize, nominal: &Params) -> Setup {
        let mut robot = self.robot.clone();
        self.plan.apply(&self.nominal_with(i, nominal), &self.drawn[i].draws, &mut robot);
        robot
    }

    /// Replaces the parameters of robot `i` without events, once the robot of [`Randomized::made_of`] has been
    /// accepted.
    pub fn set_nominal(&mut self, i: usize, nominal: &Params) {
        self.nominal[i] = Arc::new(self.nominal_with(i, nominal));
    }

    fn nominal_with(&self, i: usize, params: &Params) -> Setup {
        Setup { params: params.clone(), stages: self.nominal[i].stages.clone() }
    }

    /// The complete state of the events of robot `i`.
    pub fn save(&self, i: usize) -> Saved {
        Saved { checksum: self.plan.checksum, nominal: self.nominal(i).numbers(), drawn: self.drawn[i].clone() }
    }

    /// Restores what [`Randomized::save`] returned, for a robot with the parameters `params`; its nominal parameters
    /// must pass `accept`.
    ///
    /// # Errors
    /// [`crate::Error::Decode`] if it does not fit, and errors of `accept` and `check`; nothing has changed then.
    pub fn load(
        &mut self,
        i: usize,
        saved: &Saved,
        params: &Params,
        accept: impl FnOnce(&Params) -> Result<()>,
        check: CheckRobot<'_>,
    ) -> Result<()> {
        if saved.checksum != self.plan.checksum || !saved.drawn.fits(&self.plan) {
            return Err(invalid_snapshot("its events differ".into()));
        }
        let nominal =
            Params::from_numbers(&saved.nominal).ok_or_else(|| invalid_snapshot("it lacks parameters".into()))?;
        if nominal != self.nominal[i].params {
            accept(&nominal)?;
        }
        let nominal = self.nominal_with(i, &nominal);
        self.plan.apply(&nominal, &saved.drawn.draws, &mut self.robot);
        if self.robot.params != *params {
            return Err(invalid_snapshot("its robot does not match its draws".into()));
        }
        check(&self.robot)?;
        self.drawn[i] = saved.drawn.clone();
        self.drawn[i].find_next(&self.plan);
        self.nominal[i] = Arc::new(nominal);
        self.stages[i].clone_from(&self.robot.stages);
        Ok(())
    }

    /// Applies its draws to robot `i`; false, with nothing changed, if the result is invalid.
    fn assign<R: Robots>(&mut self, robots: &mut R, i: usize, check: CheckRobot<'_>) -> bool {
        self.plan.apply(&self.nominal[i], &self.drawn[i].draws, &mut self.robot);
        if accept(robots, i, &self.robot, check).is_err() {
            return false;
        }
        self.stages[i].clone_from(&self.robot.stages);
        true
    }
}

/// Replaces robot `i`; an error, with nothing changed, if the new robot is invalid.
fn accept<R: Robots>(robots: &mut R, i: usize, robot: &Setup, check: CheckRobot<'_>) -> Result<()> {
    check(robot)?;
    robots.set_params(i, &robot.params).map(|_| ())
}
