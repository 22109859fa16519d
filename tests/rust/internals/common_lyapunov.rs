//! A common Lyapunov function of several systems, where it exists.

use ballbot_control::common_lyapunov::common_lyapunov;
use nalgebra::Matrix4;

fn twice(a: f64, b: f64, c: f64, d: f64) -> Matrix4<f64> {
    Matrix4::new(a, b, 0.0, 0.0, c, d, 0.0, 0.0, 0.0, 0.0, a, b, 0.0, 0.0, c, d)
}

#[test]
fn a_common_function_is_found_beyond_the_guess() {
    let steps = [twice(0.5, 2.0, 0.0, 0.5), twice(0.6, 1.5, 0.0, 0.4), twice(0.5, 2.0, -0.05, 0.5)];
    let (p, ratio) = common_lyapunov(&steps, &Matrix4::identity()).unwrap();
    assert!(ratio < 1.0 && p.symmetric_eigenvalues().min() > 0.0);
    for g in steps {
        assert!((g.transpose() * p * g - p).symmetric_eigenvalues().max() < 0.0, "{p}");
        // The guess is not a Lyapunov function.
        assert!((g.transpose() * g - Matrix4::identity()).symmetric_eigenvalues().max() > 0.0);
    }
}

#[test]
fn systems_unstable_in_turns_have_no_solution() {
    let steps = [twice(0.5, 2.0, 0.0, 0.5), twice(0.5, 0.0, 2.0, 0.5)];
    assert!((steps[0] * steps[1]).complex_eigenvalues().iter().any(|pole| pole.norm() > 1.0));
    assert_eq!(common_lyapunov(&steps, &Matrix4::identity()), None);
    let unstable = [twice(1.1, 0.0, 0.0, 0.5)];
    assert_eq!(common_lyapunov(&unstable, &Matrix4::identity()), None);
    assert_eq!(common_lyapunov(&steps, &Matrix4::repeat(f64::NAN)), None);
}
