//! The description of a task as data: the source of spaces, bindings, help and documentation.

use super::{DIVERGED, Geometry, Metric, Row, RowScaling, Rows, Sensed, Step, Task, Term, Terms};
use ballbot_base::fields::{OptionDescription, describe_options};
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Memory, Scalar, Vec3};
use ballbot_base::params::Params;
use ballbot_base::state::State;
use ballbot_base::wheels::Wheels;

/// Description of a task.
#[derive(Clone, Debug, PartialEq)]
pub struct TaskDescription {
    /// As in [`Task`].
    pub name: &'static str,
    /// As in [`Task`].
    pub id: &'static str,
    /// As in [`Task`].
    pub summary: &'static str,
    /// As in [`Task`].
    pub max_episode_steps: usize,
    /// As in [`Task`].
    pub reward_threshold: Option<f64>,
    /// As in [`Task`].
    pub success: &'static str,
    /// Whether it has its own ground where none is chosen.
    pub has_terrain: bool,
    /// Options of the task itself.
    pub options: Vec<OptionDescription>,
    /// Parts of the command.
    pub command: &'static [Row],
    /// As in [`Task`].
    pub geometry: Option<Geometry>,
    /// Metrics of an episode.
    pub metrics: Vec<Metric>,
    /// Rows of the observation.
    pub rows: Vec<Row>,
    /// How the rows are scaled.
    pub scaling: RowScaling,
    /// Terms of the reward.
    pub terms: Vec<Term>,
    /// Reasons for termination with their conditions.
    pub terminations: Vec<(&'static str, &'static str)>,
}

/// Collects descriptions, and values that are not scaled.
#[derive(Default)]
struct Collected {
    rows: Vec<Row>,
    values: Vec<f64>,
    terms: Vec<Term>,
}

impl Rows<f64> for Collected {
    fn row(&mut self, row: Row, value: f64) {
        self.rows.push(row);
        self.values.push(value);
    }
}

impl Terms<f64> for Collected {
    fn term(&mut self, term: Term, _: f64) {
        self.terms.push(term);
    }
}

impl TaskDescription {
    /// Description of the task `T`: its rows and terms are read off an upright robot at rest.
    pub fn of<T: Task>() -> Self {
        let task = T::defaults();
        let mut memory = vec![0.0; T::MEMORY];
        let mut metrics = Vec::<Metric>::new();
        task.measure(&memory, 0.01, &mut metrics);
        let memory = Memory::<f64>::new(Scalar, &mut memory);
        let state = LaneState::from(&State::upright(&Params::paper()));
        let mut seen = Collected::default();
        task.observe(&Sensed { state: &state, last_action: Wheels::default() }, &memory, &mut seen);
        let step = Step {
            state: &state,
            up: Vec3::new(0.0, 0.0, 1.0),
            tilt: 0.0,
            on_floor: false,
            on_obstacle: false,
            lean: Vec3::new(0.0, 0.0, 0.0),
            action: Wheels::default(),
            last_action: Wheels::default(),
            terrain: None,
            control_dt: 0.01,
        };
        task.reward(&step, false, &memory, &mut seen);
        Self {
            name: T::NAME,
            id: T::ID,
            summary: T::SUMMARY,
            max_episode_steps: T::MAX_EPISODE_STEPS,
            reward_threshold: T::REWARD_THRESHOLD,
            success: T::SUCCESS,
            has_terrain: T::HAS_TERRAIN,
            command: T::COMMAND,
            geometry: T::GEOMETRY,
            metrics,
            options: describe_options::<T>(),
            scaling: RowScaling { rest: seen.values, gain: seen.rows.iter().map(|row| row.typical.recip()).collect() },
            rows: seen.rows,
            terms: seen.terms,
            terminations: T::TERMINATIONS
                .iter()
                .copied()
                .chain([(DIVERGED, "the state left the bounds of the simulation")])
                .collect(),
        }
    }
}
