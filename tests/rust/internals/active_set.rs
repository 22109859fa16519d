//! The impulses satisfy the contact conditions, and equal the result of an independent search.

use ballbot_contact::{
    Actions, Constants, ContactState, Delassus, Footing, Friction, Near, PerRow, Start, Velocities, advance,
    free_velocities,
};
use ballbot_core::lanes::{Scalar, Vec3};
use ballbot_core::sim::ContactMotion;
use ballbot_core::terrain::{Frame, Ground, Terrain, TerrainKind};
use ballbot_core::{Model, Params, State, Wheels};
use nalgebra::{DMatrix, DVector, Vector2, Vector3};
use std::sync::Arc;

const DT: f64 = 0.002;

/// Evenly distributed numbers: SplitMix64 (Steele, Lea and Flood, OOPSLA 2014, fig. 17).
struct Random(u64);

impl Random {
    fn within(&mut self, size: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        size * ((z >> 11) as f64 / (1_u64 << 52) as f64 - 1.0)
    }
}

/// A step of a robot: its start, and what its contacts must satisfy.
struct Step {
    start: Start<f64>,
    free: Velocities<f64>,
    friction: Friction<f64>,
}

impl Step {
    fn new(c: &Constants<f64>, state: &ContactState<f64>, torques: &[f64; 3]) -> Self {
        Self::under(c, state, &Actions::new(c.gravity_dt, Wheels(*torques)))
    }

    /// The step in the frame of the ground under the ball.
    fn on(c: &Constants<f64>, state: &ContactState<f64>, torques: &[f64; 3], ground: &Arc<Ground>) -> Self {
        let (mut footing, mut state) = (Footing::new(ground), state.clone());
        let mut actions = Actions::new(c.gravity_dt, Wheels(*torques));
        footing.enter::<f64, f64>(c, Scalar, &mut state, &mut actions);
        Self::under(c, &state, &actions)
    }

    fn under(c: &Constants<f64>, state: &ContactState<f64>, actions: &Actions<f64>) -> Self {
        let start = Start::<f64>::new::<false, f64>(c, Scalar, state);
        Self {
            free: free_velocities(c, Scalar, state, &start, actions),
            friction: Friction::new(c, &start.rows, &start.velocities),
            start,
        }
    }

    /// Residuals of the rows with impulses.
    fn residuals(&self, c: &Constants<f64>, impulses: &PerRow<f64>) -> PerRow<f64> {
        let mut velocities = self.free;
        self.start.rows.apply::<true, false, f64>(c, impulses, &mut velocities);
        self.start.rows.residuals::<false, f64>(c, &velocities)
    }

    /// Largest error of an impulse that satisfies its condition by itself, N·s; without joints.
    fn error(&self, c: &Constants<f64>, impulses: &PerRow<f64>) -> f64 {
        let r = self.residuals(c, impulses);
        let d = Delassus::<f64, f64>::new::<true, false>(c, &self.start.rows);
        let mut worst = 0.0_f64;
        for i in 0..3 {
            let (n, t) = (impulses.normals[i], impulses.drives[i]);
            worst = worst.max((n - (n - r.normals[i] * d.normal_inverse[i]).max(0.0)).abs());
            let limit = self.friction.wheels[i] * n;
            worst = worst.max((t - (t - r.drives[i] * d.drive_inverse[i]).clamp(-limit, limit)).abs());
        }
        let [z, x, y] = impulses.floor;
        worst = worst.max((z - (z - r.floor[0] * d.ball_mass).max(0.0)).abs());
        let pull =
            Vector2::new(x - r.floor[1] * d.floor_compliance_inverse, y - r.floor[2] * d.floor_compliance_inverse);
        let limit = self.friction.floor * z;
        let held = if pull.norm() > limit { pull * (limit / pull.norm()) } else { pull };
        worst.max((held - Vector2::new(x, y)).norm())
    }
}

