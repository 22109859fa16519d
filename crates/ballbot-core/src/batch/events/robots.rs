//! What the events of a chunk's robots have drawn, and when they draw next.

use super::super::robots::{Robots, refused};
use super::event::When;
use super::plan::{Plan, Target};
use super::sampler::Key;
use crate::error::Result;
use crate::params::Params;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Share of a control step by which an event may be early, for rounding.
const EARLY: f64 = 1e-9;

/// The events of one robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Drawn {
    /// Episodes begun since the environment was seeded.
    episode: u32,
    /// Whether the next episode draws what is drawn once an environment.
    startup_due: bool,
    /// Present draws, in the columns of the plan; NaN where there is none.
    draws: Vec<f64>,
    /// Time of the next draw of each event, s from the start of the episode; infinity if there is none.
    times: Vec<f64>,
    /// Draws of each event in this episode.
    counts: Vec<u32>,
    /// Control step before which the next event fires.
    next: f64,
}

/// The events of one robot with what they are applied to, to be kept.
#[derive(Serialize, Deserialize)]
pub struct Saved {
    checksum: u32,
    nominal: Vec<f64>,
    drawn: Drawn,
}

/// The events of a chunk's robots.
pub struct Randomized {
    pub plan: Arc<Plan>,
    nominal: Vec<Arc<Params>>,
    drawn: Vec<Drawn>,
    /// Room for the parameters of one robot.
    robot: Params,
}

impl Drawn {
    fn new(plan: &Plan) -> Self {
        let n = plan.events.len();
        Self {
            episode: 0,
            startup_due: true,
            draws: vec![f64::NAN; plan.width],
            times: vec![f64::INFINITY; n],
            counts: vec![0; n],
            next: f64::INFINITY,
        }
    }

    /// Draws what a new environment has, in its episode 0.
    fn start(&mut self, plan: &Plan, key: Key) {
        self.startup_due = false;
        for event in plan.events.iter().filter(|event| event.event.when == When::Startup) {
            event.draw(key, 0, 0, &mut self.draws[event.columns()]);
        }
    }

    /// Draws what a new episode has, and the times of what comes later.
    fn begin(&mut self, plan: &Plan, key: Key) {
        if self.startup_due {
            self.start(plan, key);
        }
        self.episode = self.episode.wrapping_add(1);
        self.counts.fill(0);
        for (event, time) in plan.events.iter().zip(&mut self.times) {
            let draws = &mut self.draws[event.columns()];
            *time = f64::INFINITY;
            match event.event.when {
                When::Startup => continue,
                When::Reset => {
                    event.draw(key, self.episode, 0, draws);
                    continue;
                }
                When::At(at) => *time = at,
                When::Every(_) => *time = event.gap(key, self.episode, 0),
            }
            draws.fill(f64::NAN);
        }
        self.find_next(plan);
    }

    fn find_next(&mut self, plan: &Plan) {
        let soonest = self.times.iter().copied().fold(f64::INFINITY, f64::min);
        self.next = (soonest / plan.control_dt - EARLY).ceil();
    }

    /// Whether it may be that of a robot under these events.
    fn fits(&self, plan: &Plan) -> bool {
        let n = plan.events.len();
        (self.draws.len(), self.times.len(), self.counts.len()) == (plan.width, n, n)
            && self.times.iter().all(|time| *time >= 0.0)
            && plan.events.iter().all(|event| event.could_draw(&self.draws[event.columns()]))
    }
}

impl Randomized {
    /// Of `used` robots of the same nominal parameters; draws nothing.
    pub fn new(plan: &Arc<Plan>, nominal: &Arc<Params>, used: usize) -> Self {
        Self {
            nominal: vec![Arc::clone(nominal); used],
            drawn: vec![Drawn::new(plan); used],
            robot: Params::clone(nominal),
            plan: Arc::clone(plan),
        }
    }

    /// Parameters that robot `i` has without events.
    pub fn nominal(&self, i: usize) -> &Params {
        &self.nominal[i]
    }

    /// Present draws of robot `i`, in the columns of the plan; NaN where there is none.
    pub fn draws(&self, i: usize) -> &[f64] {
        &self.drawn[i].draws
    }

    /// Makes robot `i` what it is in a new environment.
    pub fn start<R: Robots>(&mut self, robots: &mut R, i: usize, key: Key) {
        self.drawn[i].start(&self.plan, key);
        self.assign_or_nominal(robots, i);
    }

    /// Makes robot `i` what it is in a new episode.
    pub fn begin<R: Robots>(&mut self, robots: &mut R, i: usize, key: Key) {
        self.drawn[i].begin(&self.plan, key);
        self.assign_or_nominal(robots, i);
    }

