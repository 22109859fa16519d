//! Lanes against std and nalgebra, and wide against scalar.

use ballbot_core::lanes::*;
use fearless_simd::{Level, Simd};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// Runs `f` over eight numbers at a time with every instruction set of this machine.
macro_rules! wide {
    ($values:expr, |$x:ident| $result:expr) => {{
        let mut results = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            if let Some(simd) = Level::new().as_avx512() {
                results.push(wide!(simd, $values, |$x| $result));
            }
            if let Some(simd) = Level::new().as_avx2() {
                results.push(wide!(simd, $values, |$x| $result));
            }
        }
        #[cfg(target_arch = "aarch64")]
        if let Some(simd) = Level::new().as_neon() {
            results.push(wide!(simd, $values, |$x| $result));
        }
        results
    }};
    ($simd:expr, $values:expr, |$x:ident| $result:expr) => {{
        let simd = $simd;
        simd.vectorize(
            #[inline(always)]
            || {
                let mut out = Vec::new();
                for chunk in $values.chunks_exact(EIGHT) {
                    let cells = Eight(chunk.try_into().expect("eight"));
                    let $x = load(simd, &cells);
                    let mut result = Eight::default();
                    $result.store(&mut result);
                    out.extend(result.0);
                }
                out
            },
        )
    }};
}

/// Eight numbers in the registers of an instruction set.
#[inline(always)]
fn load<S: Registers>(simd: S, cells: &Eight) -> Wide<S> {
    Lane::load(simd, cells)
}

fn bits(values: &[f64]) -> Vec<u64> {
    // The kind of NaN does not matter.
    values.iter().map(|v| if v.is_nan() { f64::NAN.to_bits() } else { v.to_bits() }).collect()
}

/// Dense near the origin, then to the ends of the range, in multiples of eight.
fn magnitudes() -> Vec<f64> {
    let mut out: Vec<f64> = (0..80_000).map(|i| f64::from(i) * 1e-3).collect();
    out.extend((-320..=308).map(|e| 10_f64.powi(e)));
    out.extend([0.0, f64::MIN_POSITIVE, f64::from_bits(1), f64::MAX, f64::INFINITY, 64.0, 64.000_001]);
    out.resize(out.len().next_multiple_of(EIGHT), 1.0);
    out
}

#[test]
fn exponential_equals_std() {
    let arguments = magnitudes();
    let found: Vec<f64> = arguments.iter().map(|&x| exp_of_negative(x)).collect();
    let mut worst = 0.0_f64;
    for (x, f) in arguments.iter().zip(&found) {
        let expected = (-x.min(64.0)).exp();
        worst = worst.max((f / expected - 1.0).abs());
    }
    println!("exponential: {worst:e}");
    assert!(worst <= 4e-14, "off by {worst:e}");
    assert_eq!(exp_of_negative(0.0_f64), 1.0);
    assert_eq!(exp_of_negative(-0.0_f64), 1.0);
    assert_eq!(exp_of_negative(f64::INFINITY), exp_of_negative(64.0));
    // A slip of NaN has the friction of fast slip.
    assert_eq!(exp_of_negative(f64::NAN), exp_of_negative(64.0));
    for wide in wide!(arguments, |x| exp_of_negative(x)) {
        assert_eq!(bits(&wide), bits(&found));
    }
    let nan = [f64::NAN; EIGHT];
    for wide in wide!(nan, |x| exp_of_negative(x)) {
        assert_eq!(wide, [exp_of_negative(64.0_f64); EIGHT]);
    }
}

#[test]
fn hyperbolic_tangent_equals_std() {
    let mut arguments = magnitudes();
    arguments.extend(magnitudes().iter().map(|x| -x));
    let found: Vec<f64> = arguments.iter().map(|&x| tanh(x)).collect();
    for (x, f) in arguments.iter().zip(&found) {
        assert!((x.tanh() - f).abs() <= 2e-14, "tanh({x}) = {f}");
    }
    for wide in wide!(arguments, |x| tanh(x)) {
        assert_eq!(bits(&wide), bits(&found));
    }
}

