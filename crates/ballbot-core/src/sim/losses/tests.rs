//! Random rows of a system of fewer degrees of freedom: the impulses obey Coulomb's law, said without the solver's terms.

use super::rows::{load, partner};
use super::{Bounds, DRIVE, FLOOR, JOINT, NORMAL, Present, Problem, ROLLER, ROWS, TORQUE};

/// Degrees of freedom of ball, body and wheels.
const FREEDOMS: usize = 15;

/// Numbers within ±1 from a linear congruential generator (Knuth's MMIX constants).
#[derive(Clone)]
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// Rows with random directions. Loads press: the residual of a normal row approaches.
fn random(numbers: &mut Numbers, present: Present) -> Problem<f64> {
    let directions: [[f64; FREEDOMS]; ROWS] = std::array::from_fn(|row| {
        let own: [f64; FREEDOMS] = std::array::from_fn(|_| 0.15 * numbers.next());
        std::array::from_fn(|i| own[i] + f64::from(i == row % FREEDOMS))
    });
    let coupling = std::array::from_fn(|a| {
        std::array::from_fn(|b| directions[a].iter().zip(&directions[b]).map(|(x, y)| x * y).sum())
    });
    let residuals = std::array::from_fn(|row| {
        let speed = numbers.next();
        if load(row).is_some() || row < FLOOR { 0.3 * speed } else { 0.4 * speed - 0.6 }
    });
    let coefficient = |numbers: &mut Numbers| 0.3 + 0.3 * numbers.next();
    let bounds = Bounds {
        floor: coefficient(numbers),
        wheels: std::array::from_fn(|_| coefficient(numbers)),
        rollers: std::array::from_fn(|_| 0.2 * coefficient(numbers)),
        rolling: 0.2 * coefficient(numbers),
        spinning: 0.2 * coefficient(numbers),
        dry: 0.1 * coefficient(numbers),
        viscous: coefficient(numbers),
    };
    Problem::new(coupling, residuals, bounds, present, 1.0)
}

fn coefficient(bounds: &Bounds<f64>, row: usize) -> f64 {
    match row {
        2 => bounds.spinning,
        TORQUE..2 => bounds.rolling,
        ROLLER..JOINT => bounds.rollers[row - ROLLER],
        DRIVE..ROWS => bounds.wheels[row - DRIVE],
        _ => bounds.floor,
    }
}

/// Asserts that impulses meet the conditions of a problem. Returns whether a row slides.
fn assert_solved(problem: &Problem<f64>, impulses: &[f64; ROWS], case: usize) -> bool {
    const SMALL: f64 = 1e-8;
    let speeds = problem.speeds(impulses);
    let mut slides = false;
    for &row in problem.present.rows() {
        let (impulse, speed) = (impulses[row], speeds[row]);
        if (JOINT..FLOOR).contains(&row) {
            let dry = impulse + problem.bounds.viscous * speed;
            let held = speed.abs() <= SMALL && impulse.abs() <= problem.bounds.dry + SMALL;
            let moves = (dry.abs() - problem.bounds.dry).abs() <= SMALL && dry * speed <= SMALL;
            assert!(held || moves, "case {case}, joint {row}: impulse {impulse}, speed {speed}");
            slides |= !held;
        } else if let Some(normal) = load(row) {
            let limit = coefficient(&problem.bounds, row) * impulses[normal];
            let (other, drift) = partner(row).map_or((0.0, 0.0), |other| (impulses[other], speeds[other]));
            let (size, fast) = (impulse.hypot(other), speed.hypot(drift));
            assert!(size <= limit + SMALL, "case {case}, row {row}: {size} N·s, limit {limit}");
            // What slides has the whole friction, against its motion.
            let work = impulse * speed + other * drift;
            assert!((work + limit * fast).abs() <= SMALL, "case {case}, row {row}: work {work}, limit {limit}");
            slides |= fast > SMALL;
        } else {
            let met = impulse >= 0.0 && speed >= -SMALL && (impulse * speed).abs() <= SMALL;
            assert!(met, "case {case}, normal {row}: impulse {impulse}, speed {speed}");
        }
    }
    slides
}

#[test]
fn impulses_obey_coulombs_law() {
    let mut numbers = Numbers(1);
    let (mut sliding, mut unsolved, mut sticking) = (0, 0, 0);
    for case in 0..3000 {
        let present = Present::new(case % 3 != 1, case % 3 != 2, case % 2 == 0);
        let problem = random(&mut numbers, present);
        let solution = problem.solution(&[0.0; ROWS], true);
        if solution.unsolved {
            unsolved += 1;
        } else if assert_solved(&problem, &solution.impulses, case) {
            sliding += 1;
        } else {
            sticking += 1;
        }
    }
    println!("{sliding} with slip, {sticking} without, {unsolved} unsolved");
    assert!(sliding > 1000 && unsolved <= 30, "{sliding} with slip, {unsolved} unsolved of 3000");
}

/// Nothing drives the rows and all friction is large: more rows are at rest than there are degrees of freedom.
#[test]
fn more_rows_at_rest_than_degrees_of_freedom_are_solved() {
    let mut numbers = Numbers(2);
    for case in 0..300 {
        let mut problem = random(&mut numbers, Present::new(true, true, true));
        problem.bounds = Bounds {
            floor: 10.0,
            wheels: [10.0; 3],
            rollers: [10.0; 3],
            rolling: 10.0,
            spinning: 10.0,
            dry: 10.0,
            viscous: 0.1,
        };
        // Speeds that some motion of the system has: those that these impulses take away.
        let push: [f64; ROWS] = std::array::from_fn(|row| {
            let loaded = row == FLOOR || (NORMAL..DRIVE).contains(&row);
            if loaded { 0.5 + 0.1 * numbers.next() } else { 1e-3 * numbers.next() }
        });
        problem.residuals =
            std::array::from_fn(|row| problem.coupling[row].iter().zip(&push).map(|(w, push)| -w * push).sum::<f64>());
        let solution = problem.solution(&[0.0; ROWS], true);
        assert!(!solution.unsolved, "case {case}");
        assert_solved(&problem, &solution.impulses, case);
    }
}

/// A robot without some friction has the bits that it has beside one with it.
#[test]
fn absent_rows_change_no_bit() {
    let mut numbers = Numbers(3);
    for case in 0..300 {
        let same = numbers.clone();
        let mut few = random(&mut numbers, Present::new(case % 2 == 0, case % 2 == 1, false));
        let mut all = random(&mut same.clone(), Present::new(true, true, true));
        for bounds in [&mut few.bounds, &mut all.bounds] {
            (bounds.dry, bounds.viscous) = (0.0, 0.0);
            if case % 2 == 0 {
                bounds.rollers = [0.0; 3];
            } else {
                (bounds.rolling, bounds.spinning) = (0.0, 0.0);
            }
        }
        let [few, all] = [few, all].map(|problem| problem.solution(&[0.0; ROWS], true).impulses);
        assert_eq!(few, all, "case {case}");
    }
}
