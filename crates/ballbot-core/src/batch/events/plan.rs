//! Executable events: names resolved, ranges expanded, keys assigned.

use super::effects::makes_friction_uneven;
use super::event::{Direction, Distribution, Event, FORCE, LOADS, Operation, PUSH, When, invalid_event};
use super::sampler::{Sampler, Source, bounds};
use super::setup::{Setup, Stages, Table};
use crate::robot::check_push;
use ballbot_base::error::{Error, Result, check, finite};
use ballbot_base::fields::Fields;
use ballbot_base::force::Force;
use ballbot_base::params::Params;
use nalgebra::Vector3;
use std::f64::consts::TAU;
use std::ops::Range;

/// Maximum number of events in a list.
const MAX_EVENTS: usize = 64;
/// Largest time of an event, s.
const MAX_TIME: f64 = 1e9;
/// Largest magnitude of a draw.
const MAX_DRAW: f64 = 1e12;
/// Columns of a push or a force: impulse (N·s; m/s with `scale`) or force (N; m/s²), azimuth, height.
const LOAD_WIDTH: usize = 3;

/// What an event changes.
#[derive(Clone, Debug)]
pub enum Target {
    /// The number at this index, and parameters that change in proportion to it.
    Field { table: Table, index: usize, followers: Vec<usize> },
    /// The body's momentum.
    Push,
    /// The external force on the body.
    Force,
}

/// One event.
#[derive(Clone, Debug)]
pub struct Planned {
    pub event: Event,
    /// Its index in the list of events.
    pub place: usize,
    pub target: Target,
    /// Key of its random numbers.
    id: u64,
    /// One pair per number of the term.
    ranges: Vec<[f64; 2]>,
    /// The time that draws are whole multiples of, s, if any.
    grain: Option<f64>,
    /// Control steps over which a push is spread.
    pub steps: u32,
    /// Time step of the model, s.
    sim_dt: f64,
    /// Its first column in the draws of a robot, and the number of columns.
    first: usize,
    pub width: usize,
}

/// All events of an environment.
#[derive(Clone, Debug)]
pub struct Plan {
    pub events: Vec<Planned>,
    /// Count of numbers in a robot's draws.
    pub width: usize,
    /// Whether any event has a time within the episode.
    pub timed: bool,
    pub control_dt: f64,
    /// Whether motors differ from robot to robot.
    pub individual_motors: bool,
    /// Whether sensors differ from robot to robot.
    pub individual_sensors: bool,
    /// Checksum of all events together; environments with equal checksums have the same events.
    pub checksum: u32,
}

impl Plan {
    /// Plans events, which may be invalid, for environments of a robot. Optional events of sensors are left out unless it
    /// `senses`, and of uneven friction unless it `slips`.
    ///
    /// # Errors
    /// [`crate::Error::Inconsistent`] with index and term of an event that is invalid for any robot.
    pub fn new(
        events: &[Event],
        params: &Params,
        [senses, slips]: [bool; 2],
        sim_dt: f64,
        control_dt: f64,
    ) -> Result<Self> {
        check("the number of events", events.len() as f64, format_args!("at most {MAX_EVENTS}"), |n| {
            n <= MAX_EVENTS as f64
        })?;
        let mut plan = Self {
            events: Vec::with_capacity(events.len()),
            width: 0,
            timed: false,
            control_dt,
            individual_motors: false,
            individual_sensors: false,
            checksum: 0,
        };
        let mut text = String::new();
        for (place, event) in events.iter().enumerate() {
            let event = &event.on_robot(place, params)?;
            let planned = Planned::new(event, place, plan.width, sim_dt, control_dt);
            let planned = planned.map_err(|e| invalid_event(place, &event.term, &e))?;
            let acts = (senses || !planned.changes_sensors()) && (slips || !makes_friction_uneven(&event.term));
            if event.optional && !acts {
                continue;
            }
            if let Some(same) = plan.events.iter().find(|p| p.id == planned.id) {
                let (key, other) = (planned.id, same.place);
                let reason = if same.event.term == event.term {
                    format!("events[{other}] is of the same term: give one of them another id (both have {key})")
                } else {
                    format!("events[{other}] ({}) has the same id, {key}: ids differ", same.event.term)
                };
                return Err(invalid_event(place, &event.term, &reason));
            }
            plan.width += planned.width;
            plan.timed |= event.when.is_timed();
            plan.individual_motors |= planned.changes_motors();
            plan.individual_sensors |= planned.changes_sensors();
            text.extend(event.entries().iter().map(|(key, value)| format!("{key} = {value}\n")));
            plan.events.push(planned);
        }
        plan.checksum = crc32fast::hash(text.as_bytes());
        Ok(plan)
    }

