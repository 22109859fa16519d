//! Motions of the ball on the floor.

use super::jet::Jet;
use super::spline::Spline;
use ballbot_base::error::{Error, Result, check};
use nalgebra::Vector2;
use std::f64::consts::TAU;

/// Motion of the ball, from rest at time 0.
#[derive(Clone, Debug, PartialEq)]
pub enum Motion {
    /// It stays.
    Hold {
        /// Position, m.
        position: [f64; 2],
    },
    /// Smoothly through points, at rest at the first and the last: between two points the polynomial of degree 9 that
    /// starts and ends with zero velocity, acceleration, jerk and snap.
    Path {
        /// Points, m; the motion starts at the first.
        points: Vec<[f64; 2]>,
        /// Time at each point, increasing from 0, s.
        times: Vec<f64>,
    },
    /// From point to point on straight lines, at rest at each point.
    Stops {
        /// Points, m; the motion starts at the first.
        points: Vec<[f64; 2]>,
        /// Time at each point, increasing from 0, s.
        times: Vec<f64>,
    },
    /// With velocities that change smoothly, from rest at the origin.
    Velocities {
        /// Velocities, m/s.
        velocities: Vec<[f64; 2]>,
        /// Start of each change, not decreasing, s.
        times: Vec<f64>,
        /// Duration of a change, s.
        change: f64,
    },
    /// Around (0, radius) from the origin, initially towards x.
    Circle {
        /// Radius, m.
        radius: f64,
        /// Period, s.
        period: f64,
        /// Time to reach full speed, s.
        start: f64,
    },
    /// x = a sin ωt, y = a sin ωt cos ωt.
    Lemniscate {
        /// a, m.
        size: f64,
        /// Period, s.
        period: f64,
        /// Time to reach full speed, s.
        start: f64,
    },
    /// Back and forth along x, with a sinusoidal lean.
    Attitude {
        /// Amplitude of the lean, rad.
        lean: f64,
        /// Frequency, Hz.
        frequency: f64,
        /// Time to reach the frequency, s.
        start: f64,
    },
}

/// Largest number of points or velocities; the cost of the spline grows with its cube.
const MAX_POINTS: usize = 200;

/// Largest time, s.
const MAX_TIME: f64 = 1e5;

/// The flat output z of a motion.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum FlatOutput {
    Hold(Vector2<f64>),
    Path(Vec<Spline>, Vec<f64>),
    Velocities {
        changes: Vec<(f64, Vector2<f64>)>,
        duration: f64,
    },
    /// x of the first harmonic, y of the second with its offset and phase.
    Periodic {
        sines: [Harmonic; 2],
        rate: f64,
        start: f64,
    },
}

/// a sin(n φ), or a (1 − cos(n φ)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Harmonic {
    amplitude: f64,
    number: f64,
    cosine: bool,
}

impl Harmonic {
    fn at(&self, phase: Jet) -> Jet {
        let (sin, cos) = (phase * self.number).sin_cos();
        if self.cosine { (Jet::constant(1.0) - cos) * self.amplitude } else { sin * self.amplitude }
    }
}

/// Time integral of the step 35 u⁴ − 84 u⁵ + 70 u⁶ − 20 u⁷, three derivatives of which are zero at both ends.
pub(super) fn ramped(t: f64, duration: f64) -> Jet {
    if t <= 0.0 {
        return Jet::default();
    }
    if t >= duration {
        return Jet::time(t) - Jet::constant(0.5 * duration);
    }
    let u = Jet::time(t) * duration.recip();
    u.polynomial(&[0.0, 0.0, 0.0, 0.0, 0.0, 7.0, -14.0, 10.0, -2.5]) * duration
}