    /// The parameters that robot `i` would have in a new episode, after a new seed if there is one.
    pub fn of_next_episode(&self, i: usize, key: Key, seeded: bool) -> Params {
        let mut drawn = if seeded { Drawn::new(&self.plan) } else { self.drawn[i].clone() };
        drawn.begin(&self.plan, key);
        let mut robot = self.robot.clone();
        self.plan.apply(&self.nominal[i], &drawn.draws, &mut robot);
        robot
    }

    /// Counts the episodes of robot `i` anew, under a new seed.
    pub fn seed(&mut self, i: usize) {
        self.drawn[i].episode = 0;
        self.drawn[i].startup_due = true;
    }

    /// Whether an event of robot `i` fires before control step `step` of its episode.
    #[inline]
    pub fn due(&self, i: usize, step: f64) -> bool {
        step >= self.drawn[i].next
    }

    /// Fires what is due: parameters first, then pushes on the robot that these make.
    pub fn fire<R: Robots>(&mut self, robots: &mut R, i: usize, key: Key, step: f64) {
        let plan = Arc::clone(&self.plan);
        let now = (step + EARLY) * plan.control_dt;
        for pushes in [false, true] {
            let mut changed = false;
            for (k, event) in plan.events.iter().enumerate() {
                let drawn = &mut self.drawn[i];
                if matches!(event.target, Target::Push) != pushes || drawn.times[k] > now {
                    continue;
                }
                let draws = &mut drawn.draws[event.columns()];
                event.draw(key, drawn.episode, drawn.counts[k], draws);
                drawn.counts[k] = drawn.counts[k].wrapping_add(1);
                drawn.times[k] += event.gap(key, drawn.episode, drawn.counts[k]);
                changed = true;
                if pushes {
                    let (impulse, point) = event.push(draws, &self.nominal[i]);
                    robots.push(i, &impulse, point.as_ref()).expect("the largest push was checked");
                }
            }
            if changed && !pushes && !self.assign(robots, i) {
                // What was drawn within the episode is taken back; the robot of its beginning was accepted.
                for event in plan.events.iter().filter(|event| event.event.when.is_timed()) {
                    self.drawn[i].draws[event.columns()].fill(f64::NAN);
                }
                self.assign(robots, i);
            }
        }
        self.drawn[i].find_next(&plan);
    }

    /// The robot that the present draws of robot `i` make of a nominal one.
    pub fn made_of(&self, i: usize, nominal: &Params) -> Params {
        let mut robot = nominal.clone();
        self.plan.apply(nominal, &self.drawn[i].draws, &mut robot);
        robot
    }

    /// Replaces the parameters that robot `i` has without events, once [`Randomized::made_of`] has been taken for them.
    pub fn set_nominal(&mut self, i: usize, nominal: &Params) {
        self.nominal[i] = Arc::new(nominal.clone());
    }

    /// Everything that the future of robot `i` depends on.
    pub fn save(&self, i: usize) -> Saved {
        Saved { checksum: self.plan.checksum, nominal: self.nominal[i].numbers(), drawn: self.drawn[i].clone() }
    }

    /// Takes what [`Randomized::save`] gave, of a robot that has the parameters `params`; the nominal ones pass `accept`.
    ///
    /// # Errors
    /// [`crate::Error::Decode`] if it is not that, and what `accept` finds; nothing has changed then.
    pub fn load(
        &mut self,
        i: usize,
        saved: &Saved,
        params: &Params,
        accept: impl FnOnce(&Params) -> Result<()>,
    ) -> Result<()> {
        if saved.checksum != self.plan.checksum || !saved.drawn.fits(&self.plan) {
            return Err(refused("its events differ".into()));
        }
        let nominal = Params::from_numbers(&saved.nominal).ok_or_else(|| refused("it lacks parameters".into()))?;
        if nominal != *self.nominal[i] {
            accept(&nominal)?;
        }
        self.plan.apply(&nominal, &saved.drawn.draws, &mut self.robot);
        if self.robot != *params {
            return Err(refused("its robot is not that of its draws".into()));
        }
        self.drawn[i] = saved.drawn.clone();
        self.drawn[i].find_next(&self.plan);
        self.nominal[i] = Arc::new(nominal);
        Ok(())
    }

    /// Makes robot `i` that of its draws; false, and nothing has changed, if the model refuses it.
    fn assign<R: Robots>(&mut self, robots: &mut R, i: usize) -> bool {
        self.plan.apply(&self.nominal[i], &self.drawn[i].draws, &mut self.robot);
        robots.set_params(i, &self.robot).is_ok()
    }

    /// The same; a robot that the model refuses, although all that was tried of the ranges passed, is the nominal one in
    /// this episode, and has no draws.
    fn assign_or_nominal<R: Robots>(&mut self, robots: &mut R, i: usize) {
        if self.assign(robots, i) {
            return;
        }
        self.drawn[i].draws.fill(f64::NAN);
        self.drawn[i].startup_due = true;
        robots.set_params(i, &self.nominal[i]).expect("the nominal robot was accepted");
    }
}