    /// Approximate memory of the events of a robot.
    pub fn bytes(&self) -> usize {
        (self.width + 2 * self.events.len()) * size_of::<f64>() + size_of::<Setup>()
    }

    /// Applies draws to the nominal robot, event by event in the order of the list.
    pub fn apply(&self, nominal: &Setup, draws: &[f64], robot: &mut Setup) {
        robot.clone_from(nominal);
        for event in &self.events {
            event.apply(&draws[event.columns()], robot);
        }
    }

    /// The smallest `max_wheel_torque` of any robot that the events produce from a robot with `nominal`, N·m.
    pub fn least_torque(&self, nominal: f64) -> f64 {
        let changes = self.events.iter().filter(|event| event.event.term == "max_wheel_torque");
        changes.fold(nominal, |least, event| {
            // There may be no draw yet.
            event.bounds().fold(least, |least, [low, _]| least.min(event.changed(least, low)))
        })
    }

    /// The largest value of each option of the stages of any robot that the events produce from a robot with `nominal`.
    pub fn largest_options(&self, nominal: &Setup) -> Stages {
        let mut largest = nominal.clone();
        for event in &self.events {
            let Target::Field { table: table @ (Table::Actuators | Table::Sensors), index, .. } = event.target else {
                continue;
            };
            for (value, [_, high]) in largest.values_mut(table, index).iter_mut().zip(event.bounds()) {
                // There may be no draw yet.
                *value = value.max(event.changed(*value, high));
            }
        }
        largest.stages
    }
}

/// Parameters that change in proportion to another parameter: moments of inertia to the mass of the same part, a static
/// coefficient of friction to the dynamic one of the same pair.
fn followers(term: &str) -> Vec<usize> {
    let (prefix, suffix) = if let Some(part) = term.strip_suffix("_mass") {
        (format!("{part}_"), "inertia")
    } else if let Some(pair) = term.strip_suffix("_dynamic_friction") {
        (format!("{pair}_static_friction"), "")
    } else {
        return Vec::new();
    };
    let follows = |name: &str| name.starts_with(&prefix) && name.ends_with(suffix);
    (0..Params::FIELDS.len()).filter(|&index| follows(Params::FIELDS[index].name)).collect()
}

impl Planned {
    /// Its columns in the draws of a robot.
    pub fn columns(&self) -> Range<usize> {
        self.first..self.first + self.width
    }

    fn new(event: &Event, place: usize, first: usize, sim_dt: f64, control_dt: f64) -> Result<Self> {
        let (target, width, grain) = if event.term == PUSH {
            (Target::Push, LOAD_WIDTH, None)
        } else if event.term == FORCE {
            (Target::Force, LOAD_WIDTH, None)
        } else {
            let (table, index) = Table::find(&event.term, &LOADS)?;
            let followers = if table == Table::Params { followers(&event.term) } else { Vec::new() };
            (
                Target::Field { table, index, followers },
                table.fields()[index].len,
                table.grain(index, sim_dt, control_dt),
            )
        };
        let id = event.id.unwrap_or_else(|| u64::from(crc32fast::hash(event.term.as_bytes())));
        let most = i64::MAX.unsigned_abs();
        check("id", id as f64, "from 1 to 2^63 - 1", |_| (1..=most).contains(&id))?;
        check_range(event, if event.is_load() { 1 } else { width })?;
        check_times(event, control_dt)?;
        if matches!(target, Target::Field { table: Table::Sensors, .. }) && event.when.is_timed() {
            return Err(Error::Inconsistent(
                "options of sensors do not change within an episode: its mode is 'startup' or 'reset'".into(),
            ));
        }
        check_direction(event)?;
        check_duration(event)?;
        let mut ranges = match event.range.as_slice() {
            [pair] => vec![*pair; width],
            pairs => pairs.to_vec(),
        };
        if let Some(grain) = grain {
            check_whole(event, grain)?;
            for range in &mut ranges {
                *range = whole(*range, grain)?;
            }
        }
        let steps = if event.term == PUSH { (event.duration / control_dt).round().max(1.0) as u32 } else { 1 };
        Ok(Self { event: event.clone(), place, target, id, ranges, grain, steps, sim_dt, first, width })
    }

