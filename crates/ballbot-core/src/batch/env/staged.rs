//! The part of a control step that a stage of the caller takes.

use super::Environments;
use super::robots::Robots;
use crate::actuator::Actuator;
use crate::batch::autoreset::Autoreset;
use crate::batch::stage::{ChunkResults, ROBOT_ROW_LEN, saturated};
use crate::sensor::Sensor;
use crate::task::Task;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Cell, run_one};

/// Bound of the numbers of a row: all are finite in the observations of learners, too.
const BOUND: f64 = 1e9;

impl<R: Robots, T: Task, A: Actuator, S: Sensor> Environments<R, T, A, S> {
    /// Applies the results of a stage to all robots that have been stepped.
    pub fn apply(&mut self, autoreset: Autoreset, results: &ChunkResults<'_>) {
        let step = std::sync::Arc::clone(&self.step);
        let Some(stage) = &step.stage else { return };
        let layout = stage.0.layout();
        let (terms, rows) = (layout.terms.len(), layout.rows.len());
        let own_terms = self.ledger.terms.len() - terms;
        for i in 0..self.used {
            if self.is_reset_instead(autoreset, i) {
                continue;
            }
            let episode = &mut self.ledger.episode;
            let reason = episode.termination.get(i) as usize;
            // As for terms of the task: the terms of a diverged robot are zero.
            let has_diverged = reason == T::TERMINATIONS.len() + 1;
            let mut reward = episode.reward.get(i);
            for (k, term) in layout.terms.iter().enumerate() {
                let scale = if term.cost { -term.scale } else { term.scale };
                let value = if has_diverged { 0.0 } else { scale * results.terms[i * terms + k] };
                self.ledger.terms[own_terms + k].set(i, value);
                reward += value;
            }
            episode.reward.set(i, reward);
            let added = results.terminations[i] as usize;
            if reason == 0 && added > 0 {
                episode.termination.set(i, (T::TERMINATIONS.len() + 1 + added) as f64);
                episode.truncated.set(i, 0.0);
                episode.success.set(i, 0.0);
            }
            if layout.decides_success {
                episode.success.set(i, f64::from(u8::from(results.success[i] && reason == 0)));
            }
            self.put_newest_rows(i, &results.rows[i * rows..][..rows]);
        }
    }

    /// Writes the rows of a stage into the newest observation of robot `i`.
    pub fn put_newest_rows(&mut self, i: usize, values: &[f64]) {
        let Some(stage) = &self.step.stage else { return };
        let rows = &stage.0.layout().rows;
        let first = self.step.rows() - rows.len();
        for (cell, number) in
            self.ledger.observation[first..].iter_mut().zip(saturated(rows, self.step.scaling(), first, values))
        {
            cell.set(i, number);
        }
    }

    /// As [`super::chunk::Chunk::robot_rows`].
    pub fn write_robot_rows(&mut self, observed: bool, out: &mut [f32]) {
        let mut states = LaneState::<R::Cell>::default();
        if observed {
            self.read_measured(&mut states);
        } else {
            self.robots.read(&mut states);
        }
        for (i, row) in out.chunks_exact_mut(ROBOT_ROW_LEN).take(self.used).enumerate() {
            let state = states.lane(i);
            let (w, v) = (state.body_quaternion.w, state.body_quaternion.v);
            let up = run_one(
                #[inline(always)]
                || state.body_quaternion.rotation().rows[2],
            );
            let com = self.robots.params(i).body_com();
            let numbers = [-up.x, -up.y, -up.z]
                .into_iter()
                .chain(<[f64; 3]>::from(state.body_angular_velocity))
                .chain(state.wheel_speeds)
                .chain(state.wheel_angles)
                .chain(<[f64; 3]>::from(state.ball_position))
                .chain(<[f64; 3]>::from(state.ball_velocity))
                .chain(<[f64; 3]>::from(state.ball_angular_velocity))
                .chain([w, v.x, v.y, v.z])
                .chain(self.ledger.episode.last_action.map(|cell| cell.get(i)))
                .chain([com.x, com.y, com.z]);
            for (out, number) in row.iter_mut().zip(numbers) {
                *out = if number.is_nan() { 0.0 } else { number.clamp(-BOUND, BOUND) as f32 };
            }
        }
    }
}