fn impulses_of(state: &ContactState<f64>) -> PerRow<f64> {
    state.impulses::<f64>(Scalar)
}

fn random_start(params: &Params, rng: &mut Random) -> ContactState<f64> {
    let mut robot = ContactMotion::new(params, DT);
    let tilt = Vector2::new(rng.within(0.1), rng.within(0.1));
    robot.place(&State::tilted(params, tilt, rng.within(3.0)));
    robot.memory().clone()
}

/// Steps under random torques of the given size, with the ends of episodes of the balance task.
fn random_steps(params: &Params, size: f64, steps: usize, seed: u64, mut check: impl FnMut(&Step, &ContactState<f64>)) {
    let mut rng = Random(seed);
    let c = Constants::new(params, DT);
    let mut state = random_start(params, &mut rng);
    let mut torques = [0.0; 3];
    for k in 0..steps {
        if k % 5 == 0 {
            torques = [0; 3].map(|_| rng.within(size));
        }
        let step = Step::new(&c, &state, &torques);
        let near = Near::<f64>::new(&c, &step.start, Scalar, &state, None).mask;
        advance(&c, &mut state, None, Wheels(torques), 1);
        // The axes of the step are the principal axes of the body.
        let up = step.start.rotation.rows[2].dot(Vec3::from(c.mast));
        if near || up < 20_f64.to_radians().cos() {
            state = random_start(params, &mut rng);
            continue;
        }
        check(&step, &state);
    }
}

#[test]
fn impulses_meet_the_contact_conditions() {
    check_conditions(&Params::paper(), 100_000);
}

/// With 11.1, 8.5 and 11.4 N on its wheels in equilibrium.
#[test]
fn impulses_of_uneven_wheels_meet_the_contact_conditions() {
    let params = Params {
        body_com_offset: [0.02, -0.015],
        body_products_of_inertia: [4e-3, -6e-3, 3e-3],
        wheel_azimuths: [0.1, 2.0, 4.3],
        wheel_zenith_offsets: [0.1, -0.15, 0.05],
        ..Params::paper()
    };
    params.validate().expect("a robot that can exist");
    println!("{:?} N on the wheels", params.equilibrium_wheel_loads());
    check_conditions(&params, 25_000);
}

fn check_conditions(params: &Params, steps: usize) {
    for friction in [0.2, 0.5, 1.0, 1.65] {
        let params = Params {
            wheel_static_friction: friction,
            wheel_dynamic_friction: friction,
            floor_static_friction: friction,
            floor_dynamic_friction: friction,
            ..params.clone()
        };
        let c = Constants::new(&params, DT);
        let unit = c.static_wheel_load * DT;
        for (seed, size) in [0.1, 0.3, 0.6, 1.0].into_iter().enumerate() {
            let (mut worst, mut slips, mut open, mut searched, mut checked) = (0.0_f64, 0, 0, 0.0, 0);
            let mut last = 0.0;
            random_steps(&params, size, steps, seed as u64, |step, state| {
                let impulses = impulses_of(state);
                worst = worst.max(step.error(&c, &impulses) / unit);
                slips += usize::from((0..3).any(|i| impulses.drives[i].abs() >= friction * impulses.normals[i]));
                open += usize::from(impulses.normals.0.contains(&0.0));
                if state.searched_steps != last {
                    searched += 1.0;
                }
                last = state.searched_steps;
                checked += 1;
                assert_eq!(state.unsolved_steps, 0.0);
            });
            println!(
                "mu {friction}, {size} N·m: {checked} steps, {slips} with slip, {open} off the ball, {searched} searched, worst error {worst:.1e} N0"
            );
            assert!(worst < 1e-10, "mu {friction}, {size} N·m: {worst} of the static load");
            assert!(checked > steps / 2, "{checked} of {steps} steps are checked");
        }
    }
}

