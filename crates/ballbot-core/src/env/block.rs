//! Eight environments of the contact model in lanes: a whole control step, from actions to observations, in one go.

use super::balance::BalanceConfig;
use super::batch::Autoreset;
use super::environment::{Environment, Outcome, Parts, write_observation};
use super::group::{Group, GroupBuffers};
use super::judge::{Episode, Judge, Robot, Verdict};
use super::{ACTION_LEN, OBSERVATION_LEN};
use crate::error::Result;
use crate::lane_state::LaneState;
use crate::lanes::{EIGHT, Eight, Kernel, Lane, Scalar, Wide, run_eight, run_one};
use crate::sim::contact::{Constants, ContactMotion, Memory, advance, advance_wide};
use crate::state::State;
use fearless_simd::Simd;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// Up to eight environments. Each does what an [`Environment`] of its own would do, to the last bit.
pub struct Block {
    config: BalanceConfig,
    substeps: usize,
    judge: Judge,
    /// How many of the lanes are environments; the others stand still.
    used: usize,
    robots: Memory<Eight>,
    episodes: Episode<Eight>,
    verdicts: Verdict<Eight>,
    over: [bool; EIGHT],
    rngs: [ChaCha8Rng; EIGHT],
    /// Where robots are placed before they go to their lanes.
    motion: ContactMotion,
    /// One of the environments, when it is looked at by itself.
    single: Environment,
}

impl Block {
    /// Environments with seeds `seed`, `seed + 1`, ...; each must be reset before its first step.
    ///
    /// # Errors
    /// What [`Environment::new`] finds.
    pub fn new(config: &BalanceConfig, used: usize, seed: u64) -> Result<Self> {
        let single = Environment::new(config, seed)?;
        let motion = ContactMotion::new(&config.params, config.sim_dt);
        let mut robots = Memory::default();
        for i in 0..EIGHT {
            robots.set_lane(i, motion.memory());
        }
        Ok(Self {
            substeps: config.substeps()?,
            judge: Judge::new(config),
            used,
            robots,
            episodes: Episode::default(),
            verdicts: Verdict::default(),
            over: [true; EIGHT],
            rngs: std::array::from_fn(|i| ChaCha8Rng::seed_from_u64(seed.wrapping_add(i as u64))),
            motion,
            single,
            config: config.clone(),
        })
    }

    fn begin(&mut self, i: usize, start: &State) {
        let (viscous, dry) = (self.robots.joint_viscous_friction.0[i], self.robots.joint_coulomb_friction.0[i]);
        let memory = self.motion.memory_mut();
        (memory.joint_viscous_friction, memory.joint_coulomb_friction) = (viscous, dry);
        self.motion.place(start);
        self.robots.set_lane(i, self.motion.memory());
        let limit = self.config.max_episode_steps as f64;
        self.episodes.set_lane(i, &Episode { limit, ..Episode::default() });
        self.verdicts.set_lane(i, &Verdict::default());
        self.over[i] = false;
    }

    fn begin_at_random(&mut self, i: usize, observation: &mut [f32]) {
        let start = self.config.draw_start(&mut self.rngs[i]);
        self.begin(i, &start);
        self.observe(i, observation);
    }

    #[inline(always)]
    fn state(&self, i: usize) -> LaneState<f64> {
        let c = self.motion.constants();
        self.robots.lane(i).state(Scalar, c)
    }

    /// Keeps lanes that are no environment from falling.
    fn steady_unused(&mut self) {
        if self.used < EIGHT {
            self.motion.place(&State::upright(&self.config.params));
            for i in self.used..EIGHT {
                self.robots.set_lane(i, self.motion.memory());
            }
        }
    }

    /// Makes `single` the environment in lane `i`.
    fn load_single(&mut self, i: usize) {
        self.single.set_parts(Parts {
            model: crate::snapshot::encode(&self.robots.lane(i)),
            rng: self.rngs[i].clone(),
            episode: self.episodes.lane(i),
            over: self.over[i],
            verdict: self.verdicts.lane(i),
        });
    }
}

impl Group for Block {
    fn step(&mut self, autoreset: Autoreset, mut buffers: GroupBuffers<'_>) {
        self.steady_unused();
        let mut actions = [Eight::default(); ACTION_LEN];
        for (i, action) in buffers.actions.chunks_exact(ACTION_LEN).enumerate() {
            for (eight, value) in actions.iter_mut().zip(action) {
                eight.0[i] = f64::from(*value).clamp(-1.0, 1.0);
            }
        }
        run_eight(ControlStep {
            constants: self.motion.constants(),
            judge: &self.judge,
            max_wheel_torque: self.config.max_wheel_torque,
            substeps: self.substeps,
            actions: &actions,
            robots: &mut self.robots,
            episodes: &mut self.episodes,
            verdicts: &mut self.verdicts,
        });
        for i in 0..self.used {
            let row = i * OBSERVATION_LEN..(i + 1) * OBSERVATION_LEN;
            if autoreset == Autoreset::NextStep && self.over[i] {
                self.begin_at_random(i, &mut buffers.observations[row]);
                buffers.write(i, Outcome::default());
                continue;
            }
            let out = &mut buffers.observations[row.clone()];
            for (value, eight) in out.iter_mut().zip(&self.verdicts.observation) {
                *value = eight.0[i] as f32;
            }
            let v = &self.verdicts;
            let outcome = Outcome::new(v.reward.0[i], v.termination.0[i], v.truncated.0[i], v.success.0[i]);
            self.over[i] = outcome.done();
            buffers.write(i, outcome);
            if autoreset == Autoreset::SameStep && outcome.done() {
                let observation = &mut buffers.observations[row.clone()];
                buffers.final_observations[row].copy_from_slice(observation);
                self.begin_at_random(i, observation);
            }
        }
    }