impl Motion {
    /// The motion slowed down by a factor.
    pub(super) fn slowed(&self, factor: f64) -> Self {
        let mut slow = self.clone();
        match &mut slow {
            Self::Hold { .. } => (),
            Self::Path { times, .. } | Self::Stops { times, .. } => times.iter_mut().for_each(|t| *t *= factor),
            Self::Velocities { velocities, times, change } => {
                velocities.iter_mut().flatten().for_each(|v| *v /= factor);
                times.iter_mut().for_each(|t| *t *= factor);
                *change *= factor;
            }
            Self::Circle { period, start, .. } | Self::Lemniscate { period, start, .. } => {
                *period *= factor;
                *start *= factor;
            }
            // A lean at a lower frequency is not a slower motion: the lean itself is reduced.
            Self::Attitude { lean, .. } => *lean /= factor * factor,
        }
        slow
    }

    /// End of the motion, s; `None` if it does not end.
    pub fn duration(&self) -> Option<f64> {
        match self {
            Self::Path { times, .. } | Self::Stops { times, .. } => times.last().copied(),
            Self::Velocities { times, change, .. } => times.last().map(|t| t + change),
            _ => None,
        }
    }

    /// When the first turn at full speed of a circle or lemniscate ends, s; `None` for other motions.
    pub fn first_turn(&self) -> Option<f64> {
        match self {
            Self::Circle { period, start, .. } | Self::Lemniscate { period, start, .. } => Some(start + period),
            _ => None,
        }
    }

    /// The times, first and last, between which the ball accelerates, s; for a periodic motion, the start and one
    /// period.
    pub(super) fn pieces(&self) -> Vec<[f64; 2]> {
        match self {
            Self::Hold { .. } => Vec::new(),
            Self::Path { times, .. } | Self::Stops { times, .. } => {
                times.windows(2).map(|pair| [pair[0], pair[1]]).collect()
            }
            Self::Velocities { times, change, .. } => times.iter().map(|time| [*time, time + change]).collect(),
            Self::Circle { period, start, .. } | Self::Lemniscate { period, start, .. } => {
                vec![[0.0, *start], [*start, start + period]]
            }
            Self::Attitude { frequency, start, .. } => vec![[0.0, *start], [*start, start + frequency.recip()]],
        }
    }

    /// The flat output z whose ball position is z − `lag` z̈ (s²), for a robot that accelerates by `acceleration`
    /// (m/(s²·rad)) per lean.
    pub(super) fn flat_output(&self, lag: f64, acceleration: f64) -> Result<FlatOutput> {
        Ok(match self {
            Self::Hold { position } => {
                coordinates("position", position)?;
                FlatOutput::Hold((*position).into())
            }
            Self::Path { points, times } => {
                check_points(points, times)?;
                FlatOutput::Path(vec![Spline::new(&vectors(points), times, lag)?], Vec::new())
            }
            Self::Stops { points, times } => {
                check_points(points, times)?;
                let points = vectors(points);
                let legs = points.windows(2).zip(times.windows(2));
                let splines = legs.map(|(points, times)| Spline::new(points, times, lag)).collect::<Result<_>>()?;
                FlatOutput::Path(splines, times[1..].to_vec())
            }
            Self::Velocities { velocities, times, change } => {
                check_count("velocities", velocities.len(), 1)?;
                if times.len() != velocities.len() {
                    return Err(Error::Length { name: "times".into(), found: times.len(), expected: velocities.len() });
                }
                positive("change", *change)?;
                let mut before = 0.0;
                for &time in times {
                    check("times", time, format_args!("from {before} to {MAX_TIME} s"), |t| {
                        t >= before && t <= MAX_TIME
                    })?;
                    before = time;
                }
                let mut last = Vector2::zeros();
                let mut changes = Vec::new();
                for (velocity, &time) in velocities.iter().zip(times) {
                    coordinates("velocities", velocity)?;
                    let velocity = Vector2::from(*velocity);
                    changes.push((time, velocity - last));
                    last = velocity;
                }
                FlatOutput::Velocities { changes, duration: *change }
            }
            Self::Circle { radius, period, start } => {
                let rate = rate_of(*period, *start)?;
                length("radius", *radius)?;
                let amplitude = radius / (1.0 + lag * rate * rate);
                let harmonic = |cosine| Harmonic { amplitude, number: 1.0, cosine };
                FlatOutput::Periodic { sines: [harmonic(false), harmonic(true)], rate, start: *start }
            }
            Self::Lemniscate { size, period, start } => {
                let rate = rate_of(*period, *start)?;
                length("size", *size)?;
                let harmonic = |number: f64, amplitude: f64| Harmonic {
                    amplitude: amplitude / (1.0 + lag * (number * rate).powi(2)),
                    number,
                    cosine: false,
                };
                FlatOutput::Periodic { sines: [harmonic(1.0, *size), harmonic(2.0, 0.5 * size)], rate, start: *start }
            }
            Self::Attitude { lean, frequency, start } => {
                check("frequency", *frequency, "above 0 and at most 1000 Hz", |f| f > 0.0 && f <= 1e3)?;
                check("lean", *lean, "from 0 to 1 rad", |lean| (0.0..=1.0).contains(&lean))?;
                let rate = rate_of(frequency.recip(), *start)?;
                let sine = Harmonic { amplitude: -acceleration * lean / (rate * rate), number: 1.0, cosine: false };
                let still = Harmonic { amplitude: 0.0, ..sine };
                FlatOutput::Periodic { sines: [sine, still], rate, start: *start }
            }
        })
    }
}