/// Robots that lean by up to 0.6 rad from the normal of the ground, under random torques.
#[test]
fn impulses_on_terrains_meet_the_contact_conditions() {
    for (k, kind) in TerrainKind::ALL.iter().enumerate() {
        let terrain = Arc::new(Terrain::generate(kind.name, 3, &[]).unwrap());
        for name in ["paper", "rezero", "kugle"] {
            let params = Params { wheel_coulomb_friction: 0.0, ..Params::preset(name).unwrap() };
            // A ball may be too large for the valleys of a kind.
            let Ok(ground) = Ground::new(&terrain, params.ball_radius).map(Arc::new) else { continue };
            let c = Constants::new(&params, DT);
            let unit = c.static_wheel_load * DT;
            let mut rng = Random(k as u64);
            let (mut worst, mut leans, mut steps) = (0.0_f64, 0.0_f64, 0);
            for _ in 0..40 {
                let mut robot = ContactMotion::new(&params, DT);
                robot.set_ground(Some(&ground)).unwrap();
                let tilt = Some(Vector2::new(rng.within(0.45), rng.within(0.45)));
                let start = ground.at_rest(&params, rng.within(1.5), rng.within(1.5), rng.within(3.0), tilt).unwrap();
                if robot.accepts(&start).is_err() {
                    continue;
                }
                robot.place(&start);
                let largest = 0.4 * c.static_wheel_load * params.wheel_radius;
                for _ in 0..50 {
                    let torques = [0; 3].map(|_| rng.within(largest));
                    let before = robot.memory().clone();
                    let step = Step::on(&c, &before, &torques, &ground);
                    robot.advance(Wheels(torques), 1);
                    let (_, normal) = ground.gap(&before.ball_position.into(), params.ball_radius);
                    let lean = robot.state().body_quaternion.transform_vector(&Vector3::z()).dot(&normal).acos();
                    if robot.bot_on_floor() || lean > 0.6 {
                        break;
                    }
                    let mut impulses = impulses_of(robot.memory());
                    let [z, x, y] = impulses.floor;
                    let turned = Frame::of_normal(Vec3::<f64>::from(<[f64; 3]>::from(normal)))
                        .rotation
                        .apply(Vec3::from([x, y, z]));
                    impulses.floor = [turned.z, turned.x, turned.y];
                    worst = worst.max(step.error(&c, &impulses) / unit);
                    leans = leans.max(lean);
                    steps += 1;
                }
            }
            println!("{}, {name}: {steps} steps, up to {leans:.2} rad, worst error {worst:.1e} N0", kind.name);
            assert!(worst < 1e-9, "{}, {name}: {worst} of the static load", kind.name);
            assert!(steps > 500 && leans > 0.4, "{}, {name}: {steps} steps, {leans} rad", kind.name);
        }
    }
}

/// The rows as a dense matrix in the order floor normal, x, y, normals, drives.
struct Dense {
    matrix: DMatrix<f64>,
    residuals: DVector<f64>,
    wheels: f64,
    floor: f64,
}

impl Dense {
    /// The matrix from the response to unit impulses.
    fn new(c: &Constants<f64>, step: &Step) -> Self {
        let flat = |rows: PerRow<f64>| DVector::from_iterator(9, [rows.floor, rows.normals.0, rows.drives.0].concat());
        let unit = |k: usize| {
            let one = |block: usize| [0, 1, 2].map(|i| if 3 * block + i == k { 1.0 } else { 0.0 });
            PerRow { floor: one(0), normals: Wheels(one(1)), drives: Wheels(one(2)), joints: Wheels::default() }
        };
        let none = unit(usize::MAX);
        let residuals = flat(step.residuals(c, &none));
        let columns: Vec<_> = (0..9).map(|k| flat(step.residuals(c, &unit(k))) - &residuals).collect();
        Self {
            matrix: DMatrix::from_columns(&columns),
            residuals,
            wheels: step.friction.wheels[0],
            floor: step.friction.floor,
        }
    }