    /// Whether it requires separate motors for each robot.
    fn changes_motors(&self) -> bool {
        match self.target {
            Target::Field { table: Table::Params, index, .. } => Params::FIELDS[index].name == "max_wheel_torque",
            Target::Field { table: Table::Actuators, .. } => true,
            Target::Field { table: Table::Sensors, .. } | Target::Push | Target::Force => false,
        }
    }

    /// Whether it requires separate sensors for each robot.
    fn changes_sensors(&self) -> bool {
        matches!(self.target, Target::Field { table: Table::Sensors, .. })
    }

    /// Seconds from the previous draw, or the start of the episode, to draw `count` of a repeated event.
    pub fn gap(&self, source: Source, count: u32) -> f64 {
        match self.event.when {
            When::Every(gap) => Sampler::new(source, self.id, count, 0).draw(Distribution::Uniform, gap),
            _ => f64::INFINITY,
        }
    }

    /// Samples the numbers of an event; `attempt` counts the draws that gave an invalid robot.
    pub fn draw(&self, source: Source, count: u32, attempt: u32, out: &mut [f64]) {
        let mut sampler = Sampler::new(source, self.id, count, attempt);
        // The first number belongs to the gap.
        sampler.unit();
        let distribution = self.event.distribution;
        match self.target {
            Target::Field { .. } => {
                let mut number = |range: [f64; 2]| match self.grain {
                    None => sampler.draw(distribution, range),
                    Some(grain) => sampler.draw_whole(range, grain),
                };
                if self.event.shared {
                    out.fill(number(self.ranges[0]));
                    return;
                }
                for (value, &range) in out.iter_mut().zip(&self.ranges) {
                    *value = number(range);
                }
            }
            Target::Push | Target::Force => {
                out[0] = sampler.draw(distribution, self.ranges[0]);
                let azimuth = TAU * sampler.unit();
                out[1] = match self.event.direction {
                    Direction::Uniform => azimuth,
                    Direction::Azimuth(given) => given,
                };
                out[2] = self.event.height.map_or(f64::NAN, |range| sampler.draw(Distribution::Uniform, range));
            }
        }
    }

    /// Smallest and largest draw of each number of a parameter.
    pub fn bounds(&self) -> impl Iterator<Item = [f64; 2]> {
        self.ranges.iter().map(|&range| bounds(self.event.distribution, range))
    }

    /// The columns of each separately sampled number, with its smallest and largest draw.
    pub fn numbers(&self) -> Vec<(Range<usize>, [f64; 2])> {
        let all = self.columns();
        if self.event.shared {
            return self.bounds().take(1).map(|range| (all.clone(), range)).collect();
        }
        all.zip(self.bounds()).map(|(column, range)| (column..column + 1, range)).collect()
    }

    /// Whether numbers may be a draw of the event, or mean that there is none.
    pub fn could_draw(&self, draws: &[f64]) -> bool {
        let within = |value: f64, [low, high]: [f64; 2]| (low..=high).contains(&value);
        if draws.iter().all(|value| value.is_nan()) {
            return true;
        }
        match self.target {
            Target::Field { .. } => {
                let one = !self.event.shared || draws.iter().all(|value| *value == draws[0]);
                one && draws.iter().zip(self.bounds()).all(|(&value, range)| within(value, range))
            }
            // It has already been applied.
            Target::Push | Target::Force => true,
        }
    }

    /// The possible draw nearest to a number within a range of the event.
    pub fn nearest(&self, value: f64) -> f64 {
        self.grain.map_or(value, |grain| (value / grain).round() * grain)
    }

    /// A number after a draw is applied.
    fn changed(&self, value: f64, draw: f64) -> f64 {
        match self.event.operation {
            Operation::Abs => draw,
            Operation::Add | Operation::AddScaled => value + draw,
            Operation::Scale => value * draw,
        }
    }

