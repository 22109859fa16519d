//! Numbers that environments keep from step to step, for one robot or eight.

use ballbot_base::lanes::{Cell, EIGHT, Eight, lane_struct};
use ballbot_base::wheels::Wheels;
use serde::{Deserialize, Serialize};

lane_struct! {
    /// The current episode, and the result of its last step.
    #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
    pub struct Episode<T> {
        pub steps: T,
        /// The step at which this episode is truncated.
        pub limit: T,
        pub last_action: Wheels<T>,
        /// As [`Integral`](crate::batch::integral::Integral) adds it to the observation.
        pub integral: [T; 2],
        /// The step from which a new command is due.
        pub next_command: T,
        pub reward: T,
        /// Center of the terrain tile, m; 0 without tiles.
        pub origin: [T; 2],
        /// Level of the tile.
        pub level: T,
        /// 0 if the episode continues, otherwise 1 + the index of the reason.
        pub termination: T,
        /// 1 if the episode reached its last step, else 0.
        pub truncated: T,
        /// 1 if the episode is a success if it ends here, else 0.
        pub success: T,
    }
}

/// An episode, with the numbers whose count depends on the task and its stages.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ledger<C> {
    pub episode: Episode<C>,
    pub task: Vec<C>,
    pub actuator: Vec<C>,
    pub sensor: Vec<C>,
    /// The sensor's numbers before its last reading.
    pub last_sensor: Vec<C>,
    /// The rows of the newest observation.
    pub observation: Vec<C>,
    pub terms: Vec<C>,
}

/// Largest magnitude of a saved number; f32 can hold it.
const MAX_NUMBER: f64 = 1e30;

/// Lengths of the parts of a [`Ledger`].
#[derive(Clone, Copy, Debug)]
pub struct Sizes {
    pub task: usize,
    pub actuator: usize,
    pub sensor: usize,
    pub observation: usize,
    pub terms: usize,
}

impl Sizes {
    /// Approximate count of numbers of a ledger.
    pub fn numbers(&self) -> usize {
        self.task + self.actuator + 2 * self.sensor + self.observation + self.terms
    }
}

impl<C: Cell> Ledger<C> {
    /// Zeros.
    pub fn new(sizes: Sizes) -> Self {
        let zeros = |n: usize| vec![C::default(); n];
        Self {
            episode: Episode::default(),
            task: zeros(sizes.task),
            actuator: zeros(sizes.actuator),
            sensor: zeros(sizes.sensor),
            last_sensor: zeros(sizes.sensor),
            observation: zeros(sizes.observation),
            terms: zeros(sizes.terms),
        }
    }

    fn parts(&self) -> [&[C]; 6] {
        [&self.task, &self.actuator, &self.sensor, &self.last_sensor, &self.observation, &self.terms]
    }

    fn parts_mut(&mut self) -> [&mut [C]; 6] {
        let Self { task, actuator, sensor, last_sensor, observation, terms, .. } = self;
        [task, actuator, sensor, last_sensor, observation, terms]
    }

    /// Whether a saved ledger may replace this ledger: same sizes, valid numbers.
    pub fn fits(&self, saved: &Ledger<f64>) -> bool {
        let Episode { steps, limit, last_action, integral, reward, origin, level, .. } = saved.episode;
        let mut numbers = saved
            .parts()
            .into_iter()
            .flatten()
            .chain(&last_action)
            .chain(&integral)
            .chain(&origin)
            .chain([&steps, &limit, &reward, &level]);
        // All of them are shown or squared without further checks.
        numbers.all(|number| number.abs() <= MAX_NUMBER)
            && self.parts().map(<[C]>::len) == saved.parts().map(<[f64]>::len)
    }
}

impl Ledger<f64> {
    /// Copies a ledger of the same sizes in place.
    fn copy_from(&mut self, other: &Self) {
        self.episode.clone_from(&other.episode);
        for (to, from) in self.parts_mut().into_iter().zip(other.parts()) {
            to.copy_from_slice(from);
        }
    }

    /// Zeros everywhere, for an episode of `limit` steps.
    pub fn begin(&mut self, limit: f64) {
        self.episode = Episode { limit, next_command: f64::INFINITY, ..Episode::default() };
        self.parts_mut().into_iter().for_each(|part| part.fill(0.0));
    }
}

/// Cells from which the numbers of one robot can be read, and to which they can be written back.
pub trait Ledgers: Cell + Sized {
    /// Copies the numbers of robot `i` to `one`, which has the same sizes.
    fn take(all: &Ledger<Self>, i: usize, one: &mut Ledger<f64>);

    /// Copies the numbers of robot `i` from `one`.
    fn put(all: &mut Ledger<Self>, i: usize, one: &Ledger<f64>);
}

impl Ledgers for f64 {
    fn take(all: &Ledger<f64>, _: usize, one: &mut Ledger<f64>) {
        one.copy_from(all);
    }

    fn put(all: &mut Ledger<f64>, _: usize, one: &Ledger<f64>) {
        all.copy_from(one);
    }
}

impl Ledgers for Eight {
    fn take(all: &Ledger<Eight>, i: usize, one: &mut Ledger<f64>) {
        debug_assert!(i < EIGHT);
        one.episode = all.episode.lane(i);
        for (to, from) in one.parts_mut().into_iter().zip(all.parts()) {
            to.iter_mut().zip(from).for_each(|(to, from)| *to = from.0[i]);
        }
    }

    fn put(all: &mut Ledger<Eight>, i: usize, one: &Ledger<f64>) {
        all.episode.set_lane(i, &one.episode);
        for (to, from) in all.parts_mut().into_iter().zip(one.parts()) {
            to.iter_mut().zip(from).for_each(|(to, from)| to.0[i] = *from);
        }
    }
}