#[test]
fn arctangent_equals_std() {
    let mut points: Vec<(f64, f64)> = Vec::new();
    for k in 0..=40_000 {
        let (y, x) = (f64::from(k) * std::f64::consts::PI / 40_000.0).sin_cos();
        points.push((y.abs(), x));
    }
    let sizes = [0.0, f64::from_bits(1), 1e-300, 1e-160, 1e-9, 0.4142, 0.414_213_562_373_095_03, 1.0, 2.0, 1e9, 1e300];
    for y in sizes {
        for x in sizes {
            points.extend([(y, x), (y, -x)]);
        }
    }
    let mut worst = 0.0_f64;
    for &(y, x) in &points {
        // −0 is treated as 0.
        let expected = y.atan2(x + 0.0);
        let found = atan2_positive(y, x);
        assert!((0.0..=std::f64::consts::PI).contains(&found), "atan2({y}, {x}) = {found}");
        worst = worst.max((found - expected).abs());
    }
    println!("arctangent: {worst:e}");
    assert!(worst <= 1e-15, "off by {worst:e}");
    assert_eq!(atan2_positive(0.0, 0.0), 0.0);
    assert_eq!(atan2_positive(0.0, -0.0), 0.0);
    assert_eq!(atan2_positive(-0.0, 1.0), 0.0);
    assert!((atan2_positive(1.0, f64::INFINITY)).abs() <= 1e-15);
    assert!((atan2_positive(f64::INFINITY, 1.0) - std::f64::consts::FRAC_PI_2).abs() <= 1e-15);
}

#[test]
fn arctangent_is_equal_in_all_widths() {
    let slopes: Vec<f64> = magnitudes().into_iter().flat_map(|x| [x, -x]).collect();
    for y in [0.0, 1e-200, 1e-3, 1.0, 1e200, f64::INFINITY] {
        let scalar: Vec<f64> = slopes.iter().map(|&x| atan2_positive(y, x)).collect();
        for wide in wide!(slopes, |x| atan2_positive(x.splat(y), x)) {
            assert_eq!(bits(&wide), bits(&scalar), "y = {y}");
        }
    }
}

/// Numbers that comparisons and extremes may treat differently on different processors.
const ODD: [f64; EIGHT] = [0.0, -0.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1.5, -2.5, f64::MIN_POSITIVE];

#[test]
fn operations_on_special_values_are_equal_in_all_widths() {
    for a in ODD {
        let compare = |name: &str, scalar: fn(f64, f64) -> f64, wide: Vec<Vec<f64>>| {
            let expected: Vec<f64> = ODD.iter().map(|&x| scalar(x, a)).collect();
            for found in wide {
                assert_eq!(bits(&found), bits(&expected), "{name} of {ODD:?} and {a}");
            }
        };
        compare("max", Lane::max, wide!(ODD, |x| Lane::max(x, x.splat(a))));
        compare("min", Lane::min, wide!(ODD, |x| Lane::min(x, x.splat(a))));
        compare("abs", |x, _| Lane::abs(x), wide!(ODD, |x| Lane::abs(x)));
        compare("sqrt", |x, _| Lane::sqrt(x), wide!(ODD, |x| Lane::sqrt(x)));
        compare("negative", |x, _| -x, wide!(ODD, |x| -x));
        compare("fused", |x, a| Lane::mul_add(x, a, 0.1), wide!(ODD, |x| Lane::mul_add(x, x.splat(a), x.splat(0.1))));
        let lt = |x: f64, a: f64| if x < a { 1.0 } else { 0.0 };
        compare("lt", lt, wide!(ODD, |x| Lane::select(Lane::lt(x, x.splat(a)), x.splat(1.0), x.zero())));
        let le = |x: f64, a: f64| if x <= a { 1.0 } else { 0.0 };
        compare("le", le, wide!(ODD, |x| Lane::select(Lane::le(x, x.splat(a)), x.splat(1.0), x.zero())));
        let not = |x: f64, a: f64| if x < a { 0.0 } else { 1.0 };
        compare("not", not, wide!(ODD, |x| Lane::select(!Lane::lt(x, x.splat(a)), x.splat(1.0), x.zero())));
    }
}