impl FlatOutput {
    /// x and y at time t.
    pub(super) fn at(&self, t: f64) -> [Jet; 2] {
        match self {
            Self::Hold(position) => [Jet::constant(position.x), Jet::constant(position.y)],
            Self::Path(splines, ends) => {
                let leg = ends.partition_point(|end| *end <= t).min(splines.len() - 1);
                splines[leg].at(t)
            }
            Self::Velocities { changes, duration } => {
                let mut place = [Jet::default(); 2];
                for (time, change) in changes {
                    let way = ramped(t - time, *duration);
                    place = [place[0] + way * change.x, place[1] + way * change.y];
                }
                place
            }
            Self::Periodic { sines, rate, start } => {
                let phase = ramped(t, *start) * *rate;
                sines.map(|sine| sine.at(phase))
            }
        }
    }
}

fn vectors(points: &[[f64; 2]]) -> Vec<Vector2<f64>> {
    points.iter().copied().map(Vector2::from).collect()
}

fn coordinates(name: &str, values: &[f64; 2]) -> Result<()> {
    values.iter().try_for_each(|&value| check(name, value, "within ±1e4", |v| v.abs() <= 1e4).map(drop))
}

fn length(name: &str, value: f64) -> Result<()> {
    check(name, value, "above 0 and at most 1e4 m", |v| v > 0.0 && v <= 1e4).map(drop)
}

fn positive(name: &str, value: f64) -> Result<()> {
    check(name, value, format_args!("above 0 and at most {MAX_TIME} s"), |v| v > 0.0 && v <= MAX_TIME).map(drop)
}

fn check_count(name: &str, count: usize, least: usize) -> Result<()> {
    let limit = format_args!("from {least} to {MAX_POINTS}");
    check(format_args!("number of {name}"), count as f64, limit, |_| (least..=MAX_POINTS).contains(&count)).map(drop)
}

/// Angular rate of a period.
fn rate_of(period: f64, start: f64) -> Result<f64> {
    positive("period", period)?;
    positive("start", start)?;
    Ok(TAU / period)
}

fn check_points(points: &[[f64; 2]], times: &[f64]) -> Result<()> {
    check_count("points", points.len(), 2)?;
    if times.len() != points.len() {
        return Err(Error::Length { name: "times".into(), found: times.len(), expected: points.len() });
    }
    points.iter().try_for_each(|point| coordinates("points", point))?;
    check("times[0]", times[0], "0", |t| t == 0.0)?;
    for pair in times.windows(2) {
        let limit = format_args!("above {} and at most {MAX_TIME} s", pair[0]);
        check("times", pair[1], limit, |t| t > pair[0] && t <= MAX_TIME)?;
    }
    Ok(())
}