    /// All solutions, by trying every combination of modes: for the wheels open, sticking and slipping both ways, for
    /// the floor open, sticking, and slipping along a direction that is iterated.
    fn solutions(&self, tolerance: f64) -> Vec<DVector<f64>> {
        let mut out: Vec<DVector<f64>> = Vec::new();
        for code in 0..4 * 4 * 4 * 3 {
            let wheels = [code % 4, code / 4 % 4, code / 16 % 4];
            let mut angle = None;
            let starts = if code / 64 == 2 { 8 } else { 1 };
            for start in 0..starts {
                if code / 64 == 2 {
                    angle = Some(std::f64::consts::TAU * f64::from(start) / 8.0);
                }
                let Some(found) = self.with_modes(wheels, code / 64, angle) else { continue };
                let known = |other: &DVector<f64>| (other - &found).amax() < 1e-6 * tolerance / 1e-12;
                if self.violation(&found) < tolerance && !out.iter().any(known) {
                    out.push(found);
                }
            }
        }
        out
    }

    fn with_modes(&self, wheels: [usize; 3], floor: usize, mut angle: Option<f64>) -> Option<DVector<f64>> {
        for _ in 0..200 {
            let (mut a, mut b) = (self.matrix.clone(), -self.residuals.clone());
            let mut law = |row: usize, load: Option<(usize, f64)>| {
                a.row_mut(row).fill(0.0);
                a[(row, row)] = 1.0;
                if let Some((normal, slope)) = load {
                    a[(row, normal)] = -slope;
                }
                b[row] = 0.0;
            };
            match (floor, angle) {
                (0, _) => (0..3).for_each(|row| law(row, None)),
                (_, Some(angle)) => {
                    law(1, Some((0, self.floor * angle.cos())));
                    law(2, Some((0, self.floor * angle.sin())));
                }
                _ => (),
            }
            for (i, mode) in wheels.into_iter().enumerate() {
                match mode {
                    0 => [3 + i, 6 + i].into_iter().for_each(|row| law(row, None)),
                    2 => law(6 + i, Some((3 + i, self.wheels))),
                    3 => law(6 + i, Some((3 + i, -self.wheels))),
                    _ => (),
                }
            }
            let found = a.lu().solve(&b)?;
            let Some(old) = angle else { return Some(found) };
            let slip = &self.residuals + &self.matrix * &found;
            let pull = [1, 2].map(|k| found[k] - slip[k] / self.matrix[(k, k)]);
            let new = pull[1].atan2(pull[0]);
            let turned = (new - old).sin().abs();
            angle = Some(new);
            if turned < 1e-14 {
                return Some(found);
            }
        }
        None
    }

    /// As [`Step::error`].
    fn violation(&self, impulses: &DVector<f64>) -> f64 {
        let r = &self.residuals + &self.matrix * impulses;
        let trial = |k: usize| impulses[k] - r[k] / self.matrix[(k, k)];
        let mut worst = (impulses[0] - trial(0).max(0.0)).abs();
        for i in 3..6 {
            worst = worst.max((impulses[i] - trial(i).max(0.0)).abs());
            let limit = self.wheels * impulses[i].max(0.0);
            worst = worst.max((impulses[i + 3] - trial(i + 3).clamp(-limit, limit)).abs());
        }
        let (pull, limit) = (Vector2::new(trial(1), trial(2)), self.floor * impulses[0].max(0.0));
        let held = if pull.norm() > limit { pull * (limit / pull.norm()) } else { pull };
        worst.max((held - Vector2::new(impulses[1], impulses[2])).norm())
    }
}

