//! Sampled motions of one robot in the contact model, eight side by side.

use super::horizon::{Horizon, Objective};
use crate::actuator::Ideal;
use crate::control::{Controller, LaneSetpoint, Lqr, TorqueLimits};
use ballbot_base::lane_state::{ConditionCells, LaneState};
use ballbot_base::lanes::{Draws, EIGHT, Eight, Kernel, Lane, Registers, Scalar, Wide, run_eight};
use ballbot_base::params::Params;
use ballbot_base::state::State;
use ballbot_base::wheels::{WHEELS, Wheels};
use ballbot_lanes::ContactLanes;
use std::sync::Arc;

/// Noise added to the torques.
pub(super) struct Noise {
    /// Seed, and number of the call.
    pub(super) key: [f64; 2],
    /// Standard deviation, N·m.
    pub(super) deviation: f64,
    pub(super) correlation: f64,
    /// Largest torque, N·m.
    pub(super) largest: f64,
}

/// Workspace for the samples of one call.
pub(super) struct Rollouts {
    /// Setpoints at each decision and at the end.
    pub(super) setpoints: Vec<LaneSetpoint<Eight>>,
    robots: ContactLanes,
    /// Time steps of the simulation from one decision to the next.
    substeps: usize,
    groups: usize,
    /// Noise of each group and decision.
    noise: Vec<Wheels<Eight>>,
    /// Cost of each sample.
    costs: Vec<f64>,
}

impl std::fmt::Debug for Rollouts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Rollouts").field("groups", &self.groups).field("decisions", &self.setpoints.len()).finish()
    }
}

impl Rollouts {
    pub(super) fn new(params: &Params, control_dt: f64, step: f64, groups: usize, decisions: usize) -> Self {
        let substeps = (control_dt / step - 1e-9).ceil().max(1.0) as usize;
        Self {
            setpoints: vec![LaneSetpoint::default(); decisions + 1],
            robots: ContactLanes::new(
                &Arc::new(params.on_still_floor().with_payloads_fixed()),
                control_dt / substeps as f64,
            ),
            substeps,
            groups,
            noise: vec![Wheels::default(); groups * decisions],
            costs: vec![0.0; groups * EIGHT],
        }
    }

    /// Simulates all samples from a state under a regulator and a plan with noise. The first sample has no noise, the
    /// second has no plan.
    pub(super) fn run(&mut self, horizon: &Horizon, state: &State, plan: &[f64], noise: &Noise) {
        let Horizon { base, limits, objective, .. } = horizon;
        let Self { setpoints, robots, substeps, groups, noise: kept, costs } = self;
        robots.place_lane(0, state);
        let start = robots.lane(0);
        let motor = Ideal { max_torque: 1.0 };
        let (last_setpoint, setpoints) = setpoints.split_last().expect("there is an end");
        let decisions = setpoints.len();
        for group in 0..*groups {
            (0..EIGHT).for_each(|i| robots.set_lane(i, &start));
            let (mut states, mut conditions) = (LaneState::default(), ConditionCells::default());
            let mut cost = Eight::default();
            let mut last = Wheels::default();
            for (decision, setpoint) in setpoints.iter().enumerate() {
                robots.read(&mut states, &mut conditions);
                let mut torques = base.torques_eight(&states, setpoint, noise.largest, &mut []);
                run_eight(Decide {
                    base,
                    limits,
                    objective,
                    noise,
                    plan: &plan[WHEELS * decision..][..WHEELS],
                    group,
                    decision,
                    states: &states,
                    setpoint,
                    last: &mut last,
                    torques: &mut torques,
                    cost: &mut cost,
                });
                kept[group * decisions + decision] = last;
                robots.drive_lanes(&motor, &torques, &mut [], &mut [], *substeps);
            }
            robots.read(&mut states, &mut conditions);
            run_eight(End { base, objective, states: &states, setpoint: last_setpoint, cost: &mut cost });
            for i in 0..EIGHT {
                let healthy = conditions.healthy.0[i] > 0.0;
                costs[group * EIGHT + i] = if healthy { cost.0[i] } else { f64::INFINITY };
            }
        }
    }

    /// Adds the mean of the noise to the plan, weighted by exp(−J / T) with T in units of the costs' standard deviation.
    pub(super) fn average(&self, temperature: f64, plan: &mut [f64]) {
        let finite = || self.costs.iter().copied().filter(|cost| cost.is_finite());
        let count = finite().count();
        if count < 2 {
            return;
        }
        let mean = finite().sum::<f64>() / count as f64;
        let deviation = (finite().map(|cost| (cost - mean) * (cost - mean)).sum::<f64>() / count as f64).sqrt();
        let least = finite().fold(f64::INFINITY, f64::min);
        let scale = temperature * deviation;
        if scale <= 0.0 || !scale.is_finite() {
            return;
        }
        let weight = |cost: f64| if cost.is_finite() { ((least - cost) / scale).exp() } else { 0.0 };
        let total: f64 = self.costs.iter().map(|cost| weight(*cost)).sum();
        let decisions = self.setpoints.len() - 1;
        for (sample, cost) in self.costs.iter().enumerate() {
            let share = weight(*cost) / total;
            if share == 0.0 {
                continue;
            }
            let (group, lane) = (sample / EIGHT, sample % EIGHT);
            for (decision, planned) in plan.chunks_exact_mut(WHEELS).enumerate() {
                let noise = &self.noise[group * decisions + decision];
                planned.iter_mut().zip(noise).for_each(|(planned, noise)| *planned += share * noise.0[lane]);
            }
        }
    }
}