#[test]
fn fused_multiply_adds_round_once() {
    let x = 1.0 + f64::EPSILON;
    // The rounding error of the product remains if nothing rounds twice.
    let product = x * x;
    let expected = f64::mul_add(x, x, -product);
    assert_ne!(expected, 0.0);
    let eight = [x; EIGHT];
    for found in wide!(eight, |x| Lane::mul_add(x, x, x.splat(-product))) {
        assert_eq!(found, [expected; EIGHT]);
    }
}

fn vec3(v: &Vector3<f64>) -> Vec3<f64> {
    Vec3::new(v.x, v.y, v.z)
}

fn to_nalgebra(q: Quat<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::new(q.w, q.v.x, q.v.y, q.v.z))
}

#[test]
fn turning_equals_nalgebra() {
    let axis = Vector3::new(0.3, -0.7, 0.5).normalize();
    let start = UnitQuaternion::from_euler_angles(0.4, -1.1, 2.3);
    let quat = Quat { w: start.w, v: vec3(&start.imag()) };
    for angle in [0.0, 1e-12, 1e-6, 1e-3, 0.01, 0.1, -0.1, 0.2] {
        let (turn, half) = (UnitQuaternion::new(axis * angle), vec3(&(axis * (0.5 * angle))));
        for (found, expected) in [(quat.turned(half), turn * start), (quat.turned_in_own_frame(half), start * turn)] {
            let found = to_nalgebra(found);
            assert!((found.norm() - 1.0).abs() < 1e-15);
            let off = (found.coords - expected.coords).norm();
            assert!(off <= if angle.abs() > 0.1 { 1e-13 } else { 1e-15 }, "{angle} rad: {off:e}");
        }
    }
    // Far beyond any valid step, it still rotates about the same axis in the same sense.
    for angle in [1.0, 3.0, 50.0] {
        let found = to_nalgebra(quat.turned(vec3(&(axis * (0.5 * angle))))) * start.inverse();
        assert!(found.axis().is_some_and(|found| (found.into_inner() - axis).norm() < 1e-12), "{angle} rad: {found}");
    }
}

#[test]
fn rotation_equals_nalgebra() {
    let attitude = UnitQuaternion::from_euler_angles(0.4, -1.1, 2.3);
    let rotation = Quat { w: attitude.w, v: vec3(&attitude.imag()) }.rotation();
    let (a, b) = (Vector3::new(1.0, -2.0, 3.0), Vector3::new(0.5, 0.25, -4.0));
    let near = |found: Vec3<f64>, expected: Vector3<f64>| {
        assert!((Vector3::new(found.x, found.y, found.z) - expected).norm() < 1e-14 * 10.0, "{found:?}, {expected}");
    };
    near(rotation.apply(vec3(&a)), attitude * a);
    near(rotation.apply_transposed(vec3(&a)), attitude.inverse() * a);
    near(vec3(&a).cross(vec3(&b)), a.cross(&b));
    assert!((vec3(&a).dot(vec3(&b)) - a.dot(&b)).abs() < 1e-14 * 10.0);
}

lane_struct! {
    #[derive(Clone, Debug, Default, PartialEq)]
    pub struct Numbers<T> {
        pub one: T,
        pub three: [T; 3],
    }
}

#[test]
fn lanes_round_trip_without_changing_others() {
    let numbers = |i: usize| {
        let x = i as f64 + 0.125;
        Numbers { one: x, three: [10.0 * x, -x, 1.0 / x] }
    };
    let mut eight = Numbers::<Eight>::default();
    for i in 0..EIGHT {
        eight.set_lane(i, &numbers(i));
    }
    for i in 0..EIGHT {
        assert_eq!(eight.lane(i), numbers(i));
        assert_eq!(eight.three[2].0[i], 1.0 / (i as f64 + 0.125));
    }
    eight.set_lane(3, &numbers(20));
    for i in 0..EIGHT {
        assert_eq!(eight.lane(i), numbers(if i == 3 { 20 } else { i }));
    }
}
