//! Numbers with derivatives against closed forms.

use ballbot_base::lanes::{
    Cell, Directions, Dual, DualCell, Kernel, Lane, Registers, SIXTEEN, Scalar, Sixteen, Slopes, exp_of_negative,
    floor, run_eight, sin_cos, tanh, wrapped_angle,
};

/// A value, and a function with its slope there.
type Case<D> = (f64, fn(D) -> D, f64);

/// A number whose derivative along direction i is i.
fn number<D: Lane<Cell = DualCell<C>>, C: Copy>(token: D::Token, value: f64, derivatives: C) -> D {
    D::load(token, &DualCell { value, derivatives })
}

fn cases<D: Lane>() -> Vec<Case<D>> {
    vec![
        (0.7, |x| x * x, 1.4),
        (0.7, |x| x.squared() + x, 2.4),
        (0.7, |x| x.splat(2.0) / x, -2.0 / 0.49),
        (0.7, |x| x.mul_add(x, x), 2.4),
        (0.7, |x| x.neg_mul_add(x, x), -0.4),
        (0.7, |x| -(x * 3.0 - 1.0) / 2.0, -1.5),
        (2.25, Lane::sqrt, 1.0 / 3.0),
        (0.0, Lane::sqrt, 0.0),
        (-0.3, Lane::abs, -1.0),
        (-0.3, |x| x.max(x.zero()), 0.0),
        (-0.3, |x| x.min(x.zero()), 1.0),
        (-0.3, |x| D::select(x.lt(x.zero()), x * 5.0, x), 5.0),
        (3.7, floor, 0.0),
        (7.0, wrapped_angle, 1.0),
        (7.0, |x| sin_cos(x).0, 7.0_f64.cos()),
        (7.0, |x| sin_cos(x).1, -7.0_f64.sin()),
        (0.4, tanh, 1.0 - 0.4_f64.tanh().powi(2)),
        (0.4, exp_of_negative, -(-0.4_f64).exp()),
        (0.4, |x| x.with_value(x.splat(9.0)), 1.0),
    ]
}

struct Check;

impl Kernel for Check {
    #[inline(always)]
    fn run<S: Registers>(self, simd: S) {
        check::<Directions<S>>(simd);
    }

    fn run_one_by_one(self) {}
}

fn check<D: Slopes<Cell = Sixteen>>(token: D::Token) {
    let mut directions = Sixteen::default();
    (0..SIXTEEN).for_each(|i| directions.set(i, i as f64));
    for (k, (at, function, slope)) in cases::<Dual<D>>().into_iter().enumerate() {
        let mut cell = DualCell::default();
        function(number(token, at, directions)).store(&mut cell);
        for i in 0..SIXTEEN {
            let (derivative, expected) = (cell.derivatives.get(i), slope * i as f64);
            assert!((derivative - expected).abs() <= 1e-11 * (1.0 + expected.abs()), "case {k}: {derivative}");
        }
    }
}

#[test]
fn derivatives_equal_closed_forms() {
    run_eight(Check);
    for (k, (at, function, slope)) in cases::<Dual<f64>>().into_iter().enumerate() {
        let mut cell = DualCell::default();
        function(number(Scalar, at, 1.0)).store(&mut cell);
        assert!((cell.derivatives - slope).abs() <= 1e-11, "case {k}: {} is not {slope}", cell.derivatives);
    }
}

#[test]
fn values_have_the_bits_of_plain_numbers() {
    for ((at, function, _), (_, plain, _)) in cases::<Dual<f64>>().into_iter().zip(cases::<f64>()) {
        let mut cell = DualCell::default();
        function(number(Scalar, at, 1.0)).store(&mut cell);
        assert_eq!(cell.value.to_bits(), plain(at).to_bits());
    }
}