    fn reset(&mut self, i: usize, start: Option<&State>, observation: &mut [f32]) -> Result<()> {
        match start {
            Some(start) => {
                self.accepts(start)?;
                self.begin(i, start);
                self.observe(i, observation);
            }
            None => self.begin_at_random(i, observation),
        }
        Ok(())
    }

    fn accepts(&self, start: &State) -> Result<()> {
        self.single.robot().accepts(start)
    }

    fn observe(&self, i: usize, observation: &mut [f32]) {
        let last_action = self.episodes.lane(i).last_action;
        let sensed = run_one(
            #[inline(always)]
            || self.judge.observe(&self.state(i), &last_action),
        );
        write_observation(&sensed, observation);
    }

    fn seed(&mut self, i: usize, seed: u64) {
        self.rngs[i] = ChaCha8Rng::seed_from_u64(seed);
    }

    fn shorten(&mut self, i: usize, steps: usize) {
        self.episodes.limit.0[i] = steps.clamp(1, self.config.max_episode_steps) as f64;
    }

    fn first_over(&self) -> Option<usize> {
        self.over[..self.used].iter().position(|&over| over)
    }

    fn begun(&self) -> bool {
        (0..self.used).any(|i| !self.over[i] || self.episodes.steps.0[i] > 0.0)
    }

    fn view(&mut self, i: usize) -> &Environment {
        self.load_single(i);
        &self.single
    }

    fn edit(&mut self, i: usize, change: &mut dyn FnMut(&mut Environment)) {
        self.load_single(i);
        change(&mut self.single);
        let parts = self.single.parts();
        let memory = crate::snapshot::decode("snapshot of a contact model", &parts.model);
        self.robots.set_lane(i, &memory.expect("the environment has just encoded it"));
        self.rngs[i] = parts.rng;
        self.episodes.set_lane(i, &parts.episode);
        self.over[i] = parts.over;
        self.verdicts.set_lane(i, &parts.verdict);
    }
}

/// What a control step reads and changes.
struct ControlStep<'a> {
    constants: &'a Constants,
    judge: &'a Judge,
    max_wheel_torque: f64,
    substeps: usize,
    actions: &'a [Eight; ACTION_LEN],
    robots: &'a mut Memory<Eight>,
    episodes: &'a mut Episode<Eight>,
    verdicts: &'a mut Verdict<Eight>,
}

impl Kernel for ControlStep<'_> {
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let [a, b, c] = self.actions;
        let actions = [Wide::load(simd, a), Wide::load(simd, b), Wide::load(simd, c)];
        let mut torques = [Eight::default(); ACTION_LEN];
        for (action, cell) in actions.into_iter().zip(&mut torques) {
            (action * self.max_wheel_torque).store(cell);
        }
        advance_wide(simd, self.constants, self.robots, &torques, self.substeps);
        conclude::<Wide<S>>(simd, self.constants, self.judge, self.robots, actions, self.episodes, self.verdicts);
    }

    fn run_one_by_one(self) {
        for i in 0..EIGHT {
            let mut robot = self.robots.lane(i);
            let (mut episode, mut verdict) = (self.episodes.lane(i), self.verdicts.lane(i));
            let action = [0, 1, 2].map(|k: usize| self.actions[k].0[i]);
            advance(self.constants, &mut robot, &action.map(|a| a * self.max_wheel_torque), self.substeps);
            conclude::<f64>(Scalar, self.constants, self.judge, &robot, action, &mut episode, &mut verdict);
            self.robots.set_lane(i, &robot);
            self.episodes.set_lane(i, &episode);
            self.verdicts.set_lane(i, &verdict);
        }
    }
}

#[inline(always)]
fn conclude<L: Lane>(
    token: L::Token,
    constants: &Constants,
    judge: &Judge,
    robots: &Memory<L::Cell>,
    actions: [L; ACTION_LEN],
    episodes: &mut Episode<L::Cell>,
    verdicts: &mut Verdict<L::Cell>,
) {
    let diverged = L::load(token, &robots.diverged);
    let robot = Robot {
        state: robots.state(token, constants),
        healthy: diverged.le(diverged.zero()),
        on_floor: diverged.zero().lt(L::load(token, &robots.bot_on_floor)),
    };
    judge.judge(token, &robot, actions, episodes, verdicts);
}
