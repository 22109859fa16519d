//! Counts the floating-point operations of a step, so that their documentation stays true.

use ballbot_contact::{Actions, Delassus, Friction, JointFriction, Start, free_velocities, step};
use ballbot_core::lanes::{Lane, Scalar};
use ballbot_core::sim::ContactMotion;
use ballbot_core::{Model, Params, State, Wheels, attitude};
use nalgebra::{Vector2, Vector3};
use std::cell::RefCell;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// Flops of a step as documented: no joint friction, rolling without slip on the floor.
const DOCUMENTED: usize = 2059;

/// Allowed relative difference between the count and the documentation.
const TOLERANCE: f64 = 0.03;

/// Operations by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Operations {
    additions: usize,
    multiplications: usize,
    fused: usize,
    divisions: usize,
    roots: usize,
    /// Comparisons, selections, extrema and magnitudes; no flops by custom.
    choices: usize,
    /// Sign changes, which processors fold into what follows; no flops by custom.
    negations: usize,
}

impl Operations {
    /// A fused multiply-add counts as two.
    fn flops(&self) -> usize {
        self.additions + self.multiplications + 2 * self.fused + self.divisions + self.roots
    }
}

thread_local! {
    static DONE: RefCell<Operations> = RefCell::default();
}

// A step is one function of thousands of operations: inlined, the counting takes longer to compile than all tests.
#[inline(never)]
fn count(kind: impl FnOnce(&mut Operations) -> &mut usize) {
    DONE.with_borrow_mut(|done| *kind(done) += 1);
}

/// An `f64` that counts the operations on it.
#[derive(Clone, Copy)]
struct Counted(f64);

macro_rules! counted {
    ($trait:ident, $method:ident, $kind:ident) => {
        impl $trait for Counted {
            type Output = Self;
            fn $method(self, other: Self) -> Self {
                count(|done| &mut done.$kind);
                Self(self.0.$method(other.0))
            }
        }
        impl $trait<f64> for Counted {
            type Output = Self;
            fn $method(self, other: f64) -> Self {
                $trait::$method(self, Self(other))
            }
        }
    };
}
counted!(Add, add, additions);
counted!(Sub, sub, additions);
counted!(Mul, mul, multiplications);
counted!(Div, div, divisions);

impl Neg for Counted {
    type Output = Self;
    fn neg(self) -> Self {
        count(|done| &mut done.negations);
        Self(-self.0)
    }
}

