//! References: their derivatives, the flatness of the linear model, what is rejected, and robots that follow them.

use ballbot_core::control::{Motion, Reference, Setpoint, Turning, controller_kind};
use ballbot_core::models::LinearModel;
use ballbot_core::{Ballbot, ModelKind, Params, State};
use nalgebra::{SVector, Vector2, Vector3};
use std::collections::VecDeque;
use std::f64::consts::PI;

const CONTROL_DT: f64 = 0.01;

fn motions() -> Vec<(&'static str, Motion)> {
    let corners = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]];
    vec![
        ("move", Motion::Path { points: vec![[0.1, 0.0], [1.0, 0.4]], times: vec![0.0, 4.0] }),
        (
            "path",
            Motion::Path {
                points: vec![[0.0, 0.0], [0.6, 0.4], [1.2, -0.2], [2.0, 0.3]],
                times: vec![0.0, 2.5, 5.0, 7.5],
            },
        ),
        ("square", Motion::Stops { points: corners, times: vec![0.0, 4.0, 8.0, 12.0, 16.0] }),
        (
            "velocities",
            Motion::Velocities {
                velocities: vec![[0.5, 0.0], [0.2, 0.3], [0.0, 0.0]],
                times: vec![0.0, 2.0, 4.0],
                change: 1.5,
            },
        ),
        ("circle", Motion::Circle { radius: 0.5, period: 6.0, start: 4.0 }),
        ("lemniscate", Motion::Lemniscate { size: 0.5, period: 12.0, start: 4.0 }),
        ("attitude", Motion::Attitude { lean: 0.05, frequency: 0.5, start: 2.0 }),
    ]
}

fn made(motion: Motion) -> Reference {
    Reference::new(&Params::paper(), motion, Turning::default(), None).unwrap()
}

/// g and ℓ of the paper's robot, from its linear model: ÿ = (g − ℓ λ²) θ without motors.
fn plane(params: &Params) -> [f64; 3] {
    let LinearModel { a, b } = LinearModel::new(params);
    let turning = b.fixed_view::<3, 3>(7, 0).into_owned().try_inverse().unwrap();
    let lever = -(b.fixed_view::<2, 3>(5, 0) * turning)[(0, 1)];
    let toppling = a[(8, 3)];
    [a[(5, 3)] + lever * toppling, lever, toppling]
}

#[test]
fn derivatives_match_the_motion() {
    let [acceleration, lever, _] = plane(&Params::paper());
    for (name, motion) in motions() {
        let turning = Turning { yaw: 0.3, rate: 1.0, start: 2.0 };
        let reference = Reference::new(&Params::paper(), motion, turning, None).unwrap();
        const STEP: f64 = 1e-4;
        for k in 0..170 {
            let t = 0.0501 + 0.1 * f64::from(k);
            let [before, now, after] = [t - STEP, t, t + STEP].map(|t| reference.at(t));
            let rate = |of: fn(&Setpoint) -> Vector2<f64>| (of(&after) - of(&before)) / (2.0 * STEP);
            assert!((rate(|s| s.position) - now.velocity).norm() < 1e-6, "{name}: velocity at {t}");
            assert!((rate(|s| s.acceleration) - now.jerk).norm() < 1e-5, "{name}: jerk at {t}");
            assert!((rate(|s| s.jerk) - now.snap).norm() < 1e-4, "{name}: snap at {t}");
            let turned = (after.yaw - before.yaw + PI).rem_euclid(2.0 * PI) - PI;
            assert!((turned / (2.0 * STEP) - now.yaw_rate).abs() < 1e-6, "{name}: yaw at {t}");
            assert!(now.yaw.abs() <= PI, "{name}: yaw {}", now.yaw);
            // The equation without motor torques: ÿ = g θ − ℓ θ̈.
            let unactuated = now.acceleration - now.snap * (lever / acceleration);
            assert!((rate(|s| s.velocity) - unactuated).norm() < 1e-5, "{name}: acceleration at {t}");
        }
    }
}