    /// Changes a number of a robot, and the numbers in proportion to it. Draws of NaN change nothing.
    fn apply(&self, draws: &[f64], robot: &mut Setup) {
        let Target::Field { table, index, followers } = &self.target else { return };
        if draws[0].is_nan() {
            return;
        }
        // The body alone stays the same: what an event loads on a robot is added to `body_*`.
        let loaded = match table {
            Table::Params => loaded_payload(Params::FIELDS[*index].name),
            _ => None,
        };
        let before = loaded.map(|payload| (payload, robot.params.clone()));
        let values = robot.values_mut(*table, *index);
        let old = values[0];
        for (value, &draw) in values.iter_mut().zip(draws) {
            *value = self.changed(*value, draw);
        }
        let new = values[0];
        if let Some((payload, before)) = before {
            let now = robot.params.payloads()[payload];
            robot.params = before.with_payload(payload, now.mass, now.position);
            return;
        }
        // Nothing is proportional to zero.
        if new == old || old == 0.0 {
            return;
        }
        for &follower in followers {
            for value in robot.params.values_mut(follower) {
                // In this order a ratio of at least 1 stays at least 1 despite rounding.
                *value = new * (*value / old);
            }
        }
    }

    /// Impulse or force (inertial frame, N·s or N) and point (body frame, m; the CoM if `None`) of a push or a force.
    pub fn load(&self, draws: &[f64], nominal: &Params) -> (Vector3<f64>, Option<Vector3<f64>>) {
        let size = match self.event.operation {
            Operation::Scale => draws[0] * nominal.body_mass,
            Operation::Abs | Operation::Add | Operation::AddScaled => draws[0],
        };
        let impulse = Vector3::new(draws[1].cos(), draws[1].sin(), 0.0) * size;
        (impulse, (!draws[2].is_nan()).then(|| Vector3::z() * draws[2]))
    }

    /// A force with these draws.
    pub fn force(&self, draws: &[f64], nominal: &Params) -> Force {
        let (force, point) = self.load(draws, nominal);
        let Event { frequency, duration, .. } = self.event;
        let duration = if duration == 0.0 { f64::INFINITY } else { duration };
        Force { frequency, duration, ..Force::constant(force, point) }
    }

    /// Checks the largest push or force on a robot.
    ///
    /// # Errors
    /// As [`crate::Ballbot::push`] and [`Force::validate`].
    pub fn check_load(&self, nominal: &Params) -> Result<()> {
        for [low, high] in self.bounds().take(1) {
            for size in [low, high] {
                let heights = self.event.height.unwrap_or([0.0; 2]);
                for height in heights {
                    let draws = [size, 0.0, height];
                    if let Target::Force = self.target {
                        self.force(&draws, nominal).validate(self.sim_dt)?;
                        continue;
                    }
                    let (impulse, point) = self.load(&draws, nominal);
                    check_push(&impulse, point.as_ref())?;
                }
            }
        }
        Ok(())
    }
}

/// Checks that an event on a time in whole steps samples whole steps.
fn check_whole(event: &Event, grain: f64) -> Result<()> {
    if event.operation == Operation::Scale || event.distribution != Distribution::Uniform {
        return Err(Error::Inconsistent(format!(
            "op = '{}', dist = '{}', but a time in whole steps of {grain} s has op 'abs' or 'add' and dist 'uniform'",
            event.operation.name(),
            event.distribution.name()
        )));
    }
    Ok(())
}

/// The smallest and largest whole multiple of a time within a range.
fn whole([low, high]: [f64; 2], grain: f64) -> Result<[f64; 2]> {
    // A multiple up to rounding counts.
    let margin = |value: f64| 1e-6 * (value / grain).abs().max(1.0);
    let (first, last) = ((low / grain - margin(low)).ceil(), (high / grain + margin(high)).floor());
    if first > last {
        return Err(Error::Inconsistent(format!("range = [{low}, {high}] has no whole number of steps of {grain} s")));
    }
    Ok([first * grain, last * grain])
}