#[test]
fn impulses_match_a_search_through_all_modes() {
    let (mut compared, mut several) = (0, 0);
    for (seed, friction) in [0.2, 0.4, 0.6, 0.8, 1.0].into_iter().enumerate() {
        for floor in [0.1, friction] {
            let params = Params {
                wheel_static_friction: friction,
                wheel_dynamic_friction: friction,
                floor_static_friction: floor,
                floor_dynamic_friction: floor,
                ..Params::paper()
            };
            let c = Constants::new(&params, DT);
            let unit = params.static_wheel_load() * DT;
            let mut k = 0;
            let mut kinds = [0; 5];
            random_steps(&params, 1.0, 6000, seed as u64, |step, state| {
                k += 1;
                if k % 60 != 0 {
                    return;
                }
                let impulses = impulses_of(state);
                let found = DVector::from_iterator(9, [impulses.floor, impulses.normals.0, impulses.drives.0].concat());
                let solutions = Dense::new(&c, step).solutions(1e-9 * unit);
                let nearest = solutions.iter().map(|s| (s - &found).amax()).fold(f64::INFINITY, f64::min);
                assert!(nearest < 1e-8 * unit, "mu {friction}: {found} is none of {solutions:?}");
                compared += 1;
                several += usize::from(solutions.len() > 1);
                let slipping = (0..3).filter(|&i| found[6 + i].abs() >= friction * found[3 + i] - 1e-12).count();
                kinds[slipping] += 1;
                kinds[4] += usize::from(found[1].hypot(found[2]) >= floor * found[0] - 1e-12);
            });
            println!("mu {friction}, floor {floor}: 0, 1, 2, 3 wheels and the floor slip in {kinds:?}");
        }
    }
    println!("{compared} steps compared, {several} with several solutions");
    assert!(several * 50 < compared);
}

/// Modes of the wheels as in [`Dense::with_modes`]; `None` where the ball does not stick to the floor.
fn modes_of(impulses: &PerRow<f64>, friction: f64, floor: f64) -> Option<[usize; 3]> {
    let [z, x, y] = impulses.floor;
    (x.hypot(y) < floor * z).then(|| {
        [0, 1, 2].map(|i| match (impulses.normals[i], impulses.drives[i]) {
            (0.0, _) => 0,
            (normal, drive) if drive.abs() < friction * normal * (1.0 - 1e-9) => 1,
            (_, drive) => {
                if drive > 0.0 {
                    2
                } else {
                    3
                }
            }
        })
    })
}

/// With friction above 1 several modes may satisfy the conditions; a robot must not change its mode without a cause.
#[test]
fn modes_of_the_last_step_are_kept_while_they_are_valid() {
    let (friction, floor) = (1.65, 1.0);
    let params = Params {
        wheel_static_friction: friction,
        wheel_dynamic_friction: friction,
        floor_static_friction: floor,
        floor_dynamic_friction: floor,
        ..Params::paper()
    };
    let c = Constants::new(&params, DT);
    let unit = params.static_wheel_load() * DT;
    for (seed, size) in [0.4, 0.7, 1.0].into_iter().enumerate() {
        let (mut last, mut kept, mut changed) = (None, 0, 0);
        random_steps(&params, size, 20_000, seed as u64, |step, state| {
            let impulses = impulses_of(state);
            let before = if state.steps > 1.0 { last } else { None };
            last = modes_of(&impulses, friction, floor);
            let Some(before) = before else { return };
            let dense = Dense::new(&c, step);
            let Some(solution) = dense.with_modes(before, 1, None) else { return };
            if dense.violation(&solution) > 1e-12 * unit {
                changed += 1;
                return;
            }
            let found = DVector::from_iterator(9, [impulses.floor, impulses.normals.0, impulses.drives.0].concat());
            let apart = (&solution - &found).amax() / unit;
            assert!(apart < 1e-6, "{size} N·m: modes {before:?} are valid, but left for {last:?}: {apart} apart");
            kept += 1;
        });
        println!("{size} N·m: modes kept in {kept} steps, no longer valid in {changed}");
        assert!(kept > 1000 && changed > 10);
    }
}