#[test]
fn motions_begin_and_end_at_rest_where_they_should() {
    let at_rest = |name: &str, s: &Setpoint| {
        let moving = [s.velocity, s.acceleration, s.jerk, s.snap];
        assert!(moving.iter().all(|v| v.norm() < 1e-9), "{name}: {s:?}");
    };
    for (name, motion) in motions() {
        let reference = made(motion.clone());
        at_rest(name, &reference.at(0.0));
        at_rest(name, &reference.at(-1.0));
        if let Some(end) = reference.duration() {
            at_rest(name, &reference.at(end));
            at_rest(name, &reference.at(end + 100.0));
            let moved = reference.at(end + 100.0).position - reference.at(end).position;
            assert!(moved.norm() < 1e-12, "{name}: {moved}");
        }
        if let Motion::Path { points, times } | Motion::Stops { points, times } = motion {
            for (point, time) in points.into_iter().zip(times) {
                let left = (reference.at(time).position - Vector2::from(point)).norm();
                assert!(left < 1e-9, "{name}: {left} m from {point:?} at {time} s");
            }
        }
    }
}

#[test]
fn shapes_are_exact() {
    let circle = made(Motion::Circle { radius: 0.5, period: 6.0, start: 4.0 });
    let center = circle.at(10.0).position + circle.at(13.0).position;
    for k in 0..60 {
        let radius = (circle.at(4.0 + 0.1 * f64::from(k)).position - center / 2.0).norm();
        assert!((radius - 0.5).abs() < 1e-12, "{radius} m");
    }
    let eight = made(Motion::Lemniscate { size: 0.5, period: 12.0, start: 4.0 });
    let widest =
        (0..1200).map(|k| eight.at(4.0 + 0.01 * f64::from(k)).position).fold(Vector2::zeros(), |w, p| w.sup(&p));
    assert!((widest.x - 0.5).abs() < 1e-4 && (widest.y - 0.25).abs() < 1e-4, "{widest}");
    let (_, square) = motions().remove(2);
    let square = made(square);
    for k in 0..1600 {
        let p = square.at(0.01 * f64::from(k)).position;
        let off = [p.x, p.y, 1.0 - p.x, 1.0 - p.y].map(f64::abs).into_iter().fold(f64::INFINITY, f64::min);
        assert!(off < 1e-12, "{off} m off the square");
    }
    // The polynomial of a move from rest to rest.
    let line = made(Motion::Path { points: vec![[0.0, 0.0], [1.0, 0.0]], times: vec![0.0, 2.0] });
    let u: f64 = 0.3;
    let way = 126.0 * u.powi(5) - 420.0 * u.powi(6) + 540.0 * u.powi(7) - 315.0 * u.powi(8) + 70.0 * u.powi(9);
    let bend = (2520.0 * u.powi(3) - 12600.0 * u.powi(4) + 22680.0 * u.powi(5) - 17640.0 * u.powi(6)
        + 5040.0 * u.powi(7))
        / 4.0;
    let [acceleration, lever, _] = plane(&Params::paper());
    let found = line.at(0.6).position.x;
    assert!((found - (way - lever / acceleration * bend)).abs() < 1e-12, "{found}");
}

/// The motion with its torques solves ẋ = A x + B τ. (Simulated without feedback, rounding would grow by e^(6 t).)
#[test]
fn motions_with_their_torques_solve_the_linear_model() {
    let params = Params { ball_viscous_friction: 0.0, wheel_viscous_friction: 0.0, ..Params::paper() };
    let LinearModel { a, b } = LinearModel::new(&params);
    let [acceleration, lever, toppling] = plane(&params);
    let per_acceleration = b.fixed_view::<3, 3>(7, 0).into_owned().try_inverse().unwrap();
    for (name, motion) in motions() {
        let reference = Reference::new(&params, motion, Turning::default(), None).unwrap();
        for k in 0..1600 {
            let s = reference.at(0.01 * f64::from(k));
            let [lean, rate, turning] = [s.acceleration, s.jerk, s.snap].map(|v| v / acceleration);
            let (p, v, moving) = (s.position, s.velocity, s.acceleration - turning * lever);
            let x = SVector::from([p.x, p.y, -lean.y, lean.x, 0.0, v.x, v.y, -rate.y, rate.x, 0.0]);
            let changes =
                SVector::from([v.x, v.y, -rate.y, rate.x, 0.0, moving.x, moving.y, -turning.y, turning.x, 0.0]);
            let forward = turning - lean * toppling;
            let found = a * x + b * (per_acceleration * Vector3::new(-forward.y, forward.x, 0.0));
            assert!((found - changes).amax() < 1e-9, "{name}: {}", found - changes);
        }
    }
}