/// Checks the pairs of an event with `width` numbers.
fn check_range(event: &Event, width: usize) -> Result<()> {
    if event.shared && event.range.len() != 1 {
        let found = event.range.len();
        return Err(Error::Inconsistent(format!("range has {found} pairs of numbers, a shared sample has one")));
    }
    if event.range.len() != 1 && event.range.len() != width {
        let expected = if width == 1 { "one".to_owned() } else { format!("one, or {width}") };
        return Err(Error::Inconsistent(format!(
            "range has {} pairs of numbers, expected {expected}",
            event.range.len()
        )));
    }
    for pair in &event.range {
        let [a, b] = *pair;
        finite("range", pair)?;
        match event.distribution {
            Distribution::Uniform | Distribution::LogUniform => {
                check("range[1]", b, format_args!("at least range[0] = {a}"), |b| b >= a)?;
            }
            Distribution::Normal => {
                check("range[1], the standard deviation,", b, ">= 0", |b| b >= 0.0)?;
            }
        }
        if event.distribution == Distribution::LogUniform {
            check("range[0]", a, "> 0 with dist 'log_uniform'", |a| a >= f64::MIN_POSITIVE)?;
        }
        for bound in bounds(event.distribution, *pair) {
            check("range", bound, format_args!("within ±{MAX_DRAW:e}"), |b| b.abs() <= MAX_DRAW)?;
            if event.operation == Operation::Scale {
                check("range", bound, ">= 0 with op 'scale'", |b| b >= 0.0)?;
            }
        }
    }
    Ok(())
}

/// Checks the times of an event.
fn check_times(event: &Event, control_dt: f64) -> Result<()> {
    match event.when {
        When::Startup | When::Reset if event.is_load() => {
            Err(Error::Inconsistent(format!("a {} has mode 'interval' or 'at'", event.term)))
        }
        When::Startup | When::Reset => Ok(()),
        When::At(time) => {
            check("at", time, format_args!("from 0 to {MAX_TIME:e} s"), |t| (0.0..=MAX_TIME).contains(&t))?;
            Ok(())
        }
        When::Every([low, high]) => {
            let least = control_dt * (1.0 - 1e-9);
            check("every[0]", low, format_args!("from control_dt = {control_dt} to {MAX_TIME:e} s"), |t| {
                (least..=MAX_TIME).contains(&t)
            })?;
            check("every[1]", high, format_args!("from every[0] = {low} to {MAX_TIME:e} s"), |t| {
                (low..=MAX_TIME).contains(&t)
            })?;
            Ok(())
        }
    }
}

/// Checks that a push or a force ends before the next one.
fn check_duration(event: &Event) -> Result<()> {
    let most = match event.when {
        When::Every([least, _]) => least,
        _ => MAX_TIME,
    };
    check(
        "duration",
        event.duration,
        format_args!("from 0 to {most} s, when the next {} may come", event.term),
        |t| (0.0..=most).contains(&t),
    )?;
    Ok(())
}

/// Checks the keys that only a push or a force has.
fn check_direction(event: &Event) -> Result<()> {
    if !event.is_load() {
        return Ok(());
    }
    if matches!(event.operation, Operation::Add | Operation::AddScaled) {
        let (absolute, scaled) = match event.term.as_str() {
            PUSH => ("an impulse, N·s", "a change of velocity, m/s"),
            _ => ("N", "an acceleration, m/s²"),
        };
        return Err(Error::Inconsistent(format!("op of a {} is 'abs' ({absolute}) or 'scale' ({scaled})", event.term)));
    }
    let [least, _] = bounds(event.distribution, event.range[0]);
    check("range", least, format_args!(">= 0: the direction of a {} is its azimuth", event.term), |b| b >= 0.0)?;
    if let Direction::Azimuth(azimuth) = event.direction {
        check("direction", azimuth, "within ±1e3 rad", |a| a.abs() <= 1e3)?;
    }
    if let Some([low, high]) = event.height {
        finite("height", &[low, high])?;
        check("height[1]", high, format_args!("at least height[0] = {low}"), |h| h >= low)?;
    }
    Ok(())
}

/// Index of the payload whose mass or place a parameter is.
fn loaded_payload(name: &str) -> Option<usize> {
    match name {
        "payload_mass" | "payload_position" => Some(0),
        "second_payload_mass" | "second_payload_position" => Some(1),
        _ => None,
    }
}