impl AddAssign for Counted {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl SubAssign for Counted {
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl Lane for Counted {
    type Mask = bool;
    type Cell = f64;
    type Token = Scalar;

    fn load(_: Scalar, cell: &f64) -> Self {
        Self(*cell)
    }

    fn from_f64(_: Scalar, value: f64) -> Self {
        Self(value)
    }

    fn store(self, cell: &mut f64) {
        *cell = self.0;
    }

    fn splat(self, value: f64) -> Self {
        Self(value)
    }

    fn mul_add(self, factor: Self, term: Self) -> Self {
        count(|done| &mut done.fused);
        Self(f64::mul_add(self.0, factor.0, term.0))
    }

    fn sqrt(self) -> Self {
        count(|done| &mut done.roots);
        Self(self.0.sqrt())
    }

    fn abs(self) -> Self {
        count(|done| &mut done.choices);
        Self(self.0.abs())
    }

    fn max(self, other: Self) -> Self {
        count(|done| &mut done.choices);
        Self(Lane::max(self.0, other.0))
    }

    fn min(self, other: Self) -> Self {
        count(|done| &mut done.choices);
        Self(Lane::min(self.0, other.0))
    }

    fn lt(self, other: Self) -> bool {
        count(|done| &mut done.choices);
        self.0 < other.0
    }

    fn le(self, other: Self) -> bool {
        count(|done| &mut done.choices);
        self.0 <= other.0
    }

    fn select(mask: bool, yes: Self, no: Self) -> Self {
        count(|done| &mut done.choices);
        if mask { yes } else { no }
    }

    fn any(mask: bool) -> bool {
        mask
    }

    fn rarely<R>(_: Scalar, rare: impl FnOnce() -> R) -> R {
        rare()
    }
}

/// Torques of the motors, N·m.
const TORQUES: [f64; 3] = [0.02, -0.01, 0.01];

/// A robot that leans, rolls and turns.
fn moving(params: &Params) -> ContactMotion {
    let mut motion = ContactMotion::new(params, 0.002);
    let body = attitude(Vector2::new(0.03, -0.05), 0.6);
    motion.place(&State::rolling(params, Vector2::new(0.1, -0.05), 0.2, body, Vector3::new(0.2, -0.1, 0.3)));
    for _ in 0..50 {
        motion.advance(Wheels(TORQUES), 1);
    }
    motion
}

/// Operations of one step; the counted robot moves like the uncounted robot, to the last bit.
fn operations(params: &Params) -> Operations {
    let mut motion = moving(params);
    let mut memory = motion.memory().clone();
    motion.advance(Wheels(TORQUES), 1);
    DONE.set(Operations::default());
    let c = motion.constants();
    step::<Counted, f64, false>(c, Scalar, &mut memory, None, &Actions::new(c.gravity_dt, Wheels(TORQUES)));
    assert_eq!(&memory, motion.memory());
    DONE.take()
}

#[test]
fn operations_of_a_step_are_as_documented() {
    let params = Params::paper();
    let counted = operations(&params);
    println!("a step: {} flops, {counted:?}", counted.flops());
    let sticky = Params { wheel_viscous_friction: 1e-4, wheel_coulomb_friction: 1e-3, ..params };
    let with_joints = operations(&sticky);
    println!("with joint friction: {} flops, {with_joints:?}", with_joints.flops());
    assert!(with_joints.flops() > counted.flops());
    let error = counted.flops() as f64 / DOCUMENTED as f64 - 1.0;
    assert!(error.abs() < TOLERANCE, "{} flops a step, documented are {DOCUMENTED}", counted.flops());
}

#[test]
fn operations_of_a_sweep_are_as_counted_by_hand() {
    let motion = moving(&Params::paper());
    let (c, memory) = (motion.constants(), motion.memory());
    let start = Start::<Counted>::new::<false, f64>(c, Scalar, memory);
    let friction = Friction::new(c, &start.rows, &start.velocities);
    let joint_friction = JointFriction::new(c, start.rows.floor_gap);
    let free = free_velocities(c, Scalar, memory, &start, &Actions::new(c.gravity_dt, Wheels(TORQUES)));
    let mut residuals = start.rows.residuals::<false, f64>(c, &free);
    let mut impulses = memory.impulses(Scalar);
    let delassus = Delassus::new::<false, false>(c, &start.rows);
    DONE.set(Operations::default());
    let mut bearing = impulses.normals;
    delassus.sweep::<false>(&friction, &joint_friction, &mut bearing, &mut impulses, &mut residuals);
    let by_hand = Operations {
        // The change of each of nine impulses and of three loads that bound friction.
        additions: 9 + 3,
        // The limits of the floor's and the wheels' friction, and two squares to check whether the floor's limit is
        // reached.
        multiplications: 4 + 2,
        // Each row's own impulse, its effect on the rows it is coupled with, the floor's friction squared, and three
        // loads.
        fused: 9 + (3 * 7 + 3 * 9 + 3 * 9) + 1 + 3,
        divisions: 0,
        roots: 0,
        // Extrema of four normals and, twice, of three drives; whether the floor slips.
        choices: 4 + 2 * 3 + 1,
        // Of six residuals, of the floor's three factors and of three limits.
        negations: 6 + 3 + 3,
    };
    assert_eq!(DONE.take(), by_hand);
}