#[test]
fn motions_beyond_the_traction_are_rejected_with_a_feasible_time() {
    let params = Params::paper();
    let line = |seconds: f64| Motion::Path { points: vec![[0.0, 0.0], [1.0, 0.0]], times: vec![0.0, seconds] };
    let message = Reference::new(&params, line(2.0), Turning::default(), Some(1.0)).unwrap_err().to_string();
    println!("{message}");
    let seconds: f64 = message.split("in ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!(message.contains("lifts a wheel"), "{message}");
    let slower = Reference::new(&params, line(3.1), Turning::default(), Some(0.3)).unwrap_err().to_string();
    assert!(slower.contains("but 0.3 is allowed"), "{slower}");
    assert!(Reference::new(&params, line(seconds), Turning::default(), Some(1.0)).is_ok());
    assert!(Reference::new(&params, line(0.995 * seconds), Turning::default(), Some(1.0)).is_err());
    assert!(Reference::new(&params, line(2.0), Turning::default(), None).is_ok());
    for (motion, words) in [
        (Motion::Circle { radius: 0.5, period: 2.0, start: 4.0 }, "with a period of"),
        (Motion::Attitude { lean: 0.6, frequency: 1.0, start: 4.0 }, "a lean of"),
    ] {
        let message = Reference::new(&params, motion, Turning::default(), Some(0.9)).unwrap_err().to_string();
        assert!(message.contains(words), "{message}");
    }
}

/// Each leg counts, however short it is compared with the motion.
#[test]
fn short_legs_of_long_motions_are_rejected() {
    let rejected = |motion: Motion, turning: Turning| {
        assert!(Reference::new(&Params::paper(), motion, turning, Some(1.0)).is_err());
    };
    let (points, times) = (vec![[0.0; 2], [0.001, 0.0], [1.0, 0.0]], vec![0.0, 999.0, 1000.0]);
    rejected(Motion::Stops { points, times }, Turning::default());
    let velocities = vec![[0.0; 2], [3.0, 0.0], [3.0, 0.0]];
    rejected(Motion::Velocities { velocities, times: vec![0.0, 500.0, 999.9], change: 0.1 }, Turning::default());
    rejected(Motion::Hold { position: [0.0; 2] }, Turning { rate: 1e4, ..Turning::default() });
}

/// The torques of a motion act after the delay.
#[test]
fn a_controller_that_predicts_over_a_delay_follows_a_circle_equally_well() {
    let params = Params::paper();
    let circle = made(Motion::Circle { radius: 0.5, period: 4.0, start: 4.0 });
    let follow = |name: &str, delay: f64| {
        let kind = controller_kind(name).unwrap();
        let mut law = (kind.make)(&params, CONTROL_DT, &kind.limits, &[("delay", &[delay])]).unwrap();
        let mut robot = Ballbot::new(&params, ModelKind::Contact, 0.001).unwrap();
        robot.reset(&State::upright(&params)).unwrap();
        let mut queue = VecDeque::from([[0.0; 3]; 3]);
        let (mut sum, mut count) = (0.0, 0.0);
        for k in 0..1200 {
            let target = circle.at(f64::from(k) * CONTROL_DT);
            if k >= 800 {
                sum += (robot.state().ball_position.xy() - target.position).norm_squared();
                count += 1.0;
            }
            queue.push_back(law.wheel_torques(&robot.state(), &target).0);
            robot.step(queue.pop_front().unwrap(), 10).unwrap();
        }
        f64::sqrt(sum / count)
    };
    for name in ["lqr", "lqr_pi"] {
        let (without, with) = (follow(name, 0.0), follow(name, 0.03));
        println!("{name}: {:.2} mm without, {:.2} mm with the delay of 30 ms", without * 1e3, with * 1e3);
        assert!(with < 0.8 * without, "{name}: {with} m, without {without} m");
    }
}

#[test]
fn invalid_motions_are_rejected() {
    let rejected = |motion: Motion, words: &str| {
        let message = Reference::new(&Params::paper(), motion, Turning::default(), None).unwrap_err().to_string();
        assert!(message.contains(words), "{message}");
    };
    let path = |points: Vec<[f64; 2]>, times: Vec<f64>| Motion::Path { points, times };
    rejected(path(vec![[0.0; 2]], vec![0.0]), "number of points = 1");
    rejected(path(vec![[0.0; 2]; 2], vec![0.0]), "times has 1 values, expected 2");
    rejected(path(vec![[0.0; 2]; 2], vec![0.0, -1.0]), "times = -1");
    rejected(path(vec![[0.0; 2]; 2], vec![1.0, 2.0]), "times[0] = 1");
    rejected(path(vec![[0.0, f64::NAN]; 2], vec![0.0, 2.0]), "points = NaN");
    rejected(Motion::Circle { radius: 0.5, period: 0.0, start: 1.0 }, "period = 0");
    rejected(Motion::Circle { radius: -0.5, period: 1.0, start: 1.0 }, "radius = -0.5");
    rejected(Motion::Attitude { lean: 3.0, frequency: 1.0, start: 1.0 }, "lean = 3");
    rejected(Motion::Velocities { velocities: vec![], times: vec![], change: 1.0 }, "number of velocities = 0");
}

/// Error of the ball along a motion: root mean square and largest after `from` seconds, and the last.
fn follow(name: &str, reference: &Reference, from: f64, until: f64) -> [f64; 3] {
    let params = Params::paper();
    let kind = controller_kind(name).unwrap();
    let mut law = (kind.make)(&params, CONTROL_DT, &kind.limits, &[]).unwrap();
    let mut robot = Ballbot::new(&params, ModelKind::Contact, 0.001).unwrap();
    robot.reset(&State::upright(&params)).unwrap();
    let (mut sum, mut count, mut most, mut last) = (0.0, 0.0, 0.0_f64, 0.0);
    for k in 0.. {
        let t = k as f64 * CONTROL_DT;
        let target = reference.at(t);
        last = (robot.state().ball_position.xy() - target.position).norm();
        if t > until {
            break;
        }
        if t >= from {
            (sum, count, most) = (sum + last * last, count + 1.0, most.max(last));
        }
        let torques = law.wheel_torques(&robot.state(), &target);
        robot.step(torques, 10).unwrap();
    }
    [(sum / f64::max(count, 1.0)).sqrt(), most, last]
}

#[test]
fn robots_follow_motions() {
    let names = ["lqr", "lqi", "cascade_pid", "hierarchical_sliding_mode"];
    let circle = |period: f64| Motion::Circle { radius: 0.5, period, start: 4.0 };
    let line =
        |metres: f64, seconds: f64| Motion::Path { points: vec![[0.0; 2], [metres, 0.0]], times: vec![0.0, seconds] };
    for name in names {
        for (what, motion, from, until, largest_rms, largest_last) in [
            ("circle in 10 s", circle(10.0), 14.0, 24.0, 0.5, 1.0),
            ("circle in 6 s", circle(6.0), 10.0, 16.0, 1.5, 3.0),
            ("circle in 4 s", circle(4.0), 8.0, 12.0, 6.0, 10.0),
            ("lemniscate in 12 s", Motion::Lemniscate { size: 0.5, period: 12.0, start: 4.0 }, 4.0, 16.0, 0.5, 1.0),
            ("lemniscate in 6 s", Motion::Lemniscate { size: 0.5, period: 6.0, start: 4.0 }, 4.0, 10.0, 3.0, 3.0),
            ("1 m in 4 s", line(1.0, 4.0), 0.0, 4.0, 1.0, 1.0),
            ("1 m in 3.1 s", line(1.0, 3.1), 0.0, 3.1, 2.0, 3.0),
        ] {
            let [rms, most, last] = follow(name, &made(motion), from, until).map(|e| e * 1e3);
            println!("{name}, {what}: {rms:.2} mm rms, {most:.2} mm at most, {last:.2} mm at the end");
            assert!(rms < largest_rms && last < largest_last, "{name}, {what}: {rms} mm rms, {last} mm at the end");
        }
    }
}