/// One decision of eight samples: torques added to the regulator's torques, and the cost.
struct Decide<'a> {
    base: &'a Lqr,
    limits: &'a TorqueLimits,
    objective: &'a Objective,
    noise: &'a Noise,
    plan: &'a [f64],
    group: usize,
    decision: usize,
    states: &'a LaneState<Eight>,
    setpoint: &'a LaneSetpoint<Eight>,
    /// Noise of the previous decision, then of this decision.
    last: &'a mut Wheels<Eight>,
    torques: &'a mut Wheels<Eight>,
    cost: &'a mut Eight,
}

/// Number of each sample within its group.
const LANES: Eight = Eight([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);

/// Quantities of the samples in [`Decide`].
struct Samples<L> {
    state: LaneState<L>,
    setpoint: LaneSetpoint<L>,
    last: Wheels<L>,
    torques: Wheels<L>,
    cost: L,
    lane: L,
}

impl Decide<'_> {
    #[inline(always)]
    fn decide<L: Lane>(&self, token: L::Token, samples: &mut Samples<L>) {
        let Samples { state, setpoint, last, torques, cost, lane } = samples;
        let sample = *lane + (self.group * EIGHT) as f64;
        let seed = L::from_f64(token, self.noise.key[0]);
        let call = L::from_f64(token, self.noise.key[1]);
        let [a, b, c, _] = Draws::new(token, [seed, call], seed.zero(), sample).normals(self.decision as u32);
        // Stationary from the first decision on.
        let kept = if self.decision == 0 { 0.0 } else { self.noise.correlation };
        let fresh = self.noise.deviation * (1.0 - kept * kept).sqrt();
        for (wheel, normal) in [a, b, c].into_iter().enumerate() {
            let drawn = last[wheel] * kept + normal * fresh;
            let first = sample.lt(sample.splat(0.5));
            let second = !first & sample.lt(sample.splat(1.5));
            let no_plan = L::select(second, sample.splat(-self.plan[wheel]), drawn);
            let noise = L::select(first, sample.zero(), no_plan);
            last[wheel] = noise;
            torques[wheel] = torques[wheel] + noise + self.plan[wheel];
        }
        *torques = self.limits.apply(*torques, state, self.noise.largest).torques;
        let (x, reference) = self.base.lane_deviation(state, setpoint);
        let mut sum = *cost;
        for (value, weight) in x.iter().zip(&self.objective.states) {
            sum = value.squared().mul_add_all(*weight, sum);
        }
        for (torque, reference) in torques.iter().zip(reference) {
            sum = (*torque - reference).squared().mul_add_all(self.objective.torques, sum);
        }
        *cost = sum;
    }

    #[inline(always)]
    fn over_lanes<L: Lane<Cell = Eight>>(self, token: L::Token) {
        let mut samples = Samples::<L> {
            state: self.states.load(token),
            setpoint: self.setpoint.load(token),
            last: Wheels::load(token, self.last),
            torques: Wheels::load(token, self.torques),
            cost: L::load(token, self.cost),
            lane: L::load(token, &LANES),
        };
        self.decide(token, &mut samples);
        samples.last.store(self.last);
        samples.torques.store(self.torques);
        samples.cost.store(self.cost);
    }
}

impl Kernel for Decide<'_> {
    #[inline(always)]
    fn run<S: Registers>(self, simd: S) {
        self.over_lanes::<Wide<S>>(simd);
    }

    fn run_one_by_one(self) {
        for i in 0..EIGHT {
            let mut samples = Samples::<f64> {
                state: self.states.lane(i).load(Scalar),
                setpoint: self.setpoint.lane(i).load(Scalar),
                last: self.last.map(|cell| cell.0[i]),
                torques: self.torques.map(|cell| cell.0[i]),
                cost: self.cost.0[i],
                lane: LANES.0[i],
            };
            self.decide(Scalar, &mut samples);
            for wheel in 0..WHEELS {
                self.last[wheel].0[i] = samples.last[wheel];
                self.torques[wheel].0[i] = samples.torques[wheel];
            }
            self.cost.0[i] = samples.cost;
        }
    }
}

/// The end of eight samples: their cost-to-go.
struct End<'a> {
    base: &'a Lqr,
    objective: &'a Objective,
    states: &'a LaneState<Eight>,
    setpoint: &'a LaneSetpoint<Eight>,
    cost: &'a mut Eight,
}

impl End<'_> {
    #[inline(always)]
    fn to_go<L: Lane>(&self, state: &LaneState<L>, setpoint: &LaneSetpoint<L>) -> L {
        let (x, _) = self.base.lane_deviation(state, setpoint);
        let mut sum = x[0].zero();
        for (value, row) in x.iter().zip(&self.objective.to_go) {
            let mut product = sum.zero();
            for (other, weight) in x.iter().zip(row) {
                product = other.mul_add_all(*weight, product);
            }
            sum = value.mul_add(product, sum);
        }
        sum
    }
}

impl Kernel for End<'_> {
    #[inline(always)]
    fn run<S: Registers>(self, simd: S) {
        let cost = self.to_go::<Wide<S>>(&self.states.load(simd), &self.setpoint.load(simd));
        (cost + Wide::<S>::load(simd, self.cost)).store(self.cost);
    }

    fn run_one_by_one(self) {
        for i in 0..EIGHT {
            self.cost.0[i] += self.to_go::<f64>(&self.states.lane(i).load(Scalar), &self.setpoint.lane(i).load(Scalar));
        }
    }
}
