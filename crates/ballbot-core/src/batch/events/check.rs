//! Checks that every robot that the events may produce is valid.
//!
//! The limits of parameters are linear in them, convex or monotone in each, and most involve no more than three terms:
//! such limits hold for all draws if they hold at the corners of the ranges of any three events. Draws of all events
//! together, at corners and inside, are also tried. An invalid robot may still slip through, because the loads of the
//! wheels depend on five terms; it is sampled again when it occurs.

use super::event::{When, invalid_event};
use super::plan::{Plan, Planned, Target};
use super::setup::Setup;
use ballbot_base::error::{Error, Result};
use ballbot_base::interrupt::Watch;
use ballbot_base::model::same_geometry;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use std::ops::Range;

/// Number of draws of one event, and of all together, that are tried in addition to the corners.
const TRIALS: usize = 64;

/// Tests that a robot changed by events must pass.
pub struct Tests<'a> {
    /// Tests of its numbers only.
    pub robot: &'a dyn Fn(&Setup) -> Result<()>,
    /// Tests of its model and of where the task may place it; expensive.
    pub starts: &'a dyn Fn(&Setup) -> Result<()>,
}

/// Smallest and largest draw of each number of one event, with its columns.
struct Ranges {
    /// Index of the event in the plan.
    place: usize,
    numbers: Vec<(Range<usize>, [f64; 2])>,
}

impl Ranges {
    fn corners(&self) -> usize {
        1 << self.numbers.len()
    }

    /// Writes the draws of a corner.
    fn write(&self, corner: usize, draws: &mut [f64]) {
        for (bit, (columns, range)) in self.numbers.iter().enumerate() {
            draws[columns.clone()].fill(range[corner >> bit & 1]);
        }
    }

    fn clear(&self, draws: &mut [f64]) {
        self.numbers.iter().for_each(|(columns, _)| draws[columns.clone()].fill(f64::NAN));
    }
}

impl Plan {
    /// Checks that every robot that the events may produce from a nominal robot passes, and that the events fit it.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] with indices and terms of the events that do not; [`Error::Interrupted`] in
    /// [`crate::stoppable`].
    pub fn check(&self, nominal: &Setup, tests: &Tests<'_>) -> Result<()> {
        let mut ranges = Vec::new();
        for (place, event) in self.events.iter().enumerate() {
            match event.target {
                Target::Push | Target::Force => {
                    event.check_load(&nominal.params).map_err(|e| invalid_event(event.place, &event.event.term, &e))?;
                }
                Target::Field { .. } => ranges.push(Ranges { place, numbers: event.numbers() }),
            }
        }
        let mut trial = Trial {
            plan: self,
            nominal,
            tests,
            draws: vec![f64::NAN; self.width],
            robot: nominal.clone(),
            watch: Watch::new(),
        };
        // Smallest sets first: an error then names no more terms than needed.
        for one in &ranges {
            trial.corners(&[one], true)?;
            trial.geometry(one)?;
            trial.inside(std::slice::from_ref(one))?;
        }
        for (i, one) in ranges.iter().enumerate() {
            for two in &ranges[i + 1..] {
                trial.corners(&[one, two], true)?;
            }
        }
        for (i, one) in ranges.iter().enumerate() {
            for (j, two) in ranges.iter().enumerate().skip(i + 1) {
                for three in &ranges[j + 1..] {
                    trial.corners(&[one, two, three], false)?;
                }
            }
        }
        trial.inside(&ranges)
    }
}

struct Trial<'a> {
    plan: &'a Plan,
    nominal: &'a Setup,
    tests: &'a Tests<'a>,
    draws: Vec<f64>,
    robot: Setup,
    watch: Watch,
}

impl Trial<'_> {
    /// All corners of the ranges of some events; the other events have no effect.
    fn corners(&mut self, chosen: &[&Ranges], starts: bool) -> Result<()> {
        let total: usize = chosen.iter().map(|ranges| ranges.corners()).product();
        for corner in 0..total {
            self.watch.check()?;
            let mut rest = corner;
            for ranges in chosen {
                ranges.write(rest % ranges.corners(), &mut self.draws);
                rest /= ranges.corners();
            }
            let places = || chosen.iter().map(|ranges| ranges.place).collect::<Vec<_>>();
            self.run(starts).map_err(|error| self.blame(&places(), &error))?;
        }
        chosen.iter().for_each(|ranges| ranges.clear(&mut self.draws));
        Ok(())
    }

    /// Draws of some events together, each at a corner of its range or inside.
    fn inside(&mut self, chosen: &[Ranges]) -> Result<()> {
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        for _ in 0..if chosen.is_empty() { 0 } else { TRIALS } {
            for ranges in chosen {
                let event = &self.plan.events[ranges.place];
                for (columns, [low, high]) in &ranges.numbers {
                    let share = (1.5 * rng.random::<f64>() - 0.25).clamp(0.0, 1.0);
                    let draw = event.nearest(low + (high - low) * share).clamp(*low, *high);
                    self.draws[columns.clone()].fill(draw);
                }
            }
            let places = || chosen.iter().map(|ranges| ranges.place).collect::<Vec<_>>();
            self.run(false).map_err(|error| self.blame(&places(), &error))?;
        }
        chosen.iter().for_each(|ranges| ranges.clear(&mut self.draws));
        Ok(())
    }

    fn run(&mut self, starts: bool) -> Result<()> {
        self.plan.apply(self.nominal, &self.draws, &mut self.robot);
        if self.robot == *self.nominal {
            return Ok(());
        }
        (self.tests.robot)(&self.robot)?;
        if starts { (self.tests.starts)(&self.robot) } else { Ok(()) }
    }

    /// Checks that an event within the episode does not change the robot's shape.
    fn geometry(&mut self, ranges: &Ranges) -> Result<()> {
        let Planned { event, place, .. } = &self.plan.events[ranges.place];
        if matches!(event.when, When::Startup | When::Reset) {
            return Ok(());
        }
        for corner in 0..ranges.corners() {
            ranges.write(corner, &mut self.draws);
            self.plan.apply(self.nominal, &self.draws, &mut self.robot);
            if !same_geometry(&self.nominal.params, &self.robot.params) {
                let reason = "the robot's shape does not change within an episode: its mode is 'startup' or 'reset'";
                return Err(invalid_event(*place, &event.term, &reason));
            }
        }
        ranges.clear(&mut self.draws);
        Ok(())
    }

    /// The error for the current draws of events.
    fn blame(&self, places: &[usize], error: &Error) -> Error {
        let [first, others @ ..] = places else { return Error::Inconsistent(error.to_string()) };
        let of = |index: usize| (self.plan.events[index].place, self.plan.events[index].event.term.as_str());
        let together: Vec<_> = others
            .iter()
            .map(|&index| {
                let (place, term) = of(index);
                format!("events[{place}] ({term})")
            })
            .collect();
        let with = if together.is_empty() { String::new() } else { format!("with {}, ", together.join(", ")) };
        let (place, term) = of(*first);
        invalid_event(place, term, &format!("{with}its range contains an invalid robot: {error}"))
    }
}
